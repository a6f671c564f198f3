//! Parameters of the twin node.

use std::net::IpAddr;

use super::identification;
use needle_recording::{POSES, WRENCHES};
use ros2_client::ParameterValue;
use ros2_messages::RosMessage as _;
use ros2_messages::geometry_msgs::{PoseStamped, WrenchStamped};
use ros2_node::parameter::{Parameter, parameters};
use ros2_node::parameters::{Declaration, Parameters};
use ros2_node::recorder;
use ros2_node::start::common_declarations;

parameters! {
    /// The node's own.
    own:

    SCENE: String = Parameter::new(
        "scene",
        "needle_insertion",
        "Scene: the name of a preset, or a path to a scene file.",
    )
    .fixed();
    JOINT_NAME: String = Parameter::new(
        "joint_name",
        "insertion",
        "Joint of measured_js whose position is the depth, m; of transforms the frame of the tip.",
    );
    FRAME_ID: String = Parameter::new(
        "frame_id",
        "sample",
        "Frame of the outputs, and the one that measured_cp must be in.",
    )
    .fixed();
    MEASURED_CP_TYPE: String = Parameter::new(
        "measured_cp_type",
        PoseStamped::TYPE,
        "Type of measured_cp; with a point the instrument points straight down.",
    )
    .checked("PoseStamped, TransformStamped, PoseWithCovarianceStamped or PointStamped of geometry_msgs/msg", |v| is_one(v, &POSES))
    .fixed();
    MEASURED_CF_TYPE: String = Parameter::new("measured_cf_type", WrenchStamped::TYPE, "Type of measured_cf.")
        .checked("WrenchStamped or Wrench of geometry_msgs/msg", |v| is_one(v, &WRENCHES))
        .fixed();
    TIME_OFFSET_S: f64 = Parameter::real(
        "time_offset_s",
        0.0,
        [-1e9, 1e9],
        "How far the stamps of measured_cf are ahead of those of the poses: subtracted from them, s.",
    );
    PUBLISH_TF: bool = Parameter::new(
        "publish_tf",
        true,
        "Publish /tf_static and /tf: frame_id in parent_frame_id, needle_tip in frame_id, load_cell in needle_tip.",
    )
    .fixed();
    PARENT_FRAME_ID: String = Parameter::new(
        "parent_frame_id",
        "world",
        "Frame in which frame_id is published, at its origin, with publish_tf; empty: somebody else says where the sample is.",
    )
    .fixed();
    TISSUE_RATE_HZ: f64 = Parameter::real(
        "tissue_rate_hz",
        20.0,
        [0.0, 1000.0],
        "Rate of tissue_state, tissue_points, tissue_surface and targets; 0: never.",
    );
    STATUS_RATE_HZ: f64 = Parameter::real("status_rate_hz", 10.0, [0.1, 1000.0], "Rate of status.");
    INPUT_TIMEOUT_S: f64 = Parameter::real(
        "input_timeout_s",
        0.5,
        [0.01, 3600.0],
        "Without a pose for so long the input counts as lost; an answer later than this is withheld.",
    );
    SOLVER_TIMEOUT_S: f64 = Parameter::real(
        "solver_timeout_s",
        10.0,
        [0.5, 3600.0],
        "A solver that does not come back from a pose for so long ends the node with exit code 1.",
    );
    MAX_POSE_AGE_S: f64 = Parameter::real(
        "max_pose_age_s",
        0.0,
        [0.0, 3600.0],
        "Poses whose stamp is older than this are refused; 0: not checked (stamps of a recorded bag are old).",
    );
    TOLERANCE: f64 = Parameter::real(
        "tolerance",
        0.0,
        [0.0, 0.999],
        "Tolerated relative error of the force from too few steps (stepping.tolerance); 0: the scene's own.",
    )
    .fixed();
    THREADS: i64 = Parameter::integer("threads", 0, [0, 1024], "Threads of the solver; 0: one per core.").fixed();
    LOAD_CELL_RANGE_N: f64 = Parameter::real(
        "load_cell_range_n",
        0.0,
        [0.0, 1e6],
        "Readings of measured_cf at or beyond this count as saturated, N; 0: not checked.",
    );
    GUARD_RATE_HZ: f64 = Parameter::real("guard_rate_hz", 100.0, [1.0, 1000.0], "Rate of safety and safe_to_go_on.");
    GUARD_TIMEOUT_S: f64 = Parameter::real(
        "guard_timeout_s",
        0.025,
        [0.001, 3600.0],
        "safety is a no without a pose that was measured, by its stamp, came and was answered within this time; the same of a \
         reading of the load cell where residual_band_n asks it, and of /clock with use_sim_time.",
    );
    RESIDUAL_BAND_N: f64 = Parameter::real(
        "residual_band_n",
        0.0,
        [0.0, 1e6],
        "safety is a no unless the load cell speaks and predicted and measured force differ by less, N, as vectors; torques, where \
         they are measured, by less than this at the length of the sample. Beyond half of it the health is WARN. 0: the load cell is \
         not asked.",
    );
    FORCE_LIMIT_N: f64 = Parameter::real(
        "force_limit_n",
        0.0,
        [0.0, 1e6],
        "safety is a no from this predicted or measured force on, N. 0: no limit.",
    );
    LOOK_AHEAD: bool = Parameter::new(
        "look_ahead",
        true,
        "Keep a double of the model, with which ~/look_ahead answers; false: save its memory.",
    )
    .fixed();
    IDENTIFY: Vec<String> = Parameter::new(
        "identify",
        [],
        "What is identified from the load cell while the node runs, published in comparison; empty: nothing.",
    )
    .checked("material.shear_modulus_pa, instrument.deformation_coefficient, load_cell.offset_n", identification::check)
    .fixed();
    MEMBERS: i64 = Parameter::integer(
        "members",
        0,
        [0, 1024],
        "Twins with values of the keys in the scene's [uncertainty], for prediction_band, targets_with_covariance and outlook; 0: none.",
    )
    .fixed();
    OUTLOOK_M: f64 = Parameter::real(
        "outlook_m",
        1e-3,
        [2e-5, 0.1],
        "How far every member looks ahead for the topic outlook, m.",
    );
    HARDWARE_ID: String = Parameter::new("hardware_id", "needle_twin", "hardware_id of the diagnostics.");
    AUTOSTART: bool = Parameter::new(
        "autostart",
        true,
        "Configure and activate the node at its start; false: leave that to a lifecycle manager.",
    )
    .fixed();
    PAGE: bool = Parameter::new("page", false, "Serve the live page: the run in a browser, while it happens.").fixed();
    PAGE_PORT: i64 = Parameter::integer("page_port", 8080, [0, 65535], "Port of the live page; 0: any that is free.").fixed();
    PAGE_ADDRESS: String = Parameter::new(
        "page_address",
        "127.0.0.1",
        "Address of this machine that the live page is served at; any but the loopback's opens it to a network.",
    )
    .checked("an IP address, such as 127.0.0.1, ::1 or 0.0.0.0", is_address)
    .fixed();
    OPENIGTLINK: bool = Parameter::new("openigtlink", false, "Show instrument, surface and targets by OpenIGTLink, to 3D Slicer for instance.").fixed();
    OPENIGTLINK_PORT: i64 = Parameter::integer("openigtlink_port", 18944, [0, 65535], "Port of OpenIGTLink; 0: any that is free.").fixed();
    OPENIGTLINK_ADDRESS: String = Parameter::new(
        "openigtlink_address",
        "127.0.0.1",
        "Address of this machine that OpenIGTLink is served at; any but the loopback's opens it to a network.",
    )
    .checked("an IP address, such as 127.0.0.1, ::1 or 0.0.0.0", is_address)
    .fixed();
}

