//! `tune`: the scene that it writes meets the tolerance and the rate of poses when it is run.
#![allow(clippy::unwrap_used)]

use assert_cmd::Command;
use serde_json::Value;
use std::io::{BufRead as _, BufReader};
use std::process::{Child, ChildStderr, Output, Stdio};
use std::time::{Duration, Instant};

fn run(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_needle_twin")).args(arguments).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// How deep the compression preset goes.
const OWN_DEPTH_M: &str = "0.0025";

/// Force of a scene at a depth, N, and its real-time factor, by a program of its own.
fn solved(scene: &str, depth_m: &str) -> (f64, f64) {
    let done = run(&["solve", "--scene", scene, "--threads", "1", "--depth-m", depth_m, "--json"]);
    // The table holds for the scene's own motion. An insertion that ends sooner has a smaller peak, to which the imbalance is held.
    let said = text(&done.stderr);
    let of_steps = said.contains("Force imbalance") || said.contains("Error of the steps");
    let shorter = depth_m != OWN_DEPTH_M && done.status.code() == Some(3) && of_steps;
    assert!(done.status.success() || shorter, "{said}");
    let metrics: Value = serde_json::from_slice(&done.stdout).unwrap();
    let number = |group: &str, key: &str| metrics[group][key].as_f64().unwrap();
    (number("force", "peak_predicted_n"), number("timing", "real_time_factor"))
}

#[test]
fn the_scene_that_is_written_meets_what_was_asked() {
    let folder = tempfile::tempdir().unwrap();
    let mut costs = Vec::new();
    // (depth, force) of bags/reference/compression_force.csv
    let reference = [("0.001", 0.312_071), (OWN_DEPTH_M, 0.847_635)];
    for tolerance in ["0.04", "0.005"] {
        let scene = folder.path().join(format!("{tolerance}.toml")).display().to_string();
        let asked = ["tune", "--scene", "compression", "--tolerance", tolerance, "--pose-hz", "1000"];
        let done = run(&[&asked[..], &["--threads", "1", "--out", &scene]].concat());
        let (said, seen) = (text(&done.stdout), text(&done.stderr));
        assert_eq!(done.status.code(), Some(0), "{said}{seen}");
        assert!(said.contains(": met; ") && !said.contains("NOT met"), "{said}");
        assert!(seen.contains("independent finite elements") && seen.lines().count() > 8, "rows were measured: {seen}");
        for (depth, force) in reference {
            let (predicted, factor) = solved(&scene, depth);
            let error: f64 = predicted / force - 1.0;
            println!("{tolerance}: {depth} m {:+.3} %, {factor:.1} times real time", 100.0 * error);
            assert!(error.abs() <= tolerance.parse::<f64>().unwrap(), "{tolerance} at {depth} m: {error}");
            assert!(factor > 1.0, "{factor}");
        }
        let written = std::fs::read_to_string(&scene).unwrap();
        let per_pose = written.split(" ms of processor time").next().unwrap().rsplit(' ').next().unwrap();
        costs.push(per_pose.parse::<f64>().unwrap());
        assert!(written.starts_with("# Written by `needle_twin tune`"), "{written}");
        let steps = written.split("max_steps_per_pose = ").nth(1).unwrap().lines().next().unwrap();
        println!("{tolerance}: {steps} steps a pose");
        assert!(written.contains("dimension = \"axisymmetric\"") && steps.parse::<u32>().unwrap() <= 4, "{written}");
    }
    assert!(costs[0] < costs[1], "a wide tolerance is cheaper than a narrow one: {costs:?}");
}

#[test]
fn what_cannot_be_met_is_said_with_the_nearest() {
    let impossible = ["--tolerance", "0.0001", "--set", "discretisation.dimension=axisymmetric"];
    let motion = ["--set", "motion.depth_m=0.0005", "--set", "motion.speed_m_per_s=0.002"];
    let done = run(&[&["tune", "--scene", "compression", "--threads", "1"], &impossible[..], &motion[..]].concat());
    assert_eq!(done.status.code(), Some(1));
    let said = text(&done.stderr);
    assert!(
        said.contains("nothing that was run has both") && said.contains("Nearest to the reference: mmls"),
        "{said}"
    );
    assert_eq!(text(&done.stdout), "", "no scene is written");
    for wrong in [["--tolerance", "0"], ["--tolerance", "2"], ["--pose-hz", "-1"]] {
        let done = run(&[&["tune", "--scene", "compression"], &wrong[..]].concat());
        assert_eq!(done.status.code(), Some(2), "{wrong:?}");
    }
}

#[test]
fn a_coarser_cloud_is_corrected() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("corrected.toml").display().to_string();
    let motion = [
        "--set",
        "motion.depth_m=0.001",
        "--set",
        "motion.speed_m_per_s=0.002",
        "--set",
        "material.poisson_ratio=0.48",
        // fewer than the own fine cloud takes
        "--set",
        "stepping.max_steps_per_pose=2",
    ];
    let asked =
        ["tune", "--scene", "compression", "--tolerance", "0.01", "--pose-hz", "200", "--threads", "1", "--correct"];
    let done = run(&[&asked[..], &motion, &["--out", &scene]].concat());
    let (said, seen) = (text(&done.stdout), text(&done.stderr));
    assert_eq!(done.status.code(), Some(0), "{said}{seen}");
    assert!(said.contains("material.poisson_ratio = 0.47") && said.contains("are left of"), "{said}");
    assert!(!said.contains("NOT met") && seen.contains("_tuned"), "its pace was chosen with the correction: {seen}");
    let written = std::fs::read_to_string(&scene).unwrap();
    assert!(
        written.contains("\n[correction]\napply = true\nlearnt_from = \"") && written.contains("are left of"),
        "{written}"
    );
    // who changes the cloud learns it again, or does without
    let other = ["solve", "--scene", &scene, "--set", "discretisation.support_factor=1.9"];
    let refused = run(&other);
    assert_eq!(refused.status.code(), Some(1));
    assert!(text(&refused.stderr).contains("tune --correct"), "{}", text(&refused.stderr));
    let without = run(&[&other[..], &["--set", "correction.apply=false", "--threads", "1", "--json"]].concat());
    assert!(text(&without.stdout).contains("\"dimension_because\""), "{}", text(&without.stderr));
}

