//! What RustDDS asks for addresses, in the place of the crate of this name on crates.io (`[patch.crates-io]` of the workspace): all of
//! it is [`own_addresses`], which says why. A build without the patch has the other one, and `ros2_guarded` notices.
#![forbid(unsafe_code)]

pub use own_addresses::{Interface, get_interfaces};
