//! The body of a mesh file: does it fit the scene, and where does the instrument meet it?

use std::collections::BTreeSet;
use std::f64::consts::PI;
use std::path::Path;

use crate::instrument::Contact;
use crate::mesh::Volumes;
use crate::scene::size::MEMORY_LIMIT;
use crate::scene::{Base, Cells, Instrument, InstrumentKind, MeshFile, RegionShape, Scene, Shape};
use mtled::approximation::table::tetrahedron;
use mtled::cloud::{Axis, BASE, Cloud, TOP};

use super::body::Body;
use super::mesh_frame::{extents, oddities, shown, with_oddities};
use super::{BuildError, along};

/// Least number of nodes under a plate or indenter.
const LEAST_HELD: usize = 6;
/// Share of the indenter's face that triangles of held nodes must cover.
const LEAST_COVER: f64 = 0.75;
/// Largest height of the held surface over its width: a bond moves it as one rigid piece, which is right for a nearly flat one.
const MOST_RELIEF: f64 = 0.1;
/// Largest height of a flat base over that of the body.
const FLAT: f64 = 1e-6;
/// Layers of nodes below a needle's deepest pose.
const LAYERS_BELOW: f64 = 2.0;

/// Reads the mesh and looks for the contact.
pub(super) fn body(scene: &Scene, file: &MeshFile) -> Result<Body, BuildError> {
    let (cloud, volumes, mut warnings) = read(scene, file)?;
    let odd = oddities(scene, file, &cloud)?;
    warnings.extend(odd.iter().cloned());
    found(scene, cloud, volumes, warnings).map_err(|error| with_oddities(error, &odd))
}

/// Looks for the contact in what was read.
fn found(scene: &Scene, cloud: Cloud, volumes: Volumes, warnings: Vec<String>) -> Result<Body, BuildError> {
    fits(scene, [cloud.points.len(), cloud.cells.len()].map(|n| n as f64), "sample.mesh", "use a coarser mesh")?;
    targets(scene, &cloud)?;
    let [lowest, highest] = heights(&cloud);
    let mut body = Body {
        top: highest,
        height: highest - lowest,
        reach: highest - lowest,
        held: Vec::new(),
        layer: 0.0,
        graded: false,
        mirror: None,
        cloud,
        volumes,
        warnings,
    };
    if let Some(instrument) = &scene.instrument {
        body.top = top(&body.cloud, instrument)?;
        body.height = body.top - lowest;
        body.reach = body.height;
        hold(&mut body, instrument)?;
        if let InstrumentKind::Needle(needle) = &instrument.kind {
            path(&mut body, needle.capture_radius.get())?;
            body.reach *= Axis { entry: [0.0; 2], slope: instrument.slope() }.secant();
        }
    }
    deep_enough(scene, body)
}

/// Finds what the instrument can hold.
pub(super) fn hold(body: &mut Body, instrument: &Instrument) -> Result<(), BuildError> {
    body.held = Contact::nodes(&body.cloud.points, &body.cloud.faces, body.top, instrument);
    match instrument.kind {
        InstrumentKind::Needle(_) => Ok(()),
        _ => bond(body, instrument),
    }
}

/// z of the lowest and the highest node, m.
pub(super) fn heights(cloud: &Cloud) -> [f64; 2] {
    let z = || cloud.points.iter().map(|p| p[2]);
    [z().fold(f64::INFINITY, f64::min), z().fold(f64::NEG_INFINITY, f64::max)]
}

/// Does a model of so many nodes and cells fit into memory?
pub(super) fn fits(scene: &Scene, [nodes, cells]: [f64; 2], key: &str, remedy: &str) -> Result<(), BuildError> {
    let size = scene.estimate_of(nodes, cells);
    if size.bytes <= MEMORY_LIMIT {
        return Ok(());
    }
    let (bytes, most) = (size.bytes / 1e9, MEMORY_LIMIT / 1e9);
    refuse(
        key,
        format!(
            "{nodes:.0} nodes and {cells:.0} cells take about {bytes:.1} GB, more than the {most} GB allowed: {remedy}"
        ),
    )
}

