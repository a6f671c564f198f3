//! What a scene may ask for and is unlikely to get: said when it is checked or built, and no error.

use super::{DeformationRule, InstrumentKind, Scene};

/// Way that captured tissue can be pushed ahead of the tip before cells turn inside out there, m: runs ended at 1.6 to 2.1 mm,
/// whatever the capture radius (`docs/stability.md`).
const FURTHEST_PUSH: f64 = 1.5e-3;

impl Scene {
    /// Advice, one clause each.
    #[must_use]
    pub fn advice(&self) -> Vec<String> {
        let Some(InstrumentKind::Needle(needle)) = self.instrument.map(|i| i.kind) else { return Vec::new() };
        let push = needle.deformation_coefficient * self.motion.map_or(0.0, |m| m.depth.get());
        if needle.deformation_rule != DeformationRule::Absolute || push <= FURTHEST_PUSH {
            return Vec::new();
        }
        vec![format!(
            "instrument.deformation_rule = \"absolute\" pushes the tissue at the tip {:.1} mm ahead (instrument.deformation_coefficient \
             times motion.depth_m): past {:.1} mm cells turn inside out there and the run ends; take \"incremental\"",
            1e3 * push,
            1e3 * FURTHEST_PUSH
        )]
    }
}
