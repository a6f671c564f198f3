//! From scene to twin: cloud, shape table, solver, contact. Done once.

use std::sync::Arc;

use crate::instrument::{Contact, Frictional, NeedlePath, Press, Resistance, Shaft, start_and_slow, surface};
use crate::scene::{Base, Dimension, Instrument, InstrumentKind, Method, Needle, Region, Scene};
use mtled::approximation::table::Approximation;
use mtled::approximation::{ApproximationError, Basis, Settings, ShapeTable};
use mtled::cloud::{Axis, BASE, Cloud, Reflected, TOP};
use mtled::mirror::Mirror;
use mtled::solver::{Model, Role, Solver, SolverSettings, Surface};

use super::moved::{self, Moved};
use super::pace::Pace;
use super::recover::Saved;
use super::tissue::{Cells, Fields, Tissue};
use super::work::Counters;
use super::{Along, Body, BuildError, Fixed, Progress, Twin, axisymmetric, hexahedra, regions};

/// What a model brings to the twin.
pub(super) struct Built {
    pub solver: Solver,
    pub contact: Option<Contact>,
    pub tissue: Tissue,
    /// z of the undeformed surface where the instrument meets it, m.
    pub top: f64,
    /// Height of the body under that, m.
    pub height: f64,
    /// Deepest pose that the cloud can take, m.
    pub reach: f64,
    pub warnings: Vec<String>,
    /// Nodes whose support was enlarged.
    pub repaired_supports: usize,
}

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
            recovered: super::Recovered::new(&fixed),
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
        let at: Vec<[f64; 3]> = at.iter().map(|p| moved::back(moved, *p)).collect();
        let field = approximation.field(&at)?;
        Ok(field.nodes.into_iter().zip(field.value).collect())
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

