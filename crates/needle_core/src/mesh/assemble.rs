//! From a mesh as its file has it to a [`Cloud`]: metres, positive cells, groups as faces, order along a curve.

use std::collections::BTreeMap;

use mtled::cloud::check::{self, Fault};
use mtled::cloud::hexahedron::is_sound;
use mtled::cloud::quality::{Summary, six_volumes, volume_length};

use super::imported::{Imported, Volumes, Wanted};
use mtled::cloud::{BASE, Cloud, Hexahedron, MAX_NODES, SIDE, TOP, hilbert_order, sort_cells};

/// Quality of a cell (1: regular tetrahedron) below which it is worth a warning.
const POOR: f64 = 0.1;
/// Volume of a cell over the cube of its longest edge at which it counts as flat.
const FLAT: f64 = 1e-12;

/// The cloud, the volume groups of its cells, and warnings.
pub(super) fn assemble(mut mesh: Imported, wanted: &Wanted<'_>) -> Result<(Cloud, Volumes, Vec<String>), String> {
    let mut warnings = Vec::new();
    let unused = drop_unused(&mut mesh);
    if unused > 0 {
        warnings.push(format!("{unused} nodes belong to no cell and were left out"));
    }
    scale(&mut mesh, wanted.unit_m)?;
    straighten(&mut mesh)?;
    let turned = turn(&mut mesh)?;
    if turned > 0 {
        warnings.push(format!("{turned} inverted tetrahedra were turned round"));
    }
    let surface = check::check(&mesh.points, &mesh.cells).map_err(|fault| named(&fault, &mesh))?;
    let faces = faces(&mesh, &surface, wanted)?;
    let (cloud, volumes) = ordered(&mesh, &faces);
    let poor = poor_cells(&cloud);
    if poor > 0 {
        warnings.push(format!(
            "{poor} of {} cells are poor (quality below {POOR}, lowest {:.3}; a regular tetrahedron has 1): \
             optimise the mesh, or the force may be wrong near them",
            cloud.cells.len(),
            cloud.quality.lowest
        ));
    }
    Ok((cloud, volumes, warnings))
}

/// Leaves out nodes of no cell, or of no triangle of a surface alone; returns how many there were.
pub(super) fn drop_unused(mesh: &mut Imported) -> usize {
    let mut number = vec![u32::MAX; mesh.points.len()];
    mesh.cells.iter().flatten().chain(mesh.surface.iter().flatten()).for_each(|&n| number[n as usize] = 0);
    let kept: Vec<usize> = (0..number.len()).filter(|&n| number[n] == 0).collect();
    for (new, &old) in kept.iter().enumerate() {
        number[old] = new as u32;
    }
    let unused = number.len() - kept.len();
    mesh.points = kept.iter().map(|&n| mesh.points[n]).collect();
    mesh.node_names = kept.iter().map(|&n| mesh.node_names[n]).collect();
    let surface = mesh.surface.iter_mut().flatten();
    mesh.cells.iter_mut().flatten().chain(surface).for_each(|n| *n = number[*n as usize]);
    mesh.hexahedra.iter_mut().flat_map(|h| &mut h.corners).for_each(|n| *n = number[*n as usize]);
    for nodes in mesh.groups.values_mut() {
        nodes.retain(|&n| number[n as usize] != u32::MAX);
        nodes.iter_mut().for_each(|n| *n = number[*n as usize]);
    }
    unused
}

/// Metres from the file's unit.
pub(super) fn scale(mesh: &mut Imported, unit_m: f64) -> Result<(), String> {
    if mesh.points.len() > MAX_NODES {
        return Err(format!("it has {} nodes; at most {MAX_NODES} are taken: use a coarser mesh", mesh.points.len()));
    }
    mesh.points.iter_mut().flatten().for_each(|x| *x *= unit_m);
    Ok(())
}

/// Turns the corners of hexahedra so that their maps have positive determinants.
fn straighten(mesh: &mut Imported) -> Result<(), String> {
    let Imported { points, cells, cell_names, hexahedra, .. } = mesh;
    let at = |n: u32| points[n as usize];
    for hexahedron in hexahedra {
        let upright: Vec<bool> =
            hexahedron.cells.iter().map(|&c| six_volumes(&cells[c as usize].map(at)) > 0.0).collect();
        let [a, b, c, d, e, f, g, h] = hexahedron.corners;
        if !upright[0] {
            hexahedron.corners = [e, f, g, h, a, b, c, d];
        }
        if upright.iter().any(|u| *u != upright[0]) || !is_sound(&hexahedron.corners.map(at)) {
            return Err(format!(
                "hexahedron {}, at {:?} m, is folded or flat: its faces pass through each other, or its corners are not in the order of \
                 Gmsh and VTK (those of one face in turn, then those opposite to them): repair the mesh",
                cell_names[hexahedron.cells[0] as usize],
                at(a)
            ));
        }
    }
    Ok(())
}

/// Turns inverted cells round; returns how many there were.
fn turn(mesh: &mut Imported) -> Result<usize, String> {
    let (mut turned, mut flat, mut first) = (0, 0, None);
    for (i, c) in mesh.cells.iter_mut().enumerate() {
        let p = c.map(|n| mesh.points[n as usize]);
        let length = |k: usize| (0..3).map(|i| (p[k][i] - p[0][i]).powi(2)).sum::<f64>().sqrt();
        let size = (1..4).map(length).fold(0.0, f64::max);
        let volume = six_volumes(&p) / 6.0;
        if volume.abs() <= FLAT * size.powi(3) {
            flat += 1;
            first = first.or(Some((mesh.cell_names[i], p)));
        } else if volume < 0.0 {
            c.swap(2, 3);
            turned += 1;
        }
    }
    match first {
        None => Ok(turned),
        Some((cell, p)) => Err(format!(
            "{flat} of its {} tetrahedra are flat (no volume); the first is {cell}, at {:?} m: optimise the mesh",
            mesh.cells.len(),
            p[0]
        )),
    }
}

