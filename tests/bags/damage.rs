//! Damaged bags: what can be read is read, nothing false comes out, nothing panics, hangs or takes much memory.
#![allow(clippy::unwrap_used, clippy::panic)]

use needle_recording::{Recording, TopicNames};
use ros2_messages::builtin_interfaces::Time;
use ros2_messages::sensor_msgs::JointState;
use ros2_messages::std_msgs::{Float64, Header};
use rosbag2_mcap::{BagError, BagReader, BagWriter, CheckReport, Loss, Qos, Severity, WriterOptions, check};
use std::collections::HashSet;
use std::path::{Path, PathBuf};
use testkit::random::Random;

/// A small bag with several chunks and two topics.
fn small_bag(folder: &Path) -> PathBuf {
    let path = folder.join("small");
    let options = WriterOptions { chunk_bytes: 900, flush_after: None, ..Default::default() };
    let mut bag = BagWriter::create(&path, options).unwrap();
    let depth = bag.add_topic::<JointState>("/measured_js", &Qos::reliable(10)).unwrap();
    let number = bag.add_topic::<Float64>("/number", &Qos::reliable(10)).unwrap();
    for i in 0..24u64 {
        let mut message =
            JointState { name: vec!["insertion".into()], position: vec![i as f64 * 1e-4], ..Default::default() };
        message.header.stamp.nanosec = i as u32 + 1;
        bag.write(depth, i, i, &message).unwrap();
        bag.write(number, i, i, &Float64 { data: i as f64 }).unwrap();
    }
    bag.finish().unwrap();
    path
}

/// Topic, type, times and bytes of a message: what must not change.
type Told = (String, String, u64, u64, Vec<u8>);

/// All messages and whether anything was said to be lost.
fn tell(bag: &BagReader) -> (Vec<Told>, bool) {
    let mut messages = bag.messages();
    let told = messages
        .by_ref()
        .map(|m| {
            let topic = &bag.topics()[m.topic];
            (topic.name.clone(), topic.type_name.clone(), m.log_ns, m.publish_ns, m.data)
        })
        .collect();
    (told, !messages.losses().is_empty() || !bag.losses().is_empty())
}

fn small_bytes() -> (Vec<u8>, Vec<Told>) {
    let folder = tempfile::tempdir().unwrap();
    let bytes = std::fs::read(small_bag(folder.path()).join("small_0.mcap")).unwrap();
    let (told, lost) = tell(&BagReader::from_vec("small", bytes.clone()).unwrap());
    assert!(told.len() == 48 && !lost);
    (bytes, told)
}

#[test]
fn a_bag_cut_anywhere_gives_its_start_and_says_so() {
    let (bytes, told) = small_bytes();
    let mut read_some = 0;
    for length in 0..bytes.len() {
        match BagReader::from_vec("cut", bytes[..length].to_vec()) {
            Err(BagError::NotABag { .. }) => assert!(length < 8, "{length}"),
            Err(e) => panic!("{length}: {e}"),
            Ok(bag) => {
                let (some, lost) = tell(&bag);
                assert!(told.starts_with(&some), "cut at {length}");
                assert!(lost, "cut at {length}: nothing was said to be lost");
                assert_eq!(bag.message_count(), some.len() as u64);
                read_some += usize::from(!some.is_empty() && some.len() < told.len());
            }
        }
    }
    assert!(read_some > bytes.len() / 5, "{read_some}");
}

#[test]
fn a_cut_bag_drives_the_twin_as_far_as_it_goes() {
    let folder = tempfile::tempdir().unwrap();
    let path = small_bag(folder.path());
    let file = path.join("small_0.mcap");
    let bytes = std::fs::read(&file).unwrap();
    // Two thirds of the messages are left.
    let depths = |length: usize| {
        let bag = BagReader::from_vec("cut", bytes[..length].to_vec()).unwrap();
        bag.select(|t| t.name == "/measured_js").count()
    };
    let length = (8..bytes.len()).find(|length| depths(*length) >= 16).unwrap();
    std::fs::write(&file, &bytes[..length]).unwrap();
    let recording = Recording::load(&path, &TopicNames::default()).unwrap();
    assert!((16..24).contains(&recording.depths.len()));
    assert!(recording.losses.iter().any(|l| matches!(l, Loss::CutOff { .. })), "{:?}", recording.losses);
    std::fs::write(&file, &bytes[..100]).unwrap();
    let error = Recording::load(&path, &TopicNames::default()).unwrap_err().to_string();
    assert!(error.contains("cut off") && error.contains("no topics"), "{error}");
}

