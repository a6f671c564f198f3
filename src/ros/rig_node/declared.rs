//! Parameters of the rig node.

use ros2_client::ParameterValue as P;

use super::driver::{Load, Rig};
use crate::rig::make::RigScene;
use crate::rig::sensors::{DisplacementModel, DisplacementSensor, LoadCell, LoadCellModel};
use crate::rig::{Driver, DriverLimits, ForceSource, MotionLimits, PlayOptions, PositionSource, Stretch};
use crate::ros::parameters::{Declaration, Parameters, Range};
use crate::ros::recorder;
use crate::ros::start::common_declarations;

pub(super) fn declarations() -> Vec<Declaration> {
    let double = |name, default, low, high, text| {
        Declaration::new(name, P::Double(default), Range::Double(low, high), text).fixed()
    };
    let boolean = |name, default, text| Declaration::new(name, P::Boolean(default), Range::Any, text).fixed();
    let string =
        |name, default: &str, text| Declaration::new(name, P::String(default.to_owned()), Range::Any, text).fixed();
    let mut all = common_declarations();
    all.extend(recorder::declarations());
    all.extend([
        string("mode", "player", "player: plays a bag; driver: moves a needle to where servo_jp says.").checked(
            "one of player, driver",
            |value| match value {
                P::String(v) if v == "player" || v == "driver" => Ok(()),
                _ => Err("is player or driver".to_owned()),
            },
        ),
        string("bag", "", "rosbag2 folder or .mcap to play (also the one positional argument)."),
        double("rate", 1.0, 1e-3, 1e3, "Bag seconds per wall second."),
        boolean("loop", false, "Start again at the end."),
        double("start_offset", 0.0, 0.0, 1e9, "Where to start, s from the start of the bag."),
        boolean("start_paused", false, "Wait for ~/resume."),
        double("delay", 0.0, 0.0, 3600.0, "Wait so long before playing, s."),
        double("clock_hz", 100.0, 0.0, 10_000.0, "Rate of /clock; 0: no clock."),
        Declaration::new("topics", P::StringArray(Vec::new()), Range::Any, "Topics to play; empty: all.").fixed(),
        Declaration::new("exclude_topics", P::StringArray(Vec::new()), Range::Any, "Topics not to play.").fixed(),
        double("playback_duration", -1.0, -1.0, 1e9, "Play so long, s of the bag; negative: to the end."),
        double("playback_until_sec", -1.0, -1.0, 1e10, "Play until this bag time, s since 1970; negative: to the end."),
        boolean("exit_at_end", true, "End the program when the bag has been played; false: wait for ~/play or ~/seek."),
        boolean(
            "relative_names",
            true,
            "Play recorded topics under their names relative to this node's namespace (in the root namespace that is \
             the recorded name); false: under the recorded names as they are.",
        ),
        string("joint_name", "insertion", "Name of the joint in servo_jp and measured_js."),
        Declaration::new("seed", P::Integer(1), Range::Integer(0, i64::MAX), "Driver: seed of the sensors' noise.")
            .fixed(),
    ]);
    all.extend(foreign_declarations());
    all.extend(driver_declarations());
    all
}

