//! The twin as a ROS 2 node.
//!
//! ```text
//! input thread ──newest pose──► solver thread ──answers──► force thread ──► predicted_cf, comparison
//!                                    │
//!                                    └──snapshots──► tissue thread ──► tissue_state, tissue_points, ...
//! housekeeping thread: services, discovery, status, diagnostics, rosout        main thread: signals
//! ```
//! The solver thread touches no socket and waits for nobody; a slow subscriber can only slow the thread that publishes
//! to it.

mod comparison;
mod declared;
mod force;
mod housekeeping;
mod inbox;
mod inputs;
mod shared;
mod solver;
mod status;
mod tissue;

use std::ffi::OsString;
use std::sync::Arc;
use std::time::Duration;

use clap::Parser;
use crossbeam_channel::Receiver;

use self::declared::Settings;
use self::force::ForceOutputs;
use self::housekeeping::Housekeeping;
use self::inbox::Inbox;
use self::inputs::Inputs;
use self::shared::Shared;
use self::solver::Built;
use self::tissue::{Model, TissueOutputs};
use super::arguments::ParameterOverride;
use super::clock::NodeClock;
use super::messages::needle_twin::TissueModel;
use super::parameters::Parameters;
use super::participant::{Output, Participant};
use super::qos;
use super::recorder::{Recorder, Recording};
use super::scene_parameters;
use super::signals::Signals;
use super::start::{self, FAILURE, LOSSES, NodeError, SUCCESS, Start};
use super::threads::{join, spawn};
use super::watchdog::Watchdog;
use crate::scene::Scene;
use ros2_client::ParameterValue;

/// Answers that may wait for the force thread, seconds at any sensible rate.
const EVENTS: usize = 8192;

#[derive(Parser, Debug)]
#[command(
    name = "twin_node",
    version,
    about = "The digital twin of a needle-insertion rig as a ROS 2 node",
    after_help = "ROS arguments: --ros-args [-r from:=to] [-r __ns:=/ns] [-r __node:=name] [-p name:=value]\n    \
                  [--params-file FILE] [--log-level LEVEL] [--]\n\
                  Parameters: `ros2 param list`, or --ros-args -p ...; scene keys by their dotted path.\n\
                  Exit codes: 0 stopped, 1 failure, 2 wrong usage, 3 stopped, but the recording has losses."
)]
struct Cli {
    /// Name of a preset or path of a scene file (also the parameter `scene`).
    #[arg(long)]
    scene: Option<String>,
}

/// Runs the node until SIGINT or SIGTERM and returns the program's exit code. `arguments` has no program name.
#[must_use]
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    // Before anything starts a thread: they inherit the mask.
    let signals = match Signals::block() {
        Ok(signals) => signals,
        Err(error) => {
            eprintln!("twin_node: signals can't be blocked: {error}");
            return FAILURE;
        }
    };
    match start::start("twin", arguments).and_then(|start| twin(start, &signals)) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("twin_node: {error}");
            error.exit_code()
        }
    }
}

fn twin(mut start: Start, signals: &Signals) -> Result<u8, NodeError> {
    let cli = match Cli::try_parse_from(std::iter::once("twin_node".to_owned()).chain(start.own.drain(..))) {
        Ok(cli) => cli,
        Err(help) => {
            let code = if help.use_stderr() { start::USAGE } else { SUCCESS };
            let _ = help.print();
            return Ok(code);
        }
    };
    if let Some(scene) = cli.scene {
        start.ros.parameters.push(ParameterOverride {
            node_pattern: "/**".to_owned(),
            name: "scene".to_owned(),
            value: ParameterValue::String(scene),
            origin: "--scene".to_owned(),
        });
    }
    let (scene, parameters) = configure(&start)?;
    let node = Node::new(&start, &parameters)?;
    node.run(start, scene, parameters, signals)
}

