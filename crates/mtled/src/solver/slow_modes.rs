//! Slow modes with less inertia: tissue that is held by forces, as along a needle with friction, comes to rest in fewer steps.
//!
//! ```text
//! P = M^-1 + sum_k g_k phi_k phi_k^T        takes the place of M^-1
//! K phi_k = lambda_k M phi_k,   phi_k . M phi_k = 1,   g_k = omega^2 / lambda_k - 1
//! ```
//!
//! Each phi_k then oscillates at omega, the frequency of the slowest mode that is left as it is, in rad per step. The motion is quasi-static
//! and masses are numerical: where forces balance P does not matter. P is symmetric and positive whatever the phi_k are, so that they
//! decide about the number of steps and not about the force.
//!
//! The phi_k are those of the undeformed body with a rod along its whole path: nodes there move along the axis alone, and those of a layer as
//! one. What a constraint holds in a step takes no part in it. The modes see phi_k . (f - load), summed over what is free, and move that alone.
//!
//! They are found from the force alone, by Lanczos' method for a Chebyshev polynomial of A = M^-1/2 K M^-1/2. The polynomial is above one for the
//! wanted end of the spectrum, and within one for the rest (Saad, Numerical Methods for Large Eigenvalue Problems, 2011, chapters 6 and 7).

use nalgebra::{DMatrix, DVector, SymmetricEigen};

use super::contact::{By, Touch};
use super::drag::Drag;
use super::explicit::Solver;
use super::model::{Model, Workspace, with_kernel};
use super::nodes::Rule;
use super::slip::Slip;
use super::state::{Constraints, Control, Moving, Role, State, Tangent};
use crate::vector::dot;

/// Modes that get less inertia, at most.
const MODES: usize = 8;
/// Largest frequency that they are given, rad per step.
const FASTEST: f64 = 0.1;
/// Degree of the polynomial, and steps of Lanczos' method.
const DEGREE: usize = 33;
const STEPS: usize = 36;
/// Largest displacement of a trial field over the height of the body: small against the cells, large against round-off in single precision.
const AMPLITUDE: f64 = 1e-4;
/// End of the spectrum over its estimate, which is from below.
const MARGIN: f64 = 1.05;
/// Difference of a mode's Rayleigh quotient from what the polynomial says of it, up to which the mode was found.
const FOUND: f64 = 0.05;

/// phi_k of one node: its radial and its axial part, for each k. In single precision, which every member of an ensemble has its own of; P is as symmetric.
type Shape = [[f32; MODES]; 2];

/// Modes and what they gain.
#[derive(Debug, Clone)]
pub(super) struct SlowModes {
    shapes: Vec<Shape>,
    /// g_k; 0 of those that are not there.
    gains: [f64; MODES],
    /// Frequency of the slowest mode that is left, over what [`super::mass::FundamentalMode`] says of the body.
    faster: f64,
}

/// Adds phi_k . v of one node to the sums.
#[inline]
fn add_work(sums: &mut [f64; MODES], shape: &Shape, [radial, axial]: [f64; 2]) {
    for k in 0..MODES {
        sums[k] += f64::from(shape[0][k]) * radial + f64::from(shape[1][k]) * axial;
    }
}

/// sum_k a_k phi_k of one node.
#[inline]
fn moved(shape: &Shape, a: &[f64; MODES]) -> [f64; 2] {
    shape.each_ref().map(|shape| (0..MODES).map(|k| a[k] * f64::from(shape[k])).sum())
}

/// Whether a node moves as free tissue does.
#[inline]
fn is_free(role: Role, touch: &Touch) -> bool {
    role == Role::Free || (role == Role::Surface && touch.by == By::Nobody)
}

/// Places and nodes of the rod's layers that do not go with it.
fn slipping<'a>(drag: &'a Drag, slip: &'a Slip) -> impl Iterator<Item = (usize, usize)> + 'a {
    let places = drag.gripped().flat_map(|layer| drag.layer(layer));
    places.filter(|p| !slip.held[*p]).map(|p| (p, drag.nodes[p] as usize))
}