fn is_one(value: &ParameterValue, types: &[&str]) -> Result<(), String> {
    match value {
        ParameterValue::String(v) if types.contains(&v.as_str()) => Ok(()),
        _ => Err(format!("is one of {}", types.join(", "))),
    }
}

fn is_address(value: &ParameterValue) -> Result<(), String> {
    match value {
        ParameterValue::String(v) if v.parse::<IpAddr>().is_ok() => Ok(()),
        _ => Err("is an IP address, such as 127.0.0.1, ::1 or 0.0.0.0".to_owned()),
    }
}

/// All declarations except the scene's keys.
pub(super) fn declarations() -> Vec<Declaration> {
    let mut all = common_declarations();
    all.extend(recorder::declarations());
    all.extend(own());
    all
}

/// Parameters used by the threads, read once per change.
#[derive(Clone, Debug)]
pub(super) struct Settings {
    pub joint_name: String,
    pub time_offset_s: f64,
    pub tissue_rate_hz: f64,
    pub status_rate_hz: f64,
    pub input_timeout_s: f64,
    pub solver_timeout_s: f64,
    pub max_pose_age_s: f64,
    pub load_cell_range_n: f64,
    pub guard_rate_hz: f64,
    pub guard_timeout_s: f64,
    pub residual_band_n: f64,
    pub force_limit_n: f64,
    pub outlook_m: f64,
    pub hardware_id: String,
}

impl Settings {
    pub(crate) fn of(parameters: &Parameters) -> Self {
        Self {
            joint_name: parameters.get(JOINT_NAME),
            time_offset_s: parameters.get(TIME_OFFSET_S),
            tissue_rate_hz: parameters.get(TISSUE_RATE_HZ),
            status_rate_hz: parameters.get(STATUS_RATE_HZ),
            input_timeout_s: parameters.get(INPUT_TIMEOUT_S),
            solver_timeout_s: parameters.get(SOLVER_TIMEOUT_S),
            max_pose_age_s: parameters.get(MAX_POSE_AGE_S),
            load_cell_range_n: parameters.get(LOAD_CELL_RANGE_N),
            guard_rate_hz: parameters.get(GUARD_RATE_HZ),
            guard_timeout_s: parameters.get(GUARD_TIMEOUT_S),
            residual_band_n: parameters.get(RESIDUAL_BAND_N),
            force_limit_n: parameters.get(FORCE_LIMIT_N),
            outlook_m: parameters.get(OUTLOOK_M),
            hardware_id: parameters.get(HARDWARE_ID),
        }
    }
}
