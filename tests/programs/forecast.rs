//! `forecast`: the rest of a recording is predicted without having been read, and compared with simple formulas.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use assert_cmd::Command;
use serde_json::Value;

/// Exit code, stdout, stderr.
fn run(arguments: &[&str]) -> (i32, String, String) {
    let done = Command::new(env!("CARGO_BIN_EXE_needle_twin")).arg("forecast").args(arguments).output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (done.status.code().unwrap(), text(&done.stdout), text(&done.stderr))
}

fn bag(name: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("bags").join(name).display().to_string()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("no number: {value}"))
}

fn entry<'a>(result: &'a Value, name: &str) -> &'a Value {
    result["recordings"].as_array().unwrap().iter().find(|one| one["name"] == name).unwrap()
}

#[test]
fn the_shipped_bags_are_predicted_and_every_model_is_named() {
    let (code, out, said) = run(&[&bag("indentation"), &bag("needle_insertion"), "--json"]);
    assert_eq!(code, 0, "{said}");
    let result: Value = serde_json::from_str(&out).unwrap();
    for (name, formula) in [("indentation", "punch"), ("needle_insertion", "spring")] {
        let one = entry(&result, name);
        let baselines = one["baselines"].as_array().unwrap();
        let of = |name: &str| number(&baselines.iter().find(|b| b["name"] == name).unwrap()["rmse_n"]);
        println!("{name}: twin {} N, {baselines:?}", one["rmse_n"]);
        assert!(number(&one["relative_rmse"]) < 0.01, "{one}");
        assert!(number(&one["rmse_n"]) < of("spring") && of(formula) > 0.0 && of("last value") > of("spring"), "{one}");
        assert_eq!(one["against_baselines"], "better");
        assert!(number(&one["coverage"]) > 0.9, "{one}");
        assert!(one["over_depth"].as_array().unwrap().len() >= 3, "{one}");
    }
    assert_eq!((&result["better"], &result["failed"]), (&Value::from(2), &Value::from(0)));
}

/// A prediction does not depend on anything that was measured after the cut.
#[test]
fn the_rest_is_not_read_before_the_prediction_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let table = |name: &str, rest: &dyn Fn(f64) -> f64| {
        let mut text = "time_s,depth_m,force_n\n".to_owned();
        for i in 0..800 {
            let (t, d) = (0.01 * f64::from(i), 1e-5 * f64::from(i) - 1e-3);
            let force = 60.0 * d.max(0.0);
            let noise = 1e-4 * f64::from((i * 7919) % 13 - 6);
            let _ = writeln!(text, "{t},{d},{}", if d > 3.6e-3 { rest(force) } else { force } + noise);
        }
        let path = folder.path().join(name);
        fs::write(&path, text).unwrap();
        path.display().to_string()
    };
    let predicted = |path: &str, out: &str| {
        let out = folder.path().join(out);
        let (code, _, said) = run(&[path, "--scene", "indentation", "--force", "--out", &out.display().to_string()]);
        assert_eq!(code, 0, "{said}");
        fs::read_to_string(out.join("gel.csv")).unwrap()
    };
    let one = predicted(&table("gel.csv", &|f| f), "one");
    let other = predicted(&table("gel.csv", &|f| 7.0 - 3.0 * f), "other");
    assert!(one.lines().count() > 700);
    assert_eq!(one, other, "the force after the cut has changed the prediction");
    let json: Value =
        serde_json::from_str(&fs::read_to_string(folder.path().join("other/forecast.json")).unwrap()).unwrap();
    assert!(number(&entry(&json, "gel")["relative_rmse"]) > 0.2, "and the error is that of the other force");
}

