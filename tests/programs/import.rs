//! Contract of `import`: what tables of other programs say, and what is asked where they don't.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use needle_recording::{Recording, TopicNames};
use serde_json::Value;
use tempfile::TempDir;

fn import(arguments: &[&str]) -> (i32, String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_needle_twin")).arg("import").args(arguments).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    let (out, err) = (text(output.stdout), text(output.stderr));
    assert!(!err.contains("panicked"), "{err}");
    (output.status.code().unwrap(), out, err)
}

fn file(folder: &Path, name: &str, text: impl AsRef<[u8]>) -> PathBuf {
    let path = folder.join(name);
    fs::write(&path, text).unwrap();
    path
}

fn word(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Imports with success and reads the bag.
fn bag(file: &Path, more: &[&str]) -> Recording {
    let out = file.with_extension("bag");
    let _ = fs::remove_dir_all(&out);
    let (code, _, stderr) = import(&[&[word(file), "--out", word(&out)], more].concat());
    assert_eq!((code, stderr.as_str()), (0, ""), "{}", file.display());
    Recording::load(&out, &TopicNames::default()).unwrap()
}

/// Rows of time in s, compression in mm, load in N.
fn rows(separator: &str, comma: bool) -> String {
    let number = |x: f64| if comma { format!("{x:.4}").replace('.', ",") } else { format!("{x:.4}") };
    let row = |i: u32| [0.1, 0.02, -0.003].map(|k| number(k * f64::from(i))).join(separator);
    (0..50).map(|i| row(i) + "\r\n").collect()
}

fn same(recording: &Recording, what: &str) {
    assert_eq!((recording.depths.len(), recording.forces.len()), (50, 50), "{what}");
    for (i, (depth, force)) in recording.depths.iter().zip(&recording.forces).enumerate() {
        let i = i as f64;
        assert!((depth.time_s - 0.1 * i).abs() < 1e-9 && (force.time_s - 0.1 * i).abs() < 1e-9, "{what}");
        assert!((depth.depth_m - 2e-5 * i).abs() < 1e-12, "{what}: {depth:?}");
        assert!((force.force_n[2] + 3e-3 * i).abs() < 1e-9, "{what}: {force:?}");
    }
}

#[test]
fn the_ways_in_which_tables_are_written_mean_the_same() {
    let folder = TempDir::new().unwrap();
    let header = ["Time (s)", "Compression (mm)", "Load (N)"];
    let preamble = "Phantom_A_1\nCompression test;\nCylinder Diameter: 50mm;\nLoad cell: 1kN;\n";
    let latin: Vec<u8> = format!("Time (s);Weg [\u{b5}m];Kraft [N]\n{}", rows(";", true))
        .chars()
        .map(|c| u8::try_from(u32::from(c)).unwrap())
        .collect();
    let wide: Vec<u8> = format!("\u{feff}{}\n{}", header.join("\t"), rows("\t", false))
        .encode_utf16()
        .flat_map(u16::to_le_bytes)
        .collect();
    let texts: Vec<(&str, Vec<u8>, &[&str])> = vec![
        ("comma", format!("{}\n{}", header.join(","), rows(",", false)).into(), &[]),
        ("preamble", format!("{preamble}{}\n{}", header.join(","), rows(",", false)).into(), &[]),
        ("decimal_comma", format!("{}\n{}", header.join(";"), rows(";", true)).into(), &[]),
        ("tabs", format!("\u{feff}{}\n{}", header.join("\t"), rows("\t", true)).into(), &[]),
        ("units_below", format!("Time,Extension,Load\n(s),(mm),(N)\n{}", rows(",", false)).into(), &[]),
        ("comments", format!("# a rig\n# t x F\ntime_s,depth_mm,force_n\n# begin\n{}", rows(",", false)).into(), &[]),
        ("utf16", wide, &[]),
        ("latin1", latin, &["--position-unit", "mm"]),
        (
            "numbers",
            rows(" ", false).into(),
            &[
                "--time",
                "1",
                "--time-unit",
                "s",
                "--position",
                "2",
                "--position-unit",
                "mm",
                "--force",
                "3",
                "--force-unit",
                "N",
            ],
        ),
        (
            "quoted",
            format!(
                "\"Time (s)\",\"Compression (mm)\",\"Load (N)\"\n{}",
                rows("\",\"", false).replace("\r\n", "\"\n\"")
            )
            .into(),
            &["--header-line", "1"],
        ),
    ];
    for (name, text, more) in texts {
        let text = if name == "quoted" {
            let text = String::from_utf8(text).unwrap();
            let (head, rest) = text.split_once('\n').unwrap();
            format!("{head}\n\"{}", rest.trim_end_matches('"')).into_bytes()
        } else {
            text
        };
        same(&bag(&file(folder.path(), &format!("{name}.csv"), text), more), name);
    }
}

#[test]
fn signs_units_strains_and_clocks() {
    let folder = TempDir::new().unwrap();
    let table = |i: f64| format!("{},{},{}\n", 1e3 * i, -0.5 * i, 10.0 * i);
    let text = format!("t (ms),z (%),F (gf)\n{}", (0..40).map(|i| table(f64::from(i))).collect::<String>());
    let strain = file(folder.path(), "strain.csv", &text);
    let found =
        bag(&strain, &["--position", "z", "--gauge-length-m", "0.03", "--position-sign", "-1", "--force-sign", "-1"]);
    let (depth, force) = (found.depths[39], found.forces[39]);
    assert!((depth.depth_m - 0.195 * 0.03).abs() < 1e-12 && (depth.time_s - 39.0).abs() < 1e-9, "{depth:?}");
    assert!((force.force_n[2] + 0.39 * 9.80665).abs() < 1e-9, "{force:?}");

    // two files with their own clocks: that of the force is 0.25 s late
    let one: String = (0..40).map(|i| format!("{:.1};{:.3}\n", 0.1 * f64::from(i), 0.01 * f64::from(i))).collect();
    let other: String =
        (0..400).map(|i| format!("{:.2},{:.4}\n", 0.25 + 0.01 * f64::from(i), 0.001 * f64::from(i))).collect();
    let position = file(folder.path(), "position.csv", format!("time (s);position (mm)\n{one}"));
    let cell = file(folder.path(), "cell.csv", format!("t (s),force (N)\n{other}"));
    let out = folder.path().join("both");
    let arguments = [word(&position), word(&cell), "--out", word(&out), "--time-offset-s", "0.25"];
    assert_eq!(import(&arguments).0, 0);
    let both = Recording::load(&out, &TopicNames::default()).unwrap();
    assert_eq!((both.depths.len(), both.forces.len()), (40, 400));
    assert!(
        both.forces[0].time_s.abs() < 1e-9 && (both.forces[100].time_s - 1.0).abs() < 1e-9,
        "{:?}",
        both.forces[100]
    );
}

#[test]
fn three_columns_are_the_tip_in_the_samples_frame() {
    let folder = TempDir::new().unwrap();
    let row = |i: i32| {
        format!(
            "{:.2},{:.3},0,{:.3},{:.4}\n",
            0.01 * f64::from(i),
            0.01 * f64::from(i),
            17.0 - 0.1 * f64::from(i),
            1e-3
        )
    };
    let text = "t,px,py,pz,load\n".to_owned() + &(0..30).map(row).collect::<String>();
    let table = file(folder.path(), "free.csv", text);
    for columns in ["px,py,pz", "2,3,4"] {
        let options = ["--time", "t", "--pose-columns", columns, "--time-unit", "s", "--position-unit", "mm"];
        let read = bag(&table, &[&options[..], &["--force", "load", "--force-unit", "N"]].concat());
        assert!(read.depths.is_empty() && read.poses.len() == 30 && read.forces.len() == 30, "{columns}");
        let last = read.poses[29];
        let wanted = [29e-5, 0.0, 17e-3 - 29e-4];
        assert!(last.tip.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-9), "{columns}: {last:?}");
        assert_eq!(last.axis, [0.0, 0.0, -1.0], "{columns}");
    }
    let (code, _, stderr) = import(&[word(&table), "--out", "never", "--pose-columns", "px,py"]);
    assert!(code == 2 && stderr.contains("three columns"), "{code}: {stderr}");
}

