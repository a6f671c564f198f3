//! No false number passes: what a wrong recording gets from `replay` and `calibrate`.
//!
//! `cargo test --release --test programs verdict::the_interval -- --nocapture` makes the record of docs/lab/verdict.md.
#![allow(clippy::unwrap_used)]

use needle_estimate::compare::Cancel;
use std::time::Instant;

use crate::wrong::{self, Fault, recorded};
use assert_cmd::Command;
use needle_core::scene::Scene;
use needle_core::twin::Twin;
use needle_estimate::calibrate::{Calibration, HoldOut, LoadCell, Task, Wanted, calibrate};
use needle_estimate::compare::Explains;
use needle_estimate::compare::scale::mistaken;
use needle_estimate::compare::uncertainty::FORCE_ERROR;
use needle_recording::Recording;
use needle_recording::{At, ForceSeries, Reading};
use needle_rig::make::RigScene;
use rayon::prelude::*;
use serde_json::Value;

const MODULUS: &str = "material.shear_modulus_pa";
const COEFFICIENT: &str = "instrument.deformation_coefficient";

enum Outcome {
    Refused(String),
    Found(Box<Calibration>),
}

/// What `calibrate` makes of a recording, one thread per twin.
fn outcome(recording: &Recording, scene: &str, key: &str) -> Outcome {
    let scene = Scene::preset(scene).unwrap();
    let readings: Vec<Reading> =
        recording.depths.iter().map(|s| Reading { time_s: s.time_s, at: At::Depth(s.depth_m) }).collect();
    let measured = ForceSeries::new(recording.forces.iter().map(|s| (s.time_s, s.force_n)).collect());
    let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    one_thread.install(|| {
        let twin = Twin::new(&scene).unwrap();
        if let Some(what) = mistaken(&twin, &readings, &measured, None) {
            return Outcome::Refused(what);
        }
        let task = Task {
            scene: &scene,
            readings: &readings,
            measured: &measured,
            wanted: &[Wanted { key: key.to_owned(), bounds: None }],
            load_cell: LoadCell::Drift,
            force_error: FORCE_ERROR,
            part: HoldOut::Nothing,
            table: None,
        };
        Outcome::Found(Box::new(calibrate(&task, &mut Cancel::default(), &mut |_| {}).unwrap()))
    })
}

/// Recordings of each fault, and how many of them have to be right.
const SEEDS: u64 = 20;
const RIGHT: usize = 18;

/// What became of one seed: whether the interval holds the truth or there is none, and whether the alignment found the fault.
struct Seed {
    held: bool,
    aligned: bool,
}

fn judged(fault: Fault, scene: RigScene, key: &str, truth: f64, seed: u64) -> Seed {
    match outcome(&recorded(scene, fault, seed), scene.name(), key) {
        Outcome::Refused(what) => {
            println!("{fault:?} {} seed {seed}: refused: {what}", scene.name());
            Seed { held: true, aligned: true }
        }
        Outcome::Found(found) => {
            let estimate = found.estimate(key).unwrap();
            let interval = estimate.interval_95();
            let at = found.alignment.map(|a| [a.contact_depth_m.value, a.time_offset_s.value]);
            let verdict = found.verdict.line();
            println!(
                "{fault:?} {} seed {seed}: {:.5} {interval:?}, {verdict}, alignment {at:?}, {} runs",
                scene.name(),
                estimate.value,
                found.runs
            );
            let aligned = match fault {
                Fault::Late => at.is_some_and(|[_, s]| (s - 1.0).abs() <= 0.01),
                Fault::Deep => at.is_some_and(|[m, _]| (m - 1e-3).abs() <= 5e-5),
                _ => true,
            };
            Seed { held: interval.is_none_or(|[low, high]| low <= truth && truth <= high), aligned }
        }
    }
}

