//! Runs a scene for the study: poses in, forces out. The processor time of one thread is measured.

use super::super::clock::ThreadClock;
use super::super::progress::Progress;
use super::{Case, Steps, StudyError};
use needle_core::scene::{Motion, Scene, Seconds};
use needle_core::twin::{BuildError, Halt, StampedPose, Twin};

/// A run shorter than this is repeated, and the smallest cost is used, s.
const LONG_ENOUGH_S: f64 = 0.5;
/// Largest number of repetitions.
const REPEATS: u32 = 5;
/// Poses between two depths for runs to equilibrium: enough for the motion to be quasi-static.
const POSES_PER_DEPTH: u32 = 25;
/// Largest number of poses during which the instrument rests at one depth.
const LONGEST_REST: u32 = 400;
/// Time between two poses in runs to equilibrium, s.
const REST_PERIOD_S: f64 = 0.01;

/// Result of a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Driven {
    pub nodes: usize,
    pub integration_points: usize,
    /// Number of answered poses.
    pub poses: u64,
    /// Number of explicit steps.
    pub steps: u64,
    /// Simulated time, s.
    pub simulated_s: f64,
    /// Processor time of stepping, the smallest of the repetitions, s.
    pub cost_s: f64,
    pub min_jacobian: f64,
    pub recoveries: u64,
    /// (depth in m, force against the instrument's axis in N), for the compared depths or poses between them.
    pub path: Vec<(f64, f64)>,
    /// The same forces as vectors, frame `sample`, N.
    pub vectors: Vec<[f64; 3]>,
    /// Positions of the targets at the end, m.
    pub targets: Vec<[f64; 3]>,
    /// The same at each compared depth, or at the next pose after it.
    pub at_depths: Vec<Vec<[f64; 3]>>,
    /// Reason, if it ended before its depth.
    pub ended: Option<String>,
    /// Whether it was cancelled.
    pub stopped: bool,
}

/// Who observes a run, and what ends it before its depth.
#[derive(Clone, Copy)]
pub(crate) struct Watched<'a> {
    pub progress: &'a Progress,
    /// Asked at each compared depth of a moving run: the reason for which the rest of it is of no use.
    pub useless: &'a dyn Fn(&Driven) -> Option<String>,
}

impl<'a> Watched<'a> {
    /// A run to its end.
    pub(crate) fn whole(progress: &'a Progress) -> Self {
        Self { progress, useless: &|_| None }
    }
}

/// Builds a scene's twin on the present rayon pool and drives it to the last of the given depths (m) as the case
/// specifies.
///
/// # Errors
/// [`StudyError::NoMotion`]. A twin that can't be built or diverges is a result, not an error.
pub(crate) fn drive(scene: &Scene, case: &Case, depths: &[f64], watch: Watched) -> Result<Driven, StudyError> {
    let motion = scene.motion.ok_or_else(|| StudyError::NoMotion(scene.name.clone()))?;
    let mut twin = match Twin::new(scene) {
        Ok(twin) => twin,
        Err(e @ (BuildError::Cloud(_) | BuildError::Approximation(_))) => {
            return Ok(Driven { ended: Some(format!("can't be built: {e}")), ..Driven::default() });
        }
        Err(e) => return Err(e.into()),
    };
    twin.stop_on(watch.progress.cancel().flag());
    let mut best: Option<Driven> = None;
    let deepest_m = depths.last().copied().unwrap_or(0.0);
    let mut spent = 0.0;
    for _ in 0..REPEATS {
        twin.reset();
        let driven = Driven { min_jacobian: 1.0, ..Driven::default() };
        let mut run = Run { twin: &mut twin, driven, force_n: [0.0; 3], deepest_m, watch };
        let clock = ThreadClock::start();
        let end = match case.steps {
            Steps::Rest => run.rest_at_each(depths),
            Steps::Auto | Steps::Fixed(_) => run.move_through(&motion, depths, &clock),
        };
        let cost_s = clock.seconds();
        let driven = Driven { cost_s, ..run.finish(end) };
        spent += cost_s;
        if driven.stopped {
            return Ok(driven);
        }
        if best.as_ref().is_none_or(|b| cost_s < b.cost_s) {
            best = Some(driven);
        }
        if spent >= LONG_ENOUGH_S {
            break;
        }
    }
    Ok(best.unwrap_or_default())
}

