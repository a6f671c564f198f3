//! `metadata.yaml` of a rosbag2 folder, version 9, and the same text within the MCAP file.

use super::qos::Qos;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// Version that is written; 4 and later are read.
pub(crate) const VERSION: i64 = 9;

/// What metadata.yaml says of a bag.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Metadata {
    /// Version of the format.
    pub version: i64,
    /// `mcap` or `sqlite3`.
    pub storage_identifier: String,
    /// Last minus first log time.
    #[serde(default)]
    pub duration: Nanoseconds,
    /// First log time.
    #[serde(default)]
    pub starting_time: StartingTime,
    /// Messages in all.
    #[serde(default)]
    pub message_count: u64,
    /// Topics, with their numbers of messages.
    #[serde(default)]
    pub topics_with_message_count: Vec<TopicCount>,
    /// Compression of whole files or messages by rosbag2 itself ("" for none; MCAP compresses its chunks anyway).
    #[serde(default)]
    pub compression_format: String,
    /// "", `NONE`, `FILE` or `MESSAGE`.
    #[serde(default)]
    pub compression_mode: String,
    /// The files, in order.
    #[serde(default)]
    pub relative_file_paths: Vec<String>,
    /// The files with their numbers of messages.
    #[serde(default)]
    pub files: Vec<FileCount>,
    /// Whatever the recorder wants to say.
    #[serde(default)]
    pub custom_data: Option<BTreeMap<String, String>>,
    /// Distribution of the recorder.
    #[serde(default)]
    pub ros_distro: Option<String>,
}

/// Distribution that is written into a bag; the type hashes are those of this and later ones.
const ROS_DISTRO: &str = "jazzy";

/// A number of nanoseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
pub struct Nanoseconds {
    /// The number.
    pub nanoseconds: i64,
}

/// A point in time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
pub struct StartingTime {
    /// Nanoseconds since 1970.
    pub nanoseconds_since_epoch: i64,
}

/// A topic and its number of messages.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct TopicCount {
    /// The topic.
    pub topic_metadata: TopicMetadata,
    /// Its messages.
    pub message_count: u64,
}

/// A topic as metadata.yaml describes it.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct TopicMetadata {
    /// Name with leading slash.
    pub name: String,
    /// `package/msg/Type`.
    pub r#type: String,
    /// `cdr`.
    pub serialization_format: String,
    /// Offered quality of service: a list (version 9) or a text that holds one (before).
    #[serde(default)]
    pub offered_qos_profiles: Option<QosField>,
    /// RIHS01 hash or "".
    #[serde(default)]
    pub type_description_hash: Option<String>,
}

/// The two ways in which quality of service is written.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum QosField {
    /// Version 9.
    List(Vec<Qos>),
    /// Before.
    Text(String),
}

impl QosField {
    /// The profiles, whichever way they are written.
    ///
    /// # Errors
    /// What the YAML reader says of a text that is no list of profiles.
    pub(crate) fn profiles(&self) -> Result<Vec<Qos>, String> {
        match self {
            Self::List(list) => Ok(list.clone()),
            Self::Text(text) => Qos::parse_list(text),
        }
    }
}

/// A file and its number of messages.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct FileCount {
    /// Name within the folder.
    pub path: String,
    /// First log time.
    pub starting_time: StartingTime,
    /// Last minus first log time.
    pub duration: Nanoseconds,
    /// Messages.
    pub message_count: u64,
}

#[derive(Deserialize)]
struct Document {
    rosbag2_bagfile_information: Metadata,
}

impl Metadata {
    /// Of a bag with one MCAP file, and the first and last log time of its messages.
    pub(super) fn of_one_file(
        name: &str,
        (first, last): (u64, u64),
        topics: Vec<TopicCount>,
        custom_data: BTreeMap<String, String>,
    ) -> Self {
        let starting_time = StartingTime { nanoseconds_since_epoch: first as i64 };
        let duration = Nanoseconds { nanoseconds: (last - first) as i64 };
        let message_count = topics.iter().map(|t| t.message_count).sum();
        Self {
            version: VERSION,
            storage_identifier: "mcap".to_owned(),
            duration,
            starting_time,
            message_count,
            topics_with_message_count: topics,
            compression_format: String::new(),
            compression_mode: String::new(),
            relative_file_paths: vec![name.to_owned()],
            files: vec![FileCount { path: name.to_owned(), starting_time, duration, message_count }],
            custom_data: Some(custom_data),
            ros_distro: Some(ROS_DISTRO.to_owned()),
        }
    }

