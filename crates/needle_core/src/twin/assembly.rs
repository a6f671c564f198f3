//! What the models of a twin are made of, in the half plane and in space: settings, contact, roles, surfaces, solver.

use std::sync::Arc;

use crate::instrument::{Contact, Frictional, NeedlePath, Press, Resistance, Shaft, start_and_slow, surface};
use crate::scene::{Base, Dimension, Instrument, InstrumentKind, Method, Needle, Scene};
use mtled::approximation::{ApproximationError, Basis, Form, Settings, ShapeTable};
use mtled::cloud::{Axis, BASE};
use mtled::solver::{Model, Role, Solver, SolverSettings, Surface};

use super::tissue::Tissue;
use super::{BuildError, regions};

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

/// How a scene's shape functions are fitted and integrated.
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
    let mirror = scene.mirror();
    let on_plane = mirror.map_or_else(Vec::new, |mirror| mirror.holds(points));
    let share = |n: u32| if on_plane.get(n as usize) == Some(&true) { 0.5 } else { 1.0 };
    let Some(shaft) = Shaft::new(nodes, secant * layer, radius, share) else {
        return Err(BuildError::Unsupported {
            key: KEY,
            reason: "a frictional needle needs layers of nodes along its path, which a cylinder or a box has and a mesh has not; fill \
                     the mesh (sample.shape = outline), or use kinematic",
        });
    };
    let symmetry = scene.dimension().dimension == Dimension::Axisymmetric;
    let pushes = phi(&shaft.face(&axis, top, symmetry))?;
    let shaft =
        shaft
            .mirrored(mirror)
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
    let model = needle.rod(model);
    let model = if table.form == Form::Axisymmetric { model.with_slow_modes() } else { model };
    let mut solver = Solver::of(Arc::new(model), settings.threads);
    needle.place(&mut solver);
    solver.settle();
    solver
}
