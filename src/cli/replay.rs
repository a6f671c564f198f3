//! `needle_twin replay`: a recording through the twin, offline and deterministic.

use clap::Args;

use super::members::{Drawn, MemberOptions};
use super::options::{OutputOptions, SeriesOptions, ThreadOptions};
use super::progress::Progress;
use super::recorded::RecordedOptions;
use super::{CliError, Outcome, output};
use needle_core::scene::Scene;
use needle_core::twin::Twin;
use needle_estimate::compare::ensemble::Driven;
use needle_estimate::compare::placement::{never_touched, unreached};
use needle_estimate::compare::scale::mistaken;
use needle_estimate::compare::{Finished, Keep, Run, Session, Watch as _};
use needle_recording::{ForceSeries, Reading, Recording};

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
    let readings = arguments.recorded.topics.readings(&recording);
    let keep = arguments.series.keep(folder.is_some(), duration_s(&readings))?;
    let forced = arguments.recorded.force;
    let run = arguments.threads.install(|| replay(&scene, &recording, readings, keep, forced, members.as_ref()))??;
    output::deliver(&run, folder.as_ref(), &arguments.series, arguments.output.json)
}

/// Plays a recording offline as another command (`demo --no-dds`), fields and all.
#[cfg(feature = "ros")]
pub(super) fn offline(scene: &Scene, recording: &Recording, command: &str) -> Result<Run, CliError> {
    let readings = recording.readings(false);
    let keep = Keep { fields: true, duration_s: duration_s(&readings), save_every_s: None };
    let mut run = replay(scene, recording, readings, keep, false, None)?;
    command.clone_into(&mut run.command);
    Ok(run)
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
    members: Option<&Drawn>,
) -> Result<Run, CliError> {
    let mut progress = Progress::preparing("building the model");
    for warning in recording.warnings.iter().chain(&recording.foreign_frame()) {
        progress.warn(warning);
    }
    let session = Session::new(scene, "replay", keep);
    let session = session.map_err(|source| CliError::Build { scene: scene.name.clone(), source })?;
    session.twin().warnings().iter().for_each(|warning| progress.warn(warning));
    let measured = recording.measured();
    refuse_mistaken(session.twin(), recording, &readings, &measured, forced, &progress)?;
    progress.count(readings.len());
    let session = session.of_recording(recording, &measured);
    let Finished { mut run, answered, twin } = session.run(readings.iter().copied(), &mut progress);
    progress.finish();
    let cancel = progress.cancel().clone();
    drop(progress); // it says nothing more of poses
    if let Some(members) = members {
        members.add(
            &mut run,
            scene,
            Driven { readings: &readings, at: &answered, sightings: &recording.markers, twin: Some(&twin) },
            cancel,
        )?;
    }
    Ok(run)
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
    let found = mistaken(twin, readings, measured, recording.scene.as_deref());
    let [m_per_number, zero] = recording.position_scale;
    // the same with the number that the user's sensor shows
    let found = found.map(|what| match unreached(twin, readings, measured) {
        Some(place) if what == never_touched(place, None) => {
            never_touched(place, Some(place.contact_m / m_per_number + zero))
        }
        _ => what,
    });
    match found {
        Some(what) if forced => progress.warn(&what),
        Some(what) => return Err(CliError::Mistaken(what)),
        None => {}
    }
    Ok(())
}
