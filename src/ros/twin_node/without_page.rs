//! Replacement for a program that was built without the live page.

use std::sync::Arc;

use serde_json::Value;

use super::answer::{Model, Snapshot};
use super::declared;
use super::shared::Shared;
use needle_core::scene::Scene;
use ros2_guarded::Bell;
use ros2_messages::needle_twin::TwinStatus;
use ros2_node::parameters::Parameters;
use ros2_node::start::NodeError;

/// Never constructed.
pub(super) struct Page {
    pub board: Arc<Board>,
}

/// Never constructed.
pub(super) enum Board {}

/// Never constructed.
pub(super) struct Asked {
    pub command: Command,
}

/// Never constructed.
#[allow(dead_code)] // no command is ever sent
pub(super) enum Command {
    Tare,
    Reset,
    Mark(String),
}

impl Board {
    pub(crate) fn is_watched(&self) -> bool {
        match *self {}
    }
}

impl Asked {
    pub(crate) fn answer(&self, _: bool, _: String) {}
}

impl Page {
    /// Rejects the live page.
    ///
    /// # Errors
    /// [`NodeError::Usage`] if the parameters enable it.
    pub(crate) fn open(parameters: &Parameters, _: &Arc<Shared>, _: Bell) -> Result<Option<Self>, NodeError> {
        if parameters.get(declared::PAGE) {
            return Err(NodeError::Usage("page: this program was built without the feature page".to_owned()));
        }
        Ok(None)
    }

    pub(crate) fn asked(&self) -> Option<Asked> {
        None
    }

    pub(crate) fn status(&self, _: &TwinStatus, _: f64) {}
}

pub(super) fn model(board: &Board, _: &Model) {
    match *board {}
}

pub(super) fn tissue(board: &Board, _: &Snapshot) {
    match *board {}
}

pub(super) fn instrument(_: &Scene, _: &[[f64; 3]]) -> Value {
    Value::Null
}
