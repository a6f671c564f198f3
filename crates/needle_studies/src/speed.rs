//! Measures the cost of a step on this machine: for the presets, the number of support nodes and the size of the
//! model. Also measures the largest real-time speed of a needle in three dimensions.
//!
//! A step is measured as a pose that takes one step, many times. The shortest time is the cost on an otherwise idle
//! machine; the median is the cost in this run.

use std::time::Instant;

use serde::Serialize;

use super::csv;
use mtled::solver::StepWork;
use needle_core::scene::{Override, Preset, Scene, SceneError};
use needle_core::twin::{BuildError, Halt, StampedPose, Twin};
use needle_estimate::compare::{Cancel, Watch};

/// Number of timed poses.
const POSES: u32 = 120;
/// Travel per timed pose, m.
const TRAVEL_M: f64 = 2e-6;

/// Why a model can't be timed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SpeedError {
    /// The scene is wrong.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// It can't be discretised.
    #[error(transparent)]
    Build(#[from] BuildError),
    /// The twin halted.
    #[error(transparent)]
    Halt(#[from] Halt),
}

/// One model to time.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// Group of the row in the table.
    pub group: &'static str,
    /// Preset.
    pub preset: &'static str,
    keys: Vec<(&'static str, String)>,
    /// Threads.
    pub threads: usize,
}

/// Timings of one model.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// The model.
    pub case: Case,
    /// Nodes.
    pub nodes: usize,
    /// Integration points.
    pub points: usize,
    /// Operations per point and step.
    pub work: StepWork,
    /// Time from the scene to the first step, s.
    pub build_s: f64,
    /// Shortest step, s.
    pub best_s: f64,
    /// Median step, s.
    pub median_s: f64,
}

