//! Deep check of a bag: can every reader read it, does it say the same everywhere, is all of it there.

use super::error::BagError;
use super::metadata::{FileCount, Metadata, TopicCount, VERSION};
use super::qos::Qos;
use super::reader::{BagFile, BagReader, Topic};
use ros2_messages::builtin_interfaces::Time;
use ros2_messages::schema::{missing_types, schema};
use ros2_messages::{
    CdrError, RosMessage, diagnostic_msgs, from_cdr, geometry_msgs, needle_twin, rosgraph_msgs, sensor_msgs, std_msgs,
    visualization_msgs,
};
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Topics of metadata.yaml by name.
type Listed<'a> = BTreeMap<&'a str, &'a TopicCount>;

/// How bad a finding is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// Nothing is wrong; whoever reads the bag should know it.
    Note,
    /// Works, but look at it.
    Warning,
    /// Data is lost; the rest can be used.
    Lost,
    /// A reader will refuse the bag, or believe something false.
    Error,
}

/// One thing that the check found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// How bad it is.
    pub severity: Severity,
    /// What it is, and what it does to a reader.
    pub text: String,
}

/// What a check found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CheckReport {
    /// The bag as it was named.
    pub bag: String,
    /// Messages that were read and, where their type is known, decoded.
    pub messages: u64,
    /// Topics.
    pub topics: usize,
    /// In the order of the check; empty if all is well.
    pub findings: Vec<Finding>,
}

impl CheckReport {
    /// The worst finding.
    #[must_use]
    pub fn worst(&self) -> Option<Severity> {
        self.findings.iter().map(|f| f.severity).max()
    }

    fn add(&mut self, severity: Severity, text: impl Into<String>) {
        self.findings.push(Finding { severity, text: text.into() });
    }

    fn error(&mut self, text: impl Into<String>) {
        self.add(Severity::Error, text);
    }
}

/// Checks a bag (folder or single .mcap), reading all of it.
///
/// # Errors
/// [`BagError`] if it can't be opened at all.
pub fn check(path: impl AsRef<Path>) -> Result<CheckReport, BagError> {
    let path = path.as_ref();
    let bag = BagReader::open(path)?;
    let mut report =
        CheckReport { bag: bag.name().to_owned(), messages: 0, topics: bag.topics().len(), findings: Vec::new() };
    bag.losses().iter().for_each(|loss| report.add(Severity::Lost, loss.to_string()));
    let of_files: BTreeSet<&String> = bag.files().iter().flat_map(|f| &f.index.warnings).collect();
    for warning in bag.warnings() {
        // An index may be missing; a metadata.yaml that is missing or contradicts the file makes others refuse the bag.
        let severity = if of_files.contains(warning) { Severity::Warning } else { Severity::Error };
        report.add(severity, warning.clone());
    }
    let folder = if path.is_dir() { Some(path) } else { path.parent().filter(|_| path.ends_with("metadata.yaml")) };
    let yaml = folder.and_then(|folder| check_yaml(folder, &mut report));
    for file in bag.files() {
        check_file(file, yaml.as_ref(), &mut report);
    }
    check_topics(&bag, yaml.as_ref(), &mut report);
    check_messages(&bag, &mut report);
    Ok(report)
}

/// metadata.yaml: its version, and the keys that this version must have.
fn check_yaml(folder: &Path, report: &mut CheckReport) -> Option<Metadata> {
    #[derive(Deserialize)]
    struct Keys {
        rosbag2_bagfile_information: BTreeMap<String, serde::de::IgnoredAny>,
    }
    let text = std::fs::read_to_string(folder.join("metadata.yaml")).ok()?;
    let metadata = Metadata::parse(&text).ok()?;
    if metadata.version > VERSION {
        report.error(format!("metadata.yaml is version {}; readers of today know up to {VERSION}", metadata.version));
    } else if metadata.version < VERSION {
        let text = format!("metadata.yaml is version {}, from a ROS before Jazzy", metadata.version);
        report.add(Severity::Warning, text);
    }
    let keys = serde_saphyr::from_str::<Keys>(&text).ok()?.rosbag2_bagfile_information;
    let since = [
        ("duration", 1),
        ("starting_time", 1),
        ("message_count", 1),
        ("topics_with_message_count", 1),
        ("relative_file_paths", 1),
        ("compression_format", 3),
        ("compression_mode", 3),
        ("files", 5),
        ("custom_data", 6),
        ("ros_distro", 8),
    ];
    for (key, version) in since {
        if metadata.version >= version && !keys.contains_key(key) {
            report.error(format!("metadata.yaml has no key {key}: `ros2 bag play` refuses the bag"));
        }
    }
    if metadata.version >= 7
        && let Some(t) =
            metadata.topics_with_message_count.iter().find(|t| t.topic_metadata.type_description_hash.is_none())
    {
        report.error(format!("metadata.yaml has no type_description_hash for {}", t.topic_metadata.name));
    }
    Some(metadata)
}

