//! Contract of a calibration from tracked points: what made them comes back, better than from the force alone, and what is left is mapped.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution as _, Normal};
use serde_json::Value;
use tempfile::TempDir;

/// Noise of one coordinate of a marker, m; of the load cell, N, and by how much its size is wrong.
const NOISE_M: f64 = 5e-5;
const NOISE_N: f64 = 2e-4;
const TOO_LARGE: f64 = 1.04;
const TRUTH: f64 = 0.47;

const MARKERS: [[f64; 3]; 5] =
    [[0.002, 0.0, 0.014], [0.0, 0.003, 0.011], [-0.0025, 0.0, 0.009], [0.0, -0.0015, 0.007], [0.0015, 0.0, 0.012]];

fn program() -> Command {
    Command::new(env!("CARGO_BIN_EXE_needle_twin"))
}

fn scene(folder: &Path) -> PathBuf {
    let shown = program().args(["scene", "show", "needle_insertion"]).output().unwrap();
    let text = String::from_utf8(shown.stdout).unwrap();
    let (text, _) = text.split_once("[[targets]]").unwrap();
    let targets: String = MARKERS
        .iter()
        .enumerate()
        .map(|(i, at)| format!("[[targets]]\nname = \"marker_{i}\"\nposition_m = {at:?}\n"))
        .collect();
    let path = folder.join("needle.toml");
    fs::write(&path, format!("{text}\n{targets}")).unwrap();
    path
}

/// Numbers of a CSV, without its headers.
fn numbers(path: &Path) -> Vec<Vec<f64>> {
    let text = fs::read_to_string(path).unwrap();
    let row = |line: &str| line.split(',').map(|cell| cell.parse().unwrap_or(f64::NAN)).collect();
    text.lines().skip(1).map(row).collect()
}

/// A table of depth, force and tracked points with noise, some of them not seen.
fn table(folder: &Path, scene: &Path) -> (PathBuf, Vec<String>) {
    let out = folder.join("truth");
    let motion = ["--depth-m", "0.008", "--speed-m-per-s", "0.002", "--pose-hz", "25"];
    let truth = format!("instrument.deformation_coefficient={TRUTH}");
    program()
        .args(["solve", "--scene"])
        .arg(scene)
        .args(motion)
        .args(["--set", &truth])
        .arg("--out")
        .arg(&out)
        .output()
        .unwrap();
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let [marker, cell] = [NOISE_M, NOISE_N].map(|s| Normal::new(0.0, s).unwrap());
    let names: Vec<String> = (0..MARKERS.len()).flat_map(|i| ["x", "y", "z"].map(|c| format!("m{i}{c}"))).collect();
    let with_unit: Vec<String> = names.iter().map(|name| format!("{name} (mm)")).collect();
    let mut text = format!("time_s,depth_m,force_n,{}\n", with_unit.join(","));
    for (i, (force, target)) in
        numbers(&out.join("force.csv")).iter().zip(numbers(&out.join("targets.csv"))).enumerate()
    {
        let measured = TOO_LARGE * force[2] + cell.sample(&mut random);
        let places = target[2..].iter().enumerate().map(|(k, x)| {
            let seen = 1e3 * (x + marker.sample(&mut random));
            if i % 17 == 3 && k / 3 == 1 { String::new() } else { seen.to_string() }
        });
        let places = places.collect::<Vec<_>>().join(",");
        text += &format!("{},{},{measured},{places}\n", force[0], force[1]);
    }
    let path = folder.join("tracked.csv");
    fs::write(&path, text).unwrap();
    (path, names)
}

fn calibrate(recording: &Path, scene: &Path, more: &[&str]) -> Value {
    let output = program()
        .arg("calibrate")
        .arg(recording)
        .arg("--scene")
        .arg(scene)
        .args(["--json", "--set", "instrument.deformation_coefficient=0.6"])
        .args(["--fit", "instrument.deformation_coefficient=0.1..0.9"])
        .args(more)
        .output()
        .unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    serde_json::from_slice(&output.stdout).unwrap_or_else(|e| panic!("{e}: {stderr}"))
}

fn found(fit: &Value) -> (f64, f64) {
    let key = &fit["fit"]["instrument.deformation_coefficient"];
    (key["value"].as_f64().unwrap(), key["standard_error"].as_f64().unwrap())
}

