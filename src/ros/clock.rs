//! The node's time: the wall clock, or simulated time from `/clock`.
//!
//! ros2-client subscribes `/clock` under a type name that CycloneDDS does not match, so the node has a subscription of
//! its own (`rosgraph_msgs/msg/Clock`) and never asks the crate for the time.

use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};

use super::messages::builtin_interfaces::Time;
pub use ros2_guarded::wall_nanos;

/// Time of a node, shared by its threads.
#[derive(Debug, Default)]
pub struct NodeClock {
    simulated: AtomicBool,
    /// ns; 0: `/clock` has not said anything yet.
    simulation_nanos: AtomicI64,
}

/// What a `/clock` message did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tick {
    /// The first time since the start.
    Started,
    /// Time went on or stood still.
    Forward,
    /// Time went back by so many ns: a bag was looped or a simulator reset.
    Back(i64),
}

impl NodeClock {
    /// A clock with or without `use_sim_time`.
    #[must_use]
    pub fn new(simulated: bool) -> Self {
        Self { simulated: AtomicBool::new(simulated), simulation_nanos: AtomicI64::new(0) }
    }

    /// Changes `use_sim_time`.
    pub fn set_simulated(&self, simulated: bool) {
        self.simulated.store(simulated, Ordering::Relaxed);
    }

    /// Whether time comes from `/clock`.
    #[must_use]
    pub fn is_simulated(&self) -> bool {
        self.simulated.load(Ordering::Relaxed)
    }

    /// Takes a `/clock` message.
    pub fn tick(&self, time: Time) -> Tick {
        let now = time.nanos();
        let before = self.simulation_nanos.swap(now, Ordering::Relaxed);
        match before {
            0 => Tick::Started,
            before if now < before => Tick::Back(before - now),
            _ => Tick::Forward,
        }
    }

    /// The node's time, ns; `None` with `use_sim_time` before the first `/clock`.
    #[must_use]
    pub fn now_nanos(&self) -> Option<i64> {
        if self.is_simulated() {
            Some(self.simulation_nanos.load(Ordering::Relaxed)).filter(|now| *now != 0)
        } else {
            Some(wall_nanos())
        }
    }

    /// The node's time as a stamp; zero with `use_sim_time` before the first `/clock`.
    #[must_use]
    pub fn stamp(&self) -> Time {
        Time::from_nanos(self.now_nanos().unwrap_or(0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn simulated_time_starts_with_the_first_message() {
        let clock = NodeClock::new(true);
        assert_eq!(clock.now_nanos(), None);
        assert_eq!(clock.tick(Time { sec: 5, nanosec: 0 }), Tick::Started);
        assert_eq!(clock.now_nanos(), Some(5_000_000_000));
        assert_eq!(clock.tick(Time { sec: 5, nanosec: 0 }), Tick::Forward);
        assert_eq!(clock.tick(Time { sec: 1, nanosec: 0 }), Tick::Back(4_000_000_000));
        clock.set_simulated(false);
        assert!(clock.now_nanos().is_some_and(|now| now > 1_000_000_000_000_000_000));
    }
}
