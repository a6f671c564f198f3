//! The recorder when things go wrong: the process is killed, the disk is full.
#![allow(clippy::unwrap_used, clippy::panic)]

use ros2_messages::std_msgs::Float64;
use rosbag2_mcap::{BagError, BagReader, BagWriter, Loss, Qos, WriterOptions, check};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// Runs one of the ignored tests below in a process of its own.
fn child(test: &str, folder: &Path) -> Child {
    Command::new(std::env::current_exe().unwrap())
        .args(["--exact", test, "--ignored", "--nocapture"])
        .env("BAG_TEST_FOLDER", folder)
        .stdout(Stdio::null())
        .spawn()
        .unwrap()
}

fn folder_of_child() -> std::path::PathBuf {
    std::env::var_os("BAG_TEST_FOLDER").unwrap().into()
}

#[test]
#[ignore = "a child process of a_killed_recorder_leaves_a_readable_bag"]
fn child_that_never_finishes() {
    let options = WriterOptions { flush_after: Some(Duration::from_millis(5)), ..Default::default() };
    let mut bag = BagWriter::create(folder_of_child().join("bag"), options).unwrap();
    let topic = bag.add_topic::<Float64>("/number", &Qos::reliable(10)).unwrap();
    for i in 0u64.. {
        bag.write(topic, i, i, &Float64 { data: i as f64 }).unwrap();
        if i % 50 == 0 {
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

#[test]
fn a_killed_recorder_leaves_a_readable_bag() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bag");
    let mut recorder = child("recorder::child_that_never_finishes", folder.path());
    let file = path.join("bag_0.mcap");
    let start = std::time::Instant::now();
    while std::fs::metadata(&file).map_or(0, |m| m.len()) < 60_000 {
        assert!(start.elapsed() < Duration::from_secs(20), "the recorder writes");
        std::thread::sleep(Duration::from_millis(5));
    }
    recorder.kill().unwrap();
    recorder.wait().unwrap();
    let bag = BagReader::open(&path).unwrap();
    assert!(
        matches!(bag.losses(), [Loss::CutOff { .. }] | [Loss::PartOfChunk { .. }, Loss::CutOff { .. }]),
        "{:?}",
        bag.losses()
    );
    let numbers: Vec<f64> = bag.messages().map(|m| bag.decode::<Float64>(&m).unwrap().data).collect();
    assert!(numbers.len() > 500 && numbers.iter().enumerate().all(|(i, n)| *n == i as f64));
    assert_eq!(bag.topics()[0].messages, numbers.len() as u64);
    // What players and `ros2 bag info` go by: at most the chunk is missing behind which the process was killed.
    let said = bag.metadata().unwrap();
    let whole = numbers.len() as u64;
    assert!(said.message_count > 500 && said.message_count <= whole, "{} of {whole}", said.message_count);
    assert_eq!(said.topics_with_message_count[0].message_count, said.message_count);
    assert_eq!(said.duration.nanoseconds as u64, said.message_count - 1, "one each nanosecond");
}

#[test]
#[ignore = "a child process of a_full_disk_ends_the_recording_and_not_the_file"]
fn child_on_a_full_disk() {
    let mut bag = BagWriter::create(folder_of_child().join("bag"), WriterOptions::default()).unwrap();
    let topic = bag.add_topic::<Float64>("/number", &Qos::reliable(10)).unwrap();
    let mut errors = Vec::new();
    for i in 0..2_000_000u64 {
        // Noise, so that compression does not save the disk.
        let data = f64::from_bits(i.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 2);
        errors.extend(bag.write(topic, i, i, &Float64 { data }).err());
    }
    let [BagError::Write { reason, .. }] = errors.as_slice() else { panic!("said once: {errors:?}") };
    assert!(reason.contains("No space left"), "{reason}");
    let written = bag.finish().unwrap();
    assert!(written.complete && written.lost > 0 && written.messages + written.lost == 2_000_000, "{written:?}");
    let report = check(folder_of_child().join("bag")).unwrap();
    assert_eq!(report.findings, []);
    assert_eq!(report.messages, written.messages);
}

/// A small file system of its own, where the system lets an ordinary user have one.
#[test]
fn a_full_disk_ends_the_recording_and_not_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let mut trial = Command::new("unshare");
    trial.args(["-rm", "mount", "-t", "tmpfs", "-o", "size=4m", "none"]).arg(folder.path());
    if !trial.stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok_and(|s| s.success()) {
        eprintln!("not tried: this system gives no private file system (unshare -rm)");
        return;
    }
    let me = std::env::current_exe().unwrap();
    let script = "mount -t tmpfs -o size=4m none \"$1\" && exec \"$2\" --exact recorder::child_on_a_full_disk --ignored --nocapture";
    let output = Command::new("unshare")
        .args(["-rm", "sh", "-c", script, "sh"])
        .args([folder.path().as_os_str(), me.as_os_str()])
        .env("BAG_TEST_FOLDER", folder.path())
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}
