//! The body of a scene: its cloud, and where the instrument meets it.

use crate::instrument::{Contact, Resistance, surface};
use crate::mesh::Volumes;
use crate::scene::{Cells, Grading, IndenterTip, Instrument, InstrumentKind, Metres, Scene};
use mtled::cloud::{self, Axis, Cloud, Domain, Feature, MAX_GROWTH, Reflected, Solid, Spacing};
use mtled::mirror::Mirror;

use super::{BuildError, hexahedra, regions};

/// The needle's path in the cloud ends this far below the deepest pose, in capture radii.
const PATH_MARGIN: f64 = 1.0;
/// Largest spacing along a needle's path over the capture radius, that is two rings of nodes round it: the effective radius equals the capture
/// radius only where the cloud resolves it.
const PATH_SPACING: f64 = 0.5;
/// Rings round the upper part of a path that leans, where the tip enters at once. Two can't follow the field at its entry: in every seventh of
/// 48 clouds the force vector was more than 1 % off that of four rings, with three in none (`docs/lab/verification.md`).
const LEANING_RINGS: f64 = 3.0;
/// Down to this depth over the capture radius.
const LEANING_DEPTH: f64 = 10.0;
/// Numbers of rings that differ by less are the same: the digits that a scene writes.
const SAME_RINGS: f64 = 0.01;
/// A contact ring has at least this many nodes along its radius's worth of arc.
const RING_SPACING: f64 = 0.15;
/// Largest spacing under a rounded tip over the radius of the contact: the edge of contact lies between two nodes.
const PATCH_SPACING: f64 = 0.08;
/// Spacing at an edge of contact in a half plane over that in space.
const POINT_REFINEMENT: f64 = 0.5;
/// Spacing at the edge of a flat indenter with a wall over that without one; not below [`WALL_FINEST`] of the radius, nor coarser than
/// without. Tissue that the edge draws along the wall is stretched several times (`docs/lab/contact.md` has what was measured).
const WALL_REFINEMENT: f64 = 0.25;
const WALL_FINEST: f64 = 0.004;
/// Largest growth of the spacing round that edge.
const WALL_GROWTH: f64 = 0.15;
/// Largest spacing along the path of a needle that presses before it enters in a half plane, over the capture radius: of one with a wall, and
/// of one with friction at the membranes that it has to pierce. The edge of its tip is sharp as well.
const PRESSED_PATH_SPACING: f64 = 0.125;
/// Where a needle in a half plane pierces a membrane, and where one that holds the tissue passes from one region into another: the shear on it
/// jumps with the modulus there, and does not where tissue slips. Distance from the axis to which the cloud is finer, and spacing there, over the
/// capture radius.
const AT_BOUNDARY: [f64; 2] = [1.5, PRESSED_PATH_SPACING];
/// Largest spacing on the rest of the path of one that holds the tissue. With the spacing of a boundary on all of it a pose took three times as
/// long, and the force was no better (`docs/lab/interfaces.md`).
const BETWEEN_BOUNDARIES: f64 = 0.25;
/// What lies so far under a boundary, over the capture radius, is the region behind it.
const UNDER_IT: f64 = 1e-3;
/// Growth of the spacing with the distance from there along the path. With 0.4 an inner membrane breaks 50 um too early, with 0.25 and 0.2 35
/// and 10.
const BOUNDARY_GROWTH: f64 = 0.2;

/// Spacing of a needle's path at the surface over that deeper down, in a half plane: over the first millimetres few layers are captured,
/// and each counts.
const ENTRY_SPACING: f64 = 0.6;
/// Largest puncture strain of a surface that gives way at once: the tip is then about 1 um deep.
const AT_ONCE: f64 = 1e-3;
/// Paths that are finer than this over the capture radius are not graded: at their entry the capture window would not get shorter with the
/// layers, whose distance is no even part of it, and the force would have a saw-tooth.
const GRADED_FROM: f64 = 0.3;
/// The cloud beside it is as fine, to this distance from the axis over the capture radius.
const ENTRY_RADIUS: f64 = 1.5;
/// Growth of the spacing with depth: faster, and the capture window, which is two layers long, is too long for the first millimetres.
const ENTRY_GROWTH: f64 = 0.06;

