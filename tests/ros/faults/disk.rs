//! Results that can't be written: a full disk, a folder that is read-only.
//!
//! Where the system gives no file system of its own to a test (`unshare -rm`), a limit on the size of a file stands for the
//! full disk, and a file in the place of a folder for the folder that can't be written: each test looks at one of the two.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::process::Command;

use crate::ros::free_domain;

/// Where a test can't write.
enum Disk {
    /// In a file system of its own, mounted at $1, by the way that its name says.
    Own,
    /// By a limit on the size of a file, or below a file that is no folder.
    Limited,
}

/// Runs a shell script with a folder as $1 and the program as $2; `own` in a file system of its own of `size`, `limited` where
/// the system gives none.
fn run(size: &str, own: &str, limited: &str) -> (Disk, Option<i32>, String) {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path().display().to_string();
    let shell = |program: &str, first: &[&str], script: &str| {
        let arguments = ["-c", script, "sh", &place, env!("CARGO_BIN_EXE_needle_twin")];
        Command::new(program).args(first).args(arguments).output()
    };
    let mounted = |script: &str| {
        let script = format!("mount -t tmpfs -o size={size} none \"$1\" || exit 99\n{script}");
        shell("unshare", &["-rm", "sh"], &script)
    };
    let private = mounted("true").is_ok_and(|o| o.status.success());
    let output = if private { mounted(own) } else { shell("sh", &[], limited) }.unwrap();
    let said = String::from_utf8_lossy(&output.stderr).to_lowercase();
    (if private { Disk::Own } else { Disk::Limited }, output.status.code(), said)
}

const SOLVE: &str =
    "\"$2\" solve --scene compression --depth-m 0.0005 --set discretisation.spacing_m=0.005 --json --out";

#[test]
fn a_full_disk_costs_the_files_of_a_run_and_not_its_figures() {
    // what is left in the folder goes to stderr as well
    let script = format!("{SOLVE} \"$1/out\" >&2; code=$?; ls -A \"$1/out\" | sed 's/^/left: /' >&2; exit $code");
    // 40 kB a file, and the signal that comes with the limit unheard, as on a full disk
    let (disk, code, said) = run("60k", &script, &format!("trap '' XFSZ; ulimit -f 80; {script}"));
    let reason = match disk {
        Disk::Own => "no space left",
        Disk::Limited => "file too large",
    };
    assert_eq!(code, Some(3), "{said}");
    assert_eq!(said.matches(reason).count(), 1, "said once: {said}");
    assert!(
        said.contains("\"peak_predicted_n\"") && !said.contains("left: "),
        "the figures, and no half of a file: {said}"
    );
}

/// What is said of a folder that can't be written.
fn reason(disk: &Disk) -> &'static str {
    match disk {
        Disk::Own => "read-only",
        Disk::Limited => "not a directory",
    }
}

#[test]
fn a_folder_that_is_read_only_is_said_before_anything_is_computed() {
    let own = format!("mount -o remount,ro \"$1\" && {SOLVE} \"$1/out\" >/dev/null");
    let limited = format!(": > \"$1/file\" && {SOLVE} \"$1/file/out\" >/dev/null");
    let (disk, code, said) = run("1m", &own, &limited);
    assert_eq!((code, said.matches("error:").count()), (Some(1), 1), "{said}");
    assert!(said.contains(reason(&disk)), "{said}");
}

#[test]
fn a_recording_into_a_folder_that_is_read_only_ends_the_node_at_its_start() {
    let twin = env!("CARGO_BIN_EXE_twin_node");
    let record =
        |folder: &str| format!("ROS_DOMAIN_ID={} {twin} --ros-args -p record:=\"{folder}/run\"", free_domain());
    let own = format!("mount -o remount,ro \"$1\" && {}", record("$1"));
    let (disk, code, said) = run("1m", &own, &format!(": > \"$1/file\" && {}", record("$1/file")));
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("parameter `record`") && said.contains(reason(&disk)), "{said}");
}
