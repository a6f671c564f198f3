//! Tissue that the cloud no longer resolves: cells that have turned over.
//!
//! An integration point sees a fit over its whole support, a neighbourhood several cells wide. Its volume ratio can be that of a sound
//! tissue while the corners of its own cell have passed through each other. What such a cell carries means nothing, so the share of the
//! strain energy that stands in them tells how far the force can be trusted:
//!
//! ```text
//! share = sum of W_p V_p over the points p of cells with det(x_1 - x_0, x_2 - x_0, x_3 - x_0) of the other sign than at rest, over sum W V
//! ```
//!
//! with the field's places x of the corners. A few small cells at an instrument's sharp edge turn over at once and carry nothing.

use mtled::solver::Solver;

use super::tissue::{Fields, Tissue};

/// Where the model's nodes are, as last looked at, m: memory that is there before the first step.
#[derive(Clone, Debug)]
pub(super) struct Folds {
    places: Vec<[f64; 3]>,
}

impl Folds {
    pub(crate) fn new(tissue: &Tissue) -> Self {
        Self { places: vec![[0.0; 3]; tissue.model.nodes] }
    }

    /// Share of the strain energy (of the whole body, J) in cells that have turned over.
    pub(super) fn energy(&mut self, tissue: &Tissue, solver: &Solver, strain: f64) -> f64 {
        let u = solver.parameters();
        for (n, place) in self.places.iter_mut().enumerate() {
            let (there, by) = (tissue.at_rest(n), tissue.fields.node(n, u));
            *place = std::array::from_fn(|k| there[k] + by[k]);
        }
        let turned_over = |point: &usize| {
            let corners = tissue.corners(*point);
            let before = measure(corners, |n| tissue.at_rest(n));
            before * measure(corners, |n| self.places[n]) < 0.0
        };
        let folded: f64 = (0..tissue.model.volume.len()).filter(turned_over).map(|p| solver.energy_of(p)).sum();
        let halves = if matches!(tissue.fields, Fields::Mirrored { .. }) { 2.0 } else { 1.0 };
        (halves * folded / strain).min(1.0)
    }
}

/// Six times the volume of a tetrahedron, m^3, or twice the area of a triangle of the half plane, m^2, with a sign.
fn measure(corners: &[u32], place: impl Fn(usize) -> [f64; 3]) -> f64 {
    let first = place(corners[0] as usize);
    let edge = |i: usize| {
        let p = place(corners[i] as usize);
        [p[0] - first[0], p[1] - first[1], p[2] - first[2]]
    };
    let (a, b) = (edge(1), edge(2));
    let Some(_) = corners.get(3) else { return a[0] * b[2] - a[2] * b[0] };
    let c = edge(3);
    c[0] * (a[1] * b[2] - a[2] * b[1]) + c[1] * (a[2] * b[0] - a[0] * b[2]) + c[2] * (a[0] * b[1] - a[1] * b[0])
}