/// Cloud of a scene and what a pose needs to know of it. Lengths in m.
#[derive(Clone, Debug)]
pub struct Body {
    /// Nodes and cells: of the half beside the plane of symmetry, if the scene is modelled by that.
    pub cloud: Cloud,
    /// That plane.
    pub mirror: Option<Mirror>,
    /// z at which the instrument touches the undeformed body: depth zero.
    pub top: f64,
    /// Height of the body under that.
    pub height: f64,
    /// Deepest pose that the cloud can take.
    pub reach: f64,
    /// Nodes that the instrument can hold.
    pub held: Vec<u32>,
    /// Vertical distance between the layers of nodes along a needle's path, 0 without a needle.
    pub layer: f64,
    /// Whether they are closer to each other where the path enters.
    pub graded: bool,
    /// Volume groups of a mesh's cells.
    pub volumes: Volumes,
    /// What is worth knowing about a mesh and is no error.
    pub warnings: Vec<String>,
}

impl Body {
    /// The same with the cloud of the whole body.
    #[must_use]
    pub fn whole(mut self) -> Self {
        if let Some(mirror) = self.mirror.take() {
            self.cloud = Reflected::new(self.cloud, &mirror).cloud;
        }
        self
    }

    /// Region of each cell: 0, or one more than the place in the scene's list.
    #[must_use]
    pub fn regions(&self, scene: &Scene) -> Vec<u8> {
        let mut region = regions::of_cells(scene, self.top, &self.cloud.points, &self.cloud.cells, &self.volumes);
        if scene.discretisation.cells != Cells::Tetrahedra {
            hexahedra::in_one_region(&self.cloud, &mut region);
        }
        region
    }
}

pub(super) fn generated(scene: &Scene, domain: &Domain, grading: &Grading) -> Result<Body, BuildError> {
    let layout = Layout::new(scene, domain, grading);
    let height = domain.height();
    let mirror = scene.mirror();
    let cloud = match &mirror {
        None if scene.is_grid() => hexahedra::grid(domain, &layout.spacing),
        None => filled(scene, domain, &layout.spacing),
        Some(mirror) => half(scene, domain, &layout.spacing, mirror),
    };
    let cloud = cloud?;
    let nodes = |i| Contact::nodes(&cloud.points, &cloud.faces, height, i);
    let held = scene.instrument.as_ref().map_or_else(Vec::new, nodes);
    Ok(Body {
        cloud,
        mirror,
        top: height,
        height,
        reach: layout.reach,
        held,
        layer: layout.layer(),
        graded: layout.is_graded(),
        volumes: Volumes::default(),
        warnings: Vec::new(),
    })
}

/// Tetrahedra, and if the scene asks for them hexahedra where there is room.
pub(super) fn filled(scene: &Scene, domain: &Domain, spacing: &Spacing) -> Result<Cloud, BuildError> {
    let bricks = scene.discretisation.cells != Cells::Tetrahedra;
    if bricks {
        return hexahedra::with_bricks(domain, spacing);
    }
    cloud::generate(domain, spacing).map_err(|e| BuildError::Cloud(e.to_string()))
}

