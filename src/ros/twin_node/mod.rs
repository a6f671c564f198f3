//! The twin as a ROS 2 node.
//!
//! ```text
//! input thread ──newest poses─► solver thread ──answers──► force thread ──► predicted_cf, comparison
//!                                    │
//!                                    ├──snapshots──► tissue thread ──► tissue_state, tissue_points, ...
//!                                    └──scratch copy► look-ahead thread ──► answers of ~/look_ahead
//! force thread ──newest answered pose, comparisons──► members' thread ──► prediction_band, outlook, ...
//! housekeeping thread: services, discovery, status, diagnostics, rosout        main thread: signals
//! page thread, link thread: the newest of forces, status and tissue, to browsers; of instrument and tissue, by OpenIGTLink
//! ```
//! The solver thread uses no socket and waits for no other thread. A slow subscriber can only slow the thread that
//! publishes to it.

mod answer;
mod assurance;
mod comparison;
mod declared;
mod force;
mod housekeeping;
mod identification;
mod inbox;
mod inputs;
mod judgement;
mod look_ahead;
mod members;
#[cfg_attr(not(feature = "slicer"), path = "without_openigtlink.rs")]
mod openigtlink;
#[cfg_attr(not(feature = "page"), path = "without_page.rs")]
mod page;
mod pictured;
mod pulse;
mod rivals;
mod shared;
mod solver;
mod status;
mod stretch;
mod supervisor;
mod tf;
mod tissue;
mod tracked;
mod under_way;
mod viewers;
mod warnings;

use std::ffi::OsString;
use std::sync::{Arc, mpsc};
use std::time::{Duration, Instant};

use clap::Parser;

use self::declared::Settings;
use self::force::ForceOutputs;
use self::housekeeping::Housekeeping;
use self::identification::Identification;
use self::inbox::Inbox;
use self::inputs::Inputs;
use self::look_ahead::LookAhead;
use self::members::{MemberOutputs, Newest};
use self::openigtlink::Link;
use self::page::Page;
use self::rivals::Rivals;
use self::shared::Shared;
use self::solver::{Event, Outlets};
use self::supervisor::Supervisor;
use self::tissue::TissueOutputs;
use super::own_arguments;
use super::scene_parameters;
use named_threads::{join, join_before, spawn};
use needle_core::scene::Scene;
use needle_estimate::compare::ensemble::{self, EnsembleError, Member, Size};
use needle_recording::{POSES, WRENCHES};
use ros2_guarded::signals::Signals;
use ros2_messages::RosMessage as _;
use ros2_messages::geometry_msgs::PoseArray;
use ros2_messages::sensor_msgs::JointState;
use ros2_node::clock::NodeClock;
use ros2_node::parameters::Parameters;
use ros2_node::participant::Participant;
use ros2_node::recorder::{Recorder, Recording};
use ros2_node::start::{self, LOSSES, NodeError, Start};

/// Queue length of answers for the force thread: seconds at any sensible rate. The channel is the standard library's,
/// whose receiver sleeps. The receiver of crossbeam's channel first yields the processor several times. Under high
/// load it then runs after the time slices of all other threads, a millisecond late (docs/lab/performance.md).
const EVENTS: usize = 8192;
/// When the node stops, a thread that still computes (building a model) is abandoned after this time.
const LEAVING: Duration = Duration::from_millis(400);

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

/// A port that the node takes where a parameter asks for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Port {
    /// What is served there.
    pub serves: &'static str,
    /// Parameter that names another one.
    pub parameter: &'static str,
    /// The one without the parameter.
    pub usual: u16,
}

/// The ports of the live page and of OpenIGTLink.
#[must_use]
pub(crate) fn ports() -> [Port; 2] {
    [("the live page", declared::PAGE_PORT), ("OpenIGTLink", declared::OPENIGTLINK_PORT)].map(|(serves, parameter)| {
        Port { serves, parameter: parameter.name(), usual: u16::try_from(parameter.default()).unwrap_or(0) }
    })
}