pub(super) fn settings(scene: &Scene) -> Settings {
    let d = &scene.discretisation;
    Settings {
        basis: match d.method {
            Method::Mmls => Some(Basis::Quadratic { penalty: d.penalty }),
            Method::Mls => Some(Basis::Linear),
            Method::Tet4 => None,
        },
        support_factor: scene.support_factor(),
        points_per_cell: d.points_per_cell,
        cells_per_point: scene.cells_per_point(),
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

/// The needle's path in a scene's tissue: see [`NeedlePath::in_tissue`].
pub(super) fn in_tissue(path: NeedlePath, scene: &Scene, top: f64) -> NeedlePath {
    if path.is_revolved() {
        return path;
    }
    let [x, y] = scene.instrument.map_or([0.0; 2], |i| i.entry.map(|m| m.get()));
    let near = 0.5 * path.layer();
    let axis = Axis { entry: [x, y], slope: scene.instrument.map_or([0.0; 2], |i| i.slope()) };
    let diameter = scene.instrument.and_then(|i| i.needle_diameter_m()).unwrap_or(0.0);
    let cutting = |depth: f64| {
        let at = axis.section(top, depth, 0.0, 0.0);
        Resistance::of(scene, regions::at(scene, top, at), diameter).cutting
    };
    path.in_tissue(|depth| regions::stiffest(scene, top, [x, y, top - depth], near)).bent(top, cutting)
}

/// Nodes and values of all shape functions at points of the body, of one point after the other.
pub(super) type Phi<'a> = dyn Fn(&[[f64; 3]]) -> Result<Vec<(u32, f64)>, ApproximationError> + 'a;

/// A needle with friction through the layers of its path; `[top, layer, reach]`: z of the top face, distance between layers, length of
/// the path, m; `cells`: corners and volume of each integration point's cell; `phi`: the shape functions.
pub(super) fn frictional(
    scene: &Scene,
    needle: &Needle,
    points: &[[f64; 3]],
    held: &[u32],
    [top, layer, reach]: [f64; 3],
    cells: impl Iterator<Item = ([u32; 4], f64)>,
    phi: &Phi,
) -> Result<Contact, BuildError> {
    const KEY: &str = "instrument.interaction";
    let instrument = scene.instrument.as_ref();
    let axis = Axis { entry: instrument.map_or([0.0; 2], |i| i.entry.map(|m| m.get())), slope: needle.slope() };
    let secant = axis.secant();
    let place = |&n: &u32| (n, secant * (top - points[n as usize][2]), axis.distance(top, points[n as usize]));
    let nodes = held.iter().map(place).filter(|(_, z, _)| *z <= reach * (1.0 + 1e-9)).collect();
    let radius = needle.capture_radius.get();
    let Some(shaft) = Shaft::new(nodes, secant * layer, radius) else {
        return Err(BuildError::Unsupported {
            key: KEY,
            reason: "a frictional needle needs layers of nodes along its path, which a cylinder or a box has and a mesh has not; fill \
                     the mesh (sample.shape = outline), or use kinematic",
        });
    };
    let symmetry = scene.dimension().dimension == Dimension::Axisymmetric;
    let pushes = phi(&shaft.face(&axis, top, symmetry))?;
    let shaft = shaft
        .with_face(&pushes)
        .along(&axis, top, points)
        .in_tissue(scene, needle, &axis, top, |p| regions::at(scene, top, p));
    Ok(Contact::Frictional(Box::new(
        Frictional::new(shaft, start_and_slow(scene), reach, cells).bent(scene, needle, top),
    )))
}

/// What holds each node from the start.
pub(super) fn roles(scene: &Scene, faces: &[u8], held: &[u32]) -> Vec<Role> {
    let touchable = surface::touchable(scene);
    let of = |f: &u8| match f {
        f if f & BASE != 0 && scene.sample.base == Base::Bonded => Role::Base,
        f if f & touchable != 0 => Role::Surface,
        _ => Role::Free,
    };
    let mut role: Vec<Role> = faces.iter().map(of).collect();
    match scene.instrument {
        Some(i) if i.is_bonded() => held.iter().for_each(|&n| role[n as usize] = Role::Instrument),
        // what the tip holds meets no wall
        Some(Instrument { kind: InstrumentKind::Needle(_), .. }) => {
            held.iter().for_each(|&n| role[n as usize] = Role::Free);
        }
        _ => {}
    }
    role
}

/// Nodes whose parameter has to be the field's value: those with a role, and those that a needle may hold.
pub(super) fn interpolating(roles: &[Role], held: &[u32]) -> Vec<bool> {
    let mut interpolating: Vec<bool> = roles.iter().map(|role| *role != Role::Free).collect();
    held.iter().for_each(|&n| interpolating[n as usize] = true);
    interpolating
}

/// A plate or indenter over the nodes of its face.
pub(super) fn press(instrument: &Instrument, face: &[u32]) -> Contact {
    Contact::Press(Press::new(if instrument.is_bonded() { face.to_vec() } else { Vec::new() }))
}

/// The surfaces of instrument and base for a body between two heights, m: its bottom, and its top where the instrument meets it.
pub(super) fn surfaces(
    scene: &Scene,
    points: &[[f64; 3]],
    faces: &[u8],
    [bottom, top]: [f64; 2],
) -> [Option<Surface>; 2] {
    let edge = scene.instrument.map_or(0.0, |i| surface::edge(&i, points, faces));
    [surface::of_instrument(scene, top, edge), surface::of_base(scene, bottom)]
}

/// The solver of a scene's shape table; places of the nodes for which that was fitted, and where they are.
pub(super) fn solver(
    scene: &Scene,
    cells: &[[u32; 4]],
    [fitted, points]: [&[[f64; 3]]; 2],
    role: Vec<Role>,
    table: &ShapeTable,
    [instrument, base]: [Option<Surface>; 2],
    contact: &mut Option<Contact>,
) -> Solver {
    let d = &scene.discretisation;
    let settings = SolverSettings {
        law: scene.material.law(),
        volume_ratio: scene.volume_ratio_in(scene.dimension().dimension).into(),
        precision: d.precision,
        step_factor: scene.stepping.step_factor,
        threads: rayon::current_num_threads(),
    };
    let laws = regions::laws(scene, !table.region.is_empty());
    let model = Model::of_materials(table, cells, fitted, role, &laws, &settings).with_nodes_at(points);
    let model = model.with_surfaces(instrument, base);
    let Some(Contact::Frictional(needle)) = contact else { return Solver::of(Arc::new(model), settings.threads) };
    let mut solver = Solver::of(Arc::new(needle.rod(model)), settings.threads);
    needle.place(&mut solver);
    solver.settle();
    solver
}
