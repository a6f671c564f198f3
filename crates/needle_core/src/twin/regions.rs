//! Regions of a scene in its model: which material each cell is of.

use crate::mesh::Volumes;
use crate::scene::{Material, NamedMaterial, Region, RegionShape, Scene};
use mtled::cloud::Solid;
use mtled::material::Law;
use mtled::solver::Role;

/// The regions of a body whose top is at this height, with their solids, in an order that is theirs and not the file's: from the top down, but
/// after those before them in the file that they have a part in common with, of which the first counts. So the order of regions that are
/// apart changes no cloud. Groups of a mesh are left out.
pub(super) fn in_order(scene: &Scene, top: f64) -> Vec<(&Region, Solid)> {
    let mut left: Vec<_> = scene.regions.iter().filter_map(|r| Some((r, r.shape.solid(top)?))).collect();
    let mut ordered = Vec::with_capacity(left.len());
    while !left.is_empty() {
        let first = |i: &usize| left[..*i].iter().all(|(_, before)| before.is_apart(&left[*i].1));
        let lower = |a: &usize, b: &usize| left[*a].1.from_the_top(&left[*b].1);
        let next = (0..left.len()).filter(first).min_by(lower).unwrap_or(0);
        ordered.push(left.remove(next));
    }
    ordered
}

/// Region of a point of a generated body, as [`of_cells`].
pub(super) fn at(scene: &Scene, top: f64, point: [f64; 3]) -> u8 {
    let holds = |i: &usize| scene.regions[*i].shape.solid(top).is_some_and(|solid| solid.signed(point) <= 0.0);
    (0..scene.regions.len()).find(holds).map_or(0, |i| i as u8 + 1)
}

/// Largest initial shear modulus within a distance above and below a point of a generated body, Pa: what a node on an interface is
/// held against is the stiffer side.
pub(super) fn stiffest(scene: &Scene, top: f64, [x, y, z]: [f64; 3], near: f64) -> f64 {
    let modulus = |z: f64| {
        let named = at(scene, top, [x, y, z]).checked_sub(1).map(|region| &scene.regions[usize::from(region)].material);
        let material = named.and_then(|name| scene.materials.iter().find(|m| m.name == *name));
        material.map_or(&scene.material, |m| &m.material).shear_modulus()
    };
    modulus(z - near).max(modulus(z + near))
}

/// Region of each cell: 0, or one more than the place in the scene's list. `volumes` are the groups of a mesh's cells.
pub(super) fn of_cells<const K: usize>(
    scene: &Scene,
    top: f64,
    points: &[[f64; 3]],
    cells: &[[u32; K]],
    volumes: &Volumes,
) -> Vec<u8> {
    let shapes: Vec<Option<Solid>> = scene.regions.iter().map(|r| r.shape.solid(top)).collect();
    let holds = |cell: usize, centre: [f64; 3], region: usize| match (&shapes[region], &scene.regions[region].shape) {
        (Some(solid), _) => solid.signed(centre) <= 0.0,
        (None, RegionShape::Group { group }) => {
            volumes.of_cell.get(cell).copied().flatten().is_some_and(|volume| volumes.is_in(volume, group))
        }
        _ => false,
    };
    let region = |(cell, c): (usize, &[u32; K])| {
        let centre = std::array::from_fn(|k| c.iter().map(|&n| points[n as usize][k]).sum::<f64>() / K as f64);
        (0..shapes.len()).find(|&i| holds(cell, centre, i)).map_or(0, |i| i as u8 + 1)
    };
    cells.iter().enumerate().map(region).collect()
}

/// Material of each cell from its region: 0 for `[material]`, or one more than the place among the scene's materials; empty
/// if all are of `[material]`.
pub(super) fn materials(scene: &Scene, region: &[u8]) -> Vec<u8> {
    let index = |name: &str| scene.materials.iter().position(|m| m.name == name).map_or(0, |i| i as u8 + 1);
    let of_region: Vec<u8> = std::iter::once(0).chain(scene.regions.iter().map(|r| index(&r.material))).collect();
    let material: Vec<u8> = region.iter().map(|&r| of_region[usize::from(r)]).collect();
    if material.iter().all(|m| *m == 0) { Vec::new() } else { material }
}

/// Largest modulus over the stiffest other one of a layer that is taken for crushed: with one point in each cell an indenter has lost its
/// force there when it has gone three times the layer's thickness (docs/lab/layers.md); of stiffer layers it does so later.
const CRUSHED: f64 = 0.1;
/// The same of its thickness over the scene's spacing: beyond, it has cells enough across.
const THIN: f64 = 2.0;

/// Whether a region of a generated body is crushed between what is round it before that gives way: thin, and much softer.
/// Two nodes across and one point in each of its cells do not see it fold, and then an instrument goes through it without a
/// force (docs/lab/layers.md).
pub(super) fn is_crushed(scene: &Scene, region: &Region) -> bool {
    let (Some(solid), Some(grading)) = (region.shape.solid(0.0), &scene.grading()) else { return false };
    let named = |name: &str| scene.materials.iter().find(|m| m.name == name);
    let others = scene.regions.iter().filter_map(|r| named(&r.material)).filter(|m| !m.rigid).map(|m| &m.material);
    let stiffest = others.chain([&scene.material]).map(Material::shear_modulus).fold(0.0, f64::max);
    let soft = |m: &NamedMaterial| !m.rigid && m.material.shear_modulus() <= CRUSHED * stiffest;
    solid.thickness() < THIN * grading.spacing.get() && named(&region.material).is_some_and(soft)
}

