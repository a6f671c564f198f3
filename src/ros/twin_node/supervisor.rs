//! The main thread: waits for signals, distributes the built model, and detects threads that have ended.

use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use crossbeam_channel::{Receiver, Sender};

use super::answer::{Model, Snapshot};
use super::inbox::Inbox;
use super::pulse::Pulse;
use super::shared::Shared;
use super::solver::Built;
use super::tissue::{self, TissueOutputs};
use named_threads::spawn;
use ros2_guarded::Bell;
use ros2_guarded::signals::Signals;
use ros2_node::start::{NodeError, SUCCESS};

/// Longest interval between two checks.
const TICK: Duration = Duration::from_millis(50);

/// See the module.
pub(super) struct Supervisor {
    pub frame_id: String,
    /// If set, a model that can't be built ends the node; otherwise the lifecycle manager is informed.
    pub autostart: bool,
    pub shared: Arc<Shared>,
    pub inbox: Arc<Inbox>,
    pub tissue: Arc<TissueOutputs>,
    pub built: Receiver<Built>,
    /// To the housekeeping thread: the model, or `None` if it can't be built.
    pub models: Sender<Option<Arc<Model>>>,
    pub bell: Bell,
    pub snapshots: Receiver<Box<Snapshot>>,
    /// Started with the first model.
    pub tissue_thread: Option<JoinHandle<()>>,
}

impl Supervisor {
    /// Returns at a signal.
    ///
    /// # Errors
    /// [`NodeError`] if the model can't be built, or a thread has ended or hangs.
    pub(crate) fn run(&mut self, signals: &Signals, threads: &[&JoinHandle<()>]) -> Result<u8, NodeError> {
        let outcome = self.supervise(signals, threads);
        if let Err(error) = &outcome {
            // The last status and the last `safe_to_go_on` contain it.
            self.shared.lock().dying = Some(error.to_string());
        }
        outcome
    }

    fn supervise(&mut self, signals: &Signals, threads: &[&JoinHandle<()>]) -> Result<u8, NodeError> {
        let mut pulse = Pulse::new(TICK);
        loop {
            if let Some(signal) = signals.wait(TICK) {
                tracing::info!("stopping ({signal:?})");
                return Ok(SUCCESS);
            }
            self.feel(&mut pulse)?;
            match self.built.try_recv() {
                Ok(Ok(model)) => self.take(Arc::from(model))?,
                Ok(Err(reason)) if self.autostart => return Err(NodeError::Other(reason)),
                Ok(Err(reason)) => {
                    tracing::error!("the model can't be built: {reason}");
                    self.tell(None);
                }
                Err(_) => {}
            }
            if let Some(thread) = threads.iter().copied().chain(&self.tissue_thread).find(|thread| thread.is_finished())
            {
                let name = thread.thread().name().unwrap_or("?");
                return Err(NodeError::Other(format!(
                    "the {name} thread has ended unexpectedly (a panic above says where): start the node again, and \
                     report it with the recording"
                )));
            }
        }
    }

    /// Reports a solver that hangs for `input_timeout_s`, and ends the node after `solver_timeout_s`.
    fn feel(&self, pulse: &mut Pulse) -> Result<(), NodeError> {
        let settings = self.shared.settings();
        let same_s = pulse.look(self.inbox.at_work()).as_secs_f64();
        if same_s >= settings.solver_timeout_s {
            return Err(NodeError::Other(format!(
                "the solver has not come back from one pose for {same_s:.1} s: start the node again, with a coarser \
                 discretisation or a longer solver_timeout_s if the model is that slow"
            )));
        }
        let stuck_s = (same_s > settings.input_timeout_s).then_some(same_s);
        let before = std::mem::replace(&mut self.shared.lock().stuck_s, stuck_s);
        if stuck_s.is_some() && before.is_none() {
            tracing::error!("the solver does not come back from a pose: predicted_cf is silent");
        }
        Ok(())
    }

    fn take(&mut self, model: Arc<Model>) -> Result<(), NodeError> {
        tracing::info!(
            "scene {}: {} nodes, {} integration points, built in {:.2} s",
            model.scene,
            model.nodes,
            model.integration_points,
            model.build.as_secs_f64()
        );
        self.shared.lock().along = Arc::clone(&model.along);
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
        // Fails only if the housekeeping thread has ended.
        let _ = self.models.send(model);
        self.bell.ring();
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::panic)]
    use super::*;
    use crate::ros::twin_node::declared::{Settings, declarations};
    use crate::ros::twin_node::judgement::{Around, judge};
    use needle_core::scene::Scene;
    use ros2_messages::needle_twin::TwinStatus;
    use ros2_node::arguments::RosArguments;
    use ros2_node::clock::NodeClock;
    use ros2_node::environment::Environment;
    use ros2_node::names::Names;
    use ros2_node::parameters::Parameters;
    use ros2_node::participant::Participant;
    use ros2_node::start::FAILURE;

    /// No input is known to make a thread panic, so the test creates a thread that does.
    #[test]
    fn a_thread_that_panics_ends_the_node_with_its_name_and_an_error() {
        let environment = Environment::from_lookup(|_| None).unwrap();
        let names = Names::new("twin", &[]).unwrap();
        // The endpoints are never created: it does not join the network.
        let mut participant = Participant::new(names, &environment, &RosArguments::default()).unwrap();
        let (parameters, _) = Parameters::declare(declarations(), &[], "/twin").unwrap();
        let shared = Arc::new(Shared::new(Settings::of(&parameters), NodeClock::new(false)));
        let ((_built, built), (models, _models)) = (crossbeam_channel::bounded(1), crossbeam_channel::bounded(1));
        let (_snapshots, snapshots) = crossbeam_channel::bounded(1);
        let mut supervisor = Supervisor {
            frame_id: "sample".to_owned(),
            autostart: true,
            shared: Arc::clone(&shared),
            inbox: Arc::default(),
            tissue: Arc::new(
                TissueOutputs::new(&mut participant, &Scene::preset("needle_insertion").unwrap()).unwrap(),
            ),
            built,
            models,
            bell: participant.bell(),
            snapshots,
            tissue_thread: None,
        };
        let (end, ended) = crossbeam_channel::bounded::<()>(0);
        let sound = spawn("force", move || assert!(ended.recv().is_err())).unwrap();
        let broken = spawn("solver", || panic!("on purpose")).unwrap();
        let signals = Signals::block().unwrap();
        let error = supervisor.run(&signals, &[&sound, &broken]).unwrap_err();
        assert_eq!(error.exit_code(), FAILURE);
        assert!(error.to_string().starts_with("the solver thread has ended unexpectedly"), "{error}");
        let judgement = judge(&shared.lock(), &shared, &shared.settings(), &Around::default());
        assert!(judgement.health == TwinStatus::HEALTH_ERROR && !judgement.vouches(), "the last status says so");
        assert!(judgement.reasons.iter().any(|r| r.contains("solver thread")), "{:?}", judgement.reasons);
        drop(end);
        sound.join().unwrap();
    }
}
