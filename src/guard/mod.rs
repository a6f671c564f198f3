//! The supervising controller between the twin and a needle driver: inserts the needle, and stops when something is lost or
//! out of bounds.
//!
//! Every tick it looks at what it has heard and how long ago, and says where the needle shall be next:
//!
//! ```text
//! waiting ──all is well──► moving ──at the goal, at rest──► arrived (and goes on following the goal)
//!    ▲                       │  trouble
//!    └── resume ── stopped ◄─┘  brakes at once, then says nothing
//! ```
//! A driver stands when setpoints cease. So nothing that it missed while a process was frozen, or a cable was cut, moves the needle when
//! they are back.
//!
//! It slows down before it stops: from [`SLOWS_AT`] of the force limit on, the speed falls in proportion to the remaining
//! force, and while the twin warns it is multiplied by `slow_factor`. Where a largest probability is ordered, the members' outlook
//! ([`Outlook`]) decides in place of the predicted force, by the same rule, and the needle goes no faster than outlooks come.
//!
//! The goal is a depth, or the depth of a target that moves with the tissue; the motion there is a [`Trajectory`], so a
//! goal that moves is followed without passing it. No sockets and no clocks: times come in as ages.

mod outlook;

use std::fmt;

pub use outlook::{Odds, Outlook, Place, Question};

use needle_rig::{MotionLimits, Trajectory};

/// Share of a limit (of the force, of a probability) from which the speed falls, to nothing at the limit.
pub const SLOWS_AT: f64 = 0.8;
/// Share of a limit at which the guard stops; the rest is for what braking adds.
pub const STOPS_AT: f64 = 0.97;

/// Twin and guard hear one needle: at the same stamp their depths differ by a constant, which is that of the sensors' zeros. It may change by
/// so much, m.
const SAME_POSE_M: f64 = 1e-4;

/// Largest age of where a region begins, s: the twin's status comes ten times a second.
const REGION_TIMEOUT_S: f64 = 0.5;

/// What the guard is to do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orders {
    /// Limits of the motion; they must not be above those of the driver.
    pub motion: MotionLimits,
    /// Time between two ticks, s.
    pub step_s: f64,
    /// Largest force against the insertion, N.
    pub force_limit_n: f64,
    /// Largest probability that the force passes its limit within [`Orders::look_ahead_m`]; 1: the predicted force decides instead.
    pub max_probability_of_force_limit: f64,
    /// Largest probability that the target is missed by more than [`Orders::miss_radius_m`]; 1: it is not asked for.
    pub max_probability_of_miss: f64,
    /// How far ahead these probabilities look, m.
    pub look_ahead_m: f64,
    /// Distance from the target that counts as a miss, m.
    pub miss_radius_m: f64,
    /// Largest age of an outlook, s.
    pub outlook_timeout_s: f64,
    /// Largest age of a value, s; older ones count as lost.
    pub timeout_s: f64,
    /// The same for a target, which comes at a lower rate, s.
    pub target_timeout_s: f64,
    /// Distance to the goal that counts as arrived, m.
    pub tolerance_m: f64,
    /// Time at the goal that counts as arrived, s.
    pub dwell_s: f64,
    /// Distance between setpoint and measured position at which the driver does not follow, m.
    pub following_error_m: f64,
    /// Share of the speed while the twin warns.
    pub slow_factor: f64,
    /// Stop so far before a region's boundary, m; `None`: no region is forbidden.
    pub stop_before_m: Option<f64>,
    /// After a stop, go on by itself when all has been well for so long, s; 0: never.
    pub resume_after_s: f64,
}

impl Orders {
    /// Whether members have to look ahead.
    #[must_use]
    pub fn ask_members(&self) -> bool {
        self.max_probability_of_force_limit < 1.0 || self.max_probability_of_miss < 1.0
    }

    /// What to ask the members at a depth on the way to a goal, m.
    #[must_use]
    pub const fn question(&self, depth_m: f64, goal_m: f64) -> Question {
        let Self { look_ahead_m, force_limit_n, miss_radius_m, .. } = *self;
        Question { depth_m, goal_m, look_ahead_m, force_limit_n, miss_radius_m }
    }
}

/// A value, how long ago it came, and how old it is by its stamp.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Heard<T> {
    /// The value.
    pub value: T,
    /// Since it came, s.
    pub age_s: f64,
    /// Since its stamp, s: negative for one from the future, infinite for one without a stamp, 0 of what carries none. A predicted force
    /// has the stamp of the pose that it answers, and its age is held against the newest position.
    pub since_stamp_s: f64,
}

impl<T> Heard<T> {
    /// Of what carries no stamp.
    pub const fn unstamped(value: T, age_s: f64) -> Self {
        Self { value, age_s, since_stamp_s: 0.0 }
    }
}

/// Where a region begins on the needle's way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Boundary {
    /// Depth of the tip at which it comes into the region, m.
    pub depth_m: f64,
    /// Whether that is where the twin has the deformed boundary; otherwise as in the scene.
    pub predicted: bool,
}

