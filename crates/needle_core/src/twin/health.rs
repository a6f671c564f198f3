//! How far a prediction is from a quasi-static equilibrium.

/// Health of a prediction.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Health {
    /// Smallest volume ratio over all integration points.
    pub min_jacobian: f64,
    /// Kinetic over strain energy.
    pub kinetic_to_strain_energy: f64,
    /// |instrument force + base reaction| over the peak force so far.
    pub force_imbalance: f64,
    /// How far the two approximations of the force at rest are apart of which a moving instrument's force is the mean, N (`solver::inertia`);
    /// infinite at rest, after further steps at a pose, and for a needle with friction, whose slip no inertia shows.
    pub approximations_apart_n: f64,
    /// Largest distance between the field and its prescribed value at a constrained point, m; measured every 64 steps.
    pub constraint_error_m: f64,
    /// Share of the strain energy that stands in cells that have turned over (`crates/needle_core/src/twin/folds.rs`); measured every 64 steps.
    pub folded_energy: f64,
    /// Estimated error of the discretisation, of the force (`crates/needle_core/src/twin/recovered.rs`); measured from time to time. Of
    /// a corrected cloud what the correction left.
    pub discretisation_error: f64,
}

impl Health {
    /// Kinetic over strain energy from which on inertia colours the force.
    pub const MOST_KINETIC: f64 = 0.05;
    /// Imbalance at a pose, over the scene's accuracy, from which on the force is further off than it may be. The force itself is off by a tenth
    /// to the whole of it (`docs/lab/model_error.md`).
    pub const MOST_IMBALANCE: f64 = 10.0;
    /// The same as a root mean square over the poses, of the imbalance or of [`Health::approximations_apart_n`], whichever is less at a pose.
    pub const MEAN_IMBALANCE: f64 = 1.0;
    /// The same of the estimated error of the model, as a root mean square: the estimate is up to twelve times too wide
    /// (`docs/lab/model_error.md`).
    pub const MOST_ERROR: f64 = 10.0;
    /// Share of the strain energy in folded cells from which on the cloud does not resolve the tissue: the force is off by some half of
    /// it, and by more where a soft layer is crushed (docs/lab/stability.md).
    pub const MOST_FOLDED: f64 = 0.05;
    /// Force over the peak force below which the ratio of energies says nothing.
    pub const LOADED: f64 = 0.1;
}
