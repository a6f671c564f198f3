//! Parameters of the rig node.

use ros2_client::ParameterValue as P;

use needle_recording::{ForceSource, PositionSource};
use needle_rig::make::{Curve, RigScene};
use needle_rig::sensors::{DisplacementModel, DisplacementSensor, LoadCell, LoadCellModel};
use needle_rig::{Driver, DriverLimits, MotionLimits, PlayOptions, Stretch};
use ros2_node::parameter::{Parameter, Typed, parameters};
use ros2_node::parameters::{Declaration, Parameters};
use ros2_node::recorder;
use ros2_node::start::common_declarations;

parameters! {
    /// What both modes need said.
    own:

    MODE: String = Parameter::new(
        "mode",
        "player",
        "player: plays a bag; driver: moves a needle to where servo_jp says.",
    )
    .checked(
    "one of player, driver",
    |value| match value {
        P::String(v) if v == "player" || v == "driver" => Ok(()),
        _ => Err("is player or driver".to_owned()),
    },
        )
    .fixed();
    BAG: String = Parameter::new(
        "bag",
        "",
        "rosbag2 folder or .mcap to play (also the one positional argument).",
    )
    .fixed();
    RATE: f64 = Parameter::real("rate", 1.0, [1e-3, 1e3], "Bag seconds per wall second.");
    LOOP: bool = Parameter::new("loop", false, "Start again at the end.").fixed();
    START_OFFSET: f64 = Parameter::real(
        "start_offset",
        0.0,
        [0.0, 1e9],
        "Where to start, s from the start of the bag.",
    )
    .fixed();
    START_PAUSED: bool = Parameter::new("start_paused", false, "Wait for ~/resume.").fixed();
    DELAY: f64 = Parameter::real("delay", 0.0, [0.0, 3600.0], "Wait so long before playing, s.").fixed();
    CLOCK_HZ: f64 = Parameter::real("clock_hz", 100.0, [0.0, 10_000.0], "Rate of /clock; 0: no clock.").fixed();
    TOPICS: Vec<String> = Parameter::new("topics", [], "Topics to play; empty: all, but of /tf not needle_tip, which the twin publishes.").fixed();
    EXCLUDE_TOPICS: Vec<String> = Parameter::new("exclude_topics", [], "Topics not to play.").fixed();
    PLAYBACK_DURATION: f64 = Parameter::real(
        "playback_duration",
        -1.0,
        [-1.0, 1e9],
        "Play so long, s of the bag; negative: to the end.",
    )
    .fixed();
    PLAYBACK_UNTIL_SEC: f64 = Parameter::real(
        "playback_until_sec",
        -1.0,
        [-1.0, 1e10],
        "Play until this bag time, s since 1970; negative: to the end.",
    )
    .fixed();
    EXIT_AT_END: bool = Parameter::new(
        "exit_at_end",
        true,
        "End the program when the bag has been played; false: wait for ~/play or ~/seek.",
    )
    .fixed();
    RELATIVE_NAMES: bool = Parameter::new(
        "relative_names",
        true,
        "Play recorded topics under their names relative to this node's namespace (in the root namespace that is the \
         recorded name); false: under the recorded names as they are.",
    )
    .fixed();
    JOINT_NAME: String = Parameter::new(
        "joint_name",
        "insertion",
        "Name of the joint in servo_jp and measured_js.",
    )
    .fixed();
    SEED: i64 = Parameter::integer("seed", 1, [0, i64::MAX], "Driver: seed of the sensors' noise.").fixed();
}

