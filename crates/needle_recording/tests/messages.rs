//! The types of messages that a motion and a force come in, and stamps that are none.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;

use mcap::records::MessageHeader;
use needle_recording::{Quantity, Recording, Selection, TopicNames};
use ros2_messages::builtin_interfaces::Time;
use ros2_messages::geometry_msgs::{
    PointStamped, Pose, PoseStamped, PoseWithCovariance, PoseWithCovarianceStamped, Quaternion, Transform,
    TransformStamped, Vector3, Wrench, WrenchStamped,
};
use ros2_messages::sensor_msgs::JointState;
use ros2_messages::std_msgs::Header;
use ros2_messages::{RosMessage, to_cdr};
use rosbag2_mcap::{BagReader, Loss};

const COUNT: u32 = 200;
const BEGIN: u64 = 1_700_000_000_000_000_000;

fn ns(i: u32) -> u64 {
    BEGIN + u64::from(i) * 10_000_000
}

fn header(i: u32, frame: &str) -> Header {
    Header { stamp: Time::from_nanos(i64::try_from(ns(i)).unwrap()), frame_id: frame.to_owned() }
}

/// A bag of one motion and one force.
fn bag<M: RosMessage, F: RosMessage>(
    (motion_topic, motion): (&str, &dyn Fn(u32) -> M),
    (force_topic, force): (&str, &dyn Fn(u32) -> F),
) -> (tempfile::TempDir, BagReader) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("theirs.mcap");
    // another program's bag: this project's own has no messages of some of these types
    let mut writer = mcap::Writer::new(BufWriter::new(File::create(&path).unwrap())).unwrap();
    let mut channel = |topic: &str, of: &str| {
        let schema = writer.add_schema(of, "ros2msg", b"# as its package says").unwrap();
        writer.add_channel(schema, topic, "cdr", &BTreeMap::new()).unwrap()
    };
    let (a, b) = (channel(motion_topic, M::TYPE), channel(force_topic, F::TYPE));
    for i in 0..COUNT {
        let of = |channel_id| MessageHeader { channel_id, sequence: i, log_time: ns(i), publish_time: ns(i) };
        writer.write_to_known_channel(&of(a), &to_cdr(&motion(i)).unwrap()).unwrap();
        writer.write_to_known_channel(&of(b), &to_cdr(&force(i)).unwrap()).unwrap();
    }
    writer.finish().unwrap();
    let reader = BagReader::open(path).unwrap();
    (folder, reader)
}

fn tip(i: u32) -> [f64; 3] {
    [0.001, -0.002, 0.02 - 1e-5 * f64::from(i)]
}

fn wrench(i: u32) -> Wrench {
    Wrench { force: [0.0, 0.0, 1e-3 * f64::from(i)].into(), torque: Vector3::default() }
}

fn joints(i: u32) -> JointState {
    JointState {
        header: header(i, ""),
        name: vec!["insertion".to_owned()],
        position: vec![1e-5 * f64::from(i)],
        ..JointState::default()
    }
}

/// Poses and forces that were recorded come out, none lost.
fn whole(recording: &Recording, axis: [f64; 3]) {
    assert!(recording.losses.is_empty(), "{:?}", recording.losses);
    assert_eq!((recording.poses.len(), recording.forces.len()), (COUNT as usize, COUNT as usize));
    for (i, pose) in recording.poses.iter().enumerate() {
        let i = i as u32;
        assert!((pose.time_s - 0.01 * f64::from(i)).abs() < 1e-9, "{pose:?}");
        let near = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12);
        assert!(near(pose.tip, tip(i)) && near(pose.axis, axis), "{pose:?}");
        assert!((recording.forces[i as usize].force_n[2] - 1e-3 * f64::from(i)).abs() < 1e-12);
    }
}

fn said(position: &str, force: &str) -> Selection {
    let at = |place: &str| Quantity { place: Some(place.to_owned()), ..Quantity::default() };
    Selection { position: at(position), force: at(force), ..Selection::default() }
}

#[test]
fn a_point_is_a_pose_that_points_down() {
    let point = |i: u32| PointStamped { header: header(i, "sample"), point: tip(i).into() };
    let force = |i: u32| WrenchStamped { header: header(i, "sample"), wrench: wrench(i) };
    let (_folder, bag) = bag(("/stage/position", &point), ("/cell", &force));
    let down = [0.0, 0.0, -1.0];
    whole(&Recording::of_bag(&bag, &said("/stage/position", "/cell")).unwrap(), down);
    whole(&Recording::of_bag(&bag, &Selection::default()).unwrap(), down);
}

