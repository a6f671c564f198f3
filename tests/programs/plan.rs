//! Contract of `needle_twin plan`: the tip ends where the target is by then, also of a needle that bends, and what can't be planned is refused.
#![allow(clippy::unwrap_used, clippy::panic)]

use assert_cmd::Command;
use needle_core::scene::file::load;
use serde_json::Value;
use tempfile::TempDir;

const COARSE: [&str; 6] = [
    "discretisation.spacing_m=0.004",
    "discretisation.edge_refinement=0.5",
    "instrument.capture_radius_m=0.001",
    "motion.pose_hz=100",
    "motion.speed_m_per_s=0.01",
    "targets.0.position_m=[0.002, 0.0, 0.013]",
];

fn planned(scene: &str, changes: &[&str], arguments: &[&str]) -> std::process::Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_needle_twin"));
    command.args(["plan", "--json", "--scene", scene]);
    changes.iter().for_each(|change| {
        command.args(["--set", change]);
    });
    command.args(arguments).output().unwrap()
}

fn json(output: &std::process::Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{}", String::from_utf8_lossy(&output.stderr)))
}

#[test]
fn the_scene_of_a_plan_is_what_was_planned() {
    let folder = TempDir::new().unwrap();
    let file = folder.path().join("planned.toml");
    let plan = planned("needle_insertion", &COARSE, &["--target", "on_path", "--out", file.to_str().unwrap()]);
    let found = json(&plan);
    assert!(plan.status.success(), "{found}");
    assert!(found["plan"]["miss_m"].as_f64().unwrap() <= 5e-5, "{found}");
    // the scene of the plan says the same
    let scene = load(file.to_str().unwrap()).unwrap();
    let entry = scene.instrument.unwrap().entry.map(|e| e.get());
    assert!((entry[0] - found["plan"]["entry_m"][0].as_f64().unwrap()).abs() < 1e-12, "{entry:?} {found}");
    let depth = scene.motion.unwrap().depth.get();
    assert!((depth - found["plan"]["depth_m"].as_f64().unwrap()).abs() < 1e-12, "{depth} {found}");
}

#[test]
fn a_bevel_is_aimed_to_its_other_side() {
    let bent = [
        "instrument.flexible=true",
        "instrument.length_m=0.06",
        "instrument.outer_diameter_m=0.0005",
        "instrument.youngs_modulus_pa=6e10",
        "instrument.tip=bevel",
        "instrument.bevel_force_n=0.002",
        "targets.0.position_m=[0.0, 0.0, 0.013]",
    ];
    let plan = planned("needle_insertion", &[&COARSE[..5], &bent].concat(), &["--target", "on_path"]);
    let found = json(&plan);
    assert!(plan.status.success(), "{found}");
    let [straight, end] = ["straight", "plan"].map(|which| found[which]["miss_m"].as_f64().unwrap());
    assert!(straight > 2e-4 && end <= 5e-5, "{found}");
    let entry = found["plan"]["entry_m"][0].as_f64().unwrap();
    assert!(entry < -1e-4, "the tip is drawn to +x, so it enters on the other side: {found}");
}

#[test]
fn what_can_not_be_planned_is_refused() {
    for (scene, arguments, says) in [
        ("needle_insertion", &["--target", "nothing"][..], "there are: on_path, beside_path, far"),
        ("indentation", &["--target", "x"], "no needle"),
        ("needle_insertion", &["--target", "far", "--avoid", "bone"], "no region is called \"bone\""),
    ] {
        let output = planned(scene, &[], arguments);
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{error}");
        assert!(error.contains(says), "{arguments:?}: {error}");
    }
}
