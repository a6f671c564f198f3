//! From scene to twin: cloud, shape table, solver, contact. Done once.

use std::sync::Arc;

use crate::instrument::{Contact, NeedlePath};
use crate::scene::{Dimension, Instrument, InstrumentKind, Metres, Region, Scene, Shape};
use mtled::approximation::table::Approximation;
use mtled::approximation::{ApproximationError, ShapeTable};
use mtled::cloud::{Cloud, Domain, Reflected, TOP};
use mtled::mirror::Mirror;
use mtled::solver::Role;

use super::assembly::{Built, Phi, frictional, in_tissue, interpolating, press, roles, settings, solver, surfaces};
use super::moved::{self, Moved};
use super::pace::Pace;
use super::saved::Saved;
use super::tissue::{Cells, Fields, Tissue};
use super::work::Counters;
use super::{Along, Body, BuildError, Fixed, Progress, Twin, axisymmetric, body, hexahedra, mesh, outline, regions};

impl Twin {
    /// Builds cloud, shape functions and masses for a scene, on as many threads as the present rayon pool has.
    ///
    /// # Errors
    /// [`BuildError`] if the scene can't be discretised.
    pub fn new(scene: &Scene) -> Result<Self, BuildError> {
        Self::built(scene, None)
    }

    /// The same on the cloud that the scene has with other regions, its nodes moved with the interfaces, so that the force is a smooth
    /// function of the layers' depths; on its own cloud where that can't be ([`Twin::stretch_from`]).
    ///
    /// # Errors
    /// [`BuildError`] if the scene can't be discretised.
    pub fn on_cloud_of(scene: &Scene, regions: &[Region]) -> Result<Self, BuildError> {
        Self::built(scene, Moved::new(scene, regions).map(|moved| (moved, regions)))
    }

    /// How many times as thick, or as thin, a layer is at most as with other regions, if the nodes of the cloud for those can be moved to
    /// the scene's own; `None` where they can't: all of both have to be layers in a cylinder or box, of the same materials from top to
    /// base, and none more than twice as thick or thin.
    #[must_use]
    pub fn stretch_from(scene: &Scene, regions: &[Region]) -> Option<f64> {
        Moved::new(scene, regions).map(|moved| moved.most())
    }

    fn built(scene: &Scene, moved: Option<(Moved, &[Region])>) -> Result<Self, BuildError> {
        if let Some(reason) = scene.correction.as_ref().and_then(|c| c.of_another_mesh(&scene.sample)) {
            return Err(BuildError::Mesh { key: "correction.mesh".to_owned(), reason });
        }
        let mut dimension = scene.dimension();
        dimension.because += &scene.left_out();
        dimension.because += &super::correction::told(scene);
        let made_for = moved.as_ref().map(|(_, regions)| Scene { regions: regions.to_vec(), ..scene.clone() });
        let (made_for, moved) = (made_for.as_ref().unwrap_or(scene), moved.map(|(moved, _)| moved));
        let Built { solver, contact, tissue, top, height, reach, mut warnings, repaired_supports } =
            match dimension.dimension {
                Dimension::Axisymmetric => axisymmetric::build(scene, made_for, moved.as_ref())?,
                Dimension::Mirrored | Dimension::Full | Dimension::Auto => full(scene, made_for, moved.as_ref())?,
            };
        warnings.extend(contact.as_ref().and_then(|contact| thinner(scene, contact)));
        let of_cloud = warnings.len();
        warnings.extend(scene.advice());
        let pace = Pace::new(scene, height);
        let scene = scene.clone();
        let along = Along::of(&scene, &tissue, top);
        warnings.extend(contact.iter().flat_map(|contact| along.missed(&scene, contact)));
        let mirror = scene.mirror();
        let tissue = Arc::new(tissue);
        let fixed = Fixed {
            scene,
            along,
            dimension,
            mirror,
            tissue,
            top,
            height,
            reach,
            warnings,
            of_cloud,
            repaired_supports,
        };
        let mut twin = Self {
            folds: super::Folds::new(&fixed.tissue),
            recovered: super::Recovered::new(&fixed.scene, &fixed.tissue, fixed.top),
            fixed: Arc::new(fixed),
            solver,
            saved: Saved::new(contact.clone()),
            contact,
            progress: Progress::new(pace),
            counters: Counters::default(),
            happened: super::Happened::default(),
        };
        twin.begin();
        Ok(twin)
    }
}

