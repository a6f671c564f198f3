//! `needle_twin replay`: a recording through the twin, offline and deterministic.

use clap::Args;

use super::members::{Drawn, MemberOptions};
use super::options::{OutputOptions, SeriesOptions, ThreadOptions};
use super::progress::Progress;
use super::recorded::RecordedOptions;
use super::{CliError, Outcome, output};
use needle_core::scene::Scene;
use needle_estimate::compare::ensemble::Driven;
use needle_estimate::compare::scale::{mistaken, untared};
use needle_estimate::compare::{Finished, Keep, Run, Session, Watch as _};
use needle_recording::{Reading, Recording};

/// Run the recorded motion of a bag or table and compare with its load cell: one message at a time, as fast as the machine
/// allows; the same bag, scene and settings give the same checksum
#[derive(Debug, Args)]
pub(super) struct Arguments {
    #[command(flatten)]
    recorded: RecordedOptions,

    #[command(flatten)]
    threads: ThreadOptions,

    #[command(flatten)]
    members: MemberOptions,

    #[command(flatten)]
    series: SeriesOptions,

    #[command(flatten)]
    output: OutputOptions,
}

pub(super) fn run(arguments: &Arguments) -> Result<Outcome, CliError> {
    let (recording, scene) = arguments.recorded.load()?;
    let members = arguments.members.draw(&scene)?;
    let folder = output::prepare(&arguments.output)?;
    let by_pose = arguments.recorded.topics.by_pose();
    let keep = arguments.series.keep(folder.is_some(), recording.duration_s(by_pose))?;
    let forced = arguments.recorded.force;
    let run = arguments.threads.install(|| replay(&scene, recording, by_pose, keep, forced, members.as_ref()))??;
    output::deliver(&run, folder.as_ref(), &arguments.series, arguments.output.json)
}

/// Plays a recording offline as another command (`demo --no-dds`), fields and all.
#[cfg(feature = "ros")]
pub(super) fn offline(scene: &Scene, recording: Recording, command: &str) -> Result<Run, CliError> {
    let keep = Keep { fields: true, duration_s: recording.duration_s(false), save_every_s: None };
    let mut run = replay(scene, recording, false, keep, false, None)?;
    command.clone_into(&mut run.command);
    Ok(run)
}

fn replay(
    scene: &Scene,
    mut recording: Recording,
    by_pose: bool,
    keep: Keep,
    forced: bool,
    members: Option<&Drawn>,
) -> Result<Run, CliError> {
    let mut progress = Progress::preparing("building the model");
    for warning in recording.warnings.iter().chain(&recording.foreign_frame()) {
        progress.warn(warning);
    }
    let session = Session::new(scene, "replay", keep);
    let session = session.map_err(|source| CliError::Build { scene: scene.name.clone(), source })?;
    let twin = session.twin();
    twin.warnings().iter().for_each(|warning| progress.warn(warning));
    // a recording of millions of readings is in memory once
    let measured = recording.take_measured();
    let readings = || recording.each_reading(by_pose);
    let some = recording.some_readings(by_pose);
    let found = mistaken(twin, &some, &measured, Some(&recording)).or_else(|| untared(twin, &some, &measured));
    refuse(found, forced, &progress)?;
    drop(some);
    progress.count(readings().len());
    let session = session.of_recording(&recording, &measured);
    let Finished { mut run, answered, twin } = session.run(readings(), &mut progress);
    progress.finish();
    let cancel = progress.cancel().clone();
    drop(progress); // it says nothing more of poses
    if let Some(members) = members {
        let readings: Vec<Reading> = readings().collect();
        members.add(
            &mut run,
            scene,
            Driven { readings: &readings, at: &answered, sightings: &recording.markers, twin: Some(&twin) },
            cancel,
        )?;
    }
    Ok(run)
}

/// Refuses a recording that is likely another than it is taken for, before any time is spent on it; says it only if `forced`.
pub(super) fn refuse(found: Option<String>, forced: bool, progress: &Progress) -> Result<(), CliError> {
    match found {
        Some(what) if forced => progress.warn(&what),
        Some(what) => return Err(CliError::Mistaken(what)),
        None => {}
    }
    Ok(())
}
