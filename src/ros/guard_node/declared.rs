//! Parameters of the guard.

use ros2_client::ParameterValue as P;

use crate::guard::Orders;
use crate::rig::MotionLimits;
use crate::ros::parameters::{Declaration, Parameters, Range};
use crate::ros::recorder;
use crate::ros::start::common_declarations;

pub(super) fn declarations() -> Vec<Declaration> {
    let double = |name, default, low, high, text| {
        Declaration::new(name, P::Double(default), Range::Double(low, high), text).fixed()
    };
    let array = |name, default: [f64; 3], text| {
        Declaration::new(name, P::DoubleArray(default.to_vec()), Range::Any, text)
            .checked("three numbers", |value| three(value).map(drop))
            .fixed()
    };
    let mut all = common_declarations();
    all.extend(recorder::declarations());
    all.extend([
        Declaration::new(
            "joint_name",
            P::String("insertion".to_owned()),
            Range::Any,
            "Joint of measured_js and servo_jp whose position is the depth, m.",
        )
        .fixed(),
        double("goal_depth_m", 0.005, -10.0, 10.0, "Depth to go to, if target_index is negative."),
        Declaration::new(
            "target_index",
            P::Integer(-1),
            Range::Integer(-1, 10_000),
            "Place in the topic targets (from 0) of the target to go to; -1: none, but goal_depth_m.",
        )
        .fixed(),
        array(
            "entry_m",
            [0.0, 0.0, 0.017],
            "Where the needle's axis meets the undeformed surface, frame sample: depth 0 of a target.",
        ),
        array("axis", [0.0, 0.0, -1.0], "Direction of insertion, frame sample."),
        double("speed_m_per_s", 0.002, 1e-6, 1.0, "Speed of insertion."),
        double("max_acceleration_m_per_s2", 0.5, 1e-6, 1e3, "Largest acceleration and deceleration of the setpoint."),
        double("max_jerk_m_per_s3", 100.0, 1e-3, 1e6, "Largest jerk of the setpoint."),
        double(
            "force_limit_n",
            0.5,
            1e-6,
            1e6,
            "Largest predicted force against the insertion: the speed falls from 80 % of it on, and the guard stops at 97 %.",
        ),
        double(
            "timeout_s",
            0.025,
            0.001,
            10.0,
            "measured_js, predicted_cf and safe_to_go_on that are silent for longer are lost, and the guard stops.",
        ),
        double("target_timeout_s", 0.2, 0.001, 10.0, "The same for targets, which come at the twin's tissue_rate_hz."),
        double("tolerance_m", 1e-4, 1e-9, 1.0, "Distance to the goal that counts as arrived."),
        double("dwell_s", 0.3, 0.0, 3600.0, "Time at the goal that counts as arrived."),
        double(
            "following_error_m",
            5e-4,
            1e-9,
            1.0,
            "The guard stops if the needle is further from where it was told to be.",
        ),
        double("slow_factor", 0.5, 0.0, 1.0, "Share of the speed while the twin's health is WARN."),
        double(
            "resume_after_s",
            0.0,
            0.0,
            3600.0,
            "After a stop go on when all has been well for so long; 0: only after ~/resume.",
        ),
        double("rate_hz", 250.0, 10.0, 10_000.0, "Rate of servo_jp, and of looking at what came."),
        Declaration::new(
            "exit_when_done",
            P::Boolean(true),
            Range::Any,
            "End the program at the goal; false: go on following it.",
        )
        .fixed(),
    ]);
    all
}

fn three(value: &P) -> Result<[f64; 3], String> {
    let P::DoubleArray(v) = value else { return Err("is three numbers".to_owned()) };
    let v: [f64; 3] = v.as_slice().try_into().map_err(|_| "is three numbers".to_owned())?;
    if v.iter().all(|x| x.is_finite()) { Ok(v) } else { Err("is three finite numbers".to_owned()) }
}

/// Where the needle is to go.
#[derive(Clone, Copy, Debug)]
pub(super) enum Goal {
    /// m
    Depth(f64),
    /// A target of the twin, by its place in the topic.
    Target(usize),
}

pub(super) fn goal(parameters: &Parameters) -> Goal {
    match usize::try_from(parameters.integer("target_index")) {
        Ok(index) => Goal::Target(index),
        Err(_) => Goal::Depth(parameters.double("goal_depth_m")),
    }
}

/// The line on which the needle moves, frame `sample`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Line {
    entry_m: [f64; 3],
    axis: [f64; 3],
}

impl Line {
    /// Depth of a place along the line, m.
    pub fn depth_m(&self, place: [f64; 3]) -> f64 {
        (0..3).map(|k| (place[k] - self.entry_m[k]) * self.axis[k]).sum()
    }

    /// What of a force is against the insertion, N.
    pub fn against_n(&self, force: [f64; 3]) -> f64 {
        -(0..3).map(|k| force[k] * self.axis[k]).sum::<f64>()
    }
}

pub(super) fn line(parameters: &Parameters) -> Result<Line, String> {
    let array = |name| parameters.get(name).map_or(Err(format!("{name} is missing")), |value| three(&value));
    let (entry_m, axis) = (array("entry_m")?, array("axis")?);
    let length = axis.iter().map(|x| x * x).sum::<f64>().sqrt();
    if length < 1e-9 {
        return Err("axis is a direction and must not be 0, 0, 0".to_owned());
    }
    Ok(Line { entry_m, axis: axis.map(|x| x / length) })
}

pub(super) fn orders(parameters: &Parameters) -> Orders {
    let double = |name| parameters.double(name);
    Orders {
        motion: MotionLimits {
            speed_m_per_s: double("speed_m_per_s"),
            acceleration_m_per_s2: double("max_acceleration_m_per_s2"),
            jerk_m_per_s3: double("max_jerk_m_per_s3"),
        },
        step_s: 1.0 / double("rate_hz"),
        force_limit_n: double("force_limit_n"),
        timeout_s: double("timeout_s"),
        target_timeout_s: double("target_timeout_s"),
        tolerance_m: double("tolerance_m"),
        dwell_s: double("dwell_s"),
        following_error_m: double("following_error_m"),
        slow_factor: double("slow_factor"),
        resume_after_s: double("resume_after_s"),
    }
}
