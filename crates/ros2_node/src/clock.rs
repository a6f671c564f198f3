//! The node's time: the wall clock, or simulated time from `/clock`.
//!
//! ros2-client subscribes to `/clock` with a type name that CycloneDDS does not match. So the node has its own
//! subscription (`rosgraph_msgs/msg/Clock`) and never uses the time of ros2-client.

use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU32, Ordering};

pub use ros2_guarded::wall_nanos;
use ros2_messages::builtin_interfaces::Time;

/// Largest step back that counts as disorder, ns. `ros2 bag play --clock` begins with one, and best-effort messages
/// overtake each other.
const DISORDER_NANOS: i64 = 100_000_000;
/// This many messages in a row are not disorder but a looped short bag.
const DISORDERED: u32 = 10;

/// Time of a node, shared by its threads.
#[derive(Debug, Default)]
pub struct NodeClock {
    simulated: AtomicBool,
    /// Simulated time, ns; 0 before the first `/clock` message.
    simulation_nanos: AtomicI64,
    /// Number of consecutive messages that were slightly behind.
    behind: AtomicU32,
}

/// Effect of a `/clock` message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tick {
    /// The first time since the start.
    Started,
    /// Time advanced or stayed, or the message was out of order.
    Forward,
    /// Time went back by this many ns: a bag was looped or a simulator reset.
    Back(i64),
}

impl NodeClock {
    /// A clock with or without `use_sim_time`.
    #[must_use]
    pub fn new(simulated: bool) -> Self {
        Self { simulated: AtomicBool::new(simulated), ..Self::default() }
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

    /// Takes a `/clock` message; only one thread may call this.
    pub fn tick(&self, time: Time) -> Tick {
        let now = time.nanos();
        let back = self.simulation_nanos.load(Ordering::Relaxed).saturating_sub(now);
        if (1..=DISORDER_NANOS).contains(&back) && self.behind.fetch_add(1, Ordering::Relaxed) < DISORDERED {
            return Tick::Forward;
        }
        self.behind.store(0, Ordering::Relaxed);
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
        let at = |nanosec| clock.tick(Time { sec: 1, nanosec });
        assert_eq!((at(20_000_000), at(10_000_000)), (Tick::Forward, Tick::Forward), "the start of a player");
        assert_eq!(clock.now_nanos(), Some(1_020_000_000));
        assert_eq!(at(30_000_000), Tick::Forward);
        let looped: Vec<Tick> = (0..=DISORDERED).map(at).collect();
        assert_eq!(looped.iter().filter(|tick| matches!(tick, Tick::Back(_))).count(), 1, "a bag of 30 ms: {looped:?}");
        clock.set_simulated(false);
        assert!(clock.now_nanos().is_some_and(|now| now > 1_000_000_000_000_000_000));
    }
}
