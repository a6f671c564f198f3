//! Applies the corrections of the scene's `[align]` to a recording.

use std::borrow::Cow;

use super::Recording;
use needle_core::scene::{Align, Scene};

impl Recording {
    /// The recording after the corrections of the scene's `[align]`: contact depth, clock of the force, the load
    /// cell's zero and drift along the instrument. The unchanged recording if the scene has none.
    #[must_use]
    pub fn aligned(&self, scene: &Scene) -> Cow<'_, Self> {
        let Some(align) = scene.align.filter(|align| *align != Align::NONE) else { return Cow::Borrowed(self) };
        let (first_s, axis) = match (self.depths.first(), self.poses.first()) {
            (Some(depth), _) => (depth.time_s, direction(scene)),
            (None, Some(pose)) => (pose.time_s, pose.axis),
            (None, None) => (0.0, direction(scene)),
        };
        let mut aligned = self.clone();
        let contact = align.contact_depth.get();
        aligned.depths.iter_mut().for_each(|sample| sample.depth_m -= contact);
        for pose in &mut aligned.poses {
            (0..3).for_each(|k| pose.tip[k] -= contact * pose.axis[k]);
        }
        for force in &mut aligned.forces {
            let added = align.zero_n + align.drift_n_per_s * (force.time_s - first_s);
            // a reading is positive against the axis
            (0..3).for_each(|k| force.force_n[k] += added * axis[k]);
            force.time_s -= align.time_offset.get();
        }
        aligned.warnings.push(format!("taken out of the recording, as the scene says ([align]): {align}"));
        Cow::Owned(aligned)
    }

    /// The same of a recording that is not needed as it was: no copy is made where there is nothing to correct.
    #[must_use]
    pub fn into_aligned(self, scene: &Scene) -> Self {
        let aligned = match self.aligned(scene) {
            Cow::Owned(aligned) => Some(aligned),
            Cow::Borrowed(_) => None,
        };
        aligned.unwrap_or(self)
    }
}

/// Unit vector along the scene's instrument, into the sample.
fn direction(scene: &Scene) -> [f64; 3] {
    scene.instrument.as_ref().map_or([0.0, 0.0, -1.0], needle_core::scene::Instrument::axis)
}