impl SlowModes {
    /// phi_k . v over what is free: `free` is v of a node, radial and axial, and `slips` its axial part at a place and a node of the rod's layers.
    fn work(
        &self,
        moving: &Moving,
        held: &Constraints,
        free: impl Fn(usize) -> [f64; 2],
        slips: impl Fn(usize, usize) -> f64,
    ) -> [f64; MODES] {
        let mut sums = [0.0; MODES];
        for (n, shape) in self.shapes.iter().enumerate() {
            if is_free(held.role[n], &moving.touch[n]) {
                add_work(&mut sums, shape, free(n));
            }
        }
        for (p, n) in slipping(&held.drag, &moving.slip) {
            add_work(&mut sums, &self.shapes[n], [0.0, slips(p, n)]);
        }
        sums
    }

    /// Calls `go` with node, axis and sum_k a_k phi_k of all that is free.
    fn move_all(
        &self,
        a: &[f64; MODES],
        (touch, slip, held): (&[Touch], &Slip, &Constraints),
        mut go: impl FnMut(usize, usize, f64),
    ) {
        for (n, shape) in self.shapes.iter().enumerate() {
            if is_free(held.role[n], &touch[n]) {
                let [radial, axial] = moved(shape, a);
                go(n, 0, radial);
                go(n, 2, axial);
            }
        }
        slipping(&held.drag, slip).for_each(|(_, n)| go(n, 2, moved(&self.shapes[n], a)[1]));
    }

    /// Adds to a step what it is with P more than with M^-1.
    pub(super) fn step(&self, moving: &mut Moving, held: &Constraints, rule: &Rule) {
        let down = held.drag.axis[2];
        let (f, load) = (&moving.f, &moving.slip.load);
        let mut ways = self.work(moving, held, |n| [f[n][0], f[n][2]], |p, n| f[n][2] - load[p] * down);
        ways.iter_mut().zip(&self.gains).for_each(|(way, gain)| *way *= -gain / rule.mass_factor);
        // the tangent motion learns a share of each deviation, and the instrument of a half plane moves along its axis alone
        let lesson = if rule.travel[2] == 0.0 { 0.0 } else { rule.learn * rule.gain[2] };
        let left = 1.0 - lesson * rule.travel[2];
        let Moving { u, q, tangent: Tangent([_, _, tangent]), touch, slip, .. } = moving;
        self.move_all(&ways, (touch, slip, held), |n, k, way| {
            u[n][k] += way;
            q[n][k] += left * way;
            tangent[n][k] += lesson * way;
        });
    }

    /// v . (M - P^-1) v, by the formula of Sherman, Morrison and Woodbury for modes of these masses. Those are without their common factor.
    pub(super) fn inertia_saved(&self, v: &[[f64; 3]], mass: &[f64], moving: &Moving, held: &Constraints) -> f64 {
        let sums = self.work(moving, held, |n| [mass[n] * v[n][0], mass[n] * v[n][2]], |_, n| mass[n] * v[n][2]);
        sums.iter().zip(&self.gains).map(|(sum, gain)| gain / (1.0 + gain) * sum * sum).sum()
    }

    /// Ends a power iteration on P K from the forces at u + h e in `image`: largest <- Ke . P Ke / e . Ke, e <- P K e.
    pub(super) fn learn_largest(&self, state: &mut State, image: &mut [[f64; 3]]) {
        let State { moving, constraints, control: Control { mass, probe, largest, .. }, .. } = state;
        let mut up = 0.0;
        for (n, force) in image.iter_mut().enumerate() {
            for k in 0..3 {
                force[k] = if constraints.role[n].frees(k) { force[k] - moving.f[n][k] } else { 0.0 };
                up += probe[n][k] * force[k];
            }
            probe[n] = force.map(|force| force / mass[n]);
        }
        let mut ways = self.work(moving, constraints, |n| [image[n][0], image[n][2]], |_, n| image[n][2]);
        ways.iter_mut().zip(&self.gains).for_each(|(way, gain)| *way *= gain);
        self.move_all(&ways, (&moving.touch, &moving.slip, constraints), |n, k, way| probe[n][k] += way);
        let down: f64 = image.iter().zip(&*probe).map(|(force, e)| dot(*force, *e)).sum();
        if up > 0.0 && (down / up).is_finite() {
            *largest = down / up;
        }
    }
}

impl Model {
    /// The slow modes that have less inertia in a state.
    pub(super) fn light_modes(&self, control: &Control) -> Option<&SlowModes> {
        self.modes.as_ref().filter(|_| control.light)
    }
}

