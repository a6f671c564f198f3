//! One unpacked piece of a bag and its messages in the order of their times.

use super::chunk::unpack;
use super::index::Segment;
use super::record::{ChunkRecord, MessageRecord, PREFIX, Records, op};
use super::source::Source;
use std::ops::Range;

/// A message within the piece.
#[derive(Clone, Debug)]
pub(super) struct Entry {
    pub channel: u16,
    pub sequence: u32,
    pub log_ns: u64,
    pub publish_ns: u64,
    data: Range<usize>,
}

/// A piece of a bag whose messages are being handed out.
#[derive(Debug)]
pub(super) struct OpenSegment {
    /// Number of the file.
    pub file: usize,
    /// Why its end is missing, if it is.
    pub cut: Option<String>,
    records: Vec<u8>,
    /// The next message last.
    entries: Vec<Entry>,
}

impl OpenSegment {
    /// Reads and unpacks a piece.
    ///
    /// # Errors
    /// What is wrong with it.
    pub(super) fn read(file: usize, source: &Source, segment: Segment, limit: u64) -> Result<Self, String> {
        let bytes = source.read(segment.offset, segment.length).map_err(|e| e.to_string())?;
        let mut cut = None;
        let records = if segment.chunk {
            if bytes.first() != Some(&op::CHUNK) {
                return Err("there is no chunk where the index says".to_owned());
            }
            // The index has said how long it is; the record's own length may be beyond the file's end.
            let body = bytes.get(PREFIX as usize..).unwrap_or_default();
            let chunk = ChunkRecord::parse(body).ok_or("its header makes no sense")?;
            let unpacked = unpack(&chunk, limit)?;
            cut = unpacked.cut;
            unpacked.records
        } else {
            bytes
        };
        let mut entries: Vec<Entry> = Vec::new();
        let mut walk = Records::new(&records);
        while let Some((kind, body)) = walk.next() {
            if let Some(message) = MessageRecord::parse(body).filter(|_| kind == op::MESSAGE) {
                let MessageRecord { channel, sequence, log_ns, publish_ns, data } = message;
                let end = walk.position();
                entries.push(Entry { channel, sequence, log_ns, publish_ns, data: end - data.len()..end });
            }
        }
        // Stable: messages of the same time stay in the order of the file.
        entries.sort_by_key(|e| e.log_ns);
        entries.reverse();
        Ok(Self { file, cut, records, entries })
    }

    /// Leaves out what is not wanted: `wanted` says `None` for channels that nobody knows, which are counted.
    pub(super) fn keep(mut self, wanted: impl Fn(u16) -> Option<bool>) -> (Self, u64) {
        let mut unknown = 0;
        self.entries.retain(|entry| {
            wanted(entry.channel).unwrap_or_else(|| {
                unknown += 1;
                false
            })
        });
        (self, unknown)
    }

    /// The next message.
    pub(super) fn peek(&self) -> Option<&Entry> {
        self.entries.last()
    }

    /// Number of messages that are still to come.
    pub(super) fn left(&self) -> u64 {
        self.entries.len() as u64
    }

    /// The next message and its content.
    pub(super) fn pop(&mut self) -> Option<(Entry, Vec<u8>)> {
        let entry = self.entries.pop()?;
        let data = self.records.get(entry.data.clone()).unwrap_or_default().to_vec();
        Some((entry, data))
    }

    /// Bytes of the unpacked piece.
    pub(super) fn size(&self) -> u64 {
        self.records.len() as u64
    }
}