/// A fault, with what the file calls the nodes that it numbers.
fn named(fault: &Fault, mesh: &Imported) -> String {
    let nodes = fault.nodes();
    let names: Vec<String> = nodes
        .iter()
        .filter_map(|&n| Some(format!("{n} is {} at {:?} m", mesh.node_names.get(n)?, mesh.points.get(n)?)))
        .collect();
    if names.is_empty() { fault.to_string() } else { format!("{fault} (in the file, node {})", names.join(", ")) }
}

/// Faces of each node from the groups and the surface.
fn faces(mesh: &Imported, surface: &[[u32; 3]], wanted: &Wanted<'_>) -> Result<Vec<u8>, String> {
    let mut outer = vec![false; mesh.points.len()];
    surface.iter().flatten().for_each(|&n| outer[n as usize] = true);
    let mut faces = vec![0u8; mesh.points.len()];
    let of_base = (wanted.base, "base_group", BASE);
    for (name, key, bit) in std::iter::once(of_base).chain(wanted.contact.map(|name| (name, "contact_group", TOP))) {
        let nodes = mesh.groups.get(name).ok_or_else(|| missing(name, key, &mesh.known_groups))?;
        let before = faces.iter().filter(|f| **f & bit != 0).count();
        nodes.iter().filter(|n| outer[**n as usize]).for_each(|&n| faces[n as usize] |= bit);
        if faces.iter().filter(|f| **f & bit != 0).count() == before {
            return Err(format!("its group \"{name}\" ({key}) has no node on the surface of the tetrahedra"));
        }
    }
    for t in surface {
        if face_of(t, &faces) == 0 {
            t.iter().for_each(|&n| faces[n as usize] |= OTHER);
        }
    }
    Ok(faces)
}

/// The face of surface triangles in neither group.
const OTHER: u8 = SIDE & SIDE.wrapping_neg();

fn missing(name: &str, key: &str, known: &[String]) -> String {
    let known = match known {
        [] => "it has none: name the surfaces before meshing (Gmsh: physical groups; VTU: point or cell arrays)".into(),
        _ => format!("it has {}", known.join(", ")),
    };
    format!("it has no surface group \"{name}\" ({key}); {known}")
}

/// The one of the two groups that holds all corners of a triangle, the base first; 0: neither.
fn face_of(t: &[u32; 3], faces: &[u8]) -> u8 {
    let shared = t.iter().fold(BASE | TOP, |bits, &n| bits & faces[n as usize]);
    if shared & BASE != 0 { BASE } else { shared }
}

/// Faces of the nodes and triangles of a surface.
pub(super) fn surface_faces(
    mesh: &Imported,
    surface: &[[u32; 3]],
    wanted: &Wanted<'_>,
) -> Result<(Vec<u8>, Vec<u8>), String> {
    let faces = faces(mesh, surface, wanted)?;
    let of_triangles = surface.iter().map(|t| Some(face_of(t, &faces)).filter(|face| *face != 0).unwrap_or(OTHER));
    let of_triangles = of_triangles.collect();
    Ok((faces, of_triangles))
}

fn ordered(mesh: &Imported, faces: &[u8]) -> (Cloud, Volumes) {
    let order = hilbert_order(&mesh.points);
    let mut number = vec![0u32; order.len()];
    for (new, &old) in order.iter().enumerate() {
        number[old as usize] = new as u32;
    }
    let points: Vec<[f64; 3]> = order.iter().map(|&n| mesh.points[n as usize]).collect();
    let faces: Vec<u8> = order.iter().map(|&n| faces[n as usize]).collect();
    let mut cells: Vec<[u32; 4]> = mesh.cells.iter().map(|c| c.map(|n| number[n as usize])).collect();
    let key = |c: &[u32; 4]| {
        let mut key = *c;
        key.sort_unstable();
        key
    };
    let before: BTreeMap<[u32; 4], usize> = cells.iter().map(key).zip(0..).collect();
    sort_cells(&mut cells);
    let old: Vec<usize> = cells.iter().filter_map(|c| before.get(&key(c)).copied()).collect();
    let mut new = vec![0u32; old.len()];
    old.iter().zip(0..).for_each(|(&old, n)| new[old] = n);
    let of_cell = old.iter().map(|&c| mesh.volumes.of_cell.get(c).copied().flatten()).collect();
    let volumes = Volumes { of_cell, ..mesh.volumes.clone() };
    let renumbered = |h: &Hexahedron| Hexahedron {
        corners: h.corners.map(|n| number[n as usize]),
        cells: h.cells.iter().map(|&c| new[c as usize]).collect(),
    };
    let hexahedra = mesh.hexahedra.iter().map(renumbered).collect();
    // the same cells have passed already
    let surface = check::surface(points.len(), &cells).unwrap_or_default();
    let surface_faces = surface
        .iter()
        .map(|t| match face_of(t, &faces) {
            0 => OTHER,
            face => face,
        })
        .collect();
    let quality = Summary::of(&points, &cells);
    (Cloud { points, cells, faces, surface, surface_faces, quality, hexahedra }, volumes)
}

fn poor_cells(cloud: &Cloud) -> usize {
    let quality = |c: &[u32; 4]| volume_length(&c.map(|n| cloud.points[n as usize]));
    cloud.cells.iter().filter(|c| quality(c) < POOR).count()
}
