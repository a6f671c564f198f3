//! Options of an ensemble, for the commands that run a scene.

use clap::Args;

use super::CliError;
use super::progress::Bar;
use needle_core::scene::Scene;
use needle_estimate::compare::ensemble::{self, Crew, Driven, Member, Size};
use needle_estimate::compare::{Cancel, Run};

/// How many members, and the seed of their draws.
#[derive(Debug, Args)]
#[command(next_help_heading = "Ensemble")]
pub(super) struct MemberOptions {
    /// Run so many twins as well, with values of the keys in the scene's [uncertainty], for the band in which the force lies
    #[arg(long, value_name = "N")]
    members: Option<usize>,

    /// Seed of the members' draws; nothing else is drawn at random
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
}

/// Members that are drawn, before any time is spent on a run.
pub(super) struct Drawn {
    size: Size,
    members: Vec<Member>,
}

impl MemberOptions {
    /// The members of a scene, where some are wanted.
    pub(super) fn draw(&self, scene: &Scene) -> Result<Option<Drawn>, CliError> {
        let Some(members) = self.members else { return Ok(None) };
        let size = Size { members, seed: self.seed };
        Ok(Some(Drawn { size, members: ensemble::members(scene, size)? }))
    }
}

impl Drawn {
    /// Runs them over what drove a finished run, and adds what they say to it.
    pub(super) fn add(&self, run: &mut Run, scene: &Scene, driven: Driven, cancel: Cancel) -> Result<(), CliError> {
        let bar = Bar::new(self.size.members as u64, "members");
        let done = || bar.add(1, "");
        let crew = Crew { threads: rayon::current_num_threads(), cancel, done: &done };
        let added = ensemble::add(run, scene, &self.members, driven, self.size, &crew);
        bar.finish();
        Ok(added?)
    }
}