#[test]
fn a_given_cloud_is_corrected_at_its_own_pace() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("corrected.toml").display().to_string();
    let keys = ["motion.depth_m=0.001", "motion.speed_m_per_s=0.002", "material.poisson_ratio=0.48"];
    let motion = keys.iter().flat_map(|key| ["--set", key]).collect::<Vec<_>>();
    let asked = ["tune", "--scene", "compression", "--tolerance", "0.01", "--pose-hz", "200", "--threads", "1"];
    let cloud = ["--correct", "--cloud", "discretisation.spacing_m=0.003", "--cloud", "stepping.tolerance=0.008"];
    let done = run(&[&asked[..], &motion, &cloud, &["--out", &scene]].concat());
    let (said, seen) = (text(&done.stdout), text(&done.stderr));
    assert_eq!(done.status.code(), Some(0), "{said}{seen}");
    assert!(said.contains("are left of") && said.contains(" mm of 1 %: met") && !said.contains("NOT met"), "{said}");
    let written = std::fs::read_to_string(&scene).unwrap();
    for part in
        ["with discretisation.spacing_m=0.003, stepping.tolerance=0.008, against a finer cloud of", "[correction]"]
    {
        assert!(written.contains(part), "{part}: {written}");
    }
    let of = |key: &str| written.lines().find(|line| line.starts_with(key)).map(str::to_owned);
    assert_eq!(of("spacing_m"), Some("spacing_m = 0.003".to_owned()));
    assert_eq!(of("tolerance"), Some("tolerance = 0.008".to_owned()));

    let other = ["--correct", "--cloud", "material.poisson_ratio=0.3"];
    let alone = ["--cloud", "discretisation.spacing_m=0.003"];
    for (wrong, why) in [(&other[..], "--set changes the others"), (&alone, "--correct")] {
        let done = run(&[&asked[..], wrong].concat());
        assert_eq!(done.status.code(), Some(2), "{wrong:?}");
        assert!(text(&done.stderr).contains(why), "{}", text(&done.stderr));
    }
}

/// Time in which the first line has to be there.
const FIRST_LINE: Duration = Duration::from_secs(2);
/// Time in which a signal has to end it: a second, and as much again for a machine that does other things too.
const END: Duration = Duration::from_secs(2);

