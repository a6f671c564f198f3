//! One pose in, one prediction out: [`Twin::step`].

use crate::scene::Scene;

/// Position and direction of the instrument in frame `sample`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Tip (centre of the flat face for plate and indenter), m.
    pub tip: [f64; 3],
    /// Unit vector along the instrument, pointing into the sample; straight down is (0, 0, -1).
    pub axis: [f64; 3],
}

/// A pose and when it was taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StampedPose {
    /// Time of the measurement, s since any fixed origin.
    pub time_s: f64,
    /// The pose.
    pub pose: Pose,
}

/// Phase of the interaction between instrument and tissue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// The instrument is above the sample.
    Approach,
    /// In contact, surface not punctured (plate and indenter stay here).
    Indentation,
    /// The needle is inside and advances or rests.
    Penetration,
    /// The needle is being withdrawn.
    Retraction,
}

impl Phase {
    /// The word used in files and messages.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Approach => "approach",
            Self::Indentation => "indentation",
            Self::Penetration => "penetration",
            Self::Retraction => "retraction",
        }
    }
}

/// Something that happened between two poses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    /// The surface was punctured at this depth, m.
    Puncture {
        /// Tip depth at puncture, m.
        depth_m: f64,
    },
}

/// Health of a prediction.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Health {
    /// Smallest volume ratio over all integration points.
    pub min_jacobian: f64,
    /// Kinetic over strain energy.
    pub kinetic_to_strain_energy: f64,
    /// |instrument force + base reaction| over the peak force so far.
    pub force_imbalance: f64,
    /// Largest distance between the field and its prescribed value at a constrained point, m.
    pub constraint_error_m: f64,
}

/// What the twin says of one pose. Plain numbers: nothing is allocated per pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prediction {
    /// Stamp of the pose that this answers.
    pub time_s: f64,
    /// Depth of the tip below the undeformed top along the instrument's axis, m.
    pub depth_m: f64,
    /// Force of the tissue on the instrument in frame `sample`, N.
    pub force_n: [f64; 3],
    /// Reaction of the base on the tissue, N.
    pub base_force_n: [f64; 3],
    /// Phase of the interaction.
    pub phase: Phase,
    /// What happened since the last pose, if anything.
    pub event: Option<Event>,
    /// Explicit steps that this pose took.
    pub steps: u32,
    /// Health of the prediction.
    pub health: Health,
}

/// Why the twin can't go on. The state is unusable until [`Twin::reset`].
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Halt {
    /// The pose itself can't be used; the state is untouched and the next pose may be sent.
    #[error("pose refused: {reason}")]
    Pose {
        /// What is wrong with it.
        reason: String,
    },
    /// The solution diverged.
    #[error("the solution diverged at step {step}, depth {depth_m:.6} m: {reason}")]
    Diverged {
        /// What was seen.
        reason: String,
        /// Explicit step since the last reset.
        step: u64,
        /// Depth, m.
        depth_m: f64,
    },
}

/// Why a scene can't be built.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BuildError {
    /// The cloud of nodes could not be made.
    #[error("cloud: {0}")]
    Cloud(String),
    /// The shape functions could not be made.
    #[error("shape functions: {0}")]
    Approximation(String),
}

/// The digital twin: model, state and scratch memory of one scene.
#[derive(Debug)]
pub struct Twin {
    scene: Scene,
}

impl Twin {
    /// Builds cloud, shape functions and factorisations for a scene.
    ///
    /// # Errors
    /// [`BuildError`] if the scene can't be discretised.
    pub fn new(scene: &Scene) -> Result<Self, BuildError> {
        Ok(Self { scene: scene.clone() })
    }

    /// The scene that this twin was built from.
    #[must_use]
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Number of nodes.
    #[must_use]
    pub fn nodes(&self) -> usize {
        0
    }

    /// Number of integration points.
    #[must_use]
    pub fn integration_points(&self) -> usize {
        0
    }

    /// Explicit steps taken since the last reset.
    #[must_use]
    pub fn steps(&self) -> u64 {
        0
    }

    /// The pose at a depth along the scene's own instrument axis (what a displacement sensor measures).
    #[must_use]
    pub fn pose_at_depth(&self, depth_m: f64) -> Pose {
        Pose { tip: [0.0, 0.0, self.scene.sample.shape.height().get() - depth_m], axis: [0.0, 0.0, -1.0] }
    }

    /// Depth of a pose's tip below the undeformed top face along its own axis, m.
    #[must_use]
    pub fn depth_of(&self, pose: &Pose) -> f64 {
        (self.scene.sample.shape.height().get() - pose.tip[2]) / -pose.axis[2]
    }

    /// Advances the tissue to a pose and predicts the force.
    ///
    /// Allocates nothing, takes no lock, reads no clock.
    ///
    /// # Errors
    /// [`Halt::Pose`] if the pose can't be used (state untouched), [`Halt::Diverged`] if the solution is lost.
    pub fn step(&mut self, pose: StampedPose) -> Result<Prediction, Halt> {
        Ok(Prediction {
            time_s: pose.time_s,
            depth_m: self.depth_of(&pose.pose),
            force_n: [0.0; 3],
            base_force_n: [0.0; 3],
            phase: Phase::Approach,
            event: None,
            steps: 0,
            health: Health::default(),
        })
    }

    /// Back to the undeformed state.
    pub fn reset(&mut self) {}

    /// Reference positions of the nodes, m.
    #[must_use]
    pub fn reference_points(&self) -> &[[f64; 3]] {
        &[]
    }

    /// Triangles of the sample's surface, outward normals, indices into [`Twin::reference_points`].
    #[must_use]
    pub fn surface(&self) -> &[[u32; 3]] {
        &[]
    }

    /// Background tetrahedra, indices into [`Twin::reference_points`].
    #[must_use]
    pub fn cells(&self) -> &[[u32; 4]] {
        &[]
    }

    /// Displacement of the field at every reference point, m. Overwrites `out`.
    pub fn displacements(&self, out: &mut Vec<[f64; 3]>) {
        out.clear();
    }

    /// Volume ratio J and von Mises (Cauchy) stress in Pa, averaged to the reference points. Overwrites both.
    pub fn jacobian_and_stress(&self, jacobian: &mut Vec<f64>, von_mises_pa: &mut Vec<f64>) {
        jacobian.clear();
        von_mises_pa.clear();
    }

    /// Present positions of the scene's targets, m, in the scene's order. Overwrites `out`.
    pub fn target_positions(&self, out: &mut Vec<[f64; 3]>) {
        out.clear();
    }
}
