//! Drives a twin with a stream of poses, one at a time, as fast as the machine allows, and keeps what comes out.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use super::{Answer, Collector, Keep, Run};
use needle_core::scene::{Region, Scene};
use needle_core::twin::{BuildError, Halt, StampedPose, Twin};
use needle_recording::{At, ForceSeries, Reading};

/// Observes a run.
pub trait Watch {
    /// One pose was answered, or refused (`None`); `done` of them in all.
    fn progress(&mut self, done: usize, answer: Option<&Answer>);

    /// Whether to end here.
    fn stop(&self) -> bool;

    /// A flag that is set when the run is to end, to be seen inside a pose.
    fn stop_flag(&self) -> Option<Arc<AtomicBool>> {
        None
    }
}

/// Watches nothing and stops nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Unwatched;

impl Watch for Unwatched {
    fn progress(&mut self, _: usize, _: Option<&Answer>) {}

    fn stop(&self) -> bool {
        false
    }
}

/// Builds the twin of a scene; the second value is the wall time that it took, s.
///
/// # Errors
/// [`BuildError`] if the scene can't be discretised.
pub fn build(scene: &Scene) -> Result<(Twin, f64), BuildError> {
    let start = Instant::now();
    let twin = Twin::new(scene)?;
    Ok((twin, start.elapsed().as_secs_f64()))
}

/// The same as a sibling of another twin where it can be one ([`Twin::sibling`]).
///
/// # Errors
/// [`BuildError`] if the scene can't be discretised.
pub fn build_beside(scene: &Scene, other: Option<&Twin>) -> Result<(Twin, f64), BuildError> {
    let start = Instant::now();
    let twin = other.and_then(|other| other.sibling(scene)).map_or_else(|| Twin::new(scene), Ok)?;
    Ok((twin, start.elapsed().as_secs_f64()))
}

/// The same on the cloud that the scene has with other regions ([`Twin::on_cloud_of`]).
///
/// # Errors
/// [`BuildError`] if the scene can't be discretised.
pub fn build_on(scene: &Scene, regions: &[Region]) -> Result<(Twin, f64), BuildError> {
    let start = Instant::now();
    let twin = Twin::on_cloud_of(scene, regions)?;
    Ok((twin, start.elapsed().as_secs_f64()))
}

/// Sends readings into a fresh twin, in their order, and collects a [`Run`]. A pose that the twin refuses is counted
/// and left out, and so is one that a model that diverged has no answer to: see [`Twin::step`] for how it comes back.
///
/// Only the steps are timed. A deadline counts as missed where a step took longer than the time to the next reading.
pub fn drive(
    twin: &mut Twin,
    readings: impl IntoIterator<Item = Reading>,
    measured: Option<&ForceSeries>,
    mut collector: Collector,
    watch: &mut dyn Watch,
) -> Run {
    collector.on_one_clock(measured.is_some_and(ForceSeries::one_clock));
    collector.over_holes(measured.map_or(&[], ForceSeries::holes));
    if let Some(flag) = watch.stop_flag() {
        twin.stop_on(flag);
    }
    let mut readings = readings.into_iter().peekable();
    let mut done = 0;
    while let Some(reading) = readings.next() {
        if watch.stop() {
            collector.lost(format!("interrupted after {done} poses"));
            break;
        }
        let pose = stamped(twin, reading);
        let start = Instant::now();
        let result = twin.follow(pose);
        let latency_s = start.elapsed().as_secs_f64();
        done += 1;
        match result {
            Ok(prediction) if prediction.force_n.iter().all(|f| f.is_finite()) => {
                let force = measured.and_then(|series| series.at(reading.time_s));
                let answer = collector.answered(twin, &prediction, pose.pose.axis, force, latency_s);
                if readings.peek().is_some_and(|next| latency_s > next.time_s - reading.time_s) {
                    collector.missed_deadline();
                }
                watch.progress(done, Some(&answer));
            }
            Ok(prediction) => {
                collector.diverged(not_finite(prediction.depth_m));
                break;
            }
            Err(Halt::Pose { reason }) => {
                collector.refused(&format!("at {} s: {reason}", reading.time_s));
                watch.progress(done, None);
            }
            Err(Halt::Interrupted) => {
                collector.lost(format!("interrupted after {} poses", done - 1));
                break;
            }
            Err(halt) => {
                collector.diverged(halt.to_string());
                watch.progress(done, None);
            }
        }
    }
    let compared = collector.run().answers.iter().any(|answer| answer.measured_n.is_some());
    if measured.is_some_and(|series| !series.is_empty()) && !compared {
        collector.lost("nothing was compared: no force was measured at the time of an answered pose".to_owned());
    }
    collector.finish(twin)
}

/// What a run says that has lost its numbers.
pub(super) fn not_finite(depth_m: f64) -> String {
    format!("the force is not finite at depth {depth_m:.6} m")
}

/// The pose of a reading.
pub(super) fn stamped(twin: &Twin, reading: Reading) -> StampedPose {
    let pose = match reading.at {
        At::Depth(depth_m) => twin.pose_at_depth(depth_m),
        At::Pose(pose) => pose,
    };
    StampedPose { time_s: reading.time_s, pose }
}

impl Keep {
    /// Answers only: no field is computed.
    pub const ANSWERS: Self = Self { fields: false, duration_s: None, save_every_s: None };
}
