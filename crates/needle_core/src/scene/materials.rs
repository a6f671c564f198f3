//! `[materials.NAME]`: further materials, for regions.

use super::instrument::{FORCE, FRICTION, PER_LENGTH, SHARE};
use super::section::{Scope, Section, read, section, write};
use super::values::Values;
use super::{Interaction, Key, Material, Region, Scene, SceneError};

/// A material with a name.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedMaterial {
    /// By which regions call it.
    pub name: String,
    /// Its law with all constants.
    pub material: Material,
    /// Whether it is rigid and stands still, as bone: no constant matters then.
    pub rigid: bool,
    /// What it does to a needle.
    pub pierced: Pierced,
}

section! {
    /// What a material does to a frictional needle.
    #[derive(Clone, Copy, Debug, PartialEq, Default)]
    pub struct Pierced => {
        /// Largest friction per length of a frictional needle's shaft in the material.
        friction: f64 = Key::real("materials.friction_n_per_m", PER_LENGTH, "N/m").or("0.0"),
        /// Friction over the normal pressure of the tissue on a frictional needle's shaft, added to the friction per length.
        friction_coefficient: f64 = Key::real("materials.friction_coefficient", FRICTION, "").or("0.0"),
        /// Force of a frictional needle's tip at which it advances through the material.
        cutting_force: f64 = Key::real("materials.cutting_force_n", FORCE, "N").or("0.0"),
        /// Force of a frictional needle's tip at which it enters the material; 0: no membrane.
        puncture_force: f64 = Key::real("materials.puncture_force_n", FORCE, "N").or("0.0"),
        /// Exponent of the speed in the cutting force, as `instrument.cutting_rate_exponent`.
        cutting_rate_exponent: f64 = Key::real("materials.cutting_rate_exponent", SHARE, "").or("0.0"),
        /// Fracture toughness: where no cutting force is given, it is the toughness times the needle's diameter.
        fracture_toughness: f64 = Key::real("materials.fracture_toughness_j_per_m2", FORCE, "J/m2").or("0.0"),
    }
}

impl Scene {
    /// Whether a needle with friction has a membrane to pierce anywhere.
    #[must_use]
    pub(crate) fn has_membrane(&self) -> bool {
        let named = |name: &str| self.materials.iter().find(|m| m.name == name);
        let of_region = |r: &Region| named(&r.material).is_some_and(|m| m.pierced.puncture_force > 0.0);
        match self.instrument.map(|i| i.interaction) {
            Some(Interaction::Frictional { puncture_force, .. }) => {
                puncture_force > 0.0 || self.regions.iter().any(of_region)
            }
            _ => false,
        }
    }
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
        Material::keys().into_iter().map(named).chain([RIGID]).chain(Pierced::keys()).collect()
    }

    fn read(values: &Values, _: Scope<'_>) -> Result<Self, SceneError> {
        let of = |name: &str| {
            let scope = Scope::Named(name);
            let (material, rigid) = (Material::read(values, scope)?, read(values, scope, &RIGID)?);
            Ok(NamedMaterial { name: name.to_owned(), material, rigid, pierced: Pierced::read(values, scope)? })
        };
        values.names("materials").map(of).collect()
    }

    fn write(&self, values: &mut Values, _: Scope<'_>) {
        for NamedMaterial { name, material, rigid, pierced } in self {
            material.write(values, Scope::Named(name));
            write(values, Scope::Named(name), &RIGID, rigid);
            pierced.write(values, Scope::Named(name));
        }
    }
}
