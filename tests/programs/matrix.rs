//! `study matrix`: each cell works, or says why not.
#![allow(clippy::unwrap_used, clippy::panic)]

use assert_cmd::Command;

#[test]
fn each_cell_works_or_says_why_not() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().display().to_string();
    let done = Command::new(env!("CARGO_BIN_EXE_needle_twin"))
        .args(["study", "matrix", "--quick", "--budget-s", "1", "--out", &out])
        .output()
        .unwrap();
    assert_eq!(done.status.code(), Some(0), "{}", String::from_utf8_lossy(&done.stderr));
    let mut table = csv::Reader::from_path(folder.path().join("matrix.csv")).unwrap();
    let headers = table.headers().unwrap().clone();
    let mut worked = 0;
    for row in table.records() {
        let row = row.unwrap();
        let of = |name: &str| row[headers.iter().position(|h| h == name).unwrap()].to_owned();
        let (instrument, dimension, outcome) = (of("instrument"), of("dimension"), of("outcome"));
        let cell = format!("{instrument}, {dimension}, {}, {}: {outcome}", of("law"), of("sample"));
        println!("{cell}");
        assert!(!outcome.starts_with("lost") && !outcome.starts_with("refused"), "{cell}");
        let number = |name: &str| of(name).parse::<f64>().unwrap_or_else(|_| panic!("{name} of {cell}"));
        assert!(number("real_time_factor") > 0.0 && number("longest_pose_ms") > 0.0, "{cell}");
        assert!(number("steps_per_pose") >= 1.0 && number("reached_m") > 0.0, "{cell}");
        // a stopped cell reached less than its motion
        assert_eq!(outcome.starts_with("slower"), number("reached_m") < number("depth_m") - 1e-6, "{cell}");
        worked += 1;
    }
    assert!(worked >= 12, "{worked} cells");
}
