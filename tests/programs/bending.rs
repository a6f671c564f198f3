//! Contract of `examples/bevel_needle.toml`: it runs as it stands, and says where the bent needle is.
#![allow(clippy::unwrap_used)]

use std::fs;
use std::path::Path;

use assert_cmd::Command;
use serde_json::Value;
use tempfile::TempDir;

#[test]
fn a_bevelled_wire_leaves_its_line() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = TempDir::new().unwrap();
    let out = folder.path().join("out");
    let run = Command::new(env!("CARGO_BIN_EXE_needle_twin"))
        .args(["solve", "--json", "--depth-m", "0.02", "--scene"])
        .arg(root.join("examples/bevel_needle.toml"))
        .arg("--out")
        .arg(&out)
        .output()
        .unwrap();
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let metrics: Value = serde_json::from_slice(&run.stdout).unwrap();
    let deepest = &metrics["needle"]["deepest"];
    let [x, y] = [0, 1].map(|k| deepest["tip_m"][k].as_f64().unwrap());
    assert!(x > 3e-4 && y.abs() < 1e-9, "{deepest}");
    let rows = |name: &str| fs::read_to_string(out.join(name)).unwrap().lines().map(str::to_owned).collect::<Vec<_>>();
    let needle = rows("needle.csv");
    assert_eq!(needle.len() - 1, metrics["poses"].as_u64().unwrap() as usize);
    let last: Vec<f64> = needle.last().unwrap().split(',').map(|cell| cell.parse().unwrap()).collect();
    assert!((last[2] - x).abs() < 1e-9, "{last:?} {x}");
    // the last shape ends at the tip, and is as long as the needle
    let shape: Vec<f64> = rows("shape.csv").last().unwrap().split(',').map(|cell| cell.parse().unwrap()).collect();
    assert!((shape[2] - 0.1).abs() < 1e-5 && (shape[3] - x).abs() < 1e-9, "{shape:?}");
    let line = fs::read_to_string(out.join("needle.vtu")).unwrap();
    assert!(line.contains("NumberOfPoints=\"81\"") && line.contains(">4</DataArray>"), "{line}");
    assert!(fs::read_to_string(out.join("report.html")).unwrap().contains("\"needle\""));
}
