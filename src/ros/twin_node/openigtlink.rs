//! Output of the node by OpenIGTLink.

use std::net::{IpAddr, Ipv4Addr};
use std::sync::Arc;

use super::answer::{Model, Snapshot};
use super::declared;
use super::shared::Shared;
use openigtlink::{Board, Instrument, Server};
use ros2_node::parameters::Parameters;
use ros2_node::start::NodeError;

/// A link that is served.
pub(super) struct Link {
    board: Arc<Board>,
    _server: Server,
}

impl Link {
    /// Serves it, if the parameters enable it.
    ///
    /// # Errors
    /// [`NodeError`] if the port is in use.
    pub(crate) fn open(parameters: &Parameters, shared: &Arc<Shared>) -> Result<Option<Self>, NodeError> {
        if !parameters.get(declared::OPENIGTLINK) {
            return Ok(None);
        }
        let address = parameters.get(declared::OPENIGTLINK_ADDRESS).parse().unwrap_or(IpAddr::V4(Ipv4Addr::LOCALHOST));
        let port = u16::try_from(parameters.get(declared::OPENIGTLINK_PORT)).unwrap_or(0);
        if !address.is_loopback() {
            tracing::warn!(
                "openigtlink_address {address}: whoever reaches this machine can watch, since nothing is encrypted"
            );
        }
        let board = Arc::new(Board::default());
        let instrument = {
            let shared = Arc::clone(shared);
            move || {
                let answer = shared.lock().last?;
                let at = answer.pose.pose;
                Some(Instrument { stamp_nanos: answer.stamp.nanos(), tip: at.tip, axis: at.axis })
            }
        };
        let server = Server::start((address, port), Arc::clone(&board), instrument);
        let server = server.map_err(|e| NodeError::Other(e.to_string()))?;
        tracing::info!("OpenIGTLink: {}", server.address());
        Ok(Some(Self { board, _server: server }))
    }

    /// Whether there is a client.
    pub(crate) fn is_watched(&self) -> bool {
        self.board.is_watched()
    }

    /// Shows the sample.
    pub(crate) fn model(&self, model: &Model) {
        self.board.model(&model.points, &model.surface, &model.target_names);
    }

    /// Shows the sample at one time.
    pub(crate) fn tissue(&self, snapshot: &Snapshot) {
        self.board.tissue(snapshot.stamp.nanos(), &snapshot.displacements, &snapshot.targets);
    }
}
