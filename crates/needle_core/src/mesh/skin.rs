//! A closed surface alone as a cloud without cells: the outline of a body that the twin fills.

use std::collections::BTreeMap;

use mtled::cloud::quality::Summary;
use mtled::cloud::{Cloud, MAX_NODES};

use super::assemble::{drop_unused, scale, surface_faces};
use super::imported::{Imported, Volumes, Wanted};

/// The cloud, and warnings.
pub(super) fn skin(mut mesh: Imported, wanted: &Wanted<'_>) -> Result<(Cloud, Volumes, Vec<String>), String> {
    drop_unused(&mut mesh);
    if mesh.points.len() > MAX_NODES {
        return Err(format!("it has {} corners; at most {MAX_NODES} are taken: decimate it", mesh.points.len()));
    }
    scale(&mut mesh, wanted.unit_m)?;
    let turned = orient(&mut mesh)?;
    let mut warnings = std::mem::take(&mut mesh.remarks);
    if turned > 0 {
        warnings.push(format!("{turned} of {} triangles were turned round", mesh.surface.len()));
    }
    let (faces, surface_faces) = surface_faces(&mesh, &mesh.surface, wanted)?;
    let quality = Summary::of(&mesh.points, &[]);
    let Imported { points, surface, .. } = mesh;
    let cloud = Cloud { points, cells: Vec::new(), faces, surface, surface_faces, quality, hexahedra: Vec::new() };
    Ok((cloud, Volumes::default(), warnings))
}

/// Turns triangles so that all look outward, and looks whether they close one body; how many were turned.
fn orient(mesh: &mut Imported) -> Result<usize, String> {
    let mut at_edge: BTreeMap<[u32; 2], Vec<u32>> = BTreeMap::new();
    for (i, t) in (0..).zip(&mesh.surface) {
        edges(t).iter().for_each(|[a, b]| at_edge.entry([*a.min(b), *a.max(b)]).or_default().push(i));
    }
    if let Some((edge, triangles)) = at_edge.iter().find(|(_, triangles)| triangles.len() != 2) {
        let open = at_edge.values().filter(|triangles| triangles.len() != 2).count();
        return Err(format!(
            "its surface is not closed, or passes through itself: {open} edges don't have two triangles; the first, at {:?} m, has {}: fill \
             holes and remove double faces (MeshLab, Blender, 3D Slicer)",
            mesh.points[edge[0] as usize],
            triangles.len()
        ));
    }
    let mut seen = vec![false; mesh.surface.len()];
    let (mut open, mut turned, mut reached) = (vec![0_u32], 0, 1);
    seen[0] = true;
    while let Some(i) = open.pop() {
        for [a, b] in edges(&mesh.surface[i as usize]) {
            for &other in &at_edge[&[a.min(b), a.max(b)]] {
                if std::mem::replace(&mut seen[other as usize], true) {
                    continue;
                }
                // neighbours go along their edge in opposite directions
                if edges(&mesh.surface[other as usize]).contains(&[a, b]) {
                    mesh.surface[other as usize].swap(1, 2);
                    turned += 1;
                }
                reached += 1;
                open.push(other);
            }
        }
    }
    if reached < mesh.surface.len() {
        return Err(format!(
            "it has several closed surfaces: the first has {reached} of {} triangles. Keep that of the body alone (islands and hollows of a \
             segmentation are removed by its largest component)",
            mesh.surface.len()
        ));
    }
    if volume(&mesh.points, &mesh.surface) < 0.0 {
        mesh.surface.iter_mut().for_each(|t| t.swap(1, 2));
        turned = mesh.surface.len() - turned;
    }
    Ok(turned)
}

fn edges(t: &[u32; 3]) -> [[u32; 2]; 3] {
    [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]]
}

/// Volume that a surface encloses, m^3, negative where it looks inward.
fn volume(points: &[[f64; 3]], surface: &[[u32; 3]]) -> f64 {
    let six = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|n| points[n as usize]);
        a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])
    };
    surface.iter().map(six).sum::<f64>() / 6.0
}
