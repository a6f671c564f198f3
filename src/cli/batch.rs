//! `needle_twin batch`: many recordings, in shards that can run anywhere and again.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::{Args, Subcommand};
use indicatif::{ProgressBar, ProgressStyle};
use rayon::prelude::*;

use super::interrupt::Interrupt;
use super::options::ThreadOptions;
use super::output::OutputFolder;
use super::{CliError, Outcome, print, warn};
use crate::report;
use crate::study::batch::{self, Group, Job, Manifest, Merged, ROWS, Row};

/// Replay or calibrate every recording of a manifest, and say what the samples have in common
///
/// Each recording's row is a file of its own below --out. What is there and of the same manifest, file, scene and version is not
/// done again, so an interrupted batch goes on where it was. Shards of one manifest can run on any machines; `batch merge` puts
/// their folders together.
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub(super) struct Arguments {
    #[command(subcommand)]
    verb: Option<Verb>,

    /// TOML or CSV: a recording per row, with its scene and options
    #[arg(required = true)]
    manifest: Option<PathBuf>,

    /// Folder of the rows, tables and page
    #[arg(long, value_name = "DIR", required = true)]
    out: Option<PathBuf>,

    /// Folder that the manifest's files are looked for from [default: the manifest's own]
    #[arg(long, value_name = "DIR")]
    root: Option<PathBuf>,

    /// Do only every n-th recording, beginning with the i-th: 1/4, 2/4, 3/4 and 4/4 are the whole
    #[arg(long, value_name = "I/N", value_parser = shard)]
    shard: Option<Shard>,

    #[command(flatten)]
    threads: ThreadOptions,

    /// Print batch.json instead of a summary
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// Put the rows of several folders together: tables and page
    Merge(Merge),
}

#[derive(Debug, Args)]
struct Merge {
    /// Folders that `batch` has written
    #[arg(value_name = "DIR", required = true)]
    folders: Vec<PathBuf>,

    /// Folder of the tables and page
    #[arg(long, value_name = "DIR")]
    out: PathBuf,

    /// Print batch.json instead of a summary
    #[arg(long)]
    json: bool,
}

/// One of several parts.
#[derive(Clone, Copy, Debug)]
struct Shard {
    number: usize,
    of: usize,
}

fn shard(text: &str) -> Result<Shard, String> {
    let parts = text.split_once('/').and_then(|(i, n)| Some((i.trim().parse().ok()?, n.trim().parse().ok()?)));
    let whole = parts.filter(|(number, of)| (1..=*of).contains(number));
    whole.map(|(number, of)| Shard { number, of }).ok_or_else(|| "i/n with i from 1 to n, as 2/4".to_owned())
}

pub(super) fn run(arguments: &Arguments) -> Result<Outcome, CliError> {
    match (&arguments.verb, &arguments.manifest, &arguments.out) {
        (Some(Verb::Merge(merge)), ..) => merge.run(),
        (None, Some(manifest), Some(out)) => arguments.work(manifest, out),
        // clap lets no other through
        _ => Ok(Outcome::Complete),
    }
}

impl Merge {
    fn run(&self) -> Result<Outcome, CliError> {
        let merged = batch::merge(&self.folders)?;
        let folder = OutputFolder::prepare(&self.out)?;
        for row in &merged.rows {
            report::write_row(&folder.path, row)?;
        }
        deliver(&folder.path, &merged, self.json)
    }
}

impl Arguments {
    fn work(&self, manifest: &Path, out: &Path) -> Result<Outcome, CliError> {
        let manifest = Manifest::read(manifest, self.root.as_deref())?;
        let folder = OutputFolder::prepare(out)?;
        let shard = self.shard.unwrap_or(Shard { number: 1, of: 1 });
        let numbers = (0..manifest.recordings.len()).filter(|i| i % shard.of == shard.number - 1);
        let jobs: Vec<Job> = numbers.map(|number| Job { manifest: &manifest, number }).collect();
        let done = self.threads.install(|| rows(&jobs, &folder.path))??;
        let mine = jobs.len();
        if done.stopped {
            warn(&format!(
                "interrupted: {} of {mine} recordings are done; the same command goes on from there",
                done.rows.len()
            ));
        }
        let seconds = done.wall_s;
        let each = if done.made > 0 { format!(", {:.2} s each", seconds / done.made as f64) } else { String::new() };
        warn_if_failed(&done.rows);
        let text = format!(
            "{} recordings done in {seconds:.1} s{each}, {} were done before\n",
            done.made,
            done.rows.len() - done.made
        );
        let outcome = if self.shard.is_some() {
            print(&text)?;
            outcome(done.rows.iter().all(|row| row.failed.is_none()))
        } else {
            if !self.json {
                print(&text)?;
            }
            deliver(&folder.path, &Merged::of(done.rows), self.json)?
        };
        Ok(if done.stopped { Outcome::Lossy } else { outcome })
    }
}

