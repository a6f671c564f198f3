//! Where the points are: nodes and background cells of an upright cylinder or box.
//!
//! ```text
//! domain, spacing ─► edges ─► packing (faces, interior, relaxation) ─► order ─► delaunay ─► improve ─► check ─► Cloud
//! ```
//!
//! Plain numbers in metres, no scene types. Deterministic: the same input gives the same bits on every machine.

pub mod check;
mod delaunay;
mod domain;
mod edges;
mod error;
mod grid;
mod improve;
mod order;
mod packing;
mod quality;
mod spacing;
mod vector;

pub use domain::{BASE, Domain, SIDE, TOP};
pub use error::CloudError;
pub use order::{hilbert_order, sort_cells};
pub use quality::Summary;
pub use spacing::{BYTES_PER_NODE, CELLS_PER_NODE, Feature, MAX_NODES, Spacing};

use packing::Packing;
use vector::Point;

/// Passes of the improvement of cells.
const PASSES: usize = 12;

/// Nodes and background tetrahedra of a body.
#[derive(Clone, Debug, PartialEq)]
pub struct Cloud {
    /// Node coordinates in metres, along a Hilbert curve.
    pub points: Vec<[f64; 3]>,
    /// Cells, each with positive volume (v1-v0)·((v2-v0)×(v3-v0)); they fill the body without gap or overlap.
    pub cells: Vec<[u32; 4]>,
    /// Faces that each node lies on: [`BASE`], [`TOP`], bits of [`SIDE`]; 0 inside.
    pub faces: Vec<u8>,
    /// Surface triangles, counter-clockwise seen from outside.
    pub surface: Vec<[u32; 3]>,
    /// Face of each surface triangle: one bit, as in `faces`.
    pub surface_faces: Vec<u8>,
    /// Shape of the cells.
    pub quality: Summary,
}

impl Cloud {
    /// Volume of each cell in cubic metres.
    pub fn volumes(&self) -> Vec<f64> {
        self.cells.iter().map(|c| quality::six_volumes(&c.map(|v| self.points[v as usize])) / 6.0).collect()
    }
}

/// Generates the cloud of a body for a spacing.
///
/// # Errors
/// A number out of its range, too many nodes ([`CloudError::TooManyNodes`], before anything is allocated), or features
/// too close to each other for the spacing.
pub fn generate(domain: &Domain, spacing: &Spacing) -> Result<Cloud, CloudError> {
    domain.validate()?;
    spacing.validate(domain)?;
    let mut nodes = edges::place(domain, spacing)?;
    let packing = Packing { domain, spacing };
    packing.fill(&mut nodes);
    let order = order::hilbert_order(&nodes.points);
    let points: Vec<Point> = order.iter().map(|&i| nodes.points[i as usize]).collect();
    let faces: Vec<u8> = order.iter().map(|&i| nodes.faces[i as usize]).collect();
    let fixed: Vec<bool> = order.iter().map(|&i| nodes.fixed[i as usize]).collect();
    let cells = delaunay::triangulate(&points)?;
    let place = |face: u8, p: Point| {
        let q = if face == 0 { p } else { domain.project(face, p) };
        (domain.depth(q) >= -1e-9 * domain.height() && !packing.reserved(q)).then_some(q)
    };
    let curved = if domain.is_plane(SIDE) { 0 } else { SIDE };
    let rules = improve::Rules { faces: &faces, fixed: &fixed, curved, place: &place };
    let mut mesh = improve::Mesh::new(points, cells, rules);
    mesh.peel();
    mesh.improve(PASSES);
    let (points, mut cells) = mesh.finish();
    order::sort_cells(&mut cells);
    let surface = check::check(&points, &cells)?;
    let shared = |t: &[u32; 3]| t.iter().fold(u8::MAX, |bits, &v| bits & faces[v as usize]);
    let surface_faces = surface.iter().map(shared).collect();
    let quality = Summary::of(&points, &cells);
    Ok(Cloud { points, cells, faces, surface, surface_faces, quality })
}
