//! Writes a rosbag2 folder: `NAME/NAME_0.mcap` and `NAME/metadata.yaml`.
//!
//! Messages stream to the disk in compressed chunks, each written at once, and metadata.yaml with them: a process that is
//! killed leaves a bag that can be read up to its last chunk. Space for the open chunk and for the end of the file is set aside before a
//! message is taken, so a full disk ends the recording, not the file.

use super::error::BagError;
use super::metadata::{Metadata, QosField, TopicCount, TopicMetadata};
use super::options::WriterOptions;
use super::qos::Qos;
use super::space::Reserved;
use mcap::records::{MessageHeader, Metadata as MetadataRecord};
use ros2_messages::schema::{Schema, schema};
use ros2_messages::{RosMessage, to_cdr_in};
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Bytes that a message takes in a chunk beside its content, and in the index behind the chunk.
const PER_MESSAGE: u64 = 31 + 16;

/// A topic of the bag that is being written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TopicId(usize);

/// What a finished bag holds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Written {
    /// The folder.
    pub folder: PathBuf,
    /// Messages in the file.
    pub messages: u64,
    /// Messages that are not in the file because writing failed.
    pub lost: u64,
    /// True if the file has its index and end mark; otherwise it was cut behind its last whole chunk.
    pub complete: bool,
}

struct Topic {
    metadata: TopicMetadata,
    channel: u16,
    /// Written, the open chunk included.
    messages: u64,
    on_disk: u64,
}

/// The chunk that is not on the disk yet.
struct OpenChunk {
    /// Bytes in it, with what the index behind it will take.
    bytes: u64,
    since: Instant,
}

impl OpenChunk {
    fn new() -> Self {
        Self { bytes: 0, since: Instant::now() }
    }
}

/// Writes a bag. [`BagWriter::finish`] closes it; dropping does so too, without a word about errors.
pub struct BagWriter {
    folder: PathBuf,
    file_name: String,
    /// None once a write has failed or the bag is finished.
    mcap: Option<mcap::Writer<BufWriter<File>>>,
    space: Reserved,
    options: WriterOptions,
    topics: Vec<Topic>,
    /// First and last log time.
    span: Option<(u64, u64)>,
    chunk: OpenChunk,
    /// Chunks that are on the disk, and where they end.
    chunks_on_disk: u64,
    end_on_disk: u64,
    /// Bytes that schemas and channels take at the end of the file.
    summary_bytes: u64,
    /// The failure has been reported: no more messages are taken.
    full: bool,
    lost: u64,
    /// Memory of the message that is being written.
    message: Vec<u8>,
}

impl std::fmt::Debug for BagWriter {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.debug_struct("BagWriter")
            .field("folder", &self.folder)
            .field("end_on_disk", &self.end_on_disk)
            .finish_non_exhaustive()
    }
}

impl BagWriter {
    /// Makes the folder and starts the file, both with the folder's name.
    ///
    /// # Errors
    /// [`BagError::Exists`] if the folder exists and is not empty, [`BagError::Open`] if it can't be written.
    pub fn create(folder: impl AsRef<Path>, options: WriterOptions) -> Result<Self, BagError> {
        let folder = folder.as_ref();
        let name =
            std::path::absolute(folder).ok().and_then(|p| p.file_name().map(|n| n.to_string_lossy().into_owned()));
        Self::create_named(folder, name.as_deref().unwrap_or("bag"), options)
    }

    /// As [`BagWriter::create`], with a name for the file (`NAME_0.mcap`).
    ///
    /// # Errors
    /// As [`BagWriter::create`].
    pub fn create_named(folder: impl AsRef<Path>, name: &str, options: WriterOptions) -> Result<Self, BagError> {
        let folder = folder.as_ref().to_path_buf();
        let at = |path: &Path| {
            let path = path.to_path_buf();
            move |source| BagError::Open { path, source }
        };
        if folder.exists() && fs::read_dir(&folder).map_err(at(&folder))?.next().is_some() {
            return Err(BagError::Exists { path: folder });
        }
        fs::create_dir_all(&folder).map_err(at(&folder))?;
        let file_name = format!("{name}_0.mcap");
        let path = folder.join(&file_name);
        let file = File::create(&path).map_err(at(&path))?;
        let space = Reserved::new(file.try_clone().map_err(at(&path))?);
        let mcap = options.of_file().create(BufWriter::new(file)).map_err(|e| at(&path)(io::Error::other(e)))?;
        let writer = Self {
            folder,
            file_name,
            mcap: Some(mcap),
            space,
            options,
            topics: Vec::new(),
            span: None,
            chunk: OpenChunk::new(),
            chunks_on_disk: 0,
            end_on_disk: 0,
            summary_bytes: 0,
            full: false,
            lost: 0,
            message: Vec::new(),
        };
        writer.write_metadata_yaml().map_err(at(&writer.folder.join("metadata.yaml")))?;
        Ok(writer)
    }

