//! Reads rosbag2 folders and single MCAP files: what is in them, and their messages in the order of their log times.
//!
//! Any bytes are accepted as input. What can be read is read, what can't is said ([`Loss`]). Memory stays within
//! three times (16 MiB + 64 times the file's size), whatever lengths the file declares; a sound recording takes a few
//! chunks (megabytes).

use super::checksum::data_checksum;
use super::error::{BagError, Loss};
use super::folder::{self, Located};
use super::index::{FileIndex, read_index};
use super::metadata::Metadata;
use super::qos::Qos;
use super::record::ChannelRecord;
use super::source::Source;
use ros2_messages::{RosMessage, from_cdr};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// A topic of a bag.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Topic {
    /// Name with leading slash.
    pub name: String,
    /// `package/msg/Type`.
    pub type_name: String,
    /// Definition of the type, which topics of one type share.
    pub schema: Arc<str>,
    /// Encoding of the definition.
    pub schema_encoding: String,
    /// Encoding of the messages, `cdr`.
    pub encoding: String,
    /// What the recorded publishers offered, as the file says it.
    pub qos: Vec<Qos>,
    /// RIHS01 hash, or "".
    pub hash: String,
    /// Number of messages.
    pub messages: u64,
}

/// A message of a bag.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Message {
    /// Index into [`BagReader::topics`].
    pub topic: usize,
    /// When it was recorded, ns since 1970.
    pub log_ns: u64,
    /// When it was sent, ns since 1970.
    pub publish_ns: u64,
    /// Number that the recorder gave it.
    pub sequence: u32,
    /// Encapsulation header and CDR.
    pub data: Vec<u8>,
}

/// One file of the bag.
#[derive(Debug)]
pub(super) struct BagFile {
    pub(super) name: String,
    pub(super) source: Source,
    pub(super) index: FileIndex,
    /// Topic of each channel.
    pub(super) topics: BTreeMap<u16, usize>,
}

/// An opened bag. Cheap to clone; every clone reads the same files.
#[derive(Clone, Debug)]
pub struct BagReader(Arc<Bag>);

#[derive(Debug)]
struct Bag {
    name: String,
    files: Vec<BagFile>,
    topics: Vec<Topic>,
    metadata: Option<Metadata>,
    losses: Vec<Loss>,
    warnings: Vec<String>,
}

impl BagReader {
    /// Opens a rosbag2 folder (or its metadata.yaml), or a single MCAP file.
    ///
    /// # Errors
    /// [`BagError::Open`] if there is nothing, [`BagError::NotABag`] if it is something else; the message says what
    /// and how to convert it. A damaged bag is no error as long as anything can be read: see [`BagReader::losses`].
    pub fn open(path: impl AsRef<Path>) -> Result<Self, BagError> {
        let path = path.as_ref();
        let Located { files, metadata, losses, warnings } = folder::locate(path)?;
        let mut bag =
            Bag { name: path.display().to_string(), files: Vec::new(), topics: Vec::new(), metadata, losses, warnings };
        for file in files {
            let open = |source| BagError::Open { path: file.clone(), source };
            let source = Source::open(&file).map_err(open)?;
            folder::check_start(&file, &source)?;
            let name =
                file.file_name().map_or_else(|| file.display().to_string(), |n| n.to_string_lossy().into_owned());
            let index = read_index(&source, &name).map_err(open)?;
            bag.add(name, source, index);
        }
        bag.finish()
    }

    /// Opens an MCAP file that is in memory; `name` stands for it in messages.
    ///
    /// # Errors
    /// [`BagError::NotABag`] if it isn't one.
    pub fn from_bytes(name: &str, bytes: &'static [u8]) -> Result<Self, BagError> {
        Self::from_source(name, Source::Memory(bytes.into()))
    }

