//! Parameters of the rig node.

use ros2_client::ParameterValue as P;

use crate::rig::{DriverLimits, PlayOptions};
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
        boolean("exit_at_end", true, "End the program when the bag has been played."),
        string("joint_name", "insertion", "Driver: name of the joint in servo_jp and measured_js."),
        double("driver_rate_hz", 1000.0, 1.0, 10_000.0, "Driver: rate of measured_js."),
        double("max_speed_m_per_s", 0.005, 1e-6, 10.0, "Driver: largest speed."),
        double("max_acceleration_m_per_s2", 0.05, 1e-6, 1e3, "Driver: largest acceleration."),
        double("min_position_m", -0.05, -10.0, 10.0, "Driver: lowest position (above the surface is negative)."),
        double("max_position_m", 0.015, -10.0, 10.0, "Driver: highest position."),
        double("start_position_m", 0.0, -10.0, 10.0, "Driver: where it starts."),
    ]);
    all
}

pub(super) fn play_options(parameters: &Parameters) -> PlayOptions {
    PlayOptions {
        rate: parameters.double("rate"),
        looping: parameters.boolean("loop"),
        start_offset: std::time::Duration::try_from_secs_f64(parameters.double("start_offset")).unwrap_or_default(),
        start_paused: parameters.boolean("start_paused"),
        topics: parameters.strings("topics"),
    }
}

pub(super) fn driver_limits(parameters: &Parameters) -> Result<DriverLimits, String> {
    let range_m = [parameters.double("min_position_m"), parameters.double("max_position_m")];
    if range_m[0] >= range_m[1] {
        return Err(format!("min_position_m {} must be below max_position_m {}", range_m[0], range_m[1]));
    }
    Ok(DriverLimits {
        speed_m_per_s: parameters.double("max_speed_m_per_s"),
        acceleration_m_per_s2: parameters.double("max_acceleration_m_per_s2"),
        range_m,
    })
}
