//! `[[targets]]`: material points whose position is predicted.

use super::section::{Scope, Section, section};
use super::values::Values;
use super::{Key, SceneError};

section! {
    /// A material point whose position is predicted.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Target => {
        /// Name of the target.
        name: String = Key::text("targets.name"),
        /// Position in the undeformed sample, frame `sample`.
        position: [f64; 3] = Key::point("targets.position_m", "m"),
    }
}

impl Section for Vec<Target> {
    fn keys() -> Vec<Key> {
        Target::keys()
    }

    fn read(values: &Values, _: Scope<'_>) -> Result<Self, SceneError> {
        (0..values.targets()).map(|i| Target::read(values, Scope::Element(i))).collect()
    }

    fn write(&self, values: &mut Values, _: Scope<'_>) {
        self.iter().enumerate().for_each(|(i, target)| target.write(values, Scope::Element(i)));
    }
}
