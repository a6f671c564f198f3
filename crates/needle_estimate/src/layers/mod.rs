//! Estimates friction, cutting and puncture forces of layers, and their boundaries, from a recording alone:
//! insertion, retraction, second insertion.
//!
//! It needs neither a run of the twin nor a modulus. The only assumption about the tissue: a slipping shaft displaces
//! it downwards during the insertion as much as upwards during the retraction.
//!
//! ```text
//! second insertion   F = sum of f_i times the shaft's length in layer i, which begins at k_i = z_i + u      nothing but friction
//! retraction         F = - the same, with k_i' = z_i - u                                                    so z_i = (k_i + k_i') / 2
//! at a boundary      the tip stands at z_i, so the friction is R_i = sum of f_j (z_j+1 - z_j) above it:
//!                    before a drop F = R_i + puncture force;  where the rise to the drop begins F = R_i + cutting force above it
//! at the deepest     the first insertion has cut as far as where the force of the second begins to rise: their difference is cutting
//! ```
//!
//! What is found must add up to the force: friction and what acts at the tip are the force of the first insertion, and
//! what acts at the tip is none that pulls. A friction that exceeds the reading anywhere is said ([`Found::beyond`]).
//!
//! The friction is a piecewise linear least-squares fit: linear in the forces per length, with a search for the
//! breakpoints.

mod fit;
mod found;
mod resistance;

use crate::compare::crossing::{Crossing, Crossings};
use fit::Fit;
use found::{AIR, PIECE};
pub use found::{Found, Known, Layer, LayersError, Part, Reading};
use needle_core::scene::Scene;
use needle_recording::{At, ForceSeries};

/// Least travel between two reversals of the recorded depth, in diameters of the needle.
const TURN: f64 = 0.5;
/// Travel after a drop within which the force falls, in diameters.
const FALLS: f64 = 0.2;
/// Number of depths at which the parts are compared with the reading.
const DEPTHS: usize = 20;
/// What friction may exceed a reading by, as a share of the insertion's largest, beside twice its standard error.
const SUM: f64 = 0.05;

/// Estimates a number of layers from a recording made with a needle of a diameter in m. Depth 0 is the undeformed
/// surface.
///
/// # Errors
/// If the recording lacks a retraction or readings in air, or does not determine the layers.
pub fn layers(readings: &[Reading], diameter: f64, layers: usize) -> Result<Found, LayersError> {
    let legs = legs(readings, TURN * diameter);
    let [first, out, second @ ..] = &legs[..] else { return Err(LayersError::NoWayOut) };
    let zero = zero(readings, AIR * diameter)?;
    let net =
        |leg: &[Reading]| -> Vec<Reading> { leg.iter().map(|&[t, d, f]| [t, d, f - zero[0] - zero[1] * t]).collect() };
    let (first, out) = (net(first), net(out));
    let again = second.first().map(|leg| net(leg));
    let seen = drops(&first, diameter);
    let drops: Vec<f64> = seen.iter().map(|d| d[0]).collect();
    let fit = Fit::new(&out, again.as_deref(), diameter, layers, &drops)?;
    let mut found = resistance::resistance(&fit, &first, &seen, diameter);
    if again.is_some() {
        let alone = Fit::new(&out, None, diameter, layers, &drops)?;
        found.alone = resistance::resistance(&alone, &first, &seen, diameter).cannot_tell;
    } else {
        found.alone.clone_from(&found.cannot_tell);
    }
    found.parts = parts(&fit, &first, diameter);
    Ok(found)
}

/// Friction and reading over the depth of the first insertion.
#[allow(clippy::cast_precision_loss)]
fn parts(fit: &Fit, first: &[Reading], diameter: f64) -> Vec<Part> {
    let Some(end) = first.last().map(|r| r[1]) else { return Vec::new() };
    let pushed = fit.pushed_m(end, diameter);
    let width = end / DEPTHS as f64;
    let means = fit::pieces(first, width);
    let peak = means.iter().map(|p| p[1].abs()).fold(0.0, f64::max);
    let part = |[depth_m, measured_n]: [f64; 2]| {
        let friction = fit.on_the_way_out(depth_m - pushed);
        let allowed_n = 2.0 * friction.standard_error + SUM * peak;
        Part { depth_m, measured_n, friction_n: friction.value, allowed_n }
    };
    means.into_iter().filter(|p| p[0] > 0.0).map(part).collect()
}