/// The scene with the command line's changes, and the node's parameters, the scene's keys among them.
fn configure(start: &Start) -> Result<(Scene, Arc<Parameters>), NodeError> {
    let node = start.names.fully_qualified();
    let given = &start.ros.parameters;
    let name = match start::last_override(given, &node, "scene").map(|o| &o.value) {
        Some(ParameterValue::String(name)) => name.clone(),
        _ => "needle_insertion".to_owned(),
    };
    let mut scene = scene_parameters::apply(&scene_parameters::load(&name)?, given, &node)?;
    if let Some(ParameterValue::Double(tolerance)) = start::last_override(given, &node, "tolerance").map(|o| &o.value)
        && *tolerance > 0.0
    {
        scene.set("stepping.tolerance", &tolerance.to_string())?;
    }
    let mut declarations = declared::declarations();
    declarations.extend(scene_parameters::declarations(&scene));
    let (parameters, warnings) = Parameters::declare(declarations, given, &node)?;
    for warning in warnings {
        tracing::warn!("{warning}");
    }
    Ok((scene, Arc::new(parameters)))
}

struct Node {
    recording: Option<Recording>,
    participant: Participant,
    inputs: Inputs,
    force: ForceOutputs,
    tissue: TissueOutputs,
    model: Output<TissueModel>,
    housekeeping: Housekeeping,
    shared: Arc<Shared>,
}

impl Node {
    /// Makes every endpoint.
    fn new(start: &Start, parameters: &Arc<Parameters>) -> Result<Self, NodeError> {
        let rosout = start.ros.log.rosout.unwrap_or(true);
        let mut participant =
            Participant::join(start.names.clone(), &start.environment, &start.ros.parameters, rosout)?;
        let mapping = start::mapping(&parameters.string("service_mapping"), &start.environment);
        participant.set_mapping(mapping);
        participant.set_recorder(Recorder::create(parameters)?);
        let clock = NodeClock::new(parameters.boolean("use_sim_time"));
        let shared = Arc::new(Shared::new(Settings::of(parameters), clock));
        let inputs = Inputs::new(&mut participant)?;
        let force = ForceOutputs::new(&mut participant)?;
        let tissue = TissueOutputs::new(&mut participant)?;
        let model = participant.publisher("tissue_model", qos::latched())?;
        let housekeeping = Housekeeping::new(&mut participant, parameters, &shared, inputs.wishes())?;
        for unused in participant.unused_qos_overrides() {
            tracing::warn!("`{unused}` names no topic of this node");
        }
        start.announce(mapping);
        let recording = participant.start_recording()?;
        Ok(Self { recording, participant, inputs, force, tissue, model, housekeeping, shared })
    }

