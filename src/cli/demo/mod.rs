//! `needle_twin demo`: rig and twin as two ROS 2 nodes on this machine, and a third program that listens; then layered tissue.

mod assemble;
mod live;
mod second_act;

use std::net::{Ipv4Addr, TcpListener};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::Args;
use ros2_client::ServiceMapping;

use self::live::Live;
use super::nodes::Node;
use super::options::SeriesOptions;
use super::output::OutputFolder;
use super::{CliError, Outcome, output, replay, scene_file};
use crate::ros::observer::{Observations, Observer};
use needle_core::scene::Scene;
use needle_estimate::compare::Run;
use needle_recording::{Recording, TopicNames};
use needle_rig::embedded;
use ros2_guarded::signals::Signals;
use ros2_node::environment::{self, Environment, Reach};
use rosbag2_mcap::{BagWriter, WriterOptions};

/// Scene of the demo and of the recording that is compiled in.
const SCENE: &str = "needle_insertion";
/// Where the results go.
const OUT: &str = "out/demo";
/// Where the live page is, if nobody else is there.
const PAGE_PORT: u16 = 8080;
/// Longest wait for the twin to build its model, or for the nodes to find each other.
const PATIENCE: Duration = Duration::from_secs(60);
/// What is still on its way when the rig has left arrives within this.
const TAIL: Duration = Duration::from_millis(500);
/// Between two looks at what has come.
const LOOK: Duration = Duration::from_millis(2);

/// Start rig and twin as two ROS 2 nodes on this machine, play the embedded needle recording through them, show
/// predicted against measured force, record what was published and write the report; then take a needle through layered tissue
#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Folder for the report, the recorded bag and the nodes' logs
    #[arg(long, value_name = "DIR", default_value = OUT)]
    out: PathBuf,

    /// Replay the same recording offline, without a network
    #[arg(long)]
    no_dds: bool,
}

impl Default for Arguments {
    fn default() -> Self {
        Self { out: PathBuf::from(OUT), no_dds: false }
    }
}

pub(super) fn run(arguments: &Arguments) -> Result<Outcome, CliError> {
    let scene = scene_file::load(SCENE)?;
    let recording = Recording::from_reader(&embedded::needle_insertion()?, &TopicNames::default())?;
    let folder = OutputFolder::prepare(&arguments.out)?;
    if arguments.no_dds {
        let run = replay::offline(&scene, recording, "demo")?;
        return deliver(&run, &folder);
    }
    // Before anything starts a thread: RustDDS must not see a signal.
    let signals = Signals::block().map_err(|e| CliError::Demo(format!("signals can't be blocked: {e}")))?;
    let run = Stage::prepare(&arguments.out, &signals)?.play(&scene, &recording)?;
    deliver(&run, &folder)
}

/// Leaves the results of the first act and goes on with the second, unless something has gone wrong, or Ctrl-C has ended the first.
fn deliver(run: &Run, folder: &OutputFolder) -> Result<Outcome, CliError> {
    match output::deliver(run, Some(folder), &SeriesOptions::default(), false)? {
        Outcome::Complete => second_act::run(&folder.path),
        Outcome::Lossy => Ok(Outcome::Lossy),
    }
}

/// The live page's usual port, or another one that is free.
fn free_port() -> std::io::Result<u16> {
    let free =
        TcpListener::bind((Ipv4Addr::LOCALHOST, PAGE_PORT)).or_else(|_| TcpListener::bind((Ipv4Addr::LOCALHOST, 0)))?;
    Ok(free.local_addr()?.port())
}

/// Everything that the play needs.
struct Stage<'a> {
    folder: &'a Path,
    bag: PathBuf,
    recorded: PathBuf,
    domain: u16,
    page_port: u16,
    signals: &'a Signals,
}

/// How the play ended.
struct Ending {
    heard: Observations,
    losses: Vec<String>,
}

impl<'a> Stage<'a> {
    fn prepare(folder: &'a Path, signals: &'a Signals) -> Result<Self, CliError> {
        let domain = environment::free_domain()
            .ok_or_else(|| CliError::Demo("every ROS domain of this machine is in use".to_owned()))?;
        let (bag, recorded) = (folder.join("rig_recording"), folder.join("published"));
        for ours in [&bag, &recorded] {
            // Only what an earlier demo has left.
            if ours.join("metadata.yaml").exists() {
                std::fs::remove_dir_all(ours).map_err(|e| CliError::Demo(format!("{}: {e}", ours.display())))?;
            }
        }
        embedded::write_needle_insertion(&bag)?;
        let page_port = free_port().map_err(|e| CliError::Demo(format!("no port of the loopback is free: {e}")))?;
        Ok(Self { folder, bag, recorded, domain, page_port, signals })
    }

