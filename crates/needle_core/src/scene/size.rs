//! How large a discretisation will be, before it is built, so that nothing absurd is allocated.

use std::f64::consts::PI;

use mtled::solver::Precision;

use super::{Dimension, Grading, InstrumentKind, Metres, Scene, Shape};

/// Most memory that a scene may ask for, bytes.
pub(crate) const MEMORY_LIMIT: f64 = 8e9;

/// Nodes per cube of the spacing: the packing is denser than a cubic lattice.
const PACKING: f64 = 1.3;
/// Nodes of the half of a body beside a plane of symmetry over those of all of it, and cells.
const HALF_NODES: f64 = 0.54;
const HALF_CELLS: f64 = 0.5;
/// Background tetrahedra per node of a large cloud.
const CELLS_PER_NODE: f64 = 5.5;
/// Support nodes of an integration point at a support factor of 1.8, measured on the presets' clouds before nodes beyond
/// 0.95 of the radius were left out: rather too many.
const SUPPORT_NODES: f64 = 41.0;
/// Bytes per node besides the shape table: positions, state, masses, cells, surface, links.
const BYTES_PER_NODE: f64 = 1000.0;
/// The same of a half plane: nodes per square of the spacing, support nodes, points per triangle at most, and bytes per
/// node with its ring of shown points and their tetrahedra.
const PLANE_PACKING: f64 = 1.2;
const PLANE_SUPPORT: f64 = 16.0;
const PLANE_POINTS: f64 = 3.0;
const PLANE_BYTES: f64 = 15_000.0;

/// Estimated size of a discretisation; within a factor of two.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Nodes.
    pub nodes: f64,
    /// Memory, bytes.
    pub bytes: f64,
}

impl Scene {
    /// Estimates nodes of the model and memory; `None` for a mesh, whose file has to be read first ([`Scene::estimate_of`]).
    #[must_use]
    pub fn estimate(&self) -> Option<Estimate> {
        let of_mesh = self.sample.shape.mesh().is_some();
        self.grading().filter(|_| !of_mesh).map(|grading| self.estimate_with(&grading))
    }

    /// The same with another grading.
    fn estimate_with(&self, grading: &Grading) -> Estimate {
        let (nodes_share, cells_share) = match self.dimension().dimension {
            Dimension::Axisymmetric => return self.estimate_half_plane(grading),
            Dimension::Mirrored => (HALF_NODES, HALF_CELLS),
            Dimension::Full | Dimension::Auto => (1.0, 1.0),
        };
        let nodes = PACKING * (self.volume() / grading.spacing.get().powi(3) + self.edge_nodes(grading));
        self.estimate_of(nodes_share * nodes, cells_share * nodes * CELLS_PER_NODE)
    }

    /// Estimates the memory that a cloud of so many nodes and cells takes.
    #[must_use]
    pub fn estimate_of(&self, nodes: f64, cells: f64) -> Estimate {
        let d = &self.discretisation;
        let support = SUPPORT_NODES * (self.support_factor() / 1.8).powi(3);
        let float = match d.precision {
            Precision::F32 => 4.0,
            Precision::F64 => 8.0,
        };
        let points = match d.cells.points_per_hexahedron() {
            0 => cells * f64::from(d.points_per_cell) / f64::from(self.cells_per_point()),
            points => cells * f64::from(points.max(6)) / 6.0, // of six tetrahedra
        };
        // Per point of a relaxing material: H, and twice Pi and every h_i, of six components each.
        let memory = match self.material.prony.len() {
            0 => 0.0,
            terms => 48.0 * (1.0 + 2.0 * (1.0 + terms as f64)),
        };
        // Per support node: an index and three components of the gradient.
        Estimate { nodes, bytes: points * (support * (4.0 + 3.0 * float) + memory) + nodes * BYTES_PER_NODE }
    }

    /// A half plane: area over the square of the spacing, what the refinement adds, and the body that is shown.
    fn estimate_half_plane(&self, grading: &Grading) -> Estimate {
        let (far, edge) = (grading.spacing.get(), grading.spacing.get() * grading.edge_refinement);
        // round the edge: the integral of pi s / h(s)^2; along the axis: of 1 / h(s)^2, both with h = h_e + g s
        let round = PI / grading.growth.powi(2) * (far / edge).ln();
        let along = match self.instrument.map(|i| i.kind) {
            Some(InstrumentKind::Needle(_)) => self.height() / (grading.growth * edge),
            _ => 0.0,
        };
        let radius = (self.volume() / (PI * self.height())).sqrt();
        let nodes = PLANE_PACKING * (radius * self.height() / (far * far) + round + along);
        let float = match self.discretisation.precision {
            Precision::F32 => 4.0,
            Precision::F64 => 8.0,
        };
        let support = PLANE_SUPPORT * (self.support_factor() / 1.8).powi(2);
        let points = 2.0 * nodes * PLANE_POINTS * f64::from(self.discretisation.points_per_cell);
        Estimate { nodes, bytes: points * support * (4.0 + 3.0 * float) + nodes * PLANE_BYTES }
    }

    /// Smallest spacing of a grading that stays within [`MEMORY_LIMIT`].
    #[must_use]
    pub(crate) fn least_spacing(&self, grading: &Grading) -> Metres {
        let (mut low, mut high) = (0.0, self.height());
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if self.estimate_with(&Grading { spacing: Metres(middle), ..*grading }).bytes > MEMORY_LIMIT {
                low = middle;
            } else {
                high = middle;
            }
        }
        Metres(high)
    }

    /// Volume of a generated sample, m^3.
    fn volume(&self) -> f64 {
        match &self.sample.shape {
            Shape::Cylinder { diameter, height } => PI / 4.0 * diameter.get().powi(2) * height.get(),
            Shape::Box { size_x, size_y, height } => size_x.get() * size_y.get() * height.get(),
            Shape::Mesh(_) | Shape::Outline(_) => 0.0,
        }
    }

    /// Height of a generated sample, m.
    fn height(&self) -> f64 {
        self.sample.shape.height().map_or(0.0, Metres::get)
    }

    /// Nodes that the refinement adds round an edge of length L: the integral of L theta s / h(s)^3 ds with
    /// h = h_e + g s up to h = h_0 is L theta (1 - h_e/h_0)^2 / (2 g^2 h_e), theta being the angle that the
    /// material fills round the edge.
    fn edge_nodes(&self, grading: &Grading) -> f64 {
        let perimeter = match &self.sample.shape {
            Shape::Cylinder { diameter, .. } => PI * diameter.get(),
            Shape::Box { size_x, size_y, .. } => 2.0 * (size_x.get() + size_y.get()),
            Shape::Mesh(_) | Shape::Outline(_) => 0.0,
        };
        let length_times_angle = match self.instrument.map(|i| i.kind) {
            None => 0.0,
            Some(InstrumentKind::Plate) => 2.0 * perimeter * PI / 2.0,
            Some(InstrumentKind::Indenter { diameter, .. }) => PI * diameter.get() * PI,
            Some(InstrumentKind::Needle(_)) => self.height() * 2.0 * PI,
        };
        let edge = grading.edge_refinement * grading.spacing.get();
        length_times_angle * (1.0 - grading.edge_refinement).powi(2) / (2.0 * grading.growth.powi(2) * edge)
    }
}
