//! Contract of `batch`: shards are idempotent and can be resumed, what fails is a row with its reason, and the merged result does not
//! depend on who did what.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use serde_json::Value;
use tempfile::TempDir;

const SCENE: &str = r#"
name = "block"
description = "A coarse cylinder between two plates."
[sample]
shape = "cylinder"
diameter_m = 0.050
height_m = 0.030
[material]
model = "neo_hookean"
shear_modulus_pa = 10000.0
poisson_ratio = 0.49
density_kg_per_m3 = 1000.0
[instrument]
kind = "plate"
[discretisation]
method = "mmls"
spacing_m = 0.0075
edge_refinement = 0.3
growth = 0.35
"#;

/// Force of the made-up samples at a depth, N: of the shape of the model's, made by it once.
fn measured(curve: &[(f64, f64)], depth_m: f64) -> f64 {
    let next = curve.partition_point(|(d, _)| *d < depth_m).clamp(1, curve.len() - 1);
    let ((a, fa), (b, fb)) = (curve[next - 1], curve[next]);
    fa + (fb - fa) * ((depth_m - a) / (b - a)).clamp(0.0, 1.0)
}

fn program() -> Command {
    Command::new(env!("CARGO_BIN_EXE_needle_twin"))
}

/// Six recordings of three samples, one of which can't be read.
pub struct Lab {
    folder: TempDir,
}

