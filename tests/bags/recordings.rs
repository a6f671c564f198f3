//! The synthetic recordings: what is shipped is what `bag make` makes, and says what it is.
#![allow(clippy::unwrap_used, clippy::panic)]

use needle_recording::{Recording, TopicNames};
use needle_rig::embedded;
use needle_rig::make::{RigRecording, RigScene};
use needle_rig::sensors::{DisplacementModel, LoadCellModel};
use ros2_messages::builtin_interfaces::Time;
use ros2_messages::geometry_msgs::{Pose, PoseStamped, Quaternion, WrenchStamped};
use ros2_messages::sensor_msgs::JointState;
use ros2_messages::std_msgs::{Float64, Header};
use rosbag2_mcap::{BagError, BagReader, BagWriter, Qos, WriterOptions, check};
use std::path::{Path, PathBuf};

fn shipped(scene: RigScene) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("bags").join(scene.name())
}

fn load(path: &Path) -> Recording {
    Recording::load(path, &TopicNames::default()).unwrap()
}

#[test]
fn the_same_seed_gives_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let short = RigRecording { depth_m: 0.001, ..RigRecording::of(RigScene::NeedleInsertion) };
    let bytes = |name: &str, recording: &RigRecording| {
        let path = folder.path().join(name).join("needle");
        std::fs::create_dir(folder.path().join(name)).unwrap();
        recording.write(&path).unwrap();
        (std::fs::read(path.join("needle_0.mcap")).unwrap(), std::fs::read(path.join("metadata.yaml")).unwrap())
    };
    let first = bytes("a", &short);
    assert_eq!(first, bytes("b", &short));
    assert_ne!(first, bytes("c", &RigRecording { seed: 99, ..short }));
}

#[test]
fn the_shipped_bags_are_what_bag_make_makes() {
    let folder = tempfile::tempdir().unwrap();
    let mut bytes = 0;
    for scene in RigScene::ALL {
        let fresh = folder.path().join(scene.name());
        RigRecording::of(scene).write(&fresh).unwrap();
        let (fresh, kept) = (load(&fresh), load(&shipped(scene)));
        // Another machine's sine may differ in the last bit, which can move a reading by one step of its resolution.
        assert_eq!(fresh.depths.len(), kept.depths.len());
        for (a, b) in fresh.depths.iter().zip(&kept.depths) {
            assert!(a.time_s == b.time_s && (a.depth_m - b.depth_m).abs() < 2.1e-6);
        }
        for (a, b) in fresh.forces.iter().zip(&kept.forces) {
            assert!(a.time_s == b.time_s && (a.force_n[2] - b.force_n[2]).abs() < 1.1e-4);
        }
        assert_eq!(check(shipped(scene)).unwrap().findings, []);
        assert!(kept.source.contains("synthetic") && kept.source.contains("not a measurement"), "{}", kept.source);
        assert_eq!(kept.scene.as_deref(), Some(scene.name()));
        assert!(kept.losses.is_empty() && kept.warnings.is_empty());
        bytes += std::fs::read_dir(shipped(scene)).unwrap().map(|e| e.unwrap().metadata().unwrap().len()).sum::<u64>();
    }
    assert!(bytes < 5_000_000, "the bags of bags/ stay small: {bytes}");
}

#[test]
fn a_recording_is_the_truth_seen_by_its_sensors() {
    for scene in RigScene::ALL {
        let made = RigRecording::of(scene);
        let recording = load(&shipped(scene));
        assert_eq!(recording.topics.joint_state.as_deref(), Some("/measured_js"));
        assert_eq!(recording.topics.wrench.as_deref(), Some("/measured_cf"));
        assert_eq!(recording.force_frame, "sample");
        let (d, f) = (made.displacement, made.load_cell);
        for s in &recording.depths {
            let truth = made.true_depth_m(s.time_s);
            let error = s.depth_m - truth - d.deviation_m(truth);
            assert!(error.abs() < 6.0 * d.noise_m + d.resolution_m, "{error} at {}", s.time_s);
        }
        let mut squares = 0.0;
        for s in &recording.forces {
            let truth = made.true_force_n(made.true_depth_m(s.time_s));
            let error = s.force_n[2] - truth - f.deviation_n(truth) - f.offset_n - f.drift_n_per_s * s.time_s;
            assert!(error.abs() < 6.0 * f.noise_n + f.resolution_n, "{error} at {}", s.time_s);
            assert_eq!(s.force_n[..2], [0.0, 0.0]);
            squares += error * error;
        }
        let rms = (squares / recording.forces.len() as f64).sqrt();
        assert!((rms / f.noise_n - 1.0).abs() < 0.1, "{rms}");
        // It starts and ends above the surface, and goes as deep as it says.
        let deepest = recording.depths.iter().map(|s| s.depth_m).fold(f64::MIN, f64::max);
        assert!((deepest - made.depth_m).abs() < 2.5e-5, "{deepest}");
        let ends = [recording.depths[0], *recording.depths.last().unwrap()];
        assert!(ends.iter().all(|s| (s.depth_m + made.approach_m).abs() < 2.5e-5));
    }
}