impl Solver {
    /// Whether slow modes have less inertia from now on, where there are some ([`Model::with_slow_modes`]). What springs back after a membrane has
    /// broken swings less far without, and what is crushed under a tip turns over less often.
    pub fn lighten_slow_modes(&mut self, light: bool) {
        if let Some(modes) = &self.model.modes {
            let control = &mut self.state.control;
            (control.light, control.faster) = if light { (true, modes.faster) } else { (false, 1.0) };
        }
    }
}

/// The space that the modes are looked for in: the parameters of a half plane, radial and axial by turns, times M^1/2.
struct Space<'a> {
    model: &'a Model,
    state: State,
    /// M^1/2 of each node.
    root: Vec<f64>,
}

impl Space<'_> {
    /// The part that the constraints leave.
    fn project(&self, y: &mut DVector<f64>) {
        let Model { rest, points, .. } = self.model;
        for (n, role) in rest.role.iter().enumerate() {
            // on the axis the radial parameter has no force
            y[2 * n] *= f64::from(u8::from(role.frees(0) && points[n][0] != 0.0));
            y[2 * n + 1] *= f64::from(u8::from(role.frees(2)));
        }
        for layer in 0..rest.drag.walls.len() {
            let nodes = || rest.drag.layer(layer).map(|p| rest.drag.nodes[p] as usize);
            let held = nodes().any(|n| !rest.role[n].frees(2));
            let mass: f64 = nodes().map(|n| self.root[n] * self.root[n]).sum();
            let way = nodes().map(|n| self.root[n] * y[2 * n + 1]).sum::<f64>() / mass;
            for n in nodes() {
                (y[2 * n], y[2 * n + 1]) = (0.0, if held { 0.0 } else { way * self.root[n] });
            }
        }
    }

    /// A y, by a central difference of the force.
    fn stiffness(&self, y: &DVector<f64>, work: &mut Workspace) -> DVector<f64> {
        let way = |n: usize| [y[2 * n] / self.root[n], 0.0, y[2 * n + 1] / self.root[n]];
        let nodes = self.root.len();
        let largest = (0..nodes).flat_map(way).fold(0.0_f64, |most, c| most.max(c.abs()));
        let h = AMPLITUDE * self.model.mode.height() / largest;
        let mut out = DVector::zeros(2 * nodes);
        for side in [h, -h] {
            let Workspace { pool, scratch, image, .. } = work;
            image.iter_mut().enumerate().for_each(|(n, at)| *at = way(n).map(|c| side * c));
            with_kernel!((&self.model.kernel, &self.state.points, scratch) => (k, points, scratch) {
                k.force(points, &self.state.moving.memory, scratch, pool, image);
                k.node_forces(scratch, pool, image);
            });
            for (n, force) in image.iter().enumerate() {
                let share = 2.0 * side * self.root[n];
                (out[2 * n], out[2 * n + 1]) = (out[2 * n] + force[0] / share, out[2 * n + 1] + force[2] / share);
            }
        }
        self.project(&mut out);
        out
    }

    /// A field that excites all modes: noise, and a load along the path.
    fn start(&self) -> DVector<f64> {
        let rest = &self.model.rest;
        let mut y = DVector::from_iterator(2 * self.root.len(), rest.control.probe.iter().flat_map(|e| [e[0], e[2]]));
        let load = y.norm();
        rest.drag.nodes.iter().for_each(|&n| y[2 * n as usize + 1] += load);
        self.project(&mut y);
        y
    }
}

