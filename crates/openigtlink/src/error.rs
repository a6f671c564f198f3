//! Why the OpenIGTLink server can't be started.

use std::net::SocketAddr;

/// See the module.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LinkError {
    /// The port is in use, or the address does not belong to this machine.
    #[error(
        "OpenIGTLink can't be served at {address}: {source}. Choose another openigtlink_port (0: any that is free) or openigtlink_address"
    )]
    Bind {
        /// The requested address.
        address: SocketAddr,
        /// The error of the system.
        source: std::io::Error,
    },
    /// No thread could be started, or no runtime in it.
    #[error("the thread of OpenIGTLink can't be started: {0}")]
    Thread(String),
}
