//! Contract of `examples/phantoms`: what is shipped runs as it stands, and says what the page says of it.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::fs;
use std::path::Path;

use assert_cmd::Command;
use needle_estimate::batch::Manifest;
use serde_json::Value;
use tempfile::TempDir;

#[test]
fn the_shipped_recordings_are_calibrated_and_predict_themselves() {
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/phantoms");
    let shipped = example.join("phantoms.toml");
    let manifest = Manifest::read(&shipped, None).unwrap();
    assert_eq!((manifest.candidates.len(), manifest.recordings.len()), (15, 3), "five laws with three kinds of plates");

    // two laws and two kinds of plates take 20 runs in place of 407
    let folder = TempDir::new().unwrap();
    let text = fs::read_to_string(&shipped).unwrap();
    let left_out = ["Mooney-Rivlin", "Yeoh", "Veronda-Westmann", "Coulomb"];
    let kept =
        text.split("[[").filter(|part| !left_out.iter().any(|name| part.contains(&format!("name = \"{name}\""))));
    let text = kept.collect::<Vec<_>>().join("[[");
    let scene = example.join("phantom.toml");
    let text = text.replace("scene = \"phantom.toml\"", &format!("scene = {:?}", scene.display().to_string()));
    let manifest = folder.path().join("few.toml");
    fs::write(&manifest, text).unwrap();

    let mut command = Command::new(env!("CARGO_BIN_EXE_needle_twin"));
    let out = folder.path().join("out");
    let output =
        command.arg("batch").arg(manifest).arg("--root").arg(&example).arg("--json").arg("--out").arg(&out).output();
    let output = output.unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(0), "{stderr}");
    let all: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((all["recordings"].as_u64(), all["failed"].as_u64()), (Some(3), Some(0)));
    for group in all["groups"].as_array().unwrap() {
        let taken = group["candidates"].as_array().unwrap().iter().find(|c| c[0] == group["candidate"]).unwrap();
        assert!(taken[1].as_f64().unwrap() < 0.02, "half of what is fitted predicts the other half: {group}");
        assert!(group["mean_end_error"].as_f64().unwrap().abs() < 0.08, "and is near beyond it: {group}");
    }
}