/// What the guard has heard; `None`: never.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sight {
    /// Measured depth, m.
    pub depth_m: Option<Heard<f64>>,
    /// Predicted force against the insertion, N.
    pub force_n: Option<Heard<f64>>,
    /// Whether the twin says that it is safe to go on.
    pub safe: Option<Heard<bool>>,
    /// Time since the guard last looked, s.
    pub held_up_s: f64,
    /// A topic on which a second publisher has spoken.
    pub two_publish: Option<&'static str>,
    /// Whether the twin warns.
    pub warned: bool,
    /// Depth to go to, m.
    pub goal_m: Option<Heard<f64>>,
    /// Where the region begins that must not be entered.
    pub boundary: Option<Heard<Boundary>>,
    /// What the members say of the next piece of the way; its age is that of the pose that they looked from.
    pub odds: Option<Heard<Odds>>,
    /// Whether the goal is a target of the twin, whose position can become outdated.
    pub goal_moves: bool,
    /// Depth that the twin answered less the measured depth of the same stamp, m; `None`: no stamp was common.
    pub twin_offset_m: Option<f64>,
}

/// Why the needle must not move.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Trouble {
    /// The guard itself was not running for so long, s: what happened meanwhile it has not seen.
    HeldUp(f64),
    /// Two publish a topic, and nobody knows which of them is right.
    TwoPublish(&'static str),
    /// No position for too long.
    PositionLost,
    /// The position's stamp is so far from now, s.
    PositionStamp(f64),
    /// No prediction for too long.
    PredictionLost,
    /// The prediction is of a pose so long before the newest position, s.
    PredictionLate(f64),
    /// The stamp of the twin's word on safety is so far from now, s.
    SafetyStamp(f64),
    /// The twin says that it is not safe, or nothing.
    NotVouched,
    /// No target for too long.
    TargetLost,
    /// The predicted force, N.
    ForceLimit(f64),
    /// The members' outlook is missing or too old.
    OutlookLost,
    /// The probability that the force passes its limit.
    ForceLikely(f64),
    /// The probability that the target is missed.
    MissLikely(f64),
    /// Where the region begins that must not be entered is not known.
    RegionUnknown,
    /// The region that must not be entered begins here.
    RegionAhead(Boundary),
    /// The driver is not where it was told to be, by so much, m.
    NotFollowing(f64),
    /// The depth that the twin answers has departed from the measured one by so much since the motion began, m.
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

/// A stamp that is far from now.
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

/// What the guard is doing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Phase {
    /// Until everything has been heard and is well. It says nothing to the driver.
    Waiting(Option<Trouble>),
    /// On the way.
    Moving,
    /// At the goal, and following it.
    Arrived,
    /// Braking or at rest, until it is told to go on.
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
    /// A guard that waits.
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

    /// What it is to do.
    #[must_use]
    pub const fn orders(&self) -> &Orders {
        &self.orders
    }

    /// What it is doing.
    #[must_use]
    pub const fn phase(&self) -> Phase {
        self.phase
    }

    /// Speed of the setpoint, m/s.
    #[must_use]
    pub const fn speed_m_per_s(&self) -> f64 {
        self.trajectory.velocity_m_per_s()
    }

    /// After a stop: waits for all to be well, then goes on. False if it is not stopped.
    pub fn resume(&mut self) -> bool {
        // a driver that does not follow is not braked by it
        let astray = matches!(self.phase, Phase::Stopped(Trouble::NotFollowing(_)));
        let stopped = astray || (matches!(self.phase, Phase::Stopped(_)) && self.trajectory.is_at_rest());
        if stopped {
            self.phase = Phase::Waiting(None);
        }
        stopped
    }

    /// Brakes as if there were trouble: the setpoint until it stands, then `None`.
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

    /// One tick: where the needle shall be, m; `None` while waiting, and after a stop once it stands.
    pub fn tick(&mut self, sight: &Sight) -> Option<f64> {
        let trouble = self.trouble(sight);
        if matches!(trouble, Some(Trouble::HeldUp(_))) {
            // The driver has come to rest meanwhile: braking from the speed of before would move it.
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

    /// Deepest place that lies before the forbidden region, m; `None` if there is none.
    fn before_region(&self, sight: &Sight) -> Option<f64> {
        Some(sight.boundary?.value.depth_m - self.orders.stop_before_m?)
    }

    /// Whether the forbidden region is near, or where it is can't be said.
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

    /// Share of the speed that force and probabilities leave.
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
        // the outlook must not be outrun
        let used = if self.orders.ask_members() { odds.map_or(0.0, |odds| left(odds.used, 1.0)) } else { 1.0 };
        force.unwrap_or(0.0).min(miss).min(used)
    }

    /// Whether the force, or a probability of what lies ahead, is at its limit.
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

/// A value that came, and is stamped, within the timeout.
fn fresh<T>(heard: Option<Heard<T>>, timeout_s: f64) -> Option<T> {
    let is_fresh = |heard: &Heard<T>| heard.age_s <= timeout_s && heard.since_stamp_s.abs() <= timeout_s;
    heard.filter(is_fresh).map(|heard| heard.value)
}

/// Age by its stamp of a value that came in time and is not of now, s.
fn off<T>(heard: Option<Heard<T>>, timeout_s: f64) -> Option<f64> {
    let heard = heard.filter(|heard| heard.age_s <= timeout_s)?;
    (heard.since_stamp_s.abs() > timeout_s).then_some(heard.since_stamp_s)
}

#[cfg(test)]
mod tests;
