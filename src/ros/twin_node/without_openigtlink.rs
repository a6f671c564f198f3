//! Replacement for a program that was built without OpenIGTLink.

use std::sync::Arc;

use super::answer::{Model, Snapshot};
use super::declared;
use super::shared::Shared;
use ros2_node::parameters::Parameters;
use ros2_node::start::NodeError;

/// Never constructed.
pub(super) enum Link {}

impl Link {
    /// Rejects OpenIGTLink.
    ///
    /// # Errors
    /// [`NodeError::Usage`] if the parameters enable it.
    pub(crate) fn open(parameters: &Parameters, _: &Arc<Shared>) -> Result<Option<Self>, NodeError> {
        if parameters.get(declared::OPENIGTLINK) {
            return Err(NodeError::Usage("openigtlink: this program was built without the feature slicer".to_owned()));
        }
        Ok(None)
    }

    pub(crate) fn is_watched(&self) -> bool {
        match *self {}
    }

    pub(crate) fn model(&self, _: &Model) {
        match *self {}
    }

    pub(crate) fn tissue(&self, _: &Snapshot) {
        match *self {}
    }
}
