//! The supervising controller between the twin and a needle driver. It inserts the needle, and stops when data are
//! lost or a quantity is out of bounds.
//!
//! At every tick it checks the received values and their ages, and computes the next setpoint of the needle:
//!
//! ```text
//! waiting ──all is well──► moving ──at the goal, at rest──► arrived (and goes on following the goal)
//!    ▲                       │  trouble
//!    └── resume ── stopped ◄─┘  brakes at once, then sends nothing
//! ```
//! A driver stands still when setpoints cease. So setpoints that it missed while a process was suspended, or a cable
//! was cut, do not move the needle afterwards.
//!
//! The guard slows down before it stops. From [`SLOWS_AT`] of the force limit on, the speed falls in proportion to
//! the remaining force. While the twin warns, the speed is multiplied by `slow_factor`. If a largest probability is
//! configured, the members' look-ahead ([`Outlook`]) replaces the predicted force in the same rule. The needle then
//! moves no faster than look-aheads arrive.
//!
//! The goal is a depth, or the depth of a target that moves with the tissue. The motion is a [`Trajectory`], so a
//! moving goal is followed without overshoot. This crate uses no sockets and no clocks: times are passed in as ages.
#![forbid(unsafe_code)]
#![warn(unreachable_pub)] // what is pub is for another crate

mod outlook;

use std::fmt;

pub use outlook::{Odds, Question};
pub use outlook::{Outlook, Place};

use needle_rig::{MotionLimits, Trajectory};

/// Share of a limit (of the force, of a probability) from which on the speed falls; it is zero at the limit.
pub const SLOWS_AT: f64 = 0.8;
/// Share of a limit at which the guard stops; the rest is reserved for the increase during braking.
pub(crate) const STOPS_AT: f64 = 0.97;

/// Twin and guard receive the position of the same needle. At the same stamp their depths differ by a constant, the
/// difference of the sensors' zeros. Largest change of that difference, m.
const SAME_POSE_M: f64 = 1e-4;

/// Largest age of a region's boundary, s: the twin's status comes ten times a second.
const REGION_TIMEOUT_S: f64 = 0.5;

/// Configuration of the guard.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orders {
    /// Limits of the motion; they must not be above those of the driver.
    pub motion: MotionLimits,
    /// Time between two ticks, s.
    pub step_s: f64,
    /// Largest force against the insertion, N.
    pub force_limit_n: f64,
    /// Largest probability that the force exceeds its limit within [`Orders::look_ahead_m`]; 1: the predicted force
    /// is used instead.
    pub max_probability_of_force_limit: f64,
    /// Largest probability that the target is missed by more than [`Orders::miss_radius_m`]; 1: not used.
    pub max_probability_of_miss: f64,
    /// Distance over which these probabilities look ahead, m.
    pub look_ahead_m: f64,
    /// Distance from the target that counts as a miss, m.
    pub miss_radius_m: f64,
    /// Largest age of a look-ahead, s.
    pub outlook_timeout_s: f64,
    /// Largest age of a value, s; older values count as lost.
    pub timeout_s: f64,
    /// The same for a target, which comes at a lower rate, s.
    pub target_timeout_s: f64,
    /// Distance to the goal that counts as arrived, m.
    pub tolerance_m: f64,
    /// Time at the goal that counts as arrived, s.
    pub dwell_s: f64,
    /// Distance between setpoint and measured position above which the driver does not follow, m.
    pub following_error_m: f64,
    /// Factor on the speed while the twin warns.
    pub slow_factor: f64,
    /// Distance at which it stops before a region's boundary, m; `None`: no region is forbidden.
    pub stop_before_m: Option<f64>,
    /// Time without trouble after which it resumes automatically after a stop, s; 0: never.
    pub resume_after_s: f64,
}

impl Orders {
    /// Whether the members' look-ahead is needed.
    #[must_use]
    pub fn ask_members(&self) -> bool {
        self.max_probability_of_force_limit < 1.0 || self.max_probability_of_miss < 1.0
    }

    /// The question to the members at a depth during the motion to a goal, m.
    #[must_use]
    pub const fn question(&self, depth_m: f64, goal_m: f64) -> Question {
        let Self { look_ahead_m, force_limit_n, miss_radius_m, .. } = *self;
        Question { depth_m, goal_m, look_ahead_m, force_limit_n, miss_radius_m }
    }
}

