//! The files that a run leaves: complete, finite, atomic.
#![allow(clippy::unwrap_used, clippy::panic)]

mod synthetic_run;

use needle_twin::{compare::Run, report};
use std::fs;

#[test]
fn all_files_are_written_and_nothing_else() {
    let out = tempfile::tempdir().unwrap();
    let run = synthetic_run::needle(1000.0);
    report::prepare(out.path()).unwrap();
    let paths = report::write_all(&out.path().join("a/b"), &run).unwrap();
    if let Ok(keep) = std::env::var("KEEP_REPORT") {
        report::write_all(keep.as_ref(), &run).unwrap();
    }
    let mut names: Vec<String> =
        fs::read_dir(out.path().join("a/b")).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    assert_eq!(names.len(), paths.len());
    println!("{names:?}");
}

#[test]
fn empty() {
    let out = tempfile::tempdir().unwrap();
    report::write_all(out.path(), &Run::default()).unwrap();
}
