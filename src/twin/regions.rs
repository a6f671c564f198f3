//! Regions of a scene in its model: which material each cell is of.

use crate::mesh::Volumes;
use crate::scene::{Material, NamedMaterial, Region, RegionShape, Scene};
use mtled::cloud::Solid;
use mtled::material::Law;
use mtled::solver::Role;

/// The shape of a region in a sample whose top is at this height; `None` for a group of a mesh.
pub(super) fn solid(shape: &RegionShape, top: f64) -> Option<Solid> {
    match *shape {
        RegionShape::Layer { from_depth, to_depth } => {
            Some(Solid::Layer { bottom: top - to_depth.get(), top: top - from_depth.get() })
        }
        RegionShape::Sphere { centre, radius } => Some(Solid::Sphere { centre, radius: radius.get() }),
        RegionShape::Cylinder { centre, radius, height } => {
            Some(Solid::Cylinder { centre, radius: radius.get(), height: height.get() })
        }
        RegionShape::Box { centre, size } => Some(Solid::Box { centre, size }),
        RegionShape::Group { .. } => None,
    }
}

/// Region of a point of a generated body, as [`of_cells`].
pub(super) fn at(scene: &Scene, top: f64, point: [f64; 3]) -> u8 {
    let holds = |i: &usize| solid(&scene.regions[*i].shape, top).is_some_and(|solid| solid.signed(point) <= 0.0);
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
    let shapes: Vec<Option<Solid>> = scene.regions.iter().map(|r| solid(&r.shape, top)).collect();
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
    let (Some(solid), Some(grading)) = (solid(&region.shape, 0.0), &scene.discretisation.grading) else { return false };
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
