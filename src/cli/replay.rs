//! `needle_twin replay`: a recording through the twin, offline and deterministic.

use std::path::PathBuf;

use clap::Args;

use super::options::{OutputOptions, SeriesOptions, SetOptions, ThreadOptions};
use super::progress::Progress;
use super::{CliError, Outcome, output, scene_file};
use crate::compare::scale::mistaken;
use crate::compare::{self, At, Collector, ForceSeries, Keep, Reading, Run};
use crate::input::{Recording, TopicNames};
use crate::scene::Scene;
use crate::twin::Twin;

/// Scene of a bag that doesn't say which it was made for.
const DEFAULT_SCENE: &str = "needle_insertion";

/// Run the recorded motion of a bag and compare with its load cell: one message at a time, as fast as the machine
/// allows; the same bag, scene and settings give the same checksum
#[derive(Debug, Args)]
pub(super) struct Arguments {
    #[command(flatten)]
    recorded: RecordedOptions,

    #[command(flatten)]
    threads: ThreadOptions,

    /// Seed of what is drawn at random; a replay draws nothing, so its results don't depend on it
    #[arg(long, value_name = "N", help_heading = "Run")]
    seed: Option<u64>,

    #[command(flatten)]
    series: SeriesOptions,

    #[command(flatten)]
    output: OutputOptions,
}

/// A recording and the scene that it is run with.
#[derive(Debug, Args)]
pub(super) struct RecordedOptions {
    /// rosbag2 folder or .mcap file
    bag: PathBuf,

    /// Preset or scene file [default: the one that the bag names, needle_insertion if it names none]
    #[arg(long, value_name = "NAME|FILE", help_heading = "Scene")]
    scene: Option<String>,

    #[command(flatten)]
    set: SetOptions,

    #[command(flatten)]
    pub topics: TopicOptions,

    /// Go on where units, signs or scene of the recording look wrong; of `calibrate`, write a rejected model's scene as well
    #[arg(long, help_heading = "Run")]
    pub force: bool,
}

impl RecordedOptions {
    /// Reads both.
    pub(super) fn load(&self) -> Result<(Recording, Scene), CliError> {
        let recording = Recording::load(&self.bag, &self.topics.names())?;
        let name = self.scene.as_deref().or(recording.scene.as_deref()).unwrap_or(DEFAULT_SCENE);
        let scene = self.set.apply(&scene_file::load(name)?, [])?;
        Ok((recording, scene))
    }
}

/// Which topics of the bag are taken.
#[derive(Debug, Args)]
#[command(next_help_heading = "Bag")]
pub(super) struct TopicOptions {
    /// Joint whose position is the depth
    #[arg(long, value_name = "NAME", default_value = "insertion")]
    joint: String,

    /// Frame of the tip's poses: origin at the centre of the sample's bottom face, z up
    #[arg(long, value_name = "NAME", default_value = "sample")]
    frame_id: String,

    /// Topic of the displacement sensor, sensor_msgs/JointState [default: a measured_js]
    #[arg(long, value_name = "TOPIC")]
    measured_js: Option<String>,

    /// Topic of the tip's pose, geometry_msgs/PoseStamped [default: a measured_cp, where there is no measured_js]
    #[arg(long, value_name = "TOPIC")]
    measured_cp: Option<String>,

    /// Topic of the load cell, geometry_msgs/WrenchStamped [default: a measured_cf]
    #[arg(long, value_name = "TOPIC")]
    measured_cf: Option<String>,
}

pub(super) fn run(arguments: &Arguments) -> Result<Outcome, CliError> {
    let (recording, scene) = arguments.recorded.load()?;
    let folder = output::prepare(&arguments.output)?;
    let readings = arguments.recorded.topics.readings(&recording);
    let keep = arguments.series.keep(folder.is_some(), duration_s(&readings))?;
    let forced = arguments.recorded.force;
    let run = arguments.threads.install(|| replay(&scene, &recording, readings, keep, forced))??;
    output::deliver(&run, folder.as_ref(), &arguments.series, arguments.output.json)
}

