//! Contract of the command line: what goes to stdout, what the files hold, and the exit codes.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::io::Read as _;
use std::process::Stdio;
use std::thread::sleep;
use std::time::Duration;

use assert_cmd::Command;
use serde_json::Value;
use tempfile::TempDir;

/// A small model that is run in a moment: the command line is under test, not the force.
const SMALL: &[&str] = &[
    "--scene",
    "needle_insertion",
    "--set",
    "discretisation.spacing_m=0.004",
    "--set",
    "instrument.capture_radius_m=0.0015",
    "--set",
    "stepping.max_steps_per_pose=5",
    "--speed-m-per-s",
    "0.01",
];

fn needle_twin() -> Command {
    Command::new(env!("CARGO_BIN_EXE_needle_twin"))
}

/// What a command prints that has nothing to remark but that a small model's stability table doesn't hold.
fn stdout(arguments: &[&str]) -> String {
    let output = needle_twin().args(arguments).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    // on a busy machine a long run or a long build says how far it is
    let is_progress = |line: &str| line.contains(" poses, ") || line.ends_with(" so far");
    let said: Vec<&str> = said.lines().filter(|line| !is_progress(line)).collect();
    assert!(said.iter().all(|line| line.contains("does not hold")), "no diagnostics without a terminal: {said:?}");
    let code = if said.is_empty() { 0 } else { 3 };
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {said:?}");
    String::from_utf8(output.stdout).unwrap()
}

fn json(arguments: &[&str]) -> Value {
    serde_json::from_str(&stdout(arguments)).unwrap()
}

/// Every dotted path of a JSON object that leads to a value.
fn paths(value: &Value, prefix: &str, out: &mut Vec<String>) {
    match value {
        Value::Object(map) => map.iter().for_each(|(key, value)| paths(value, &format!("{prefix}{key}."), out)),
        _ => out.push(prefix.trim_end_matches('.').to_owned()),
    }
}

#[test]
fn metrics_have_the_keys_of_the_contract() {
    let metrics = json(&[&["solve", "--json", "--depth-m", "0.0005"], SMALL].concat());
    let mut found = Vec::new();
    paths(&metrics, "", &mut found);
    for key in [
        "scene",
        "method",
        "nodes",
        "integration_points",
        "poses",
        "steps",
        "checksum",
        "force.peak_predicted_n",
        "force.peak_measured_n",
        "force.rmse_n",
        "force.nrmse",
        "force.max_abs_error_n",
        "timing.build_s",
        "timing.wall_s",
        "timing.simulated_s",
        "timing.real_time_factor",
        "timing.step_us",
        "timing.pose_latency_ms.p50",
        "timing.pose_latency_ms.p99",
        "timing.pose_latency_ms.max",
        "timing.missed_deadlines",
        "timing.coalesced_poses",
        "stability.diverged",
        "stability.recoveries",
        "stability.repaired_supports",
        "stability.min_jacobian",
        "stability.max_kinetic_to_strain_energy",
        "stability.force_imbalance",
        "model_error.force_rms_n",
        "model_error.force_max_n",
        "model_error.targets_rms_m",
    ] {
        assert!(found.iter().any(|path| path == key), "{key} is not in {found:?}");
    }
    assert_eq!(metrics["scene"], "needle_insertion");
    assert_eq!(metrics["poses"], 51, "0.5 mm at 10 mm/s and 1 kHz, both ends included");
    assert_eq!(metrics["timing"]["simulated_s"], 0.05);
    assert_eq!(metrics["stability"]["diverged"], false);
    assert!(metrics["checksum"].as_str().unwrap().len() >= 16);
    assert!(metrics["nodes"].as_u64().unwrap() > 50);
    assert!(metrics["steps"].as_u64().unwrap() >= 50);
}

/// The estimated error covers what linear tetrahedra are off, and is that of each model: of the half plane a fraction.
#[test]
fn the_error_of_the_model_is_stated_and_covers_it() {
    let of = |keys: &[&str]| {
        let scene = ["solve", "--json", "--scene", "compression", "--speed-m-per-s", "0.01", "--pose-hz", "200"];
        let metrics = json(&[&scene, keys].concat());
        let number = |path: &str| metrics.pointer(path).unwrap().as_f64().unwrap();
        (number("/force/peak_predicted_n"), number("/model_error/force_max_n"))
    };
    let half_plane = of(&[]);
    let coarse = ["--set", "discretisation.dimension=full", "--set", "discretisation.spacing_m=0.004"];
    let tetrahedra = of(&[&coarse[..], &["--set", "discretisation.method=tet4"]].concat());
    // finite elements of bags/reference, at 2.5 mm
    const REFERENCE: f64 = 0.8494;
    for (name, (force, error)) in [("half plane", half_plane), ("tetrahedra", tetrahedra)] {
        println!("{name}: {force:.4} +- {error:.4} N");
        assert!((force - REFERENCE).abs() < error, "{name}: {force} +- {error} N");
    }
    assert!(half_plane.1 < 0.04 * REFERENCE && tetrahedra.1 > 1.5 * half_plane.1, "{half_plane:?} {tetrahedra:?}");
}

