//! Why the page can't be served.

use std::net::SocketAddr;

/// See the module.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LiveError {
    /// The port is taken, or the address is not of this machine.
    #[error(
        "the live page can't be served at {address}: {source}. Choose another page_port (0: any that is free) or page_address"
    )]
    Bind {
        /// Where it was to be.
        address: SocketAddr,
        /// What the system says.
        source: std::io::Error,
    },
    /// No thread, or no runtime in it.
    #[error("the live page's thread can't be started: {0}")]
    Thread(String),
}