/// Reads a mesh, and looks whether it has what the scene needs.
pub(super) fn read(scene: &Scene, file: &MeshFile) -> Result<(Cloud, Volumes, Vec<String>), BuildError> {
    let contact = scene.instrument.is_some().then_some(file.contact_group.as_str());
    let wanted = crate::mesh::Wanted { unit_m: file.unit_m, base: &file.base_group, contact };
    let (cloud, volumes, warnings) = crate::mesh::load_with_volumes(Path::new(&file.path), &wanted)
        .map_err(|e| BuildError::Mesh { key: "sample.mesh".to_owned(), reason: e.to_string() })?;
    groups(scene, &volumes)?;
    let own = matches!(scene.sample.shape, Shape::Mesh(_));
    if own && cloud.cells.is_empty() {
        let reason = "a surface alone has no tetrahedra for nodes: \"outline\" fills it with the twin's own (with discretisation.spacing_m), or \
                      mesh it in 3 dimensions (Gmsh leaves out what is in no physical group: name a physical volume as well)";
        return refuse("sample.shape", reason.to_owned());
    }
    if own && scene.discretisation.cells != Cells::Tetrahedra && cloud.hexahedra.is_empty() {
        let reason = "the mesh has no hexahedra: mesh with hexahedra, or leave the key out".to_owned();
        return refuse("discretisation.cells", reason);
    }
    base(scene, &cloud, heights(&cloud))?;
    Ok((cloud, volumes, warnings))
}

/// Is the motion no deeper than the body takes?
pub(super) fn deep_enough(scene: &Scene, mut body: Body) -> Result<Body, BuildError> {
    body.warnings.extend(along::meets_rigid(scene, &body));
    match &scene.motion {
        Some(motion) if motion.depth.get() >= body.reach => refuse(
            "motion.depth_m",
            format!(
                "{} m is too deep: the mesh, {}, takes less than {:.6} m there",
                motion.depth.get(),
                shown(extents(&body.cloud)),
                body.reach
            ),
        ),
        _ => Ok(body),
    }
}

/// Has every region its group, and every volume a region? What is in none is of `[material]`, if that is one part.
fn groups(scene: &Scene, volumes: &Volumes) -> Result<(), BuildError> {
    let listed = || volumes.names.join(", ");
    let mut named = Vec::new();
    for region in &scene.regions {
        let RegionShape::Group { group } = &region.shape else { continue };
        if !volumes.names.contains(group) {
            let key = format!("regions.{}.group", region.name);
            let has = if volumes.names.is_empty() { "none (only .msh files carry them)".to_owned() } else { listed() };
            return refuse(&key, format!("the mesh has no volume group \"{group}\"; it has {has}"));
        }
        named.push(group);
    }
    let open = |set: &&Vec<u32>| set.iter().all(|&g| !named.contains(&&volumes.names[g as usize]));
    let parts: BTreeSet<&Vec<u32>> = volumes.sets.iter().filter(open).filter(|set| !set.is_empty()).collect();
    if parts.len() < 2 {
        return Ok(());
    }
    // what all of them are in tells none apart
    let tells = |g: &&u32| parts.iter().any(|set| !set.contains(g));
    let rest: BTreeSet<u32> = parts.iter().flat_map(|set| set.iter()).filter(tells).copied().collect();
    let rest: Vec<&str> = rest.iter().map(|&g| volumes.names[g as usize].as_str()).collect();
    refuse(
        "sample.mesh",
        format!(
            "no material for the volume groups {}: the mesh has {}, and all but one, which is of [material], need a [[regions]] \
             with shape = \"group\", group = \"{}\" and a material",
            rest.join(", "),
            listed(),
            rest[0]
        ),
    )
}

