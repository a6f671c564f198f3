//! Parameters of the twin node.

use ros2_client::ParameterValue as P;

use super::identification;
use crate::ros::parameters::{Declaration, Parameters, Range};
use crate::ros::recorder;
use crate::ros::start::common_declarations;

/// Everything but the scene's keys: a table, one entry per parameter.
pub(super) fn declarations() -> Vec<Declaration> {
    let double =
        |name, default, low, high, text| Declaration::new(name, P::Double(default), Range::Double(low, high), text);
    let string = |name, default: &str, text| Declaration::new(name, P::String(default.to_owned()), Range::Any, text);
    let mut all = common_declarations();
    all.extend(recorder::declarations());
    all.extend([
        string("scene", "needle_insertion", "Scene: the name of a preset, or a path to a scene file.").fixed(),
        string("joint_name", "insertion", "Joint of measured_js whose position is the depth, m."),
        string("frame_id", "sample", "Frame of the outputs, and the one that measured_cp must be in.").fixed(),
        double(
            "tissue_rate_hz",
            20.0,
            0.0,
            1000.0,
            "Rate of tissue_state, tissue_points, tissue_surface and targets; 0: never.",
        ),
        double("status_rate_hz", 10.0, 0.1, 1000.0, "Rate of status."),
        double(
            "input_timeout_s",
            0.5,
            0.01,
            3600.0,
            "Without a pose for so long the input counts as lost; an answer later than this is withheld.",
        ),
        double(
            "solver_timeout_s",
            10.0,
            0.5,
            3600.0,
            "A solver that does not come back from a pose for so long ends the node with exit code 1.",
        ),
        double(
            "max_pose_age_s",
            0.0,
            0.0,
            3600.0,
            "Poses whose stamp is older than this are refused; 0: not checked (stamps of a recorded bag are old).",
        ),
        double(
            "tolerance",
            0.0,
            0.0,
            0.999,
            "Tolerated relative error of the force from too few steps (stepping.tolerance); 0: the scene's own.",
        )
        .fixed(),
        Declaration::new("threads", P::Integer(0), Range::Integer(0, 1024), "Threads of the solver; 0: one per core.")
            .fixed(),
        double(
            "load_cell_range_n",
            0.0,
            0.0,
            1e6,
            "Readings of measured_cf at or beyond this count as saturated, N; 0: not checked.",
        ),
        double("guard_rate_hz", 100.0, 1.0, 1000.0, "Rate of safe_to_go_on."),
        double(
            "guard_timeout_s",
            0.025,
            0.001,
            3600.0,
            "safe_to_go_on is false without a pose that came and was answered within this time.",
        ),
        double(
            "residual_band_n",
            0.0,
            0.0,
            1e6,
            "safe_to_go_on is false unless the load cell speaks and predicted and measured force differ by less, N; \
             beyond half of it the health is WARN. 0: the load cell is not asked.",
        ),
        Declaration::new(
            "look_ahead",
            P::Boolean(true),
            Range::Any,
            "Keep a double of the model, with which ~/look_ahead answers; false: save its memory.",
        )
        .fixed(),
        Declaration::new(
            "identify",
            P::StringArray(Vec::new()),
            Range::Any,
            "What is identified from the load cell while the node runs, published in comparison; empty: nothing.",
        )
        .checked(
            "material.shear_modulus_pa, instrument.deformation_coefficient, load_cell.offset_n",
            identification::check,
        )
        .fixed(),
        string("hardware_id", "needle_twin", "hardware_id of the diagnostics."),
        Declaration::new(
            "autostart",
            P::Boolean(true),
            Range::Any,
            "Configure and activate the node at its start; false: leave that to a lifecycle manager.",
        )
        .fixed(),
    ]);
    all
}

/// What the threads need of the parameters, read once per change.
#[derive(Clone, Debug)]
pub(super) struct Settings {
    pub joint_name: String,
    pub tissue_rate_hz: f64,
    pub status_rate_hz: f64,
    pub input_timeout_s: f64,
    pub solver_timeout_s: f64,
    pub max_pose_age_s: f64,
    pub load_cell_range_n: f64,
    pub guard_rate_hz: f64,
    pub guard_timeout_s: f64,
    pub residual_band_n: f64,
    pub hardware_id: String,
}

impl Settings {
    pub fn of(parameters: &Parameters) -> Self {
        Self {
            joint_name: parameters.string("joint_name"),
            tissue_rate_hz: parameters.double("tissue_rate_hz"),
            status_rate_hz: parameters.double("status_rate_hz"),
            input_timeout_s: parameters.double("input_timeout_s"),
            solver_timeout_s: parameters.double("solver_timeout_s"),
            max_pose_age_s: parameters.double("max_pose_age_s"),
            load_cell_range_n: parameters.double("load_cell_range_n"),
            guard_rate_hz: parameters.double("guard_rate_hz"),
            guard_timeout_s: parameters.double("guard_timeout_s"),
            residual_band_n: parameters.double("residual_band_n"),
            hardware_id: parameters.string("hardware_id"),
        }
    }
}
