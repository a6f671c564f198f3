//! One pose in, one prediction out: [`Twin::step`].

mod along;
mod answer;
mod assembly;
mod axisymmetric;
mod body;
mod build;
mod contain;
mod correction;
mod error;
mod folds;
mod happened;
mod health;
mod hexahedra;
mod look_ahead;
mod mesh;
mod mesh_frame;
mod moved;
mod observe;
mod outline;
mod own_instrument;
mod pace;
mod part;
mod pierce;
mod recover;
mod recovered;
mod regions;
mod revolve;
mod saved;
mod sibling;
mod speed;
mod step;
mod struck;
mod team;
#[cfg(test)]
mod tests;
mod tissue;
mod way;
mod work;

use std::sync::Arc;

use crate::instrument::Contact;
pub use crate::instrument::{Event, Phase};
use crate::scene::{Dimension, Instrument, Resolved, Scene};
use mtled::cloud::Axis;
use mtled::mirror::Mirror;
use mtled::solver::{Solver, StepWork};

pub use along::{Along, FOLLOWED, REST};
pub use answer::{Halt, Prediction, Trouble};
pub use body::{Body, coarsest_path};
pub use correction::Similarity;
pub use error::BuildError;
pub use happened::Happening;
pub use health::Health;
pub use look_ahead::Motion;
pub use mesh_frame::{extents, shown};
pub use own_instrument::Held;
pub use part::{Length, Part};
pub use team::{Places, Team};
pub use work::Work;

use folds::Folds;
use happened::Happened;
use pace::Pace;
use recovered::Recovered;
use saved::{Lost, Saved};
use speed::Speed;
use tissue::Tissue;
use work::Counters;

/// Position and direction of the instrument in frame `sample`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Tip (centre of the flat face for plate and indenter), m.
    pub tip: [f64; 3],
    /// Unit vector along the instrument, pointing into the sample; straight down is (0, 0, -1).
    pub axis: [f64; 3],
    /// How far the instrument is turned about that axis from where the scene has it, rad, counter-clockwise as seen from above. Only a bevelled
    /// tip is not the same for all of them.
    pub roll_rad: f64,
}

impl Pose {
    /// Two unit vectors across an axis: x as far as it is across, and what is a quarter of a turn further, counter-clockwise as seen from above.
    fn across(axis: [f64; 3]) -> [[f64; 3]; 2] {
        let most = |v: [f64; 3]| {
            let along = v[0] * axis[0] + v[1] * axis[1] + v[2] * axis[2];
            let across: [f64; 3] = std::array::from_fn(|k| v[k] - along * axis[k]);
            let length = across.iter().map(|x| x * x).sum::<f64>().sqrt();
            (length, across.map(|x| x / length))
        };
        let (length, x) = most([1.0, 0.0, 0.0]);
        let first = if length > 1e-6 { x } else { most([0.0, 1.0, 0.0]).1 };
        let [a, b] = [first, axis];
        [first, [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]]
    }

    /// A pose whose instrument has the x axis of its own frame in a direction; z is its axis. Without roll x is as far along the frame's x as it
    /// can be.
    #[must_use]
    pub fn with_x_axis(tip: [f64; 3], axis: [f64; 3], x: [f64; 3]) -> Self {
        let [c, s] = Self::across(axis).map(|e| e[0] * x[0] + e[1] * x[1] + e[2] * x[2]);
        Self { tip, axis, roll_rad: s.atan2(c) }
    }

    /// The x axis of the instrument's own frame, whose z is its axis.
    #[must_use]
    pub fn x_axis(&self) -> [f64; 3] {
        let ([first, second], (s, c)) = (Self::across(self.axis), self.roll_rad.sin_cos());
        std::array::from_fn(|k| c * first[k] + s * second[k])
    }
}

/// A pose and when it was taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StampedPose {
    /// Time of the measurement, s since any fixed origin.
    pub time_s: f64,
    /// The pose.
    pub pose: Pose,
}

