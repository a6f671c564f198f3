//! How a field is approximated: weight functions, MLS and MMLS, linear tetrahedra. One product: the [`ShapeTable`].

pub mod mls;
pub mod support;
pub mod table;
pub mod weight;

pub use mls::Basis;
pub use table::{ApproximationError, Field, Settings, ShapeTable};