/// Eigenvalues below `low` and their vectors, in rising order, of a symmetric operator whose spectrum ends at `high`.
fn slowest(
    mut apply: impl FnMut(&DVector<f64>) -> DVector<f64>,
    project: impl Fn(&mut DVector<f64>),
    start: DVector<f64>,
    [low, high]: [f64; 2],
) -> Vec<(f64, DVector<f64>)> {
    let (middle, half) = (0.5 * (high + low), 0.5 * (high - low));
    let mut polynomial = |y: &DVector<f64>| {
        let mut scaled = |y: &DVector<f64>| (y * middle - apply(y)) / half;
        let (mut before, mut now) = (y.clone(), scaled(y));
        for _ in 1..DEGREE {
            let next = 2.0 * scaled(&now) - before;
            before = std::mem::replace(&mut now, next);
        }
        // what round-off leaves outside the space would grow as what is slowest does
        project(&mut now);
        now
    };
    let mut basis = vec![start.normalize()];
    let mut projected = DMatrix::zeros(STEPS, STEPS);
    for i in 0..STEPS {
        let mut next = polynomial(&basis[i]);
        for (j, own) in basis.iter().enumerate() {
            let share = next.dot(own);
            (projected[(i, j)], projected[(j, i)]) = (share, share);
            next -= share * own;
        }
        // once more, so that they are orthogonal to the last bit
        basis.iter().for_each(|own| next -= next.dot(own) * own);
        let norm = next.norm();
        if norm <= f64::EPSILON * projected[(0, 0)].abs() {
            break;
        }
        basis.push(next / norm);
    }
    let size = basis.len().min(STEPS);
    let eigen = SymmetricEigen::new(projected.view((0, 0), (size, size)).into_owned());
    let mut found = Vec::new();
    for (value, shares) in
        eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()).filter(|(value, _)| **value > 1.0)
    {
        let vector: DVector<f64> = basis.iter().zip(shares.iter()).map(|(own, share)| own * *share).sum();
        let quotient = vector.dot(&apply(&vector)) / vector.norm_squared();
        let expected = middle - half * (value.acosh() / DEGREE as f64).cosh();
        if quotient > 0.0 && (quotient - expected).abs() <= FOUND * expected {
            found.push((quotient, vector.normalize()));
        }
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    found
}

impl Model {
    /// With less inertia of the slowest modes of a half plane (see `solver::slow_modes`); after [`Model::with_rod`].
    #[must_use]
    pub fn with_slow_modes(mut self) -> Self {
        let mut work = Workspace::new(&self, 1);
        let control = &self.rest.control;
        let root: Vec<f64> = control.mass.iter().map(|m| m.sqrt()).collect();
        let space = Space { model: &self, state: self.undeformed(), root };
        let spectrum = [FASTEST * FASTEST, MARGIN * control.largest];
        let apply = |y: &DVector<f64>| space.stiffness(y, &mut work);
        let found = slowest(apply, |y| space.project(y), space.start(), spectrum);
        // all get the frequency of the first that is left
        let next = found.get(MODES).map_or(FASTEST, |(lambda, _)| lambda.sqrt());
        let mut modes = SlowModes {
            shapes: vec![Shape::default(); space.root.len()],
            gains: [0.0; MODES],
            faster: next / self.mode.frequency(control.mass.iter().copied()),
        };
        for (k, (lambda, y)) in found.iter().take(MODES).enumerate() {
            modes.gains[k] = next * next / lambda - 1.0;
            for (n, (shape, root)) in modes.shapes.iter_mut().zip(&space.root).enumerate() {
                (shape[0][k], shape[1][k]) = ((y[2 * n] / root) as f32, (y[2 * n + 1] / root) as f32);
            }
        }
        (self.rest.control.light, self.rest.control.faster) = (true, modes.faster);
        self.modes = Some(modes);
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of a diagonal matrix with a spectrum as that of a half plane: all that are slow, each once, and nothing else.
    #[test]
    fn slow_modes_of_a_diagonal_matrix_are_found() {
        let slow = [0.018, 0.021, 0.027, 0.031, 0.035, 0.043, 0.047, 0.0496, 0.052];
        let value = |i: usize| slow.get(i).map_or(0.01 + 3.0 * (i as f64 / 400.0), |omega| omega * omega);
        let diagonal = DVector::from_fn(400, |i, _| value(i));
        let start = DVector::from_fn(400, |i, _| ((i * 7919) % 101) as f64 / 50.0 - 0.993);
        let found = slowest(|y| y.component_mul(&diagonal), |_| {}, start, [0.01, 3.1]);
        assert_eq!(found.len(), slow.len(), "{:?}", found.iter().map(|f| f.0.sqrt()).collect::<Vec<_>>());
        for (i, (omega, (value, vector))) in slow.iter().zip(&found).enumerate() {
            assert!((value.sqrt() / omega - 1.0).abs() < 1e-6, "{omega}: {value}");
            assert!((vector[i].abs() - 1.0).abs() < 1e-4, "{omega}: {}", vector[i]);
        }
    }
}
