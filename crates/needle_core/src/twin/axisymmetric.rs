//! The half-plane model of a scene with symmetry of revolution: cloud, shape table, solver, contact, and the body that
//! it sweeps.

use crate::instrument::{Contact, NeedlePath};
use crate::mesh::Volumes;
use crate::scene::{Instrument, InstrumentKind, Metres, Scene, Shape};
use mtled::approximation::axisymmetric::{AxisymmetricApproximation, MeridianField};
use mtled::approximation::{ApproximationError, ShapeTable};
use mtled::cloud::{self, Domain, Meridian};
use mtled::solver::Role;

use super::assembly::{Built, Phi, frictional, interpolating, press, roles, settings, solver, surfaces};
use super::body::Layout;
use super::moved::{self, Moved};
use super::revolve::{Revolved, sectors};
use super::tissue::{Cells, Fields, Tissue};
use super::{BuildError, regions};

/// Builds the model. `made_for`: the scene of the cloud, which is moved from there.
///
/// # Errors
/// [`BuildError`] if the half plane can't be discretised.
pub(super) fn build(scene: &Scene, made_for: &Scene, moved: Option<&Moved>) -> Result<Built, BuildError> {
    let (Shape::Cylinder { diameter, height }, Some(grading)) = (&scene.sample.shape, &scene.grading()) else {
        return Err(BuildError::Unsupported {
            key: "discretisation.dimension",
            reason: "only a cylinder with a spacing has a half plane; use \"full\" or \"auto\"",
        });
    };
    let domain = Domain::Cylinder { radius: 0.5 * diameter.get(), height: height.get() };
    let mut layout = Layout::in_half_plane(made_for, &domain, grading);
    let mut plane = cloud::meridian::meridian(&domain, &layout.spacing).map_err(cloud_error)?;
    let held = scene
        .instrument
        .as_ref()
        .map_or_else(Vec::new, |i| Contact::nodes(&plane.points, &plane.faces, height.get(), i));
    let region = regions::of_cells(made_for, height.get(), &plane.points, &plane.triangles, &Volumes::default());
    let material = regions::materials(scene, &region);
    let mut roles = roles(scene, &plane.faces, &held);
    let mut approximation = approximation(scene, &plane, &held, &roles);
    if !material.is_empty() {
        approximation = approximation.with_regions(&material);
    }
    let targets = scene.targets.iter().map(|t| moved::back(moved, in_half_plane(t.position)));
    let targets: Vec<[f64; 3]> = targets.collect();
    let table = approximation.repaired_table(&[&plane.points[..], &targets].concat())?;
    let mut table = approximation.pruned(table, scene.discretisation.points_per_support_node);
    let fields = [approximation.field(&plane.points)?, approximation.field(&targets)?];
    let fitted = moved.map(|moved| {
        moved.stretch(&mut table, &plane.points, &plane.triangles);
        layout.reach = height.get() - moved.height(height.get() - layout.reach);
        let places = moved.places(&plane.points);
        std::mem::replace(&mut plane.points, places)
    });
    let places = [fitted.as_deref().unwrap_or(&plane.points), &plane.points];
    let cells: Vec<[u32; 4]> = plane.triangles.iter().map(|&[a, b, c]| [a, b, c, c]).collect();
    let phi = |at: &[[f64; 3]]| -> Result<Vec<(u32, f64)>, ApproximationError> {
        let at: Vec<[f64; 3]> = at.iter().map(|p| moved::back(moved, *p)).collect();
        let field = approximation.field(&at)?;
        Ok(field.nodes.into_iter().zip(field.value.iter().map(|of_z| of_z[1])).collect())
    };
    let contact = |i| contact(scene, i, &plane, &held, (&layout, &table), &phi);
    let mut contact = scene.instrument.as_ref().map(contact).transpose()?;
    regions::hold_rigid(scene, &plane.triangles, &material, &mut roles);
    let surfaces = surfaces(scene, &plane.points, &plane.faces, [0.0, height.get()]);
    Ok(Built {
        solver: solver(scene, &cells, places, roles, &table, surfaces, &mut contact),
        contact,
        top: height.get(),
        height: height.get(),
        reach: layout.reach,
        warnings: regions::warnings(scene, &region),
        repaired_supports: approximation.repaired_supports(),
        tissue: tissue(scene, &plane, fields, table, sectors(0.5 * diameter.get(), layout.spacing.far), &region)?,
    })
}