impl Lab {
    pub fn new() -> Self {
        let lab = Self { folder: TempDir::new().unwrap() };
        fs::write(lab.path("block.toml"), SCENE).unwrap();
        let out = lab.path("own");
        let motion = ["--depth-m", "0.006", "--speed-m-per-s", "0.001", "--pose-hz", "50"];
        program()
            .arg("solve")
            .arg("--scene")
            .arg(lab.path("block.toml"))
            .args(motion)
            .arg("--out")
            .arg(&out)
            .assert()
            .success();
        let force = fs::read_to_string(out.join("force.csv")).unwrap();
        let curve: Vec<(f64, f64)> = force
            .lines()
            .skip(1)
            .map(|line| line.split(',').map(str::parse).collect::<Vec<Result<f64, _>>>())
            .map(|cells| (*cells[1].as_ref().unwrap(), *cells[2].as_ref().unwrap()))
            .collect();
        for (name, size, zero_n, contact_mm) in [
            ("A_1", 1.0, 0.1, 0.0),
            ("A_2", 1.02, -0.2, 0.3),
            ("B_1", 1.5, 0.0, 0.2),
            ("B_2", 1.47, 0.05, 0.0),
            ("C_1", 2.0, 0.0, 0.0),
        ] {
            let row = |i: u32| {
                let depth_mm = 0.02 * f64::from(i) - 0.5;
                // noise that repeats
                let noise = 0.01 * ((f64::from(i) * 12.9898).sin() * 43_758.547).fract();
                let force = size * measured(&curve, 1e-3 * (depth_mm - contact_mm)) + zero_n + noise;
                format!("{};{depth_mm};{force}\n", 0.02 * f64::from(i))
            };
            let rows: String = (0..300).map(row).collect();
            fs::write(lab.path(&format!("{name}.csv")), format!("Time (s);Position (mm);Load (N)\n{rows}")).unwrap();
        }
        fs::write(lab.path("C_2.csv"), "nothing but words\n").unwrap();
        let manifest = "[defaults]\nscene = \"block.toml\"\nfit = [\"material.shear_modulus_pa\"]\nload_cell = \"offset\"\n\
                        sample = \"{name:1}\"\ngroup = \"all\"\nto_depth_m = 0.005\nfit_to_depth_m = 0.003\n\
                        [[candidates]]\nname = \"plain\"\nset = []\n\
                        [[candidates]]\nname = \"stiffening\"\nset = [\"material.poisson_ratio=0.3\"]\n\
                        [[recordings]]\nfile = \"*_*.csv\"\n";
        fs::write(lab.path("manifest.toml"), manifest).unwrap();
        lab
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Runs the batch; exit code and what it printed.
    pub fn batch(&self, out: &str, more: &[&str]) -> (i32, String, String) {
        let mut command = program();
        command.arg("batch").arg(self.path("manifest.toml")).arg("--out").arg(self.path(out)).args(more);
        let output = command.output().unwrap();
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
        (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
    }
}

/// Every file of a folder with its bytes.
pub fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = fs::read_dir(folder).unwrap().map(|e| e.unwrap().path());
    let mut all = BTreeMap::new();
    for path in entries {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() {
            all.extend(files(&path).into_iter().map(|(inner, bytes)| (format!("{name}/{inner}"), bytes)));
        } else {
            all.insert(name, fs::read(&path).unwrap());
        }
    }
    all
}

#[test]
fn shards_in_any_order_and_twice_make_the_result_of_one_machine() {
    let lab = Lab::new();
    let (code, stdout, stderr) = lab.batch("whole", &["--threads", "2"]);
    assert_eq!(code, 3, "one recording can't be read: {stderr}");
    assert!(stderr.contains("C_2") && stderr.contains("--separator"), "{stderr}");
    assert!(stdout.contains("6 recordings, 1 failed"), "{stdout}");
    let whole = files(&lab.path("whole"));
    assert!(whole.contains_key("recordings/A_1.json") && whole.contains_key("report.html"), "{:?}", whole.keys());

    // three shards, of which one runs twice and one loses a row before it is run again
    for (out, shard) in [("three", "3/3"), ("one", "1/3"), ("one", "1/3"), ("two", "2/3")] {
        lab.batch(out, &["--shard", shard, "--threads", "1"]);
    }
    fs::remove_file(lab.path("two/recordings/A_2.json")).unwrap();
    let (_, again, _) = lab.batch("two", &["--shard", "2/3"]);
    assert!(again.contains("1 recordings done") && again.contains("1 were done before"), "{again}");
    // a digit of what is kept is another one: the row is done again, and that is said
    let row = lab.path("two/recordings/A_2.json");
    let text = fs::read_to_string(&row).unwrap();
    let (before, after) = text.split_once("\"peak_n\": ").unwrap();
    let digit = after.find(|c: char| ('1'..='8').contains(&c)).unwrap();
    let other = char::from(after.as_bytes()[digit] + 1);
    fs::write(&row, format!("{before}\"peak_n\": {}{other}{}", &after[..digit], &after[digit + 1..])).unwrap();
    let mut refused = program();
    refused.args(["batch", "merge"]).arg(lab.path("two")).arg("--out").arg(lab.path("none"));
    let said = String::from_utf8(refused.output().unwrap().stderr).unwrap();
    assert!(said.contains("A_2.json") && said.contains("checksum") && said.contains("run its shard again"), "{said}");
    let (_, again, said) = lab.batch("two", &["--shard", "2/3"]);
    assert!(again.contains("1 recordings done") && again.contains("1 were done before"), "{again}");
    assert!(said.contains("A_2.json") && said.contains("computed again"), "{said}");
    assert_eq!(fs::read_to_string(&row).unwrap(), text, "bit for bit");
    let mut merge = program();
    merge.args(["batch", "merge"]).args(["two", "three", "one"].map(|out| lab.path(out)));
    merge.arg("--out").arg(lab.path("merged")).assert().code(3);
    let merged = files(&lab.path("merged"));
    let differ: Vec<&String> =
        whole.keys().chain(merged.keys()).filter(|name| whole.get(*name) != merged.get(*name)).collect();
    assert!(differ.is_empty(), "bit for bit: {differ:?}");
}

#[test]
fn rows_and_samples_say_what_was_found() {
    let lab = Lab::new();
    lab.batch("out", &[]);
    let all: Value = serde_json::from_slice(&fs::read(lab.path("out/batch.json")).unwrap()).unwrap();
    let group = &all["groups"][0];
    assert_eq!(group["candidate"], "plain", "the model that made them leaves the least: {group}");
    assert_eq!((group["predicted"].as_u64(), group["within_5_percent"].as_u64()), (Some(5), Some(5)), "{group}");
    let samples = all["samples"].as_array().unwrap();
    for (sample, size) in samples.iter().zip([1.01, 1.485, 2.0]) {
        let key = &sample["keys"][0];
        let value = key["value"].as_f64().unwrap();
        assert!((value / (1e4 * size) - 1.0).abs() < 0.01, "{sample}");
        for one in sample["left_one_out"].as_array().unwrap() {
            assert!(one[1].as_f64().unwrap() < 0.03, "{sample}");
        }
    }
    let row: Value = serde_json::from_slice(&fs::read(lab.path("out/recordings/A_2.json")).unwrap()).unwrap();
    let contact = row["fits"][0]["contact_depth_m"].as_f64().unwrap();
    assert!((contact - 3e-4).abs() < 5e-5, "{row}");
    let page = fs::read_to_string(lab.path("out/report.html")).unwrap();
    assert_eq!(page.matches("<svg").count(), 5);
    let first = page.find("class=\"card\"").unwrap();
    assert!(page[first..first + 60].contains("C_2"), "the worst first");
    assert!(!page.contains("http"), "it loads nothing");
    let table = fs::read_to_string(lab.path("out/table.csv")).unwrap();
    assert_eq!(table.lines().count(), 7);
}

#[test]
fn what_changes_is_done_again_and_nothing_else() {
    let lab = Lab::new();
    lab.batch("out", &[]);
    // the one that failed is tried again, and only it
    let (_, text, _) = lab.batch("out", &[]);
    assert!(text.contains("1 recordings done") && text.contains("5 were done before"), "{text}");
    let table = fs::read_to_string(lab.path("A_1.csv")).unwrap();
    fs::write(lab.path("C_2.csv"), &table).unwrap();
    fs::write(lab.path("B_1.csv"), table.replace("0.1", "0.10")).unwrap();
    let (code, text, stderr) = lab.batch("out", &[]);
    assert_eq!(code, 0, "{stderr}");
    assert!(text.contains("2 recordings done") && text.contains("4 were done before"), "{text}");
}

#[test]
fn a_table_of_recordings_is_a_manifest_too() {
    let lab = Lab::new();
    let manifest = lab.path("list.csv");
    fs::write(
        &manifest,
        "name,file,sample,scene,set,fit,load_cell,to_depth_m\n\
         first,A_1.csv,A,block.toml,material.shear_modulus_pa=10000,,,0.004\n\
         # left out\n\
         second,B_1.csv,B,block.toml,,material.shear_modulus_pa=1e3..1e5,offset,0.004\n",
    )
    .unwrap();
    let out = lab.path("out");
    program().arg("batch").arg(&manifest).arg("--out").arg(&out).assert().success();
    let of = |name: &str| -> Value {
        serde_json::from_slice(&fs::read(out.join(format!("recordings/{name}.json"))).unwrap()).unwrap()
    };
    assert_eq!(of("first")["fits"][0]["keys"].as_array().unwrap().len(), 0, "replayed");
    assert_eq!(of("second")["fits"][0]["keys"][0]["key"], "material.shear_modulus_pa");
    for (text, words) in [
        ("file\nnone_*.csv\n", "none_"),
        ("file,scene,colour\na.csv,b,red\n", "colour"),
        ("name,file\nx,A_1.csv\nx,B_1.csv\n", "two recordings are called x"),
    ] {
        fs::write(&manifest, text).unwrap();
        let output = program().arg("batch").arg(&manifest).arg("--out").arg(lab.path("none")).output().unwrap();
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.code() == Some(1) && stderr.contains(words), "{stderr}");
    }
}