#[test]
fn a_wrench_without_a_stamp_has_the_time_of_its_recording() {
    let pose = |i: u32| PoseStamped {
        header: header(i, "sample"),
        pose: Pose { position: tip(i).into(), orientation: Quaternion { x: 1.0, y: 0.0, z: 0.0, w: 0.0 } },
    };
    let (_folder, bag) = bag(("/tip", &pose), ("/wrench", &wrench));
    for selection in [said("/tip", "/wrench"), Selection::default()] {
        let recording = Recording::of_bag(&bag, &selection).unwrap();
        whole(&recording, [0.0, 0.0, -1.0]);
        assert!((recording.forces[100].time_s - 1.0).abs() < 1e-6, "{:?}", recording.forces[100]);
    }
}

#[test]
fn a_pose_with_covariance_is_a_pose() {
    // z of the tool along x
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let pose = |i: u32| PoseWithCovarianceStamped {
        header: header(i, "sample"),
        pose: PoseWithCovariance {
            pose: Pose { position: tip(i).into(), orientation: Quaternion { x: 0.0, y: half, z: 0.0, w: half } },
            ..PoseWithCovariance::default()
        },
    };
    let force = |i: u32| WrenchStamped { header: header(i, "sample"), wrench: wrench(i) };
    let (_folder, bag) = bag(("/tracker/tip", &pose), ("/cell", &force));
    whole(&Recording::of_bag(&bag, &said("/tracker/tip", "/cell")).unwrap(), [1.0, 0.0, 0.0]);
}

/// A stamp with more nanoseconds than a second has is no time: few of them are lost, and counted; where all are such, the recorder's clock is
/// used, and that is said.
#[test]
fn of_several_tools_on_one_topic_that_of_the_tip_is_named() {
    let half = COUNT / 2;
    let transform = |i: u32| TransformStamped {
        header: header(i, "sample"),
        child_frame_id: if i < half { "needle" } else { "probe" }.to_owned(),
        transform: Transform { translation: tip(i).into(), rotation: Quaternion { x: 1.0, y: 0.0, z: 0.0, w: 0.0 } },
    };
    let force = |i: u32| WrenchStamped { header: header(i, "sample"), wrench: wrench(i) };
    let (_folder, bag) = bag(("/tracker", &transform), ("/cell", &force));
    let error = Recording::of_bag(&bag, &Selection::default()).unwrap_err().to_string();
    assert!(error.contains("needle, probe: name that of the tip with --joint"), "{error}");
    let names = TopicNames { joint: "needle".to_owned(), ..TopicNames::default() };
    let found = Recording::of_bag(&bag, &Selection { names, ..Selection::default() }).unwrap();
    assert_eq!((found.poses.len(), found.losses.len()), (half as usize, 0), "{:?}", found.losses);
}

#[test]
fn a_named_position_needs_no_topic_that_stands_out() {
    let other = |i: u32| JointState { position: vec![1.0], ..joints(i) };
    let (_folder, bag) = bag(("/rig/measured_js", &joints), ("/arm/measured_js", &other));
    let error = Recording::of_bag(&bag, &Selection::default()).unwrap_err().to_string();
    assert!(error.contains("/rig/measured_js") && error.contains("--measured-js"), "{error}");
    let position = Quantity { place: Some("/rig/measured_js".to_owned()), ..Quantity::default() };
    let found = Recording::of_bag(&bag, &Selection { position, ..Selection::default() }).unwrap();
    assert!((found.depths[100].depth_m - 1e-3).abs() < 1e-12, "{:?}", found.depths[100]);
}

#[test]
fn more_nanoseconds_than_a_second_has_are_no_stamp() {
    let force = |i: u32| WrenchStamped { header: header(i, "sample"), wrench: wrench(i) };
    let broken = |of: &'static dyn Fn(u32) -> bool| {
        move |i: u32| {
            let mut message = joints(i);
            if of(i) {
                message.header.stamp.nanosec = 1_000_000_000 + i;
            }
            message
        }
    };
    let (_folder, few) = bag(("/measured_js", &broken(&|i| i % 80 == 7)), ("/measured_cf", &force));
    let recording = Recording::of_bag(&few, &Selection::default()).unwrap();
    assert_eq!((recording.depths.len(), recording.forces.len()), (COUNT as usize - 3, COUNT as usize));
    let [Loss::Samples { topic, count: 3, reason }] = &recording.losses[..] else { panic!("{:?}", recording.losses) };
    assert!(topic == "/measured_js" && reason.contains("more than 999999999 ns"), "{topic}: {reason}");

    let (_folder, all) = bag(("/measured_js", &broken(&|_| true)), ("/measured_cf", &force));
    let recording = Recording::of_bag(&all, &Selection::default()).unwrap();
    assert!(recording.losses.is_empty() && recording.depths.len() == COUNT as usize, "{:?}", recording.losses);
    let text = "/measured_js: 200 of 200 messages have a stamp with more than 999999999 ns";
    assert!(recording.warnings.iter().any(|warning| warning.starts_with(text)), "{:?}", recording.warnings);
    assert!((recording.depths[100].time_s - 1.0).abs() < 1e-6);
}
