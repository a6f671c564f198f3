//! The body of what a mesh outlines: the mesh gives its shape and its groups, and the twin's own cloud fills it.

use crate::mesh::Volumes;
use crate::scene::{Grading, MeshFile, RegionShape, Scene};
use mtled::cloud::{Cloud, Domain, Outline};

use super::body::{Body, Layout, filled};
use super::mesh_frame::{oddities, with_oddities};
use super::{BuildError, mesh};

/// Reads the mesh, fills it and looks for the contact.
pub(super) fn body(scene: &Scene, file: &MeshFile, grading: &Grading) -> Result<Body, BuildError> {
    let (cloud, volumes, mut warnings) = mesh::read(scene, file)?;
    let odd = oddities(scene, file, &cloud)?;
    warnings.extend(odd.iter().cloned());
    fill(scene, grading, cloud, volumes, warnings).map_err(|error| with_oddities(error, &odd))
}

fn fill(
    scene: &Scene,
    grading: &Grading,
    mut mesh: Cloud,
    volumes: Volumes,
    warnings: Vec<String>,
) -> Result<Body, BuildError> {
    if !mesh.cells.is_empty() {
        mesh::targets(scene, &mesh)?;
    }
    let [lowest, highest] = mesh::heights(&mesh);
    let top = scene.instrument.as_ref().map_or(Ok(highest), |i| mesh::top(&mesh, i))?;
    mesh.points.iter_mut().for_each(|p| p[2] -= lowest);
    let outline = Outline::new(&mesh, groups(scene, &volumes), top - lowest);
    if mesh.cells.is_empty() {
        within(scene, &outline, lowest)?;
    }
    let domain = Domain::Outline(&outline);
    let layout = Layout::new(&lowered(scene, lowest), &domain, grading);
    let mut cloud = filled(scene, &domain, &layout.spacing)?;
    let size = [cloud.points.len(), cloud.cells.len()].map(|n| n as f64);
    mesh::fits(scene, size, "discretisation.spacing_m", "use a larger spacing")?;
    let volumes = Volumes { of_cell: of_cells(&cloud, &outline, &volumes), ..volumes };
    cloud.points.iter_mut().for_each(|p| p[2] += lowest);
    let mut body = Body {
        top,
        height: top - lowest,
        reach: layout.reach,
        held: Vec::new(),
        layer: layout.layer(),
        graded: layout.is_graded(),
        mirror: None,
        cloud,
        volumes,
        warnings,
    };
    if let Some(instrument) = &scene.instrument {
        mesh::hold(&mut body, instrument)?;
    }
    mesh::deep_enough(scene, body)
}

/// Every target lies inside a surface.
fn within(scene: &Scene, outline: &Outline, lowest: f64) -> Result<(), BuildError> {
    for (i, target) in scene.targets.iter().enumerate() {
        let [x, y, z] = target.position;
        if outline.cell_at([x, y, z - lowest]).is_none() {
            let reason =
                format!("target \"{}\" at {:?} m lies outside the surface of the mesh", target.name, target.position);
            return mesh::refuse(&format!("targets.{i}.position_m"), reason);
        }
    }
    Ok(())
}

/// Number of each cell's region: groups of one material have no interface that matters.
fn groups(scene: &Scene, volumes: &Volumes) -> Vec<u32> {
    let first = |volume: u32| {
        let of =
            |r: &crate::scene::Region| matches!(&r.shape, RegionShape::Group { group } if volumes.is_in(volume, group));
        scene.regions.iter().position(of).map_or(0, |i| i as u32 + 1)
    };
    let number: Vec<u32> = (0..volumes.sets.len() as u32).map(first).collect();
    let one = |g: &Option<u32>| g.map_or(0, |g| number[g as usize]);
    volumes.of_cell.iter().map(one).collect()
}

/// The scene with its regions in a frame whose z is less by so much.
fn lowered(scene: &Scene, by: f64) -> Scene {
    let mut scene = scene.clone();
    for region in &mut scene.regions {
        match &mut region.shape {
            RegionShape::Sphere { centre, .. }
            | RegionShape::Cylinder { centre, .. }
            | RegionShape::Box { centre, .. } => {
                centre[2] -= by;
            }
            RegionShape::Layer { .. } | RegionShape::Group { .. } => {}
        }
    }
    scene
}

/// Volume of each of the cloud's cells: that of the mesh at its middle.
fn of_cells(cloud: &Cloud, outline: &Outline, volumes: &Volumes) -> Vec<Option<u32>> {
    let group = |c: &[u32; 4]| {
        let p = c.map(|n| cloud.points[n as usize]);
        let middle: [f64; 3] = std::array::from_fn(|k| p.iter().map(|q| q[k]).sum::<f64>() / 4.0);
        // a flat cell under a hollow of the surface may have its middle outside
        let towards = |q: &[f64; 3]| std::array::from_fn(|k| 0.5 * (middle[k] + q[k]));
        let mut places = std::iter::once(middle).chain(p.iter().map(towards));
        places.find_map(|p| outline.cell_at(p)).and_then(|cell| volumes.of_cell.get(cell as usize).copied().flatten())
    };
    cloud.cells.iter().map(group).collect()
}