/// What a needle driver needs said.
fn driver_declarations() -> [Declaration; 13] {
    let double = |name, default, low, high, text| {
        Declaration::new(name, P::Double(default), Range::Double(low, high), text).fixed()
    };
    let string =
        |name, default: &str, text| Declaration::new(name, P::String(default.to_owned()), Range::Any, text).fixed();
    [
        double("driver_rate_hz", 1000.0, 1.0, 10_000.0, "Driver: rate of measured_js."),
        double("max_speed_m_per_s", 0.005, 1e-6, 10.0, "Driver: largest speed."),
        double("max_acceleration_m_per_s2", 0.5, 1e-6, 1e3, "Driver: largest acceleration and deceleration."),
        double("max_jerk_m_per_s3", 100.0, 1e-3, 1e6, "Driver: largest jerk."),
        double("min_position_m", -0.05, -10.0, 10.0, "Driver: lowest position (above the surface is negative)."),
        double("max_position_m", 0.015, -10.0, 10.0, "Driver: highest position."),
        double("start_position_m", 0.0, -10.0, 10.0, "Driver: where it starts."),
        double(
            "command_timeout_s",
            0.05,
            0.0,
            3600.0,
            "Driver: a stream of servo_jp that is silent for longer has ceased, and the motion stops; 0: never. A command \
             that comes alone is gone to.",
        ),
        string(
            "displacement_sensor",
            "ideal",
            "Driver: what measures its position: ideal; or magnetostrictive, with resolution, noise and non-linearity.",
        ),
        string(
            "load_cell",
            "none",
            "Driver: what measures the force: none; ideal; or subminiature, with range, noise, offset and drift.",
        ),
        string(
            "tissue",
            "needle_insertion",
            "Driver: whose independent finite-element force over depth presses on the load cell: needle_insertion, \
             indentation, compression.",
        ),
        Declaration::new(
            "tissue_stiffness",
            P::Double(1.0),
            Range::Double(0.0, 100.0),
            "Driver: factor on the force of the tissue. Can be changed while it runs: tissue that is not as was modelled.",
        ),
        double(
            "sensor_latency_s",
            0.0,
            0.0,
            1.0,
            "Driver: readings leave so long after the moment that their stamp names.",
        ),
    ]
}

/// What a recording of another rig needs said.
fn foreign_declarations() -> [Declaration; 8] {
    let double =
        |name, default, text| Declaration::new(name, P::Double(default), Range::Double(-1e12, 1e12), text).fixed();
    let string =
        |name, default: &str, text| Declaration::new(name, P::String(default.to_owned()), Range::Any, text).fixed();
    [
        string(
            "position_topic",
            "",
            "Recorded topic to play as measured_js: JointState, Range, Float64 or Float32; empty: none.",
        ),
        string("position_joint", "", "Joint of a JointState position_topic; empty: joint_name, or its only one."),
        double(
            "position_m_per_unit",
            1.0,
            "Depth of one unit of position_topic, m (0.001 for mm; negative if the number falls as the needle goes in).",
        ),
        double("position_offset_m", 0.0, "Depth at the number 0 of position_topic, m."),
        string(
            "force_topic",
            "",
            "Recorded topic to play as measured_cf: WrenchStamped, Float64 or Float32; empty: none.",
        ),
        double(
            "force_n_per_unit",
            1.0,
            "Force of one unit of force_topic, N (0.00980665 for gf; negative if the cell counts the force on the tissue).",
        ),
        Declaration::new(
            "force_axis",
            P::DoubleArray(vec![0.0, 0.0, 1.0]),
            Range::Any,
            "Direction in frame `frame_id` along which a Float64 or Float32 force_topic counts.",
        )
        .checked("three numbers, not all 0", |value| direction(value).map(drop))
        .fixed(),
        string("frame_id", "sample", "Frame of measured_cf where the recording has none."),
    ]
}

/// A unit vector.
fn direction(value: &P) -> Result<[f64; 3], String> {
    let fail = || "is three numbers, not all 0".to_owned();
    let P::DoubleArray(v) = value else { return Err(fail()) };
    let v: [f64; 3] = v.as_slice().try_into().map_err(|_| fail())?;
    let norm = v.iter().map(|x| x * x).sum::<f64>().sqrt();
    if norm > 0.0 && norm.is_finite() { Ok(v.map(|x| x / norm)) } else { Err(fail()) }
}

pub(super) fn position_source(parameters: &Parameters) -> Option<PositionSource> {
    Some(PositionSource {
        topic: Some(parameters.string("position_topic")).filter(|t| !t.is_empty())?,
        joint: parameters.string("position_joint"),
        m_per_unit: parameters.double("position_m_per_unit"),
        offset_m: parameters.double("position_offset_m"),
        joint_name: parameters.string("joint_name"),
    })
}

