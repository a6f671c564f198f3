//! `study accuracy` and `study merge`: no row is lost or doubled, however the study was cut into parts or interrupted.
#![allow(clippy::unwrap_used, clippy::panic)]

use assert_cmd::Command;
use needle_core::scene::Scene;
use needle_studies::accuracy::{self, Extent, Row, plan};
use std::collections::BTreeSet;
use std::path::Path;
use std::process::Output;

/// The cheapest of the study: linear tetrahedra, few of them.
const SMALL: [&str; 7] = ["study", "accuracy", "--scene", "compression", "--method", "tet4", "--quick"];

fn run(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_needle_twin")).args(arguments).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn names(rows: &[Row]) -> BTreeSet<String> {
    let names: BTreeSet<String> = rows.iter().map(|row| row.case.name()).collect();
    assert_eq!(names.len(), rows.len(), "no row is there twice");
    names
}

/// What doesn't depend on the machine.
fn results(rows: &[Row]) -> BTreeSet<String> {
    rows.iter().map(|r| format!("{} {:?} {:?}", r.case.name(), r.force_error, r.displacement_error)).collect()
}

fn read(folder: &Path, name: &str) -> Vec<Row> {
    accuracy::read(&folder.join(name)).unwrap()
}

#[test]
fn shards_that_are_merged_are_the_whole_study() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let scene = Scene::preset("compression").unwrap();
    let all = plan(&scene, Extent::Quick).unwrap();
    let wanted: BTreeSet<String> = all.iter().filter(|c| c.method == "tet4").map(|c| c.name()).collect();

    // two parts into one folder, as a batch scheduler does it, and one more run of the first
    for (shard, out) in [("1/2", "parts"), ("2/2", "parts"), ("1/2", "again")] {
        let done = run(&[&SMALL[..], &["--threads", "1", "--shard", shard, "--out", &path(out)]].concat());
        assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
        assert!(text(&done.stdout).contains("ms/pose"), "{}", text(&done.stdout));
    }
    let parts = [
        read(&folder.path().join("parts"), "accuracy.1of2.csv"),
        read(&folder.path().join("parts"), "accuracy.2of2.csv"),
    ];
    assert!(parts[0].len().abs_diff(parts[1].len()) <= 1 && parts[0].len() > 3, "the parts are of one size");
    assert_eq!(names(&parts.concat()), wanted);
    let again = read(&folder.path().join("again"), "accuracy.1of2.csv");
    assert_eq!(results(&again), results(&parts[0]), "errors don't depend on the run");

    let merged = run(&["study", "merge", &path("parts"), &path("again"), "--quick", "--out", &path("whole")]);
    let said = text(&merged.stderr);
    assert_eq!(merged.status.code(), Some(3), "the other methods are missing: {said}");
    let missing = all.iter().filter(|c| c.method != "tet4").count();
    assert_eq!(said.matches("missing: compression, m").count(), missing, "{said}");
    assert!(said.contains(&format!("{} rows were there more than once", again.len())), "{said}");
    let whole = read(&folder.path().join("whole"), "accuracy.csv");
    assert_eq!(names(&whole), wanted);
    assert_eq!(results(&whole), results(&parts.concat()));
    for row in &whole {
        let same = parts.concat().into_iter().chain(again.clone()).filter(|r| r.case == row.case);
        assert_eq!(same.map(|r| r.cost_s).reduce(f64::min), Some(row.cost_s), "the cheapest run is kept");
    }
    for file in ["accuracy_compression.svg", "accuracy_compression.png", "accuracy.html"] {
        assert!(folder.path().join("whole").join(file).metadata().unwrap().len() > 5000, "{file}");
    }

    // nothing is left to be run where all is known
    let resumed = run(&[&SMALL[..], &["--threads", "1", "--out", &path("whole")]].concat());
    assert_eq!(resumed.status.code(), Some(0));
    assert!(text(&resumed.stderr).contains("0 are left"), "{}", text(&resumed.stderr));
    assert_eq!(read(&folder.path().join("whole"), "accuracy.csv"), whole);
}

/// Finite elements lock less where the cloud is finer: the errors are the method's, not noise.
#[test]
fn rows_hold_what_they_say() {
    let folder = tempfile::tempdir().unwrap();
    let done = run(&[&SMALL[..], &["--out", &folder.path().display().to_string()]].concat());
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    let rows = read(folder.path(), "accuracy.csv");
    let of = |dimension: &'static str| {
        let mut rows: Vec<&Row> =
            rows.iter().filter(|r| r.case.dimension == dimension && r.case.pose_hz == 1000.0).collect();
        rows.sort_by_key(|r| r.nodes);
        rows
    };
    let errors: Vec<f64> = of("axisymmetric").iter().map(|r| r.max_force_error().unwrap()).collect();
    assert!(errors.len() == 4 && errors.windows(2).all(|w| w[1] < w[0]) && errors[3] < 0.05, "{errors:?}");
    for row in &rows {
        assert!(row.max_force_error() >= row.rms_force_error() && row.displacement_error.unwrap() < 0.1, "{row:?}");
        assert!((0.3..1.0).contains(&row.min_jacobian) && row.cost_s > 0.0 && row.ended.is_none(), "{row:?}");
        assert!((row.simulated_s - 2.5).abs() < 1e-9 && row.poses == (2.5 * row.case.pose_hz) as u64 + 1, "{row:?}");
    }
    let space = rows.iter().find(|r| !r.case.is_half_plane()).unwrap();
    let plane = rows.iter().filter(|r| r.case.is_half_plane() && r.case.pose_hz == space.case.pose_hz);
    assert!(
        plane.clone().count() > 3 && plane.into_iter().all(|r| r.cost_s < 0.2 * space.cost_s),
        "half planes are cheap"
    );
}

#[cfg(unix)]
#[test]
fn an_interrupted_study_keeps_its_rows_and_goes_on() {
    use std::io::{BufRead as _, BufReader};
    use std::process::{Command as Process, Stdio};
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().display().to_string();
    let arguments = [&SMALL[..], &["--threads", "1", "--out", &out]].concat();
    let mut child = Process::new(env!("CARGO_BIN_EXE_needle_twin"))
        .args(&arguments)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
    // the heading and two rows
    let begun: Vec<String> = lines.by_ref().take(3).map(Result::unwrap).collect();
    assert!(begun[1].starts_with("compression"), "{begun:?}");
    let pid = child.id().to_string();
    assert!(Process::new("kill").args(["-INT", &pid]).status().unwrap().success());
    lines.for_each(drop);
    let ended = child.wait_with_output().unwrap();
    assert_eq!(ended.status.code(), Some(3), "{}", text(&ended.stderr));
    let kept = read(folder.path(), "accuracy.csv");
    let all = plan(&Scene::preset("compression").unwrap(), Extent::Quick).unwrap();
    let wanted: BTreeSet<String> = all.iter().filter(|c| c.method == "tet4").map(|c| c.name()).collect();
    assert!(kept.len() >= 2 && kept.len() < wanted.len(), "{} rows", kept.len());
    let resumed = run(&arguments);
    assert_eq!(resumed.status.code(), Some(0));
    let rows = read(folder.path(), "accuracy.csv");
    assert_eq!(rows[..kept.len()], kept, "what was known was not run again");
    assert_eq!(names(&rows), wanted);
}
