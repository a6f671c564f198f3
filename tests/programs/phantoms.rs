//! Contract of `examples/phantoms`: what is shipped runs as it stands, and says what the page says of it.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::path::Path;

use assert_cmd::Command;
use serde_json::Value;
use tempfile::TempDir;

#[test]
fn the_shipped_recordings_are_calibrated_and_predict_themselves() {
    let folder = TempDir::new().unwrap();
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/phantoms/phantoms.toml");
    let mut command = Command::new(env!("CARGO_BIN_EXE_needle_twin"));
    let output = command.arg("batch").arg(manifest).arg("--json").arg("--out").arg(folder.path()).output().unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(0), "{stderr}");
    let all: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((all["recordings"].as_u64(), all["failed"].as_u64()), (Some(3), Some(0)));
    for group in all["groups"].as_array().unwrap() {
        let left = group["candidates"].as_array().unwrap().iter().find(|c| c[0] == group["candidate"]).unwrap();
        assert!(left[1].as_f64().unwrap() < 0.02, "the law meets what it was fitted to: {group}");
        assert!(group["mean_end_error"].as_f64().unwrap().abs() < 0.06, "and is near beyond it: {group}");
    }
}