#[test]
fn the_deformation_coefficient_comes_back_from_tracked_points_better_than_from_the_force() {
    let folder = TempDir::new().unwrap();
    let scene = scene(folder.path());
    let (table, names) = table(folder.path(), &scene);
    let columns = ["--marker-columns", &names.join(","), "--marker-noise-m", "5e-5"];
    let alone = calibrate(&table, &scene, &[&columns[..], &["--markers-only"]].concat());
    let (value, error) = found(&alone);
    assert!((value / TRUTH - 1.0).abs() < 0.02, "{alone}");
    assert!((value - TRUTH).abs() < 4.0 * error && error < 0.01 * TRUTH, "{alone}");
    assert!((alone["reduced_chi_square"].as_f64().unwrap() - 1.0).abs() < 0.15, "only noise is left: {alone}");
    assert_eq!(alone["rmse_n"], Value::Null);
    for (i, marker) in alone["markers"].as_array().unwrap().iter().enumerate() {
        assert!((marker["rms_m"].as_f64().unwrap() / NOISE_M - 1.0).abs() < 0.25, "{marker}");
        let seen = marker["seen"].as_u64().unwrap();
        assert!(if i == 1 { seen < 101 } else { seen == 101 }, "what was not seen is left out: {marker}");
    }
    // a load cell whose size is wrong pulls at a fit of the force, and less at one that weighs both
    let both = calibrate(&table, &scene, &columns);
    assert!((found(&both).0 / TRUTH - 1.0).abs() < 0.02 && both["rmse_n"].as_f64().unwrap() > 0.0, "{both}");
    let force = calibrate(&table, &scene, &[]);
    assert!((found(&both).0 - TRUTH).abs() < 0.75 * (found(&force).0 - TRUTH).abs(), "{both} {force}");

    // the bag carries them as measured_targets
    let bag = folder.path().join("bag");
    program().arg("import").arg(&table).args(&columns[..2]).arg("--out").arg(&bag).assert().success();
    assert_eq!(calibrate(&bag, &scene, &["--marker-noise-m", "5e-5", "--markers-only"])["fit"], alone["fit"]);
}

#[test]
fn members_learn_from_tracked_points_of_a_recording() {
    let folder = TempDir::new().unwrap();
    let scene = scene(folder.path());
    let (table, names) = table(folder.path(), &scene);
    let replay = |more: &[&str]| -> Value {
        let mut command = program();
        command.arg("replay").arg(&table).arg("--scene").arg(&scene).args(["--json", "--members", "16", "--set"]);
        command.args(["uncertainty.instrument.deformation_coefficient={uniform=[0.35, 0.55]}", "--set"]);
        // the load cell's size is wrong
        command.args(["uncertainty.material.shear_modulus_pa={normal=[1678, 100]}"]).args(more);
        let output = command.output().unwrap();
        let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
        // the scene's own value explains the recording only in part
        assert_eq!(output.status.code(), Some(3), "{stderr}");
        serde_json::from_slice::<Value>(&output.stdout).unwrap()["ensemble"]["assimilated"].clone()
    };
    let coefficient = |found: &Value| {
        let keys = found["keys"].as_array().unwrap();
        let key = keys.iter().find(|key| key["key"] == "instrument.deformation_coefficient").unwrap();
        [&key["mean"], &key["standard_deviation"]].map(|x| x.as_f64().unwrap())
    };
    let (force, both) = (replay(&[]), replay(&["--marker-columns", &names.join(",")]));
    assert_eq!((&force["tracked_blocks"], &both["blocks"]), (&Value::from(0), &force["blocks"]));
    assert!(both["tracked_blocks"].as_u64() > Some(500), "{both}");
    let ([_, unsure], [mean, sure]) = (coefficient(&force), coefficient(&both));
    assert!((mean / TRUTH - 1.0).abs() < 0.03 && sure < 0.5 * unsure, "{force}, then {both}");
}

#[test]
fn a_scene_without_the_markers_is_refused() {
    let folder = TempDir::new().unwrap();
    let scene = scene(folder.path());
    let (table, names) = table(folder.path(), &scene);
    let mut command = program();
    command.arg("calibrate").arg(&table).args([
        "--scene",
        "needle_insertion",
        "--marker-noise-m",
        "5e-5",
        "--marker-columns",
    ]);
    let output = command.arg(names.join(",")).args(["--fit", "instrument.deformation_coefficient"]).output().unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.code() == Some(1) && stderr.contains("[[targets]]"), "{stderr}");
}
