//! Contract of ensembles on the command line: `--members` on `solve` and `replay`.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::fs;
use std::path::Path;

use assert_cmd::Command;
use serde_json::Value;

const SMALL: [&str; 10] = [
    "--scene",
    "indentation",
    "--depth-m",
    "0.001",
    "--speed-m-per-s",
    "0.002",
    "--set",
    "discretisation.spacing_m=0.003",
    "--set",
    "targets.0.name=tumour",
];

fn program(arguments: &[&str]) -> (Option<i32>, String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_needle_twin")).args(arguments).output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.code(), text(&output.stdout), text(&output.stderr))
}

fn solve(more: &[&str]) -> (Option<i32>, String, String) {
    let place = ["--set", "targets.0.position_m=[0.0,0.0,0.010]"];
    program(&[&["solve"], &SMALL[..], &place, more].concat())
}

/// Columns of a table of numbers by their names.
fn column(folder: &Path, name: &str) -> Vec<f64> {
    let text = fs::read_to_string(folder.join("force.csv")).unwrap();
    let place = text.lines().next().unwrap().split(',').position(|c| c == name);
    let place = place.unwrap_or_else(|| panic!("no column {name}"));
    text.lines().skip(1).map(|line| line.split(',').nth(place).unwrap().parse().unwrap()).collect()
}

#[test]
fn solve_gives_the_band_of_its_members() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let modulus = "uncertainty.material.shear_modulus_pa={normal=[1678, 100]}";
    let (code, json, stderr) = solve(&["--members", "8", "--set", modulus, "--out", out, "--json"]);
    assert_eq!(code, Some(0), "{stderr}");
    let metrics: Value = serde_json::from_str(&json).unwrap();
    let ensemble = &metrics["ensemble"];
    assert_eq!((ensemble["members"].as_u64(), ensemble["left_out"].as_u64()), (Some(8), Some(0)));
    let key = &ensemble["keys"][0];
    assert_eq!(key["key"], "material.shear_modulus_pa");
    assert_eq!((key["mean"].as_f64(), key["standard_deviation"].as_f64()), (Some(1678.0), Some(100.0)));
    assert_eq!(ensemble["measured_share_inside"], Value::Null);
    assert_eq!(ensemble["targets"][0]["name"], "tumour");
    let [low, middle, high] =
        ["predicted_low_n", "predicted_n", "predicted_high_n"].map(|name| column(folder.path(), name));
    let last = middle.len() - 1;
    assert!(low[last] < middle[last] && middle[last] < high[last]);
    // the force goes with the modulus; eight draws see nearly two standard deviations to either side
    let half = (high[last] - low[last]) / 2.0 / middle[last] / (100.0 / 1678.0);
    assert!((1.2..2.0).contains(&half), "{half} standard deviations");
    let page = fs::read_to_string(folder.path().join("report.html")).unwrap();
    assert!(page.contains("95 % of members"), "the page has the fan");
    // without members nothing else changes
    let (_, plain, _) = solve(&["--set", modulus, "--json"]);
    let plain: Value = serde_json::from_str(&plain).unwrap();
    assert_eq!(plain["checksum"], metrics["checksum"]);
    assert!(plain.get("ensemble").is_none());
    let (_, other, _) = solve(&["--members", "8", "--set", modulus, "--seed", "1", "--json", "--threads", "1"]);
    let other: Value = serde_json::from_str(&other).unwrap();
    assert_ne!(other["ensemble"]["band_mean_width_n"], ensemble["band_mean_width_n"], "another seed draws others");
}

#[test]
fn keys_that_go_together_widen_the_band_and_opposite_ones_narrow_it() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let width = |correlation: &str| {
        // at the deepest the force is some 30 mN, of which the modulus' standard deviation makes 6 %
        let modulus = "uncertainty.material.shear_modulus_pa={normal=[1678, 100]}";
        let zero = format!("uncertainty.align.force_zero_n={{normal=[0, 0.0025]{correlation}}}");
        let (code, _, stderr) = solve(&["--members", "32", "--set", modulus, "--set", &zero, "--out", out]);
        assert_eq!(code, Some(0), "{stderr}");
        let [low, high] = ["predicted_low_n", "predicted_high_n"].map(|name| column(folder.path(), name));
        high[high.len() - 1] - low[low.len() - 1]
    };
    let [opposite, none, alike] =
        [-0.95, 0.0, 0.95].map(|r| width(&format!(", correlation = {{ \"material.shear_modulus_pa\" = {r} }}")));
    assert!(opposite < 0.6 * none && none < 0.8 * alike, "{opposite}, {none}, {alike} N");
    let alone = width("");
    assert!((none / alone - 1.0).abs() < 1e-6, "a correlation of 0 is none: {none}, {alone} N");
    let refused = |of: &str| {
        let zero = format!("uncertainty.align.force_zero_n={{normal=[0, 0.0025], correlation={of}}}");
        let (code, _, stderr) = solve(&["--members", "8", "--set", &zero]);
        assert_eq!(code, Some(1));
        stderr
    };
    assert!(refused("{ \"material.shear_modulus_pa\" = 0.5 }").contains("no other key"));
    assert!(refused("{ \"material.shear_modulus_pa\" = 1.5 }").contains("above -1 and below 1"));
}

