//! Records the messages that a node receives and sends into a rosbag2 folder, in a separate thread.
//!
//! A publisher or subscription passes on the bytes without waiting. If the disk is slow or full, the recording loses
//! messages, which are counted; nothing else is affected.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::Duration;

use ros2_client::QosProfile;
use ros2_client::qos::{Durability, History, Reliability};
use serde::Serialize;

use super::clock::wall_nanos;
use super::error::NodeError;
use super::parameter::{Parameter, parameters};
use super::parameters::Parameters;
use named_threads::spawn;
use ros2_messages::schema::Schema;
use ros2_messages::to_cdr;
use rosbag2_mcap::{BagWriter, Qos, TopicId, WriterOptions, Written};

/// Largest number of messages in the queue to the disk.
const WAITING_MESSAGES: usize = 16_384;
/// Largest number of bytes in the queue to the disk.
const WAITING_BYTES: usize = 64 << 20;
/// Longest time until a message reaches the disk.
const FLUSH: Duration = Duration::from_secs(1);
/// Recorded only on request: for viewers, and computable from `tissue_model` and `tissue_state`, or from poses. Frames that were
/// recorded would contradict those of a twin that the recording is played to.
const NOT_UNASKED: [&str; 4] = ["tissue_points", "tissue_surface", "/tf", "/tf_static"];

parameters! {
    /// What a node that can record declares.
    declarations:

    /// Where the recording goes.
    RECORD: String = Parameter::new(
        "record",
        "",
        "Folder (new or empty) for a rosbag2 recording of what the node hears and says; empty: no recording.",
    )
    .fixed();
    /// What is recorded.
    RECORD_TOPICS: Vec<String> = Parameter::new(
        "record_topics",
        [],
        "Topics to record, by their names here or on the network; empty: all but tissue_points, tissue_surface, /tf \
         and /tf_static, which follow from the others.",
    )
    .fixed();
}

enum Entry {
    Message { topic: TopicId, log_ns: u64, publish_ns: u64, bytes: Vec<u8> },
    Stop,
}

#[derive(Debug, Default)]
struct Backlog {
    bytes: AtomicUsize,
    lost: AtomicU64,
}

/// Accepts the messages of one topic.
#[derive(Clone)]
pub(crate) struct Tap {
    topic: TopicId,
    sender: SyncSender<Entry>,
    backlog: Arc<Backlog>,
}

impl Tap {
    /// Records a message that the node sends now.
    pub(crate) fn said<M: Serialize>(&self, message: &M) {
        let now = wall_nanos();
        self.put(message, now, now);
    }

    /// Records a message that was received; times in ns since 1970.
    pub(crate) fn heard<M: Serialize>(&self, message: &M, [received, sent]: [i64; 2]) {
        self.put(message, received, sent);
    }

    fn put<M: Serialize>(&self, message: &M, log: i64, publish: i64) {
        let ns = |t: i64| u64::try_from(t).unwrap_or(0);
        let room = self.backlog.bytes.load(Ordering::Relaxed) < WAITING_BYTES;
        let taken = room
            && to_cdr(message).is_ok_and(|bytes| {
                // Counted before the writing thread can subtract it.
                let size = bytes.len();
                self.backlog.bytes.fetch_add(size, Ordering::Relaxed);
                let entry = Entry::Message { topic: self.topic, log_ns: ns(log), publish_ns: ns(publish), bytes };
                let sent = self.sender.try_send(entry).is_ok();
                self.backlog.bytes.fetch_sub(if sent { 0 } else { size }, Ordering::Relaxed);
                sent
            });
        if !taken {
            self.backlog.lost.fetch_add(1, Ordering::Relaxed);
        }
    }
}

/// A recording in preparation: topics can be added.
pub struct Recorder {
    writer: BagWriter,
    topics: Vec<String>,
    sender: SyncSender<Entry>,
    entries: Receiver<Entry>,
    backlog: Arc<Backlog>,
}

impl Recorder {
    /// Creates the folder in the parameter `record`, if it is set.
    ///
    /// # Errors
    /// [`NodeError::Other`] if it exists and is not empty, or can't be written.
    pub fn create(parameters: &Parameters) -> Result<Option<Self>, NodeError> {
        let folder = parameters.get(RECORD);
        if folder.is_empty() {
            return Ok(None);
        }
        let options = WriterOptions {
            flush_after: Some(FLUSH),
            library: concat!("ros2_node ", env!("CARGO_PKG_VERSION")).to_owned(),
            ..WriterOptions::default()
        };
        let writer = BagWriter::create(Path::new(&folder), options)
            .map_err(|e| NodeError::Other(format!("parameter `record`: {e}")))?;
        let (sender, entries) = sync_channel(WAITING_MESSAGES);
        let topics = parameters.get(RECORD_TOPICS);
        Ok(Some(Self { writer, topics, sender, entries, backlog: Arc::default() }))
    }

