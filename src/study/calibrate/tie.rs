//! Keys that go together: equal ones stay equal, and the force is proportional to all pressures of a law at once.

use super::unknown::Sought;
use crate::scene::Scene;

/// All pressures of a law: the force is proportional to them taken together (quasi-static, Poisson's ratio fixed), so a change of all by
/// one factor needs no run. The second is a list, of one where it is sought.
const PRESSURES: [&str; 6] = [
    "material.shear_modulus_pa",
    "material.ogden_shear_moduli_pa",
    "material.c10_pa",
    "material.c01_pa",
    "material.c20_pa",
    "material.c30_pa",
];
/// Where a scene has the first equal to the second, and only the second is sought, they stay equal.
const TIED: [(&str, &str); 2] = [
    ("instrument.retraction_coefficient", "instrument.deformation_coefficient"),
    ("sample.base_friction_coefficient", "instrument.friction_coefficient"),
];

/// The key that stays equal to another one of a scene.
pub(super) fn tied_to(scene: &Scene, other: &str) -> Option<&'static str> {
    let same = |key| scene.get(key).is_some() && scene.get(key) == scene.get(other);
    TIED.iter().find(|(key, of)| *of == other && same(key)).map(|(key, _)| *key)
}

/// The keys that go with unknowns, with the indices of these.
pub(super) fn tied(scene: &Scene, sought: &[Sought]) -> Vec<(&'static str, usize)> {
    let of = |(k, s): (usize, &Sought)| tied_to(scene, s.name()).map(|key| (key, k));
    let alone = |key: &str| sought.iter().all(|s| s.name() != key);
    sought.iter().enumerate().filter_map(of).filter(|(key, _)| alone(key)).collect()
}

/// The unknowns that are pressures, if they are all that the scene's law has. The modulus of one of several regions is not.
pub(super) fn pressures(scene: &Scene, sought: &[Sought]) -> Vec<usize> {
    let place = |key: &str| sought.iter().position(|s| matches!(s, Sought::Key(own) if own == key));
    let zero = |key: &str| scene.get(key).and_then(|v| v.as_list()).is_none_or(|list| list.iter().all(|x| *x == 0.0));
    let whole = PRESSURES.iter().all(|key| zero(key) || place(key).is_some());
    let places = PRESSURES.iter().filter_map(|key| place(key)).collect();
    if whole && scene.regions.is_empty() { places } else { Vec::new() }
}