/// Estimates layers from a recording's readings, made with the needle of a scene.
///
/// # Errors
/// [`LayersError::NoNeedle`] if the scene has none; otherwise as [`layers`].
pub fn of_recording(
    scene: &Scene,
    readings: &[needle_recording::Reading],
    measured: &ForceSeries,
    number: usize,
) -> Result<Found, LayersError> {
    let diameter = scene.instrument.and_then(|i| i.needle_diameter_m()).ok_or(LayersError::NoNeedle)?;
    let top = scene.sample.shape.height().map_or(0.0, |h| h.get());
    let force = |r: &needle_recording::Reading| {
        let force = measured.at(r.time_s)?;
        Some(match r.at {
            At::Depth(depth) => [r.time_s, depth, force[2]],
            At::Pose(pose) => {
                let against = -(0..3).map(|k| force[k] * pose.axis[k]).sum::<f64>();
                [r.time_s, top - pose.tip[2], against]
            }
        })
    };
    layers(&readings.iter().filter_map(force).collect::<Vec<_>>(), diameter, number)
}

/// Insertions and retractions in turn, starting where the depth begins to grow. They are separated by reversals of
/// more than `turn`, m.
fn legs(readings: &[Reading], turn: f64) -> Vec<&[Reading]> {
    let (mut legs, mut start, mut extreme, mut down) = (Vec::new(), 0, 0, true);
    let depth = |i: usize| readings.get(i).map_or(0.0, |r| r[1]);
    for i in 0..readings.len() {
        let beyond = if down { depth(i) - depth(extreme) } else { depth(extreme) - depth(i) };
        if beyond >= 0.0 {
            extreme = i;
        } else if beyond < -turn {
            // skip a retraction before the first insertion
            if extreme > start || !legs.is_empty() {
                legs.extend(readings.get(start..=extreme));
            }
            (start, down, extreme) = (extreme, !down, i);
        }
    }
    if extreme > start && (depth(extreme) - depth(start)).abs() > turn {
        legs.extend(readings.get(start..=extreme));
    }
    legs
}

/// Reading without load at time 0, N, and its drift, N/s, from the readings in air; no drift if these cover too
/// little time.
fn zero(readings: &[Reading], above: f64) -> Result<[f64; 2], LayersError> {
    let air: Vec<&Reading> = readings.iter().filter(|r| r[1] < -above).collect();
    let (Some(a), Some(b), Some(begin), Some(end)) = (air.first(), air.last(), readings.first(), readings.last())
    else {
        return Err(LayersError::NoAir);
    };
    #[allow(clippy::cast_precision_loss)]
    let n = air.len() as f64;
    let mean = |k: usize| air.iter().map(|r| r[k]).sum::<f64>() / n;
    let (time, force) = (mean(0), mean(2));
    let spread: f64 = air.iter().map(|r| (r[0] - time).powi(2)).sum();
    let both: f64 = air.iter().map(|r| (r[0] - time) * (r[2] - force)).sum();
    let drift = if b[0] - a[0] > 0.25 * (end[0] - begin[0]) && spread > 0.0 { both / spread } else { 0.0 };
    Ok([force - drift * time, drift])
}

/// Depth, m, and size, N, of the drops: down to the lowest force while the tissue springs back.
fn drops(first: &[Reading], diameter: f64) -> Vec<[f64; 2]> {
    let mut crossings = Crossings::new(diameter);
    let seen = first.iter().filter_map(|&[t, d, f]| crossings.take(t, d, f));
    let size = |c: &Crossing| {
        let after = first.iter().filter(|r| (0.0..FALLS * diameter).contains(&(r[1] - c.depth_m)));
        let after: Vec<Reading> = after.copied().collect();
        fit::pieces(&after, PIECE * diameter).iter().map(|p| c.force_before_n - p[1]).fold(0.0, f64::max)
    };
    seen.map(|c| [c.depth_m, size(&c)]).collect()
}
