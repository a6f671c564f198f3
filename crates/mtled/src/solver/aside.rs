//! Across and along a rod: how nodes that it drags are held off its axis, and what they contribute to the balance.
//!
//! u = h' + s a: a is the unit vector along the rod, s the way of the node along it ([`super::drag`]), and h' the part across the rod of h,
//! how far the rod has moved sideways at the node's depth. For an upright rod these are z and x, y.
//!
//! A node that is guided along an oblique line ([`super::state::Role::Guided`]) is held along it and has its spring across it.

use super::contact::By;
use super::drag::Drag;
use super::inertia::Sums;
use super::nodes::{Held, Rule};
use super::state::{Moving, Path};
use crate::vector::dot;

/// a . v
#[inline]
pub(super) fn along(v: &[f64; 3], axis: &[f64; 3]) -> f64 {
    dot(*v, *axis)
}

/// v less its part along the axis.
#[inline]
pub(super) fn across(v: &[f64; 3], axis: &[f64; 3]) -> [f64; 3] {
    let share = along(v, axis);
    std::array::from_fn(|k| v[k] - share * axis[k])
}

/// Horizontal h with the same part across the axis as u.
pub(super) fn aside(u: &[f64; 3], axis: &[f64; 3]) -> [f64; 3] {
    let s = u[2] / axis[2];
    [u[0] - s * axis[0], u[1] - s * axis[1], 0.0]
}

/// Where a path has h at the share s of its way.
fn at(path: &Path, s: f64) -> [f64; 3] {
    [path.at(s, 0), path.at(s, 1), 0.0]
}

/// What moves of a dragged node: its displacement, its velocity off the tangent motion, its tangent motions.
pub(super) type Dragged<'a> = (&'a mut [f64; 3], &'a mut [f64; 3], &'a mut [[f64; 3]; 3]);

/// Takes a dragged node that is held rigidly to its place across the rod.
pub(super) fn place((u, q, tangent): Dragged<'_>, held: &Held<'_>, path: &Path, s: f64, rule: &Rule) {
    let (axis, to) = (&held.rod, at(path, s));
    let way = along(u, axis) - along(&to, axis);
    let next: [f64; 3] = std::array::from_fn(|k| to[k] + way * axis[k]);
    for (t, gain) in tangent.iter_mut().zip(rule.gain) {
        let known = along(t, axis);
        *t = std::array::from_fn(|k| known * axis[k] + (next[k] - u[k]) * gain);
    }
    let known = along(q, axis);
    *q = axis.map(|a| known * a);
    *u = next;
}

/// Moves a dragged node that a spring holds across the rod. The spring is that at the end of the step, so that it is stable however stiff.
pub(super) fn pull(
    (u, q, tangent): Dragged<'_>,
    f: &[f64; 3],
    inverse: f64,
    held: &Held<'_>,
    path: &Path,
    s: f64,
    rule: &Rule,
) {
    let axis = &held.rod;
    let spring = path.spring * inverse;
    let drift: [f64; 3] = std::array::from_fn(|k| rule.drift(tangent, k));
    let free: [f64; 3] = std::array::from_fn(|k| drift[k] + rule.keep * q[k] - f[k] * inverse);
    let [free, drift, to, from] = [free, drift, at(path, s), *u].map(|v| across(&v, axis));
    let known = along(q, axis);
    for k in 0..3 {
        let v = (free[k] + spring * (to[k] - from[k])) / (1.0 + spring);
        u[k] += v;
        q[k] = rule.teach(tangent, k, v - drift[k]) + known * axis[k];
    }
}

/// The same of a node that stands, and the internal force on it.
pub(super) type Stood<'a> = (&'a [f64; 3], &'a [f64; 3], &'a [[f64; 3]; 3], &'a [f64; 3]);

/// What holds a dragged node across the rod contributes to the balance.
pub(super) fn sums(
    sums: &mut Sums,
    (u, q, tangent, f): Stood<'_>,
    place: &[f64; 3],
    mass: f64,
    held: &Held<'_>,
    path: &Path,
) {
    let axis = &held.rod;
    let f = across(f, axis);
    if path.spring == f64::INFINITY {
        sums.add_held(By::Instrument, place, &f.map(|f| -f));
        return;
    }
    let (to, from, q) = (across(&[path.end[0], path.end[1], 0.0], axis), across(u, axis), across(q, axis));
    let pulls: [f64; 3] = std::array::from_fn(|k| path.spring * (to[k] - from[k]));
    sums.add_held(By::Instrument, place, &pulls.map(|pull| -pull));
    add_across(sums, (&q, tangent), &std::array::from_fn(|k| f[k] - pulls[k]), mass, axis);
}

