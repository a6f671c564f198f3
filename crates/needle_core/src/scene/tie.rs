//! Keys that go together: where two are equal, they stay equal while only one of them is changed.

use super::Scene;

/// The first stays equal to the second.
const TIED: [(&str, &str); 2] = [
    ("instrument.retraction_coefficient", "instrument.deformation_coefficient"),
    ("sample.base_friction_coefficient", "instrument.friction_coefficient"),
];

impl Scene {
    /// The key that stays equal to another one of this scene, where somebody looks for the values of keys or draws them.
    #[must_use]
    pub fn tied_to(&self, other: &str) -> Option<&'static str> {
        let same = |key| self.get(key).is_some() && self.get(key) == self.get(other);
        TIED.iter().find(|(key, of)| *of == other && same(key)).map(|(key, _)| *key)
    }
}
