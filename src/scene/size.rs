//! How large a discretisation will be, before it is built: nothing absurd gets as far as the memory.

use std::f64::consts::PI;

use super::{InstrumentKind, Metres, Precision, Scene, Shape};

/// Most memory that a scene may ask for, bytes.
pub const MEMORY_LIMIT: f64 = 8e9;

/// Nodes per cube of the spacing: the packing is denser than a cubic lattice.
const PACKING: f64 = 1.3;
/// Background tetrahedra per node of a large cloud.
const CELLS_PER_NODE: f64 = 5.5;
/// Support nodes of an integration point at a support factor of 1.8 (method.md, section 3.7).
const SUPPORT_NODES: f64 = 41.0;
/// Bytes per node besides the shape table: positions, state, masses, cells, surface, links.
const BYTES_PER_NODE: f64 = 1000.0;

/// Estimated size of a discretisation; within a factor of two.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Nodes.
    pub nodes: f64,
    /// Memory, bytes.
    pub bytes: f64,
}

impl Scene {
    /// Estimates nodes and memory.
    #[must_use]
    pub fn estimate(&self) -> Estimate {
        self.estimate_at(self.discretisation.spacing.get())
    }

    /// The same with another spacing.
    fn estimate_at(&self, spacing: f64) -> Estimate {
        let d = &self.discretisation;
        let nodes = PACKING * (self.volume() / spacing.powi(3) + self.edge_nodes(spacing));
        let support = SUPPORT_NODES * (d.support_factor / 1.8).powi(3);
        let float = match d.precision {
            Precision::F32 => 4.0,
            Precision::F64 => 8.0,
        };
        let points = nodes * CELLS_PER_NODE * f64::from(d.points_per_cell);
        // Per point of a relaxing material: H, and twice Pi and every h_i, of six components each.
        let memory = match self.material.prony.len() {
            0 => 0.0,
            terms => 48.0 * (1.0 + 2.0 * (1.0 + terms as f64)),
        };
        // Per support node: an index and three components of the gradient.
        Estimate { nodes, bytes: points * (support * (4.0 + 3.0 * float) + memory) + nodes * BYTES_PER_NODE }
    }

    /// Smallest spacing that stays within [`MEMORY_LIMIT`].
    #[must_use]
    pub fn least_spacing(&self) -> Metres {
        let (mut low, mut high) = (0.0, self.sample.shape.height().get());
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if self.estimate_at(middle).bytes > MEMORY_LIMIT {
                low = middle;
            } else {
                high = middle;
            }
        }
        Metres(high)
    }

    /// Volume of the sample, m^3.
    fn volume(&self) -> f64 {
        match self.sample.shape {
            Shape::Cylinder { diameter, height } => PI / 4.0 * diameter.get().powi(2) * height.get(),
            Shape::Box { size_x, size_y, height } => size_x.get() * size_y.get() * height.get(),
        }
    }

    /// Nodes that the refinement adds round an edge of length L: the integral of L theta s / h(s)^3 ds with
    /// h = h_e + g s up to h = h_0 is L theta (1 - h_e/h_0)^2 / (2 g^2 h_e), theta being the angle that the
    /// material fills round the edge.
    fn edge_nodes(&self, spacing: f64) -> f64 {
        let d = &self.discretisation;
        let perimeter = match self.sample.shape {
            Shape::Cylinder { diameter, .. } => PI * diameter.get(),
            Shape::Box { size_x, size_y, .. } => 2.0 * (size_x.get() + size_y.get()),
        };
        let length_times_angle = match self.instrument.map(|i| i.kind) {
            None => 0.0,
            Some(InstrumentKind::Plate) => 2.0 * perimeter * PI / 2.0,
            Some(InstrumentKind::Indenter { diameter }) => PI * diameter.get() * PI,
            Some(InstrumentKind::Needle(_)) => self.sample.shape.height().get() * 2.0 * PI,
        };
        let edge = d.edge_refinement * spacing;
        length_times_angle * (1.0 - d.edge_refinement).powi(2) / (2.0 * d.growth.powi(2) * edge)
    }
}