/// Plays a recording offline as another command (`demo --no-dds`), fields and all.
pub(super) fn offline(scene: &Scene, recording: &Recording, command: &str) -> Result<Run, CliError> {
    let depths = recording.depths.iter();
    let readings: Vec<Reading> = depths.map(|s| Reading { time_s: s.time_s, at: At::Depth(s.depth_m) }).collect();
    let keep = Keep { fields: true, duration_s: duration_s(&readings), save_every_s: None };
    let mut run = replay(scene, recording, readings, keep, false)?;
    command.clone_into(&mut run.command);
    Ok(run)
}

impl TopicOptions {
    pub(super) fn names(&self) -> TopicNames {
        TopicNames {
            joint_state: self.measured_js.clone(),
            pose: self.measured_cp.clone(),
            wrench: self.measured_cf.clone(),
            joint: self.joint.clone(),
            frame_id: self.frame_id.clone(),
        }
    }

    /// The depths, unless there are none or the pose was asked for by name.
    pub(super) fn readings(&self, recording: &Recording) -> Vec<Reading> {
        let pose_wanted = self.measured_cp.is_some() && self.measured_js.is_none();
        if recording.depths.is_empty() || pose_wanted {
            recording.poses.iter().map(|s| Reading { time_s: s.time_s, at: At::Pose(s.pose()) }).collect()
        } else {
            recording.depths.iter().map(|s| Reading { time_s: s.time_s, at: At::Depth(s.depth_m) }).collect()
        }
    }
}

/// Time from the first reading to the last, s.
fn duration_s(readings: &[Reading]) -> Option<f64> {
    readings.first().zip(readings.last()).map(|(first, last)| last.time_s - first.time_s)
}

fn replay(
    scene: &Scene,
    recording: &Recording,
    readings: Vec<Reading>,
    keep: Keep,
    forced: bool,
) -> Result<Run, CliError> {
    let mut progress = Progress::preparing("building the model");
    for warning in recording.warnings.iter().chain(&foreign_frame(recording)) {
        progress.warn(warning);
    }
    let built = compare::build(scene);
    let (mut twin, build_s) = built.map_err(|source| CliError::Build { scene: scene.name.clone(), source })?;
    twin.warnings().iter().for_each(|warning| progress.warn(warning));
    let measured = series(recording);
    refuse_mistaken(&twin, recording, &readings, &measured, forced, &progress)?;
    progress.count(readings.len());
    let mut collector = Collector::new(&twin, "replay", build_s, keep);
    recording.losses.iter().for_each(|loss| collector.lost(loss.to_string()));
    measured.loss().into_iter().for_each(|loss| collector.lost(loss));
    if !measured.is_empty() {
        collector.measured_source(&recording.source);
    }
    let run = compare::drive(&mut twin, readings, Some(&measured), collector, &mut progress);
    progress.finish();
    Ok(run)
}

/// The measured force over time.
pub(super) fn series(recording: &Recording) -> ForceSeries {
    ForceSeries::new(recording.forces.iter().map(|s| (s.time_s, s.force_n)).collect())
}

/// Refuses a recording whose units, signs or scene are likely wrong, before any time is spent on it; says it only if `forced`.
pub(super) fn refuse_mistaken(
    twin: &Twin,
    recording: &Recording,
    readings: &[Reading],
    measured: &ForceSeries,
    forced: bool,
    progress: &Progress,
) -> Result<(), CliError> {
    match mistaken(twin, readings, measured, recording.scene.as_deref()) {
        Some(what) if forced => progress.warn(&what),
        Some(what) => return Err(CliError::Mistaken(what)),
        None => {}
    }
    Ok(())
}

/// What to say of forces that are recorded in another frame: a replay has no transforms to bring them over.
pub(super) fn foreign_frame(recording: &Recording) -> Option<String> {
    let (found, wanted) = (recording.force_frame.trim_start_matches('/'), &recording.topics.frame_id);
    (!found.is_empty() && found != wanted).then(|| {
        format!("the forces are recorded in frame `{found}`, taken as if its axes were those of `{wanted}`: rotate them if they are not")
    })
}