/// What moves across a line contributes: its velocity there, and its force less the spring's.
fn add_across(sums: &mut Sums, (q, tangent): (&[f64; 3], &[[f64; 3]; 3]), left: &[f64; 3], mass: f64, axis: &[f64; 3]) {
    for k in 0..3 {
        sums.kinetic += 0.5 * mass * q[k] * q[k];
        sums.present += q[k] * left[k];
    }
    for (learnt, t) in sums.learnt.iter_mut().zip(tangent) {
        let t = across(t, axis);
        (0..3).for_each(|k| *learnt += t[k] * left[k]);
    }
}

/// Moves a node that is guided along an oblique line. The spring is that at the end of the step, as in [`pull`].
pub(super) fn guide((u, q, tangent): Dragged<'_>, f: &[f64; 3], inverse: f64, path: &Path, s: f64, rule: &Rule) {
    let axis = &path.along;
    let spring = path.spring * inverse;
    let drift: [f64; 3] = std::array::from_fn(|k| rule.drift(tangent, k));
    let free: [f64; 3] = std::array::from_fn(|k| drift[k] + rule.keep * q[k] - f[k] * inverse);
    let gap: [f64; 3] = std::array::from_fn(|k| path.at(s, k) - u[k]);
    let way = along(&gap, axis);
    let [free, drift, gap] = [free, drift, gap].map(|v| across(&v, axis));
    for k in 0..3 {
        let v = (free[k] + spring * gap[k]) / (1.0 + spring);
        u[k] += v + way * axis[k];
        q[k] = rule.teach(tangent, k, v - drift[k]);
    }
    for (t, gain) in tangent.iter_mut().zip(rule.gain) {
        let off = way * gain - along(t, axis);
        (0..3).for_each(|k| t[k] += off * axis[k]);
    }
    *q = across(q, axis);
}

/// What guides a node along an oblique line contributes to the balance.
pub(super) fn guided_sums(sums: &mut Sums, (u, q, tangent, f): Stood<'_>, place: &[f64; 3], mass: f64, path: &Path) {
    let axis = &path.along;
    let gap: [f64; 3] = std::array::from_fn(|k| path.spring * (path.end[k] - u[k]));
    let (pulls, push, f) = (across(&gap, axis), along(f, axis), across(f, axis));
    sums.add_held(By::Instrument, place, &std::array::from_fn(|k| -pulls[k] - push * axis[k]));
    add_across(sums, (q, tangent), &std::array::from_fn(|k| f[k] - pulls[k]), mass, axis);
}

impl Drag {
    /// What the dragged nodes contribute to the balance along the axis.
    pub(super) fn sums(&self, state: &Moving, points: &[[f64; 3]], mass: &[f64], mass_factor: f64) -> Sums {
        let mut sums = Sums::default();
        if self.nodes.is_empty() {
            // no rod: not even the sign of a zero is another
            return sums;
        }
        let axis = &self.axis;
        let Moving { u, q, tangent, f, slip, .. } = state;
        for layer in self.gripped() {
            for p in self.layer(layer) {
                let n = self.nodes[p] as usize;
                let left = along(&f[n], axis) - slip.load[p];
                let mut going = tangent.of(n).map(|t| along(&t, axis));
                if slip.held[p] {
                    // per metre into the body
                    going[2] = 1.0 / axis[2].abs();
                }
                let place = std::array::from_fn(|k| points[n][k] + u[n][k]);
                sums.add_held(By::Instrument, &place, &axis.map(|a| -a * slip.load[p]));
                let with = |s: f64| axis.map(|a| s * a);
                sums.add_free(
                    mass[n] * mass_factor,
                    &with(along(&q[n], axis)),
                    going.map(with).each_ref(),
                    &with(left),
                );
            }
        }
        sums
    }
}