/// A received value with its two ages.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Heard<T> {
    /// The value.
    pub value: T,
    /// Time since it was received, s.
    pub age_s: f64,
    /// Time since its stamp, s: negative for a stamp in the future, infinite for a missing stamp, 0 for a type
    /// without stamps. A predicted force has the stamp of the pose that it answers, and its age is relative to the
    /// newest position.
    pub since_stamp_s: f64,
}

impl<T> Heard<T> {
    /// A value of a type without stamps.
    pub const fn unstamped(value: T, age_s: f64) -> Self {
        Self { value, age_s, since_stamp_s: 0.0 }
    }
}

/// The boundary of a region on the needle's path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Boundary {
    /// Depth of the tip at which it enters the region, m.
    pub depth_m: f64,
    /// Whether this is the deformed boundary predicted by the twin; otherwise it is that of the scene.
    pub predicted: bool,
}

/// The received values; `None`: never received.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sight {
    /// Measured depth, m.
    pub depth_m: Option<Heard<f64>>,
    /// Predicted force against the insertion, N.
    pub force_n: Option<Heard<f64>>,
    /// Whether the twin reports that it is safe to continue.
    pub safe: Option<Heard<bool>>,
    /// Time since the guard's last tick, s.
    pub held_up_s: f64,
    /// A topic on which a second publisher has sent messages.
    pub two_publish: Option<&'static str>,
    /// Whether the twin warns.
    pub warned: bool,
    /// Depth to go to, m.
    pub goal_m: Option<Heard<f64>>,
    /// The boundary of the forbidden region.
    pub boundary: Option<Heard<Boundary>>,
    /// The members' look-ahead; its age is that of the pose from which they looked ahead.
    pub odds: Option<Heard<Odds>>,
    /// Whether the goal is a target of the twin, whose position can become out of date.
    pub goal_moves: bool,
    /// Depth that the twin answered minus the measured depth with the same stamp, m; `None`: there was no common
    /// stamp.
    pub twin_offset_m: Option<f64>,
}

/// Why the needle must not move.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Trouble {
    /// The guard itself was not running for this time, s, and has missed events in it.
    HeldUp(f64),
    /// Two nodes publish a topic, and the guard can't know which one is right.
    TwoPublish(&'static str),
    /// No position within the timeout.
    PositionLost,
    /// The position's stamp is this far from the present time, s.
    PositionStamp(f64),
    /// No prediction within the timeout.
    PredictionLost,
    /// The prediction belongs to a pose this much older than the newest position, s.
    PredictionLate(f64),
    /// The stamp of the twin's safety report is this far from the present time, s.
    SafetyStamp(f64),
    /// The twin reports that it is not safe, or nothing.
    NotVouched,
    /// No target position within the timeout.
    TargetLost,
    /// The predicted force, N, is at its limit.
    ForceLimit(f64),
    /// The members' look-ahead is missing or too old.
    OutlookLost,
    /// The probability that the force exceeds its limit.
    ForceLikely(f64),
    /// The probability that the target is missed.
    MissLikely(f64),
    /// The boundary of the forbidden region is not known.
    RegionUnknown,
    /// The forbidden region begins here.
    RegionAhead(Boundary),
    /// Distance of the driver from its setpoint, m.
    NotFollowing(f64),
    /// Change of the difference between the twin's depth and the measured one since the motion began, m.
    OtherPose(f64),
}