pub(super) fn refuse<T>(key: &str, reason: String) -> Result<T, BuildError> {
    Err(BuildError::Mesh { key: key.to_owned(), reason })
}

/// Does the body stand on a table, if its base is not bonded?
fn base(scene: &Scene, cloud: &Cloud, [lowest, highest]: [f64; 2]) -> Result<(), BuildError> {
    let on_base = cloud.points.iter().zip(&cloud.faces).filter(|(_, face)| **face & BASE != 0);
    let relief = on_base.map(|(p, _)| p[2] - lowest).fold(0.0, f64::max);
    if scene.sample.base == Base::Bonded || relief <= FLAT * (highest - lowest) {
        return Ok(());
    }
    refuse(
        "sample.base",
        format!(
            "the mesh's base (sample.base_group) is {relief:.6} m high, and only a flat one can slide on a table: turn the \
             mesh so that its base is horizontal, or take \"bonded\""
        ),
    )
}

/// Triangles of the contact surface, by their corners.
fn contact_surface(cloud: &Cloud) -> impl Iterator<Item = (&[u32; 3], [[f64; 3]; 3])> {
    let marked = cloud.surface.iter().zip(&cloud.surface_faces).filter(|(_, face)| **face == TOP);
    marked.map(|(t, _)| (t, t.map(|n| cloud.points[n as usize])))
}