#[test]
fn a_flipped_bit_anywhere_makes_nothing_false() {
    let (bytes, told) = small_bytes();
    let truth: HashSet<Told> = told.iter().cloned().collect();
    let mut recovered = 0;
    for at in 8..bytes.len() {
        let mut bad = bytes.clone();
        bad[at] ^= 1 << (at % 8);
        let Ok(bag) = BagReader::from_vec("flipped", bad) else { continue };
        let (some, lost) = tell(&bag);
        assert!(some.iter().all(|m| truth.contains(m)), "a bit at {at} made a false message");
        assert!(lost || some.len() == told.len(), "a bit at {at} lost messages without a word");
        recovered += some.len();
    }
    // One chunk of many is lost with a bit in it, the others are not.
    assert!(recovered > bytes.len() * told.len() * 7 / 10, "{recovered} of {}", bytes.len() * told.len());
}

/// A bag as rosbag2 writes it: a metadata record at the start that says nothing yet, and the true one at the end.
fn with_a_placeholder(folder: &Path, yaml: &str) {
    let file = folder.join("bag_0.mcap");
    let bytes = std::fs::read(&file).unwrap();
    let record = |yaml: &str| mcap::records::Metadata {
        name: "rosbag2".to_owned(),
        metadata: [("serialized_metadata".to_owned(), yaml.to_owned())].into(),
    };
    let inner = |yaml: &str| yaml.lines().skip(1).map(|l| format!("{}\n", &l[2..])).collect::<String>();
    let options = mcap::WriteOptions::new().profile("ros2").chunk_size(None);
    let mut out = options.create(std::io::Cursor::new(Vec::new())).unwrap();
    out.write_metadata(&record(&inner(yaml).replace("message_count: 2", "message_count: 0"))).unwrap();
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        out.write(&message.unwrap()).unwrap();
    }
    out.write_metadata(&record(&inner(yaml))).unwrap();
    out.finish().unwrap();
    std::fs::write(&file, out.into_inner().into_inner()).unwrap();
}

#[test]
fn the_last_metadata_record_of_a_file_counts() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bag");
    let mut bag = BagWriter::create(&path, WriterOptions::default()).unwrap();
    let topic = bag.add_topic::<Float64>("/number", &Qos::reliable(10)).unwrap();
    (1..3).for_each(|i| bag.write(topic, i, i, &Float64 { data: i as f64 }).unwrap());
    bag.finish().unwrap();
    with_a_placeholder(&path, &std::fs::read_to_string(path.join("metadata.yaml")).unwrap());
    let report = check(&path).unwrap();
    assert_eq!((report.messages, report.findings), (2, vec![]));
    let alone = BagReader::open(path.join("bag_0.mcap")).unwrap();
    assert_eq!(alone.metadata().unwrap().message_count, 2);
}

#[test]
fn random_bytes_are_an_error_or_nothing() {
    let mut random = Random::new(7);
    for round in 0..3000 {
        let length = random.below(2000) as usize;
        let mut bytes = random.bytes(length);
        if round % 2 == 0 {
            bytes.splice(0..0, *b"\x89MCAP0\r\n");
        }
        match BagReader::from_vec("noise", bytes) {
            Err(e) => assert!(round % 2 == 1 && e.to_string().contains("not a bag") || length == 0, "{e}"),
            Ok(bag) => assert!(tell(&bag).0.is_empty() && !bag.losses().is_empty()),
        }
    }
}

/// Reads everything that a bag of these bytes gives.
fn read_all(bytes: Vec<u8>) -> Option<BagReader> {
    let also_as_recording = bytes.iter().filter(|b| **b == 1).count() % 4 == 0; // a quarter, at random
    let bag = BagReader::from_vec("mutated", bytes).ok()?;
    tell(&bag);
    if also_as_recording {
        let _ = Recording::from_reader(&bag, &TopicNames::default());
    }
    Some(bag)
}

#[test]
#[ignore = "a child process of lengths_in_a_file_are_not_believed"]
fn child_with_little_memory() {
    let (bytes, _) = small_bytes();
    let mut random = Random::new(8);
    for _ in 0..4000 {
        let mut bad = bytes.clone();
        for _ in 0..=random.below(8) {
            mutate(&mut bad, &mut random);
        }
        read_all(bad);
    }
    // Huge numbers at every place of the file.
    for at in 8..bytes.len() - 8 {
        for huge in [u64::MAX >> (at % 2), 0x7fff_ffff << (at % 12)] {
            let mut bad = bytes.clone();
            bad[at..at + 8].copy_from_slice(&huge.to_le_bytes());
            read_all(bad);
        }
    }
    // 1 GiB of zeros in one chunk of 32 kB, declared honestly and dishonestly.
    let packed = zstd::encode_all(std::io::Read::take(std::io::repeat(0), 1 << 30), 3).unwrap();
    for declared in [1 << 30, 1 << 20, u64::MAX] {
        let bag = read_all(file_with_chunk(declared, &packed)).unwrap();
        assert!(matches!(bag.losses()[0], Loss::Chunk { .. }), "{:?}", bag.losses());
    }
}