#[test]
fn options_of_solve_are_those_of_the_scene() {
    let options = json(&[&["solve", "--json", "--depth-m", "0.0005", "--pose-hz", "500"], SMALL].concat());
    let keys = ["--set", "motion.depth_m=0.0005", "--set", "motion.pose_hz=500"];
    let set = json(&[&["solve", "--json"], SMALL, &keys].concat());
    assert_eq!(options["checksum"], set["checksum"]);
    assert_eq!(options["poses"], 26);
}

#[test]
fn files_of_a_run_are_named_and_whole() {
    let folder = TempDir::new().unwrap();
    let out = folder.path().join("a/b");
    let summary = stdout(&[&["solve", "--depth-m", "0.0005", "--out", out.to_str().unwrap()], SMALL].concat());
    assert!(summary.lines().count() < 24, "one screen: {summary}");
    for word in ["needle_insertion", "peak predicted", "real-time factor", "checksum", "metrics.json"] {
        assert!(summary.contains(word), "{word}: {summary}");
    }
    for name in ["metrics.json", "force.csv", "targets.csv", "final.vtu", "force.png", "report.html"] {
        assert!(out.join(name).metadata().unwrap().len() > 0, "{name}");
    }
    let csv = std::fs::read_to_string(out.join("force.csv")).unwrap();
    assert!(
        csv.starts_with("time_s,depth_m,predicted_n,measured_n,predicted_x_n,predicted_y_n,predicted_z_n,measured_x_n")
    );
    assert_eq!(csv.lines().count(), 52);
    let strays = std::fs::read_dir(&out)
        .unwrap()
        .filter(|entry| entry.as_ref().unwrap().file_name().to_string_lossy().starts_with('.'));
    assert_eq!(strays.count(), 0, "nothing temporary is left");
}

#[test]
fn a_time_series_has_a_frame_per_interval() {
    let folder = TempDir::new().unwrap();
    let out = folder.path().to_str().unwrap();
    let summary = stdout(&[&["solve", "--depth-m", "0.0005", "--out", out, "--save-every", "0.01"], SMALL].concat());
    assert!(summary.contains("series.pvd"), "{summary}");
    let series = std::fs::read_to_string(folder.path().join("series.pvd")).unwrap();
    let times: Vec<f64> =
        series.split("timestep=\"").skip(1).map(|rest| rest.split('"').next().unwrap().parse().unwrap()).collect();
    // 50 ms of motion; `tests/programs/vtu.rs` reads the files with meshio
    assert_eq!(times.len(), 6, "{times:?}");
    assert!(times.windows(2).all(|t| (t[1] - t[0] - 0.01).abs() < 1e-9), "{times:?}");
    assert!((0..6).all(|i| folder.path().join(format!("series/frame_{i:04}.vtu")).exists()));
    for wrong in ["0", "-1", "nan", "1e-9"] {
        let every = format!("--save-every={wrong}");
        let output = needle_twin().args([&["solve", "--out", out, &every], SMALL].concat()).output().unwrap();
        assert_eq!(output.status.code(), Some(1), "{wrong}");
        assert!(String::from_utf8_lossy(&output.stderr).contains("--save-every"), "{wrong}");
    }
    let nowhere = needle_twin().args([&["solve", "--save-every", "1"], SMALL].concat()).output().unwrap();
    assert_eq!(nowhere.status.code(), Some(2), "a series needs a folder");
}

/// Runs the program with a terminal for stderr, gives what it drew there.
const IN_A_TERMINAL: &str = "
import os, pty, subprocess, sys, threading
ours, theirs = pty.openpty()
drawn = []
def read():
    while True:
        try:
            piece = os.read(ours, 65536)
        except OSError:
            return
        if not piece:
            return
        drawn.append(piece)
thread = threading.Thread(target=read)
thread.start()
code = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=theirs).returncode
os.close(theirs)
thread.join()
sys.stdout.buffer.write(b''.join(drawn))
sys.exit(code)
";

#[test]
fn a_terminal_shows_the_curves_while_they_come() {
    let program = env!("CARGO_BIN_EXE_needle_twin");
    let run = ["-c", IN_A_TERMINAL, program, "solve", "--depth-m", "0.004", "--threads", "1"];
    let output =
        Command::new("python3").args([&run[..], SMALL].concat()).env("TERM", "xterm-256color").output().unwrap();
    let drawn = String::from_utf8_lossy(&output.stdout);
    // so coarse a model need not hold its stability table, and then says so
    assert!(output.status.success() || drawn.contains("does not hold"), "{drawn}");
    assert!(drawn.chars().any(|c| ('\u{2801}'..'\u{28ff}').contains(&c)), "no curve: {drawn}");
    for word in ["predicted", "measured", "times real time", "steps per pose", "poses"] {
        assert!(drawn.contains(word), "{word}: {drawn}");
    }
}

