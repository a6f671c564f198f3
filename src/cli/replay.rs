//! `needle_twin replay`: a recording through the twin, offline and deterministic.

use clap::Args;

use super::members::{Drawn, MemberOptions};
use super::options::{OutputOptions, SeriesOptions, ThreadOptions};
use super::progress::Progress;
use super::recorded::RecordedOptions;
use super::{CliError, Outcome, output};
use needle_core::scene::Scene;
use needle_core::twin::Twin;
use needle_estimate::compare::ensemble::{Answered, Driven};
use needle_estimate::compare::placement::{never_touched, unreached};
use needle_estimate::compare::scale::mistaken;
use needle_estimate::compare::{self, Collector, Keep, Run, Watch as _};
use needle_recording::Recording;
use needle_recording::{ForceSeries, Reading};

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
    let built = compare::build(scene);
    let (mut twin, build_s) = built.map_err(|source| CliError::Build { scene: scene.name.clone(), source })?;
    twin.warnings().iter().for_each(|warning| progress.warn(warning));
    let measured = recording.measured();
    refuse_mistaken(&twin, recording, &readings, &measured, forced, &progress)?;
    progress.count(readings.len());
    let mut collector = Collector::new(&twin, "replay", build_s, keep);
    recording.losses.iter().for_each(|loss| collector.lost(loss.to_string()));
    measured.loss().into_iter().for_each(|loss| collector.lost(loss));
    if !measured.is_empty() {
        collector.measured_source(&recording.source);
    }
    let mut answered = Answered::new(&mut progress);
    let again = readings.iter().copied();
    let mut run = compare::drive(&mut twin, again, Some(&measured), collector, &mut answered);
    let at = answered.at;
    progress.finish();
    let stop = progress.stop_flag();
    drop(progress); // it says nothing more of poses
    if let Some(members) = members {
        members.add(
            &mut run,
            scene,
            Driven { readings: &readings, at: &at, sightings: &recording.markers, twin: Some(&twin) },
            stop,
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
    let reading = |contact_m: f64| never_touched(contact_m, Some(contact_m / m_per_number + zero));
    // the same with the number that the user's sensor shows
    let found = found.map(|what| match unreached(twin, readings, measured) {
        Some(contact_m) if what == never_touched(contact_m, None) => reading(contact_m),
        _ => what,
    });
    match found {
        Some(what) if forced => progress.warn(&what),
        Some(what) => return Err(CliError::Mistaken(what)),
        None => {}
    }
    Ok(())
}
