//! The answer to a pose, or why there is none.

use super::health::Health;
use crate::instrument::{Event, Phase};

/// The answer to one pose. Plain numbers: nothing is allocated per pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prediction {
    /// Stamp of the pose that this answers.
    pub time_s: f64,
    /// Depth of the tip below the undeformed top along the instrument's axis, m.
    pub depth_m: f64,
    /// Force of the tissue on the instrument in frame `sample`, N; while it moves, less what inertia and damping of the
    /// explicit steps add along its way (see `solver::inertia`).
    pub force_n: [f64; 3],
    /// Force of the tissue on the base, N: cancels `force_n` at rest, and lags behind while the instrument moves.
    pub base_force_n: [f64; 3],
    /// Force on the needle of a template that holds it as well (`instrument.guide_z_m`), N; part of `force_n`, which is what the load cell bears.
    pub template_force_n: [f64; 3],
    /// Torque of the tissue on the instrument about the load cell's origin (`instrument.load_cell_height_m`), axes of frame `sample`, N m.
    pub torque_nm: [f64; 3],
    /// Phase of the interaction.
    pub phase: Phase,
    /// What happened since the last pose, if anything; of several ([`super::Twin::happened`]) the first puncture, or else the first.
    pub event: Option<Event>,
    /// Explicit steps that this pose took.
    pub steps: u32,
    /// Health of the prediction.
    pub health: Health,
}

impl Prediction {
    /// What the forces on instrument and base differ by, N: nothing at rest.
    #[must_use]
    pub fn unbalanced_n(&self) -> [f64; 3] {
        std::array::from_fn(|k| self.force_n[k] - self.template_force_n[k] + self.base_force_n[k])
    }

    /// Error of the force that the model makes, N: the discretisation's, and what the forces on instrument and base differ by, which is how
    /// far the steps are from an equilibrium. At 95 of 100 poses it is at least the difference to a fine cloud at rest
    /// (`docs/lab/model_error.md`).
    #[must_use]
    pub fn model_error_n(&self) -> f64 {
        let length = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
        let unbalanced = length(self.unbalanced_n());
        (self.health.discretisation_error * length(self.force_n)).hypot(unbalanced)
    }
}

/// Why a pose has no answer.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Halt {
    /// The pose itself can't be used; the state is untouched and the next pose may be sent.
    #[error("pose refused: {reason}")]
    Pose {
        /// What is wrong with it.
        reason: String,
    },
    /// The flag of [`super::Twin::stop_on`] was set. The twin is back in its last saved state.
    #[error("interrupted")]
    Interrupted,
    /// The solution diverged. The twin is back in its last saved state and tries the next poses from there: a few of any depth,
    /// then those that are no deeper, at the latest when the instrument is out of the tissue. Those that it doesn't try get this.
    #[error(
        "the solution diverged at step {step}, depth {depth_m:.6} m, after {tries} tries with ever smaller steps: {trouble}"
    )]
    Diverged {
        /// What was seen.
        trouble: Trouble,
        /// Attempts to continue.
        tries: u32,
        /// Explicit step since the last reset.
        step: u64,
        /// Depth, m.
        depth_m: f64,
    },
}

/// Why a state is not acceptable.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Trouble {
    /// Forces or energies are not finite.
    #[error("forces or energies are not finite; try a smaller stepping.step_factor")]
    NotFinite,
    /// A cell is crushed to zero volume or inverted.
    #[error(
        "integration point {point} at ({:.6}, {:.6}, {:.6}) m of the undeformed body is inverted (volume ratio \
         {volume_ratio:.3e}); try a coarser discretisation.spacing_m, a larger edge_refinement, or material.volumetric = \
         \"logarithmic\"", place[0], place[1], place[2]
    )]
    Inverted {
        /// Index of the integration point.
        point: usize,
        /// Its cell's centre in the undeformed body, m.
        place: [f64; 3],
        /// det F.
        volume_ratio: f64,
    },
    /// More kinetic energy than a quasi-static motion has: the step is too large.
    #[error(
        "kinetic energy {kinetic_j:.3e} J runs away from strain energy {strain_j:.3e} J; try a smaller \
         stepping.step_factor or a slower motion"
    )]
    RunsAway {
        /// J
        kinetic_j: f64,
        /// J
        strain_j: f64,
    },
}
