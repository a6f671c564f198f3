//! What the solver needs besides cloud and shape table.

use crate::material::Law;

/// Which volume ratio the pressure sees.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VolumeRatio {
    /// Projected onto a coarser cloud, as the pressure of a Taylor-Hood element: the cure for volumetric locking.
    Projected,
    /// Projected, and with it the dependence on volume of the neo-Hookean distortion: a mixed formulation (`solver::mixed`). Other laws,
    /// and those that relax, are as `Projected`.
    Mixed,
    /// Averaged over each node's cells (average nodal pressure): locks less than pointwise.
    Averaged,
    /// J of the integration point itself: locks as nu tends to 0.5.
    Pointwise,
}

/// Precision of the kernel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// 32-bit shape table and stress; state and time integration stay 64-bit.
    F32,
    /// 64-bit throughout.
    F64,
}

/// What the solver needs besides cloud and shape table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SolverSettings {
    /// The material.
    pub law: Law,
    /// Which volume ratio the pressure sees.
    pub volume_ratio: VolumeRatio,
    /// Precision of the kernel.
    pub precision: Precision,
    /// f: fraction of the stable step.
    pub step_factor: f64,
    /// Threads, the caller's included.
    pub threads: usize,
}