parameters! {
    /// What a needle driver needs said.
    of_driver:

    DRIVER_RATE_HZ: f64 = Parameter::real(
        "driver_rate_hz",
        1000.0,
        [1.0, 10_000.0],
        "Driver: rate of measured_js.",
    )
    .fixed();
    MAX_SPEED_M_PER_S: f64 = Parameter::real(
        "max_speed_m_per_s",
        0.005,
        [1e-6, 10.0],
        "Driver: largest speed.",
    )
    .fixed();
    MAX_ACCELERATION_M_PER_S2: f64 = Parameter::real(
        "max_acceleration_m_per_s2",
        0.5,
        [1e-6, 1e3],
        "Driver: largest acceleration and deceleration.",
    )
    .fixed();
    MAX_JERK_M_PER_S3: f64 = Parameter::real("max_jerk_m_per_s3", 100.0, [1e-3, 1e6], "Driver: largest jerk.").fixed();
    MIN_POSITION_M: f64 = Parameter::real(
        "min_position_m",
        -0.05,
        [-10.0, 10.0],
        "Driver: lowest position (above the surface is negative).",
    )
    .fixed();
    MAX_POSITION_M: f64 = Parameter::real("max_position_m", 0.015, [-10.0, 10.0], "Driver: highest position.").fixed();
    START_POSITION_M: f64 = Parameter::real("start_position_m", 0.0, [-10.0, 10.0], "Driver: where it starts.").fixed();
    COMMAND_TIMEOUT_S: f64 = Parameter::real(
        "command_timeout_s",
        0.05,
        [0.0, 3600.0],
        "Driver: a stream of servo_jp that is silent for longer has ceased, and the motion stops; 0: never. A command \
         that comes alone is gone to.",
    )
    .fixed();
    DISPLACEMENT_SENSOR: String = Parameter::new(
        "displacement_sensor",
        "ideal",
        "Driver: what measures its position: ideal; or magnetostrictive, with resolution, noise and non-linearity.",
    )
    .fixed();
    LOAD_CELL: String = Parameter::new(
        "load_cell",
        "none",
        "Driver: what measures the force: none; ideal; or subminiature, with range, noise, offset and drift.",
    )
    .fixed();
    TISSUE: String = Parameter::new(
        "tissue",
        "needle_insertion",
        "Driver: whose independent finite-element force over depth presses on the load cell: needle_insertion, \
         indentation, compression.",
    )
    .fixed();
    TISSUE_STIFFNESS: f64 = Parameter::real(
        "tissue_stiffness",
        1.0,
        [0.0, 100.0],
        "Driver: factor on the force of the tissue. Can be changed while it runs: tissue that is not as was modelled.",
    );
    SENSOR_LATENCY_S: f64 = Parameter::real(
        "sensor_latency_s",
        0.0,
        [0.0, 1.0],
        "Driver: readings leave so long after the moment that their stamp names.",
    )
    .fixed();
}

parameters! {
    /// What a recording of another rig needs said.
    of_foreign:

    POSITION_TOPIC: String = Parameter::new(
        "position_topic",
        "",
        "Recorded topic to play as measured_js: JointState, Range, Float64, Float32, or /name[INDEX] of a Float64MultiArray; empty: none.",
    )
    .fixed();
    POSITION_JOINT: String = Parameter::new(
        "position_joint",
        "",
        "Joint of a JointState position_topic; empty: joint_name, or its only one.",
    )
    .fixed();
    POSITION_M_PER_UNIT: f64 = Parameter::real(
        "position_m_per_unit",
        1.0,
        [-1e12, 1e12],
        "Depth of one unit of position_topic, m (0.001 for mm; negative if the number falls as the needle goes in).",
    )
    .fixed();
    POSITION_OFFSET_M: f64 = Parameter::real(
        "position_offset_m",
        0.0,
        [-1e12, 1e12],
        "Depth at the number 0 of position_topic, m.",
    )
    .fixed();
    FORCE_TOPIC: String = Parameter::new(
        "force_topic",
        "",
        "Recorded topic to play as measured_cf: WrenchStamped, Float64, Float32, or /name[INDEX] of a Float64MultiArray; empty: none.",
    )
    .fixed();
    FORCE_N_PER_UNIT: f64 = Parameter::real(
        "force_n_per_unit",
        1.0,
        [-1e12, 1e12],
        "Force of one unit of force_topic, N (0.00980665 for gf; negative if the cell counts the force on the tissue).",
    )
    .fixed();
    FORCE_AXIS: [f64; 3] = Parameter::new(
        "force_axis",
        [0.0, 0.0, 1.0],
        "Direction in frame `frame_id` along which a Float64 or Float32 force_topic counts.",
    )
    .checked("three numbers, not all 0", is_direction)
    .fixed();
    FRAME_ID: String = Parameter::new(
        "frame_id",
        "sample",
        "Frame of measured_cf where the recording has none.",
    )
    .fixed();
}

pub(super) fn declarations() -> Vec<Declaration> {
    let mut all = common_declarations();
    all.extend(recorder::declarations());
    all.extend(own());
    all.extend(of_foreign());
    all.extend(of_driver());
    all
}

/// A unit vector.
fn direction(v: [f64; 3]) -> Result<[f64; 3], String> {
    let norm = v.iter().map(|x| x * x).sum::<f64>().sqrt();
    if norm > 0.0 && norm.is_finite() { Ok(v.map(|x| x / norm)) } else { Err("is three numbers, not all 0".to_owned()) }
}

fn is_direction(value: &P) -> Result<(), String> {
    direction(Typed::of(value).unwrap_or_default()).map(drop)
}

pub(super) fn position_source(parameters: &Parameters) -> Option<PositionSource> {
    Some(PositionSource {
        topic: Some(parameters.get(POSITION_TOPIC)).filter(|t| !t.is_empty())?,
        joint: parameters.get(POSITION_JOINT),
        m_per_unit: parameters.get(POSITION_M_PER_UNIT),
        offset_m: parameters.get(POSITION_OFFSET_M),
        joint_name: parameters.get(JOINT_NAME),
    })
}

