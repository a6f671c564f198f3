//! Writes a set of files such that no incomplete file ever exists under its own name.

use super::ReportError;
use std::{
    fs,
    io::{self, Write as _},
    path::{Path, PathBuf},
    process,
};

/// A file that is ready to be written: its path in the output folder, and its content.
pub(super) struct Rendered {
    pub name: String,
    pub content: Vec<u8>,
}

impl Rendered {
    pub(crate) fn new(name: impl Into<String>, content: impl Into<Vec<u8>>) -> Self {
        Self { name: name.into(), content: content.into() }
    }
}

/// Creates the output folder and checks that files can be written in it. Worth calling before a long run.
///
/// # Errors
/// [`ReportError::Folder`] or [`ReportError::File`] naming the folder or file and the reason.
pub fn prepare(out: &Path) -> Result<(), ReportError> {
    make_folder(out)?;
    let probe = temporary(&out.join("metrics.json"));
    let written = fs::write(&probe, b"probe").and_then(|()| fs::remove_file(&probe));
    written.map_err(|source| ReportError::File { path: out.join("metrics.json"), source })
}

/// Writes all files under temporary names in the same folders, then renames them. If one can't be written, the
/// temporary ones are removed, and existing files remain unchanged.
///
/// The first file marks the set as complete. Its old version is removed before the others are replaced, and its new
/// version is written last. So if it exists, the other files belong to the same run, even if the process or the
/// machine failed.
pub(super) fn write(out: &Path, files: &[Rendered]) -> Result<Vec<PathBuf>, ReportError> {
    let paths: Vec<PathBuf> = files.iter().map(|f| out.join(&f.name)).collect();
    let result = write_and_rename(files, &paths);
    if result.is_err() {
        for path in &paths {
            // Best effort: the error that is reported is the original one.
            let _ = fs::remove_file(temporary(path));
        }
    }
    result.map(|()| paths)
}

fn write_and_rename(files: &[Rendered], paths: &[PathBuf]) -> Result<(), ReportError> {
    for (file, path) in files.iter().zip(paths) {
        make_folder(path.parent().unwrap_or(Path::new(".")))?;
        write_through(&temporary(path), &file.content)
            .map_err(|source| ReportError::File { path: path.clone(), source })?;
    }
    if let ([seal, others @ ..], true) = (paths, paths.len() > 1) {
        remove(seal)?;
        others.iter().try_for_each(|path| put_in_place(path))?;
        return put_in_place(seal);
    }
    paths.iter().try_for_each(|path| put_in_place(path))
}

fn put_in_place(path: &Path) -> Result<(), ReportError> {
    fs::rename(temporary(path), path).map_err(|source| ReportError::File { path: path.to_owned(), source })
}

fn remove(path: &Path) -> Result<(), ReportError> {
    match fs::remove_file(path) {
        Err(source) if source.kind() != io::ErrorKind::NotFound => {
            Err(ReportError::File { path: path.to_owned(), source })
        }
        _ => Ok(()),
    }
}

/// Removes a file of an earlier run, if there is one.
pub(super) fn remove_file(path: &Path) -> Result<(), ReportError> {
    match fs::remove_file(path) {
        Err(source) if source.kind() != io::ErrorKind::NotFound => {
            Err(ReportError::File { path: path.to_owned(), source })
        }
        _ => Ok(()),
    }
}

fn make_folder(path: &Path) -> Result<(), ReportError> {
    fs::create_dir_all(path).map_err(|source| ReportError::Folder { path: path.to_owned(), source })
}

fn write_through(path: &Path, content: &[u8]) -> io::Result<()> {
    let mut file = fs::File::create(path)?;
    file.write_all(content)?;
    file.sync_data() // a full disk or a lost network folder shows up here, not after the rename
}

/// In the same folder, so that the rename stays within one file system; the process id separates concurrent runs.
fn temporary(path: &Path) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!(".{name}.{}.partial", process::id()))
}
