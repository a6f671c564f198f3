//! `[materials.NAME]`: further materials, for regions.

use super::section::{Scope, Section, read, write};
use super::values::Values;
use super::{Key, Material, SceneError};

/// A material with a name.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedMaterial {
    /// By which regions call it.
    pub name: String,
    /// Its law with all constants.
    pub material: Material,
    /// Whether it is rigid and stands still, as bone: no constant matters then.
    pub rigid: bool,
}

const RIGID: Key = Key::boolean("materials.rigid")
    .described("Whether the material is rigid and stands still, as bone: its other constants then do nothing.")
    .or("false");

impl Section for Vec<NamedMaterial> {
    fn keys() -> Vec<Key> {
        // The registry is built once; what it leaks is a few words.
        let plural = |path: &'static str| -> &'static str { path.replacen("material.", "materials.", 1).leak() };
        let named = |key: Key| Key {
            path: plural(key.path),
            only_with: key.only_with.map(|(selector, words)| (plural(selector), words)),
            live: false,
            ..key
        };
        Material::keys().into_iter().map(named).chain([RIGID]).collect()
    }

    fn read(values: &Values, _: Scope<'_>) -> Result<Self, SceneError> {
        let of = |name: &str| {
            let scope = Scope::Named(name);
            let (material, rigid) = (Material::read(values, scope)?, read(values, scope, &RIGID)?);
            Ok(NamedMaterial { name: name.to_owned(), material, rigid })
        };
        values.names("materials").map(of).collect()
    }

    fn write(&self, values: &mut Values, _: Scope<'_>) {
        for NamedMaterial { name, material, rigid } in self {
            material.write(values, Scope::Named(name));
            write(values, Scope::Named(name), &RIGID, rigid);
        }
    }
}