impl fmt::Display for Trouble {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::HeldUp(s) => write!(f, "the guard itself was held up for {s:.3} s"),
            Self::TwoPublish(topic) => {
                write!(
                    f,
                    "two publish {topic}: stop one of them, or remap it (`ros2 topic info --verbose` has their nodes)"
                )
            }
            Self::PositionStamp(s) => stamp(f, "measured_js", *s),
            Self::PredictionLate(s) => {
                write!(
                    f,
                    "predicted_cf answers a pose of {s:.3} s before the newest measured_js: poses reach the twin late"
                )
            }
            Self::SafetyStamp(s) => stamp(f, "safety", *s),
            Self::PositionLost => write!(f, "measured_js is silent: is the sensor's cable connected?"),
            Self::PredictionLost => write!(f, "predicted_cf is silent: does the twin run?"),
            Self::NotVouched => write!(f, "the twin does not vouch for its prediction (see its status)"),
            Self::TargetLost => write!(f, "targets is silent or has no such target"),
            Self::ForceLimit(force) => write!(f, "the predicted force, {force:.4} N, is at the limit"),
            Self::OutlookLost => {
                write!(f, "outlook is silent or too old: has the twin members, and do they keep up?")
            }
            Self::ForceLikely(p) => write!(f, "the force passes its limit ahead with a probability of {p:.3}"),
            Self::MissLikely(p) => write!(f, "the target is missed with a probability of {p:.3}"),
            Self::RegionUnknown => {
                write!(
                    f,
                    "the twin's status is silent, or has no region on the needle's path of the name in stop_before_region"
                )
            }
            Self::RegionAhead(Boundary { depth_m, predicted }) => {
                let of = if *predicted { "as the twin predicts its boundary" } else { "as the scene has it" };
                write!(f, "the region of stop_before_region begins at {depth_m:.6} m, {of}")
            }
            Self::OtherPose(gap) => write!(
                f,
                "the twin answers poses that depart from measured_js by {gap:.6} m: its position is frozen, or of another sensor"
            ),
            Self::NotFollowing(gap) => write!(f, "the driver is {gap:.6} m away from where it was told to be"),
        }
    }
}

/// Describes a stamp that is far from the present time.
fn stamp(f: &mut fmt::Formatter<'_>, topic: &str, since_s: f64) -> fmt::Result {
    if since_s.is_infinite() {
        return write!(f, "{topic} has no stamps: how old it is can't be known");
    }
    let (by_s, side) = if since_s < 0.0 { (-since_s, "ahead of") } else { (since_s, "behind") };
    write!(
        f,
        "the stamp of {topic} is {by_s:.3} s {side} the guard's clock: it is late, or the clocks differ (synchronise them, or use_sim_time)"
    )
}

/// State of the guard.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Phase {
    /// Waits until all values are received and there is no trouble. Sends nothing to the driver.
    Waiting(Option<Trouble>),
    /// Moving to the goal.
    Moving,
    /// At the goal, and following it.
    Arrived,
    /// Braking or at rest, until `~/resume` is called.
    Stopped(Trouble),
}

/// See the module.
#[derive(Clone, Debug)]
pub struct Guard {
    orders: Orders,
    phase: Phase,
    trajectory: Trajectory,
    /// Time at the goal, s.
    at_goal_s: f64,
    /// Time without trouble after a stop, s.
    well_s: f64,
    /// [`Sight::twin_offset_m`] when the motion began.
    offset_m: Option<f64>,
}

impl Guard {
    /// A guard in the waiting state.
    #[must_use]
    pub fn new(orders: Orders) -> Self {
        Self {
            orders,
            phase: Phase::Waiting(None),
            trajectory: Trajectory::new(orders.motion, orders.step_s, 0.0),
            at_goal_s: 0.0,
            well_s: 0.0,
            offset_m: None,
        }
    }

    /// Its configuration.
    #[must_use]
    pub const fn orders(&self) -> &Orders {
        &self.orders
    }

    /// Its state.
    #[must_use]
    pub const fn phase(&self) -> Phase {
        self.phase
    }

    /// Speed of the setpoint, m/s.
    #[must_use]
    pub const fn speed_m_per_s(&self) -> f64 {
        self.trajectory.velocity_m_per_s()
    }

    /// After a stop: waits until there is no trouble, then continues. Returns false if it is not stopped.
    pub fn resume(&mut self) -> bool {
        // a driver that does not follow can't be braked, so the trajectory need not be at rest
        let astray = matches!(self.phase, Phase::Stopped(Trouble::NotFollowing(_)));
        let stopped = astray || (matches!(self.phase, Phase::Stopped(_)) && self.trajectory.is_at_rest());
        if stopped {
            self.phase = Phase::Waiting(None);
        }
        stopped
    }

    /// Brakes as after trouble: returns the setpoint until it is at rest, then `None`.
    pub fn leave(&mut self) -> Option<f64> {
        if matches!(self.phase, Phase::Waiting(_) | Phase::Stopped(Trouble::NotFollowing(_)))
            || self.trajectory.is_at_rest()
        {
            return None;
        }
        self.trajectory.stop();
        self.trajectory.step();
        Some(self.trajectory.position_m())
    }