/// Where a point is at azimuth zero.
fn in_half_plane([x, y, z]: [f64; 3]) -> [f64; 3] {
    [x.hypot(y), 0.0, z]
}

fn cloud_error(e: cloud::CloudError) -> BuildError {
    BuildError::Cloud(e.to_string())
}

fn approximation(scene: &Scene, plane: &Meridian, held: &[u32], roles: &[Role]) -> AxisymmetricApproximation {
    let interpolating = interpolating(roles, held);
    let approximation =
        AxisymmetricApproximation::new(&plane.points, &plane.triangles, &interpolating, settings(scene));
    match scene.instrument {
        // tissue under the tip of a needle with friction is deformed by its push, and counts
        Some(i) if i.is_frictional() => approximation.with_filled(held),
        Some(i) if matches!(i.kind, InstrumentKind::Needle(_)) => approximation.with_plain(held),
        _ => approximation,
    }
}

fn contact(
    scene: &Scene,
    instrument: &Instrument,
    plane: &Meridian,
    held: &[u32],
    (layout, table): (&Layout, &ShapeTable),
    phi: &Phi,
) -> Result<Contact, BuildError> {
    let InstrumentKind::Needle(needle) = &instrument.kind else {
        return Ok(press(instrument, held));
    };
    let top = scene.sample.shape.height().map_or(0.0, Metres::get);
    let triangle = |p: usize| plane.triangles[table.cell[p] as usize];
    let near = |p: &u32| {
        let corners = triangle(*p as usize).map(|n| plane.points[n as usize]);
        let centre = [0, 2].map(|k| corners.iter().map(|c| c[k]).sum::<f64>() / 3.0);
        centre[0].hypot(centre[1] - top) < 2.0 * needle.capture_radius.get()
    };
    let watched = (0..table.cell.len() as u32).filter(near).collect();
    let corners = (0..table.cell.len()).map(|p| {
        let [a, b, c] = triangle(p);
        ([a, b, c, c], table.volume[p])
    });
    if instrument.is_frictional() {
        return frictional(
            scene,
            needle,
            &plane.points,
            held,
            [top, layout.finest_layer(), layout.reach],
            corners,
            phi,
        );
    }
    let nodes = held.iter().map(|&n| (n, top - plane.points[n as usize][2])).collect();
    let path = NeedlePath::new(nodes, plane.points.len(), *needle, layout.reach, layout.layer(), watched, corners);
    let path = path.revolved();
    Ok(Contact::Needle(Box::new(if layout.is_graded() { path.graded() } else { path })))
}

fn tissue(
    scene: &Scene,
    plane: &Meridian,
    [nodes, targets]: [MeridianField; 2],
    table: ShapeTable,
    sectors: usize,
    region: &[u8],
) -> Result<Tissue, BuildError> {
    let Revolved { points, cells, triangle, surface, first, azimuths } =
        Revolved::new(plane, sectors).map_err(cloud_error)?;
    let azimuth = |p: [f64; 3]| match p[0].hypot(p[1]) {
        0.0 => [1.0, 0.0],
        r => [p[0] / r, p[1] / r],
    };
    Ok(Tissue {
        points,
        cells,
        region: if scene.regions.is_empty() {
            Vec::new()
        } else {
            triangle.iter().map(|&t| region[t as usize]).collect()
        },
        surface,
        model: Cells {
            nodes: plane.points.len(),
            triangles: Some(plane.triangles.clone()),
            of_point: table.cell,
            volume: table.volume,
        },
        fields: Fields::Revolved {
            nodes,
            targets,
            first,
            azimuths,
            target_azimuths: scene.targets.iter().map(|t| azimuth(t.position)).collect(),
        },
    })
}
