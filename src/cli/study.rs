//! `needle_twin study`: what a discretisation costs, how near it comes to independent solutions, and what a closed loop does under faults.

mod accuracy;
#[cfg(feature = "ros")]
mod hazards;
mod matrix;
mod sensitivity;
mod speed;

use std::path::PathBuf;

use clap::{Args, Subcommand};

use self::accuracy::{Accuracy, Merge, PRESETS};
use super::options::{SetOptions, ThreadOptions};
use super::output::OutputFolder;
use super::progress::{Progress, bar};
use super::{CliError, Outcome, print, warn};
use needle_core::scene::Override;
use needle_estimate::compare::Watch as _;
use needle_studies::accuracy::StudyError;
use needle_studies::composites::COMPOSITES;
use needle_studies::stability;
use needle_studies::verification::{self, Verification};

/// Study the method: accuracy against cost, stability, and faults of a closed loop
#[derive(Debug, Args)]
pub(super) struct Arguments {
    #[command(subcommand)]
    study: Study,
}

#[derive(Debug, Subcommand)]
enum Study {
    Accuracy(Accuracy),
    Merge(Merge),
    Verification(Verify),
    Stability(Stability),
    Speed(speed::Speed),
    Matrix(matrix::Matrix),
    Sensitivity(sensitivity::SensitivityArguments),
    #[cfg(feature = "ros")]
    Hazards(hazards::Hazards),
}

/// Drive the indentation on until each method ends, and map how deep it came and why it ended
#[derive(Debug, Args)]
struct Stability {
    /// Three methods, five changes, a coarse cloud: about two minutes
    #[arg(long)]
    quick: bool,

    /// Write stability.csv and the map into this folder; runs that its stability.csv has already are not run again
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,

    #[command(flatten)]
    threads: ThreadOptions,
}

impl Stability {
    fn run(&self) -> Result<Outcome, CliError> {
        let folder = self.out.as_deref().map(OutputFolder::prepare).transpose()?;
        let known = folder.as_ref().and_then(|f| std::fs::read_to_string(f.path.join("stability.csv")).ok());
        let mut rows = known.map_or_else(Vec::new, |text| stability::parse(&text));
        let cases: Vec<_> =
            stability::cases(self.quick).into_iter().filter(|c| !rows.iter().any(|r| r.is_of(c))).collect();
        if !rows.is_empty() {
            warn(&format!("{} runs are known, {} are left", rows.len(), cases.len()));
        }
        let bar = bar(cases.len() as u64, "{pos}/{len} runs");
        let progress = Progress::silent();
        print(&stability::heading())?;
        for case in cases {
            bar.set_message(format!("{}, {} {}", case.method.name, case.change.group, case.change.label));
            let row = self.threads.install(|| case.run(&progress))??;
            if progress.cancel().is_cancelled() {
                break;
            }
            bar.suspend(|| print(&row.line()))?;
            rows.push(row);
            bar.inc(1);
            if let Some(folder) = &folder {
                needle_report::write_stability(&folder.path, &rows)?;
            }
        }
        bar.finish_and_clear();
        if let Some(folder) = &folder {
            needle_report::write_stability(&folder.path, &rows)?;
        }
        Ok(if progress.cancel().is_cancelled() { Outcome::Lossy } else { Outcome::Complete })
    }
}

/// Run the presets as they ship and samples of several materials, at their own speed, and hold them against independent finite elements
#[derive(Debug, Args)]
struct Verify {
    /// Scene to run (may be repeated): compression, indentation, needle_insertion, layered_indentation, layered_needle,
    /// inclusion_indentation, inclusion_compression or membrane_indentation [default: all]
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
        Study::Merge(merge) => merge.run(),
        Study::Verification(verify) => verify.run(),
        Study::Stability(stability) => stability.run(),
        Study::Speed(speed) => speed.run(),
        Study::Matrix(matrix) => matrix.run(),
        Study::Sensitivity(sensitivity) => sensitivity.run(),
        #[cfg(feature = "ros")]
        Study::Hazards(hazards) => hazards.run(),
    }
}

/// The scenes of these names that have a reference; all of them if none is named.
fn verified(names: &[String]) -> Result<Vec<&'static str>, StudyError> {
    let known = || PRESETS.into_iter().chain(COMPOSITES.iter().map(|c| c.name));
    if let Some(unknown) = names.iter().find(|s| known().all(|k| k != s.as_str())) {
        return Err(StudyError::NoReference(unknown.clone()));
    }
    Ok(known().filter(|k| names.is_empty() || names.iter().any(|s| s == k)).collect())
}

impl Verify {
    fn run(&self) -> Result<Outcome, CliError> {
        let scenes = verified(&self.scenes)?;
        let folder = self.out.as_deref().map(OutputFolder::prepare).transpose()?;
        let keys = self.set.set.iter().map(|text| Override::parse(text, "--set")).collect::<Result<Vec<_>, _>>()?;
        let mut all = Vec::new();
        for scene in scenes {
            let mut progress = Progress::preparing(scene);
            let one = self.threads.install(|| Verification::run(scene, &keys, None, &mut progress))??;
            progress.finish();
            print(&verification::table(&one))?;
            all.push(one);
            if progress.cancel().is_cancelled() {
                break;
            }
        }
        if let Some(folder) = folder {
            for path in needle_report::write_verification(&folder.path, &all)? {
                print(&format!("{}\n", path.display()))?;
            }
        }
        let complete = all.iter().all(|one| one.run.losses.is_empty());
        Ok(if complete { Outcome::Complete } else { Outcome::Lossy })
    }
}