impl Body {
    /// Generates the scene's cloud, or reads its mesh file.
    ///
    /// # Errors
    /// [`BuildError`] if the cloud can't be made, or the mesh doesn't fit the scene.
    pub fn new(scene: &Scene) -> Result<Self, BuildError> {
        let grading = scene.grading();
        let (domain, grading) = match (&scene.sample.shape, &grading) {
            (Shape::Mesh(file), _) => return mesh::body(scene, file),
            (Shape::Outline(file), Some(grading)) => return outline::body(scene, file, grading),
            (_, None) => {
                return Err(BuildError::Unsupported {
                    key: "discretisation.spacing_m",
                    reason: "a cylinder, box or outline needs a spacing",
                });
            }
            (Shape::Cylinder { diameter, height }, Some(grading)) => {
                (Domain::Cylinder { radius: 0.5 * diameter.get(), height: height.get() }, grading)
            }
            (Shape::Box { size_x, size_y, height }, Some(grading)) => {
                (Domain::Box { size: [*size_x, *size_y, *height].map(Metres::get) }, grading)
            }
        };
        body::generated(scene, &domain, grading)
    }
}

/// Share of the capture radius that the cloud's effective one may miss by.
const THINNER: f64 = 0.15;

/// What to say of a needle that the cloud makes thinner or thicker than was asked for.
fn thinner(scene: &Scene, contact: &Contact) -> Option<String> {
    let made = match contact {
        Contact::Needle(path) => path.effective_radius(),
        Contact::Frictional(needle) => needle.effective_radius(),
        Contact::Press(_) | Contact::Own(_) => return None,
    };
    let InstrumentKind::Needle(needle) = &scene.instrument.as_ref()?.kind else { return None };
    let asked = needle.capture_radius.get();
    ((made / asked - 1.0).abs() > THINNER).then(|| {
        format!(
            "the cloud gives the needle an effective radius of {:.3} mm, and instrument.capture_radius_m asks for {:.3} mm: the force \
             is that of the former. A smaller discretisation.spacing_m comes nearer",
            1e3 * made,
            1e3 * asked
        )
    })
}

/// The model in three dimensions, or in half of them. `made_for`: the scene of the cloud, which is moved from there.
fn full(scene: &Scene, made_for: &Scene, moved: Option<&Moved>) -> Result<Built, BuildError> {
    let mut body = Body::new(made_for)?;
    let (cloud, held) = (&body.cloud, &body.held);
    let mut roles = roles(scene, &cloud.faces, held);
    let interpolating = interpolating(&roles, held);
    let region = body.regions(made_for);
    let material = regions::materials(scene, &region);
    let mut approximation = Approximation::new(&cloud.points, &cloud.cells, interpolating, settings(scene));
    if let Some(mirror) = &body.mirror {
        approximation = approximation.with_mirror(*mirror, &mirror.holds(&cloud.points));
    }
    if !material.is_empty() {
        approximation = approximation.with_regions(&material).with_four_points(&regions::with_four_points(made_for));
    }
    if scene.discretisation.cells.points_per_hexahedron() > 0 {
        let four = regions::with_four_points(made_for);
        let four = |cell: usize| material.get(cell).is_some_and(|&m| four.get(usize::from(m)) == Some(&true));
        approximation = hexahedra::integrated(approximation, scene, cloud, four)?;
    }
    let mut targets: Vec<[f64; 3]> = scene.targets.iter().map(|t| moved::back(moved, t.position)).collect();
    let beyond = to_the_half(&mut targets, body.mirror.as_ref());
    let consistent = scene.is_consistent_in(scene.dimension().dimension);
    let surface = if consistent { approximation.surface_points() } else { Vec::new() };
    let mut table = approximation.repaired_table(&[&cloud.points[..], &targets, &surface].concat())?;
    table = approximation.pruned(table, scene.discretisation.points_per_support_node);
    if consistent {
        let tied: Vec<bool> = roles.iter().map(|role| *role != Role::Free).collect();
        table = approximation.consistent(table, &tied)?;
    }
    let (nodes, targets) = (approximation.field(&cloud.points)?, approximation.field(&targets)?);
    let fitted = moved.map(|moved| {
        moved.stretch(&mut table, &body.cloud.points, &body.cloud.cells);
        body.reach = body.top - moved.height(body.top - body.reach);
        let places = moved.places(&body.cloud.points);
        std::mem::replace(&mut body.cloud.points, places)
    });
    let cloud = &body.cloud;
    let phi = |at: &[[f64; 3]]| -> Result<Vec<(u32, f64)>, ApproximationError> {
        let mut at: Vec<[f64; 3]> = at.iter().map(|p| moved::back(moved, *p)).collect();
        to_the_half(&mut at, body.mirror.as_ref());
        let field = approximation.field(&at)?;
        let own = |n: u32| n.checked_sub(body.cloud.points.len() as u32).unwrap_or(n);
        Ok(field.nodes.into_iter().map(own).zip(field.value).collect())
    };
    let contact = |i| make_contact(scene, i, &body, &table, &phi);
    let mut contact = scene.instrument.as_ref().map(contact).transpose()?;
    regions::hold_rigid(scene, &cloud.cells, &material, &mut roles);
    let surfaces = surfaces(scene, &cloud.points, &cloud.faces, [body.top - body.height, body.top]);
    let places = [fitted.as_deref().unwrap_or(&cloud.points), &cloud.points];
    let solver = solver(scene, &cloud.cells, places, roles, &table, surfaces, &mut contact);
    let (of_point, volume) = cells_and_volumes(table);
    let model = Cells { nodes: cloud.points.len(), triangles: None, of_point, volume };
    let (cloud, fields, region_shown) = match body.mirror {
        None => (body.cloud, Fields::Full { nodes, targets }, region.clone()),
        Some(mirror) => {
            let Reflected { cloud, original } = Reflected::new(body.cloud, &mirror);
            (cloud, Fields::Mirrored { nodes, targets, mirror, original, beyond }, [&region[..], &region[..]].concat())
        }
    };
    let Cloud { points, cells, surface, .. } = cloud;
    Ok(Built {
        solver,
        contact,
        warnings: body.warnings.into_iter().chain(regions::warnings(scene, &region)).collect(),
        tissue: Tissue {
            points,
            cells,
            region: if scene.regions.is_empty() { Vec::new() } else { region_shown },
            surface,
            model,
            fields,
        },
        top: body.top,
        height: body.height,
        reach: body.reach,
        repaired_supports: approximation.repaired_supports(),
    })
}