/// The digital twin: what never changes of one scene, a state of it, and scratch memory.
#[derive(Debug)]
pub struct Twin {
    fixed: Arc<Fixed>,
    solver: Solver,
    contact: Option<Contact>,
    progress: Progress,
    /// Where the instrument was at the solver's saved state.
    saved: Saved,
    /// What was computed beside the force.
    counters: Counters,
    /// Events of the last pose.
    happened: Happened,
    folds: Folds,
    recovered: Recovered,
}

/// What never changes of a twin; shared with its branches.
#[derive(Debug)]
struct Fixed {
    scene: Scene,
    dimension: Resolved,
    /// Plane of symmetry of a model of half the body.
    mirror: Option<Mirror>,
    /// Regions on the instrument's path.
    along: Along,
    tissue: Arc<Tissue>,
    /// z of the undeformed surface where the instrument meets it, m.
    top: f64,
    /// Height of the body under that, m.
    height: f64,
    /// Deepest pose that the cloud can take, m.
    reach: f64,
    warnings: Vec<String>,
    /// How many of them are of the cloud; the rest are of the scene.
    of_cloud: usize,
    /// Nodes whose support was enlarged.
    repaired_supports: usize,
}

/// What changes from pose to pose beside tissue and instrument.
#[derive(Clone, Debug)]
struct Progress {
    pace: Pace,
    steps_since_save: u32,
    /// See [`Health`].
    constraint_error_m: f64,
    /// See [`Health`].
    folded_energy: f64,
    /// See [`Health`].
    discretisation_error: f64,
    steps: u64,
    /// Times that the twin went back to the last good state.
    recoveries: u64,
    /// Tip of the last pose relative to the entry point, m.
    tip: [f64; 3],
    /// Where the instrument's axis met the undeformed top at the last pose, relative to the entry point, m.
    shaft: [f64; 2],
    /// How far the instrument was turned about its axis then, rad.
    roll: f64,
    phase: Phase,
    /// Time of the last pose that was answered, s.
    seen_s: Option<f64>,
    /// Of the tip along its axis.
    speed: Speed,
    /// The loss of the solution that the twin has not come back from.
    lost: Option<Lost>,
}

impl Progress {
    /// Before the first pose.
    fn new(pace: Pace) -> Self {
        Self {
            pace,
            steps_since_save: 0,
            constraint_error_m: 0.0,
            folded_energy: 0.0,
            discretisation_error: 0.0,
            steps: 0,
            recoveries: 0,
            tip: [0.0; 3],
            shaft: [0.0; 2],
            roll: 0.0,
            phase: Phase::Approach,
            seen_s: None,
            speed: Speed::default(),
            lost: None,
        }
    }
}

impl Twin {
    /// The scene that this twin was built from.
    #[must_use]
    pub fn scene(&self) -> &Scene {
        &self.fixed.scene
    }

    /// Times that the twin went back to the last good state and tried again with smaller steps, since the last reset.
    #[must_use]
    pub fn recoveries(&self) -> u64 {
        self.progress.recoveries
    }

    /// Number of nodes whose support was enlarged, since it did not determine the fit, or only just.
    #[must_use]
    pub fn repaired_supports(&self) -> usize {
        self.fixed.repaired_supports
    }

    /// What is worth knowing about the scene and its mesh and is no error.
    #[must_use]
    pub fn warnings(&self) -> &[String] {
        &self.fixed.warnings
    }

    /// The dimension that the model has: [`Dimension::Full`], [`Dimension::Mirrored`] or [`Dimension::Axisymmetric`].
    #[must_use]
    pub fn dimension(&self) -> Dimension {
        self.fixed.dimension.dimension
    }

    /// Why it has that dimension, in one clause.
    #[must_use]
    pub fn dimension_because(&self) -> &str {
        &self.fixed.dimension.because
    }

    /// Number of the model's nodes: those of a half plane if it is axisymmetric, each of which is shown as a ring of
    /// [`Twin::reference_points`], or those on one side of a plane of symmetry and on it.
    #[must_use]
    pub fn nodes(&self) -> usize {
        self.fixed.tissue.model.nodes
    }