    /// One tick. Returns the setpoint of the needle, m; `None` while waiting, and after a stop once it is at rest.
    pub fn tick(&mut self, sight: &Sight) -> Option<f64> {
        let trouble = self.trouble(sight);
        if matches!(trouble, Some(Trouble::HeldUp(_))) {
            // The driver has come to rest meanwhile: braking from the previous speed would move it.
            self.trajectory = Trajectory::new(self.orders.motion, self.orders.step_s, self.trajectory.position_m());
        }
        match (self.phase, trouble, sight.depth_m) {
            (Phase::Waiting(_), None, Some(depth)) => {
                self.trajectory = Trajectory::new(self.orders.motion, self.orders.step_s, depth.value);
                (self.at_goal_s, self.well_s, self.offset_m) = (0.0, 0.0, sight.twin_offset_m);
                self.phase = Phase::Moving;
            }
            (Phase::Waiting(_), trouble, _) => {
                self.phase = Phase::Waiting(trouble);
                return None;
            }
            (Phase::Moving | Phase::Arrived, Some(trouble), _) => {
                self.phase = Phase::Stopped(trouble);
                self.trajectory.stop();
                self.well_s = 0.0;
            }
            (Phase::Moving | Phase::Arrived, None, _) => {
                self.offset_m = self.offset_m.or(sight.twin_offset_m);
                self.go(sight);
            }
            (Phase::Stopped(_), trouble, _) => self.hold(trouble),
        }
        let stopped = matches!(self.phase, Phase::Stopped(_));
        let astray = matches!(self.phase, Phase::Stopped(Trouble::NotFollowing(_)));
        if astray || (stopped && self.trajectory.is_at_rest()) {
            return None;
        }
        self.trajectory.step();
        Some(self.trajectory.position_m())
    }

    /// Sets speed and goal.
    fn go(&mut self, sight: &Sight) {
        let Orders { motion, step_s, tolerance_m, dwell_s, slow_factor, .. } = self.orders;
        let share = if sight.warned { slow_factor } else { 1.0 };
        self.trajectory.limit_speed(motion.speed_m_per_s * share * self.share_left(sight));
        let (Some(goal), Some(depth)) = (sight.goal_m, sight.depth_m) else { return };
        self.trajectory.go_to(self.before_region(sight).map_or(goal.value, |limit| goal.value.min(limit)));
        let here = (depth.value - goal.value).abs() <= tolerance_m;
        self.at_goal_s = if here { self.at_goal_s + step_s } else { 0.0 };
        if self.at_goal_s >= dwell_s {
            self.phase = Phase::Arrived;
        }
    }

    /// Deepest position before the forbidden region, m; `None` if no region is forbidden.
    fn before_region(&self, sight: &Sight) -> Option<f64> {
        Some(sight.boundary?.value.depth_m - self.orders.stop_before_m?)
    }

    /// Whether the forbidden region is near, or its position is not known.
    fn region_trouble(&self, sight: &Sight, depth: f64) -> Option<Trouble> {
        self.orders.stop_before_m?;
        let boundary = fresh(sight.boundary, REGION_TIMEOUT_S).filter(|b| b.depth_m.is_finite());
        let Some(boundary) = boundary else { return Some(Trouble::RegionUnknown) };
        let limit = self.before_region(sight)?;
        (depth >= limit - self.orders.tolerance_m).then_some(Trouble::RegionAhead(boundary))
    }

    /// Counts the time without trouble.
    fn hold(&mut self, trouble: Option<Trouble>) {
        self.well_s = if trouble.is_none() { self.well_s + self.orders.step_s } else { 0.0 };
        let after_s = self.orders.resume_after_s;
        if after_s > 0.0 && self.well_s >= after_s {
            self.resume();
        }
    }

    /// Factor on the speed that force and probabilities allow.
    fn share_left(&self, sight: &Sight) -> f64 {
        let Orders { force_limit_n, max_probability_of_force_limit, max_probability_of_miss, .. } = self.orders;
        let left = |value: f64, limit: f64| ((limit - value) / ((1.0 - SLOWS_AT) * limit)).clamp(0.0, 1.0);
        let odds = sight.odds.map(|odds| odds.value);
        let force = if max_probability_of_force_limit < 1.0 {
            odds.map(|odds| left(odds.force_limit, max_probability_of_force_limit))
        } else {
            sight.force_n.map(|force| left(force.value, force_limit_n))
        };
        let miss = if max_probability_of_miss < 1.0 {
            odds.map_or(0.0, |odds| left(odds.miss, max_probability_of_miss))
        } else {
            1.0
        };
        // the needle must not leave the range of the look-ahead
        let used = if self.orders.ask_members() { odds.map_or(0.0, |odds| left(odds.used, 1.0)) } else { 1.0 };
        force.unwrap_or(0.0).min(miss).min(used)
    }

