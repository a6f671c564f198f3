//! `needle_twin study`: what a discretisation costs and how near it comes to independent solutions.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use indicatif::{ProgressBar, ProgressStyle};

use super::interrupt::Interrupt;
use super::options::{SetOptions, ThreadOptions};
use super::output::OutputFolder;
use super::progress::Progress;
use super::{CliError, Outcome, print, warn};
use crate::compare::Watch as _;
use crate::report;
use crate::scene::Override;
use crate::study::accuracy::{self, StudyError};
use crate::study::verification::{self, Verification};

/// Presets that have a reference solution.
const PRESETS: [&str; 3] = ["compression", "indentation", "needle_insertion"];

/// Study the method: accuracy against cost
#[derive(Debug, Args)]
pub(super) struct Arguments {
    #[command(subcommand)]
    study: Study,
}

#[derive(Debug, Subcommand)]
enum Study {
    Accuracy(Accuracy),
    Verification(Verify),
}

/// Refine the clouds of the presets and compare force and displacement, at rest, with independent finite elements
#[derive(Debug, Args)]
struct Accuracy {
    /// Preset to study (may be repeated) [default: all three]
    #[arg(long = "scene", value_name = "NAME")]
    scenes: Vec<String>,

    /// Coarser clouds, fewer methods, half the depth: about two minutes
    #[arg(long)]
    quick: bool,

    /// Write accuracy.csv and a picture per scene into this folder
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,

    #[command(flatten)]
    threads: ThreadOptions,
}

/// Run the presets as they ship, at their own speed, and hold them against independent finite elements
#[derive(Debug, Args)]
struct Verify {
    /// Preset to run (may be repeated) [default: all three]
    #[arg(long = "scene", value_name = "NAME")]
    scenes: Vec<String>,

    #[command(flatten)]
    set: SetOptions,

    /// Write verification.csv and a picture per scene into this folder
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,

    #[command(flatten)]
    threads: ThreadOptions,
}

pub(super) fn run(arguments: &Arguments) -> Result<Outcome, CliError> {
    match &arguments.study {
        Study::Accuracy(accuracy) => accuracy.run(),
        Study::Verification(verify) => verify.run(),
    }
}

/// The presets of these names; all of them if there is none.
fn presets(names: &[String]) -> Result<Vec<&'static str>, StudyError> {
    if let Some(unknown) = names.iter().find(|s| !PRESETS.contains(&s.as_str())) {
        return Err(StudyError::NoReference(unknown.clone()));
    }
    let wanted = |p: &&str| names.is_empty() || names.iter().any(|s| s == p);
    Ok(PRESETS.into_iter().filter(wanted).collect())
}

impl Verify {
    fn run(&self) -> Result<Outcome, CliError> {
        let presets = presets(&self.scenes)?;
        let folder = self.out.as_deref().map(OutputFolder::prepare).transpose()?;
        let keys = self.set.set.iter().map(|text| Override::parse(text, "--set")).collect::<Result<Vec<_>, _>>()?;
        let mut all = Vec::new();
        for preset in presets {
            let mut progress = Progress::preparing(preset);
            let one = self.threads.install(|| Verification::run(preset, &keys, None, &mut progress))??;
            progress.finish();
            print(&verification::table(&one))?;
            all.push(one);
            if progress.stop() {
                break;
            }
        }
        if let Some(folder) = folder {
            for path in report::write_verification(&folder.path, &all)? {
                print(&format!("{}\n", path.display()))?;
            }
        }
        let complete = all.iter().all(|one| one.run.losses.is_empty());
        Ok(if complete { Outcome::Complete } else { Outcome::Lossy })
    }
}

impl Accuracy {
    fn run(&self) -> Result<Outcome, CliError> {
        let presets = presets(&self.scenes)?;
        let folder = self.out.as_deref().map(OutputFolder::prepare).transpose()?;
        let cases = accuracy::cases(&presets, self.quick);
        let bar = ProgressBar::new(cases.len() as u64);
        let style = ProgressStyle::with_template("{bar:40} {pos}/{len} runs, {elapsed}  {msg}");
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        let interrupt = Interrupt::listen();
        print(&accuracy::heading())?;
        let mut rows = Vec::new();
        let mut complete = true;
        for case in cases {
            if interrupt.pressed() {
                warn(&format!("interrupted after {} runs", rows.len()));
                complete = false;
                break;
            }
            bar.set_message(format!("{}, {}, spacing x {}", case.preset, case.variant.name, case.spacing));
            let row = self.threads.install(|| case.run())??;
            bar.suspend(|| print(&row.line()))?;
            rows.push(row);
            bar.inc(1);
        }
        bar.finish_and_clear();
        print(&accuracy::orders(&rows))?;
        if let Some(folder) = folder {
            for path in report::write_accuracy(&folder.path, &rows)? {
                print(&format!("{}\n", path.display()))?;
            }
        }
        Ok(if complete { Outcome::Complete } else { Outcome::Lossy })
    }
}