/// The cloud of the half of a body: generated where the plane of symmetry is y = 0, and turned to where it is.
fn half(scene: &Scene, domain: &Domain, spacing: &Spacing, mirror: &Mirror) -> Result<Cloud, BuildError> {
    let within = |[x, y]: [f64; 2]| [mirror.to_own_frame([x, y, 0.0])[0], 0.0];
    let mut own = spacing.clone();
    for feature in &mut own.features {
        match feature {
            Feature::ContactRing { centre, .. } | Feature::Patch { centre, .. } => *centre = within(*centre),
            Feature::Path { axis, .. } | Feature::FinePath { axis, .. } => {
                (axis.entry, axis.slope) = (within(axis.entry), within(axis.slope))
            }
            Feature::Region { solid: Solid::Sphere { centre, .. } | Solid::Cylinder { centre, .. }, .. } => {
                let [x, _] = within([centre[0], centre[1]]);
                *centre = [x, 0.0, centre[2]];
            }
            Feature::Rim { .. } | Feature::Region { .. } => {}
        }
    }
    let domain = match *domain {
        Domain::Box { size: [x, y, z] } if mirror.direction()[0] == 0.0 => Domain::Box { size: [y, x, z] },
        other => other,
    };
    Ok(filled(scene, &domain.half(), &own)?.turned(mirror))
}

/// How the nodes of a generated body lie, in space or in a half plane.
pub(super) struct Layout {
    /// Spacing, with the features that the instrument asks for.
    pub spacing: Spacing,
    /// Deepest pose that such a cloud can take, m.
    pub reach: f64,
}

impl Layout {
    /// Spacing in space.
    pub(crate) fn new(scene: &Scene, domain: &Domain, grading: &Grading) -> Self {
        Self::refined(scene, domain, grading, 1.0)
    }

    /// Spacing in the half plane, where an edge of contact is a point: twice as fine costs next to nothing there.
    pub(crate) fn in_half_plane(scene: &Scene, domain: &Domain, grading: &Grading) -> Self {
        let spacing = Metres(scene.plane_refinement() * grading.spacing.get());
        let mut layout = Self::refined(scene, domain, &Grading { spacing, ..*grading }, POINT_REFINEMENT);
        let wall = surface::has_wall(scene) && !scene.instrument.is_some_and(|i| i.is_frictional());
        if wall {
            layout.spacing.growth = layout.spacing.growth.min(WALL_GROWTH);
            layout.spacing.features.iter_mut().for_each(refine_edge);
        }
        if wall {
            layout.refine_path(PRESSED_PATH_SPACING);
        }
        if !scene.regions.is_empty() && !scene.instrument.is_some_and(|i| i.is_frictional()) {
            layout.refine_path(BETWEEN_BOUNDARIES);
        }
        layout.refine_at_boundaries(scene, domain);
        if scene.regions.is_empty() && scene.instrument.as_ref().is_some_and(enters_at_once) {
            let entry = layout.spacing.features.iter().find_map(entry);
            layout.spacing.features.extend(entry);
        }
        layout
    }

    /// Makes a needle's path finer: its spacing is at most this over the capture radius.
    fn refine_path(&mut self, largest: f64) {
        for feature in &mut self.spacing.features {
            if let Feature::Path { capture_radius, spacing, .. } = feature {
                *spacing = spacing.min(largest * *capture_radius);
            }
        }
    }

    /// Makes a needle's path finer where its tip presses on a membrane, and where one that holds the tissue comes from one region into another.
    fn refine_at_boundaries(&mut self, scene: &Scene, domain: &Domain) {
        let passages = |f: &Feature| match *f {
            Feature::Path { axis, capture_radius, length, .. } => Some((axis, capture_radius, length)),
            _ => None,
        };
        let Some((axis, radius, length)) = self.spacing.features.iter().find_map(passages) else { return };
        let slips = scene.instrument.is_some_and(|i| i.is_frictional());
        let height = domain.height();
        let needs_it = |depth: &f64| {
            let below = axis.section(height, depth + UNDER_IT * radius, 0.0, 0.0);
            let pierced = || Resistance::of(scene, regions::at(scene, height, below), 2.0 * radius).puncture > 0.0;
            if slips { pierced() } else { !scene.regions.is_empty() }
        };
        let [reach, spacing] = AT_BOUNDARY;
        let fine = |depth| Feature::FinePath {
            axis,
            depths: [depth; 2],
            radius: reach * radius,
            spacing: spacing * radius,
            growth: BOUNDARY_GROWTH,
        };
        let depths = self.spacing.passages(domain, &axis, length);
        self.spacing.features.extend(depths.into_iter().filter(needs_it).map(fine));
    }

