//! Derives cutting and puncture forces from the friction and the first insertion's drops.

use super::fit::{Fit, pieces};
use super::found::{Found, Known, Layer, PIECE, Reading};

/// The force rises already before the tip reaches a membrane; only this distance before the rise is used, in
/// diameters.
const NEAR: f64 = 0.15;
/// Travel before a drop over which the rise is linear, in diameters.
const RISE: f64 = 0.15;
/// Readings this close to a drop may belong to it, in diameters: the tissue springs back along the needle, with
/// friction, before the force falls.
const AT: f64 = 0.04;
/// Readings this close to a reversal of the recording, or to a drop whose rise is evaluated, are left out, in
/// diameters.
const TURNS: f64 = 0.01;
/// Travel after a drop in which the tissue springs back, in diameters.
const SPRINGS: f64 = 0.1;
/// Least ratio of a membrane's drop to other drops.
const MEMBRANE: f64 = 2.0;
/// Fewest intervals on either side of a bend.
const FEWEST: usize = 3;

pub(super) fn resistance(fit: &Fit, first: &[Reading], drops: &[[f64; 2]], diameter: f64) -> Found {
    let n = fit.layers;
    let mut cannot_tell = Vec::new();
    let largest = largest(drops, n);
    let certain = largest.len() == n;
    let membranes = if certain { largest } else { membranes(fit, drops) };
    if fit.is_double() && !certain {
        let why = "whose each was is told by where the boundaries lie, which is wrong where a membrane is pushed deeper than the next one";
        cannot_tell.push(format!("puncture forces for certain: {} drops were seen for {n} layers; {why}", drops.len()));
    }
    let layers = (0..n)
        .map(|i| {
            let mut layer = Layer {
                from_depth_m: None,
                friction_n_per_m: fit.friction(i),
                cutting_force_n: None,
                puncture_force_n: None,
            };
            if !fit.is_double() {
                of_one_insertion(&mut layer, i, fit, first, membranes.first().copied().flatten().filter(|_| certain), diameter);
                let lacking = [("cutting", layer.cutting_force_n), ("puncture", layer.puncture_force_n)];
                let forces: Vec<&str> = lacking.iter().filter(|(_, f)| f.is_none()).map(|(name, _)| *name).collect();
                let forces = (!forces.is_empty()).then(|| format!("{} force", forces.join(" and ")));
                let depth = (n > 1).then(|| "depth".to_owned());
                let all: Vec<String> = depth.into_iter().chain(forces).collect();
                if !all.is_empty() {
                    let why = "how far the tip pushes the tissue ahead of it, and so how much of the shaft rubs, shows in a second insertion";
                    cannot_tell.push(format!("{} of layer {}: {why}", all.join(", "), i + 1));
                }
                return layer;
            }
            layer.from_depth_m = Some(fit.begins(i));
            if !certain && drops.len() > n && i + 1 < n {
                let why = "there are more drops than layers, none much larger than others, and whose each was is not certain";
                cannot_tell.push(format!("cutting and puncture force of layer {}: {why}", i + 1));
                return layer;
            }
            let drop = membranes.get(i).copied().flatten();
            layer.puncture_force_n = drop.and_then(|d| less(before(first, d, diameter, AT)?, fit.above(i)));
            if layer.puncture_force_n.is_none() {
                cannot_tell.push(format!("puncture force of layer {}: no drop was seen, so it is no more than its cutting force", i + 1));
            }
            layer.cutting_force_n = if i + 1 == n {
                let end = first.last().map_or(0.0, |r| r[1]);
                fit.channel().and_then(|channel| less(before(first, end, diameter, TURNS)?, channel))
            } else {
                let next = membranes.get(i + 1).copied().flatten();
                let from = drop.unwrap_or(fit.comes(i)) + SPRINGS * diameter;
                next.and_then(|next| less(bend(first, from, next - TURNS * diameter, diameter)?, fit.above(i + 1)))
            };
            if layer.cutting_force_n.is_none() {
                let why = if i + 1 == n && fit.channel().is_some() {
                    "the friction of the second insertion takes up the whole force at the end of the first"
                } else if i + 1 == n {
                    "the second insertion doesn't come to the end of the first one's channel"
                } else {
                    "no membrane behind it, or no way of steady cutting before that, shows where the tip comes to its end"
                };
                cannot_tell.push(format!("cutting force of layer {}: {why}", i + 1));
            }
            layer
        })
        .collect();
    Found {
        layers,
        cannot_tell,
        alone: Vec::new(),
        rmse_n: fit.rmse(),
        drops_m: drops.iter().map(|d| d[0]).collect(),
        parts: Vec::new(),
    }
}

/// What one insertion and its way out tell beside the friction. The membrane at the surface breaks before any of the
/// shaft rubs. At the deepest as much of the shaft rubs as where the friction of the way out is complete: what the
/// force there is more is the last layer's cutting force.
fn of_one_insertion(layer: &mut Layer, i: usize, fit: &Fit, first: &[Reading], drop: Option<f64>, diameter: f64) {
    // the friction ends below the surface: where the layers are is not known
    if fit.comes(0) > NEAR * diameter {
        return;
    }
    if i == 0 {
        let force = drop.and_then(|d| before(first, d, diameter, AT));
        layer.puncture_force_n = force.filter(|f| f.value > 1.96 * f.standard_error);
    }
    if i + 1 == fit.layers {
        let end = first.last().map_or(0.0, |r| r[1]);
        let friction = fit.on_the_way_out(end - fit.pushed_m(end, diameter));
        // the needle may have left the channel's end before: along no more than the travel of the turn
        let turn = 0.5 * layer.friction_n_per_m.value * fit.turn_m(end);
        let friction = Known { standard_error: friction.standard_error.hypot(turn), ..friction };
        layer.cutting_force_n = before(first, end, diameter, TURNS).and_then(|force| less(force, friction));
    }
}

