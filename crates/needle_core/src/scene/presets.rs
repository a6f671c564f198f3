//! The scenes that are compiled in.

use super::key::nearest_word;
use super::{Scene, SceneError};

/// A scene that is compiled in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Preset {
    /// Name, as `--scene` takes it.
    pub name: &'static str,
    /// The scene file's text, comments included.
    pub text: &'static str,
}

/// All presets.
pub static PRESETS: &[Preset] = &[
    Preset { name: "compression", text: include_str!("presets/compression.toml") },
    Preset { name: "indentation", text: include_str!("presets/indentation.toml") },
    Preset { name: "needle_insertion", text: include_str!("presets/needle_insertion.toml") },
    Preset { name: "layered_tissue", text: include_str!("presets/layered_tissue.toml") },
];

impl Preset {
    /// Those of the source paper, which have a reference solution.
    #[must_use]
    pub fn of_the_paper() -> &'static [Self] {
        &PRESETS[..3]
    }

    /// The preset of a name.
    ///
    /// # Errors
    /// [`SceneError::UnknownPreset`], with the names that exist.
    pub fn find(name: &str) -> Result<&'static Self, SceneError> {
        PRESETS.iter().find(|preset| preset.name == name).ok_or_else(|| {
            let names: Vec<&str> = PRESETS.iter().map(|preset| preset.name).collect();
            SceneError::UnknownPreset {
                name: name.to_owned(),
                known: names.join(", "),
                hint: nearest_word(name, &names).map_or_else(String::new, |near| format!("; did you mean {near}?")),
            }
        })
    }

    /// The scene itself.
    ///
    /// # Errors
    /// None for the presets as shipped, which a test holds them to.
    pub fn scene(&self) -> Result<Scene, SceneError> {
        Scene::from_toml(self.text, self.name)
    }
}