#[test]
fn a_shown_scene_is_a_scene_file() {
    let folder = TempDir::new().unwrap();
    for name in ["compression", "indentation", "needle_insertion"] {
        for set in [&[] as &[&str], &["--set", "material.poisson_ratio=0.3"]] {
            let shown = stdout(&[&["scene", "show", name], set].concat());
            let path = folder.path().join("mine.toml");
            std::fs::write(&path, &shown).unwrap();
            let path = path.to_str().unwrap();
            assert!(stdout(&["scene", "check", path]).contains("ok"));
            let again = json(&["scene", "show", path, "--json"]);
            assert_eq!(again, json(&[&["scene", "show", name, "--json"], set].concat()));
            assert_eq!(again["material.poisson_ratio"], if set.is_empty() { 0.49 } else { 0.3 });
        }
    }
}

#[test]
fn scenes_and_keys_are_listed() {
    let list = json(&["scene", "list", "--json"]);
    let names: Vec<_> = list.as_array().unwrap().iter().map(|row| row["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["compression", "indentation", "needle_insertion", "layered_tissue"]);
    let text = stdout(&["scene", "list"]);
    assert!(names.iter().all(|name| text.contains(name)));
    let keys = json(&["scene", "show", "--keys", "--json"]);
    let text = stdout(&["scene", "show", "--keys"]);
    for row in keys.as_array().unwrap() {
        assert!(text.contains(row["key"].as_str().unwrap()) && text.contains(row["description"].as_str().unwrap()));
    }
    let checked = &json(&["scene", "check", "--json", "indentation"])[0];
    assert!(checked["ok"].as_bool().unwrap());
    let tried = &checked["tried"];
    let number = |key: &str| tried[key].as_f64().unwrap();
    assert!(
        number("real_time_factor") > 0.0 && number("steps_per_pose") >= 1.0 && number("longest_pose_ms") > 0.0,
        "{tried}"
    );
    assert!((1e-4..0.1).contains(&number("model_error")) && tried["diverged"].is_null(), "{tried}");
    let text = stdout(&["scene", "check", "indentation"]);
    assert!(
        text.contains("times real time") && text.contains("error of the model") && text.contains("accuracy of 1.0 %"),
        "{text}"
    );
}

#[test]
fn help_names_every_command_and_the_exit_codes() {
    let help = stdout(&["--help"]);
    for word in ["solve", "replay", "scene", "Exit codes"] {
        assert!(help.contains(word), "{word}: {help}");
    }
    let solve = stdout(&["solve", "--help"]);
    for word in ["--scene", "--set", "--depth-m", "--speed-m-per-s", "--pose-hz", "--threads", "--out", "--json", "m/s"]
    {
        assert!(solve.contains(word), "{word}: {solve}");
    }
    assert!(stdout(&["--version"]).contains(env!("CARGO_PKG_VERSION")));
}

#[test]
fn a_reader_who_has_had_enough_is_no_failure() {
    let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_needle_twin"))
        .args(["scene", "show", "--keys"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let mut stderr = String::new();
    child.stderr.take().unwrap().read_to_string(&mut stderr).unwrap();
    assert!(child.wait().unwrap().success(), "{stderr}");
    assert!(stderr.is_empty(), "{stderr}");
}

#[test]
fn ctrl_c_keeps_what_is_done() {
    a_signal_keeps_what_is_done("-INT");
}

#[test]
fn so_does_sigterm() {
    a_signal_keeps_what_is_done("-TERM");
    a_signal_keeps_what_is_done("-HUP");
}

fn a_signal_keeps_what_is_done(signal: &str) {
    let folder = TempDir::new().unwrap();
    let out = folder.path().join("out");
    let child = std::process::Command::new(env!("CARGO_BIN_EXE_needle_twin"))
        .args(["solve", "--scene", "indentation", "--speed-m-per-s", "0.00001", "--out"])
        .arg(&out)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // long enough for a line of how it goes, where there is no terminal
    sleep(Duration::from_secs(8));
    let pid = child.id().to_string();
    assert!(std::process::Command::new("kill").args([signal, &pid]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(3), "finished, but not all of it: {stderr}");
    assert!(stderr.contains("interrupted after"), "{stderr}");
    let line = stderr.lines().next().unwrap();
    assert!(line.contains(" of 1000001 poses, indentation: depth ") && line.contains("times real time"), "{stderr}");
    let metrics: Value = serde_json::from_slice(&std::fs::read(out.join("metrics.json")).unwrap()).unwrap();
    assert!(metrics["losses"][0].as_str().unwrap().contains("interrupted"));
    let names = std::fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let partial: Vec<String> = names.filter(|name| name.contains("partial")).collect();
    assert!(partial.is_empty(), "{partial:?}");
}
