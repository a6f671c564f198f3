//! How a field is approximated: weight functions, MLS and MMLS, linear tetrahedra, in space or in a meridian half plane.
//! One product: the [`ShapeTable`].

pub mod axisymmetric;
mod error;
mod field;
mod group;
mod join;
pub(crate) mod mirrored;
pub mod mls;
mod pruned;
mod regions;
mod repair;
mod shape_table;
pub mod support;
pub mod table;
mod weight;

pub use error::ApproximationError;
pub use field::Field;
pub use mls::Basis;
pub use shape_table::{Form, ShapeTable};
pub use table::Settings;
