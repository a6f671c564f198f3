//! `needle_twin batch`: many recordings, in shards that can run anywhere and again.

use needle_estimate::baseline::Against;
use needle_estimate::compare::Cancel;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::{Args, Subcommand};
use rayon::prelude::*;

use super::interrupt::Interrupt;
use super::options::ThreadOptions;
use super::output::OutputFolder;
use super::progress::Bar;
use super::shard::Shard;
use super::{CliError, Outcome, print, warn};
use needle_estimate::batch::{
    self, Group, Job, Manifest, MergeError, Merged, Needed, ROWS, Row, SampleJob, SampleRow, Tables,
};

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
    #[arg(long, value_name = "I/N")]
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
            needle_report::write_row(&folder.path, row)?;
        }
        for row in &merged.joint {
            needle_report::write_sample(&folder.path, row)?;
        }
        deliver(&folder.path, &merged, self.json)
    }
}

impl Arguments {
    fn work(&self, manifest: &Path, out: &Path) -> Result<Outcome, CliError> {
        let manifest = Manifest::read(manifest, self.root.as_deref())?;
        let folder = OutputFolder::prepare(out)?;
        let shard = self.shard.unwrap_or(Shard::WHOLE);
        let done = self.threads.install(|| rows(&manifest, shard, &folder.path))??;
        let mine = (0..manifest.recordings.len()).filter(|i| shard.has(*i)).count();
        if done.stopped {
            warn(&format!(
                "interrupted: {} of {mine} recordings are done; the same command goes on from there",
                done.rows.len()
            ));
        }
        warn_if_failed(&done.rows);
        let text = done.cost();
        let outcome = if self.shard.is_some() {
            print(&text)?;
            outcome(done.rows.iter().all(|row| row.failed.is_none()))
        } else {
            if !self.json {
                print(&text)?;
            }
            deliver(&folder.path, &Merged::of(done.rows, done.joint), self.json)?
        };
        Ok(if done.stopped { Outcome::Lossy } else { outcome })
    }
}

/// What came of the jobs.
struct Done {
    rows: Vec<Row>,
    joint: Vec<SampleRow>,
    /// Rows that were made now, and the runs of the twin and the calibrations that they took.
    made: usize,
    runs: u64,
    calibrations: u64,
    /// Runs that the shared curves took.
    shared_runs: usize,
    wall_s: f64,
    stopped: bool,
}

impl Done {
    /// What it took, for whoever plans more of it.
    fn cost(&self) -> String {
        let (made, seconds) = (self.made, self.wall_s);
        let before = self.rows.len() - made;
        let mut text = format!("{made} recordings done in {seconds:.1} s");
        if made > 0 {
            let _ = write!(text, ", {:.2} s each", seconds / made as f64); // a String takes anything
        }
        if self.calibrations > 0 {
            let each = self.runs as f64 / self.calibrations as f64;
            let _ = write!(text, ", {} calibrations with {each:.1} runs of the twin each", self.calibrations);
        }
        if self.shared_runs > 0 {
            let _ = write!(text, ", {} runs for the curves that they share", self.shared_runs);
        }
        let _ = writeln!(text, ", {before} were done before");
        text
    }
}

/// What a file holds; one that is damaged is said, and done again.
fn still_there<T>(read: fn(&Path) -> Result<T, MergeError>, path: &Path) -> Option<T> {
    match read(path) {
        Err(MergeError::Row { path, reason }) if path.exists() => {
            warn(&format!("{}: {reason}; it is computed again", path.display()));
            None
        }
        outcome => outcome.ok(),
    }
}

/// A row that is there already and still holds.
fn known(job: &Job, out: &Path) -> Option<Row> {
    let row = still_there(batch::read, &out.join(ROWS).join(format!("{}.json", job.name())))?;
    (row.failed.is_none() && row.fingerprint == job.fingerprint()).then_some(row)
}