/// Twice the area of a triangle seen from above; negative if it faces down.
fn seen_from_above(p: &[[f64; 3]; 3]) -> f64 {
    let [a, b, c] = p;
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// z of the contact surface where the instrument's axis meets it first; its highest point for a plate.
pub(super) fn top(cloud: &Cloud, instrument: &Instrument) -> Result<f64, BuildError> {
    let [x, y] = instrument.entry.map(|m| m.get());
    let at_axis = |p: &[[f64; 3]; 3]| {
        let whole = seen_from_above(p);
        let share = |k: usize| {
            let mut q = *p;
            q[k] = [x, y, 0.0];
            seen_from_above(&q) / whole
        };
        let shares: [f64; 3] = std::array::from_fn(share);
        let inside = whole > 0.0 && shares.iter().all(|s| *s >= -1e-9);
        inside.then(|| (0..3).map(|k| shares[k] * p[k][2]).sum::<f64>())
    };
    let z = match instrument.kind {
        InstrumentKind::Plate => contact_surface(cloud).flat_map(|(_, p)| p.map(|p| p[2])).reduce(f64::max),
        _ => contact_surface(cloud).filter_map(|(_, p)| at_axis(&p)).reduce(f64::max),
    };
    z.map_or_else(
        || {
            let corners = || contact_surface(cloud).flat_map(|(_, p)| p);
            let extent = |k: usize| {
                let [low, high] =
                    [(f64::INFINITY, f64::min as fn(f64, f64) -> f64), (f64::NEG_INFINITY, f64::max)].map(|(from, of)| corners().map(|p| p[k]).fold(from, of));
                format!("from {low:.4} to {high:.4}")
            };
            refuse(
                "instrument.entry_x_m",
                format!(
                    "the instrument's axis at ({x}, {y}) m, instrument.entry_x_m and entry_y_m, doesn't meet the \
                     mesh's contact surface (sample.contact_group) from above, which goes {} m along x and {} m along y",
                    extent(0),
                    extent(1)
                ),
            )
        },
        Ok,
    )
}

/// Can a plate or indenter be bonded to the nodes that it holds?
fn bond(body: &Body, instrument: &Instrument) -> Result<(), BuildError> {
    let Body { cloud, held, .. } = body;
    if held.len() < LEAST_HELD {
        return refuse(
            "sample.mesh",
            format!(
                "the contact surface has only {} nodes under the instrument, at least {LEAST_HELD} are needed: refine \
                 the mesh there",
                held.len()
            ),
        );
    }
    let mut under = vec![false; cloud.points.len()];
    held.iter().for_each(|&n| under[n as usize] = true);
    if let InstrumentKind::Indenter { diameter, .. } = &instrument.kind {
        let held_triangles = contact_surface(cloud).filter(|(t, _)| t.iter().all(|&n| under[n as usize]));
        let area: f64 = held_triangles.map(|(_, p)| 0.5 * seen_from_above(&p)).sum();
        let cover = area / (0.25 * PI * diameter.get().powi(2));
        if cover < LEAST_COVER {
            return refuse(
                "instrument.diameter_m",
                format!(
                    "the nodes under the indenter cover only {:.0}% of its face, at least {:.0}% are needed: keep it \
                     within the contact group (sample.contact_group), refine the mesh there, or embed the face's rim \
                     as a curve",
                    100.0 * cover,
                    100.0 * LEAST_COVER
                ),
            );
        }
    }
    let extent = |k: usize| {
        let along = || held.iter().map(|&n| cloud.points[n as usize][k]);
        along().fold(f64::NEG_INFINITY, f64::max) - along().fold(f64::INFINITY, f64::min)
    };
    let (width, relief) = (extent(0).max(extent(1)), extent(2));
    if relief > MOST_RELIEF * width {
        return refuse(
            "sample.contact_group",
            format!(
                "the surface under the instrument is {relief:.6} m high over a width of {width:.6} m; at most {MOST_RELIEF} \
                 of the width is taken, since it moves as one rigid piece: use a smaller instrument, or turn the mesh \
                 so that the surface faces up (+z)"
            ),
        );
    }
    Ok(())
}

/// Is the mesh fine enough along a needle's path, and how far? Depths are vertical, as the needle's.
fn path(body: &mut Body, capture_radius: f64) -> Result<(), BuildError> {
    let Body { cloud, held, top, .. } = &*body;
    let mut depths: Vec<f64> = held.iter().map(|&n| top - cloud.points[n as usize][2]).collect();
    depths.sort_by(f64::total_cmp);
    // the path ends at the first gap
    let end = depths.windows(2).find(|w| w[1] - w[0] > capture_radius).map_or(depths.last(), |w| Some(&w[0]));
    let end = end.copied().unwrap_or(0.0);
    let nodes = depths.iter().filter(|d| **d <= end).count();
    let at_surface = held.iter().filter(|&&n| cloud.faces[n as usize] & TOP != 0).count();
    let layer = (PI * capture_radius.powi(2) * end / nodes.max(1) as f64).cbrt();
    if at_surface < 3 || layer > capture_radius || end <= LAYERS_BELOW * layer {
        return refuse(
            "instrument.capture_radius_m",
            format!(
                "the mesh is too coarse for a needle: {at_surface} nodes of the contact surface and {nodes} down to \
                 {end:.6} m lie within {capture_radius} m of its axis; refine it there to half of that radius, or \
                 capture more"
            ),
        );
    }
    body.layer = layer;
    body.reach = end - LAYERS_BELOW * layer;
    body.held
        .retain(|&n| body.top - body.cloud.points[n as usize][2] <= end && body.cloud.faces[n as usize] & BASE == 0);
    Ok(())
}

/// Every target lies in a cell.
pub(super) fn targets(scene: &Scene, cloud: &Cloud) -> Result<(), BuildError> {
    for (i, target) in scene.targets.iter().enumerate() {
        let holds = |c: &[u32; 4]| {
            let p = c.map(|n| cloud.points[n as usize]);
            let (_, gradients) = tetrahedron(&p);
            let from = |a: usize| (0..3).map(|k| gradients[a][k] * (target.position[k] - p[a][k])).sum::<f64>();
            (0..4).all(|a| 1.0 + from(a) >= -1e-9)
        };
        if !cloud.cells.iter().any(holds) {
            return refuse(
                &format!("targets.{i}.position_m"),
                format!("target \"{}\" at {:?} m lies in no cell of the mesh", target.name, target.position),
            );
        }
    }
    Ok(())
}