    /// As [`BagReader::from_bytes`], with bytes that the reader keeps.
    ///
    /// # Errors
    /// [`BagError::NotABag`] if it isn't one.
    pub fn from_vec(name: &str, bytes: Vec<u8>) -> Result<Self, BagError> {
        Self::from_source(name, Source::Memory(bytes.into()))
    }

    fn from_source(name: &str, source: Source) -> Result<Self, BagError> {
        folder::check_start(Path::new(name), &source)?;
        let index = read_index(&source, name).map_err(|e| BagError::Open { path: name.into(), source: e })?;
        let (metadata, losses, warnings) = (None, Vec::new(), Vec::new());
        let mut bag = Bag { name: name.to_owned(), files: Vec::new(), topics: Vec::new(), metadata, losses, warnings };
        bag.add(name.to_owned(), source, index);
        bag.finish()
    }

    /// The path as it was given.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.0.name
    }

    /// The topics, sorted by name.
    #[must_use]
    pub fn topics(&self) -> &[Topic] {
        &self.0.topics
    }

    /// First and last log time, ns since 1970; `None` without messages.
    #[must_use]
    pub fn span_ns(&self) -> Option<(u64, u64)> {
        let spans = self.0.files.iter().map(|f| &f.index.statistics).filter(|s| s.messages > 0);
        spans.map(|s| (s.start_ns, s.end_ns)).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
    }

    /// Number of messages in all.
    #[must_use]
    pub fn message_count(&self) -> u64 {
        self.0.files.iter().map(|f| f.index.statistics.messages).sum()
    }

    /// Bytes of all files.
    #[must_use]
    pub fn size(&self) -> u64 {
        self.0.files.iter().map(|f| f.source.len()).sum()
    }

    /// Names of the files.
    pub fn file_names(&self) -> impl Iterator<Item = &str> {
        self.0.files.iter().map(|f| f.name.as_str())
    }

    /// What metadata.yaml says, or the copy of it in the file.
    #[must_use]
    pub fn metadata(&self) -> Option<&Metadata> {
        self.0.metadata.as_ref()
    }

    /// What the recorder said of the bag, by key (`custom_data` of metadata.yaml).
    #[must_use]
    pub fn custom_data(&self, key: &str) -> Option<&str> {
        self.0.metadata.as_ref()?.custom_data.as_ref()?.get(key).map(String::as_str)
    }

    /// What was found lost when the bag was opened. Reading the messages may find more: [`super::Messages::losses`].
    #[must_use]
    pub fn losses(&self) -> &[Loss] {
        &self.0.losses
    }

    /// What is odd but cost nothing (no metadata.yaml, one that contradicts the file, a broken index).
    #[must_use]
    pub fn warnings(&self) -> &[String] {
        &self.0.warnings
    }

    /// The message as `T`.
    ///
    /// # Errors
    /// The reason, if the topic has another type or the bytes don't hold a `T`.
    pub fn decode<T: RosMessage>(&self, message: &Message) -> Result<T, String> {
        let topic = self.topics().get(message.topic).ok_or("the message is from another bag")?;
        if topic.type_name != T::TYPE {
            return Err(format!("its type is {}, not {}", topic.type_name, T::TYPE));
        }
        if topic.encoding != "cdr" {
            return Err(format!("its encoding is {:?}, not cdr", topic.encoding));
        }
        from_cdr(&message.data).map_err(|e| e.to_string())
    }

    /// Topics and types in one line, for messages to the user.
    #[must_use]
    pub fn describe_topics(&self) -> String {
        let names: Vec<String> = self.topics().iter().map(|t| format!("{} ({})", t.name, t.type_name)).collect();
        if names.is_empty() { "no topics".to_owned() } else { names.join(", ") }
    }

    pub(super) fn files(&self) -> &[BagFile] {
        &self.0.files
    }
}