/// Three samples of one tissue, of Yeoh's law, differ by their softness. Of each the first part is fitted; what stiffens further on the others
/// have shown. What is measured of a sample after the cut changes the forecasts of the others alone.
#[test]
fn the_law_is_learnt_from_the_other_recordings() {
    let folder = tempfile::tempdir().unwrap();
    let tables = ["soft", "middle", "stiff"].map(|name| folder.path().join(format!("{name}.csv")));
    for (path, scale) in tables.iter().zip([0.6, 1.0, 1.7]) {
        let solved = folder.path().join("solved");
        let law = format!("model=yeoh c10_pa={} c20_pa={} c30_pa={}", scale * 800.0, scale * 60.0, scale * 120.0);
        let set = law.split(' ').flat_map(|change| ["--set".to_owned(), format!("material.{change}")]);
        let mut command = Command::new(env!("CARGO_BIN_EXE_needle_twin"));
        command.args([
            "solve",
            "--scene",
            "compression",
            "--set",
            "motion.depth_m=0.006",
            "--set",
            "motion.speed_m_per_s=0.005",
        ]);
        let done = command.args(["--set", "motion.pose_hz=100", "--out"]).arg(&solved).args(set).output().unwrap();
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        fs::copy(solved.join("force.csv"), path).unwrap();
    }
    let names: Vec<String> = tables.iter().map(|path| path.display().to_string()).collect();
    let columns =
        ["--scene", "compression", "--position", "depth_m", "--force-column", "predicted_n", "--fit-to", "0.4"];
    let forecast = |more: &[&str], out: &str| -> Value {
        let out = folder.path().join(out).display().to_string();
        let all: Vec<&str> = names.iter().map(String::as_str).chain(columns).chain(["--json", "--out", &out]).collect();
        let (code, json, said) = run(&[&all[..], more].concat());
        assert_eq!(code, 0, "{said}");
        serde_json::from_str(&json).unwrap()
    };
    let (own, learnt) = (forecast(&["--law", "scene"], "own"), forecast(&[], "learnt"));
    for name in ["soft", "middle", "stiff"] {
        let error = |result: &Value| number(&entry(result, name)["relative_rmse"]);
        println!(
            "{name}: {} with the scene's law, {} with {}",
            error(&own),
            error(&learnt),
            entry(&learnt, name)["law"]
        );
        assert!(
            entry(&own, name)["law"].is_null()
                && entry(&learnt, name)["law"].as_str().unwrap().contains("learnt from 2")
        );
        assert!(error(&learnt) < 0.02 && error(&learnt) < 0.2 * error(&own), "{name}");
        assert!(number(&entry(&learnt, name)["coverage"]) > 0.9, "{name}");
    }
    // one recording alone starts from what the others have taught, and what is its own in the file does not count
    let prior = folder.path().join("lab.json").display().to_string();
    forecast(&["--write-prior", &prior], "kept");
    let alone: Vec<&str> =
        [names[0].as_str()].into_iter().chain(columns).chain(["--json", "--prior", &prior]).collect();
    let (code, json, said) = run(&alone);
    assert_eq!(code, 0, "{said}");
    let alone: Value = serde_json::from_str(&json).unwrap();
    for field in ["law", "correction", "rmse_n"] {
        assert_eq!(entry(&alone, "soft")[field], entry(&learnt, "soft")[field], "{field}");
    }
    assert!(entry(&alone, "soft")["correction"].as_str().unwrap().starts_with("corrected by 2 other recordings"));
    // the soft sample's rest becomes another
    let text = fs::read_to_string(&tables[0]).unwrap();
    let depth = |line: &str| line.split(',').nth(1).and_then(|d| d.parse::<f64>().ok()).unwrap_or(0.0);
    let changed = |line: &str| {
        let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
        if depth(line) > 2.5e-3 {
            cells[2] = format!("{}", 0.5 * cells[2].parse::<f64>().unwrap());
        }
        cells.join(",") + "\n"
    };
    fs::write(&tables[0], text.lines().map(changed).collect::<String>()).unwrap();
    forecast(&[], "changed");
    let prediction =
        |out: &str, name: &str| fs::read_to_string(folder.path().join(out).join(format!("{name}.csv"))).unwrap();
    assert_eq!(prediction("learnt", "soft"), prediction("changed", "soft"));
    assert_ne!(prediction("learnt", "stiff"), prediction("changed", "stiff"));
}

