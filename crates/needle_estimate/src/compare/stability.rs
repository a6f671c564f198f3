//! Indicators of whether a run's forces are those of a quasi-static equilibrium, each with its bound.

use super::Run;
use needle_core::twin::Health;

const MORE_STEPS: &str = "more steps per pose: a smaller stepping.tolerance, a larger stepping.max_steps_per_pose";
/// Volume ratio below which a cell counts as inverted.
const FOLDED: f64 = 0.1;

/// A row of the stability table.
#[derive(Clone, Debug, PartialEq)]
pub struct StabilityRow {
    /// Name of the indicator.
    pub name: &'static str,
    /// Its value, in the unit below.
    pub value: f64,
    /// `m` or empty.
    pub unit: &'static str,
    /// Whether the bound holds.
    pub holds: bool,
    /// The bound in words.
    pub bound: String,
    /// What the indicator means.
    pub about: &'static str,
    /// What to do if the bound is violated.
    pub remedy: &'static str,
}

impl Run {
    /// The rows of the stability table.
    #[must_use]
    pub fn stability(&self) -> [StabilityRow; 7] {
        let (jacobian, energy) = (self.min_jacobian, self.max_kinetic_to_strain_energy);
        let (imbalance, constraint) = (self.force_imbalance, self.constraint_error_m);
        let folded = self.folded_energy;
        let [mean, most] = [Health::MEAN_IMBALANCE, Health::MOST_IMBALANCE].map(|times| times * self.accuracy);
        let steps = self.step_error_rms.unwrap_or(self.force_imbalance_rms);
        let error = self.relative_model_error();
        [
            StabilityRow {
                name: "Smallest volume ratio",
                value: jacobian,
                unit: "",
                holds: jacobian > FOLDED,
                bound: "above 0.1".to_owned(),
                about: "Volume of the most compressed cell over its volume at rest; 0 would be a cell turned inside out.",
                remedy: "the tissue folds: a coarser discretisation.spacing_m, a smaller depth, or an earlier puncture",
            },
            StabilityRow {
                name: "Energy in folded cells",
                value: folded,
                unit: "",
                holds: folded < Health::MOST_FOLDED,
                bound: "below 0.05".to_owned(),
                about: "Strain energy in cells whose corners have passed through each other, over all of it: the cloud does not resolve that tissue.",
                remedy: "the force is not to be trusted from there on: a smaller depth, a smaller discretisation.spacing_m, or a \
                         scene about one axis (discretisation.dimension = \"auto\")",
            },
            StabilityRow {
                name: "Kinetic over strain energy",
                value: energy,
                unit: "",
                holds: energy < Health::MOST_KINETIC,
                bound: "below 0.05".to_owned(),
                about: "Largest value once the force passed 10 % of its peak; small means that inertia does not colour the force.",
                remedy: "a smaller stepping.tolerance, or a slower motion",
            },
            StabilityRow {
                name: "Force imbalance",
                value: imbalance,
                unit: "",
                holds: imbalance < most,
                bound: format!("below {most:.3}"),
                about: "Largest sum of instrument force and base reaction, over the peak force. The force is off by less.",
                remedy: MORE_STEPS,
            },
            StabilityRow {
                name: "Error of the steps, r.m.s.",
                value: steps,
                unit: "",
                holds: steps < mean,
                bound: format!("below {mean:.3}"),
                about: "Root mean square over the poses of the imbalance, or of how far two approximations of the force at rest are apart where that is less. The bounds are 10 times and once the scene's accuracy.",
                remedy: MORE_STEPS,
            },
            StabilityRow {
                name: "Model error, r.m.s.",
                value: error,
                unit: "",
                holds: error < Health::MOST_ERROR * self.accuracy,
                bound: format!("below {:.3}", Health::MOST_ERROR * self.accuracy),
                about: "Estimated error of cloud and steps over the peak force, up to twelve times too wide; the bound is 10 times the accuracy.",
                remedy: "the cloud does not resolve the tissue: a smaller accuracy",
            },
            StabilityRow {
                name: "Constraint error",
                value: constraint,
                unit: " m",
                holds: constraint < 1e-6,
                bound: "below 10⁻⁶ m".to_owned(),
                about: "Largest distance between the field and its prescribed value under the instrument and at the base.",
                remedy: "report it with the scene: the essential boundary conditions are not met",
            },
        ]
    }

    /// Notes the share of the strain energy in inverted cells at a depth.
    pub fn note_folds(&mut self, depth_m: f64, folded_energy: f64) {
        self.folded_energy = self.folded_energy.max(folded_energy);
        if folded_energy >= Health::MOST_FOLDED {
            self.folded_from_m.get_or_insert(depth_m);
        }
    }

    /// The violated bounds, a line each; empty for a run without answers.
    #[must_use]
    pub fn unstable(&self) -> Vec<String> {
        if self.answers.is_empty() {
            return Vec::new();
        }
        let line = |row: &StabilityRow| {
            let value = if row.value.is_finite() {
                format!("{:.3e}{}", row.value, row.unit)
            } else {
                "not a finite number".to_owned()
            };
            format!("{} {value} does not hold (should be {}): {}", row.name, row.bound, row.remedy)
        };
        let mut lines: Vec<String> = self.stability().iter().filter(|row| !row.holds).map(line).collect();
        if let (Some(depth_m), false) = (self.folded_from_m, lines.is_empty()) {
            lines.push(format!("cells that turned over have carried more than that from {:.2} mm on", 1e3 * depth_m));
        }
        lines
    }

    /// Whether the largest force of the run is a peak, and not an artefact of inverted cells or of a diverged
    /// solution.
    #[must_use]
    pub fn has_peak(&self) -> bool {
        self.diverged.is_none() && self.min_jacobian > FOLDED
    }
}