    /// Reads the text of a metadata.yaml.
    ///
    /// # Errors
    /// What the YAML reader says (with line and column), or that a key is missing.
    pub fn parse(yaml: &str) -> Result<Self, String> {
        serde_saphyr::from_str::<Document>(yaml).map(|d| d.rosbag2_bagfile_information).map_err(|e| e.to_string())
    }

    /// Reads the copy within an MCAP file, which has no outer level.
    ///
    /// # Errors
    /// As [`Metadata::parse`].
    pub(crate) fn parse_inner(yaml: &str) -> Result<Self, String> {
        serde_saphyr::from_str::<Self>(yaml).map_err(|e| e.to_string())
    }

    /// Text of metadata.yaml. Within the MCAP file (record `rosbag2`, key `serialized_metadata`) it stands without
    /// the outer level: [`Metadata::to_yaml_inner`].
    #[must_use]
    pub(crate) fn to_yaml(&self) -> String {
        format!("rosbag2_bagfile_information:\n{}", indent(&self.to_yaml_inner(), 2))
    }

    /// The keys and values alone. `ros2 bag play` needs every key to be there.
    #[must_use]
    pub(crate) fn to_yaml_inner(&self) -> String {
        let mut out = format!(
            "version: {}\nstorage_identifier: {}\nduration:\n  nanoseconds: {}\nstarting_time:\n  \
             nanoseconds_since_epoch: {}\nmessage_count: {}\n",
            self.version,
            quoted_if_needed(&self.storage_identifier),
            self.duration.nanoseconds,
            self.starting_time.nanoseconds_since_epoch,
            self.message_count
        );
        if self.topics_with_message_count.is_empty() {
            out.push_str("topics_with_message_count: []\n");
        } else {
            out.push_str("topics_with_message_count:\n");
        }
        for topic in &self.topics_with_message_count {
            push_topic(&mut out, topic);
        }
        // Writing to a String can't fail.
        let _ = write!(
            out,
            "compression_format: {}\ncompression_mode: {}\n",
            quoted(&self.compression_format),
            quoted(&self.compression_mode)
        );
        push_list(
            &mut out,
            "relative_file_paths",
            self.relative_file_paths.iter().map(|f| format!("- {}\n", quoted_if_needed(f))),
        );
        push_list(
            &mut out,
            "files",
            self.files.iter().map(|f| {
                format!(
                    "- path: {}\n  starting_time:\n    nanoseconds_since_epoch: {}\n  duration:\n    nanoseconds: {}\n  \
                     message_count: {}\n",
                    quoted_if_needed(&f.path),
                    f.starting_time.nanoseconds_since_epoch,
                    f.duration.nanoseconds,
                    f.message_count
                )
            }),
        );
        match &self.custom_data {
            Some(data) if !data.is_empty() => {
                out.push_str("custom_data:\n");
                for (key, value) in data {
                    let _ = writeln!(out, "  {}: {}", quoted_if_needed(key), quoted(value));
                }
            }
            _ => out.push_str("custom_data: ~\n"),
        }
        let _ = writeln!(out, "ros_distro: {}", quoted_if_needed(self.ros_distro.as_deref().unwrap_or("unknown")));
        out
    }
}