pub(super) fn force_source(parameters: &Parameters) -> Option<ForceSource> {
    Some(ForceSource {
        topic: Some(parameters.get(FORCE_TOPIC)).filter(|t| !t.is_empty())?,
        n_per_unit: parameters.get(FORCE_N_PER_UNIT),
        axis: direction(parameters.get(FORCE_AXIS)).unwrap_or([0.0, 0.0, 1.0]),
        frame_id: parameters.get(FRAME_ID),
    })
}

pub(super) fn play_options(parameters: &Parameters) -> PlayOptions {
    PlayOptions {
        rate: parameters.get(RATE),
        looping: parameters.get(LOOP),
        start_offset: std::time::Duration::try_from_secs_f64(parameters.get(START_OFFSET)).unwrap_or_default(),
        start_paused: parameters.get(START_PAUSED),
        topics: parameters.get(TOPICS),
        exclude_topics: parameters.get(EXCLUDE_TOPICS),
        stretch: Stretch {
            duration: std::time::Duration::try_from_secs_f64(parameters.get(PLAYBACK_DURATION)).ok(),
            until_ns: nanoseconds(parameters.get(PLAYBACK_UNTIL_SEC)),
        },
    }
}

#[allow(clippy::cast_possible_truncation)] // within the parameter's range
fn nanoseconds(seconds: f64) -> Option<i64> {
    (seconds >= 0.0).then_some((seconds * 1e9) as i64)
}

/// A load cell, and the tissue that loads it.
pub(super) struct Load {
    pub cell: LoadCell,
    /// Force over depth during insertion, from `bags/reference/`.
    pub tissue: Curve,
    pub frame_id: String,
}

/// The needle and its sensors.
pub(super) struct Rig {
    pub driver: Driver,
    pub displacement: DisplacementSensor,
    pub load: Option<Load>,
    pub joint: String,
    pub period: std::time::Duration,
    pub latency_s: f64,
}

/// The needle driver with its sensors.
pub(super) fn rig(parameters: &Parameters) -> Result<Rig, String> {
    let limits = driver_limits(parameters)?;
    let step_s = 1.0 / parameters.get(DRIVER_RATE_HZ);
    let seed = u64::try_from(parameters.get(SEED)).unwrap_or(0);
    let displacement = one_of(
        parameters,
        DISPLACEMENT_SENSOR,
        &[("ideal", DisplacementModel::IDEAL), ("magnetostrictive", DisplacementModel::MAGNETOSTRICTIVE)],
    )?;
    let cell = one_of(
        parameters,
        LOAD_CELL,
        &[("none", None), ("ideal", Some(LoadCellModel::IDEAL)), ("subminiature", Some(LoadCellModel::SUBMINIATURE))],
    )?;
    let tissue = one_of(parameters, TISSUE, &RigScene::ALL.map(|scene| (scene.name(), scene)))?;
    Ok(Rig {
        driver: Driver::new(limits, step_s, parameters.get(START_POSITION_M)),
        displacement: DisplacementSensor::new(displacement, seed),
        load: cell.map(|model| Load {
            cell: LoadCell::new(model, seed),
            tissue: tissue.curve(),
            frame_id: parameters.get(FRAME_ID),
        }),
        joint: parameters.get(JOINT_NAME),
        period: std::time::Duration::from_secs_f64(step_s),
        latency_s: parameters.get(SENSOR_LATENCY_S),
    })
}

/// The value that a word of a parameter stands for.
fn one_of<T: Copy>(parameters: &Parameters, parameter: Parameter<String>, words: &[(&str, T)]) -> Result<T, String> {
    let given = parameters.get(parameter);
    words.iter().find(|(word, _)| *word == given).map(|(_, value)| *value).ok_or_else(|| {
        let known: Vec<&str> = words.iter().map(|(word, _)| *word).collect();
        format!("{} `{given}` must be one of {}", parameter.name(), known.join(", "))
    })
}

fn driver_limits(parameters: &Parameters) -> Result<DriverLimits, String> {
    let range_m = [parameters.get(MIN_POSITION_M), parameters.get(MAX_POSITION_M)];
    if range_m[0] >= range_m[1] {
        return Err(format!("min_position_m {} must be below max_position_m {}", range_m[0], range_m[1]));
    }
    Ok(DriverLimits {
        motion: MotionLimits {
            speed_m_per_s: parameters.get(MAX_SPEED_M_PER_S),
            acceleration_m_per_s2: parameters.get(MAX_ACCELERATION_M_PER_S2),
            jerk_m_per_s3: parameters.get(MAX_JERK_M_PER_S3),
        },
        range_m,
        command_timeout_s: parameters.get(COMMAND_TIMEOUT_S),
    })
}
