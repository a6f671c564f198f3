//! `needle_twin solve`: a scene's own motion, answered pose by pose.

use clap::Args;

use super::members::{Drawn, MemberOptions};
use super::options::{OutputOptions, SeriesOptions, SetOptions, ThreadOptions};
use super::progress::Progress;
use super::{CliError, Outcome, output, scene_file};
use needle_core::scene::{Motion, Override, Scene};
use needle_estimate::compare::ensemble::Driven;
use needle_estimate::compare::{Finished, Keep, Run, Session, Watch as _};

/// Run a scene's own motion: a stream of poses, each answered as the live node would, as fast as the machine allows
#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Preset or scene file (`needle_twin scene list` names the presets)
    #[arg(long, value_name = "NAME|FILE", help_heading = "Scene")]
    scene: String,

    #[command(flatten)]
    set: SetOptions,

    /// Depth to reach, m, positive into the sample [default: the scene's]
    #[arg(long, value_name = "D", allow_negative_numbers = true, help_heading = "Motion")]
    depth_m: Option<String>,

    /// Speed, m/s [default: the scene's]
    #[arg(long, value_name = "V", allow_negative_numbers = true, help_heading = "Motion")]
    speed_m_per_s: Option<String>,

    /// Poses per second [default: the scene's, 1000 if it has none]
    #[arg(long, value_name = "R", allow_negative_numbers = true, help_heading = "Motion")]
    pose_hz: Option<String>,

    #[command(flatten)]
    members: MemberOptions,

    #[command(flatten)]
    threads: ThreadOptions,

    #[command(flatten)]
    series: SeriesOptions,

    #[command(flatten)]
    output: OutputOptions,
}

pub(super) fn run(arguments: &Arguments) -> Result<Outcome, CliError> {
    let scene = arguments.set.apply(&scene_file::load(&arguments.scene)?, arguments.motion())?;
    let motion = scene.motion.ok_or_else(|| CliError::NoMotion { scene: scene.name.clone() })?;
    let members = arguments.members.draw(&scene)?;
    let folder = output::prepare(&arguments.output)?;
    let duration_s = Some((motion.pose_count() - 1.0) / motion.pose_rate.get());
    let keep = arguments.series.keep(folder.is_some(), duration_s)?;
    let run = arguments.threads.install(|| solve(&scene, &motion, keep, members.as_ref()))??;
    output::deliver(&run, folder.as_ref(), &arguments.series, arguments.output.json)
}

impl Arguments {
    /// The motion's options as changes of the scene, so that they obey its ranges.
    fn motion(&self) -> impl Iterator<Item = Override> {
        [
            ("motion.depth_m", "--depth-m", &self.depth_m),
            ("motion.speed_m_per_s", "--speed-m-per-s", &self.speed_m_per_s),
            ("motion.pose_hz", "--pose-hz", &self.pose_hz),
        ]
        .into_iter()
        .filter_map(|(path, option, value)| value.as_ref().map(|value| Override::text(path, value, option)))
    }
}

/// Runs a scene's own motion.
pub(super) fn solve(scene: &Scene, motion: &Motion, keep: Keep, members: Option<&Drawn>) -> Result<Run, CliError> {
    let mut progress = Progress::preparing("building the model");
    let session = Session::new(scene, "solve", keep);
    let session = session.map_err(|source| CliError::Build { scene: scene.name.clone(), source })?;
    session.twin().warnings().iter().for_each(|warning| progress.warn(warning));
    progress.count(motion.pose_count() as usize);
    let Finished { mut run, answered, twin } = session.run(Session::motion(motion), &mut progress);
    progress.finish();
    let cancel = progress.cancel().clone();
    drop(progress); // it says nothing more of poses
    if let Some(members) = members {
        let readings: Vec<_> = Session::motion(motion).collect();
        members.add(
            &mut run,
            scene,
            Driven { readings: &readings, at: &answered, sightings: &[], twin: Some(&twin) },
            cancel,
        )?;
    }
    Ok(run)
}
