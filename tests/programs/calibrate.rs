//! `calibrate`: what it prints, that what made a recording comes back, how sure it is, and what it refuses.
#![allow(clippy::unwrap_used)]

use needle_estimate::compare::Cancel;
use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use needle_core::scene::Scene;
use needle_estimate::calibrate::{Calibration, HoldOut, LoadCell, Task, Wanted, calibrate};
use needle_estimate::compare::uncertainty::FORCE_ERROR;
use needle_recording::{At, ForceSeries, Reading};
use needle_recording::{Recording, TopicNames};
use needle_rig::make::{RigRecording, RigScene};
use serde_json::Value;

const MODULUS: &str = "material.shear_modulus_pa";
const COEFFICIENT: &str = "instrument.deformation_coefficient";

fn shipped(bag: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("bags").join(bag).display().to_string()
}

/// Exit code, stdout, stderr.
fn run(arguments: &[&str]) -> (i32, String, String) {
    let done = Command::new(env!("CARGO_BIN_EXE_needle_twin")).arg("calibrate").args(arguments).output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (done.status.code().unwrap(), text(&done.stdout), text(&done.stderr))
}

fn json(arguments: &[&str]) -> (Value, String) {
    let (code, out, said) = run(&[arguments, &["--threads", "1", "--json"]].concat());
    assert_eq!(code, 0, "{said}");
    (serde_json::from_str(&out).unwrap(), said)
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

#[test]
fn the_modulus_comes_back_from_the_compression_wherever_the_search_begins() {
    let mut found = Vec::new();
    for start in ["1678", "400", "9000"] {
        let set = format!("{MODULUS}={start}");
        let (result, said) = json(&[&shipped("compression"), "--fit", MODULUS, "--set", &set]);
        assert_eq!(said, "", "nothing to remark");
        let fit = &result["fit"][MODULUS];
        let (value, error) = (number(&fit["value"]), number(&fit["standard_error"]));
        println!("from {start} Pa: {value:.2} +- {error:.2} Pa, rmse {} N", result["rmse_n"]);
        assert!((value / 1678.0 - 1.0).abs() <= 0.02, "{fit}");
        assert!((value - 1678.0).abs() <= 1.96 * error && error < 0.02 * value, "{fit}");
        assert!(number(&fit["noise_standard_error"]) > 0.0 && number(&fit["systematic_standard_error"]) > 0.0, "{fit}");
        assert!(number(&result["rmse_n"]) < 0.003 && result["converged"] == true, "{result}");
        assert!(result["runs"].as_u64().unwrap() <= 12, "linear in the modulus: few runs, {result}");
        found.push(value);
    }
    assert!(found.iter().all(|v| (v / found[0] - 1.0).abs() < 1e-3), "{found:?}");
}

/// Smooth plates explain the press between bonded ones, with a modulus that is a third higher: the interval of either has to hold the other.
#[test]
fn an_interval_holds_what_the_recording_does_not_decide() {
    let bag = shipped("compression");
    let smooth = ["--set", "instrument.contact=frictionless", "--set", "sample.base=frictionless"];
    let interval = |fit: &Value, name: &str| [0, 1].map(|k| number(&fit[name][k]));
    for set in [&[][..], &smooth] {
        let (result, _) = json(&[&[bag.as_str(), "--fit", MODULUS][..], set].concat());
        let fit = &result["fit"][MODULUS];
        let [low, high] = interval(fit, "interval_95");
        let own = interval(fit, "interval_95_as_assumed");
        println!("{low:.0} to {high:.0} Pa, {own:.0?} as assumed: {}", result["alternatives"]);
        assert!(low < 1678.0 && 1678.0 < high && low < 2332.0 && 2332.0 < high, "{fit}");
        assert!(low <= own[0] && own[1] <= high && own[1] - own[0] < 0.3 * (high - low), "{fit}");
        let others = result["alternatives"].as_array().unwrap();
        let plates = others.iter().find(|a| a["assumed"].as_str().unwrap().ends_with("plates")).unwrap();
        assert_eq!(plates["explains"], "yes");
        assert!(others.iter().any(|a| a["assumed"] == "the contact fitted too"), "{}", result["alternatives"]);
        assert!(others.iter().any(|a| a["assumed"] == "Ogden's law"), "{}", result["alternatives"]);
    }
    let (code, screen, said) = run(&[&bag, "--fit", MODULUS]);
    assert!(
        code == 0
            && screen.contains("with frictionless plates")
            && screen.contains("nothing of this recording decides"),
        "{screen}{said}"
    );
    let (known, _) = json(&[&bag, "--fit", MODULUS, "--certain", "all"]);
    let fit = &known["fit"][MODULUS];
    assert_eq!(interval(fit, "interval_95"), interval(fit, "interval_95_as_assumed"));
    assert_eq!(known["alternatives"], Value::Array(Vec::new()));
    // a face of which the recording tells that it is bonded
    let (face, _) = json(&[&shipped("indentation"), "--fit", MODULUS, "--certain", "contact", "law"]);
    assert_ne!(face["alternatives"][0]["explains"], "yes", "{}", face["alternatives"]);
}

#[test]
fn the_deformation_coefficient_comes_back_from_the_needle() {
    let out = tempfile::tempdir().unwrap();
    let folder = out.path().join("fit").display().to_string();
    let starts = ["--set", "instrument.deformation_coefficient=0.5", "--set", "instrument.retraction_coefficient=0.5"];
    let bag = shipped("needle_insertion");
    let (result, said) = json(&[&[&bag, "--fit", COEFFICIENT, "--out", &folder][..], &starts].concat());
    let fit = &result["fit"][COEFFICIENT];
    let (value, error) = (number(&fit["value"]), number(&fit["standard_error"]));
    println!("{value:.5} +- {error:.5}, {said}");
    assert!((value / 0.4 - 1.0).abs() <= 0.03, "{fit}");
    assert!((value - 0.4).abs() <= 1.96 * error && error < 0.02 * value, "{fit}");
    assert_eq!(result["tied"]["instrument.retraction_coefficient"], COEFFICIENT, "the scene had them equal");
    // the scene that is written replays with the residual that was reported, but for the load cell's offset
    let scene = PathBuf::from(&folder).join("scene.toml").display().to_string();
    let replayed = Command::new(env!("CARGO_BIN_EXE_needle_twin"))
        .args(["replay", &bag, "--scene", &scene, "--threads", "1", "--json"])
        .output()
        .unwrap();
    let metrics: Value = serde_json::from_slice(&replayed.stdout).unwrap();
    assert!(number(&metrics["force"]["rmse_n"]) < 0.0008, "{}", metrics["force"]);
    for name in ["calibration.json", "calibration.csv", "calibration.png", "calibration.svg"] {
        assert!(PathBuf::from(&folder).join(name).metadata().unwrap().len() > 1000, "{name}");
    }
}

/// A recording of another seed, 50 readings a second, and what comes back from it.
fn from_seed(scene: RigScene, key: &str, seed: u64) -> Calibration {
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("bag");
    RigRecording { seed, rate_hz: 50.0, ..RigRecording::of(scene) }.write(&bag).unwrap();
    let recording = Recording::load(&bag, &TopicNames::default()).unwrap();
    let readings: Vec<Reading> =
        recording.depths.iter().map(|s| Reading { time_s: s.time_s, at: At::Depth(s.depth_m) }).collect();
    let measured = ForceSeries::new(recording.forces.iter().map(|s| (s.time_s, s.force_n)).collect());
    let task = Task {
        scene: &Scene::preset(scene.name()).unwrap(),
        readings: &readings,
        measured: &measured,
        wanted: &[Wanted { key: key.to_owned(), bounds: None }],
        load_cell: LoadCell::Drift,
        force_error: FORCE_ERROR,
        part: HoldOut::Nothing,
        table: None,
    };
    let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    one_thread.install(|| calibrate(&task, &mut Cancel::default(), &mut |_| {})).unwrap()
}

#[test]
fn the_truth_lies_in_the_95_percent_interval_of_nineteen_seeds_of_twenty() {
    for (scene, key, truth) in [(RigScene::Compression, MODULUS, 1678.0), (RigScene::NeedleInsertion, COEFFICIENT, 0.4)]
    {
        let (mut inside, mut worst, mut widest, mut offset_inside) = (0, 0.0_f64, 0.0_f64, 0);
        for seed in 101..121 {
            let found = from_seed(scene, key, seed);
            let estimate = found.estimate(key).unwrap();
            // a recording that is said not to be explained has none, and counts as a miss
            let intervals = [key, "load_cell.offset_n"].map(|key| found.estimate(key).unwrap().interval_95());
            let [Some([low, high]), Some([least, most])] = intervals else { continue };
            inside += u32::from(low <= truth && truth <= high);
            worst = worst.max((estimate.value / truth - 1.0).abs());
            widest = widest.max(0.5 * (high - low) / truth);
            offset_inside += u32::from(least <= 3e-4 && 3e-4 <= most);
        }
        println!(
            "{key}: {inside} of 20 inside, worst {:.2} %, interval +- {:.2} %; offset {offset_inside} of 20 inside",
            100.0 * worst,
            100.0 * widest
        );
        assert!(inside >= 19, "{key}: {inside}");
        assert!(worst <= if key == MODULUS { 0.02 } else { 0.03 }, "{key}: {worst}");
        assert!(widest <= 0.04, "an interval that holds everything says nothing: {widest}");
        assert!(offset_inside >= 19, "{key}: offset {offset_inside}");
    }
}

#[test]
fn what_the_data_cannot_tell_apart_or_tell_at_all_is_named() {
    let bag = shipped("needle_insertion");
    let (result, said) = json(&[&bag, "--fit", COEFFICIENT, MODULUS]);
    let groups = result["indistinguishable"].as_array().unwrap();
    let names: Vec<&str> = groups.iter().flat_map(|g| g.as_array().unwrap()).filter_map(Value::as_str).collect();
    assert!(names.contains(&MODULUS) && names.contains(&COEFFICIENT), "{result}");
    assert!(said.contains("can't tell apart") && said.contains(MODULUS) && said.contains(COEFFICIENT), "{said}");
    // how closely depends on the fine shape of the curve, as the values do; of their product the bag knows
    let correlation = number(&result["correlation"]["matrix"][0][1]);
    assert!((-1.0..-0.3).contains(&correlation), "{correlation}");
    let [coefficient, modulus] = [COEFFICIENT, MODULUS].map(|key| number(&result["fit"][key]["value"]));
    assert!((coefficient * modulus / (0.4 * 1678.0) - 1.0).abs() < 0.03, "{coefficient} {modulus}");
    // masses are scaled: the density is not in the force
    let density = "material.density_kg_per_m3";
    let (result, said) = json(&[&shipped("compression"), "--fit", MODULUS, density]);
    assert_eq!(result["without_effect"], serde_json::json!([density]));
    assert!(result["fit"][density]["standard_error"].is_null() && said.contains(density), "{said}");
    assert!((number(&result["fit"][MODULUS]["value"]) / 1678.0 - 1.0).abs() < 0.02, "the other is found all the same");
}

#[test]
fn two_keys_with_effects_of_their_own_come_back_together() {
    let ratio = "material.poisson_ratio";
    let set = ["--set", "material.poisson_ratio=0.47"];
    let (result, said) =
        json(&[&[&shipped("compression"), "--fit", MODULUS, "material.poisson_ratio=0.4..0.499"][..], &set].concat());
    println!("{} {said}", result["fit"]);
    for (key, truth) in [(MODULUS, 1678.0), (ratio, 0.49)] {
        let fit = &result["fit"][key];
        assert!((number(&fit["value"]) - truth).abs() <= 1.96 * number(&fit["standard_error"]), "{key}: {fit}");
        assert!((number(&fit["value"]) / truth - 1.0).abs() < 0.03, "{key}: {fit}");
    }
}

#[test]
fn what_was_held_out_and_another_bag_are_predicted() {
    let set = format!("{MODULUS}=1000");
    let (bag, other) = (shipped("compression"), shipped("indentation"));
    let (result, _) = json(&[&bag, "--fit", MODULUS, "--set", &set, "--hold-out", "half", "--predict", &other]);
    let (held, other) = (&result["hold_out"], &result["prediction"]);
    println!("{held} {other}");
    let counts = ["fitted_readings", "predicted_readings"].map(|key| held[key].as_u64().unwrap());
    assert!(counts.iter().all(|n| *n > 200), "{held}");
    assert!(number(&held["predicted_rmse_n"]) > 0.0 && number(&held["predicted_nrmse"]) < 0.01, "{held}");
    assert!((number(&held["fitted_rmse_n"]) - number(&result["rmse_n"])).abs() < 1e-15, "{held}");
    assert_eq!((&other["scene"], &other["carried"]), (&"indentation".into(), &serde_json::json!([MODULUS])));
    assert!(number(&other["nrmse"]) < 0.01, "{other}");
    // held against the needle, what only a plate has is left behind
    let (result, _) = json(&[&bag, "--fit", MODULUS, "sample.height_m=0.016..0.018", "--hold-out", "retraction"]);
    assert!(result["hold_out"].is_null() && result["readings"].as_u64().unwrap() < 1200, "{result}");
}

#[test]
fn a_bound_holds_and_is_said() {
    let fit = format!("{MODULUS}=2000..3000");
    let (code, out, said) = run(&[&shipped("compression"), "--fit", &fit, "--json"]);
    let result: Value = serde_json::from_str(&out).unwrap();
    assert_eq!((code, &result["verdict"]["explains"]), (3, &Value::from("no")), "a fifth off is not explained");
    let found = &result["fit"][MODULUS];
    assert_eq!((number(&found["value"]), &found["at_bound"]), (2000.0, &Value::Bool(true)));
    assert!(said.contains("ended at its bound 2000") && found["interval_95"].is_null(), "{said}");
}

/// Each share of the relaxation is a key of its own; the place of one that is not there is said.
#[test]
fn numbers_of_a_list_are_found_one_by_one() {
    let folder = tempfile::tempdir().unwrap();
    let solved = folder.path().join("solved").display().to_string();
    let set = |shares: &str| {
        let keys = ["material.prony_times_s=[0.05, 1.0]", shares, "motion.speed_m_per_s=0.002"];
        let mut arguments = vec!["--scene".to_owned(), "compression".to_owned()];
        keys.iter().for_each(|key| arguments.extend(["--set".to_owned(), (*key).to_owned()]));
        arguments
    };
    let done = Command::new(env!("CARGO_BIN_EXE_needle_twin"))
        .args(["solve", "--out", &solved])
        .args(set("material.prony_shares=[0.2, 0.3]"))
        .output()
        .unwrap();
    assert!(done.status.success(), "{done:?}");
    let table = format!("{solved}/force.csv");
    let start = set("material.prony_shares=[0.1, 0.1]");
    let columns = ["--position", "depth_m", "--force-column", "predicted_n", "--load-cell", "exact", "--fit"];
    let fit = |keys: &[&str]| {
        let start: Vec<&str> = start.iter().map(String::as_str).collect();
        [&[table.as_str()], &start[..], &columns[..], keys].concat().iter().map(|s| (*s).to_owned()).collect::<Vec<_>>()
    };
    let both = fit(&["material.prony_shares[0]", "material.prony_shares[1]"]);
    let (found, _) = json(&both.iter().map(String::as_str).collect::<Vec<_>>());
    let share = |place: usize| number(&found["fit"][format!("material.prony_shares[{place}]")]["value"]);
    println!("shares {} and {}, true 0.2 and 0.3", share(0), share(1));
    assert!((share(0) - 0.2).abs() < 0.02 && (share(1) - 0.3).abs() < 0.02, "{found}");

    let beyond = fit(&["material.prony_shares[2]"]);
    let (code, _, said) = run(&beyond.iter().map(String::as_str).collect::<Vec<_>>());
    assert!(code == 1 && said.contains("material.prony_shares[2]"), "{code} {said}");
}

/// Modulus, share and time of a relaxation come out of a press that holds, in a scene that names no relaxation. Synthetic: the twin's own force. A hold
/// that is shorter than the relaxation gives no interval.
#[test]
fn a_hold_tells_how_the_tissue_relaxes() {
    let folder = tempfile::tempdir().unwrap();
    let found = |tau: f64, hold: f64| -> Value {
        let solved = folder.path().join(format!("{tau}")).display().to_string();
        let hold = format!("motion.hold_s={hold}");
        let keys = ["motion.depth_m=0.002", "motion.speed_m_per_s=0.004", &hold, "motion.pose_hz=50"];
        let scene: Vec<&str> =
            ["--scene", "compression"].into_iter().chain(keys.iter().flat_map(|key| ["--set", *key])).collect();
        let time = format!("material.prony_times_s=[{tau}]");
        let truth = ["--set", "material.prony_shares=[0.3]", "--set", &time, "--out", &solved];
        let done =
            Command::new(env!("CARGO_BIN_EXE_needle_twin")).arg("solve").args(&scene).args(truth).output().unwrap();
        assert!(done.status.success(), "{done:?}");
        // noise of 1 mN and a zero of 5 mN
        let text = fs::read_to_string(format!("{solved}/force.csv")).unwrap();
        let noisy = |(i, line): (usize, &str)| {
            let cells: Vec<&str> = line.split(',').collect();
            let noise = 1.7e-3 * ((i * 7919 % 1009) as f64 / 504.0 - 1.0) + 5e-3;
            let force = cells[2].parse::<f64>().map_or_else(|_| "force_n".to_owned(), |f| (f + noise).to_string());
            format!("{},{},{force}\n", cells[0], cells[1])
        };
        let table = folder.path().join(format!("{tau}.csv")).display().to_string();
        fs::write(&table, text.lines().enumerate().map(noisy).collect::<String>()).unwrap();
        let start = ["--set", "material.shear_modulus_pa=1400", "--load-cell", "offset", "--certain", "all", "--fit"];
        let fit = ["material.shear_modulus_pa", "material.prony_shares[0]", "material.prony_times_s[0]"];
        json(&[&[table.as_str()], &scene[..], &start, &fit].concat()).0
    };
    let of = |found: &Value, key: &str, truth: f64| {
        let one = &found["fit"][key];
        let interval = &one["interval_95"];
        println!("{key}: {} within {interval}, true {truth}", one["value"]);
        assert!((number(&one["value"]) / truth - 1.0).abs() < 0.03, "{key}: {one}");
        assert!(number(&interval[0]) <= truth && truth <= number(&interval[1]), "{key}: {one}");
    };
    let long = found(1.5, 6.0);
    of(&long, "material.shear_modulus_pa", 1678.0);
    of(&long, "material.prony_shares[0]", 0.3);
    of(&long, "material.prony_times_s[0]", 1.5);
    let short = found(10.0, 3.0);
    let one = &short["fit"]["material.prony_times_s[0]"];
    assert!(one["interval_95"].is_null() && one.to_string().contains("is shorter than a relaxation"), "{one}");
}

#[test]
fn what_cannot_be_fitted_is_refused_with_the_remedy() {
    let bag = shipped("compression");
    for (arguments, code, words) in [
        (vec!["--fit", "material.shear_modulus"], 1, vec![MODULUS]),
        (vec!["--fit", "discretisation.method"], 1, vec!["only a single number", "mmls"]),
        (vec!["--fit", COEFFICIENT], 1, vec!["has no such key"]),
        (vec!["--fit", "material.poisson_ratio=0.2..0.7"], 1, vec!["0.7", "out of range"]),
        (vec!["--fit", "material.poisson_ratio=0.4..0.3"], 1, vec!["nothing between"]),
        (vec!["--fit", MODULUS, "--fit", MODULUS], 1, vec!["twice"]),
        (vec!["--fit", "material.poisson_ratio=a..b"], 2, vec!["0.2..0.8"]),
        (vec!["--fit", MODULUS, "--force-error", "2"], 2, vec!["0.01 for 1 %"]),
        (vec![], 2, vec!["--fit"]),
    ] {
        let (exit, out, said) = run(&[&[bag.as_str()][..], &arguments].concat());
        assert_eq!((exit, out.as_str()), (code, ""), "{arguments:?}: {said}");
        for word in words {
            assert!(said.contains(word), "{arguments:?}: {said}");
        }
    }
    let (exit, _, said) = run(&["no/such/bag", "--fit", MODULUS]);
    assert!(exit == 1 && said.contains("no/such/bag"), "{said}");
}

/// Depths and forces of a shipped recording at common times, changed row by row, as a table.
fn table(bag: &str, row: impl Fn(f64, f64, f64) -> Option<[f64; 3]>) -> (tempfile::TempDir, String) {
    let recording = Recording::load(shipped(bag), &TopicNames::default()).unwrap();
    let measured = recording.measured();
    let rows = recording.depths.iter().filter_map(|s| row(s.time_s, s.depth_m, measured.at(s.time_s)?[2]));
    let text: String = rows.map(|[t, d, f]| format!("{t},{d},{f}\n")).collect();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.csv");
    fs::write(&path, format!("time_s,depth_m,force_n\n{text}")).unwrap();
    (folder, path.display().to_string())
}

fn replayed(arguments: &[&str]) -> (i32, Value, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_needle_twin"));
    let done = command.arg("replay").args(arguments).args(["--threads", "1", "--json"]).output().unwrap();
    let said = String::from_utf8_lossy(&done.stderr).into_owned();
    (done.status.code().unwrap(), serde_json::from_slice(&done.stdout).unwrap_or_default(), said)
}

#[test]
fn the_calibrated_scene_replays_with_the_residual_that_was_reported() {
    let (folder, table) = table("compression", |t, d, f| Some([t, d + 8e-4, f + 0.05 + 2e-4 * t]));
    let out = folder.path().join("fit").display().to_string();
    let (result, said) = json(&[&table, "--scene", "compression", "--fit", MODULUS, "--out", &out]);
    assert!(said.contains("0.7") || said.contains("0.8"), "the contact is said: {said}");
    let align = &result["align"];
    assert!((number(&align["contact_depth_m"]) - 8e-4).abs() < 4e-5, "{align}");
    assert!(
        (number(&align["force_zero_n"]) - 0.05).abs() < 2e-3 && number(&align["force_drift_n_per_s"]) > 1e-4,
        "{align}"
    );
    let scene = format!("{out}/scene.toml");
    let (code, metrics, said) = replayed(&[&table, "--scene", &scene]);
    let (rmse, reported) = (number(&metrics["force"]["rmse_n"]), number(&result["rmse_n"]));
    println!("replayed {rmse} N, reported {reported} N: {said}");
    assert_eq!((code, &metrics["verdict"]["explains"]), (0, &Value::from("yes")), "{said}");
    assert!((rmse / reported - 1.0).abs() < 0.1 && said.contains("[align]"), "{rmse} {reported} {said}");
    // what is found from there is what was found
    let (again, _) = json(&[&table, "--scene", &scene, "--fit", MODULUS]);
    assert!(
        (number(&again["align"]["contact_depth_m"]) / number(&align["contact_depth_m"]) - 1.0).abs() < 0.05,
        "{again}"
    );
    assert!((number(&again["load_cell"]["offset_n"]["value"]) - 0.05).abs() < 2e-3, "{again}");
    assert!((number(&again["fit"][MODULUS]["value"]) / number(&result["fit"][MODULUS]["value"]) - 1.0).abs() < 0.01);
}

#[test]
fn a_ramp_from_contact_gives_an_interval_and_says_what_it_left_out() {
    let peak = std::cell::Cell::new(0.0_f64);
    let (_folder, table) = table("compression", |t, d, f| {
        let rises = d > 0.0 && d >= peak.get() - 1e-4;
        peak.set(peak.get().max(d));
        (rises && t < 4.0).then_some([t, d, f])
    });
    let (result, said) = json(&[&table, "--scene", "compression", "--fit", MODULUS]);
    let fit = &result["fit"][MODULUS];
    println!("{fit} {said}");
    let [low, high] = [0, 1].map(|i| number(&fit["interval_95_as_assumed"][i]));
    assert!(low <= 1678.0 && 1678.0 <= high && high - low < 200.0, "{fit}");
    assert_eq!(result["drift_left_out_for"], serde_json::json!([MODULUS]));
    assert!(said.contains("--load-cell drift") && !said.contains("prony"), "{said}");
    // asked for, it is fitted, and what cures is named
    let (_, out, said) = run(&[&table, "--scene", "compression", "--fit", MODULUS, "--load-cell", "drift", "--json"]);
    let result: Value = serde_json::from_str(&out).unwrap();
    assert!(result["fit"][MODULUS]["interval_95"].is_null(), "{result}");
    assert!(said.contains("--load-cell offset") && !said.contains("fit fewer") && !said.contains("prony"), "{said}");
}

#[test]
fn a_modulus_in_another_unit_is_named_and_not_the_force() {
    for (modulus, unit) in [("0.001678", "MPa"), ("1.678", "kPa")] {
        let (code, _, said) = replayed(&[&shipped("compression"), "--set", &format!("{MODULUS}={modulus}")]);
        assert_eq!(code, 1, "{said}");
        let named = format!("{MODULUS} = {modulus} Pa is likely meant in {unit}");
        assert!(said.contains(&named) && said.contains("1678") && !said.contains("the force is likely"), "{said}");
    }
}