fn push_topic(out: &mut String, topic: &TopicCount) {
    let t = &topic.topic_metadata;
    let profiles = match &t.offered_qos_profiles {
        None => String::new(),
        Some(QosField::Text(text)) => text.clone(),
        Some(QosField::List(list)) => list.iter().map(Qos::to_yaml).collect(),
    };
    let profiles = if profiles.is_empty() { " []\n".to_owned() } else { format!("\n{}", indent(&profiles, 8)) };
    let _ = write!(
        out,
        "  - topic_metadata:\n      name: {}\n      type: {}\n      serialization_format: {}\n      \
         offered_qos_profiles:{}      type_description_hash: {}\n    message_count: {}\n",
        quoted_if_needed(&t.name),
        quoted_if_needed(&t.r#type),
        quoted_if_needed(&t.serialization_format),
        profiles,
        quoted(t.type_description_hash.as_deref().unwrap_or("")),
        topic.message_count
    );
}

fn push_list(out: &mut String, key: &str, entries: impl Iterator<Item = String>) {
    let entries: String = entries.collect();
    if entries.is_empty() {
        let _ = writeln!(out, "{key}: []");
    } else {
        let _ = write!(out, "{key}:\n{}", indent(&entries, 2));
    }
}

fn indent(text: &str, by: usize) -> String {
    let pad = " ".repeat(by);
    text.lines().map(|line| format!("{pad}{line}\n")).collect()
}

/// A double-quoted YAML string.
fn quoted(text: &str) -> String {
    let mut out = String::from("\"");
    for c in text.chars() {
        match c {
            '"' => out.push_str("\\\""),
            '\\' => out.push_str("\\\\"),
            '\n' => out.push_str("\\n"),
            c if c.is_control() => {
                let _ = write!(out, "\\u{:04x}", u32::from(c));
            }
            c => out.push(c),
        }
    }
    out.push('"');
    out
}

/// Plain where YAML reads it back as the same string.
fn quoted_if_needed(text: &str) -> String {
    let plain = text.starts_with(|c: char| c.is_ascii_alphabetic() || c == '/' || c == '_')
        && text.chars().all(|c| c.is_ascii_alphanumeric() || "/_.".contains(c))
        && !matches!(
            text.to_ascii_lowercase().as_str(),
            "true" | "false" | "yes" | "no" | "null" | "on" | "off" | "y" | "n"
        );
    if plain { text.to_owned() } else { quoted(text) }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn example() -> Metadata {
        let topic = |name: &str, count| TopicCount {
            topic_metadata: TopicMetadata {
                name: name.into(),
                r#type: "std_msgs/msg/Float64".into(),
                serialization_format: "cdr".into(),
                offered_qos_profiles: Some(QosField::List(vec![Qos::reliable(10)])),
                type_description_hash: Some(String::new()),
            },
            message_count: count,
        };
        Metadata {
            version: VERSION,
            storage_identifier: "mcap".into(),
            duration: Nanoseconds { nanoseconds: 5 },
            starting_time: StartingTime { nanoseconds_since_epoch: 1_767_225_600_000_000_000 },
            message_count: 3,
            topics_with_message_count: vec![topic("/a", 1), topic("/b/c", 2)],
            compression_format: String::new(),
            compression_mode: String::new(),
            relative_file_paths: vec!["2026-01 \"x\" \u{e4}_0.mcap".into()],
            files: vec![FileCount {
                path: "2026-01 \"x\" \u{e4}_0.mcap".into(),
                starting_time: StartingTime { nanoseconds_since_epoch: 7 },
                duration: Nanoseconds { nanoseconds: 5 },
                message_count: 3,
            }],
            custom_data: Some([("synthetic".to_owned(), "true: \\ \"yes\"\n".to_owned())].into()),
            ros_distro: Some("jazzy".into()),
        }
    }

    #[test]
    fn text_and_back() {
        let metadata = example();
        assert_eq!(Metadata::parse(&metadata.to_yaml()).unwrap(), metadata);
        let bare = Metadata { topics_with_message_count: vec![], files: vec![], custom_data: None, ..metadata };
        assert_eq!(Metadata::parse(&bare.to_yaml()).unwrap(), bare);
    }

    #[test]
    fn older_versions_with_quality_as_text() {
        let yaml = "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: sqlite3\n  \
                    duration: {nanoseconds: 1}\n  starting_time: {nanoseconds_since_epoch: 2}\n  message_count: 1\n  \
                    topics_with_message_count:\n    - topic_metadata:\n        name: /a\n        type: std_msgs/msg/Float64\n        \
                    serialization_format: cdr\n        offered_qos_profiles: \"\"\n      message_count: 1\n  \
                    relative_file_paths: [a.db3]\n";
        let metadata = Metadata::parse(yaml).unwrap();
        assert_eq!(metadata.storage_identifier, "sqlite3");
        let field = metadata.topics_with_message_count[0].topic_metadata.offered_qos_profiles.as_ref().unwrap();
        assert!(field.profiles().unwrap().is_empty());
    }

    #[test]
    fn other_yaml_is_refused() {
        for text in ["", "a: 1", "rosbag2_bagfile_information: 3", "[", "rosbag2_bagfile_information:\n  version: x"] {
            assert!(Metadata::parse(text).is_err(), "{text}");
        }
    }
}