    fn play(&self, scene: &Scene, recording: &Recording) -> Result<Run, CliError> {
        let peak = recording.forces.iter().map(|f| f.force_n[2].abs()).fold(1e-6, f64::max);
        let duration = recording.depths.last().map_or(0.0, |d| d.time_s);
        let mut live = Live::new(1.1 * peak, Duration::from_secs_f64(duration));
        live.say(&format!(
            "two ROS 2 nodes on this machine, to be seen at http://127.0.0.1:{}/ and heard with: ROS_DOMAIN_ID={} ros2 topic list",
            self.page_port, self.domain
        ));
        let result = self.exchange(&mut live);
        live.finish();
        let ending = result?;
        let mut run = assemble::run(&ending.heard, scene, &recording.source);
        run.losses.extend(ending.losses);
        Ok(run)
    }

    fn exchange(&self, live: &mut Live) -> Result<Ending, CliError> {
        let bag = self.bag.display().to_string();
        let port = format!("page_port:={}", self.page_port);
        let settings = ["status_rate_hz:=20.0", "tissue_rate_hz:=10.0", "page:=true", &port];
        let settings: Vec<&str> =
            std::iter::once("--ros-args").chain(settings.iter().flat_map(|s| ["-p", s])).collect();
        let mut twin = Node::start("twin-node", &settings, self.domain, self.folder)?;
        let play = [&bag, "--ros-args", "-p", "start_paused:=true"];
        let mut rig = Node::start("rig-node", &play, self.domain, self.folder)?;
        let environment = Environment {
            domain: self.domain,
            reach: Reach::Localhost,
            mapping: ServiceMapping::Enhanced,
            zenoh: None,
            log_folder: None,
            warnings: Vec::new(),
        };
        let writer = BagWriter::create(
            &self.recorded,
            WriterOptions { library: needle_core::WRITER.to_owned(), ..WriterOptions::default() },
        )?;
        let mut observer = Observer::join(&environment, Some(writer))?;

        let mut losses = Vec::new();
        if self.wait(live, &mut observer, [&mut twin, &mut rig])? {
            self.watch(live, &mut observer, &mut twin, &mut rig, &mut losses)?;
        } else {
            losses.push("interrupted before the start".to_owned());
        }
        match twin.stop(Duration::from_secs(5)) {
            Some(status) if status.success() => {}
            Some(status) => losses.push(format!("the twin node ended with {status}")),
            None => losses.push("the twin node did not stop and was killed".to_owned()),
        }
        drop(rig);
        let (heard, unrecorded) = observer.leave();
        losses.extend(unrecorded);
        if heard.predicted.is_empty() && losses.is_empty() {
            return Err(twin.failure("has not predicted anything"));
        }
        Ok(Ending { heard, losses })
    }

    /// Until the model is built and everybody has found everybody; false after Ctrl-C.
    fn wait(&self, live: &Live, observer: &mut Observer, nodes: [&mut Node; 2]) -> Result<bool, CliError> {
        let begun = Instant::now();
        let [twin, rig] = nodes;
        live.say("the twin builds its model");
        loop {
            if self.signals.wait(LOOK).is_some() {
                return Ok(false);
            }
            observer.poll();
            if twin.ended().is_some() {
                return Err(twin.failure("has ended"));
            }
            if rig.ended().is_some() {
                return Err(rig.failure("has ended"));
            }
            if observer.heard.model.is_some() && observer.is_connected() && observer.resume_rig() {
                return Ok(true);
            }
            if begun.elapsed() > PATIENCE {
                return Err(twin.failure("and the rig have not found each other within a minute"));
            }
        }
    }

    /// Until the rig has played everything, or Ctrl-C.
    fn watch(
        &self,
        live: &mut Live,
        observer: &mut Observer,
        twin: &mut Node,
        rig: &mut Node,
        losses: &mut Vec<String>,
    ) -> Result<(), CliError> {
        live.say("");
        let mut over: Option<Instant> = None;
        loop {
            if self.signals.wait(LOOK).is_some() {
                losses.push("interrupted".to_owned());
                return Ok(());
            }
            observer.poll();
            live.show(&observer.heard);
            if twin.ended().is_some() {
                return Err(twin.failure("has ended"));
            }
            match (over, rig.ended()) {
                (None, Some(status)) => {
                    if !status.success() {
                        losses.push(format!("the rig node ended with {status}"));
                    }
                    over = Some(Instant::now());
                }
                (Some(at), _) if at.elapsed() > TAIL => return Ok(()),
                _ => {}
            }
        }
    }
}