    /// Whether the force, or a probability ahead, is at its limit.
    fn limit_trouble(&self, sight: &Sight, force: f64) -> Option<Trouble> {
        let Orders { force_limit_n, max_probability_of_force_limit, max_probability_of_miss, .. } = self.orders;
        let by_force = max_probability_of_force_limit >= 1.0 && force >= STOPS_AT * force_limit_n;
        if by_force || !self.orders.ask_members() {
            return by_force.then_some(Trouble::ForceLimit(force));
        }
        let Some(Odds { force_limit, miss, .. }) = fresh(sight.odds, self.orders.outlook_timeout_s) else {
            return Some(Trouble::OutlookLost);
        };
        if max_probability_of_force_limit < 1.0 && force_limit >= STOPS_AT * max_probability_of_force_limit {
            return Some(Trouble::ForceLikely(force_limit));
        }
        let missed = max_probability_of_miss < 1.0 && miss >= STOPS_AT * max_probability_of_miss;
        missed.then_some(Trouble::MissLikely(miss))
    }

    /// Why the needle must not move, the most serious reason first.
    fn trouble(&self, sight: &Sight) -> Option<Trouble> {
        let Orders { timeout_s, target_timeout_s, following_error_m, .. } = self.orders;
        if sight.held_up_s > timeout_s {
            return Some(Trouble::HeldUp(sight.held_up_s));
        }
        if let Some(topic) = sight.two_publish {
            return Some(Trouble::TwoPublish(topic));
        }
        let Some(depth) = fresh(sight.depth_m, timeout_s).filter(|d| d.is_finite()) else {
            return Some(off(sight.depth_m, timeout_s).map_or(Trouble::PositionLost, Trouble::PositionStamp));
        };
        let Some(force) = fresh(sight.force_n, timeout_s).filter(|f| f.is_finite()) else {
            return Some(off(sight.force_n, timeout_s).map_or(Trouble::PredictionLost, Trouble::PredictionLate));
        };
        if let Some(trouble) = self.limit_trouble(sight, force) {
            return Some(trouble);
        }
        if fresh(sight.safe, timeout_s) != Some(true) {
            return Some(off(sight.safe, timeout_s).map_or(Trouble::NotVouched, Trouble::SafetyStamp));
        }
        let goal_timeout = if sight.goal_moves { target_timeout_s } else { f64::INFINITY };
        if fresh(sight.goal_m, goal_timeout).is_none_or(|goal| !goal.is_finite()) {
            return Some(Trouble::TargetLost);
        }
        if let Some(trouble) = self.region_trouble(sight, depth) {
            return Some(trouble);
        }
        if matches!(self.phase, Phase::Waiting(_) | Phase::Stopped(_)) {
            return None;
        }
        let gap = (depth - self.trajectory.position_m()).abs();
        if gap > following_error_m {
            return Some(Trouble::NotFollowing(gap));
        }
        let departed = self.offset_m.zip(sight.twin_offset_m).map(|(then, now)| (now - then).abs());
        departed.filter(|departed| *departed > SAME_POSE_M).map(Trouble::OtherPose)
    }
}

/// The value, if it was received and stamped within the timeout.
fn fresh<T>(heard: Option<Heard<T>>, timeout_s: f64) -> Option<T> {
    let is_fresh = |heard: &Heard<T>| heard.age_s <= timeout_s && heard.since_stamp_s.abs() <= timeout_s;
    heard.filter(is_fresh).map(|heard| heard.value)
}

/// Age by the stamp, s, of a value that was received in time but whose stamp is outside the timeout.
fn off<T>(heard: Option<Heard<T>>, timeout_s: f64) -> Option<f64> {
    let heard = heard.filter(|heard| heard.age_s <= timeout_s)?;
    (heard.since_stamp_s.abs() > timeout_s).then_some(heard.since_stamp_s)
}

#[cfg(test)]
mod tests;