/// Does the recordings whose rows are not there yet.
fn rows(manifest: &Manifest, shard: Shard, out: &Path) -> Result<Done, CliError> {
    let interrupt = Interrupt::listen();
    let begun = Instant::now();
    let cancel = interrupt.cancel();
    let none = Tables::default();
    let job = |tables, number| Job { manifest, number, tables };
    let all: Vec<Job> = (0..manifest.recordings.len()).map(|n| job(&none, n)).collect();
    let mine: Vec<&Job> = all.iter().filter(|job| shard.has(job.number)).collect();
    let before: Vec<(usize, Option<Row>)> = mine.par_iter().map(|job| (job.number, known(job, out))).collect();
    let (known_samples, samples) = samples_left(&all, shard, out);
    let (there, left): (Vec<_>, Vec<_>) = before.into_iter().partition(|(_, row)| row.is_some());
    let left: Vec<Job> = left.into_iter().map(|(number, _)| job(&none, number)).collect();
    let needed: Vec<Job> = left.iter().chain(samples.iter().flat_map(|sample| &sample.jobs)).copied().collect();
    let mut needed = Needed::of(&needed);
    needed.read(out);
    let curves = Bar::new(needed.runs() as u64, "runs for the curves that all share");
    let tables = needed.make(out, cancel, &|| curves.add(1, ""));
    curves.finish();
    let bar = Bar::new(left.len() as u64, "recordings");
    let one = |left: &Job| -> Result<Option<Row>, CliError> {
        if cancel.is_cancelled() {
            return Ok(None);
        }
        let row = job(&tables, left.number).run(cancel);
        if cancel.is_cancelled() {
            return Ok(None);
        }
        needle_report::write_row(out, &row)?;
        bar.add(1, &row.name);
        Ok(Some(row))
    };
    let made: Vec<Option<Row>> = left.par_iter().map(one).collect::<Result<_, CliError>>()?;
    bar.finish();
    let made: Vec<Row> = made.into_iter().flatten().collect();
    let joint = samples_done(samples, &tables, out, cancel)?;
    let fits = || made.iter().flat_map(|row| &row.fits).filter(|fit| fit.failed.is_none());
    let runs = fits().map(|fit| u64::from(fit.runs)).sum();
    let calibrations = fits().filter(|fit| !fit.keys.is_empty()).count() as u64;
    let (count, wall_s) = (made.len(), begun.elapsed().as_secs_f64());
    let rows = there.into_iter().filter_map(|(_, row)| row).chain(made).collect();
    let joint = known_samples.into_iter().chain(joint).collect();
    Ok(Done {
        rows,
        joint,
        made: count,
        runs,
        calibrations,
        shared_runs: tables.runs(),
        wall_s,
        stopped: cancel.is_cancelled(),
    })
}

/// The samples of a shard whose rows still hold, and those that are left.
fn samples_left<'a>(all: &[Job<'a>], shard: Shard, out: &Path) -> (Vec<SampleRow>, Vec<SampleJob<'a>>) {
    let samples = SampleJob::all(all).into_iter().enumerate().filter(|(i, _)| shard.has(*i)).map(|(_, sample)| sample);
    let (mut known, mut left) = (Vec::new(), Vec::new());
    for sample in samples {
        let row = still_there(batch::read_sample, &needle_report::sample_path(out, sample.name));
        match row.filter(|row| row.fingerprint == sample.fingerprint()) {
            Some(row) => known.push(row),
            None => left.push(sample),
        }
    }
    (known, left)
}

/// Fits the recordings of each sample together.
fn samples_done(
    samples: Vec<SampleJob>,
    tables: &Tables,
    out: &Path,
    cancel: &Cancel,
) -> Result<Vec<SampleRow>, CliError> {
    let bar = Bar::new(samples.len() as u64, "samples fitted together");
    let one = |sample: &SampleJob| -> Result<Option<SampleRow>, CliError> {
        let jobs = sample.jobs.iter().map(|job| Job { tables, ..*job }).collect();
        let row = SampleJob { name: sample.name, jobs }.run(cancel);
        if cancel.is_cancelled() {
            return Ok(None);
        }
        needle_report::write_sample(out, &row)?;
        bar.add(1, &row.name);
        Ok(Some(row))
    };
    let done: Vec<Option<SampleRow>> = samples.par_iter().map(one).collect::<Result<_, CliError>>()?;
    bar.finish();
    Ok(done.into_iter().flatten().collect())
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
    needle_report::write_batch(out, merged)?;
    print(&if json { needle_report::batch_json(merged) } else { summary(merged, out) })?;
    Ok(outcome(merged.failed() == 0 && merged.missing == 0))
}

fn summary(merged: &Merged, out: &Path) -> String {
    let mut text = String::new();
    let (all, failed, missing) = (merged.rows.len(), merged.failed(), merged.missing);
    let _ = writeln!(text, "{all} recordings, {failed} failed, {missing} without a row"); // a String takes anything
    for group in &merged.groups {
        let _ = writeln!(text, "{}", line(group));
    }
    let [better, as_good, worse] =
        [Against::Better, Against::AsGood, Against::Worse].map(|against| merged.standing(against));
    if better + as_good + worse > 0 {
        let _ = writeln!(text, "than the best baseline: better in {better}, as good in {as_good}, worse in {worse}");
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
