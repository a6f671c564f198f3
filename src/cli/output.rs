//! What a run leaves: files in a folder, a summary or JSON on stdout, and whether it was complete.

use std::path::{Path, PathBuf};

use super::options::{OutputOptions, SeriesOptions};
use super::{CliError, Outcome, print, summary, warn};
use crate::compare::Run;
use crate::report;

/// A folder for results that is known to be writable. If nothing is ever written, it goes again.
pub(super) struct OutputFolder {
    pub path: PathBuf,
    made_here: bool,
}

impl OutputFolder {
    /// Makes the folder and proves that it can be written, before any time is spent on a run.
    pub(super) fn prepare(path: &Path) -> Result<Self, CliError> {
        let folder = Self { path: path.to_owned(), made_here: !path.exists() };
        report::prepare(path)?;
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

/// Writes the files and tells the user.
pub(super) fn deliver(
    run: &Run,
    folder: Option<&OutputFolder>,
    series: &SeriesOptions,
    json: bool,
) -> Result<Outcome, CliError> {
    let mut files = folder.map(|folder| report::write_all(&folder.path, run)).transpose()?.unwrap_or_default();
    if let (Some(folder), Some(_)) = (folder, series.save_every) {
        report::write_series(&folder.path, run)?;
        files.push(folder.path.join("series.pvd"));
    }
    for loss in &run.losses {
        warn(loss);
    }
    if let Some(reason) = &run.diverged {
        warn(&format!("diverged: {reason}"));
    }
    print(&if json { report::metrics_json(run) } else { summary::summary(run, &files) })?;
    let complete = run.losses.is_empty() && run.diverged.is_none();
    Ok(if complete { Outcome::Complete } else { Outcome::Lossy })
}
