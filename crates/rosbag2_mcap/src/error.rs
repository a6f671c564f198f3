//! What can go wrong with a bag, each with the file, what is wrong and what to do.

use std::path::PathBuf;

/// Why a bag can't be opened, read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BagError {
    /// The file or folder can't be opened or read.
    #[error("{}: {source}", path.display())]
    Open {
        /// What was to be opened.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// There is something, but not a bag that can be read here.
    #[error("{}: {found}; {remedy}", path.display())]
    NotABag {
        /// What was opened.
        path: PathBuf,
        /// What it is instead.
        found: String,
        /// What to do.
        remedy: String,
    },
    /// The bag has no topic that would do.
    #[error("{bag}: no topic for {wanted}; the bag has {available}. {remedy}")]
    NoTopic {
        /// The bag.
        bag: String,
        /// What was looked for.
        wanted: String,
        /// Topics and types that the bag has.
        available: String,
        /// What to do.
        remedy: String,
    },
    /// A topic is there, but holds nothing that can be used.
    #[error("{bag}: topic {topic} ({type_name}): {reason}")]
    Topic {
        /// The bag.
        bag: String,
        /// Name of the topic.
        topic: String,
        /// Its type.
        type_name: String,
        /// What is wrong and what to do.
        reason: String,
    },
    /// A message is not what its topic's type says.
    #[error("{bag}: message {number} on {topic} ({type_name}): {reason}")]
    Message {
        /// The bag.
        bag: String,
        /// Name of the topic.
        topic: String,
        /// Its type.
        type_name: String,
        /// Number of the message in the bag's order, from 0.
        number: u64,
        /// What is wrong.
        reason: String,
    },
    /// The output already exists.
    #[error("{}: exists already; choose another name or remove it first", path.display())]
    Exists {
        /// The folder.
        path: PathBuf,
    },
    /// The bag can't be written, or not any further.
    #[error("{}: {reason}; {kept}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What happened.
        reason: String,
        /// What is left on the disk.
        kept: String,
    },
    /// The recording that was asked for can't be made.
    #[error("{what}: {value} is out of range; allowed is {allowed}")]
    OutOfRange {
        /// Name of the value.
        what: &'static str,
        /// What was asked for.
        value: String,
        /// The range, and why.
        allowed: String,
    },
}

/// Something of a bag that could not be read, or must not be believed. The rest was used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Loss {
    /// The file ends before its end mark.
    #[error("{file} is cut off: it ends at byte {length} without an end mark; what lies before was read")]
    CutOff {
        /// Name of the file.
        file: String,
        /// Its length.
        length: u64,
    },
    /// From some byte on nothing makes sense any more.
    #[error("{file} can't be read from byte {offset} on ({reason}); what lies before was read")]
    Garbled {
        /// Name of the file.
        file: String,
        /// First byte that was not read.
        offset: u64,
        /// What was found.
        reason: String,
    },
    /// A chunk of messages is lost.
    #[error("{file}: the chunk at byte {offset} is lost{}: {reason}", messages.map_or(String::new(), |n| format!(" ({n} messages)")))]
    Chunk {
        /// Name of the file.
        file: String,
        /// Where the chunk starts.
        offset: u64,
        /// How many messages it held, where the index says so.
        messages: Option<u64>,
        /// Why.
        reason: String,
    },
    /// The end of a chunk is lost, its start was read.
    #[error("{file}: the chunk at byte {offset} breaks off after {read} messages: {reason}")]
    PartOfChunk {
        /// Name of the file.
        file: String,
        /// Where the chunk starts.
        offset: u64,
        /// Messages that were read.
        read: u64,
        /// Why the rest is lost.
        reason: String,
    },
    /// Messages on channels that are not described anywhere.
    #[error("{file}: {messages} messages belong to channels that the file does not describe")]
    UnknownChannel {
        /// Name of the file.
        file: String,
        /// How many.
        messages: u64,
    },
    /// A file was altered or damaged since it was written. What was read of it may be false.
    #[error(
        "{file}: the checksum of its data is {found:08x}, not {saved:08x}: it was altered or damaged, and what is read may be false"
    )]
    Checksum {
        /// Name of the file.
        file: String,
        /// The checksum that was written.
        saved: u32,
        /// That of what is there.
        found: u32,
    },
    /// A file that metadata.yaml lists is not there.
    #[error("{file} is listed in metadata.yaml but is not there")]
    MissingFile {
        /// Name of the file.
        file: String,
    },
    /// A piece of a split recording that is not there.
    #[error("{file} is not there, a piece of the recording: what it held is lost")]
    MissingPiece {
        /// Name that the file would have.
        file: String,
    },
    /// A time of which nothing was recorded.
    #[error("from {from} to {to} s ({length} s) {what}")]
    Hole {
        /// Its beginning, s.
        from: String,
        /// Its end, s.
        to: String,
        /// Its length, s.
        length: String,
        /// What that means.
        what: &'static str,
    },
    /// Messages or samples that can't be used.
    #[error("topic {topic}: {count} messages left out: {reason}")]
    Samples {
        /// Name of the topic.
        topic: String,
        /// How many.
        count: u64,
        /// Why.
        reason: String,
    },
}