#[test]
fn what_is_not_there_is_asked_for() {
    let folder = TempDir::new().unwrap();
    let out = folder.path().join("none");
    let refused = |name: &str, text: &str, more: &[&str], words: &[&str]| {
        let path = file(folder.path(), name, text);
        let (code, _, stderr) = import(&[&[word(&path), "--out", word(&out)], more].concat());
        assert_eq!(code, 1, "{name}: {stderr}");
        words.iter().for_each(|w| assert!(stderr.contains(w), "{name}: {w} in {stderr}"));
        assert!(!out.exists(), "{name}");
    };
    let body = rows(",", false);
    refused("no_unit.csv", &format!("Time (s),Position,Load (N)\n{body}"), &[], &["Position", "--position-unit", "mm"]);
    refused("no_names.csv", &body, &[], &["--position", "1 `1`"]);
    refused("two.csv", &format!("Time (s),Force (N),Load (N)\n{body}"), &[], &["several", "--force", "Load"]);
    refused("words.csv", "nothing\nto see\n", &[], &["--separator"]);
    refused("old.mat", "MATLAB 5.0 MAT-file", &[], &["MATLAB", "writetable"]);
    let all = format!("Time (s),Position (mm),Load (N)\n{body}");
    refused("unit.csv", &all, &["--force-unit", "pound"], &["--force-unit pound", "lbf"]);
    refused("timeless.csv", &format!("a,Position (mm),Load (N)\n{body}"), &[], &["--time", "--rate-hz"]);
}