/// Why a run ends early.
enum End {
    Stopped,
    Lost(String),
}

struct Run<'a> {
    twin: &'a mut Twin,
    driven: Driven,
    /// Force of the last pose, N.
    force_n: [f64; 3],
    /// The last depth, m.
    deepest_m: f64,
    watch: Watched<'a>,
}

impl Run<'_> {
    /// The insertion of the scene's own motion, to the last depth.
    fn move_through(&mut self, motion: &Motion, depths: &[f64], clock: &ThreadClock) -> Result<(), End> {
        let motion = Motion { hold: Seconds(0.0), retract: false, insertions: 1, ..*motion };
        for (time_s, depth) in motion.poses() {
            self.pose(time_s, depth)?;
            self.note(depth);
            let before = self.driven.at_depths.len();
            while depths.get(self.driven.at_depths.len()).is_some_and(|next| depth >= next * (1.0 - 1e-9)) {
                self.note_targets();
            }
            if self.driven.at_depths.len() > before {
                (self.driven.cost_s, self.driven.steps) = (clock.seconds(), self.twin.steps());
                if let Some(why) = (self.watch.useless)(&self.driven) {
                    return Err(End::Lost(format!("at {:.2} mm: {why}", 1e3 * depth)));
                }
            }
            if depth >= self.deepest_m * (1.0 - 1e-9) {
                break;
            }
        }
        Ok(())
    }

    /// Moves from depth to depth and waits at each until the tissue is at rest.
    fn rest_at_each(&mut self, depths: &[f64]) -> Result<(), End> {
        let mut from = 0.0;
        for &depth in depths {
            for i in 1..POSES_PER_DEPTH {
                self.next_pose(from + (depth - from) * f64::from(i) / f64::from(POSES_PER_DEPTH))?;
            }
            let mut steps = self.next_pose(depth)?;
            for _ in 0..LONGEST_REST {
                if steps == 0 {
                    break;
                }
                steps = self.next_pose(depth)?;
            }
            self.note(depth);
            self.note_targets();
            from = depth;
        }
        Ok(())
    }

    fn next_pose(&mut self, depth_m: f64) -> Result<u32, End> {
        self.pose(REST_PERIOD_S * (self.driven.poses + 1) as f64, depth_m)
    }

    /// Stores the last force, as component against the instrument's axis and as vector.
    fn note(&mut self, depth_m: f64) {
        let axis = self.twin.pose_at_depth(depth_m).axis;
        self.driven.path.push((depth_m, -(0..3).map(|k| self.force_n[k] * axis[k]).sum::<f64>()));
        self.driven.vectors.push(self.force_n);
    }

    fn note_targets(&mut self) {
        let mut targets = Vec::new();
        self.twin.target_positions(&mut targets);
        self.driven.at_depths.push(targets);
    }

    /// Answers one pose; returns the number of its steps.
    fn pose(&mut self, time_s: f64, depth_m: f64) -> Result<u32, End> {
        if self.watch.progress.cancel().is_cancelled() {
            return Err(End::Stopped);
        }
        let pose = self.twin.pose_at_depth(depth_m);
        let lost = |halt: Halt| match halt {
            Halt::Interrupted => End::Stopped,
            halt => End::Lost(format!("at {:.2} mm: {halt}", 1e3 * depth_m)),
        };
        let answer = self.twin.step(StampedPose { time_s, pose }).map_err(lost)?;
        self.driven.poses += 1;
        self.driven.simulated_s = time_s;
        self.driven.min_jacobian = self.driven.min_jacobian.min(answer.health.min_jacobian);
        self.force_n = answer.force_n;
        self.watch.progress.share(depth_m / self.deepest_m);
        Ok(answer.steps)
    }

    fn finish(self, end: Result<(), End>) -> Driven {
        let Self { twin, mut driven, .. } = self;
        match end {
            Ok(()) => twin.target_positions(&mut driven.targets),
            Err(End::Stopped) => driven.stopped = true,
            Err(End::Lost(why)) => driven.ended = Some(why),
        }
        Driven {
            nodes: twin.nodes(),
            integration_points: twin.integration_points(),
            steps: twin.steps(),
            recoveries: twin.recoveries(),
            ..driven
        }
    }
}
