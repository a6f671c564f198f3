//! Contract of `calibrate --layers`: a table of a double insertion in, layers out, on the screen and as a file; what is none is an error.
#![allow(clippy::unwrap_used)]

use std::fmt::Write as _;
use std::fs;

use assert_cmd::Command;
use serde_json::Value;

fn program(arguments: &[&str]) -> (Option<i32>, String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_needle_twin")).arg("calibrate").args(arguments).output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.code(), text(&output.stdout), text(&output.stderr))
}

#[test]
fn a_table_of_a_double_insertion_says_its_layers() {
    let folder = tempfile::tempdir().unwrap();
    let rod = fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/references/rod_double.csv")).unwrap();
    // the rod's places are 10 um apart, read at 1 mm/s, with noise of 0.2 mN
    let mut text = String::from("time_s,depth_m,force_n\n");
    for (i, row) in rod.lines().skip(1).enumerate() {
        let (depth, force) = row.split_once(',').unwrap();
        let noise = 2e-4 * (12.9898 * i as f64).sin();
        let force: f64 = force.parse().unwrap();
        writeln!(text, "{},{depth},{}", 0.01 * i as f64, force + noise).unwrap();
    }
    let table = folder.path().join("double.csv");
    fs::write(&table, text).unwrap();
    let table = table.to_str().unwrap();
    let common = [table, "--scene", "layered_tissue", "--layers", "3"];
    let (code, json, stderr) = program(&[&common[..], &["--json"]].concat());
    assert_eq!(code, Some(0), "{stderr}");
    let found: Value = serde_json::from_str(&json).unwrap();
    for (layer, friction) in found["layers"].as_array().unwrap().iter().zip([6.0, 3.0, 9.0]) {
        let value = layer["friction_n_per_m"]["value"].as_f64().unwrap();
        assert!((value / friction - 1.0).abs() < 0.05, "{found}");
    }
    assert_eq!(found["layers"].as_array().map(Vec::len), Some(3));
    let out = folder.path().join("out");
    let (code, screen, stderr) = program(&[&common[..], &["--out", out.to_str().unwrap()]].concat());
    assert_eq!(code, Some(0), "{stderr}");
    assert!(screen.contains("friction") && screen.contains("layers.json"), "{screen}");
    let written: Value = serde_json::from_str(&fs::read_to_string(out.join("layers.json")).unwrap()).unwrap();
    assert_eq!(written["layers"], found["layers"]);
}

#[test]
fn an_insertion_without_friction_is_an_error_with_the_remedy() {
    let bag = concat!(env!("CARGO_MANIFEST_DIR"), "/bags/needle_insertion");
    let (code, _, stderr) = program(&[bag, "--layers", "2"]);
    assert_eq!(code, Some(1), "{stderr}");
    assert!(stderr.starts_with("error: ") && stderr.trim_end().lines().count() == 1, "{stderr}");
    let (code, _, stderr) = program(&[bag, "--layers", "2", "--fit", "material.shear_modulus_pa"]);
    assert_eq!(code, Some(2), "either or: {stderr}");
}
