//! Parameters of the guard.

use needle_guard::{Orders, Place};
use needle_rig::MotionLimits;
use ros2_node::parameter::{Parameter, parameters};
use ros2_node::parameters::{Declaration, Parameters};
use ros2_node::recorder;
use ros2_node::start::common_declarations;

parameters! {
    /// The guard's own.
    own:

    JOINT_NAME: String = Parameter::new(
        "joint_name",
        "insertion",
        "Joint of measured_js and servo_jp whose position is the depth, m.",
    )
    .fixed();
    GOAL_DEPTH_M: f64 = Parameter::real(
        "goal_depth_m",
        0.005,
        [-10.0, 10.0],
        "Depth to go to, if target_index is negative.",
    )
    .fixed();
    TARGET_INDEX: i64 = Parameter::integer(
        "target_index",
        -1,
        [-1, 10_000],
        "Place in the topic targets (from 0) of the target to go to; -1: none, but goal_depth_m.",
    )
    .fixed();
    ENTRY_M: [f64; 3] = Parameter::new(
        "entry_m",
        [0.0, 0.0, 0.017],
        "Where the needle's axis meets the undeformed surface, frame sample: depth 0 of a target.",
    )
    .fixed();
    AXIS: [f64; 3] = Parameter::new("axis", [0.0, 0.0, -1.0], "Direction of insertion, frame sample.").fixed();
    SPEED_M_PER_S: f64 = Parameter::real("speed_m_per_s", 0.002, [1e-6, 1.0], "Speed of insertion.").fixed();
    MAX_ACCELERATION_M_PER_S2: f64 = Parameter::real(
        "max_acceleration_m_per_s2",
        0.5,
        [1e-6, 1e3],
        "Largest acceleration and deceleration of the setpoint.",
    )
    .fixed();
    MAX_JERK_M_PER_S3: f64 = Parameter::real(
        "max_jerk_m_per_s3",
        100.0,
        [1e-3, 1e6],
        "Largest jerk of the setpoint.",
    )
    .fixed();
    FORCE_LIMIT_N: f64 = Parameter::real(
        "force_limit_n",
        0.5,
        [1e-6, 1e6],
        "Largest predicted force against the insertion (of its length while axis is not the twin's): the speed falls from 80 % of it on, \
         and the guard stops at 97 %.",
    )
    .fixed();
    MAX_PROBABILITY_OF_FORCE_LIMIT: f64 = Parameter::real(
        "max_probability_of_force_limit",
        1.0,
        [1e-6, 1.0],
        "Largest probability, by the twin's members, that the force passes force_limit_n within look_ahead_m: the speed falls from 80 % of \
         it on, and the guard stops at 97 %. Below 1 it is asked in place of the predicted force.",
    )
    .fixed();
    MAX_PROBABILITY_OF_MISS: f64 = Parameter::real(
        "max_probability_of_miss",
        1.0,
        [1e-6, 1.0],
        "Largest probability, by the twin's members, that the target is missed by more than miss_radius_m; 1: not asked.",
    )
    .fixed();
    LOOK_AHEAD_M: f64 = Parameter::real(
        "look_ahead_m",
        5e-4,
        [1e-6, 0.1],
        "How far ahead these probabilities look, m; shorter than the twin's outlook_m by the way of a few outlooks.",
    )
    .fixed();
    MISS_RADIUS_M: f64 = Parameter::real(
        "miss_radius_m",
        1e-3,
        [1e-6, 1.0],
        "Distance between tip and target that counts as a miss, m.",
    )
    .fixed();
    OUTLOOK_TIMEOUT_S: f64 = Parameter::real(
        "outlook_timeout_s",
        1.0,
        [0.001, 10.0],
        "An outlook of the twin's members that came longer ago is lost, and the guard stops, where a probability is asked.",
    )
    .fixed();
    TIMEOUT_S: f64 = Parameter::real(
        "timeout_s",
        0.025,
        [0.001, 10.0],
        "measured_js, predicted_cf and safety that are silent for longer, or whose stamps are further from now, are lost, and the guard \
         stops; so it does when it was itself held up for longer.",
    )
    .fixed();
    TARGET_TIMEOUT_S: f64 = Parameter::real(
        "target_timeout_s",
        0.2,
        [0.001, 10.0],
        "The same for targets, which come at the twin's tissue_rate_hz.",
    )
    .fixed();
    TOLERANCE_M: f64 = Parameter::real(
        "tolerance_m",
        1e-4,
        [1e-9, 1.0],
        "Distance to the goal that counts as arrived.",
    )
    .fixed();
    DWELL_S: f64 = Parameter::real("dwell_s", 0.3, [0.0, 3600.0], "Time at the goal that counts as arrived.").fixed();
    FOLLOWING_ERROR_M: f64 = Parameter::real(
        "following_error_m",
        5e-4,
        [1e-9, 1.0],
        "The guard stops if the needle is further from where it was told to be.",
    )
    .fixed();
    SLOW_FACTOR: f64 = Parameter::real(
        "slow_factor",
        0.5,
        [0.0, 1.0],
        "Share of the speed while the twin's health is WARN.",
    )
    .fixed();
    RESUME_AFTER_S: f64 = Parameter::real(
        "resume_after_s",
        0.0,
        [0.0, 3600.0],
        "After a stop go on when all has been well for so long; 0: only after ~/resume.",
    )
    .fixed();
    STOP_BEFORE_REGION: String = Parameter::new(
        "stop_before_region",
        "",
        "Name of a region of the twin's scene that the tip must not come into; empty: none.",
    )
    .fixed();
    STOP_BEFORE_M: f64 = Parameter::real(
        "stop_before_m",
        5e-4,
        [0.0, 1.0],
        "How far before that region the needle stops.",
    )
    .fixed();
    RATE_HZ: f64 = Parameter::real(
        "rate_hz",
        250.0,
        [10.0, 10_000.0],
        "Rate of servo_jp, and of looking at what came.",
    )
    .fixed();
    EXIT_WHEN_DONE: bool = Parameter::new(
        "exit_when_done",
        true,
        "End the program at the goal; false: go on following it.",
    )
    .fixed();
}

