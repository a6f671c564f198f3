//! `tune`: the scene that it writes meets the tolerance and the rate of poses when it is run.
#![allow(clippy::unwrap_used)]

use assert_cmd::Command;
use serde_json::Value;
use std::process::Output;

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
    let shorter = depth_m != OWN_DEPTH_M && done.status.code() == Some(3) && said.contains("Force imbalance");
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
