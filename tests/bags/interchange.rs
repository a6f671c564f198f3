//! rosbags and mcap-ros2-support read our bags field by field.
#![allow(clippy::unwrap_used, clippy::panic)]

use needle_recording::{Recording, Selection, TopicNames};
use needle_rig::make::RigScene;
use ros2_messages::{
    RosMessage, diagnostic_msgs, from_cdr, geometry_msgs, needle_twin as own, rosgraph_msgs,
    schema::{recorded_types, schema},
    sensor_msgs, std_msgs, tf2_msgs, to_cdr, visualization_msgs,
};
use rosbag2_mcap::{BagReader, BagWriter, Qos, Severity, TopicId, WriterOptions, check};
use serde_json::{Value, json};
use std::fmt::Debug;
use std::path::Path;
use testkit::{python::run_script, random::Random};

/// A bag that is being written, and what a reader must find in it.
struct Both {
    bag: BagWriter,
    expected: Vec<Value>,
    encoded: Vec<Vec<u8>>,
    types: Vec<String>,
}

impl Both {
    /// Adds a topic with random messages of type `T`, and checks that they come back from their own bytes.
    fn topic<T: RosMessage + PartialEq + Debug>(&mut self, random: &mut Random, count: usize) {
        let topics = self.types.len();
        let name = format!("/group/topic_{topics}");
        let kinds = [
            (Qos::reliable(10), "reliable", "volatile"),
            (Qos::best_effort(1), "best_effort", "volatile"),
            (Qos::transient_local(1), "reliable", "transient_local"),
        ];
        let (qos, reliability, durability) = &kinds[topics % 3];
        let topic: TopicId = self.bag.add_topic::<T>(&name, qos).unwrap();
        for _ in 0..count {
            let message: T = random.make();
            let log_ns = 1_700_000_000_000_000_000 + 1000 * self.expected.len() as u64;
            self.bag.write(topic, log_ns, log_ns - 7, &message).unwrap();
            let bytes = to_cdr(&message).unwrap();
            assert_eq!(from_cdr::<T>(&bytes).unwrap(), message);
            self.encoded.push(bytes);
            self.expected.push(json!({
                "topic": name, "type": T::TYPE, "log_ns": log_ns, "publish_ns": log_ns - 7,
                "hash": schema(T::TYPE).unwrap().hash, "reliability": reliability, "durability": durability,
                "message": serde_json::to_value(&message).unwrap(),
            }));
        }
        self.types.push(T::TYPE.to_owned());
    }
}

/// Bytes in, the same message's bytes out.
type Recode = fn(&[u8]) -> Vec<u8>;

/// Decodes what the other side wrote in big-endian order and encodes it again.
fn back<T: RosMessage>(bytes: &[u8]) -> Vec<u8> {
    to_cdr(&from_cdr::<T>(bytes).unwrap()).unwrap()
}

#[test]
fn every_message_type_is_read_by_others() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("every type");
    let bag = BagWriter::create(&path, WriterOptions { chunk_bytes: 20_000, ..Default::default() }).unwrap();
    let mut both = Both { bag, expected: Vec::new(), encoded: Vec::new(), types: Vec::new() };
    let mut random = Random::new(1);
    let mut decoders: Vec<(Recode, usize)> = Vec::new();
    macro_rules! topics {
        ($($message:ty),* $(,)?) => {$(
            both.topic::<$message>(&mut random, 40);
            decoders.push((back::<$message>, 40));
        )*};
    }
    topics!(
        sensor_msgs::JointState,
        geometry_msgs::WrenchStamped,
        geometry_msgs::PoseStamped,
        std_msgs::Float64,
        std_msgs::Bool,
        std_msgs::String,
        rosgraph_msgs::Clock,
        sensor_msgs::PointCloud2,
        visualization_msgs::Marker,
        geometry_msgs::PoseArray,
        geometry_msgs::PoseWithCovarianceStamped,
        geometry_msgs::TransformStamped,
        geometry_msgs::PointStamped,
        geometry_msgs::Wrench,
        diagnostic_msgs::DiagnosticArray,
        tf2_msgs::TFMessage,
        own::TissueModel,
        own::TissueState,
        own::TissueEvent,
        own::ForceBand,
        own::Outlook,
        own::ForceComparison,
        own::TwinStatus,
        own::Safety,
    );
    let mut recorded: Vec<String> = recorded_types().collect();
    recorded.sort();
    both.types.sort();
    assert_eq!(both.types, recorded, "every type that is recorded is tried here");
    let Both { bag, expected, encoded, .. } = both;
    let written = bag.finish().unwrap();
    assert_eq!((written.messages, written.lost, written.complete), (expected.len() as u64, 0, true));

    let json = folder.path().join("expected.json");
    std::fs::write(&json, serde_json::to_vec(&expected).unwrap()).unwrap();
    let messages = Path::new(env!("CARGO_MANIFEST_DIR")).join("msg");
    let big_endian = run_script("bags/read_back.py", &[&path, &json, &messages]);
    let big_endian: Vec<String> = serde_json::from_str(&big_endian).unwrap();
    let decoders = decoders.iter().flat_map(|(decode, count)| std::iter::repeat_n(decode, *count));
    for ((hex, decode), bytes) in big_endian.iter().zip(decoders).zip(&encoded) {
        let other: Vec<u8> =
            (0..hex.len() / 2).map(|i| u8::from_str_radix(&hex[2 * i..2 * i + 2], 16).unwrap()).collect();
        assert_eq!(other[..2], [0, 0]);
        assert_eq!(&decode(&other), bytes);
    }

    // And by ourselves.
    let reader = BagReader::open(&path).unwrap();
    let read: Vec<Vec<u8>> = reader.messages().map(|m| m.data).collect();
    assert_eq!(read, encoded);
    // The stamps are random too, which deserves a warning.
    let report = check(&path).unwrap();
    assert!(report.worst() <= Some(Severity::Warning) && report.messages == written.messages, "{report:?}");
}

