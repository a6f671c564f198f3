//! From scene to twin: cloud, shape table, solver, contact. Done once.

use crate::approximation::table::Approximation;
use crate::approximation::{ApproximationError, Basis, Settings, ShapeTable};
use crate::cloud::{self, Axis, BASE, Cloud, Domain, Feature, Spacing};
use crate::instrument::{Bonded, Contact, NeedlePath};
use crate::scene::{Dimension, Instrument, InstrumentKind, Method, Scene, Shape};
use crate::solver::{Role, Solver, SolverSettings};

use super::pace::Pace;
use super::{BuildError, Phase, Twin};

/// The needle's path in the cloud ends this far below the deepest pose, in capture radii.
const PATH_MARGIN: f64 = 1.0;
/// Spacing along a needle's path over the capture radius: the effective radius equals the capture radius only where
/// the cloud resolves it.
const PATH_SPACING: f64 = 0.5;
/// A contact ring has at least this many nodes along its radius's worth of arc.
const RING_SPACING: f64 = 0.15;

impl Twin {
    /// Builds cloud, shape functions and masses for a scene, on as many threads as the present rayon pool has.
    ///
    /// # Errors
    /// [`BuildError`] if the scene can't be discretised.
    pub fn new(scene: &Scene) -> Result<Self, BuildError> {
        if scene.discretisation.dimension == Dimension::Axisymmetric {
            return Err(BuildError::Unsupported {
                key: "discretisation.dimension",
                reason: "\"axisymmetric\" is not built yet; use \"full\" or \"auto\"",
            });
        }
        let (cloud, reach) = make_cloud(scene)?;
        let top = scene.sample.shape.height().get();
        let held = scene.instrument.as_ref().map_or_else(Vec::new, |i| Contact::nodes(&cloud.points, top, i));
        let mut interpolating: Vec<bool> = cloud.faces.iter().map(|f| f & BASE != 0).collect();
        held.iter().for_each(|&n| interpolating[n as usize] = true);
        let approximation = Approximation::new(&cloud.points, &cloud.cells, interpolating, settings(scene));
        let table = approximation.table()?;
        let targets: Vec<[f64; 3]> = scene.targets.iter().map(|t| t.position).collect();
        let contact = scene.instrument.as_ref().map(|i| make_contact(i, &held, &cloud, top, &table));
        let solver = make_solver(scene, &cloud, &held, &table);
        let pace = Pace::new(scene);
        Ok(Self {
            node_field: approximation.field(&cloud.points)?,
            target_field: approximation.field(&targets)?,
            scene: scene.clone(),
            points: cloud.points,
            cells: cloud.cells,
            surface: cloud.surface,
            cell_of_point: table.cell,
            solver,
            contact,
            reach,
            pace,
            steps_since_save: 0,
            steps: 0,
            tip: [0.0; 3],
            shaft: [0.0; 2],
            phase: Phase::Approach,
        })
    }
}

impl From<ApproximationError> for BuildError {
    fn from(e: ApproximationError) -> Self {
        Self::Approximation(e.to_string())
    }
}

fn settings(scene: &Scene) -> Settings {
    let d = &scene.discretisation;
    Settings {
        basis: match d.method {
            Method::Mmls => Some(Basis::Quadratic { penalty: d.penalty }),
            Method::Mls => Some(Basis::Linear),
            Method::Tet4 => None,
        },
        support_factor: d.support_factor,
        points_per_cell: d.points_per_cell,
    }
}