#[test]
fn cells_that_are_no_numbers_are_a_loss_and_empty_ones_are_not() {
    let folder = TempDir::new().unwrap();
    let text = format!("Time (s),Position (mm),Load (N)\n{}5.0,0.1,overload\n5.1,,0.2\n5.2,0.1,\n", rows(",", false));
    let path = file(folder.path(), "gaps.csv", text);
    let out = folder.path().join("bag");
    let (code, _, stderr) = import(&[word(&path), "--out", word(&out)]);
    assert_eq!(code, 3, "{stderr}");
    assert!(stderr.contains("line 52") && stderr.contains("overload"), "{stderr}");
    let read = Recording::load(&out, &TopicNames::default()).unwrap();
    assert_eq!((read.depths.len(), read.forces.len()), (52, 51), "the depth beside a force that is none stays");
}

#[test]
fn a_dry_run_shows_what_was_understood_and_writes_nothing() {
    let folder = TempDir::new().unwrap();
    let text = format!(
        "Time (s),Compression (mm),Load (N),Engineering Stress (kPa)\n{}",
        rows(",", false).replace("\r\n", ",1\n")
    );
    let path = file(folder.path(), "dry.csv", text);
    let out = folder.path().join("bag");
    let (code, stdout, _) = import(&[word(&path), "--out", word(&out), "--dry-run", "--json"]);
    assert_eq!(code, 0);
    let seen: Value = serde_json::from_str(&stdout).unwrap();
    let columns = seen["tables"][0]["columns"].as_array().unwrap();
    let shown: Vec<(&str, u64)> =
        columns.iter().map(|c| (c["what"].as_str().unwrap(), c["column"].as_u64().unwrap())).collect();
    assert_eq!(shown, [("time", 1), ("position", 2), ("force", 3)]);
    assert_eq!(seen["bag"], Value::Null);
    let (_, text, _) = import(&[word(&path), "--dry-run"]);
    assert!(text.contains("in mm") && text.contains("50 rows") && text.contains("dry run"), "{text}");
    assert!(!out.exists());
}

/// A table is read piece by piece: of a million rows (28 MB of text) the readings remain, 48 bytes a row. Read as a whole it needed more than
/// 160 MB.
#[cfg(target_os = "linux")]
#[test]
fn a_long_table_takes_room_for_its_readings_only() {
    let folder = TempDir::new().unwrap();
    let rows: String = (0..1_000_000)
        .map(|i| format!("{:.4},{:.6},{:.6}\n", f64::from(i) * 1e-3, f64::from(i) * 1e-5, 0.25))
        .collect();
    let table = file(folder.path(), "long.csv", format!("Time (s),Position (mm),Force (N)\n{rows}"));
    let command =
        format!("ulimit -v 130000; exec {} import {} --dry-run", env!("CARGO_BIN_EXE_needle_twin"), word(&table));
    let output = Command::new("bash").args(["-c", &command]).output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(text.contains("depth  1000000 readings from 0.000 to 999.999 s"), "{text}{output:?}");
}

/// A long table is read twice and is never in memory: three million rows (84 MB of text) run in 90 MB of addresses, though their
/// readings are 144 MB.
#[cfg(target_os = "linux")]
#[test]
fn a_long_table_takes_no_room() {
    let folder = TempDir::new().unwrap();
    let row = |i: u32| format!("{:.4},{:.6},{:.6}\n", f64::from(i) * 1e-3, f64::from(i) * 1e-5, 0.25);
    let rows: String = (0..3_000_000).map(row).collect();
    let table = file(folder.path(), "long.csv", format!("Time (s),Position (mm),Force (N)\n{rows}"));
    let (program, out) = (env!("CARGO_BIN_EXE_needle_twin"), folder.path().join("bag"));
    let command = format!("ulimit -v 90000; exec {program} import {} --out {}", word(&table), word(&out));
    let output = Command::new("bash").args(["-c", &command]).output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(text.contains("depth  3000000 readings from 0.000 to 2999.999 s"), "{text}{output:?}");
    let checked = Command::new(program).args(["bag", "info", word(&out)]).output().unwrap();
    assert!(String::from_utf8_lossy(&checked.stdout).contains("6000000"), "{checked:?}");
}