    /// The folder.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Adds a topic of a type that this program knows. `name` starts with a slash.
    ///
    /// # Errors
    /// [`BagError::Write`] if the file can't be written any further.
    pub fn add_topic<T: RosMessage>(&mut self, name: &str, qos: &Qos) -> Result<TopicId, BagError> {
        let schema =
            schema(T::TYPE).ok_or_else(|| self.error(format!("type {} has no schema in this program", T::TYPE)))?;
        self.add_raw_topic(name, &schema, qos)
    }

    /// Adds a topic of any type, given its schema.
    ///
    /// # Errors
    /// [`BagError::Write`] if the file can't be written any further.
    pub fn add_raw_topic(&mut self, name: &str, schema: &Schema, qos: &Qos) -> Result<TopicId, BagError> {
        let mut topic = Topic {
            metadata: TopicMetadata {
                name: name.to_owned(),
                r#type: schema.type_name.clone(),
                serialization_format: "cdr".to_owned(),
                offered_qos_profiles: Some(QosField::List(vec![qos.clone()])),
                type_description_hash: Some(schema.hash.clone()),
            },
            channel: 0,
            messages: 0,
            on_disk: 0,
        };
        if let Some(mcap) = self.mcap.as_mut().filter(|_| !self.full) {
            let channel_metadata: BTreeMap<String, String> = [
                ("offered_qos_profiles".to_owned(), qos.to_yaml()),
                ("topic_type_hash".to_owned(), schema.hash.clone()),
            ]
            .into();
            topic.channel = mcap
                .add_schema(&schema.type_name, "ros2msg", schema.text.as_bytes())
                .and_then(|id| mcap.add_channel(id, name, "cdr", &channel_metadata))
                .map_err(|e| self.error(e.to_string()))?;
            // Once in the open chunk, once at the end of the file.
            let bytes = (schema.text.len() + schema.type_name.len() + name.len()) as u64 + 600;
            self.chunk.bytes += bytes;
            self.summary_bytes += bytes;
        }
        self.topics.push(topic);
        // with every chunk too: until then the topic is not on the disk
        if self.topics.len().is_power_of_two() {
            self.write_metadata_yaml().map_err(|e| self.error(e.to_string()))?;
        }
        Ok(TopicId(self.topics.len() - 1))
    }

    /// Writes one message; times in ns since 1970: when it was received, and when it was sent.
    ///
    /// # Errors
    /// As [`BagWriter::write_raw`].
    pub fn write<T: RosMessage>(
        &mut self,
        topic: TopicId,
        log_ns: u64,
        publish_ns: u64,
        message: &T,
    ) -> Result<(), BagError> {
        let mut bytes = std::mem::take(&mut self.message);
        let written = match to_cdr_in(&mut bytes, message) {
            Ok(()) => self.write_raw(topic, log_ns, publish_ns, &bytes),
            Err(e) => Err(self.error(e.to_string())),
        };
        self.message = bytes;
        written
    }

    /// Writes one message that is already serialised (encapsulation header and CDR).
    ///
    /// # Errors
    /// [`BagError::Write`] when the file can't be written any further, once: what comes after is counted in
    /// [`Written::lost`] and answered with `Ok`, so that a recorder says it once.
    pub fn write_raw(&mut self, topic: TopicId, log_ns: u64, publish_ns: u64, bytes: &[u8]) -> Result<(), BagError> {
        let Some(&Topic { channel, messages, .. }) = self.topics.get(topic.0) else {
            return Err(self.error("the topic belongs to another bag".to_owned()));
        };
        if self.full || self.mcap.is_none() {
            self.lost += 1;
            return Ok(());
        }
        let record = bytes.len() as u64 + PER_MESSAGE;
        if let Err(e) = self.space.up_to(self.size_with(record)) {
            self.full = true;
            self.lost += 1;
            return Err(self.error(e.to_string()));
        }
        let header = MessageHeader {
            channel_id: channel,
            sequence: messages as u32,
            log_time: log_ns,
            publish_time: publish_ns,
        };
        if let Some(Err(e)) = self.mcap.as_mut().map(|mcap| mcap.write_to_known_channel(&header, bytes)) {
            self.lost += 1;
            return Err(self.fail(e.to_string()));
        }
        self.topics[topic.0].messages += 1;
        self.chunk.bytes += record;
        self.span = Some(self.span.map_or((log_ns, log_ns), |(first, last)| (first.min(log_ns), last.max(log_ns))));
        let old = self.options.flush_after.is_some_and(|age| self.chunk.since.elapsed() >= age);
        if old || self.chunk.bytes >= self.options.chunk_bytes { self.flush() } else { Ok(()) }
    }

