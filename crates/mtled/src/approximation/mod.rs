//! How a field is approximated: weight functions, MLS and MMLS, linear tetrahedra, in space or in a meridian half plane.
//! One product: the [`ShapeTable`].

pub mod axisymmetric;
mod error;
mod field;
mod group;
pub mod hexahedra;
pub mod join;
pub mod mirrored;
pub mod mls;
pub mod pruned;
pub mod regions;
mod repair;
pub mod support;
pub mod table;
pub mod weight;

pub use error::ApproximationError;
pub use field::Field;
pub use mls::Basis;
pub use table::{Form, Settings, ShapeTable};
