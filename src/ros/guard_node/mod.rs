//! The guard as a ROS 2 node: `needle_twin guard`.
//!
//! ```text
//! measured_js, predicted_cf, safety, status, targets, /clock ──► control thread ──► servo_jp
//! housekeeping thread: ~/resume, parameters, discovery, diagnostics        main thread: signals
//! ```
//! It is a process of its own, so that it outlives the twin and detects that the twin has ended. The driver detects the end of
//! the guard, since it stops when a stream of `servo_jp` ceases.

mod control;
mod declared;
mod housekeeping;

use std::ffi::OsString;
use std::sync::Arc;
use std::time::Duration;

use clap::Parser;

use self::control::{Endpoints, Shared, Task};
use self::housekeeping::Housekeeping;
use super::own_arguments;
use named_threads::{join, spawn};
use needle_guard::Guard;
use ros2_guarded::signals::Signals;
use ros2_node::parameters::Parameters;
use ros2_node::recorder::{Recorder, Recording};
use ros2_node::start::{self, LOSSES, NodeError, SUCCESS, Start};

#[derive(Parser, Debug)]
#[command(
    name = "needle_twin guard",
    about = "Inserts the needle to a depth or to a moving target, watches the twin's prediction, and stops when something is lost or out of bounds (a ROS 2 node)",
    after_help = "ROS arguments: --ros-args [-r from:=to] [-r __ns:=/ns] [-p name:=value] [--params-file FILE] [--]\n\
                  Parameters: goal_depth_m, or target_index with entry_m and axis; speed_m_per_s, force_limit_n, timeout_s,\n    \
                  resume_after_s, ... (`ros2 param describe /guard NAME`).\n\
                  Exit codes: 0 arrived or stopped by a signal, 1 failure, 2 wrong usage, 3 the recording has losses."
)]
struct Cli {}

/// Runs the guard until it has arrived, or until SIGINT or SIGTERM, and returns the program's exit code. `arguments`
/// does not include the program name.
#[must_use]
pub(crate) fn run(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    start::run("needle_twin guard", ["guard", env!("CARGO_CRATE_NAME")], arguments, guard)
}

fn guard(mut start: Start, signals: &Signals) -> Result<u8, NodeError> {
    if let Err(code) = own_arguments::<Cli>("needle_twin guard", &mut start) {
        return Ok(code);
    }
    let parameters = start.declare(declared::declarations())?;
    let orders = declared::orders(&parameters);
    let task = Task {
        guard: Guard::new(orders),
        goal: declared::goal(&parameters),
        line: declared::line(&parameters).map_err(NodeError::Usage)?,
        region: declared::region(&parameters),
        joint: parameters.get(declared::JOINT_NAME),
        period: Duration::from_secs_f64(orders.step_s),
        exit_when_done: parameters.get(declared::EXIT_WHEN_DONE),
    };
    tracing::info!(
        "brakes from {:.4} m/s in {:.1} ms, {:.1} ms after the last word of what it needs",
        orders.motion.speed_m_per_s,
        1e3 * orders.motion.braking_time_s(),
        1e3 * orders.timeout_s
    );
    work(start, &parameters, task, signals)
}

fn work(mut start: Start, parameters: &Arc<Parameters>, task: Task, signals: &Signals) -> Result<u8, NodeError> {
    let mut participant = start.participant(parameters)?;
    participant.set_recorder(Recorder::create(parameters)?);
    let endpoints = Endpoints::new(&mut participant, task.guard.orders(), parameters.get(start::USE_SIM_TIME))?;
    let housekeeping = Housekeeping::new(&mut participant, parameters)?;
    let recording = start.join(&mut participant, parameters)?;
    let shared = Arc::new(Shared::default());
    let (stop, stopped) = crossbeam_channel::bounded::<()>(0);
    let (stop_housekeeping, housekeeping_stopped) = crossbeam_channel::bounded::<()>(0);
    let (done, finished) = crossbeam_channel::bounded(1);
    let control = {
        let shared = Arc::clone(&shared);
        spawn("control", move || {
            // Fails only if the node has already ended.
            let _ = done.send(control::run(task, &endpoints, &shared, &stopped));
        })?
    };
    let health = participant.health();
    let seen = Arc::clone(&shared);
    let keeper =
        spawn("housekeeping", move || housekeeping.run(&shared, &start.rosout, &health, &housekeeping_stopped))?;
    let failed = loop {
        if let Some(signal) = signals.wait(Duration::from_millis(20)) {
            tracing::info!("stopping ({signal:?})");
            break None;
        }
        if control.is_finished() {
            let gone = "the control thread has ended unexpectedly".to_owned();
            break finished.try_recv().unwrap_or(Err(gone)).err();
        }
        if keeper.is_finished() {
            break Some("the housekeeping thread has ended unexpectedly".to_owned());
        }
    };
    drop(stop);
    join(control);
    if let Some(report) = seen.report() {
        // the last line of the log says how it ended
        tracing::info!("ended {}", report.words());
    }
    drop(stop_housekeeping);
    join(keeper);
    drop(participant);
    let missing = recording.map_or(0, Recording::finish);
    match failed {
        Some(reason) => Err(NodeError::Other(reason)),
        None => Ok(if missing > 0 { LOSSES } else { SUCCESS }),
    }
}
