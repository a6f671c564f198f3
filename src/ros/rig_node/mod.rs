//! The simulated rig as a ROS 2 node: plays a recording, or moves a needle.

mod declared;
mod driver;
mod housekeeping;
mod outputs;
mod playback;

use std::ffi::OsString;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use clap::Parser;
use crossbeam_channel::{Receiver, Sender};

use self::housekeeping::Housekeeping;
use self::outputs::{Outputs, Wishes};
use self::playback::{Command, Report};
use super::own_arguments;
use named_threads::{join, spawn};
use needle_rig::Player;
use ros2_guarded::signals::Signals;
use ros2_node::clock::NodeClock;
use ros2_node::parameters::Parameters;
use ros2_node::participant::Participant;
use ros2_node::recorder::{Recorder, Recording};
use ros2_node::start::{self, LOSSES, NodeError, SUCCESS, Start};
use rosbag2_mcap::BagReader;

/// Time after the end of the bag during which lost messages are sent again to reliable readers.
const LINGER: Duration = Duration::from_millis(500);

#[derive(Parser, Debug)]
#[command(
    name = "rig_node",
    version,
    about = "The simulated rig as a ROS 2 node: plays a rosbag2 recording, or moves a needle (-p mode:=driver)",
    after_help = "ROS arguments: --ros-args [-r from:=to] [-r __ns:=/ns] [-r __node:=name] [-p name:=value]\n    \
                  [--params-file FILE] [--log-level LEVEL] [--]\n\
                  Parameters as in `ros2 bag play`: rate, loop, start_offset, start_paused, delay, clock_hz, topics,\n    \
                  exclude_topics, playback_duration, playback_until_sec. A recording of another rig:\n    \
                  position_topic, position_m_per_unit, force_topic, force_n_per_unit, ...\n\
                  Exit codes: 0 stopped or played, 1 failure, 2 wrong usage, 3 played, but the bag has losses."
)]
struct Cli {
    /// rosbag2 folder or .mcap to play (also the parameter `bag`).
    bag: Option<String>,
}

/// Runs the node until the end of the playback, or until SIGINT or SIGTERM, and returns the program's exit code.
/// `arguments` does not include the program name.
#[must_use]
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    start::run("rig_node", ["rig", env!("CARGO_CRATE_NAME")], arguments, rig)
}

fn rig(mut start: Start, signals: &Signals) -> Result<u8, NodeError> {
    let cli: Cli = match own_arguments("rig_node", &mut start) {
        Ok(cli) => cli,
        Err(code) => return Ok(code),
    };
    if let Some(bag) = cli.bag {
        start.set(declared::BAG, bag, "argument BAG");
    }
    let parameters = start.declare(declared::declarations())?;
    if parameters.get(start::USE_SIM_TIME) {
        tracing::warn!("use_sim_time has no effect on the rig, which makes the time: leave it out");
    }
    if parameters.get(declared::MODE) == "driver" {
        drive(start, &parameters, signals)
    } else {
        let player = open(&parameters)?;
        play(start, &parameters, player, signals)
    }
}

/// Opens the bag and logs its irregularities.
fn open(parameters: &Parameters) -> Result<Player, NodeError> {
    let path = parameters.get(declared::BAG);
    if path.is_empty() {
        return Err(NodeError::Usage(
            "there is no bag to play: give its path (rig_node BAG, or --ros-args -p bag:=BAG), or -p mode:=driver"
                .to_owned(),
        ));
    }
    let bag = BagReader::open(&path).map_err(|e| NodeError::Other(e.to_string()))?;
    for warning in bag.warnings() {
        tracing::warn!("{warning}");
    }
    for loss in bag.losses() {
        tracing::warn!("{loss}");
    }
    if let Some(source) = declared::position_source(parameters) {
        source.check(&bag).map_err(NodeError::program)?;
    }
    if let Some(source) = declared::force_source(parameters) {
        source.check(&bag).map_err(NodeError::program)?;
    }
    let options = declared::play_options(parameters);
    let described = bag.describe_topics();
    Player::new(bag, &options, Instant::now()).ok_or_else(|| {
        let wanted = if options.topics.is_empty() { String::new() } else { format!(" on {:?}", options.topics) };
        NodeError::Other(format!("{path}: no messages{wanted} to play; it has {described}"))
    })
}

struct Common {
    recording: Option<Recording>,
    participant: Participant,
    clock: Arc<NodeClock>,
    stop: Sender<()>,
    thread: JoinHandle<()>,
}

/// The common part of both modes. The last endpoints of the node are made here, and it joins the network.
fn common(
    mut participant: Participant,
    start: Start,
    parameters: &Arc<Parameters>,
    commands: Option<Sender<Command>>,
) -> Result<Common, NodeError> {
    let housekeeping = Housekeeping::new(&mut participant, parameters, commands.is_some())?;
    let recording = start.join(&mut participant, parameters)?;
    let clock = Arc::new(NodeClock::new(false));
    let (stop, stopped) = crossbeam_channel::bounded(0);
    let commands = commands.unwrap_or_else(|| crossbeam_channel::bounded(0).0);
    let of_thread = Arc::clone(&clock);
    let thread = spawn("housekeeping", move || housekeeping.run(&of_thread, &commands, &start.rosout, &stopped))?;
    Ok(Common { recording, participant, clock, stop, thread })
}

