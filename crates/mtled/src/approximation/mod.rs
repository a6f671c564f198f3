//! How a field is approximated: weight functions, MLS and MMLS, linear tetrahedra, in space or in a meridian half plane.
//! One product: the [`ShapeTable`].

pub mod axisymmetric;
pub mod join;
pub mod mls;
pub mod regions;
mod repair;
pub mod support;
pub mod table;
pub mod weight;

pub use mls::Basis;
pub use table::{ApproximationError, Field, Form, Settings, ShapeTable};