/// What came of the jobs.
struct Done {
    rows: Vec<Row>,
    /// Rows that were made now.
    made: usize,
    wall_s: f64,
    stopped: bool,
}

/// Does the jobs whose rows are not there yet.
fn rows(jobs: &[Job], out: &Path) -> Result<Done, CliError> {
    let interrupt = Interrupt::listen();
    let begun = Instant::now();
    let bar = ProgressBar::new(jobs.len() as u64);
    let style = ProgressStyle::with_template("{bar:40} {pos}/{len} recordings, {eta} left  {msg}");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    let stop = || interrupt.pressed();
    let one = |job: &Job| -> Result<Option<(Row, bool)>, CliError> {
        if stop() {
            return Ok(None);
        }
        let known = batch::read(&out.join(ROWS).join(format!("{}.json", job.name()))).ok();
        let known = known.filter(|row| row.failed.is_none() && row.fingerprint == job.fingerprint());
        let made = known.is_none();
        let row = known.unwrap_or_else(|| job.run(&stop));
        if stop() {
            return Ok(None);
        }
        if made {
            report::write_row(out, &row)?;
        }
        bar.set_message(row.name.clone());
        bar.inc(1);
        Ok(Some((row, made)))
    };
    let all: Vec<_> = jobs.par_iter().map(one).collect::<Result<_, CliError>>()?;
    bar.finish_and_clear();
    let done: Vec<(Row, bool)> = all.into_iter().flatten().collect();
    let made = done.iter().filter(|(_, made)| *made).count();
    let rows = done.into_iter().map(|(row, _)| row).collect();
    Ok(Done { rows, made, wall_s: begun.elapsed().as_secs_f64(), stopped: stop() })
}

fn warn_if_failed(rows: &[Row]) {
    for row in rows {
        row.failed.iter().for_each(|reason| warn(&format!("{}: {reason}", row.name)));
        row.losses.iter().for_each(|loss| warn(&format!("{}: {loss}", row.name)));
    }
}

fn outcome(whole: bool) -> Outcome {
    if whole { Outcome::Complete } else { Outcome::Lossy }
}

/// Writes tables and page, and tells the user.
fn deliver(out: &Path, merged: &Merged, json: bool) -> Result<Outcome, CliError> {
    report::write_batch(out, merged)?;
    print(&if json { report::batch_json(merged) } else { summary(merged, out) })?;
    Ok(outcome(merged.failed() == 0 && merged.missing == 0))
}

fn summary(merged: &Merged, out: &Path) -> String {
    let mut text = String::new();
    let (all, failed, missing) = (merged.rows.len(), merged.failed(), merged.missing);
    let _ = writeln!(text, "{all} recordings, {failed} failed, {missing} without a row"); // a String takes anything
    for group in &merged.groups {
        let _ = writeln!(text, "{}", line(group));
    }
    let _ = writeln!(text, "{}: report.html, table.csv, candidates.csv, batch.json", out.display());
    text
}

/// A kind of samples on one line.
fn line(group: &Group) -> String {
    let mut text = group.name.clone();
    if !group.candidate.is_empty() {
        let _ = write!(text, ": {}", group.candidate);
    }
    for (key, mean, within, between) in &group.keys {
        let _ = write!(text, "; {key} {mean:.6}");
        for (what, spread) in [("within", within), ("between", between)] {
            text.extend(spread.map(|s| format!(", {what} {s:.4}")));
        }
    }
    if let (Some(mean), Some(largest)) = (group.mean_end_error, group.largest_end_error) {
        let (within, of) = (group.within_5_percent, group.predicted);
        let _ = write!(
            text,
            "; predicted {:+.1} % (largest {:+.1} %), {within} of {of} within 5 %",
            100.0 * mean,
            100.0 * largest
        );
    }
    text
}