#[test]
fn a_second_insertion_follows_from_the_first_and_one_insertion_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let solved = folder.path().join("solved").display().to_string();
    let set = ["--scene", "indentation", "--set", "motion.depth_m=0.003"];
    let done = Command::new(env!("CARGO_BIN_EXE_needle_twin"))
        .args(["solve", "--set", "motion.insertions=2", "--out", &solved])
        .args(set)
        .output()
        .unwrap();
    assert!(done.status.success());
    let table = format!("{solved}/force.csv");
    let columns = ["--position", "depth_m", "--force-column", "predicted_n", "--set", "material.shear_modulus_pa=2500"];
    let (code, out, said) = run(&[&[table.as_str(), "--of", "insertion", "--json"], &set[..], &columns[..]].concat());
    assert_eq!(code, 0, "{said}");
    let result: Value = serde_json::from_str(&out).unwrap();
    let one = entry(&result, "force");
    assert_eq!(one["fitted_to"], "insertion 1 of 2");
    let modulus = number(&one["fit"]["material.shear_modulus_pa"]["value"]);
    assert!((modulus / 1678.0 - 1.0).abs() < 0.01, "{one}");
    assert!(number(&one["relative_rmse"]) < 0.01, "{one}");

    let (code, _, said) = run(&[&bag("indentation"), "--of", "insertion"]);
    assert_eq!(code, 3);
    assert!(said.contains("one insertion: --of depth or --of time"), "{said}");
}

#[test]
fn a_recording_that_fails_is_named_and_the_others_are_predicted() {
    let (code, out, said) = run(&[&bag("indentation"), "not_there.csv", "--json"]);
    assert_eq!(code, 3);
    assert!(said.contains("not_there") && said.contains("No such file"), "{said}");
    let result: Value = serde_json::from_str(&out).unwrap();
    assert_eq!(result["failed"], 1);
    assert!(entry(&result, "not_there")["failed"].is_string());
    assert!(number(&entry(&result, "indentation")["relative_rmse"]) < 0.01);
    // a law without that modulus: nothing is fitted in silence
    let ogden = ["material.model=ogden", "material.ogden_shear_moduli_pa=[1678]", "material.ogden_exponents=[2]"];
    let set: Vec<&str> = ogden.iter().flat_map(|change| ["--set", change]).collect();
    let (code, _, said) = run(&[&[bag("indentation").as_str()], &set[..]].concat());
    assert_eq!(code, 3);
    assert!(said.contains("name the keys to fit with --fit"), "{said}");
    let (code, _, said) = run(&[&bag("indentation"), "--fit-to", "1.5"]);
    assert_eq!(code, 2);
    assert!(said.contains("a share between 0 and 1"), "{said}");
}

/// A needle with friction: modulus, friction and cutting force are found from the first half of the insertion.
#[test]
fn a_needle_with_friction_is_predicted_where_no_formula_does() {
    let folder = tempfile::tempdir().unwrap();
    let solved = folder.path().join("solved").display().to_string();
    let scene = [
        "--scene",
        "needle_insertion",
        "--set",
        "instrument.interaction=frictional",
        "--set",
        "instrument.puncture_force_n=0.008",
        "--set",
        "motion.depth_m=0.004",
        "--set",
        "motion.pose_hz=200",
    ];
    let needle = |modulus: &str, friction: &str, cutting: &str| {
        ["material.shear_modulus_pa", "instrument.friction_n_per_m", "instrument.cutting_force_n"]
            .iter()
            .zip([modulus, friction, cutting])
            .flat_map(|(key, value)| ["--set".to_owned(), format!("{key}={value}")])
            .collect::<Vec<String>>()
    };
    let done = Command::new(env!("CARGO_BIN_EXE_needle_twin"))
        .args(["solve", "--out", &solved])
        .args(scene)
        .args(needle("1800", "4", "0.003"))
        .output()
        .unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let table = format!("{solved}/force.csv");
    // not from every start: docs/forecast.md
    let begun = needle("1678", "4.5", "0.004");
    let mut arguments = vec![table.as_str(), "--position", "depth_m", "--force-column", "predicted_n", "--json"];
    arguments.extend(scene);
    arguments.extend(begun.iter().map(String::as_str));
    let (code, out, said) = run(&arguments);
    assert_eq!(code, 0, "{said}");
    let result: Value = serde_json::from_str(&out).unwrap();
    let one = entry(&result, "force");
    println!("{one:#}");
    let found = |key: &str| number(&one["fit"][key]["value"]);
    assert!((found("material.shear_modulus_pa") / 1800.0 - 1.0).abs() < 0.05, "{one}");
    assert!((found("instrument.friction_n_per_m") / 4.0 - 1.0).abs() < 0.15, "{one}");
    assert!(number(&one["relative_rmse"]) < 0.04, "{one}");
    assert_eq!(one["against_baselines"], "better");
}