    /// `point`: spacing at edges of contact over what the scene asks for.
    fn refined(scene: &Scene, domain: &Domain, grading: &Grading, point: f64) -> Self {
        let far = grading.spacing.get().min(domain.half_thickness());
        let edge = far * grading.edge_refinement;
        let mut reach = domain.height();
        let mut features = Vec::new();
        if let Some(instrument) = &scene.instrument {
            let centre = instrument.entry.map(|m| m.get());
            let axis = Axis { entry: centre, slope: instrument.slope() };
            match &instrument.kind {
                // the edge of what a mesh outlines is not known
                InstrumentKind::Plate if matches!(domain, Domain::Outline(_)) => {}
                InstrumentKind::Plate => {
                    features.extend([true, false].map(|top| Feature::Rim { top, spacing: point * edge }));
                }
                InstrumentKind::Indenter { diameter, tip: IndenterTip::Sphere, .. } => {
                    let ball = 0.5 * diameter.get();
                    let depth = scene.motion.as_ref().map_or(ball, |m| m.depth.get().min(ball));
                    // Hertz: the contact's radius at that depth
                    let radius = (ball * depth).sqrt();
                    let spacing = point * far.min(PATCH_SPACING * radius);
                    features.push(Feature::Patch { centre, radius, spacing });
                }
                InstrumentKind::Indenter { diameter, tip: IndenterTip::Flat, .. } => {
                    let radius = 0.5 * diameter.get();
                    let ring = if scene.regions.is_empty() { RING_SPACING } else { point * RING_SPACING };
                    let spacing = point * edge.min(ring * radius);
                    features.push(Feature::ContactRing { centre, radius, spacing });
                }
                InstrumentKind::Needle(needle) => {
                    let capture_radius = needle.capture_radius.get();
                    let spacing =
                        along_path(edge, instrument, capture_radius, coarsest_path(instrument, grading, point < 1.0));
                    let floor = domain.length_along(&axis) - 2.0 * spacing;
                    let deepest = scene.motion.as_ref().map_or(floor, |m| m.depth.get());
                    let length = (deepest + PATH_MARGIN * capture_radius).min(floor).max(spacing);
                    reach = length;
                    features.push(Feature::Path { axis, capture_radius, length, spacing });
                    if leans(instrument) && grading.path_rings == 0 {
                        let depth = (LEANING_DEPTH * capture_radius).min(length / axis.secant());
                        features.extend(three_rings(axis, capture_radius, spacing, depth));
                    }
                }
            }
        }
        features.extend(interfaces(scene, domain, far, point < 1.0));
        Self { spacing: Spacing { far, growth: grading.growth, features }, reach }
    }

    /// Least vertical distance between the layers of nodes along a needle's path, m; 0 without a needle.
    pub(crate) fn finest_layer(&self) -> f64 {
        let fine = self.spacing.features.iter().filter(|f| matches!(f, Feature::FinePath { .. })).map(Feature::spacing);
        fine.fold(self.layer(), f64::min)
    }

    /// Whether the layers of a needle's path are closer to each other where it enters.
    pub(crate) fn is_graded(&self) -> bool {
        self.spacing.features.iter().any(|f| matches!(f, Feature::FinePath { .. }))
    }

    /// Vertical distance between the layers of nodes along a needle's path, m; 0 without a needle. The largest, where they are graded.
    pub(crate) fn layer(&self) -> f64 {
        self.spacing.features.iter().filter_map(Feature::layer).next().unwrap_or(0.0)
    }
}

