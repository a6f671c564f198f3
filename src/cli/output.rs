//! What a run leaves: files in a folder, a summary or JSON on stdout, and whether it was complete.

use std::path::{Path, PathBuf};

use super::options::{OutputOptions, SeriesOptions};
use super::{CliError, Outcome, print, summary, warn};
use needle_estimate::compare::{Explains, Run};
use needle_report::ReportError;

/// A folder for results that is known to be writable. If nothing is ever written, it goes again.
pub(super) struct OutputFolder {
    pub path: PathBuf,
    made_here: bool,
}

impl OutputFolder {
    /// Makes the folder and proves that it can be written, before any time is spent on a run.
    pub(super) fn prepare(path: &Path) -> Result<Self, CliError> {
        let folder = Self { path: path.to_owned(), made_here: !path.exists() };
        needle_report::prepare(path)?;
        Ok(folder)
    }
}

impl Drop for OutputFolder {
    fn drop(&mut self) {
        if self.made_here {
            // Only an empty folder can be removed: where results are in it, this does nothing.
            let _ = std::fs::remove_dir(&self.path);
        }
    }
}

/// Makes the output folder, if one is wanted.
pub(super) fn prepare(options: &OutputOptions) -> Result<Option<OutputFolder>, CliError> {
    options.out.as_deref().map(OutputFolder::prepare).transpose()
}

fn write(run: &Run, folder: &Path, series: &SeriesOptions) -> Result<Vec<PathBuf>, ReportError> {
    let mut files = needle_report::write_all(folder, run)?;
    needle_report::clear_series(folder)?;
    if series.save_every.is_some() {
        needle_report::write_series(folder, run)?;
        files.push(folder.join("series.pvd"));
    }
    Ok(files)
}

/// Writes the files and tells the user. Files that can't be written are a loss, not the end.
pub(super) fn deliver(
    run: &Run,
    folder: Option<&OutputFolder>,
    series: &SeriesOptions,
    json: bool,
) -> Result<Outcome, CliError> {
    let written = folder.map(|folder| write(run, &folder.path, series)).transpose();
    if let Err(error) = &written {
        // A run may have taken hours: what it found goes to stdout even when the disk is full.
        warn(&format!("{error}: its files are not complete, but the figures of the run follow on stdout"));
    }
    let all_written = written.is_ok();
    let files = written.ok().flatten().unwrap_or_default();
    for loss in &run.losses {
        warn(loss);
    }
    let verdict = run.verdict();
    if matches!(verdict.explains, Explains::No | Explains::InPart) {
        warn(&verdict.line());
    }
    // too few readings for a verdict are no fault
    let quiet = usize::from(verdict.explains == Explains::NoMeasurement && verdict.too_little);
    verdict.reasons.iter().skip(quiet).for_each(|reason| warn(reason));
    print(&if json { needle_report::metrics_json(run) } else { summary::summary(run, &files) })?;
    let complete = run.losses.is_empty() && run.diverged.is_none() && all_written;
    let complete = complete && run.unstable().is_empty() && verdict.explains != Explains::No;
    Ok(if complete { Outcome::Complete } else { Outcome::Lossy })
}
