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

/// The friction that is found exceeds the force: the numbers are printed, and not believed.
#[test]
fn a_friction_beyond_the_whole_force_ends_with_exit_code_3() {
    let folder = tempfile::tempdir().unwrap();
    let table = folder.path().join("torn.csv");
    let mut text = "time_s,depth_m,force_n\n".to_owned();
    for i in 0..=10_000 {
        let depth = 0.018 - 4e-6 * f64::from((i - 5000_i32).abs());
        let sticks = if depth > 0.009 { 0.45 - 95.0 * (0.018 - depth) } else { -45.0 * depth.max(0.0) };
        let force = if i <= 5000 { 25.0 * depth.max(0.0) } else { sticks };
        let _ = writeln!(text, "{},{depth},{}", 2e-3 * f64::from(i), force + 1e-4 * f64::from((i * 7919) % 13 - 6));
    }
    fs::write(&table, text).unwrap();
    let arguments = [table.to_str().unwrap(), "--scene", "needle_insertion", "--layers", "1"];
    let (code, screen, stderr) = program(&arguments);
    assert_eq!(code, Some(3), "{screen}{stderr}");
    assert!(stderr.contains("does not add up") && screen.contains("at the tip"), "{screen}{stderr}");
    let (code, json, _) = program(&[&arguments[..], &["--json"]].concat());
    let found: Value = serde_json::from_str(&json).unwrap();
    assert!(code == Some(3) && found["adds_up"] == false && found["parts"].as_array().unwrap().len() >= 20, "{found}");
}