pub(super) fn declarations() -> Vec<Declaration> {
    let mut all = common_declarations();
    all.extend(recorder::declarations());
    all.extend(own());
    all
}

/// Goal of the needle.
#[derive(Clone, Copy, Debug)]
pub(super) enum Goal {
    /// Depth, m.
    Depth(f64),
    /// A target of the twin, by its index in the topic.
    Target(usize),
}

pub(super) fn goal(parameters: &Parameters) -> Goal {
    match usize::try_from(parameters.get(TARGET_INDEX)) {
        Ok(index) => Goal::Target(index),
        Err(_) => Goal::Depth(parameters.get(GOAL_DEPTH_M)),
    }
}

/// The region that must not be entered.
pub(super) fn region(parameters: &Parameters) -> Option<String> {
    Some(parameters.get(STOP_BEFORE_REGION)).filter(|name| !name.is_empty())
}

/// The line of the needle's motion, frame `sample`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Line {
    entry_m: [f64; 3],
    axis: [f64; 3],
}

impl Line {
    /// Depth of a position along the line, m.
    pub(crate) fn depth_m(&self, place: [f64; 3]) -> f64 {
        (0..3).map(|k| (place[k] - self.entry_m[k]) * self.axis[k]).sum()
    }

    /// A position in the coordinates of the line.
    pub(crate) fn place(&self, place: [f64; 3]) -> Place {
        let depth_m = self.depth_m(place);
        let off = |k: usize| place[k] - self.entry_m[k] - depth_m * self.axis[k];
        Place { depth_m, aside_m: (0..3).map(|k| off(k) * off(k)).sum::<f64>().sqrt() }
    }

    /// Direction of insertion.
    pub(crate) const fn axis(&self) -> [f64; 3] {
        self.axis
    }

    /// Cosine of the angle to a direction of any length.
    pub(crate) fn along(&self, direction: [f64; 3]) -> f64 {
        let length = direction.iter().map(|x| x * x).sum::<f64>().sqrt();
        (0..3).map(|k| self.axis[k] * direction[k]).sum::<f64>() / length
    }

    /// The component of a force against the insertion, N.
    pub(crate) fn against_n(&self, force: [f64; 3]) -> f64 {
        -(0..3).map(|k| force[k] * self.axis[k]).sum::<f64>()
    }
}

pub(super) fn line(parameters: &Parameters) -> Result<Line, String> {
    let (entry_m, axis) = (parameters.get(ENTRY_M), parameters.get(AXIS));
    let length = axis.iter().map(|x| x * x).sum::<f64>().sqrt();
    if length < 1e-9 {
        return Err("axis is a direction and must not be 0, 0, 0".to_owned());
    }
    Ok(Line { entry_m, axis: axis.map(|x| x / length) })
}

pub(super) fn orders(parameters: &Parameters) -> Orders {
    Orders {
        motion: MotionLimits {
            speed_m_per_s: parameters.get(SPEED_M_PER_S),
            acceleration_m_per_s2: parameters.get(MAX_ACCELERATION_M_PER_S2),
            jerk_m_per_s3: parameters.get(MAX_JERK_M_PER_S3),
        },
        step_s: 1.0 / parameters.get(RATE_HZ),
        force_limit_n: parameters.get(FORCE_LIMIT_N),
        max_probability_of_force_limit: parameters.get(MAX_PROBABILITY_OF_FORCE_LIMIT),
        max_probability_of_miss: parameters.get(MAX_PROBABILITY_OF_MISS),
        look_ahead_m: parameters.get(LOOK_AHEAD_M),
        miss_radius_m: parameters.get(MISS_RADIUS_M),
        outlook_timeout_s: parameters.get(OUTLOOK_TIMEOUT_S),
        timeout_s: parameters.get(TIMEOUT_S),
        target_timeout_s: parameters.get(TARGET_TIMEOUT_S),
        tolerance_m: parameters.get(TOLERANCE_M),
        dwell_s: parameters.get(DWELL_S),
        following_error_m: parameters.get(FOLLOWING_ERROR_M),
        slow_factor: parameters.get(SLOW_FACTOR),
        stop_before_m: region(parameters).map(|_| parameters.get(STOP_BEFORE_M)),
        resume_after_s: parameters.get(RESUME_AFTER_S),
    }
}
