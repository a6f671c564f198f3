//! Options that several sub-commands share.

use std::path::PathBuf;

use clap::Args;

use super::CliError;
use needle_core::scene::{Override, Scene};
use needle_estimate::compare::Keep;

/// Changes to a scene.
#[derive(Clone, Debug, Args)]
pub(super) struct SetOptions {
    /// Change a key of the scene by its dotted path, as in material.poisson_ratio=0.499 (may be repeated;
    /// `needle_twin scene show --keys` lists every key)
    #[arg(long = "set", value_name = "KEY=VALUE", help_heading = "Scene")]
    pub set: Vec<String>,
}

impl SetOptions {
    /// The scene with the changes and then those of `more`.
    pub(super) fn apply(&self, scene: &Scene, more: impl IntoIterator<Item = Override>) -> Result<Scene, CliError> {
        let mut changes = self.set.iter().map(|text| Override::parse(text, "--set")).collect::<Result<Vec<_>, _>>()?;
        changes.extend(more);
        Ok(if changes.is_empty() { scene.clone() } else { scene.with(&changes)? })
    }
}

/// Where results go.
#[derive(Debug, Args)]
#[command(next_help_heading = "Output")]
pub(super) struct OutputOptions {
    /// Write metrics.json, force.csv, targets.csv, final.vtu, force.png and report.html into this folder
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,

    /// Print the metrics as JSON instead of a summary
    #[arg(long)]
    pub json: bool,
}

/// Most files of a time series.
const MOST_FRAMES: f64 = 2000.0;

/// The deformed sample over time.
#[derive(Debug, Default, Args)]
#[command(next_help_heading = "Output")]
pub(super) struct SeriesOptions {
    /// Write series.pvd with the deformed sample every so many seconds of the motion, for ParaView (with --out)
    #[arg(long, value_name = "SECONDS", requires = "out")]
    pub save_every: Option<f64>,
}

impl SeriesOptions {
    /// What a run of that length keeps.
    pub(super) fn keep(&self, fields: bool, duration_s: Option<f64>) -> Result<Keep, CliError> {
        if let Some(every) = self.save_every {
            let shortest = duration_s.unwrap_or(0.0) / MOST_FRAMES;
            if !(every.is_finite() && every > 0.0 && every >= shortest) {
                return Err(CliError::SaveEvery { every, shortest });
            }
        }
        Ok(Keep { fields, duration_s, save_every_s: self.save_every })
    }
}

/// How many threads step the tissue.
#[derive(Clone, Debug, Args)]
pub(super) struct ThreadOptions {
    /// Threads that step the tissue [default: one per core]; the results don't depend on it
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024), help_heading = "Run")]
    pub threads: Option<u16>,
}

impl ThreadOptions {
    /// Does some work in a pool of so many threads.
    pub(super) fn install<T: Send>(&self, work: impl FnOnce() -> T + Send) -> Result<T, CliError> {
        let threads = self.threads.map_or(0, usize::from); // 0: one per core
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        Ok(pool.map_err(|source| CliError::Threads { threads, source })?.install(work))
    }
}