fn participant(start: &mut Start, parameters: &Parameters) -> Result<Participant, NodeError> {
    let mut participant = start.participant(parameters)?;
    participant.set_recorder(Recorder::create(parameters)?);
    Ok(participant)
}

fn play(mut start: Start, parameters: &Arc<Parameters>, player: Player, signals: &Signals) -> Result<u8, NodeError> {
    let mut participant = participant(&mut start, parameters)?;
    let wishes = Wishes {
        clock_hz: parameters.get(declared::CLOCK_HZ),
        relative_names: parameters.get(declared::RELATIVE_NAMES),
        topics: parameters.get(declared::TOPICS),
        position: declared::position_source(parameters),
        force: declared::force_source(parameters),
    };
    let outputs = Arc::new(Outputs::new(&mut participant, &player, wishes)?);
    let (commands, received) = crossbeam_channel::bounded(16);
    let common = common(participant, start, parameters, Some(commands.clone()))?;
    let (from, to) = player.span_ns();
    tracing::info!(
        "{}: {} messages, {:.3} s{}",
        player.bag().name(),
        player.bag().message_count(),
        Duration::from_nanos(u64::try_from(to - from).unwrap_or(0)).as_secs_f64(),
        if player.clock().is_paused() { ", paused until ~/resume" } else { "" }
    );
    let delay = Duration::try_from_secs_f64(parameters.get(declared::DELAY)).unwrap_or_default();
    let stay = !parameters.get(declared::EXIT_AT_END);
    let (done, finished) = crossbeam_channel::bounded(1);
    let thread = {
        let outputs = Arc::clone(&outputs);
        spawn("playback", move || {
            // Fails only if the node has already ended.
            let _ = done.send(playback::run(player, &outputs, &received, delay, stay));
        })?
    };
    let outcome = supervise(&commands, &finished, &thread, signals);
    drop(commands);
    join(thread);
    drop(common.stop);
    join(common.thread);
    drop(outputs);
    drop(common.participant);
    let missing = common.recording.map_or(0, Recording::finish);
    let code = conclude(&outcome?);
    Ok(if missing > 0 { LOSSES } else { code })
}

/// Waits for the end of the bag or for a signal.
fn supervise(
    commands: &Sender<Command>,
    finished: &Receiver<Report>,
    playback: &JoinHandle<()>,
    signals: &Signals,
) -> Result<Report, NodeError> {
    let gone = || NodeError::Other("the playback thread has ended unexpectedly".to_owned());
    let quit = || {
        let _ = commands.send(Command::Quit);
        finished.recv().map_err(|_| gone())
    };
    loop {
        if let Some(signal) = signals.wait(Duration::from_millis(20)) {
            tracing::info!("stopping ({signal:?})");
            return quit();
        }
        if let Ok(report) = finished.try_recv() {
            let until = Instant::now() + LINGER;
            while Instant::now() < until && signals.wait(Duration::from_millis(20)).is_none() {}
            return Ok(report);
        }
        if playback.is_finished() && finished.is_empty() {
            return Err(gone());
        }
    }
}

fn conclude(report: &Report) -> u8 {
    #[allow(clippy::cast_precision_loss)] // microseconds for a log line
    let micros = |q: f64| report.late.value_at_quantile(q) as f64 * 1e-3;
    tracing::info!(
        "played {} messages; behind their time by {:.0} us (median), {:.0} us (99%), {:.0} us (largest)",
        report.played,
        micros(0.5),
        micros(0.99),
        micros(1.0)
    );
    for loss in &report.losses {
        tracing::warn!("lost: {loss}");
    }
    if report.losses.is_empty() { SUCCESS } else { LOSSES }
}

fn drive(mut start: Start, parameters: &Arc<Parameters>, signals: &Signals) -> Result<u8, NodeError> {
    let rig = declared::rig(parameters).map_err(NodeError::Usage)?;
    let mut participant = participant(&mut start, parameters)?;
    let endpoints = driver::Endpoints::new(&mut participant, rig.load.is_some())?;
    let common = common(participant, start, parameters, None)?;
    let (stop, stopped) = crossbeam_channel::bounded(0);
    let thread = {
        let (parameters, clock) = (Arc::clone(parameters), Arc::clone(&common.clock));
        spawn("driver", move || {
            let published = driver::run(rig, &endpoints, &parameters, &clock, &stopped);
            tracing::info!("published {published} positions");
        })?
    };
    let failed = loop {
        if let Some(signal) = signals.wait(Duration::from_millis(50)) {
            tracing::info!("stopping ({signal:?})");
            break None;
        }
        if thread.is_finished() {
            break Some("the driver thread has ended unexpectedly".to_owned());
        }
    };
    drop(stop);
    join(thread);
    drop(common.stop);
    join(common.thread);
    drop(common.participant);
    let missing = common.recording.map_or(0, Recording::finish);
    if let Some(reason) = failed {
        return Err(NodeError::Other(reason));
    }
    Ok(if missing > 0 { LOSSES } else { SUCCESS })
}
