//! The same scene gives the same bits with any number of threads, from the command line.
#![allow(clippy::unwrap_used)]

use std::process::Command;

use serde_json::Value;

#[test]
fn the_command_line_keeps_the_promise() {
    let metrics = |threads: &str| -> Value {
        let output = Command::new(env!("CARGO_BIN_EXE_needle_twin"))
            .args(["solve", "--scene", "compression", "--depth-m", "0.0005", "--json", "--speed-m-per-s", "0.02"])
            .args(["--set", "discretisation.spacing_m=0.004", "--set", "stepping.max_steps_per_pose=5"])
            .args(["--threads", threads])
            .output()
            .unwrap();
        // so fast a motion on so coarse a model need not hold its stability table: 3
        assert!(matches!(output.status.code(), Some(0 | 3)), "{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let one = metrics("1");
    for threads in ["2", "4"] {
        let many = metrics(threads);
        assert_eq!(many["checksum"], one["checksum"], "{threads} threads");
        assert_eq!(many["force"], one["force"], "{threads} threads");
    }
}