fn twenty_seeds(fault: Fault, scene: RigScene, key: &str, truth: f64) {
    let begun = Instant::now();
    let seeds: Vec<Seed> =
        (201..201 + SEEDS).into_par_iter().map(|seed| judged(fault, scene, key, truth, seed)).collect();
    let held = seeds.iter().filter(|s| s.held).count();
    let aligned = seeds.iter().filter(|s| s.aligned).count();
    println!(
        "== {fault:?} {}: held {held}, aligned {aligned} of {SEEDS}, {:.1} s",
        scene.name(),
        begun.elapsed().as_secs_f64()
    );
    assert!(held >= RIGHT, "{fault:?}: {held} of {SEEDS} hold the truth or give no interval");
    assert!(aligned >= RIGHT, "{fault:?}: {aligned} of {SEEDS} alignments are right");
}

#[test]
fn the_interval_of_a_needle_holds_the_truth_or_none_is_given_of_six_wrong_recordings() {
    for fault in Fault::ALL {
        twenty_seeds(fault, RigScene::NeedleInsertion, COEFFICIENT, 0.4);
    }
}

#[test]
fn the_interval_of_a_compression_holds_the_truth_or_none_is_given() {
    for fault in [Fault::None, Fault::Late, Fault::Deep, Fault::Drops] {
        twenty_seeds(fault, RigScene::Compression, MODULUS, 1678.0);
    }
}

#[test]
fn a_shifted_clock_and_a_contact_elsewhere_are_found_and_taken_out() {
    for seed in [31, 32] {
        let Outcome::Found(found) =
            outcome(&recorded(RigScene::NeedleInsertion, Fault::Late, seed), "needle_insertion", COEFFICIENT)
        else {
            unreachable!("a late force is no matter of scale")
        };
        let late = found.alignment.unwrap().time_offset_s;
        println!("late {late:?}, {:?}", found.estimate(COEFFICIENT).unwrap().interval_95());
        assert!((late.value - 1.0).abs() <= 0.01 && late.error.unwrap() < 0.01, "{late:?}");
        assert!(found.realigned[1] && found.verdict.explains == Explains::Yes, "{:?}", found.verdict);
        let Outcome::Found(found) =
            outcome(&recorded(RigScene::NeedleInsertion, Fault::Deep, seed), "needle_insertion", COEFFICIENT)
        else {
            unreachable!("a millimetre is no matter of scale")
        };
        let contact = found.alignment.unwrap().contact_depth_m;
        println!("deep {contact:?}, {:?}", found.estimate(COEFFICIENT).unwrap().interval_95());
        assert!((contact.value - 1e-3).abs() <= 5e-5, "{contact:?}");
        assert!(found.realigned[0] && found.verdict.explains == Explains::Yes, "{:?}", found.verdict);
        assert_eq!(found.refused, 0, "none is too deep once the contact is known");
    }
}

#[test]
fn a_right_recording_is_explained_and_left_as_it_is() {
    for (scene, key) in [(RigScene::Compression, MODULUS), (RigScene::NeedleInsertion, COEFFICIENT)] {
        let Outcome::Found(found) = outcome(&recorded(scene, Fault::None, 41), scene.name(), key) else {
            unreachable!("nothing is wrong with it")
        };
        assert_eq!((found.verdict.explains, found.realigned), (Explains::Yes, [false; 2]), "{:?}", found.verdict);
        assert!(found.verdict.reasons.is_empty(), "{:?}", found.verdict);
        assert!(found.runs <= 10, "a key that the force is proportional to needs hardly a run: {}", found.runs);
    }
}

/// Exit code, stdout, stderr of a command.
fn run(arguments: &[&str]) -> (i32, String, String) {
    let done = Command::new(env!("CARGO_BIN_EXE_needle_twin")).args(arguments).output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (done.status.code().unwrap(), text(&done.stdout), text(&done.stderr))
}