impl Bag {
    fn add(&mut self, name: String, source: Source, mut index: FileIndex) {
        self.losses.append(&mut index.losses);
        self.warnings.extend(index.warnings.iter().cloned());
        for channel in index.channels.values() {
            let schema = index.schemas.get(&channel.schema_id);
            let topic = Topic {
                name: channel.topic.clone(),
                type_name: schema.map_or(String::new(), |s| s.name.clone()),
                schema: schema.map_or_else(|| Arc::from(""), |s| Arc::clone(&s.text)),
                schema_encoding: schema.map_or(String::new(), |s| s.encoding.clone()),
                encoding: channel.encoding.clone(),
                qos: channel
                    .metadata
                    .get("offered_qos_profiles")
                    .and_then(|q| Qos::parse_list(q).ok())
                    .unwrap_or_default(),
                hash: channel.metadata.get("topic_type_hash").cloned().unwrap_or_default(),
                messages: index.statistics.per_channel.get(&channel.id).copied().unwrap_or(0),
            };
            self.topics.push(topic);
        }
        if self.metadata.is_none() {
            let yaml = index.own_metadata();
            self.metadata = yaml.and_then(|yaml| Metadata::parse_inner(yaml).ok());
        }
        self.files.push(BagFile { name, source, index, topics: BTreeMap::new() });
    }

    /// Once all files are in it: each topic once, sorted, and what is odd or lost.
    fn finish(mut self) -> Result<BagReader, BagError> {
        // stable: of several channels of one topic the first says what it is
        self.topics.sort_by(|a, b| (&a.name, &a.type_name).cmp(&(&b.name, &b.type_name)));
        self.topics.dedup_by(|next, kept| {
            let same = (&next.name, &next.type_name) == (&kept.name, &kept.type_name);
            kept.messages += if same { next.messages } else { 0 };
            same
        });
        self.number_channels();
        self.compare_with_metadata();
        self.compare_with_checksums()?;
        Ok(BagReader(Arc::new(self)))
    }

    /// Says which files are not as they were written.
    fn compare_with_checksums(&mut self) -> Result<(), BagError> {
        for file in &self.files {
            let checksum = data_checksum(&file.source);
            match checksum.map_err(|source| BagError::Open { path: file.name.clone().into(), source })? {
                Some((saved, found)) if saved != found => {
                    self.losses.push(Loss::Checksum { file: file.name.clone(), saved, found });
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// Topic index of each channel.
    fn number_channels(&mut self) {
        for file in &mut self.files {
            let index = &file.index;
            let number = |c: &ChannelRecord| {
                let type_name = index.schemas.get(&c.schema_id).map_or("", |s| s.name.as_str());
                let key = (c.topic.as_str(), type_name);
                self.topics.binary_search_by(|t| (t.name.as_str(), t.type_name.as_str()).cmp(&key)).ok()
            };
            file.topics = index.channels.values().filter_map(|c| Some((c.id, number(c)?))).collect();
        }
    }

    /// Says where metadata.yaml and the files differ. The files are right.
    fn compare_with_metadata(&mut self) {
        let Some(metadata) = &self.metadata else { return };
        if !self.losses.is_empty() {
            return; // it can't agree
        }
        let found: u64 = self.files.iter().map(|f| f.index.statistics.messages).sum();
        if metadata.message_count != found {
            let said = metadata.message_count;
            self.warnings.push(format!("metadata.yaml says {said} messages, the files hold {found}"));
        }
        for entry in &metadata.topics_with_message_count {
            let said = &entry.topic_metadata;
            let first = self.topics.partition_point(|t| t.name < said.name);
            match self.topics.get(first).filter(|t| t.name == said.name) {
                None => {
                    self.warnings.push(format!("metadata.yaml lists topic {}, which the files don't have", said.name))
                }
                Some(t) if t.type_name != said.r#type => self.warnings.push(format!(
                    "metadata.yaml says that {} is {}, the files say {}",
                    t.name, said.r#type, t.type_name
                )),
                Some(_) => {}
            }
        }
    }
}