    /// The tap of a topic that is to be recorded. `name` is the program's name, and `topic` the full name.
    ///
    /// # Errors
    /// The error of the file system.
    pub(super) fn tap(
        &mut self,
        name: &str,
        topic: &str,
        schema: Option<&Schema>,
        profile: &QosProfile,
    ) -> Result<Option<Tap>, NodeError> {
        let wanted = if self.topics.is_empty() {
            !NOT_UNASKED.contains(&name)
        } else {
            self.topics.iter().any(|t| t == name || t == topic)
        };
        let Some(schema) = schema.filter(|_| wanted) else { return Ok(None) };
        let topic = self
            .writer
            .add_raw_topic(topic, schema, &recorded(profile))
            .map_err(|e| NodeError::Other(format!("parameter `record`: {e}")))?;
        Ok(Some(Tap { topic, sender: self.sender.clone(), backlog: Arc::clone(&self.backlog) }))
    }

    /// Starts writing.
    ///
    /// # Errors
    /// [`NodeError::Other`] if no thread can be started.
    pub(crate) fn start(self) -> Result<Recording, NodeError> {
        let Self { writer, sender, entries, backlog, .. } = self;
        tracing::info!("recording into {}", writer.folder().display());
        let shared = Arc::clone(&backlog);
        let thread = spawn_writer(writer, entries, shared)?;
        Ok(Recording { sender, backlog, thread })
    }
}

/// The profile in the format of a bag.
fn recorded(profile: &QosProfile) -> Qos {
    let depth = match profile.history {
        History::KeepLast { depth } => u32::try_from(depth).unwrap_or(u32::MAX),
        History::KeepAll => 1000,
    };
    match (profile.durability, profile.reliability) {
        (Durability::TransientLocal, _) => Qos::transient_local(depth),
        (_, Reliability::Reliable { .. }) => Qos::reliable(depth),
        _ => Qos::best_effort(depth),
    }
}

fn spawn_writer(
    writer: BagWriter,
    entries: Receiver<Entry>,
    backlog: Arc<Backlog>,
) -> Result<JoinHandle<()>, NodeError> {
    Ok(spawn("recorder", move || match write_all(writer, &entries, &backlog) {
        Ok(written) => {
            backlog.lost.fetch_add(written.lost, Ordering::Relaxed);
            tracing::info!("recorded {} messages into {}", written.messages, written.folder.display());
        }
        Err(reason) => {
            backlog.lost.fetch_add(1, Ordering::Relaxed);
            tracing::error!("the recording could not be closed: {reason}");
        }
    })?)
}

/// Writes until it is stopped, then closes the bag. A failure is reported once, and the node continues.
fn write_all(mut writer: BagWriter, entries: &Receiver<Entry>, backlog: &Backlog) -> Result<Written, String> {
    let mut unsaved = false;
    loop {
        let outcome = match entries.recv_timeout(FLUSH) {
            Ok(Entry::Message { topic, log_ns, publish_ns, bytes }) => {
                backlog.bytes.fetch_sub(bytes.len(), Ordering::Relaxed);
                unsaved = true;
                writer.write_raw(topic, log_ns, publish_ns, &bytes)
            }
            Err(RecvTimeoutError::Timeout) if std::mem::take(&mut unsaved) => writer.flush(),
            Err(RecvTimeoutError::Timeout) => Ok(()),
            Ok(Entry::Stop) | Err(RecvTimeoutError::Disconnected) => break,
        };
        if let Err(error) = outcome {
            tracing::error!("the recording stops: {error}. The node goes on");
        }
    }
    writer.finish().map_err(|e| e.to_string())
}

/// An active recording.
pub struct Recording {
    sender: SyncSender<Entry>,
    backlog: Arc<Backlog>,
    thread: JoinHandle<()>,
}

impl Recording {
    /// Writes the queued messages, closes the bag, and returns the number of lost messages.
    #[must_use]
    pub fn finish(self) -> u64 {
        // Fails only if the thread has ended.
        let _ = self.sender.send(Entry::Stop);
        named_threads::join(self.thread);
        let lost = self.backlog.lost.load(Ordering::Relaxed);
        if lost > 0 {
            tracing::error!("{lost} messages are missing in the recording");
        }
        lost
    }
}