/// Header and own copy of metadata.
fn check_file(file: &BagFile, yaml: Option<&Metadata>, report: &mut CheckReport) {
    let name = &file.name;
    if file.index.header.profile != "ros2" {
        report.error(format!(
            "{name}: its profile is {:?}, not ros2: readers of ROS 2 refuse it",
            file.index.header.profile
        ));
    }
    match file.index.own_metadata() {
        None => report
            .add(Severity::Warning, format!("{name} has no metadata record: `ros2 bag info` of the file alone fails")),
        Some(text) => match (Metadata::parse_inner(text), yaml) {
            (Err(e), _) => {
                report.error(format!("{name}: its metadata record can't be read, `ros2 bag play` refuses it: {e}"))
            }
            (Ok(own), Some(yaml)) if !same(&own, yaml) && yaml.relative_file_paths.len() == 1 => {
                report.error(format!("{name}: its metadata record and metadata.yaml differ"));
            }
            _ => {}
        },
    }
}

/// Whether two descriptions are of one recording. Names of files change when they are renamed, and `ros2 bag reindex` leaves out what only
/// the recorder knew.
fn same(own: &Metadata, yaml: &Metadata) -> bool {
    let bare = |of: &Metadata| Metadata {
        relative_file_paths: Vec::new(),
        files: of.files.iter().map(|f| FileCount { path: String::new(), ..f.clone() }).collect(),
        ..of.clone()
    };
    let (own, yaml) = (bare(own), bare(yaml));
    let known = Metadata {
        storage_identifier: if yaml.storage_identifier.is_empty() {
            String::new()
        } else {
            own.storage_identifier.clone()
        },
        custom_data: yaml.custom_data.as_ref().and(own.custom_data.clone()),
        ros_distro: yaml.ros_distro.as_ref().and(own.ros_distro.clone()),
        ..own
    };
    known == yaml
}

/// Encodings, schemas, hashes and quality of service of each topic.
fn check_topics(bag: &BagReader, yaml: Option<&Metadata>, report: &mut CheckReport) {
    let listed: Option<Listed<'_>> = yaml.map(|yaml| {
        // of several of one name the first counts
        yaml.topics_with_message_count.iter().rev().map(|t| (t.topic_metadata.name.as_str(), t)).collect()
    });
    // topics of one type share its definition
    let mut missing = BTreeMap::new();
    for topic in bag.topics() {
        let name = &topic.name;
        if topic.encoding != "cdr" {
            report.error(format!("{name}: its messages are encoded as {:?}, not cdr", topic.encoding));
        }
        match topic.schema_encoding.as_str() {
            "ros2msg" => {
                let missing = missing.entry(topic.schema.as_ptr()).or_insert_with(|| missing_types(&topic.schema));
                if !missing.is_empty() {
                    report.error(format!(
                        "{name}: its schema does not define {}: readers can't decode it",
                        missing.join(", ")
                    ));
                }
            }
            "ros2idl" => {}
            other => report.error(format!("{name}: its schema is encoded as {other:?}, not ros2msg")),
        }
        if let Some(known) =
            schema(&topic.type_name).filter(|k| !k.hash.is_empty() && !topic.hash.is_empty() && k.hash != topic.hash)
        {
            report.error(format!(
                "{name}: its type hash is {}, that of {} is {}",
                topic.hash, known.type_name, known.hash
            ));
        }
        if !topic.qos.iter().all(Qos::is_named) {
            report.add(
                Severity::Warning,
                format!("{name}: its quality of service is written in numbers, as before Jazzy"),
            );
        }
        if let Some(listed) = &listed {
            compare_topic(topic, listed, report);
        }
    }
}

/// One topic in the file and in metadata.yaml.
fn compare_topic(topic: &Topic, listed: &Listed<'_>, report: &mut CheckReport) {
    let name = &topic.name;
    let Some(entry) = listed.get(name.as_str()) else {
        report.error(format!("{name} is not listed in metadata.yaml: readers will not see it"));
        return;
    };
    if entry.message_count != topic.messages {
        let (said, found) = (entry.message_count, topic.messages);
        report.error(format!("{name}: metadata.yaml says {said} messages, the index of the file {found}"));
    }
    let hash = entry.topic_metadata.type_description_hash.as_deref().unwrap_or("");
    // Older writers leave it out in one of the two places.
    if !hash.is_empty() && !topic.hash.is_empty() && hash != topic.hash {
        report.error(format!("{name}: its type hash is {hash:?} in metadata.yaml and {:?} in the file", topic.hash));
    }
    let profiles = entry.topic_metadata.offered_qos_profiles.as_ref().map_or(Ok(Vec::new()), |q| q.profiles());
    match profiles {
        Err(e) => report.error(format!("{name}: its quality of service in metadata.yaml can't be read: {e}")),
        Ok(profiles) if profiles != topic.qos => report.error(format!(
            "{name}: its quality of service differs between metadata.yaml and the file: some readers then yield no message at all"
        )),
        Ok(_) => {}
    }
}