#[test]
fn units_signs_and_scene_are_refused_before_any_search_with_what_is_likely() {
    let folder = tempfile::tempdir().unwrap();
    for (fault, words) in [
        (Fault::Millinewtons, ["mN", "--force"]),
        (Fault::Millimetres, ["mm", "--force"]),
        (Fault::ForceTurned, ["sign of the force", "--force"]),
        (Fault::DepthTurned, ["sign of the position", "--force"]),
    ] {
        let bag = folder.path().join(format!("{fault:?}"));
        wrong::write(&recorded(RigScene::NeedleInsertion, fault, 3), "needle_insertion", &bag);
        let bag = bag.to_str().unwrap();
        for command in [&["replay", bag][..], &["calibrate", bag, "--fit", COEFFICIENT]] {
            let (code, out, said) = run(command);
            assert_eq!((code, out.as_str()), (1, ""), "{fault:?}: {said}");
            assert!(words.iter().all(|word| said.contains(word)), "{fault:?}: {said}");
            assert_eq!(said.lines().count(), 1, "{said}");
        }
    }
    let bag = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("bags/needle_insertion");
    let bag = bag.to_str().unwrap();
    let (code, _, said) = run(&["calibrate", bag, "--scene", "compression", "--fit", MODULUS]);
    assert!(code == 1 && said.contains("--scene needle_insertion"), "{said}");
    // the same of a bag that names no scene
    let nameless = folder.path().join("nameless");
    wrong::write(&recorded(RigScene::NeedleInsertion, Fault::None, 3), "", &nameless);
    let (code, _, said) = run(&["calibrate", nameless.to_str().unwrap(), "--scene", "compression", "--fit", MODULUS]);
    assert!(code == 1 && said.contains("--scene needle_insertion"), "{said}");
    // whoever means it goes on
    let forced = ["replay", "--force", "--json", "--scene", "compression", bag];
    let (code, out, said) = run(&forced);
    let metrics: Value = serde_json::from_str(&out).unwrap();
    assert!(code == 3 && metrics["verdict"]["explains"] == "no" && said.contains("needle_insertion"), "{said}");
}

#[test]
fn a_rejected_model_gives_its_reason_and_picture_and_no_scene() {
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("drops");
    wrong::write(&recorded(RigScene::NeedleInsertion, Fault::Drops, 5), "needle_insertion", &bag);
    let out = folder.path().join("fit");
    let arguments = ["calibrate", bag.to_str().unwrap(), "--fit", COEFFICIENT, "--out", out.to_str().unwrap()];
    // of an earlier calibration
    std::fs::create_dir(&out).unwrap();
    std::fs::write(out.join("scene.toml"), "old").unwrap();
    let (code, summary, said) = run(&arguments);
    assert_eq!(code, 3, "{summary} {said}");
    assert!(summary.lines().next().unwrap().contains("does not explain"), "{summary}");
    assert!(summary.lines().next().unwrap().contains("verdict  rejected"), "{summary}");
    assert!(summary.contains("without an interval") && !summary.contains("95 %"), "{summary}");
    assert!(said.starts_with("warning: rejected"), "{said}");
    assert!(out.join("calibration.png").exists() && !out.join("scene.toml").exists());
    let json: Value = serde_json::from_str(&std::fs::read_to_string(out.join("calibration.json")).unwrap()).unwrap();
    assert!(json["verdict"]["explains"] == "no" && !json["verdict"]["reasons"].as_array().unwrap().is_empty());
    assert!(json["fit"][COEFFICIENT]["interval_95"].is_null() && json["fit"][COEFFICIENT]["standard_error"].is_null());
    let (code, ..) = run(&[&arguments[..], &["--force"]].concat());
    assert!(code == 3 && out.join("scene.toml").exists(), "whoever means it gets the scene");
}