/// Changes something at random: a byte, the length, a number, a piece.
fn mutate(bytes: &mut Vec<u8>, random: &mut Random) {
    let length = bytes.len() as u64;
    let at = random.below(length) as usize;
    match random.below(4) {
        0 => bytes[at] = random.below(256) as u8,
        1 => bytes.truncate(at.max(8)),
        2 => {
            let number = (u64::MAX >> random.below(64)).to_le_bytes();
            let end = (at + 8).min(bytes.len());
            bytes[at..end].copy_from_slice(&number[..end - at]);
        }
        _ => {
            let from = random.below(length) as usize;
            let count = (random.below(64) as usize).min(bytes.len() - from.max(at));
            bytes.copy_within(from..from + count, at);
        }
    }
}

/// An MCAP file with one zstd chunk and no end.
fn file_with_chunk(declared: u64, packed: &[u8]) -> Vec<u8> {
    let mut body = Vec::new();
    body.extend([0u64, 0, declared].iter().flat_map(|n| n.to_le_bytes()));
    body.extend([0u32, 4].iter().flat_map(|n| n.to_le_bytes()));
    body.extend(b"zstd");
    body.extend((packed.len() as u64).to_le_bytes());
    body.extend(packed);
    let record = |kind: u8, body: &[u8]| [&[kind][..], &(body.len() as u64).to_le_bytes(), body].concat();
    [&b"\x89MCAP0\r\n"[..], &record(1, &[0; 8]), &record(6, &body)].concat()
}

#[test]
fn lengths_in_a_file_are_not_believed() {
    let me = std::env::current_exe().unwrap();
    // The bound for a file of 40 kB is three times 18.5 MB; the rest is the program itself.
    let script =
        format!("ulimit -v 250000 && exec '{}' --exact damage::child_with_little_memory --ignored", me.display());
    let output = std::process::Command::new("sh").args(["-c", &script]).output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    assert!(output.status.success(), "{}{}", text(&output.stdout), text(&output.stderr));
}

#[test]
fn other_files_are_named_for_what_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let cases: [(&str, &[u8], &str); 6] = [
        ("empty.mcap", b"", "an empty file"),
        ("text.mcap", b"hello, this is a text", "not a bag"),
        ("a.db3", b"SQLite format 3\0............", "rosbags-convert"),
        ("b.bag", b"#ROSBAG V2.0\n", "ROS 1"),
        ("c.mcap.zstd", b"\x28\xb5\x2f\xfd........", "zstd -d"),
        ("d.mcap", b"\x89MCAP", "cut off"),
    ];
    for (name, bytes, said) in cases {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        let error = BagReader::open(&path).unwrap_err().to_string();
        assert!(error.contains(said) && error.contains(name), "{error}");
    }
    std::fs::create_dir(folder.path().join("bags")).unwrap();
    small_bag(&folder.path().join("bags"));
    let above = BagReader::open(folder.path().join("bags")).unwrap_err().to_string();
    assert!(above.contains("name one of them: small"), "{above}");
    let missing = BagReader::open(folder.path().join("nothing")).unwrap_err();
    assert!(matches!(missing, BagError::Open { .. }) && missing.to_string().contains("nothing"));
}

#[test]
fn folders_with_missing_or_false_metadata_are_read_with_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    let path = small_bag(folder.path());
    let yaml = path.join("metadata.yaml");
    let good = std::fs::read_to_string(&yaml).unwrap();
    assert_eq!(check(&path).unwrap().findings, []);
    let opened = |text: Option<&str>| {
        match text {
            Some(text) => std::fs::write(&yaml, text).unwrap(),
            None => std::fs::remove_file(&yaml).unwrap(),
        }
        let bag = BagReader::open(&path).unwrap();
        assert_eq!(bag.messages().count(), 48);
        (bag.warnings().join("\n"), bag.losses().len())
    };
    for (text, warning) in [
        (None, "no metadata.yaml"),
        (Some("}{"), "can't be used"),
        (Some(&*good.replace("message_count: 48", "message_count: 99")), "says 99 messages"),
        (
            Some(&*good.replace("sensor_msgs/msg/JointState", "std_msgs/msg/Bool")),
            "files say sensor_msgs/msg/JointState",
        ),
        (Some(&*good.replace("name: /number", "name: /other")), "lists topic /other"),
    ] {
        let (warnings, losses) = opened(text);
        assert!(warnings.contains(warning) && losses == 0, "{warnings}");
    }
    let (_, losses) = opened(Some(&good.replace("    - small_0.mcap", "    - small_0.mcap\n    - small_1.mcap")));
    assert_eq!(losses, 1, "a file that is listed and not there");
    std::fs::write(&yaml, good.replace("storage_identifier: mcap", "storage_identifier: sqlite3")).unwrap();
    assert!(BagReader::open(&path).unwrap_err().to_string().contains("rosbags-convert"));
    std::fs::write(&yaml, &good).unwrap();
    assert!(BagReader::open(&yaml).unwrap().warnings().is_empty(), "metadata.yaml itself may be named");
}