#[test]
fn ideal_sensors_give_the_reference_itself() {
    let folder = tempfile::tempdir().unwrap();
    let made = RigRecording {
        displacement: DisplacementModel::IDEAL,
        load_cell: LoadCellModel::IDEAL,
        ..RigRecording::of(RigScene::Compression)
    };
    made.write(folder.path().join("ideal")).unwrap();
    let recording = load(&folder.path().join("ideal"));
    let peak = recording.forces.iter().map(|s| s.force_n[2]).fold(0.0, f64::max);
    assert!((peak - 0.847635).abs() < 1e-9, "{peak}");
    assert!(recording.depths.iter().all(|s| (s.depth_m - made.true_depth_m(s.time_s)).abs() < 1e-12));
}

#[test]
fn nothing_is_overwritten_and_nothing_is_left_behind() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bag");
    let made = RigRecording { depth_m: 0.0005, ..RigRecording::of(RigScene::Indentation) };
    made.write(&path).unwrap();
    assert!(matches!(made.write(&path), Err(BagError::Exists { .. })));
    assert!(matches!(BagWriter::create(&path, WriterOptions::default()), Err(BagError::Exists { .. })));
    assert!(made.write(folder.path().join("bag/metadata.yaml/x")).is_err());
    assert!(RigRecording { depth_m: 1.0, ..made.clone() }.write(folder.path().join("deep")).is_err());
    // Where nothing can be made, the message names what was asked for.
    let error = made.write("/proc/nowhere").unwrap_err().to_string();
    assert!(error.starts_with("/proc/nowhere:"), "{error}");
    let names: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(names, ["bag"]);
}

#[test]
fn the_embedded_bag_is_the_shipped_one() {
    let inside = embedded::needle_insertion().unwrap();
    let shipped = BagReader::open(shipped(RigScene::NeedleInsertion)).unwrap();
    assert!(inside.messages().eq(shipped.messages()));
    assert_eq!(inside.metadata(), shipped.metadata());
    let folder = tempfile::tempdir().unwrap();
    embedded::write_needle_insertion(folder.path().join("needle_insertion")).unwrap();
    assert_eq!(check(folder.path().join("needle_insertion")).unwrap().findings, []);
}

/// A bag with the given topics, each with a few stamped messages.
fn bag_with(folder: &Path, write: impl FnOnce(&mut BagWriter)) -> PathBuf {
    let path = folder.join("bag");
    let mut bag = BagWriter::create(&path, WriterOptions::default()).unwrap();
    write(&mut bag);
    bag.finish().unwrap();
    path
}

fn stamp(ns: i64) -> Header {
    Header { stamp: Time::from_nanos(ns), frame_id: "sample".to_owned() }
}

fn joint(ns: i64, name: &str, position: f64) -> JointState {
    JointState { header: stamp(ns), name: vec![name.to_owned()], position: vec![position], ..Default::default() }
}

#[test]
fn topics_are_found_by_name_and_by_type_and_their_absence_is_explained() {
    let folder = tempfile::tempdir().unwrap();
    let path = bag_with(folder.path(), |bag| {
        let other = bag.add_topic::<JointState>("/arm/joint_states", &Qos::reliable(10)).unwrap();
        let mine = bag.add_topic::<JointState>("/rig/measured_js", &Qos::reliable(10)).unwrap();
        let predicted = bag.add_topic::<WrenchStamped>("/predicted_cf", &Qos::reliable(10)).unwrap();
        let force = bag.add_topic::<WrenchStamped>("/ft_sensor", &Qos::reliable(10)).unwrap();
        bag.write(other, 5, 5, &joint(5, "elbow", 1.0)).unwrap();
        bag.write(mine, 6, 6, &joint(6, "insertion", 0.25)).unwrap();
        bag.write(predicted, 7, 7, &WrenchStamped::default()).unwrap();
        bag.write(force, 8, 8, &WrenchStamped { header: stamp(8), ..Default::default() }).unwrap();
    });
    let recording = load(&path);
    assert_eq!(recording.topics.joint_state.as_deref(), Some("/rig/measured_js"));
    assert_eq!(recording.topics.wrench.as_deref(), Some("/ft_sensor"));
    assert_eq!(recording.depths[0].depth_m, 0.25);

    let named = |name: &str| TopicNames { joint_state: Some(name.to_owned()), ..Default::default() };
    let missing = Recording::load(&path, &named("/tip")).unwrap_err().to_string();
    assert!(missing.contains("/tip") && missing.contains("/rig/measured_js (sensor_msgs/msg/JointState)"), "{missing}");
    let wrong = Recording::load(&path, &named("/ft_sensor")).unwrap_err().to_string();
    assert!(wrong.contains("geometry_msgs/msg/WrenchStamped") && wrong.contains("JointState is needed"), "{wrong}");
    let elbow = TopicNames { joint: "wrist".into(), ..named("/arm/joint_states") };
    let other = Recording::load(&path, &elbow).unwrap_err().to_string();
    assert!(other.contains("no joint `wrist` but elbow"), "{other}");
}

