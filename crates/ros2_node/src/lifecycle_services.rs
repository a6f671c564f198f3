//! A managed node's services (`~/get_state`, `~/change_state`, ...) and `~/transition_event`.

use super::clock::NodeClock;
use super::lifecycle::{self, Change, State, TRANSITIONS, Transition};
use super::participant::{Output, Participant, ParticipantError};
use super::qos;
use super::service::{Caller, Service};
use ros2_messages::lifecycle_msgs::{
    AskRequest, ChangeStateRequest, ChangeStateResponse, GetAvailableStatesResponse, GetAvailableTransitionsResponse,
    GetStateResponse, Transition as TransitionMessage, TransitionEvent,
};

const PACKAGE: &str = "lifecycle_msgs";

/// Outcome of a change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// It is complete.
    Done,
    /// It continues; [`LifecycleServices::finish`] reports its end.
    UnderWay,
}

/// See the module.
pub struct LifecycleServices {
    get_state: Service<AskRequest, GetStateResponse>,
    change_state: Service<ChangeStateRequest, ChangeStateResponse>,
    states: Service<AskRequest, GetAvailableStatesResponse>,
    transitions: Service<AskRequest, GetAvailableTransitionsResponse>,
    graph: Service<AskRequest, GetAvailableTransitionsResponse>,
    events: Output<TransitionEvent>,
    state: State,
    /// The caller that waits for the end of the active transition.
    waiting: Option<Caller>,
}

impl LifecycleServices {
    /// Creates the endpoints; the node is unconfigured.
    ///
    /// # Errors
    /// [`ParticipantError`].
    pub fn new(participant: &mut Participant) -> Result<Self, ParticipantError> {
        Ok(Self {
            get_state: participant.server("~/get_state", PACKAGE, "GetState")?,
            change_state: participant.server("~/change_state", PACKAGE, "ChangeState")?,
            states: participant.server("~/get_available_states", PACKAGE, "GetAvailableStates")?,
            transitions: participant.server("~/get_available_transitions", PACKAGE, "GetAvailableTransitions")?,
            graph: participant.server("~/get_transition_graph", PACKAGE, "GetAvailableTransitions")?,
            events: participant.publisher("~/transition_event", qos::reliable(10))?,
            state: State::Unconfigured,
            waiting: None,
        })
    }

    /// The present state.
    #[must_use]
    pub const fn state(&self) -> State {
        self.state
    }

    /// Answers the pending requests; `act` performs the changes.
    pub fn poll(&mut self, clock: &NodeClock, act: &mut dyn FnMut(Change) -> Outcome) {
        let state = self.state;
        self.get_state.answer(|_| GetStateResponse { current_state: state.message() });
        self.states.answer(|_| GetAvailableStatesResponse {
            available_states: State::ALL.into_iter().map(State::message).collect(),
        });
        let describe = |ways: &mut dyn Iterator<Item = Transition>| GetAvailableTransitionsResponse {
            available_transitions: ways.map(Transition::description).collect(),
        };
        self.transitions.answer(|_| describe(&mut lifecycle::from(state)));
        self.graph.answer(|_| describe(&mut TRANSITIONS.into_iter()));
        while let Some((caller, request)) = self.change_state.take() {
            self.begin(&request.transition, Some(caller), clock, act);
        }
    }

    /// Makes a change on the node's own initiative.
    pub fn change(&mut self, label: &str, clock: &NodeClock, act: &mut dyn FnMut(Change) -> Outcome) {
        self.begin(&TransitionMessage { id: 0, label: label.to_owned() }, None, clock, act);
    }

    fn begin(
        &mut self,
        asked: &TransitionMessage,
        caller: Option<Caller>,
        clock: &NodeClock,
        act: &mut dyn FnMut(Change) -> Outcome,
    ) {
        let Some((transition, change)) = lifecycle::requested(self.state, asked) else {
            let wish = if asked.label.is_empty() { asked.id.to_string() } else { asked.label.clone() };
            tracing::warn!(
                "no transition `{wish}` from state `{}`: ~/get_available_transitions says which there are",
                self.state.label()
            );
            if let Some(caller) = caller {
                self.change_state.send(caller, &ChangeStateResponse { success: false });
            }
            return;
        };
        self.go(transition, clock);
        self.waiting = caller;
        if act(change) == Outcome::Done {
            self.finish(true, clock);
        }
    }

    /// Ends the active transition and answers its caller.
    pub fn finish(&mut self, success: bool, clock: &NodeClock) {
        let Some(end) = lifecycle::ended(self.state, success) else { return };
        self.go(end, clock);
        tracing::info!("{}", self.state.label());
        if let Some(caller) = self.waiting.take() {
            self.change_state.send(caller, &ChangeStateResponse { success });
        }
    }

    fn go(&mut self, transition: Transition, clock: &NodeClock) {
        self.state = transition.goal;
        self.events.send(TransitionEvent {
            timestamp: clock.now_nanos().and_then(|now| u64::try_from(now).ok()).unwrap_or(0),
            transition: transition.message(),
            start_state: transition.start.message(),
            goal_state: transition.goal.message(),
        });
    }
}
