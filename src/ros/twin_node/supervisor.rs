//! The main thread: waits for signals, brings the built model to those who need it, and notices what has died.

use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use crossbeam_channel::{Receiver, Sender};

use super::inbox::Inbox;
use super::shared::Shared;
use super::solver::Built;
use super::tissue::{self, Model, Snapshot, TissueOutputs};
use crate::ros::signals::Signals;
use crate::ros::start::{NodeError, SUCCESS};
use crate::ros::threads::spawn;

/// Longest time between two looks.
const TICK: Duration = Duration::from_millis(50);

/// See the module.
pub(super) struct Supervisor {
    pub frame_id: String,
    /// A model that can't be built ends the node; else its manager hears of it.
    pub autostart: bool,
    pub shared: Arc<Shared>,
    pub inbox: Arc<Inbox>,
    pub tissue: Arc<TissueOutputs>,
    pub built: Receiver<Built>,
    /// To the housekeeping thread: the model, or that there is none.
    pub models: Sender<Option<Arc<Model>>>,
    pub snapshots: Receiver<Box<Snapshot>>,
    /// Started with the first model.
    pub tissue_thread: Option<JoinHandle<()>>,
}

impl Supervisor {
    /// Returns when a signal comes.
    ///
    /// # Errors
    /// [`NodeError`] if the model can't be built or a thread has ended.
    pub fn run(&mut self, signals: &Signals, threads: [&JoinHandle<()>; 2]) -> Result<u8, NodeError> {
        loop {
            if let Some(signal) = signals.wait(TICK) {
                tracing::info!("stopping ({signal:?})");
                return Ok(SUCCESS);
            }
            match self.built.try_recv() {
                Ok(Ok(model)) => self.take(Arc::from(model))?,
                Ok(Err(reason)) if self.autostart => return Err(NodeError::Other(reason)),
                Ok(Err(reason)) => {
                    tracing::error!("the model can't be built: {reason}");
                    self.tell(None);
                }
                Err(_) if threads.iter().any(|thread| thread.is_finished()) => {
                    return Err(NodeError::Other("a thread of the node has ended unexpectedly".to_owned()));
                }
                Err(_) => {}
            }
        }
    }

    fn take(&mut self, model: Arc<Model>) -> Result<(), NodeError> {
        tracing::info!(
            "scene {}: {} nodes, {} integration points, built in {:.2} s",
            model.scene,
            model.nodes,
            model.integration_points,
            model.build.as_secs_f64()
        );
        self.tell(Some(Arc::clone(&model)));
        if self.tissue_thread.is_none() {
            let (tissue, shared, inbox) = (Arc::clone(&self.tissue), Arc::clone(&self.shared), Arc::clone(&self.inbox));
            let (frame, snapshots) = (self.frame_id.clone(), self.snapshots.clone());
            let body = move || tissue::run(&tissue, &model, &frame, &shared, &inbox, &snapshots);
            self.tissue_thread = Some(spawn("tissue", body)?);
        }
        Ok(())
    }

    fn tell(&self, model: Option<Arc<Model>>) {
        // Fails only when the housekeeping thread has ended.
        let _ = self.models.send(model);
    }
}