/// Reads every message; decodes those of known types.
fn check_messages(bag: &BagReader, report: &mut CheckReport) {
    let mut counts = vec![0; bag.topics().len()];
    let mut problems: Vec<(u64, String)> = vec![(0, String::new()); bag.topics().len()];
    let mut courses = vec![Course::default(); bag.topics().len()];
    let mut messages = bag.messages();
    for message in &mut messages {
        report.messages += 1;
        counts[message.topic] += 1;
        match stamp(&bag.topics()[message.topic].type_name, &message.data) {
            Some(Err(e)) => problems[message.topic] = (problems[message.topic].0 + 1, e.to_string()),
            Some(Ok(Some(stamp))) => courses[message.topic].follow(stamp.nanos()),
            Some(Ok(None)) | None => {}
        }
    }
    messages.losses().iter().for_each(|loss| report.add(Severity::Lost, loss.to_string()));
    let lost = report.worst() >= Some(Severity::Lost);
    for (number, topic) in bag.topics().iter().enumerate() {
        let (name, type_name) = (&topic.name, &topic.type_name);
        if counts[number] != topic.messages && !lost {
            let (said, found) = (topic.messages, counts[number]);
            report.error(format!("{name}: the index of the file says {said} messages, it holds {found}"));
        }
        let (bad, reason) = &problems[number];
        if *bad > 0 {
            report.error(format!("{name}: {bad} messages are no {type_name}: {reason}"));
        }
        let back = courses[number].disordered();
        if back > 0 {
            report.add(Severity::Warning, format!("{name}: {back} messages are stamped earlier than one before them"));
        }
    }
    let of_a_loop = bag.topics().iter().zip(&courses).filter(|(_, course)| course.starts > 0);
    let names: Vec<&str> = of_a_loop.clone().map(|(topic, _)| topic.name.as_str()).collect();
    if let Some(starts) = of_a_loop.map(|(_, course)| course.starts).max() {
        let times = if starts == 1 { "once" } else { &format!("{starts} times") };
        report.add(
            Severity::Note,
            format!("time starts again {times}, as where a player loops or a simulator is reset: {}", names.join(", ")),
        );
    }
}

/// How the stamps of a topic run.
#[derive(Clone, Debug, Default)]
struct Course {
    latest_ns: i64,
    /// Messages in a row that are earlier than the latest, each later than the one before it; the stamp of the last.
    early: (u64, i64),
    disordered: u64,
    /// How often time started again.
    starts: u64,
}

impl Course {
    /// Messages in a row from which on an earlier time is a new start, and how much earlier it is then, ns. Messages that have overtaken
    /// others are fewer or nearer.
    const NEW_START: (u64, i64) = (3, 100_000_000);

    fn follow(&mut self, stamp_ns: i64) {
        if stamp_ns >= self.latest_ns || stamp_ns < self.early.1 {
            self.disordered += std::mem::take(&mut self.early).0;
        }
        if stamp_ns >= self.latest_ns {
            self.latest_ns = stamp_ns;
            return;
        }
        self.early = (self.early.0 + 1, stamp_ns);
        let (messages, nanos) = Self::NEW_START;
        if self.early.0 >= messages && self.latest_ns - stamp_ns > nanos {
            self.starts += 1;
            (self.latest_ns, self.early) = (stamp_ns, (0, 0));
        }
    }

    /// Messages that are stamped earlier than one before them, and are no new start.
    fn disordered(&self) -> u64 {
        self.disordered + self.early.0
    }
}

/// Decodes a message of a known type; its header's stamp, if it has one. `None` for an unknown type.
fn stamp(type_name: &str, data: &[u8]) -> Option<Result<Option<Time>, CdrError>> {
    macro_rules! decode {
        ($($with_header:ty),*; $($without:ty),*) => {
            match type_name {
                $(<$with_header>::TYPE => from_cdr::<$with_header>(data).map(|m| Some(m.header.stamp)),)*
                $(<$without>::TYPE => from_cdr::<$without>(data).map(|_| None),)*
                _ => return None,
            }
        };
    }
    Some(decode!(
        geometry_msgs::PoseStamped, geometry_msgs::PoseArray, geometry_msgs::WrenchStamped, sensor_msgs::JointState,
        sensor_msgs::PointCloud2, visualization_msgs::Marker, diagnostic_msgs::DiagnosticArray, needle_twin::TissueModel,
        needle_twin::TissueState, needle_twin::TissueEvent, needle_twin::ForceBand, needle_twin::Outlook, needle_twin::ForceComparison, needle_twin::TwinStatus,
        needle_twin::Safety,
        geometry_msgs::PoseWithCovarianceStamped;
        std_msgs::Float64, std_msgs::Bool, rosgraph_msgs::Clock
    ))
}