/// The topics that the node reads, by the names that it has for them, with their types as ROS says them: the first, or one of the others if the
/// topic's parameter names it.
#[must_use]
pub(crate) fn input_topics() -> [(&'static str, &'static [&'static str]); 4] {
    [
        ("measured_js", &[JointState::TYPE]),
        ("measured_cp", &POSES),
        ("measured_cf", &WRENCHES),
        ("measured_targets", &[PoseArray::TYPE]),
    ]
}

/// Runs the node until SIGINT or SIGTERM and returns the program's exit code. `arguments` does not include the
/// program name.
#[must_use]
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    start::run("twin_node", ["twin", env!("CARGO_CRATE_NAME")], arguments, twin)
}

fn twin(mut start: Start, signals: &Signals) -> Result<u8, NodeError> {
    let cli: Cli = match own_arguments("twin_node", &mut start) {
        Ok(cli) => cli,
        Err(code) => return Ok(code),
    };
    if let Some(scene) = cli.scene {
        start.set(declared::SCENE, scene, "--scene");
    }
    let (scene, parameters) = configure(&start)?;
    let node = Node::new(&mut start, &scene, &parameters)?;
    node.run(start, scene, parameters, signals)
}

/// The scene with the command line's changes, and the node's parameters including the scene's keys.
fn configure(start: &Start) -> Result<(Scene, Arc<Parameters>), NodeError> {
    let node = start.names.fully_qualified();
    let given = &start.ros.parameters;
    let name = start::last_override(given, &node, declared::SCENE).unwrap_or_else(|| declared::SCENE.default());
    let mut scene = scene_parameters::apply(&scene_parameters::load(&name)?, given, &node)?;
    if let Some(tolerance) = start::last_override(given, &node, declared::TOLERANCE).filter(|t| *t > 0.0) {
        scene.set("stepping.tolerance", &tolerance.to_string()).map_err(NodeError::program)?;
    }
    if scene.align.is_some() {
        tracing::warn!(
            "[align] is of a recording: the node takes depths, forces and stamps as they come (zero the sensors, or ~/tare)"
        );
    }
    let mut declarations = declared::declarations();
    declarations.extend(scene_parameters::declarations(&scene));
    let parameters = start.declare(declarations)?;
    Ok((scene, parameters))
}

struct Node {
    recording: Option<Recording>,
    participant: Participant,
    inputs: Inputs,
    force: ForceOutputs,
    tissue: TissueOutputs,
    look_ahead: LookAhead,
    /// Only with an ensemble.
    members: Option<MemberOutputs>,
    housekeeping: Housekeeping,
    shared: Arc<Shared>,
    page: Option<Page>,
}

impl Node {
    /// Creates every endpoint and joins the network.
    fn new(start: &mut Start, scene: &Scene, parameters: &Arc<Parameters>) -> Result<Self, NodeError> {
        let mut participant = start.participant(parameters)?;
        let rivals = Rivals::new(&mut participant)?;
        participant.set_recorder(Recorder::create(parameters)?);
        let clock = NodeClock::new(parameters.get(start::USE_SIM_TIME));
        let shared = Arc::new(Shared::new(Settings::of(parameters), clock));
        let types = [declared::MEASURED_CP_TYPE, declared::MEASURED_CF_TYPE].map(|kind| parameters.get(kind));
        let inputs = Inputs::new(&mut participant, types.each_ref().map(String::as_str))?;
        let force = ForceOutputs::new(&mut participant, parameters, scene)?;
        let page = Page::open(parameters, &shared, participant.bell())?;
        let mut tissue = TissueOutputs::new(&mut participant, scene)?;
        tissue.viewers.page = page.as_ref().map(|page| Arc::clone(&page.board));
        tissue.viewers.link = Link::open(parameters, &shared)?;
        let look_ahead = participant.server("~/look_ahead", "needle_twin", "LookAhead")?;
        let members = parameters.get(declared::MEMBERS) > 0;
        let members = members.then(|| MemberOutputs::new(&mut participant)).transpose()?;
        let housekeeping = Housekeeping::new(&mut participant, parameters, &shared, inputs.wishes(), rivals)?;
        let recording = start.join(&mut participant, parameters)?;
        Ok(Self { recording, participant, inputs, force, tissue, look_ahead, members, housekeeping, shared, page })
    }

    // Threads are connected, started and, in the order of a clean shutdown, joined one after the other. In separate
    // functions that order would be hard to see.
    fn run(self, start: Start, scene: Scene, parameters: Arc<Parameters>, signals: &Signals) -> Result<u8, NodeError> {
        let frame_id = parameters.get(declared::FRAME_ID);
        set_threads(parameters.get(declared::THREADS))?;
        let identification = Identification::new(&scene, &parameters.get(declared::IDENTIFY))?;
        let seen = force::Seen::new(scene.instrument.and_then(|i| i.needle_diameter_m()));
        let lever_m = assurance::lever_m(&scene);
        let own = scene
            .motion
            .filter(|_| parameters.get(declared::LOOK_AHEAD))
            .map(|motion| look_ahead::OwnMotion { depth_m: motion.depth.get(), speed_m_per_s: motion.speed.get() });
        let drawn = draw(&scene, parameters.get(declared::MEMBERS))?;
        let Self { recording, participant, inputs, force, tissue, look_ahead, members, housekeeping, shared, page } =
            self;
        let doubles = parameters.get(declared::LOOK_AHEAD);
        let (inbox, force, tissue) = (Arc::new(Inbox::default()), Arc::new(force), Arc::new(tissue));
        let (event_sender, events) = mpsc::sync_channel(EVENTS);
        let (snapshot_sender, snapshots) = crossbeam_channel::bounded(2);
        let (departure_sender, departures) = crossbeam_channel::bounded(2);
        let (built_sender, built) = crossbeam_channel::bounded(1);
        let (model_sender, models) = crossbeam_channel::bounded(1);
        let (stop_inputs, inputs_stopped) = smol::channel::bounded(1);
        let (stop_housekeeping, housekeeping_stopped) = crossbeam_channel::bounded::<()>(0);
        let context = housekeeping::Context {
            frame_id: frame_id.clone(),
            inbox: Arc::clone(&inbox),
            events: event_sender.clone(),
            force: Arc::clone(&force),
            tissue: Arc::clone(&tissue),
            models,
            rosout: start.rosout,
            reach: start.environment.reach,
            middleware: participant.health(),
            bell: participant.bell(),
            page,
        };
        let mut supervisor = Supervisor {
            frame_id: frame_id.clone(),
            autostart: parameters.get(declared::AUTOSTART),
            shared: Arc::clone(&shared),
            inbox: Arc::clone(&inbox),
            tissue,
            built,
            models: model_sender,
            bell: participant.bell(),
            snapshots,
            tissue_thread: None,
        };
        let solver = {
            let inbox = Arc::clone(&inbox);
            let outlets = Outlets {
                built: built_sender,
                events: event_sender.clone(),
                snapshots: snapshot_sender,
                departures: departure_sender,
            };
            spawn("solver", move || solver::run(&scene, doubles, &inbox, &outlets))?
        };
        let look_ahead = {
            let (inbox, frame, stopped) = (Arc::clone(&inbox), frame_id.clone(), inputs_stopped.clone());
            let shared = Arc::clone(&shared);
            spawn("look-ahead", move || {
                look_ahead::run(&look_ahead, &frame, &inbox, &departures, &stopped, &shared, own);
            })?
        };
        let last_word = event_sender.clone();
        let input = {
            let (shared, inbox, frame) = (Arc::clone(&shared), Arc::clone(&inbox), frame_id.clone());
            spawn("input", move || inputs::run(&inputs, &frame, &shared, &inbox, &event_sender, &inputs_stopped))?
        };
        let newest = Arc::new(Newest::default());
        let members = members.map(|outputs| {
            let (shared, newest, frame) = (Arc::clone(&shared), Arc::clone(&newest), frame_id.clone());
            spawn("members", move || members::run(&outputs, &frame, &drawn, &newest, &shared))
        });
        let members = members.transpose()?;
        let force = {
            let asked = members.is_some().then(|| Arc::clone(&newest));
            spawn("force", move || {
                force::run(&force, &frame_id, &shared, &events, identification, asked.as_deref(), seen, lever_m)
            })?
        };
        let housekeeping = spawn("housekeeping", move || housekeeping.run(&context, &housekeeping_stopped))?;

        let threads = [&solver, &force, &input, &look_ahead, &housekeeping];
        let threads: Vec<_> = threads.into_iter().chain(&members).chain(participant.thread()).collect();
        let outcome = supervisor.run(signals, &threads);
        // Inputs first, so that no new data come while the others finish.
        drop(stop_inputs);
        inbox.stop();
        newest.stop();
        let deadline = Instant::now() + LEAVING;
        for thread in [input, look_ahead, solver].into_iter().chain(members) {
            let _ = join_before(thread, deadline);
        }
        // The solver sends it as well, if it can.
        let _ = last_word.try_send(Event::Stop);
        for thread in [Some(force), supervisor.tissue_thread.take()].into_iter().flatten() {
            let _ = join_before(thread, deadline + LEAVING / 2);
        }
        drop(stop_housekeeping);
        join(housekeeping);
        drop(participant);
        let lost = recording.map_or(0, Recording::finish);
        outcome.map(|code| if lost > 0 { LOSSES } else { code })
    }
}

/// The members requested by the parameter.
fn draw(scene: &Scene, members: i64) -> Result<Vec<Member>, NodeError> {
    let members = usize::try_from(members).unwrap_or(0);
    if members == 0 {
        return Ok(Vec::new());
    }
    let drawn = ensemble::members(scene, Size { members, seed: 0 });
    let drawn = drawn.and_then(|drawn| ensemble::check_live(&drawn).map(|()| drawn));
    drawn.map_err(|error| {
        NodeError::Other(match error {
            // the command line's own advice is an option that a node does not have
            EnsembleError::NoUncertainty { scene, key, mean, deviation } => format!(
                "parameter members: scene {scene} says of no key how uncertain it is. Write it into a file (needle_twin scene show {scene} > \
                 own.toml), add a section [uncertainty] with \"{key}\" = {{ normal = [{mean}, {deviation}] }} (mean and standard deviation; \
                 lognormal and uniform are there too), and start the node with -p scene:=own.toml"
            ),
            error => format!("parameter members: {error}"),
        })
    })
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