/// Every message of a bag of depths and forces as independent readers find it.
fn read_by_others(path: &Path) {
    let bag = BagReader::open(path).unwrap();
    let expected: Vec<Value> = bag
        .messages()
        .map(|m| {
            let topic = &bag.topics()[m.topic];
            let message = match topic.name.as_str() {
                "/measured_js" => serde_json::to_value(bag.decode::<sensor_msgs::JointState>(&m).unwrap()),
                _ => serde_json::to_value(bag.decode::<geometry_msgs::WrenchStamped>(&m).unwrap()),
            };
            json!({
                "topic": topic.name, "type": topic.type_name, "log_ns": m.log_ns, "publish_ns": m.publish_ns,
                "hash": topic.hash, "reliability": "reliable", "durability": "volatile", "message": message.unwrap(),
            })
        })
        .collect();
    assert_eq!(expected.len() as u64, bag.message_count());
    let json = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(json.path(), serde_json::to_vec(&expected).unwrap()).unwrap();
    let messages = Path::new(env!("CARGO_MANIFEST_DIR")).join("msg");
    run_script("bags/read_back.py", &[path, json.path(), &messages]);
}

#[test]
fn the_shipped_bags_are_read_by_others() {
    for scene in RigScene::ALL {
        read_by_others(&Path::new(env!("CARGO_MANIFEST_DIR")).join("bags").join(scene.name()));
    }
}

#[test]
fn an_imported_table_is_read_by_others() {
    let folder = tempfile::tempdir().unwrap();
    let table = folder.path().join("rig.csv");
    let row = |i: u32| format!("{},{},{}\n", 0.1 * f64::from(i), 0.017 * f64::from(i), 0.3 * f64::from(i));
    std::fs::write(&table, format!("Time (s),Compression (mm),Load (N)\n{}", (0..200).map(row).collect::<String>()))
        .unwrap();
    let path = folder.path().join("imported");
    let written = Recording::open(&[table], &Selection::default()).unwrap().write(&path, Some("compression")).unwrap();
    assert_eq!((written.messages, written.lost, written.complete), (400, 0, true));
    read_by_others(&path);
    assert!(check(&path).unwrap().worst() <= Some(Severity::Warning), "{:?}", check(&path));
}

#[test]
fn bags_of_other_writers_are_read() {
    let folder = tempfile::tempdir().unwrap();
    run_script("bags/others.py", &[folder.path()]);
    let mut read = 0;
    for entry in std::fs::read_dir(folder.path()).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let recording = Recording::load(&path, &TopicNames::default()).unwrap();
        assert!(recording.losses.is_empty(), "{name}: {:?}", recording.losses);
        assert_eq!((recording.depths.len(), recording.forces.len()), (300, 300), "{name}");
        for (i, (depth, force)) in recording.depths.iter().zip(&recording.forces).enumerate() {
            let (time_s, i) = (0.01 * i as f64, i as f64);
            assert!((depth.time_s - time_s).abs() < 1e-12 && (force.time_s - time_s).abs() < 1e-12, "{name}");
            assert_eq!((depth.depth_m, force.force_n[2]), (i * 1e-4, i * 1e-3), "{name}");
        }
        assert_eq!(BagReader::open(&path).unwrap().message_count(), 600, "{name}");
        let report = check(&path).unwrap();
        assert!(report.worst() <= Some(Severity::Warning), "{name}: {report:?}");
        read += 1;
    }
    assert_eq!(read, 11);
}