    /// Height of the body under the instrument, m.
    #[must_use]
    pub fn height_m(&self) -> f64 {
        self.fixed.height
    }

    /// Depth from which on poses are refused, m.
    #[must_use]
    pub fn reach_m(&self) -> f64 {
        self.fixed.reach
    }

    /// Number of integration points.
    #[must_use]
    pub fn integration_points(&self) -> usize {
        self.fixed.tissue.model.of_point.len()
    }

    /// Explicit steps taken since the last reset.
    #[must_use]
    pub fn steps(&self) -> u64 {
        self.progress.steps
    }

    /// What one evaluation of the internal force has to move and to compute.
    #[must_use]
    pub fn step_work(&self) -> StepWork {
        self.solver.work()
    }

    /// Threads that a step uses. Their number never changes a result.
    #[must_use]
    pub fn threads(&self) -> usize {
        self.solver.threads()
    }

    /// The pose at a depth along the scene's own instrument axis (what a displacement sensor measures).
    #[must_use]
    pub fn pose_at_depth(&self, depth_m: f64) -> Pose {
        let path = self.path();
        let (cosine, [sx, sy]) = (1.0 / path.secant(), path.slope);
        let [x, y] = path.at(depth_m * cosine);
        Pose {
            tip: [x, y, self.fixed.top - depth_m * cosine],
            axis: [sx * cosine, sy * cosine, -cosine],
            roll_rad: 0.0,
        }
    }

    /// Depth of a pose's tip below the undeformed top face along its own axis, m.
    #[must_use]
    pub fn depth_of(&self, pose: &Pose) -> f64 {
        (self.fixed.top - pose.tip[2]) / -pose.axis[2]
    }

    /// The line on which the scene's instrument moves.
    fn path(&self) -> Axis {
        let of = |i: &Instrument| Axis { entry: i.entry.map(|m| m.get()), slope: i.slope() };
        self.fixed.scene.instrument.as_ref().map_or(Axis::vertical([0.0; 2]), of)
    }

    /// Reference positions of the points that the tissue is shown by, m: the model's nodes in space, or rings of them.
    #[must_use]
    pub fn reference_points(&self) -> &[[f64; 3]] {
        &self.fixed.tissue.points
    }

    /// Triangles of the sample's surface, outward normals, indices into [`Twin::reference_points`].
    #[must_use]
    pub fn surface(&self) -> &[[u32; 3]] {
        &self.fixed.tissue.surface
    }

    /// Background tetrahedra, indices into [`Twin::reference_points`].
    #[must_use]
    pub fn cells(&self) -> &[[u32; 4]] {
        &self.fixed.tissue.cells
    }

    /// Region of each background tetrahedron: 0 for what is of `[material]`, or one more than the place among the scene's
    /// regions. Empty where the scene has none.
    #[must_use]
    pub fn cell_regions(&self) -> &[u8] {
        &self.fixed.tissue.region
    }

    /// Regions on the instrument's path.
    #[must_use]
    pub fn along(&self) -> &Along {
        &self.fixed.along
    }

    /// Depths of the tip at which it comes into the first regions of its path as the deformed tissue has them now, m; NaN where there is
    /// none. `None` but for a needle with friction: others come into a region where the scene has it.
    #[must_use]
    pub fn boundaries_m(&self) -> Option<[f64; FOLLOWED]> {
        let Some(Contact::Frictional(needle)) = &self.contact else { return None };
        let mut depths = [f64::NAN; FOLLOWED];
        for (depth, (_, from)) in depths.iter_mut().zip(self.fixed.along.stretches()) {
            *depth = needle.deformed(from, &self.solver);
        }
        Some(depths)
    }

    /// What happened to the tissue in the last pose that was answered, in its order.
    #[must_use]
    pub fn happened(&self) -> &[Happening] {
        self.happened.list()
    }
}