#[test]
fn a_replay_says_first_whether_the_model_explains_the_measurement() {
    let bag = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("bags/needle_insertion");
    let bag = bag.to_str().unwrap();
    let (code, summary, said) = run(&["replay", bag]);
    assert_eq!((code, said.as_str()), (0, ""));
    assert!(summary.lines().next().unwrap().contains("explains the measurement (reduced chi-square"), "{summary}");
    // a modulus that is half as large again
    let (code, out, said) = run(&["replay", bag, "--json", "--set", "material.shear_modulus_pa=2500"]);
    let metrics: Value = serde_json::from_str(&out).unwrap();
    assert_eq!((code, &metrics["verdict"]["explains"]), (3, &Value::from("no")), "{said}");
    assert!(said.contains("a force 0.6") && said.contains("calibrate"), "the factor that is missing: {said}");
    let alignment = &metrics["alignment"];
    assert!(
        alignment["contact_depth_m"].as_f64().unwrap().abs() < 1e-4,
        "a wrong size is no wrong alignment: {alignment}"
    );
    // a late force is named
    let folder = tempfile::tempdir().unwrap();
    let late = folder.path().join("late");
    wrong::write(&recorded(RigScene::NeedleInsertion, Fault::Late, 3), "needle_insertion", &late);
    let (code, out, said) = run(&["replay", late.to_str().unwrap(), "--json"]);
    let metrics: Value = serde_json::from_str(&out).unwrap();
    assert!(code == 3 && said.contains("later than the position"), "{said}");
    assert!((metrics["alignment"]["time_offset_s"].as_f64().unwrap() - 1.0).abs() < 0.01, "{}", metrics["alignment"]);
}

#[test]
fn a_table_that_does_not_hold_is_said_and_its_spike_is_no_peak() {
    // tissue that passes the shaft folds
    let set = [
        "--set",
        "instrument.puncture_strain=4.5",
        "--set",
        "motion.depth_m=0.009",
        "--set",
        "instrument.wall_contact=false",
    ];
    let (code, out, said) =
        run(&[&["solve", "--scene", "needle_insertion", "--json", "--pose-hz", "100"][..], &set].concat());
    let metrics: Value = serde_json::from_str(&out).unwrap();
    println!("{} {said}", metrics["stability"]);
    assert_eq!(code, 3, "{said}");
    assert!(said.contains("does not hold"), "{said}");
    assert!(metrics["force"]["peak_predicted_n"].is_null() && metrics["force"]["largest_predicted_n"].is_number());
    let (code, summary, said) =
        run(&[&["solve", "--scene", "needle_insertion", "--pose-hz", "100"][..], &set].concat());
    assert!(
        code == 3 && summary.contains("no peak, since the run fails") && said.contains("does not hold"),
        "{summary}"
    );
    assert!(summary.lines().next().unwrap().contains("the stability table does not hold"), "{summary}");
}

#[test]
fn a_modulus_that_is_a_tenth_off_is_not_explained() {
    let bag = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("bags");
    for scene in ["compression", "indentation", "needle_insertion"] {
        let bag = bag.join(scene);
        for (modulus, explains, exit) in [("1678", "yes", 0), ("1850", "no", 3), ("1510", "no", 3)] {
            let set = format!("{MODULUS}={modulus}");
            let (code, out, _) = run(&["replay", bag.to_str().unwrap(), "--json", "--set", &set]);
            let verdict = &serde_json::from_str::<Value>(&out).unwrap()["verdict"];
            println!("{scene} {modulus}: {verdict}");
            assert_eq!((code, verdict["explains"].as_str().unwrap()), (exit, explains), "{scene} {modulus}: {verdict}");
        }
    }
}

#[test]
fn a_motion_whose_way_out_is_not_modelled_is_explained_in_part() {
    // as a needle that rubs: on the way out the force is another one
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("rubs");
    wrong::write(&recorded(RigScene::NeedleInsertion, Fault::Rubs, 3), "needle_insertion", &bag);
    let (code, out, said) = run(&["replay", bag.to_str().unwrap(), "--json"]);
    let metrics: Value = serde_json::from_str(&out).unwrap();
    assert_eq!((code, &metrics["verdict"]["explains"]), (0, &Value::from("in part")), "{said}");
    assert!(said.contains("on the way out"), "{said}");
}
