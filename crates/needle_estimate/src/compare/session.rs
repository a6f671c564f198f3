//! Session: drives a twin with readings, and collects answers, comparison, events and figures. All runs use it.

use std::time::Instant;

use super::watch::{Cancel, Watch};
use super::{Collector, Keep, Run};
use needle_core::scene::{Region, Scene};
use needle_core::twin::{BuildError, Halt, StampedPose, Twin};
use needle_recording::{At, ForceSeries, Reading, Recording};

/// A fresh twin, what its answers are compared with, and what is kept of them.
///
/// ```
/// use needle_core::scene::Scene;
/// use needle_estimate::compare::{Cancel, Keep, Session};
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let scene = Scene::preset("compression")?;
/// let motion = scene.motion.ok_or("no motion")?;
/// let session = Session::new(&scene, "example", Keep::ANSWERS)?;
/// let finished = session.run(Session::motion(&motion).take(10), &mut Cancel::default());
/// assert_eq!(finished.run.answers.len(), 10);
/// # Ok(())
/// # }
/// ```
pub struct Session<'a> {
    twin: Twin,
    collector: Collector,
    measured: Option<&'a ForceSeries>,
}

/// Result of a session.
pub struct Finished {
    /// The run.
    pub run: Run,
    /// Index of the reading that each answer belongs to.
    pub answered: Vec<usize>,
    /// The twin at the end of the run.
    pub twin: Twin,
}

impl<'a> Session<'a> {
    /// Builds the twin of a scene. `command` is the name of the command (`replay`).
    ///
    /// # Errors
    /// [`BuildError`] if the scene can't be discretised.
    pub fn new(scene: &Scene, command: &str, keep: Keep) -> Result<Self, BuildError> {
        Self::built(command, keep, || Twin::new(scene))
    }

    /// The same; shares the cloud of another twin if possible ([`Twin::sibling`]).
    ///
    /// # Errors
    /// [`BuildError`] if the scene can't be discretised.
    pub(crate) fn sibling(scene: &Scene, other: Option<&Twin>, command: &str, keep: Keep) -> Result<Self, BuildError> {
        Self::built(command, keep, || other.and_then(|other| other.sibling(scene)).map_or_else(|| Twin::new(scene), Ok))
    }

    /// The same, on the cloud of the scene with other regions ([`Twin::on_cloud_of`]).
    ///
    /// # Errors
    /// [`BuildError`] if the scene can't be discretised.
    pub(crate) fn on_cloud_of(
        scene: &Scene,
        regions: &[Region],
        command: &str,
        keep: Keep,
    ) -> Result<Self, BuildError> {
        Self::built(command, keep, || Twin::on_cloud_of(scene, regions))
    }

    fn built(command: &str, keep: Keep, build: impl FnOnce() -> Result<Twin, BuildError>) -> Result<Self, BuildError> {
        let begun = Instant::now();
        let twin = build()?;
        Ok(Self::with(twin, begun.elapsed().as_secs_f64(), command, keep))
    }

    /// From a twin that has just been built, in `build_s` seconds, or reset.
    #[must_use]
    pub fn with(twin: Twin, build_s: f64, command: &str, keep: Keep) -> Self {
        let collector = Collector::new(&twin, command, build_s, keep);
        Self { twin, collector, measured: None }
    }

    /// Compares with a measured force.
    #[must_use]
    pub fn compared_with(self, measured: &'a ForceSeries) -> Self {
        Self { measured: Some(measured), ..self }
    }

    /// Compares with a recording. The recording's losses are added to the run's. `measured` is
    /// [`Recording::measured`].
    #[must_use]
    pub fn of_recording(mut self, recording: &Recording, measured: &'a ForceSeries) -> Self {
        recording.losses.iter().for_each(|loss| self.collector.lost(loss.to_string()));
        measured.loss().into_iter().for_each(|loss| self.collector.lost(loss));
        if !measured.is_empty() {
            self.collector.measured_source(&recording.source);
        }
        self.compared_with(measured)
    }

    /// The twin, before the first reading.
    #[must_use]
    pub const fn twin(&self) -> &Twin {
        &self.twin
    }

    /// The readings of a scene's own motion.
    pub fn motion(motion: &needle_core::scene::Motion) -> impl Iterator<Item = Reading> + use<> {
        motion.poses().map(|(time_s, depth)| Reading { time_s, at: At::Depth(depth) })
    }

    /// Sends readings into the twin, in order. A pose that the twin refuses is counted and left out. So is a pose
    /// without an answer because the model diverged; see [`Twin::step`] for the recovery.
    ///
    /// Only the steps are timed. A deadline counts as missed if a step took longer than the time to the next reading.
    pub fn run(self, readings: impl IntoIterator<Item = Reading>, watch: &mut dyn Watch) -> Finished {
        let Self { mut twin, mut collector, measured } = self;
        let cancel = watch.cancel().clone();
        collector.on_one_clock(measured.is_some_and(ForceSeries::one_clock));
        collector.over_holes(measured.map_or(&[], ForceSeries::holes));
        twin.stop_on(cancel.flag());
        let mut readings = readings.into_iter().peekable();
        let (mut done, mut answered) = (0, Vec::new());
        let (mut from_s, mut to_s) = (f64::INFINITY, f64::NEG_INFINITY);
        while let Some(reading) = readings.next() {
            if cancel.is_cancelled() {
                collector.lost(format!("interrupted after {done} poses"));
                break;
            }
            let pose = stamped(&twin, reading);
            (from_s, to_s) = (from_s.min(reading.time_s), to_s.max(reading.time_s));
            let start = Instant::now();
            let result = twin.follow(pose);
            let latency_s = start.elapsed().as_secs_f64();
            done += 1;
            match result {
                Ok(prediction) if prediction.force_n.iter().all(|f| f.is_finite()) => {
                    let force = measured.and_then(|series| series.at(reading.time_s));
                    let answer = collector.answered(&twin, &prediction, pose.pose.axis, force, latency_s);
                    if readings.peek().is_some_and(|next| latency_s > next.time_s - reading.time_s) {
                        collector.missed_deadline();
                    }
                    answered.push(done - 1);
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
        collector.read_forces(measured.map(|series| series.between(from_s, to_s)));
        let compared = collector.run().answers.iter().any(|answer| answer.measured_n.is_some());
        if measured.is_some_and(|series| !series.is_empty()) && !compared {
            collector.lost("nothing was compared: no force was measured at the time of an answered pose".to_owned());
        }
        Finished { run: collector.finish(&twin), answered, twin }
    }

    /// [`Session::run`] without observer; returns the run alone.
    pub fn unwatched(self, readings: impl IntoIterator<Item = Reading>) -> Run {
        self.run(readings, &mut Cancel::default()).run
    }
}

/// Depth of each reading, m.
#[must_use]
pub fn depths(twin: &Twin, readings: &[Reading]) -> Vec<f64> {
    let depth = |reading: &Reading| match reading.at {
        At::Depth(depth_m) => depth_m,
        At::Pose(pose) => twin.depth_of(&pose),
    };
    readings.iter().map(depth).collect()
}

/// The loss of a run whose forces are not finite.
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
    /// Answers only: no fields are computed.
    pub const ANSWERS: Self = Self { fields: false, duration_s: None, save_every_s: None };

    /// Fields as well, for readings of a known length.
    #[must_use]
    pub fn fields_of(readings: &[Reading]) -> Self {
        let duration_s = readings.first().zip(readings.last()).map(|(first, last)| last.time_s - first.time_s);
        Self { fields: true, duration_s, save_every_s: None }
    }
}