/// The cloud, and the deepest pose that it can take.
fn make_cloud(scene: &Scene) -> Result<(Cloud, f64), BuildError> {
    let domain = match scene.sample.shape {
        Shape::Cylinder { diameter, height } => Domain::Cylinder { radius: 0.5 * diameter.get(), height: height.get() },
        Shape::Box { size_x, size_y, height } => Domain::Box { size: [size_x.get(), size_y.get(), height.get()] },
    };
    let d = &scene.discretisation;
    let far = d.spacing.get().min(domain.half_thickness());
    let edge = far * d.edge_refinement;
    let height = domain.height();
    let mut reach = height;
    let mut features = Vec::new();
    if let Some(instrument) = &scene.instrument {
        let centre = instrument.entry.map(|m| m.get());
        let axis = Axis { entry: centre, slope: instrument.slope() };
        match &instrument.kind {
            InstrumentKind::Plate => {
                features.extend([true, false].map(|top| Feature::Rim { top, spacing: edge }));
            }
            InstrumentKind::Indenter { diameter } => {
                let radius = 0.5 * diameter.get();
                features.push(Feature::ContactRing { centre, radius, spacing: edge.min(RING_SPACING * radius) });
            }
            InstrumentKind::Needle(needle) => {
                let capture_radius = needle.capture_radius.get();
                let spacing = far.min(PATH_SPACING * capture_radius);
                let floor = height * axis.secant() - 2.0 * spacing;
                let deepest = scene.motion.as_ref().map_or(floor, |m| m.depth.get());
                let length = (deepest + PATH_MARGIN * capture_radius).min(floor).max(spacing);
                reach = length;
                features.push(Feature::Path { axis, capture_radius, length, spacing });
            }
        }
    }
    let spacing = Spacing { far, growth: d.growth, features };
    let cloud = cloud::generate(&domain, &spacing).map_err(|e| BuildError::Cloud(e.to_string()))?;
    Ok((cloud, reach))
}

fn make_contact(instrument: &Instrument, held: &[u32], cloud: &Cloud, top: f64, table: &ShapeTable) -> Contact {
    match &instrument.kind {
        InstrumentKind::Plate | InstrumentKind::Indenter { .. } => Contact::Bonded(Bonded::new(held.to_vec())),
        InstrumentKind::Needle(needle) => {
            let layer = layer_distance(held, cloud, top);
            let [x, y] = instrument.entry.map(|m| m.get());
            let corners = || table.cell.iter().map(|&c| cloud.cells[c as usize]);
            let near = |c: &[u32; 4]| {
                let p = c.map(|n| cloud.points[n as usize]);
                let centre: [f64; 3] = std::array::from_fn(|k| p.iter().map(|q| q[k]).sum::<f64>() / 4.0);
                (centre[0] - x).hypot(centre[1] - y).hypot(centre[2] - top) < 2.0 * needle.capture_radius.get()
            };
            let watched =
                (0..table.cell.len() as u32).filter(|&p| near(&cloud.cells[table.cell[p as usize] as usize])).collect();
            Contact::Needle(Box::new(NeedlePath::new(held, &cloud.points, top, *needle, layer, watched, corners())))
        }
    }
}

/// Distance between the path's layers of nodes.
fn layer_distance(held: &[u32], cloud: &Cloud, top: f64) -> f64 {
    let mut depths: Vec<f64> = held.iter().map(|&n| top - cloud.points[n as usize][2]).collect();
    depths.sort_by(f64::total_cmp);
    let deepest = depths.last().copied().unwrap_or(0.0);
    depths.dedup_by(|a, b| (*a - *b).abs() < 1e-6 * top);
    deepest / (depths.len().max(2) - 1) as f64
}

fn make_solver(scene: &Scene, cloud: &Cloud, held: &[u32], table: &ShapeTable) -> Solver {
    let base = |f: &u8| if f & BASE != 0 { Role::Base } else { Role::Free };
    let mut role: Vec<Role> = cloud.faces.iter().map(base).collect();
    let bonded = scene.instrument.as_ref().is_some_and(|i| !matches!(i.kind, InstrumentKind::Needle(_)));
    if bonded {
        held.iter().for_each(|&n| role[n as usize] = Role::Instrument);
    }
    let d = &scene.discretisation;
    Solver::new(
        table,
        &cloud.cells,
        &cloud.points,
        role,
        &SolverSettings {
            law: scene.material.law(),
            volume_ratio: d.volume_ratio,
            precision: d.precision,
            step_factor: scene.stepping.step_factor,
            threads: rayon::current_num_threads(),
        },
    )
}
