//! Why there is no link.

use std::net::SocketAddr;

/// See the module.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LinkError {
    /// The port is taken, or the address is not of this machine.
    #[error(
        "OpenIGTLink can't be served at {address}: {source}. Choose another openigtlink_port (0: any that is free) or openigtlink_address"
    )]
    Bind {
        /// Where it was to be.
        address: SocketAddr,
        /// What the system says.
        source: std::io::Error,
    },
    /// No thread, or no runtime in it.
    #[error("the thread of OpenIGTLink can't be started: {0}")]
    Thread(String),
}