/// A search that goes on, its stderr, and the first line there.
fn begun(arguments: &[&str]) -> (Child, BufReader<ChildStderr>, String) {
    let start = Instant::now();
    let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_needle_twin"))
        .args(arguments)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut stderr = BufReader::new(child.stderr.take().unwrap());
    let mut first = String::new();
    stderr.read_line(&mut first).unwrap();
    assert!(start.elapsed() < FIRST_LINE, "{:?}: {first}", start.elapsed());
    (child, stderr, first)
}

/// Sends a signal; the exit code and the rest of stderr, where it ends in time.
fn ended(mut child: Child, stderr: BufReader<ChildStderr>, signal: &str) -> (Option<i32>, String) {
    let start = Instant::now();
    let sent = std::process::Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap();
    assert!(sent.success());
    let said: Vec<String> = stderr.lines().map_while(Result::ok).collect();
    let code = child.wait().unwrap().code();
    assert!(start.elapsed() < END, "{signal}: {:?}, {said:?}", start.elapsed());
    (code, said.join("\n"))
}

#[test]
fn a_signal_ends_it_at_any_moment_and_nothing_found_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("tuned.toml");
    let scene = ["tune", "--scene", "needle_insertion", "--set", "instrument.tilt_rad=0.26"];
    let more = ["--tolerance", "0.001", "--threads", "1", "--out", out.to_str().unwrap()];
    // while the reference run's cloud is built, in that run, and later
    for (after_s, signal, correct) in [
        (0.3, "-TERM", &[][..]),
        (2.0, "-INT", &["--correct"]),
        (5.0, "-TERM", &[]),
        (5.0, "-TERM", &["--correct", "--cloud", "discretisation.spacing_m=0.0035"]),
        (12.0, "-INT", &[]),
    ] {
        let start = Instant::now();
        let (child, stderr, first) = begun(&[&scene[..], &more, correct].concat());
        std::thread::sleep(Duration::from_secs_f64(after_s).saturating_sub(start.elapsed()));
        let (code, said) = ended(child, stderr, signal);
        assert_eq!(code, Some(3), "{after_s} s: {first}{said}");
        assert!(said.contains("interrupted: nothing was found yet, so nothing is written"), "{after_s} s: {said}");
        assert!(!out.exists(), "{after_s} s");
    }
}

#[test]
fn a_signal_leaves_the_best_so_far() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("tuned.toml").display().to_string();
    // a slow motion, so that much is left to try after the first row
    let asked = ["tune", "--scene", "needle_insertion", "--set", "motion.speed_m_per_s=0.0002", "--out", &out];
    let (mut child, mut stderr, _) = begun(&[&asked[..], &["--threads", "1"]].concat());
    let mut line = String::new();
    while !(line.starts_with("needle_insertion") && line.contains("mmls")) {
        line.clear();
        assert!(stderr.read_line(&mut line).unwrap() > 0, "no row was measured");
    }
    let stdout = child.stdout.take().unwrap();
    let (code, said) = ended(child, stderr, "-TERM");
    let shown = std::io::read_to_string(stdout).unwrap();
    assert_eq!(code, Some(3), "{said}{shown}");
    assert!(shown.contains("interrupted: best so far: ") && shown.contains(" times real time"), "{shown}");
    let written = std::fs::read_to_string(&out).unwrap();
    assert!(written.starts_with("# The search was interrupted"), "{written}");
    assert_eq!(run(&["scene", "check", &out]).status.code(), Some(0), "{written}");
}

#[test]
fn what_is_tried_is_said_while_it_is() {
    let asked = ["tune", "--scene", "needle_insertion", "--set", "instrument.tilt_rad=0.26", "--threads", "1"];
    let (child, mut stderr, first) = begun(&asked);
    assert!(first.starts_with("0 s: ") || first.starts_with("1 s: "), "{first}");
    let mut line = String::new();
    let start = Instant::now();
    while !line.contains("reference run of the own model on a fine cloud") {
        line.clear();
        assert!(stderr.read_line(&mut line).unwrap() > 0 && start.elapsed() < Duration::from_secs(12), "{line}");
    }
    assert!(line.contains("run 1: ") && line.contains("nothing is within 2 % yet") && line.contains("left"), "{line}");
    assert_eq!(ended(child, stderr, "-INT").0, Some(3));
}
