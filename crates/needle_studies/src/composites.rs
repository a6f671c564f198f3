//! Samples of several materials that have a reference solution (`bags/reference/README.md`, its last table): a preset
//! with other regions.

use super::csv;
use needle_core::scene::{Override, Preset, Scene, SceneError, Target};
use std::collections::BTreeMap;

/// A composite sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Composite {
    /// Name for `--scene`.
    pub name: &'static str,
    /// The preset that it is made from.
    pub preset: &'static str,
    /// Its materials and regions, as TOML.
    regions: &'static str,
    /// Other differences from the preset.
    keys: &'static [(&'static str, &'static str)],
    /// Heights in the undeformed sample of points on the axis whose displacement the reference contains, mm.
    heights_mm: &'static [u8],
    /// The reference: depth, force, uncertainty, displacements.
    pub(super) table: &'static str,
}

const LAYERS: &str = r#"
[materials.stiff]
model = "neo_hookean"
shear_modulus_pa = 5034.0
[materials.soft]
model = "neo_hookean"
shear_modulus_pa = 839.0
[[regions]]
name = "top"
material = "stiff"
shape = "layer"
from_depth_m = 0.0
to_depth_m = 0.002
[[regions]]
name = "middle"
material = "soft"
shape = "layer"
from_depth_m = 0.002
to_depth_m = 0.007
"#;

const SPHERE_AT_10_MM: &str = r#"
[materials.hard]
model = "neo_hookean"
shear_modulus_pa = 8390.0
[[regions]]
name = "inclusion"
material = "hard"
shape = "sphere"
centre_m = [0.0, 0.0, 0.010]
radius_m = 0.003
"#;

const SPHERE_AT_8_5_MM: &str = r#"
[materials.hard]
model = "neo_hookean"
shear_modulus_pa = 16780.0
[[regions]]
name = "inclusion"
material = "hard"
shape = "sphere"
centre_m = [0.0, 0.0, 0.0085]
radius_m = 0.003
"#;

const SKIN: &str = r#"
[materials.skin]
model = "neo_hookean"
shear_modulus_pa = 16780.0
[[regions]]
name = "skin"
material = "skin"
shape = "layer"
from_depth_m = 0.0
to_depth_m = 0.0005
"#;

/// The references have no wall contact.
const NO_WALL: (&str, &str) = ("instrument.wall_contact", "false");

/// All of them.
pub const COMPOSITES: [Composite; 5] = [
    Composite {
        name: "layered_indentation",
        preset: "indentation",
        regions: LAYERS,
        keys: &[NO_WALL],
        heights_mm: &[15, 10],
        table: include_str!("../bags/reference/layered_indentation.csv"),
    },
    Composite {
        name: "layered_needle",
        preset: "needle_insertion",
        regions: LAYERS,
        keys: &[],
        heights_mm: &[],
        table: include_str!("../bags/reference/layered_needle.csv"),
    },
    Composite {
        name: "inclusion_indentation",
        preset: "indentation",
        regions: SPHERE_AT_10_MM,
        keys: &[NO_WALL],
        heights_mm: &[13, 10, 7],
        table: include_str!("../bags/reference/inclusion_indentation.csv"),
    },
    Composite {
        name: "inclusion_compression",
        preset: "compression",
        regions: SPHERE_AT_8_5_MM,
        keys: &[],
        heights_mm: &[],
        table: include_str!("../bags/reference/inclusion_compression.csv"),
    },
    Composite {
        name: "membrane_indentation",
        preset: "indentation",
        regions: SKIN,
        // the force is only a few mN: with one step per pose the inertial error is 2 % of it (docs/lab/layers.md)
        keys: &[NO_WALL, ("instrument.diameter_m", "0.001"), ("stepping.tolerance", "0.0015")],
        heights_mm: &[],
        table: include_str!("../bags/reference/membrane_indentation.csv"),
    },
];

/// The scene with a name: a composite or a preset.
///
/// # Errors
/// [`SceneError`] if it is neither.
pub fn posed(name: &str) -> Result<Scene, SceneError> {
    Composite::find(name).map_or_else(|| Scene::preset(name), Composite::scene)
}

impl Composite {
    /// The composite with a name.
    #[must_use]
    pub fn find(name: &str) -> Option<&'static Self> {
        COMPOSITES.iter().find(|c| c.name == name)
    }

    /// Its scene, with targets at the points for which the reference has displacements.
    ///
    /// # Errors
    /// None for the shipped composites; a test checks this.
    pub fn scene(&self) -> Result<Scene, SceneError> {
        let text = Preset::find(self.preset)?.text.to_owned() + self.regions;
        let keys: Vec<_> = self.keys.iter().map(|(key, value)| Override::text(key, value, "study")).collect();
        let mut scene = Scene::from_toml(&text, self.name)?.with(&keys)?;
        self.name.clone_into(&mut scene.name);
        let height = |z: &u8| Target { name: format!("z{z}mm"), position: [0.0, 0.0, 1e-3 * f64::from(*z)] };
        scene.targets = self.heights_mm.iter().map(height).collect();
        Ok(scene)
    }

    /// Depth, m, and upward displacement of each target at that depth, m.
    #[must_use]
    pub(crate) fn displacements(&self) -> Vec<(f64, Vec<f64>)> {
        let rows = csv::read(self.table).filter_map(Result::ok);
        let row = |row: BTreeMap<String, f64>| {
            let of = |z: &u8| row.get(&format!("uz_axis_z{z}mm_m")).copied();
            Some((*row.get("depth_m")?, self.heights_mm.iter().map(of).collect::<Option<_>>()?))
        };
        rows.filter_map(row).collect()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn every_one_is_a_scene_with_its_reference() {
        for composite in COMPOSITES {
            let scene = composite.scene().unwrap();
            assert!(!scene.regions.is_empty(), "{}", composite.name);
            let moved = composite.displacements();
            assert_eq!(moved.len(), composite.table.lines().count() - 1, "{}", composite.name);
            assert!(moved.iter().all(|(_, up)| up.len() == scene.targets.len()));
        }
        let (depth, up) = Composite::find("layered_indentation").unwrap().displacements()[3].clone();
        assert_eq!((depth, up), (0.004, vec![-0.003825, -0.002056]));
    }
}