#[test]
fn a_bag_without_motion_lists_its_topics() {
    let folder = tempfile::tempdir().unwrap();
    let path = bag_with(folder.path(), |bag| {
        let topic = bag.add_topic::<Float64>("/temperature", &Qos::reliable(10)).unwrap();
        bag.write(topic, 1, 1, &Float64 { data: 20.0 }).unwrap();
    });
    let error = Recording::load(&path, &TopicNames::default()).unwrap_err();
    assert!(matches!(error, BagError::NoTopic { .. }));
    let text = error.to_string();
    assert!(text.contains("measured_js") && text.contains("/temperature (std_msgs/msg/Float64)"), "{text}");
}

#[test]
fn several_joints_need_the_right_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = bag_with(folder.path(), |bag| {
        let topic = bag.add_topic::<JointState>("/measured_js", &Qos::reliable(10)).unwrap();
        let two =
            JointState { name: vec!["yaw".into(), "insertion".into()], position: vec![9.0, 0.5], ..joint(1, "", 0.0) };
        bag.write(topic, 1, 1, &two).unwrap();
    });
    assert_eq!(load(&path).depths[0].depth_m, 0.5);
    let error =
        Recording::load(&path, &TopicNames { joint: "slide".into(), ..Default::default() }).unwrap_err().to_string();
    assert!(error.contains("slide") && error.contains("yaw, insertion"), "{error}");
}

#[test]
fn bad_samples_are_left_out_and_counted() {
    let folder = tempfile::tempdir().unwrap();
    let path = bag_with(folder.path(), |bag| {
        let topic = bag.add_topic::<JointState>("/measured_js", &Qos::reliable(10)).unwrap();
        let depths = [(10, 0.1), (30, 0.3), (20, 0.2), (40, f64::NAN), (50, 0.5), (50, 0.6)];
        for (log, (ns, depth)) in depths.into_iter().enumerate() {
            bag.write(topic, log as u64, log as u64, &joint(ns, "insertion", depth)).unwrap();
        }
        bag.write_raw(topic, 7, 7, &[0, 1, 0, 0, 1]).unwrap();
        bag.write(topic, 8, 8, &joint(5_000_000_000, "insertion", 0.7)).unwrap();
        bag.write(topic, 9, 9, &joint(60, "insertion", 0.8)).unwrap();
    });
    let recording = load(&path);
    let depths: Vec<f64> = recording.depths.iter().map(|s| s.depth_m).collect();
    // the stamp of 5 s leapt ahead of those round it
    assert_eq!(depths, [0.1, 0.2, 0.3, 0.5, 0.6, 0.8]);
    let losses = recording.losses.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n");
    assert!(
        losses.contains("NaN is not finite") && losses.contains("another time") && losses.contains("hold this message"),
        "{losses}"
    );
    let warnings = recording.warnings.join("\n");
    assert!(warnings.contains("sorted") && warnings.contains("1 readings have the stamp of another"), "{warnings}");
}

#[test]
fn poses_point_along_z_of_the_tip_and_unstamped_messages_use_the_time_of_sending() {
    let folder = tempfile::tempdir().unwrap();
    let path = bag_with(folder.path(), |bag| {
        let topic = bag.add_topic::<PoseStamped>("/measured_cp", &Qos::reliable(10)).unwrap();
        // Half a turn about x: z points down.
        let pose =
            Pose { position: [0.0, 0.0, 0.02].into(), orientation: Quaternion { x: 1.0, y: 0.0, z: 0.0, w: 0.0 } };
        for i in 0..3u64 {
            bag.write(topic, 1000 + i, 100 * (i + 1), &PoseStamped { header: stamp(0), pose }).unwrap();
        }
    });
    let recording = load(&path);
    assert_eq!(recording.poses[1].axis, [0.0, 0.0, -1.0]);
    assert_eq!(recording.poses[1].tip, [0.0, 0.0, 0.02]);
    assert_eq!(recording.origin_ns, 100);
    assert!((recording.poses[2].time_s - 200e-9).abs() < 1e-15);
    assert!(recording.warnings.iter().any(|w| w.contains("no stamp")));
}