pub(super) fn force_source(parameters: &Parameters) -> Option<ForceSource> {
    Some(ForceSource {
        topic: Some(parameters.string("force_topic")).filter(|t| !t.is_empty())?,
        n_per_unit: parameters.double("force_n_per_unit"),
        axis: parameters.get("force_axis").and_then(|v| direction(&v).ok()).unwrap_or([0.0, 0.0, 1.0]),
        frame_id: parameters.string("frame_id"),
    })
}

pub(super) fn play_options(parameters: &Parameters) -> PlayOptions {
    PlayOptions {
        rate: parameters.double("rate"),
        looping: parameters.boolean("loop"),
        start_offset: std::time::Duration::try_from_secs_f64(parameters.double("start_offset")).unwrap_or_default(),
        start_paused: parameters.boolean("start_paused"),
        topics: parameters.strings("topics"),
        exclude_topics: parameters.strings("exclude_topics"),
        stretch: Stretch {
            duration: std::time::Duration::try_from_secs_f64(parameters.double("playback_duration")).ok(),
            until_ns: nanoseconds(parameters.double("playback_until_sec")),
        },
    }
}

#[allow(clippy::cast_possible_truncation)] // within the parameter's range
fn nanoseconds(seconds: f64) -> Option<i64> {
    (seconds >= 0.0).then_some((seconds * 1e9) as i64)
}

/// The needle driver with its sensors.
pub(super) fn rig(parameters: &Parameters) -> Result<Rig, String> {
    let limits = driver_limits(parameters)?;
    let step_s = 1.0 / parameters.double("driver_rate_hz");
    let seed = u64::try_from(parameters.integer("seed")).unwrap_or(0);
    let displacement = one_of(
        parameters,
        "displacement_sensor",
        &[("ideal", DisplacementModel::IDEAL), ("magnetostrictive", DisplacementModel::MAGNETOSTRICTIVE)],
    )?;
    let cell = one_of(
        parameters,
        "load_cell",
        &[("none", None), ("ideal", Some(LoadCellModel::IDEAL)), ("subminiature", Some(LoadCellModel::SUBMINIATURE))],
    )?;
    let tissue = one_of(parameters, "tissue", &RigScene::ALL.map(|scene| (scene.name(), scene)))?;
    Ok(Rig {
        driver: Driver::new(limits, step_s, parameters.double("start_position_m")),
        displacement: DisplacementSensor::new(displacement, seed),
        load: cell.map(|model| Load {
            cell: LoadCell::new(model, seed),
            tissue: tissue.curve(),
            frame_id: parameters.string("frame_id"),
        }),
        joint: parameters.string("joint_name"),
        period: std::time::Duration::from_secs_f64(step_s),
        latency_s: parameters.double("sensor_latency_s"),
    })
}

/// What a word stands for.
fn one_of<T: Copy>(parameters: &Parameters, name: &str, words: &[(&str, T)]) -> Result<T, String> {
    let given = parameters.string(name);
    words.iter().find(|(word, _)| *word == given).map(|(_, value)| *value).ok_or_else(|| {
        let known: Vec<&str> = words.iter().map(|(word, _)| *word).collect();
        format!("{name} `{given}` must be one of {}", known.join(", "))
    })
}

fn driver_limits(parameters: &Parameters) -> Result<DriverLimits, String> {
    let range_m = [parameters.double("min_position_m"), parameters.double("max_position_m")];
    if range_m[0] >= range_m[1] {
        return Err(format!("min_position_m {} must be below max_position_m {}", range_m[0], range_m[1]));
    }
    Ok(DriverLimits {
        motion: MotionLimits {
            speed_m_per_s: parameters.double("max_speed_m_per_s"),
            acceleration_m_per_s2: parameters.double("max_acceleration_m_per_s2"),
            jerk_m_per_s3: parameters.double("max_jerk_m_per_s3"),
        },
        range_m,
        command_timeout_s: parameters.double("command_timeout_s"),
    })
}
