//! A coarse run of the model: an insertion in a few poses of a few steps, to check a recording before a fit.

use needle_core::scene::Dimension;
use needle_core::twin::Twin;

/// Poses of the run, and explicit steps of each pose in a half plane and in space.
pub(super) const POSES: u32 = 16;
const STEPS: [u32; 2] = [60, 12];

/// An undeformed copy of a twin that takes so few steps.
pub(super) fn coarse(twin: &Twin) -> Twin {
    let mut double = twin.double();
    double.limit_steps(STEPS[usize::from(twin.dimension() != Dimension::Axisymmetric)]);
    double
}