/// The models to time; `threads` is the largest number of threads.
#[must_use]
pub fn cases(threads: usize, quick: bool) -> Vec<Case> {
    let full = ("discretisation.dimension", "full".to_owned());
    let case =
        |group, preset, keys: &[(&'static str, String)], threads| Case { group, preset, keys: keys.to_vec(), threads };
    let mut cases = Vec::new();
    let mut counts = vec![1];
    while counts.last().is_some_and(|&n| 2 * n <= threads) {
        counts.push(2 * counts[counts.len() - 1]);
    }
    for Preset { name: preset, .. } in Preset::of_the_paper() {
        cases.push(case("as shipped", preset, &[], 1));
    }
    for Preset { name: preset, .. } in Preset::of_the_paper() {
        for &threads in &counts {
            cases.push(case("three dimensions", preset, std::slice::from_ref(&full), threads));
        }
    }
    for (group, dimension) in [("oblique, whole", "full"), ("oblique, half", "mirrored")] {
        let oblique = ("instrument.tilt_rad", "0.26".to_owned());
        for &threads in &counts {
            let keys = [oblique.clone(), ("discretisation.dimension", dimension.to_owned())];
            cases.push(case(group, "needle_insertion", &keys, threads));
        }
    }
    for factor in ["1.4", "1.5", "1.6"] {
        let keys = [full.clone(), ("discretisation.support_factor", factor.to_owned())];
        cases.push(case("support", "needle_insertion", &keys, 1));
    }
    for preset in ["compression", "needle_insertion"] {
        for points in ["8", "1"] {
            let cells = ("discretisation.cells", "hexahedra".to_owned());
            let keys = [full.clone(), cells, ("discretisation.points_per_hexahedron", points.to_owned())];
            let group = if points == "8" { "hexahedra of 8" } else { "hexahedra of 1" };
            // for builds with the feature `research`
            if scene(preset, &keys).is_ok() {
                cases.push(case(group, preset, &keys, 1));
            }
        }
    }
    let spacings: &[&str] = if quick { &["0.004", "0.0015"] } else { &["0.004", "0.0015", "0.001", "0.0006"] };
    for spacing in spacings {
        let keys = [full.clone(), ("discretisation.spacing_m", (*spacing).to_owned())];
        cases.push(case("size", "compression", &keys, 1));
        if threads > 1 {
            cases.push(case("size", "compression", &keys, threads));
        }
    }
    cases
}

fn scene(preset: &str, keys: &[(&'static str, String)]) -> Result<Scene, SpeedError> {
    let keys: Vec<Override> = keys.iter().map(|(key, value)| Override::text(key, value, "study speed")).collect();
    Ok(Scene::preset(preset)?.with(&keys)?)
}

impl Case {
    /// Builds the model and times its steps, on as many threads as the present rayon pool has.
    ///
    /// # Errors
    /// [`SpeedError`] if the scene can't be built or the twin halts.
    pub fn run(&self) -> Result<Row, SpeedError> {
        let mut keys = self.keys.clone();
        keys.push(("stepping.max_steps_per_pose", "1".to_owned()));
        let scene = scene(self.preset, &keys)?;
        let start = Instant::now();
        let mut twin = Twin::new(&scene)?;
        let build_s = start.elapsed().as_secs_f64();
        let mut times = Vec::with_capacity(POSES as usize);
        for i in 1..=POSES {
            let pose = twin.pose_at_depth(TRAVEL_M * f64::from(i));
            let start = Instant::now();
            twin.step(StampedPose { time_s: 1e-3 * f64::from(i), pose })?;
            times.push(start.elapsed().as_secs_f64());
        }
        times.sort_by(f64::total_cmp);
        Ok(Row {
            case: self.clone(),
            nodes: twin.nodes(),
            points: twin.integration_points(),
            work: twin.step_work(),
            build_s,
            best_s: times[0],
            median_s: times[times.len() / 2],
        })
    }
}

impl Row {
    /// Best time per integration point and step, ns.
    #[must_use]
    pub fn ns_per_point(&self) -> f64 {
        1e9 * self.best_s / self.points as f64
    }

    /// One line of the table.
    #[must_use]
    pub fn line(&self) -> String {
        let Case { group, preset, threads, .. } = &self.case;
        format!(
            "{group:<17}{preset:<18}{threads:>3}{:>8}{:>9}{:>9.1}{:>9.2}{:>10.1}{:>10.1}{:>9.1}\n",
            self.nodes,
            self.points,
            self.work.support_nodes,
            self.build_s,
            1e6 * self.best_s,
            1e6 * self.median_s,
            self.ns_per_point(),
        )
    }
}

/// Heading of the table.
#[must_use]
pub fn heading() -> String {
    format!(
        "{:<17}{:<18}{:>3}{:>8}{:>9}{:>9}{:>9}{:>10}{:>10}{:>9}\n",
        "what", "preset", "thr", "nodes", "points", "support", "build s", "best us", "median us", "ns/point"
    )
}

/// Content of `speed.csv`.
#[must_use]
pub fn csv(rows: &[Row]) -> String {
    csv::write(rows.iter().map(Record::from))
}

/// A line of `speed.csv`.
#[derive(Serialize)]
struct Record {
    what: &'static str,
    preset: &'static str,
    threads: usize,
    nodes: usize,
    points: usize,
    support_nodes: f64,
    bytes_per_point: f64,
    flops_per_point: f64,
    build_s: f64,
    best_step_s: f64,
    median_step_s: f64,
}

impl From<&Row> for Record {
    fn from(row: &Row) -> Self {
        Self {
            what: row.case.group,
            preset: row.case.preset,
            threads: row.case.threads,
            nodes: row.nodes,
            points: row.points,
            support_nodes: row.work.support_nodes,
            bytes_per_point: row.work.bytes,
            flops_per_point: row.work.flops,
            build_s: row.build_s,
            best_step_s: row.best_s,
            median_step_s: row.median_s,
        }
    }
}

/// An insertion in three dimensions at one speed and one rate of poses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Speed, m/s.
    pub speed: f64,
    /// Poses per second, 1/s.
    pub pose_hz: f64,
    /// Simulated time over wall time, without the time to build the model.
    pub real_time_factor: f64,
    /// Mean steps per pose.
    pub steps_per_pose: f64,
    /// Largest difference from the quasi-static force on the same cloud, over its peak.
    pub error: f64,
}

/// Heading of the table of motions.
#[must_use]
pub fn motion_heading() -> String {
    format!(
        "\n{:<46}{:>6}{:>12}{:>12}{:>20}\n",
        "needle_insertion, three dimensions", "mm/s", "poses 1/s", "steps/pose", "real-time factor"
    )
}

impl Motion {
    /// One line of the table.
    #[must_use]
    pub fn line(&self) -> String {
        let Self { speed, pose_hz, real_time_factor, steps_per_pose, error } = self;
        let error = format!("{:.2} % of the peak from the quasi-static force", 100.0 * error);
        format!("{error:<46}{:>6.0}{pose_hz:>12.0}{steps_per_pose:>12.1}{real_time_factor:>20.2}\n", 1e3 * speed)
    }
}

/// Speeds in m/s and rates of poses in 1/s that [`motions`] tries.
pub(crate) const MOTIONS: [(f64, f64); 6] =
    [(1e-3, 1000.0), (5e-3, 1000.0), (20e-3, 1000.0), (1e-3, 100.0), (5e-3, 100.0), (20e-3, 100.0)];
/// Least steps per pose of the quasi-static run at 5 mm/s and 1 kHz.
const QUASI_STATIC_STEPS: &str = "8";

/// One insertion.
struct Insertion {
    /// Depth, m, and force, N.
    force: Vec<[f64; 2]>,
    real_time_factor: f64,
    steps_per_pose: f64,
}

/// Drives the needle of the preset to the end of its path; `None` if it was cancelled.
fn insertion(
    speed: f64,
    pose_hz: f64,
    keys: &[(&'static str, String)],
    cancel: &Cancel,
) -> Result<Option<Insertion>, SpeedError> {
    let scene = scene("needle_insertion", keys)?;
    let depth = scene.motion.map_or(0.0, |m| m.depth.get());
    let mut twin = Twin::new(&scene)?;
    let count = (depth / speed * pose_hz).round() as u32;
    let start = Instant::now();
    let mut force = Vec::with_capacity(count as usize);
    for i in 0..=count {
        if cancel.is_cancelled() {
            return Ok(None);
        }
        let at = depth * f64::from(i) / f64::from(count);
        let pose = StampedPose { time_s: f64::from(i) / pose_hz, pose: twin.pose_at_depth(at) };
        force.push([at, twin.step(pose)?.force_n[2]]);
    }
    let simulated = depth / speed;
    Ok(Some(Insertion {
        force,
        real_time_factor: simulated / start.elapsed().as_secs_f64(),
        steps_per_pose: twin.steps() as f64 / f64::from(count + 1),
    }))
}

/// Runs `MOTIONS` and passes each to `row`; ends early if `progress` is cancelled.
///
/// # Errors
/// [`SpeedError`] if the scene can't be built or the twin halts.
pub fn motions(progress: &dyn Watch, mut row: impl FnMut(&Motion)) -> Result<(), SpeedError> {
    let cancel = progress.cancel();
    let full = ("discretisation.dimension", "full".to_owned());
    let patient = [full.clone(), ("stepping.min_steps_per_pose", QUASI_STATIC_STEPS.to_owned())];
    let Some(Insertion { force: reference, .. }) = insertion(5e-3, 1000.0, &patient, cancel)? else { return Ok(()) };
    let peak = reference.iter().fold(0.0_f64, |peak, p| peak.max(p[1]));
    let at = |depth: f64| {
        let i = reference.partition_point(|p| p[0] < depth).clamp(1, reference.len() - 1);
        let ([a, f], [b, g]) = (reference[i - 1], reference[i]);
        f + (g - f) * (depth - a) / (b - a)
    };
    for (speed, pose_hz) in MOTIONS {
        let keys = std::slice::from_ref(&full);
        let Some(run) = insertion(speed, pose_hz, keys, cancel)? else { break };
        let Insertion { real_time_factor, steps_per_pose, .. } = run;
        let error = run.force.iter().map(|p| (p[1] - at(p[0])).abs()).fold(0.0, f64::max) / peak;
        row(&Motion { speed, pose_hz, real_time_factor, steps_per_pose, error });
    }
    Ok(())
}
