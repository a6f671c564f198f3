//! Viewers of the sample in addition to subscribers: browsers and clients of OpenIGTLink. All see the same snapshots.

use std::sync::Arc;

use super::answer::{Model, Snapshot};
use super::openigtlink::Link;
use super::page::{self, Board};

/// Recipients of snapshots for viewers.
#[derive(Default)]
pub(super) struct Viewers {
    /// The live page, if one is served.
    pub page: Option<Arc<Board>>,
    /// The link, if one is served.
    pub link: Option<Link>,
}

impl Viewers {
    /// Whether there is a viewer.
    pub(crate) fn watch(&self) -> bool {
        self.page.as_ref().is_some_and(|board| board.is_watched())
            || self.link.as_ref().is_some_and(|link| link.is_watched())
    }

    /// Shows an undeformed sample.
    pub(crate) fn model(&self, model: &Model) {
        self.page.iter().for_each(|board| page::model(board, model));
        self.link.iter().for_each(|link| link.model(model));
    }

    /// Shows the sample at one time.
    pub(crate) fn tissue(&self, snapshot: &Snapshot) {
        self.page.iter().filter(|board| board.is_watched()).for_each(|board| page::tissue(board, snapshot));
        self.link.iter().filter(|link| link.is_watched()).for_each(|link| link.tissue(snapshot));
    }
}