/// Moves points beyond a plane of symmetry to their images; which those are.
fn to_the_half(points: &mut [[f64; 3]], mirror: Option<&Mirror>) -> Vec<bool> {
    let Some(mirror) = mirror else { return vec![false; points.len()] };
    let beyond: Vec<bool> = points.iter().map(|p| mirror.across(p) < 0.0).collect();
    points.iter_mut().zip(&beyond).filter(|(_, beyond)| **beyond).for_each(|(p, _)| *p = mirror.image(p));
    beyond
}

/// What of a table is kept of each point; the rest, the largest object of all, is dropped before the fields are made.
fn cells_and_volumes(table: ShapeTable) -> (Vec<u32>, Vec<f64>) {
    (table.cell, table.volume)
}

impl From<ApproximationError> for BuildError {
    fn from(e: ApproximationError) -> Self {
        Self::Approximation(e.to_string())
    }
}

fn make_contact(
    scene: &Scene,
    instrument: &Instrument,
    body: &Body,
    table: &ShapeTable,
    phi: &Phi,
) -> Result<Contact, BuildError> {
    let Body { cloud, held, top, reach, layer, .. } = body;
    match &instrument.kind {
        InstrumentKind::Plate | InstrumentKind::Indenter { .. } => Ok(press(instrument, held)),
        InstrumentKind::Needle(needle) if instrument.is_frictional() => {
            let corners = table.cell.iter().map(|&c| cloud.cells[c as usize]);
            let cells = corners.zip(table.volume.iter().copied());
            frictional(scene, needle, &cloud.points, held, [*top, *layer, *reach], cells, phi)
        }
        InstrumentKind::Needle(needle) => {
            let [x, y] = instrument.entry.map(|m| m.get());
            let corners = table.cell.iter().map(|&c| cloud.cells[c as usize]);
            let near = |c: &[u32; 4]| {
                let p = c.map(|n| cloud.points[n as usize]);
                let centre: [f64; 3] = std::array::from_fn(|k| p.iter().map(|q| q[k]).sum::<f64>() / 4.0);
                (centre[0] - x).hypot(centre[1] - y).hypot(centre[2] - top) < 2.0 * needle.capture_radius.get()
            };
            let watched =
                (0..table.cell.len() as u32).filter(|&p| near(&cloud.cells[table.cell[p as usize] as usize])).collect();
            // the whole of the contact surface is at depth zero, curved or not
            let on_top = |n: u32| cloud.faces[n as usize] & TOP != 0;
            let depth = |n: u32| if on_top(n) { 0.0 } else { top - cloud.points[n as usize][2] };
            let nodes = held.iter().map(|&n| (n, depth(n))).collect();
            let cells = corners.zip(table.volume.iter().copied());
            let path = NeedlePath::new(nodes, cloud.points.len(), *needle, *reach, *layer, watched, cells);
            let path = in_tissue(path, scene, *top);
            let path = if body.graded { path.graded() } else { path };
            let path = match body.mirror {
                Some(mirror) => path.mirrored(mirror, &cloud.points),
                None => path,
            };
            Ok(Contact::Needle(Box::new(path)))
        }
    }
}
