//! Where the points are: nodes and background cells of an upright cylinder or box, or of
//! the half plane of an axisymmetric model ([`meridian`]).
//!
//! ```text
//! domain, spacing ─► edges ─► packing (faces, interior, relaxation) ─► order ─► delaunay ─► improve ─► check ─► Cloud
//! ```
//!
//! Sizes on the paper's sample (cylinder of 30 mm by 17 mm), lengths in mm:
//!
//! | scene | feature | growth | far | nodes | cells | lowest quality |
//! |---|---|---|---|---|---|---|
//! | indentation | ring of radius 5, spacing 0.3 | 0.2 | 1.58 | 8188 | 42,400 | 0.45 |
//! | needle | path 10.5 deep, capture radius 0.5, spacing 0.25 | 0.3 | 2.33 | 5133 | 28,200 | 0.44 |
//! | compression | both rims, spacing 0.5 | 0.3 | 1.55 | 7136 | 34,100 | 0.45 |
//!
//! Plain numbers in metres, no scene types. Deterministic: the same input gives the same bits, whatever the number of
//! threads (there is one) and from run to run.
#![forbid(unsafe_code)]
#![warn(unreachable_pub)] // public is what another crate can name

mod carve;
pub mod check;
mod conform;
mod delaunay;
mod domain;
mod edges;
mod error;
mod faces;
mod generate;
pub mod grid;
pub mod hexahedron;
mod improve;
mod interfaces;
pub mod meridian;
pub mod mirror;
mod nodes;
mod order;
mod outline;
mod packing;
mod path;
pub mod quality;
mod reconnect;
mod reflect;
mod shift;
mod skin;
mod smooth;
mod solid;
mod spacing;
mod tree;
mod triangulate;
pub mod vector;

pub use domain::Domain;
pub use error::CloudError;
pub use faces::{BASE, MIRROR, SIDE, TOP};
pub use generate::{LEAST_QUALITY, generate, generate_with};
pub use hexahedron::Hexahedron;
pub use meridian::Meridian;
pub use order::{hilbert_order, sort_cells};
pub use outline::Outline;
pub use packing::{OwnNodes, PACKED, Room};
pub use path::Axis;
pub use quality::Summary;
pub use reflect::Reflected;
pub use solid::Solid;
pub use spacing::{BYTES_PER_NODE, CELLS_PER_NODE, Feature, MAX_GROWTH, MAX_NODES, Spacing};

/// Nodes and background tetrahedra of a body.
#[derive(Clone, Debug, PartialEq)]
pub struct Cloud {
    /// Node coordinates in metres, along a Hilbert curve.
    pub points: Vec<[f64; 3]>,
    /// Cells, each with positive volume (v1-v0)·((v2-v0)×(v3-v0)); they fill the body without gap or overlap.
    pub cells: Vec<[u32; 4]>,
    /// Faces that each node lies on: [`BASE`], [`TOP`], bits of [`SIDE`], of a half body [`MIRROR`]; 0 inside.
    pub faces: Vec<u8>,
    /// Surface triangles, counter-clockwise seen from outside.
    pub surface: Vec<[u32; 3]>,
    /// Face of each surface triangle: one bit, as in `faces`.
    pub surface_faces: Vec<u8>,
    /// Shape of the cells.
    pub quality: Summary,
    /// Hexahedra that some of the cells, or all, are the tetrahedra of.
    pub hexahedra: Vec<Hexahedron>,
}

impl Cloud {
    /// Volume of each cell in cubic metres.
    pub fn volumes(&self) -> Vec<f64> {
        self.cells.iter().map(|c| quality::six_volumes(&c.map(|v| self.points[v as usize])) / 6.0).collect()
    }
}
