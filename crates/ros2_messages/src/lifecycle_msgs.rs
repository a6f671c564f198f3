//! Package `lifecycle_msgs`: what a managed node and its manager say to each other.

use super::ros_messages;
use serde::{Deserialize, Serialize};

/// A state of a managed node.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct State {
    /// One of the numbers of `lifecycle_msgs/msg/State`.
    pub id: u8,
    /// Its name.
    pub label: String,
}

/// A way from one state to another.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Transition {
    /// One of the numbers of `lifecycle_msgs/msg/Transition`.
    pub id: u8,
    /// Its name.
    pub label: String,
}

/// A transition with where it starts and ends.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TransitionDescription {
    /// The transition.
    pub transition: Transition,
    /// From here.
    pub start_state: State,
    /// To there.
    pub goal_state: State,
}

/// A transition that has begun or ended.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TransitionEvent {
    /// Node time, ns.
    pub timestamp: u64,
    /// The transition.
    pub transition: Transition,
    /// From here.
    pub start_state: State,
    /// To there.
    pub goal_state: State,
}

/// Request of the services that only ask: empty, which CDR writes as one octet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct AskRequest {
    /// Always 0.
    pub structure_needs_at_least_one_member: u8,
}

/// Response of `GetState`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct GetStateResponse {
    /// The present state.
    pub current_state: State,
}

/// Request of `ChangeState`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ChangeStateRequest {
    /// What to do; the name counts if there is one.
    pub transition: Transition,
}

/// Response of `ChangeState`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ChangeStateResponse {
    /// Whether it was done.
    pub success: bool,
}

/// Response of `GetAvailableStates`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct GetAvailableStatesResponse {
    /// All states.
    pub available_states: Vec<State>,
}

/// Response of `GetAvailableTransitions`, which also stands for the whole graph.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct GetAvailableTransitionsResponse {
    /// The transitions.
    pub available_transitions: Vec<TransitionDescription>,
}

ros_messages!("lifecycle_msgs": State, Transition, TransitionDescription, TransitionEvent);