/// The same manifest with more defaults.
fn with_defaults(lab: &Lab, more: &str) {
    let manifest = fs::read_to_string(lab.path("manifest.toml")).unwrap();
    fs::write(lab.path("manifest.toml"), manifest.replacen("[defaults]\n", &format!("[defaults]\n{more}\n"), 1))
        .unwrap();
}

fn json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

#[test]
fn curves_that_all_share_find_what_runs_find() {
    let lab = Lab::new();
    lab.batch("runs", &[]);
    with_defaults(&lab, "curves = \"table\"\nchoose_from_depth_m = 0.0015");
    let (_, text, _) = lab.batch("table", &[]);
    assert!(text.contains("0.0 runs of the twin each, 2 runs for the curves that they share"), "{text}");
    for name in ["A_1", "A_2", "B_1", "B_2", "C_1"] {
        let [runs, table] = ["runs", "table"].map(|out| json(&lab.path(out).join(format!("recordings/{name}.json"))));
        for (a, b) in runs["fits"].as_array().unwrap().iter().zip(table["fits"].as_array().unwrap()) {
            let value = |fit: &Value| fit["keys"][0]["value"].as_f64().unwrap();
            assert!((value(a) / value(b) - 1.0).abs() < 2e-3, "{name}: {a} {b}");
            assert!(b["forward_error"].as_f64().unwrap() < 0.05 && a["forward_error"].is_null(), "{b}");
            assert!(a["runs"].as_u64().unwrap() >= 2, "{a}");
        }
    }
    // the curves are kept: what is done again takes none of their runs, and comes out the same
    let made = files(&lab.path("table"));
    fs::remove_dir_all(lab.path("table/recordings")).unwrap();
    let (_, text, _) = lab.batch("table", &[]);
    assert!(text.contains("0.0 runs of the twin each") && !text.contains("runs for the curves"), "{text}");
    assert!(files(&lab.path("table")) == made, "bit for bit");
}

#[test]
fn recordings_of_a_sample_are_fitted_together() {
    let lab = Lab::new();
    with_defaults(&lab, "curves = \"table\"\ntogether = true");
    lab.batch("out", &[]);
    let all = json(&lab.path("out/batch.json"));
    for (sample, size) in all["samples"].as_array().unwrap().iter().zip([1.01, 1.485, 2.0]) {
        let key = &sample["keys"][0];
        assert_eq!(key["together"], true, "{sample}");
        assert!((key["value"].as_f64().unwrap() / (1e4 * size) - 1.0).abs() < 0.01, "{sample}");
    }
    // one modulus and the contact of each: 0 and 0.3 mm; the repeats differ by 2 %, and so does the modulus within its error
    let row = json(&lab.path("out/samples/A.json"));
    let fit = &row["fits"][0];
    let contact = |i: usize| fit["own"][i][1].as_f64().unwrap();
    assert!(contact(0).abs() < 1e-4 && (contact(1) - 3e-4).abs() < 1e-4, "{fit}");
    let error = fit["keys"][0]["standard_error"].as_f64().unwrap();
    assert!((40.0..200.0).contains(&error), "half of the difference of the two, 200 Pa, or less: {fit}");
    // shards make the same
    for shard in ["1/2", "2/2"] {
        lab.batch("parts", &["--shard", shard, "--threads", "1"]);
    }
    let mut merge = program();
    merge.args(["batch", "merge"]).arg(lab.path("parts")).arg("--out").arg(lab.path("parts")).assert().code(3);
    assert_eq!(files(&lab.path("parts")), files(&lab.path("out")));
}
