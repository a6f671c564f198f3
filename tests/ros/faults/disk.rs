//! Results that can't be written: a full disk, a folder that is read-only.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::process::Command;

/// Runs a shell script in a file system of its own of `size`, mounted at $1; `None` where the system gives none.
fn in_own_disk(size: &str, script: &str) -> Option<(Option<i32>, String)> {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path().display().to_string();
    let own = |script: &str| {
        let script = format!("mount -t tmpfs -o size={size} none \"$1\" || exit 99\n{script}");
        Command::new("unshare")
            .args(["-rm", "sh", "-c", &script, "sh", &place, env!("CARGO_BIN_EXE_needle_twin")])
            .output()
    };
    if !own("true").is_ok_and(|o| o.status.success()) {
        eprintln!("not tried: this system gives no private file system (unshare -rm)");
        return None;
    }
    let output = own(script).unwrap();
    Some((output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned()))
}

const SOLVE: &str =
    "\"$2\" solve --scene compression --depth-m 0.0005 --set discretisation.spacing_m=0.005 --json --out";

#[test]
fn a_full_disk_costs_the_files_of_a_run_and_not_its_figures() {
    // what is left of the file system goes to stderr as well
    let script = format!("{SOLVE} \"$1/out\" >&2; code=$?; ls -A \"$1/out\" | sed 's/^/left: /' >&2; exit $code");
    let Some((code, said)) = in_own_disk("60k", &script) else { return };
    assert_eq!(code, Some(3), "{said}");
    assert_eq!(said.to_lowercase().matches("no space left").count(), 1, "said once: {said}");
    assert!(
        said.contains("\"peak_predicted_n\"") && !said.contains("left: "),
        "the figures, and no half of a file: {said}"
    );
}

#[test]
fn a_folder_that_is_read_only_is_said_before_anything_is_computed() {
    let script = format!("mount -o remount,ro \"$1\" && {SOLVE} \"$1/out\" >/dev/null");
    let Some((code, said)) = in_own_disk("1m", &script) else { return };
    assert_eq!((code, said.matches("error:").count()), (Some(1), 1), "{said}");
    assert!(said.to_lowercase().contains("read-only"), "{said}");
}

#[test]
fn a_recording_into_a_folder_that_is_read_only_ends_the_node_at_its_start() {
    let twin = env!("CARGO_BIN_EXE_twin_node");
    let script = format!("mount -o remount,ro \"$1\" && ROS_DOMAIN_ID=87 {twin} --ros-args -p record:=\"$1/run\"");
    let Some((code, said)) = in_own_disk("1m", &script) else { return };
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("parameter `record`") && said.to_lowercase().contains("read-only"), "{said}");
}