    fn run(self, start: Start, scene: Scene, parameters: Arc<Parameters>, signals: &Signals) -> Result<u8, NodeError> {
        let (frame_id, autostart) = (parameters.string("frame_id"), parameters.boolean("autostart"));
        set_threads(parameters.integer("threads"))?;
        let Self { recording, participant, inputs, force, tissue, model: model_output, housekeeping, shared } = self;
        let inbox = Arc::new(Inbox::default());
        let (event_sender, events) = crossbeam_channel::bounded(EVENTS);
        let (snapshot_sender, snapshots) = crossbeam_channel::bounded(2);
        let (built_sender, built) = crossbeam_channel::bounded(1);
        let (stop_inputs, inputs_stopped) = smol::channel::bounded(1);

        let solver = {
            let (inbox, events) = (Arc::clone(&inbox), event_sender.clone());
            spawn("solver", move || solver::run(&scene, &inbox, &built_sender, &events, &snapshot_sender))?
        };
        let input = {
            let (shared, inbox, frame, events) =
                (Arc::clone(&shared), Arc::clone(&inbox), frame_id.clone(), event_sender.clone());
            spawn("input", move || inputs::run(&inputs, &frame, &shared, &inbox, &events, &inputs_stopped))?
        };
        let force = Arc::new(force);
        let force_thread = {
            let (shared, frame, force) = (Arc::clone(&shared), frame_id.clone(), Arc::clone(&force));
            spawn("force", move || force::run(&force, &frame, &shared, &events))?
        };
        let tissue = Arc::new(tissue);
        let (model_sender, models) = crossbeam_channel::bounded(1);
        let (stop_housekeeping, housekeeping_stopped) = crossbeam_channel::bounded::<()>(0);
        let housekeeping_thread = {
            let context = housekeeping::Context {
                frame_id: frame_id.clone(),
                inbox: Arc::clone(&inbox),
                events: event_sender,
                force: Arc::clone(&force),
                tissue: Arc::clone(&tissue),
                models,
                rosout: start.rosout,
                reach: start.environment.reach,
                logger: participant.node().logging_handle(),
            };
            spawn("housekeeping", move || housekeeping.run(&context, &housekeeping_stopped))?
        };

        let mut watchdog = Watchdog::new();
        let mut tissue_thread = None;
        let outcome = loop {
            if let Some(signal) = signals.wait(Duration::from_millis(50)) {
                tracing::info!("stopping ({signal:?})");
                break Ok(SUCCESS);
            }
            if let Err(reason) = watchdog.check() {
                break Err(NodeError::Other(reason));
            }
            match next_model(&built) {
                Some(Ok(model)) => {
                    let model: Arc<Model> = Arc::from(model);
                    let first = tissue_thread.is_none();
                    publish_model(&model_output, &model, &shared, &frame_id, first);
                    let _ = model_sender.send(Some(Arc::clone(&model)));
                    if !first {
                        continue;
                    }
                    let (tissue, shared, inbox, frame, snapshots) = (
                        Arc::clone(&tissue),
                        Arc::clone(&shared),
                        Arc::clone(&inbox),
                        frame_id.clone(),
                        snapshots.clone(),
                    );
                    tissue_thread = Some(spawn("tissue", move || {
                        tissue::run(&tissue, &model, &frame, &shared, &inbox, &snapshots)
                    })?);
                }
                Some(Err(reason)) if autostart => break Err(NodeError::Other(reason)),
                Some(Err(reason)) => {
                    tracing::error!("the model can't be built: {reason}");
                    let _ = model_sender.send(None);
                }
                None if solver.is_finished() || force_thread.is_finished() => {
                    break Err(NodeError::Other("a thread of the node has ended unexpectedly".to_owned()));
                }
                None => {}
            }
        };
        // Inputs first, so that nothing new comes while the others finish.
        drop(stop_inputs);
        join(input);
        inbox.stop();
        join(solver);
        join(force_thread);
        if let Some(thread) = tissue_thread {
            join(thread);
        }
        drop(stop_housekeeping);
        join(housekeeping_thread);
        // Endpoints before the node, the node before the participant: peers see the node leave at once.
        drop((force, tissue, model_output));
        drop(participant);
        let lost = recording.map_or(0, Recording::finish);
        outcome.map(|code| if lost > 0 { LOSSES } else { code })
    }
}

/// The model, once.
fn next_model(built: &Receiver<Built>) -> Option<Built> {
    built.try_recv().ok()
}

/// The same scene gives the same model: built once more, it is not published once more.
fn publish_model(output: &Output<TissueModel>, model: &Model, shared: &Shared, frame_id: &str, first: bool) {
    tracing::info!(
        "scene {}: {} nodes, {} integration points, built in {:.2} s",
        model.scene,
        model.nodes,
        model.integration_points,
        model.build.as_secs_f64()
    );
    if first {
        output.send(model.message(shared.clock.stamp(), frame_id));
    }
}

fn set_threads(threads: i64) -> Result<(), NodeError> {
    let threads = usize::try_from(threads).unwrap_or(0);
    if threads == 0 {
        return Ok(());
    }
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build_global()
        .map_err(|e| NodeError::Other(format!("threads {threads}: {e}")))
}
