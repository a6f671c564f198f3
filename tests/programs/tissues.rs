//! Contract of `examples/tissues`: each scene runs as it stands, and its moduli are those of the table in `docs/materials.md`.
#![allow(clippy::unwrap_used)]

use std::fs;
use std::path::Path;

use assert_cmd::Command;
use needle_core::scene::file::load;
use serde_json::Value;
use tempfile::TempDir;

/// A modulus that no source gives, and that the page and the scene say is assumed.
const ASSUMED: [(&str, &str); 1] = [("brain", "lesion")];

#[test]
fn each_scene_runs_and_its_moduli_stand_in_the_table() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let page = fs::read_to_string(root.join("docs/materials.md")).unwrap();
    let rows: Vec<Vec<&str>> =
        page.lines().filter(|l| l.starts_with('|')).map(|l| l.split('|').map(str::trim).collect()).collect();
    // the second column in kPa, without what is said of its scatter
    let in_table: Vec<f64> = rows.iter().filter_map(|r| r.get(2)?.split(' ').next()?.parse().ok()).collect();
    let mut scenes: Vec<_> = fs::read_dir(root.join("examples/tissues")).unwrap().map(|e| e.unwrap().path()).collect();
    scenes.sort();
    assert!(scenes.len() >= 4, "{scenes:?}");
    for path in scenes {
        let name = path.file_name().unwrap().to_str().unwrap();
        assert!(page.contains(&format!("`examples/tissues/{name}`")), "{name} has no row");
        let scene = load(path.to_str().unwrap()).unwrap();
        let of_regions = scene.materials.iter().map(|m| (m.name.as_str(), m.material.shear_modulus()));
        for (material, modulus) in of_regions.chain([("", scene.material.shear_modulus())]) {
            let known = in_table.iter().any(|kpa| (modulus - 1e3 * kpa).abs() < 1e-6 * modulus);
            assert!(known || ASSUMED.contains(&(scene.name.as_str(), material)), "{name}: {material} {modulus} Pa");
        }
        let folder = TempDir::new().unwrap();
        let out = folder.path().join("out");
        let solve = ["solve", "--json", "--scene"];
        let run = Command::new(env!("CARGO_BIN_EXE_needle_twin"))
            .args(solve)
            .arg(&path)
            .arg("--out")
            .arg(&out)
            .output()
            .unwrap();
        assert_eq!(run.status.code(), Some(0), "{name}: {}", String::from_utf8_lossy(&run.stderr));
        let said: Value = serde_json::from_slice(&run.stdout).unwrap();
        assert!(said["force"]["peak_predicted_n"].as_f64().unwrap() > 0.0, "{name}: {said}");
    }
}