/// Largest spacing along a needle's path in space, or in a half plane, m; infinite for other instruments.
#[must_use]
pub fn coarsest_path(instrument: &Instrument, grading: &Grading, half_plane: bool) -> f64 {
    let InstrumentKind::Needle(needle) = &instrument.kind else { return f64::INFINITY };
    let given = (!half_plane && grading.path_rings > 0).then(|| 1.0 / f64::from(grading.path_rings));
    given.unwrap_or(PATH_SPACING) * needle.capture_radius.get()
}

/// Spacing along a needle's path, m: what is asked for, or less. Layers of a path that leans are as far apart as its rings: where the capture
/// radius was no whole number of layers the force was up to 2 % off.
fn along_path(asked: f64, instrument: &Instrument, capture_radius: f64, coarsest: f64) -> f64 {
    let spacing = asked.min(coarsest);
    if leans(instrument) { capture_radius / (capture_radius / spacing - SAME_RINGS).ceil() } else { spacing }
}

/// Whether a needle's path leans, and its tip enters at once ([`enters_at_once`] has why the others keep their cloud).
fn leans(instrument: &Instrument) -> bool {
    instrument.slope() != [0.0; 2] && enters_at_once(instrument)
}

/// What gives a path that leans three rings down to a depth, if it has fewer.
fn three_rings(axis: Axis, radius: f64, spacing: f64, depth: f64) -> Option<Feature> {
    let fine = radius / LEANING_RINGS;
    let entry = Feature::FinePath { axis, depths: [0.0, depth], radius, spacing: fine, growth: MAX_GROWTH };
    (spacing > (1.0 + SAME_RINGS) * fine).then_some(entry)
}

/// Cells across the thickness of a region in a half plane, at least, and in space across one that is crushed; across others one has to do.
const CELLS_ACROSS: f64 = 2.0;

/// The regions' boundaries, fine enough for the thinnest of them.
///
/// In space a sphere's facets, triangles of edge e, lie e^2/(8 R) within it on average, so its nodes stand as far outside.
fn interfaces(scene: &Scene, domain: &Domain, far: f64, half_plane: bool) -> impl Iterator<Item = Feature> {
    let solids = regions::in_order(scene, domain.height());
    solids.into_iter().map(move |(region, solid)| {
        let across = if half_plane || regions::is_crushed(scene, region) { CELLS_ACROSS } else { 1.0 };
        let spacing = far.min(solid.thickness() / across);
        let solid = match solid {
            Solid::Sphere { centre, radius } if !half_plane => {
                Solid::Sphere { centre, radius: radius + spacing * spacing / (8.0 * radius) }
            }
            other => other,
        };
        Feature::Region { solid, spacing }
    })
}

/// Whether a needle's path may be finer where it enters. Where the surface is pressed first, its strain at the tip's edge, which is singular,
/// says how deep: it stays that of the cloud in space. Where tissue slips along the needle the force of the first millimetres is no matter of
/// layers.
pub(super) fn enters_at_once(instrument: &Instrument) -> bool {
    match &instrument.kind {
        InstrumentKind::Needle(needle) => needle.puncture_strain <= AT_ONCE && !instrument.is_frictional(),
        _ => false,
    }
}

/// What makes a needle's path finer where it enters, if it is coarse.
fn entry(feature: &Feature) -> Option<Feature> {
    let Feature::Path { axis, capture_radius, spacing, .. } = *feature else { return None };
    let (radius, fine) = (ENTRY_RADIUS * capture_radius, ENTRY_SPACING * spacing);
    let entry = Feature::FinePath { axis, depths: [0.0; 2], radius, spacing: fine, growth: ENTRY_GROWTH };
    (spacing > GRADED_FROM * capture_radius).then_some(entry)
}

/// Makes the cloud finer at the edge of an indenter's wall.
fn refine_edge(feature: &mut Feature) {
    if let Feature::ContactRing { radius, spacing, .. } = feature {
        *spacing = (WALL_REFINEMENT * *spacing).max(spacing.min(WALL_FINEST * *radius));
    }
}
