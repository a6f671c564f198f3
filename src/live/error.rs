//! Why the page can't be served.

use std::net::SocketAddr;

/// See the module.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LiveError {
    /// The port is in use, or the address does not belong to this machine.
    #[error(
        "the live page can't be served at {address}: {source}. Choose another page_port (0: any that is free) or page_address"
    )]
    Bind {
        /// The requested address.
        address: SocketAddr,
        /// The error of the system.
        source: std::io::Error,
    },
    /// No thread could be started, or no runtime in it.
    #[error("the live page's thread can't be started: {0}")]
    Thread(String),
}
