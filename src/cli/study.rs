//! `needle_twin study`: what a discretisation costs and how near it comes to independent solutions.

mod speed;

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
use crate::study::stability;
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
    Stability(Stability),
    Speed(speed::Speed),
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
        let bar = ProgressBar::new(cases.len() as u64);
        let style = ProgressStyle::with_template("{bar:40} {pos}/{len} runs, {elapsed}, {eta} left  {msg}");
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        bar.enable_steady_tick(std::time::Duration::from_millis(500));
        let progress = Progress::silent();
        print(&stability::heading())?;
        for case in cases {
            bar.set_message(format!("{}, {} {}", case.method.name, case.change.group, case.change.label));
            let row = self.threads.install(|| case.run(&progress))??;
            if progress.stop() {
                break;
            }
            bar.suspend(|| print(&row.line()))?;
            rows.push(row);
            bar.inc(1);
            if let Some(folder) = &folder {
                report::write_stability(&folder.path, &rows)?;
            }
        }
        bar.finish_and_clear();
        if let Some(folder) = &folder {
            report::write_stability(&folder.path, &rows)?;
        }
        Ok(if progress.stop() { Outcome::Lossy } else { Outcome::Complete })
    }
}

/// Refine the clouds of the presets and compare force and displacement, at rest, with independent finite elements
#[derive(Debug, Args)]
struct Accuracy {
    /// Preset to study (may be repeated) [default: all three]
    #[arg(long = "scene", value_name = "NAME")]
    scenes: Vec<String>,

    /// Method to study, as the table names it, such as "mmls, averaged" (may be repeated) [default: all six]
    #[arg(long = "method", value_name = "NAME", value_parser = accuracy::VARIANTS.map(|v| v.name))]
    methods: Vec<String>,

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
        Study::Stability(stability) => stability.run(),
        Study::Speed(speed) => speed.run(),
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
    /// The methods that were named; the first few for the quick form, otherwise all.
    fn variants(&self) -> Vec<accuracy::Variant> {
        let all = accuracy::VARIANTS;
        match (self.methods.is_empty(), self.quick) {
            (true, true) => all[..accuracy::QUICK].to_vec(),
            (true, false) => all.to_vec(),
            (false, _) => all.into_iter().filter(|v| self.methods.iter().any(|m| m == v.name)).collect(),
        }
    }

    fn run(&self) -> Result<Outcome, CliError> {
        let presets = presets(&self.scenes)?;
        let folder = self.out.as_deref().map(OutputFolder::prepare).transpose()?;
        let cases = accuracy::cases(&presets, &self.variants(), self.quick);
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