#[test]
fn members_of_a_scene_that_is_sure_of_everything_are_refused_with_the_remedy() {
    let (code, _, stderr) = solve(&["--members", "8"]);
    assert_eq!(code, Some(1));
    assert!(
        stderr.contains("[uncertainty]") && stderr.contains("\"material.shear_modulus_pa\" = { normal"),
        "{stderr}"
    );
    let sure = "uncertainty.material.shear_modulus_pa={normal=[1678, 100]}";
    let (code, _, stderr) = solve(&["--members", "1", "--set", sure]);
    assert!(code == Some(1) && stderr.contains("at least 2"), "{stderr}");
}

#[test]
fn a_study_of_sensitivity_says_which_key_matters() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = |more: &[&str]| {
        let small = [
            "study",
            "sensitivity",
            "--set",
            "discretisation.spacing_m=0.003",
            "--set",
            "motion.depth_m=0.0005",
            "--set",
            "motion.speed_m_per_s=0.02",
            "--scene",
            "indentation",
        ];
        program(&[&small[..], more].concat())
    };
    let modulus = "uncertainty.material.shear_modulus_pa={uniform=[1500, 1900]}";
    let zero = "uncertainty.align.force_zero_n={normal=[0.0, 0.0001]}";
    let target = ["--set", "targets.0.name=tumour", "--set", "targets.0.position_m=[0.0,0.0,0.010]"];
    let out = folder.path().to_str().unwrap();
    let keys = ["--set", modulus, "--set", zero, "--members", "8", "--out", out, "--json"];
    let (code, json, stderr) = arguments(&[&keys[..], &target].concat());
    assert_eq!(code, Some(0), "{stderr}");
    let found: Value = serde_json::from_str(&json).unwrap();
    // force is proportional to the one, and the other is none of the tissue's
    assert_eq!((found["points"].as_u64(), found["runs"].as_u64()), (Some(8), Some(1)));
    let output = &found["outputs"][0];
    assert_eq!(output["name"], "peak_force_n");
    let index = |key: usize, which: &str| output["keys"][key][which].as_f64().unwrap();
    assert!(index(0, "total") > 0.9 && index(1, "total") < 0.1, "the modulus matters, the zero does not: {output}");
    assert_eq!(found["outputs"][1]["name"], "displacement_m.tumour");
    assert_eq!(fs::read_to_string(folder.path().join("sensitivity.json")).unwrap(), json);
    let table = fs::read_to_string(folder.path().join("sensitivity.csv")).unwrap();
    assert!(table.lines().nth(1).unwrap().starts_with("peak_force_n,material.shear_modulus_pa,"), "{table}");
    let (code, _, stderr) = arguments(&["--members", "8"]);
    assert!(code == Some(1) && stderr.contains("[uncertainty]"), "{stderr}");
}

/// Parts of a study that two machines have made are put together bit for bit, and nothing is run twice.
#[test]
fn parts_of_a_study_of_sensitivity_are_put_together() {
    let folder = tempfile::tempdir().unwrap();
    let study = |out: &str, more: &[&str]| {
        let out = folder.path().join(out);
        let ratio = "uncertainty.material.poisson_ratio={uniform=[0.45, 0.49]}";
        let small = ["discretisation.spacing_m=0.003", "motion.depth_m=0.0005", "motion.speed_m_per_s=0.02", ratio];
        let set = small.iter().flat_map(|change| ["--set", change]);
        let head = ["study", "sensitivity", "--scene", "indentation", "--members", "4", "--out", out.to_str().unwrap()];
        program(&head.into_iter().chain(set).chain(more.iter().copied()).collect::<Vec<_>>())
    };
    let of = |out: &str| fs::read(folder.path().join(out).join("sensitivity.json")).unwrap();
    assert_eq!(study("whole", &[]).0, Some(0));
    // four points, two blocks of them that differ
    for (part, runs) in [("2/3", 3), ("1/3", 3), ("3/3", 2)] {
        let (code, said, stderr) = study("parts", &["--shard", part]);
        assert_eq!(code, Some(0), "{stderr}");
        assert!(said.contains(&format!("part {} of 3: {runs} of 8 runs, {runs} made now", &part[..1])), "{said}");
        assert!(!folder.path().join("parts/sensitivity.json").exists(), "a part says nothing of the whole");
    }
    let (_, again, _) = study("parts", &["--shard", "2/3"]);
    assert!(again.contains("3 of 8 runs, 0 made now"), "{again}");
    assert_eq!(study("parts", &[]).0, Some(0));
    assert!(of("parts") == of("whole"), "bit for bit");
    let kept = fs::read_dir(folder.path().join("parts/members")).unwrap().count();
    assert_eq!(kept, 8);
    let (code, _, stderr) = study("parts", &["--shard", "4/3"]);
    assert!(code == Some(2) && stderr.contains("i/n"), "{stderr}");
}