/// Which materials' cells have four points each in space, by [`materials`]: those of crushed regions.
pub(super) fn with_four_points(scene: &Scene) -> Vec<bool> {
    let crushed = |m: &NamedMaterial| scene.regions.iter().any(|r| r.material == m.name && is_crushed(scene, r));
    std::iter::once(false).chain(scene.materials.iter().map(crushed)).collect()
}

/// Laws by the materials' indices; without `composite` of `[material]` alone.
pub(super) fn laws(scene: &Scene, composite: bool) -> Vec<Law> {
    let further = if composite { &scene.materials[..] } else { &[] };
    std::iter::once(scene.material.law()).chain(further.iter().map(|m| m.material.law())).collect()
}

/// Holds the nodes of rigid materials where they are.
pub(super) fn hold_rigid<const K: usize>(scene: &Scene, cells: &[[u32; K]], material: &[u8], role: &mut [Role]) {
    let rigid = |m: u8| m > 0 && scene.materials[usize::from(m) - 1].rigid;
    for (c, _) in cells.iter().zip(material).filter(|(_, m)| rigid(**m)) {
        c.iter().for_each(|&n| role[n as usize] = Role::Base);
    }
}

/// What to say of regions that the model has nothing of.
pub(super) fn warnings(scene: &Scene, region: &[u8]) -> Vec<String> {
    let mut cells = vec![0_usize; scene.regions.len() + 1];
    region.iter().for_each(|&r| cells[usize::from(r)] += 1);
    let empty = scene.regions.iter().zip(&cells[1..]).filter(|(_, count)| **count == 0);
    let absent = empty.map(|(r, _)| {
        format!(
            "region \"{}\" holds no cell of the model: it lies outside of the sample or within regions before it, or is \
             smaller than discretisation.spacing_m resolves",
            r.name
        )
    });
    let unused = scene.materials.iter().filter(|m| scene.regions.iter().all(|r| r.material != m.name));
    absent.chain(unused.map(|m| format!("material \"{}\" is in no region", m.name))).collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::twin::Body;

    fn with(sample: &str, regions: &[&str]) -> Scene {
        let material = "model = \"neo_hookean\"\nshear_modulus_pa = 5000.0\n";
        let common = "poisson_ratio = 0.49\ndensity_kg_per_m3 = 1000.0\n";
        let head = format!("{sample}[material]\n{material}{common}[materials.a]\n{material}[materials.b]\n{material}");
        let instrument = "[instrument]\nkind = \"plate\"\n[discretisation]\nspacing_m = 0.004\n";
        Scene::from_toml(&format!("{head}{}{instrument}", regions.concat()), "regions.toml").unwrap()
    }

    /// Regions that are apart make the same cloud in any order, to the last bit; of two that overlap the first counts.
    #[test]
    fn the_order_of_regions_that_are_apart_changes_no_cloud() {
        let region = |name: &str, material: &str, shape: &str| {
            format!("[[regions]]\nname = \"{name}\"\nmaterial = \"{material}\"\n{shape}\n")
        };
        let layer = |from: f64, to: f64| format!("shape = \"layer\"\nfrom_depth_m = {from}\nto_depth_m = {to}");
        let sphere = |x: f64, z: f64| format!("shape = \"sphere\"\ncentre_m = [{x}, 0, {z}]\nradius_m = 0.003");
        let cylinder = "[sample]\nshape = \"cylinder\"\ndiameter_m = 0.024\nheight_m = 0.016\n";
        let full = "[sample]\nshape = \"box\"\nsize_x_m = 0.03\nsize_y_m = 0.02\nheight_m = 0.016\n";
        let layers =
            [("skin", "a", layer(0.0, 0.002)), ("fat", "b", layer(0.002, 0.006)), ("deep", "a", layer(0.006, 0.016))];
        let beside = [
            ("left", "a", sphere(-0.006, 0.009)),
            ("right", "b", sphere(0.006, 0.007)),
            ("skin", "b", layer(0.0, 0.002)),
        ];
        for (sample, regions) in [(cylinder, layers), (full, beside)] {
            let texts = regions.map(|(name, material, shape)| region(name, material, &shape));
            let [a, b, c] = texts.each_ref().map(String::as_str);
            let cloud = |order: [&str; 3]| Body::new(&with(sample, &order)).unwrap().cloud;
            let first = cloud([a, b, c]);
            for order in [[c, b, a], [b, c, a]] {
                let other = cloud(order);
                assert!(first.points == other.points && first.cells == other.cells, "{order:?}");
            }
        }
        let [over, under] = [region("over", "a", &sphere(0.0, 0.008)), region("under", "b", &layer(0.004, 0.012))];
        for (order, first) in [([&*over, &*under], "over"), ([&*under, &*over], "under")] {
            let scene = with(full, &order);
            assert_eq!(in_order(&scene, 0.016)[0].0.name, first);
        }
    }
}
