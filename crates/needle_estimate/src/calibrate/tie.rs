//! Coupled keys: keys that are equal stay equal, and the force is proportional to all pressures of a law together.

use super::unknown::Sought;
use needle_core::scene::Scene;

/// All pressures of a law. The force is proportional to them together (quasi-static, Poisson's ratio fixed), so a
/// change of all by one factor needs no run. The second is a list, with a single element if it is sought.
pub(super) const PRESSURES: [&str; 6] = [
    "material.shear_modulus_pa",
    "material.ogden_shear_moduli_pa",
    "material.c10_pa",
    "material.c01_pa",
    "material.c20_pa",
    "material.c30_pa",
];

/// The keys coupled to unknowns, with the indices of these.
pub(super) fn tied(scene: &Scene, sought: &[Sought]) -> Vec<(&'static str, usize)> {
    let of = |(k, s): (usize, &Sought)| scene.tied_to(s.name()).map(|key| (key, k));
    let alone = |key: &str| sought.iter().all(|s| s.name() != key);
    sought.iter().enumerate().filter_map(of).filter(|(key, _)| alone(key)).collect()
}

/// The unknowns that are pressures, if they are all pressures of the scene's law. The modulus of one of several
/// regions is not.
pub(super) fn pressures(scene: &Scene, sought: &[Sought]) -> Vec<usize> {
    let scale = sought.iter().position(Sought::is_scale).filter(|_| scene.regions.is_empty());
    if let Some(scale) = scale {
        return vec![scale];
    }
    let place = |key: &str| sought.iter().position(|s| matches!(s, Sought::Key(own) if own == key));
    let zero = |key: &str| scene.get(key).and_then(|v| v.as_list()).is_none_or(|list| list.iter().all(|x| *x == 0.0));
    let whole = PRESSURES.iter().all(|key| zero(key) || place(key).is_some());
    let places = PRESSURES.iter().filter_map(|key| place(key)).collect();
    if whole && scene.regions.is_empty() { places } else { Vec::new() }
}
