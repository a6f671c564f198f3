//! The states of a managed node and their transitions, as in rcl_lifecycle.
//!
//! This module has no services and sockets; `lifecycle_services` offers it on the network.

use ros2_messages::lifecycle_msgs as msgs;

/// State of a managed node, with the number in `lifecycle_msgs/msg/State`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum State {
    /// Nothing is built.
    Unconfigured = 1,
    /// Built, without output.
    Inactive = 2,
    /// Active.
    Active = 3,
    /// Final state.
    Finalized = 4,
    /// In transition to inactive.
    Configuring = 10,
    /// In transition to unconfigured.
    CleaningUp = 11,
    /// In transition to finalized.
    ShuttingDown = 12,
    /// In transition to active.
    Activating = 13,
    /// In transition back to inactive.
    Deactivating = 14,
    /// After an error in a transition.
    ErrorProcessing = 15,
}

impl State {
    /// All states in the order of their numbers.
    pub const ALL: [Self; 10] = [
        Self::Unconfigured,
        Self::Inactive,
        Self::Active,
        Self::Finalized,
        Self::Configuring,
        Self::CleaningUp,
        Self::ShuttingDown,
        Self::Activating,
        Self::Deactivating,
        Self::ErrorProcessing,
    ];

    /// Name in `ros2 lifecycle get`.
    #[must_use]
    pub const fn label(self) -> &'static str {
        match self {
            Self::Unconfigured => "unconfigured",
            Self::Inactive => "inactive",
            Self::Active => "active",
            Self::Finalized => "finalized",
            Self::Configuring => "configuring",
            Self::CleaningUp => "cleaningup",
            Self::ShuttingDown => "shuttingdown",
            Self::Activating => "activating",
            Self::Deactivating => "deactivating",
            Self::ErrorProcessing => "errorprocessing",
        }
    }

    /// As a message.
    #[must_use]
    pub(crate) fn message(self) -> msgs::State {
        msgs::State { id: self as u8, label: self.label().to_owned() }
    }
}

/// A change that a manager can request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// Build.
    Configure,
    /// Release what was built.
    Cleanup,
    /// Start working.
    Activate,
    /// Stop working.
    Deactivate,
    /// End permanently.
    Shutdown,
}

/// A transition between two states.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Transition {
    /// Number in `lifecycle_msgs/msg/Transition`.
    pub id: u8,
    /// Its name.
    pub label: &'static str,
    /// Start state.
    pub start: State,
    /// Goal state.
    pub goal: State,
}

impl Transition {
    /// As a message.
    #[must_use]
    pub(crate) fn message(self) -> msgs::Transition {
        msgs::Transition { id: self.id, label: self.label.to_owned() }
    }

    /// With its states.
    #[must_use]
    pub(crate) fn description(self) -> msgs::TransitionDescription {
        msgs::TransitionDescription {
            transition: self.message(),
            start_state: self.start.message(),
            goal_state: self.goal.message(),
        }
    }
}

const fn way(id: u8, label: &'static str, start: State, goal: State) -> Transition {
    Transition { id, label, start, goal }
}

const SUCCESS: &str = "transition_success";
const FAILURE: &str = "transition_failure";
const ERROR: &str = "transition_error";

/// The whole graph, in rcl_lifecycle's order.
pub(crate) const TRANSITIONS: [Transition; 25] = {
    use State::{
        Activating, Active, CleaningUp, Configuring, Deactivating, ErrorProcessing, Finalized, Inactive, ShuttingDown,
        Unconfigured,
    };
    [
        way(1, "configure", Unconfigured, Configuring),
        way(10, SUCCESS, Configuring, Inactive),
        way(11, FAILURE, Configuring, Unconfigured),
        way(12, ERROR, Configuring, ErrorProcessing),
        way(2, "cleanup", Inactive, CleaningUp),
        way(20, SUCCESS, CleaningUp, Unconfigured),
        way(21, FAILURE, CleaningUp, Inactive),
        way(22, ERROR, CleaningUp, ErrorProcessing),
        way(3, "activate", Inactive, Activating),
        way(30, SUCCESS, Activating, Active),
        way(31, FAILURE, Activating, Inactive),
        way(32, ERROR, Activating, ErrorProcessing),
        way(4, "deactivate", Active, Deactivating),
        way(40, SUCCESS, Deactivating, Inactive),
        way(41, FAILURE, Deactivating, Active),
        way(42, ERROR, Deactivating, ErrorProcessing),
        way(5, "shutdown", Unconfigured, ShuttingDown),
        way(6, "shutdown", Inactive, ShuttingDown),
        way(7, "shutdown", Active, ShuttingDown),
        way(50, SUCCESS, ShuttingDown, Finalized),
        way(51, FAILURE, ShuttingDown, Finalized),
        way(52, ERROR, ShuttingDown, ErrorProcessing),
        way(60, SUCCESS, ErrorProcessing, Unconfigured),
        way(61, FAILURE, ErrorProcessing, Finalized),
        way(62, ERROR, ErrorProcessing, Finalized),
    ]
};

/// Transitions that start in a state.
pub(crate) fn from(state: State) -> impl Iterator<Item = Transition> {
    TRANSITIONS.into_iter().filter(move |t| t.start == state)
}

/// The transition and change that a request means in a state. The request's name is used if it has one, otherwise its
/// number. `None`: there is no such transition from this state.
#[must_use]
pub(crate) fn requested(state: State, asked: &msgs::Transition) -> Option<(Transition, Change)> {
    let fits = |t: &Transition| if asked.label.is_empty() { t.id == asked.id } else { t.label == asked.label };
    let transition = from(state).filter(fits).find(|t| t.id < 10)?;
    let change = match transition.id {
        1 => Change::Configure,
        2 => Change::Cleanup,
        3 => Change::Activate,
        4 => Change::Deactivate,
        _ => Change::Shutdown,
    };
    Some((transition, change))
}

/// The transition that ends an active transition.
#[must_use]
pub(crate) fn ended(state: State, success: bool) -> Option<Transition> {
    from(state).find(|t| t.label == if success { SUCCESS } else { FAILURE })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ask(id: u8, label: &str) -> msgs::Transition {
        msgs::Transition { id, label: label.to_owned() }
    }

    #[test]
    fn the_way_through_life() {
        let mut state = State::Unconfigured;
        for (label, goal) in [
            ("configure", State::Inactive),
            ("activate", State::Active),
            ("deactivate", State::Inactive),
            ("cleanup", State::Unconfigured),
            ("configure", State::Inactive),
            ("shutdown", State::Finalized),
        ] {
            let Some((transition, _)) = requested(state, &ask(0, label)) else { unreachable!("{label}") };
            let end = ended(transition.goal, true);
            assert_eq!(end.map(|t| t.goal), Some(goal));
            state = goal;
        }
        assert_eq!(requested(State::Finalized, &ask(1, "")), None);
    }

    #[test]
    fn what_can_not_be_done_here_is_not_done() {
        assert_eq!(requested(State::Unconfigured, &ask(3, "")), None);
        assert_eq!(requested(State::Active, &ask(0, "activate")), None);
        assert_eq!(requested(State::Configuring, &ask(10, "")), None, "ends are not for managers to ask for");
        assert_eq!(requested(State::Active, &ask(7, "")).map(|t| t.1), Some(Change::Shutdown));
        assert_eq!(ended(State::Configuring, false).map(|t| t.goal), Some(State::Unconfigured));
    }
}
