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
mod resistance;

use crate::compare::crossing::{Crossing, Crossings};
use fit::Fit;
use needle_core::scene::Scene;
use needle_recording::{At, ForceSeries};

/// Least travel between two reversals of the recorded depth, in diameters of the needle.
const TURN: f64 = 0.5;
/// Travel after a drop within which the force falls, in diameters.
const FALLS: f64 = 0.2;
/// Width of the intervals over which readings are averaged, in diameters.
const PIECE: f64 = 0.025;
/// Height above the surface from which on readings are in air, in diameters.
const AIR: f64 = 0.2;

/// Number of depths at which the parts are compared with the reading.
const DEPTHS: usize = 20;
/// Largest way, in diameters, that the tip of the first insertion counts as having pushed tissue ahead of it, so that less of the
/// shaft rubs than the depth says.
const PUSHED: f64 = 4.0;
/// What friction may exceed a reading by, as a share of the insertion's largest, beside twice its standard error.
const SUM: f64 = 0.05;

/// A value and its standard error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Known {
    /// Value.
    pub value: f64,
    /// Standard error.
    pub standard_error: f64,
}

/// Estimates for a layer; `None`: not determined by the recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layer {
    /// Depth of its upper boundary in undeformed tissue, m.
    pub from_depth_m: Option<Known>,
    /// Friction per length, N/m.
    pub friction_n_per_m: Known,
    /// Cutting force at the tip, N.
    pub cutting_force_n: Option<Known>,
    /// Puncture force at the layer's upper boundary, N; `None` also if no drop was seen.
    pub puncture_force_n: Option<Known>,
}

/// The force of the first insertion at a depth, and what of it is friction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part {
    /// Depth, m.
    pub depth_m: f64,
    /// Reading less the zero, N.
    pub measured_n: f64,
    /// Friction along the shaft that was found, N.
    pub friction_n: f64,
    /// What the friction may exceed the reading by, N.
    pub allowed_n: f64,
}

impl Part {
    /// The rest, N: cutting, and tissue that the tip pushes ahead.
    #[must_use]
    pub fn at_the_tip_n(&self) -> f64 {
        self.measured_n - self.friction_n
    }
}

/// Result of the estimation.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// Layers from the surface down.
    pub layers: Vec<Layer>,
    /// Quantities that can't be determined, each with the reason.
    pub cannot_tell: Vec<String>,
    /// Quantities that the first insertion and its retraction alone would not have determined.
    pub alone: Vec<String>,
    /// Root mean square residual of the friction's fit, N.
    pub rmse_n: f64,
    /// Depths of the drops of the first insertion, m.
    pub drops_m: Vec<f64>,
    /// What the force of the first insertion consists of, from the surface down.
    pub parts: Vec<Part>,
}

impl Found {
    /// Where the friction that was found exceeds the measured force most, if it does anywhere: it is then no friction
    /// of this recording.
    #[must_use]
    pub fn beyond(&self) -> Option<&Part> {
        let beyond = |p: &&Part| p.friction_n > p.measured_n + p.allowed_n;
        self.parts.iter().filter(beyond).min_by(|a, b| a.at_the_tip_n().total_cmp(&b.at_the_tip_n()))
    }
}

/// Why a recording can't be evaluated.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LayersError {
    /// The scene's instrument is not a needle.
    #[error("the scene's instrument is no needle: name one with --scene")]
    NoNeedle,
    /// No retraction.
    #[error(
        "the recording has no way out after an insertion, and one insertion alone can't tell friction from cutting: record both, and a second"
    )]
    NoWayOut,
    /// No readings in air.
    #[error(
        "the recording has no readings above the surface, so the force's zero is not known: withdraw the needle out of it"
    )]
    NoAir,
    /// Too few readings.
    #[error("the recording has too few readings for {0} layers: fewer layers, or more readings")]
    Few(usize),
    /// The readings don't determine the friction's breakpoints.
    #[error("the readings don't determine the friction of {0} layers: try fewer")]
    Undetermined(usize),
}

/// A reading: time in s, depth in m, force against the insertion in N.
pub type Reading = [f64; 3];

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