    /// Puts what was written so far on the disk, as a whole chunk.
    ///
    /// # Errors
    /// [`BagError::Write`], once.
    pub fn flush(&mut self) -> Result<(), BagError> {
        let Some(mcap) = &mut self.mcap else { return Ok(()) };
        let flushed = mcap.flush().map_err(io::Error::other).and_then(|()| self.space.len());
        match flushed {
            Ok(end) => {
                self.end_on_disk = end;
                self.topics.iter_mut().for_each(|t| t.on_disk = t.messages);
                self.chunks_on_disk += 1;
                self.chunk = OpenChunk::new();
                // A disk that has no room for it may have room for messages; closing writes it again, and says so.
                let _ = self.write_metadata_yaml();
                Ok(())
            }
            Err(e) => Err(self.fail(e.to_string())),
        }
    }

    /// Closes the file and writes metadata.yaml.
    ///
    /// # Errors
    /// [`BagError::Write`] if the end of the file or metadata.yaml can't be written and that was not reported before.
    pub fn finish(mut self) -> Result<Written, BagError> {
        let result = self.close();
        let written = Written {
            folder: self.folder.clone(),
            messages: self.messages(),
            lost: self.lost,
            complete: matches!(result, Ok(true)),
        };
        result.map(|_| written)
    }

    /// True if the file has got its end.
    fn close(&mut self) -> Result<bool, BagError> {
        let mut complete = false;
        if self.mcap.is_some() {
            self.flush()?;
            self.write_end().map_err(|e| self.fail(e.to_string()))?;
            complete = true;
        }
        self.write_metadata_yaml().map_err(|e| self.error(format!("metadata.yaml can't be written: {e}")))?;
        Ok(complete)
    }

    /// Metadata record, index, end mark.
    fn write_end(&mut self) -> io::Result<()> {
        let Some(mut mcap) = self.mcap.take() else { return Ok(()) };
        let record = MetadataRecord {
            name: "rosbag2".to_owned(),
            metadata: [("serialized_metadata".to_owned(), self.metadata().to_yaml_inner())].into(),
        };
        mcap.write_metadata(&record).and_then(|()| mcap.finish()).map_err(io::Error::other)?;
        let mut buffer = mcap.into_inner();
        buffer.flush()?;
        let file = buffer.into_inner().map_err(|e| e.into_error())?;
        self.space.cut(self.space.len()?)?;
        file.sync_all()
    }

    /// Size that the file needs if it takes `record` bytes more and is then closed.
    fn size_with(&self, record: u64) -> u64 {
        let chunk = self.chunk.bytes + record;
        let compressed = chunk + chunk / 128 + 1024; // zstd never grows data by more
        let per_topic = self.topics.len() as u64;
        let index = (self.chunks_on_disk + 1) * (100 + 10 * per_topic) + 26 * per_topic;
        let metadata = 2000 + 1000 * per_topic;
        self.end_on_disk + compressed + self.summary_bytes + index + metadata
    }

    /// Ends writing: cuts the file behind its last whole chunk.
    fn fail(&mut self, reason: String) -> BagError {
        if let Some(mcap) = self.mcap.take() {
            // Takes the stream out without writing anything more.
            let _ = mcap.into_inner().into_parts();
        }
        for topic in &mut self.topics {
            self.lost += topic.messages - topic.on_disk;
            topic.messages = topic.on_disk;
        }
        self.chunk = OpenChunk::new();
        let cut = self.space.cut(self.end_on_disk).err();
        let reason = cut.map_or(reason.clone(), |e| format!("{reason} (and cutting off the broken end failed: {e})"));
        self.error(reason)
    }

    /// Messages in the file, those of the open chunk included.
    fn messages(&self) -> u64 {
        self.topics.iter().map(|t| t.messages).sum()
    }

    fn error(&self, reason: String) -> BagError {
        BagError::Write {
            path: self.folder.join(&self.file_name),
            reason,
            kept: format!("{} messages are in the file", self.messages()),
        }
    }

    /// What metadata.yaml says now.
    fn metadata(&self) -> Metadata {
        let count = |t: &Topic| TopicCount { topic_metadata: t.metadata.clone(), message_count: t.messages };
        let topics = self.topics.iter().map(count).collect();
        Metadata::of_one_file(&self.file_name, self.span.unwrap_or((0, 0)), topics, self.options.custom_data.clone())
    }

    /// Written anew with every topic and chunk, so that it says what is in the file whenever the process ends.
    fn write_metadata_yaml(&self) -> io::Result<()> {
        let (path, new) = (self.folder.join("metadata.yaml"), self.folder.join("metadata.yaml.new"));
        let written = fs::write(&new, self.metadata().to_yaml()).and_then(|()| fs::rename(&new, path));
        if written.is_err() {
            let _ = fs::remove_file(&new);
        }
        written
    }
}

impl Drop for BagWriter {
    fn drop(&mut self) {
        if self.mcap.is_some() {
            let _ = self.close();
        }
    }
}