/// Depths of the largest drops, one per layer, in order, if the others are much smaller. Membranes are punctured one
/// after the other, however far each was displaced; other falls of the force come from a varying cutting force. Empty
/// if there are too few drops, or others of similar size.
fn largest(drops: &[[f64; 2]], layers: usize) -> Vec<Option<f64>> {
    let mut sizes: Vec<f64> = drops.iter().map(|d| d[1]).collect();
    sizes.sort_by(|a, b| b.total_cmp(a));
    let least = layers.checked_sub(1).and_then(|last| sizes.get(last).copied()).unwrap_or(f64::INFINITY);
    if least < MEMBRANE * sizes.get(layers).copied().unwrap_or(0.0) {
        return Vec::new();
    }
    drops.iter().filter(|d| d[1] >= least).map(|d| Some(d[0])).collect()
}

/// The drop of each layer's membrane: the largest after the last boundary that the tip can have reached.
fn membranes(fit: &Fit, drops: &[[f64; 2]]) -> Vec<Option<f64>> {
    let comes = |i: usize| drops.iter().filter(move |d| (0..fit.layers).rfind(|&k| fit.comes(k) <= d[0]) == Some(i));
    (0..fit.layers).map(|i| comes(i).max_by(|a, b| a[1].total_cmp(&b[1])).map(|d| d[0])).collect()
}

/// A force minus its friction; `None` if the difference is zero within its error.
fn less(force: Known, friction: Known) -> Option<Known> {
    let value = force.value - friction.value;
    let standard_error = force.standard_error.hypot(friction.standard_error);
    (value > 1.96 * standard_error).then_some(Known { value, standard_error })
}

/// Least-squares line with or without a bend: force at the bend, or at depth 0 without one; its standard error; sum
/// of squares.
#[allow(clippy::cast_precision_loss)]
fn line(points: &[[f64; 2]], at: f64, bent: bool) -> Option<(Known, f64, [f64; 2])> {
    let rows = |p: &[f64; 2]| [1.0, p[0] - at, if bent { (p[0] - at).max(0.0) } else { 0.0 }];
    let mut normal = nalgebra::Matrix3::zeros();
    let mut right = nalgebra::Vector3::zeros();
    for p in points {
        let row = nalgebra::Vector3::from(rows(p));
        normal += row * row.transpose();
        right += row * p[1];
    }
    if !bent {
        normal[(2, 2)] = 1.0;
    }
    let inverse = normal.try_inverse()?;
    let found = inverse * right;
    let squares: f64 = points.iter().map(|p| (nalgebra::Vector3::from(rows(p)).dot(&found) - p[1]).powi(2)).sum();
    let freedom = points.len().checked_sub(if bent { 4 } else { 2 }).filter(|n| *n > 0)? as f64;
    let standard_error = (squares / freedom * inverse[(0, 0)]).sqrt();
    Some((Known { value: found[0], standard_error }, squares, [found[1], found[1] + found[2]]))
}

/// Force just before a depth at which it drops or reverses, N, from readings no closer than `at` diameters.
fn before(first: &[Reading], depth: f64, diameter: f64, at: f64) -> Option<Known> {
    let near = |r: &&Reading| r[1] > depth - RISE * diameter && r[1] < depth - at * diameter;
    let points: Vec<[f64; 2]> = first.iter().filter(near).map(|r| [r[1], r[2]]).collect();
    line(&points, depth, false).map(|(force, ..)| force)
}

/// Force at the start of the rise to a drop, N. An evaluation over the whole interval is biased, since the force
/// rises already before the tip reaches the tissue ahead. So the interval just before it is used, with the difference
/// as an error.
fn bend(first: &[Reading], from: f64, to: f64, diameter: f64) -> Option<Known> {
    let on: Vec<Reading> = first.iter().filter(|r| r[1] > from && r[1] < to).copied().collect();
    let points = pieces(&on, PIECE * diameter);
    let (wide, mut at) = bent(&points)?;
    let mut force = wide;
    for _ in 0..3 {
        let near: Vec<[f64; 2]> = points.iter().filter(|p| p[0] > at - NEAR * diameter).copied().collect();
        let Some((narrow, place)) = bent(&near) else { break };
        (force, at) = (narrow, place);
    }
    let standard_error = force.standard_error.hypot(force.value - wide.value);
    Some(Known { value: force.value, standard_error })
}

/// Where a line bends upwards: force there, N, and depth, m.
fn bent(points: &[[f64; 2]]) -> Option<(Known, f64)> {
    let inner = points.get(FEWEST..points.len().checked_sub(FEWEST)?)?;
    let fits = inner.iter().filter_map(|p| Some((p[0], line(points, p[0], true)?)));
    let (at, (force, _, slopes)) = fits.min_by(|a, b| a.1.1.total_cmp(&b.1.1))?;
    (slopes[1] > slopes[0]).then_some((force, at))
}
