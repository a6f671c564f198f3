//! Contract of the options that say what a recording's numbers are: a bag and a table alike, one adapter.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use needle_recording::{Quantity, Recording, Selection};
use ros2_messages::RosMessage as _;
use ros2_messages::schema::Schema;
use ros2_messages::std_msgs::{Float64MultiArray, MultiArrayLayout};
use rosbag2_mcap::{BagWriter, Qos, WriterOptions};
use serde_json::Value;
use tempfile::TempDir;

/// Time in s, depth in m, force in N: with few binary digits, so that a sign or a text changes no bit.
fn samples() -> impl Iterator<Item = (f64, f64, f64)> {
    (0..40).map(f64::from).map(|i| (i / 64.0, i / 65_536.0, i / 1024.0))
}

fn array_bag(folder: &Path) -> PathBuf {
    let text = "std_msgs/MultiArrayLayout layout\nfloat64[] data\n\
                ================================================================================\n\
                MSG: std_msgs/MultiArrayLayout\nstd_msgs/MultiArrayDimension[] dim\nuint32 data_offset\n\
                ================================================================================\n\
                MSG: std_msgs/MultiArrayDimension\nstring label\nuint32 size\nuint32 stride\n";
    let schema =
        Schema { type_name: Float64MultiArray::TYPE.to_owned(), text: text.to_owned(), hash: "RIHS01_0".to_owned() };
    let mut bag = BagWriter::create(folder.join("daq"), WriterOptions::default()).unwrap();
    let topic = bag.add_raw_topic("/daq", &schema, &Qos::reliable(10)).unwrap();
    for (time_s, depth_m, force_n) in samples() {
        let ns = 1_700_000_000_000_000_000 + (time_s * 1e9) as u64;
        let message = Float64MultiArray { layout: MultiArrayLayout::default(), data: vec![7.0, -depth_m, force_n] };
        bag.write(topic, ns, ns, &message).unwrap();
    }
    bag.finish().unwrap().folder
}

fn table(folder: &Path) -> PathBuf {
    let path = folder.join("rig.csv");
    let rows: String = samples().map(|(t, d, f)| format!("{t},{d},{}\n", -f)).collect();
    fs::write(&path, format!("time_s,depth_m,force_n\n{rows}")).unwrap();
    path
}

fn checksum(recording: &Path, more: &[&str]) -> (Value, Value) {
    let coarse = ["--json", "--force", "--scene", "compression", "--set", "discretisation.spacing_m=0.004"];
    let output = Command::new(env!("CARGO_BIN_EXE_needle_twin"))
        .arg("replay")
        .arg(recording)
        .args(coarse)
        .args(["--set", "stepping.max_steps_per_pose=3"])
        .args(more)
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    let metrics: Value = serde_json::from_slice(&output.stdout).unwrap_or_else(|e| panic!("{e}: {text}"));
    (metrics["checksum"].clone(), metrics["force"].clone())
}

#[test]
fn a_bag_of_arrays_and_a_table_are_one_recording() {
    let folder = TempDir::new().unwrap();
    let array = array_bag(folder.path());
    let options = ["--position-topic", "/daq[1]", "--position-sign", "-1", "--force-topic", "/daq[2]"];
    let of_array = checksum(&array, &options);
    let of_table = checksum(&table(folder.path()), &["--force-sign", "-1"]);
    assert_eq!(of_array, of_table);
    assert!(of_array.1["peak_measured_n"].as_f64().unwrap() > 0.0, "{of_array:?}");
    let imported = folder.path().join("imported");
    let mut import = Command::new(env!("CARGO_BIN_EXE_needle_twin"));
    import.arg("import").arg(&array).args(options).arg("--out").arg(&imported).assert().success();
    assert_eq!(checksum(&imported, &[]), of_array, "and the same once imported");
}

#[test]
fn units_and_clocks_of_topics() {
    let folder = TempDir::new().unwrap();
    let array = array_bag(folder.path());
    let quantity = |place: &str, unit: &str, reversed| Quantity {
        place: Some(place.to_owned()),
        unit: Some(unit.to_owned()),
        reversed,
        ..Quantity::default()
    };
    let said = Selection {
        position: quantity("/daq[1]", "mm", true),
        force: quantity("/daq[2]", "gf", false),
        time_offset_s: 0.5,
        ..Selection::default()
    };
    let read = Recording::open(std::slice::from_ref(&array), &said).unwrap();
    let (depth, force) = (read.depths[8], read.forces[8]);
    assert!(
        (depth.depth_m - 8.0 / 65_536.0 * 1e-3).abs() < 1e-15 && (force.force_n[2] - 9.80665e-3 / 128.0).abs() < 1e-12
    );
    assert!((depth.time_s - force.time_s - 0.5).abs() < 1e-9, "the force was half a second late");
    for (place, word) in [("/daq", "INDEX"), ("/daq[9]", "index 9"), ("/none", "/daq")] {
        let said = Selection { position: quantity(place, "mm", false), ..Selection::default() };
        let error = Recording::open(std::slice::from_ref(&array), &said).unwrap_err().to_string();
        assert!(error.contains(word), "{place}: {error}");
    }
}