#[test]
fn the_check_finds_what_makes_other_readers_fail() {
    let folder = tempfile::tempdir().unwrap();
    let path = small_bag(folder.path());
    let yaml = path.join("metadata.yaml");
    let good = std::fs::read_to_string(&yaml).unwrap();
    let findings = |text: String| {
        assert_ne!(text, good);
        std::fs::write(&yaml, text).unwrap();
        check(&path).unwrap().findings.iter().map(|f| f.text.clone()).collect::<Vec<_>>().join("\n")
    };
    for (from, to, said) in [
        ("depth: 10", "depth: 5", "quality of service differs"),
        ("  custom_data: ~\n", "", "no key custom_data"),
        ("  ros_distro: jazzy\n", "", "no key ros_distro"),
        ("RIHS01_705b", "RIHS01_0000", "type hash is \"RIHS01_0000"),
        ("version: 9", "version: 10", "version is 10"),
        ("message_count: 24", "message_count: 25", "says 25 messages"),
    ] {
        let found = findings(good.replace(from, to));
        assert!(found.contains(said) || said == "version is 10" && found.contains("version 10"), "{from}: {found}");
    }
}

/// A bag of stamps in ms, 10 ms of recording apart.
fn stamped(folder: &Path, name: &str, stamps_ms: impl Iterator<Item = i64>) -> CheckReport {
    let path = folder.join(name);
    let mut bag = BagWriter::create(&path, WriterOptions::default()).unwrap();
    let topic = bag.add_topic::<JointState>("/measured_js", &Qos::reliable(10)).unwrap();
    for (i, stamp_ms) in (0..).zip(stamps_ms) {
        let header = Header { stamp: Time::from_nanos(stamp_ms * 1_000_000), ..Header::default() };
        let joint = JointState { header, name: vec!["insertion".into()], position: vec![0.0], ..JointState::default() };
        bag.write(topic, i * 10_000_000, i * 10_000_000, &joint).unwrap();
    }
    bag.finish().unwrap();
    check(&path).unwrap()
}

#[test]
fn a_loop_is_told_from_stamps_in_disorder() {
    let folder = tempfile::tempdir().unwrap();
    let looped = stamped(folder.path(), "looped", (0..3).flat_map(|_| (1000..2000).step_by(10)));
    let text = "time starts again 2 times, as where a player loops or a simulator is reset: /measured_js";
    assert_eq!((looped.worst(), &*looped.findings[0].text), (Some(Severity::Note), text));
    assert_eq!(looped.findings.len(), 1);
    // two messages that two others have overtaken, and one from long ago
    let disorder = [1000, 1010, 1040, 1020, 1030, 1050, 500, 1060];
    let disorder = stamped(folder.path(), "disorder", disorder.into_iter());
    let text = "/measured_js: 3 messages are stamped earlier than one before them";
    assert_eq!((disorder.worst(), &*disorder.findings[0].text), (Some(Severity::Warning), text));
}

#[test]
fn several_files_are_one_bag_in_the_order_of_time() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("split");
    std::fs::create_dir(&path).unwrap();
    for part in 0..12u64 {
        let one = folder.path().join(format!("part{part}"));
        let mut bag = BagWriter::create(&one, WriterOptions::default()).unwrap();
        let topic = bag.add_topic::<Float64>("/number", &Qos::reliable(10)).unwrap();
        for i in 0..10 {
            // Neighbouring files overlap in time.
            bag.write(topic, 10 * part + 2 * i, 0, &Float64 { data: (10 * part + 2 * i) as f64 }).unwrap();
        }
        bag.finish().unwrap();
        std::fs::rename(one.join(format!("part{part}_0.mcap")), path.join(format!("split_{part}.mcap"))).unwrap();
    }
    let bag = BagReader::open(&path).unwrap();
    assert_eq!(bag.topics().len(), 1);
    assert_eq!(bag.topics()[0].messages, 120);
    let numbers: Vec<f64> = bag.messages().map(|m| bag.decode::<Float64>(&m).unwrap().data).collect();
    assert!(numbers.len() == 120 && numbers.is_sorted());
}
