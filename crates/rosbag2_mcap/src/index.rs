//! What an MCAP file holds and where: from its own index where that is sound, otherwise by reading it from the start.

use super::chunk::unpack;
use super::error::Loss;
use super::record::{
    ChannelRecord, ChunkIndexRecord, ChunkRecord, Fields, Footer, Header, MAGIC, MessageRecord, MetadataRecord, PREFIX,
    Records, SchemaRecord, Statistics, op,
};
use super::source::{Source, unpack_limit};
use std::collections::BTreeMap;

/// A piece of the file that holds messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Segment {
    /// Where it starts.
    pub offset: u64,
    /// How long it is.
    pub length: u64,
    /// Earliest log time in it.
    pub start_ns: u64,
    /// True: one chunk record. False: plain records, messages among them.
    pub chunk: bool,
}

/// What a file holds.
#[derive(Debug, Default)]
pub(super) struct FileIndex {
    pub header: Header,
    pub schemas: BTreeMap<u16, SchemaRecord>,
    pub channels: BTreeMap<u16, ChannelRecord>,
    pub segments: Vec<Segment>,
    pub statistics: Statistics,
    pub metadata: Vec<MetadataRecord>,
    /// What is lost for good.
    pub losses: Vec<Loss>,
    /// What is odd but cost nothing.
    pub warnings: Vec<String>,
}

impl FileIndex {
    /// The text of metadata.yaml within the file. rosbag2 writes two such records: at the start a placeholder, at the end
    /// the true one.
    pub(crate) fn own_metadata(&self) -> Option<&str> {
        let record = self.metadata.iter().rfind(|m| m.name == "rosbag2")?;
        record.entries.get("serialized_metadata").map(String::as_str)
    }
}

/// Reads the index of `file`, which starts with [`MAGIC`].
///
/// # Errors
/// If the system can't read the file.
pub(super) fn read_index(source: &Source, file: &str) -> std::io::Result<FileIndex> {
    match from_summary(source)? {
        Some(index) => Ok(index),
        None => Scan::new(source, file).run(),
    }
}

/// The index from the end of the file, if it is there, sound and complete.
fn from_summary(source: &Source) -> std::io::Result<Option<FileIndex>> {
    let length = source.len();
    let start = MAGIC.len() as u64;
    if length < start + Footer::TAIL {
        return Ok(None);
    }
    let footer_start = length - Footer::TAIL;
    let Some(footer) = Footer::parse_tail(&source.read(footer_start, Footer::TAIL)?) else { return Ok(None) };
    if footer.summary_start < start || footer.summary_start >= footer_start {
        return Ok(None);
    }
    // The checksum covers the footer's kind, length and two offsets too.
    let bytes = source.read(footer.summary_start, footer_start - footer.summary_start + PREFIX + 16)?;
    if footer.summary_crc != 0 && crc32fast::hash(&bytes) != footer.summary_crc {
        return Ok(None);
    }
    let Some((header, _)) = read_header(source)? else { return Ok(None) };
    let mut index = FileIndex { header, ..FileIndex::default() };
    let mut statistics = None;
    for (kind, body) in Records::new(&bytes[..bytes.len() - (PREFIX as usize + 16)]) {
        if !index.describe(kind, body) {
            return Ok(None);
        }
        match kind {
            op::STATISTICS => statistics = Statistics::parse(body),
            op::CHUNK_INDEX => match ChunkIndexRecord::parse(body).filter(|c| within(c, footer.summary_start)) {
                Some(c) => {
                    index.segments.push(Segment {
                        offset: c.offset,
                        length: c.length,
                        start_ns: c.start_ns,
                        chunk: true,
                    });
                }
                None => return Ok(None),
            },
            op::METADATA_INDEX => index.metadata.extend(metadata_at(source, body)?),
            _ => {}
        }
    }
    let Some(statistics) = statistics else { return Ok(None) };
    index.segments.sort_by_key(|s| s.offset);
    let complete = statistics.chunks as usize == index.segments.len()
        && statistics.channels as usize <= index.channels.len()
        && (statistics.messages == 0 || !index.segments.is_empty());
    index.statistics = statistics;
    Ok(complete.then_some(index))
}

fn within(chunk: &ChunkIndexRecord, end: u64) -> bool {
    chunk.offset >= MAGIC.len() as u64
        && chunk.length >= PREFIX
        && chunk.offset.checked_add(chunk.length).is_some_and(|chunk_end| chunk_end <= end)
}

/// The metadata record that an index entry (offset, length, name) points to.
fn metadata_at(source: &Source, entry: &[u8]) -> std::io::Result<Option<MetadataRecord>> {
    let mut f = Fields(entry);
    let (Some(offset), Some(length)) = (f.u64(), f.u64()) else { return Ok(None) };
    if offset.checked_add(length).is_none_or(|end| end > source.len()) {
        return Ok(None);
    }
    let bytes = source.read(offset, length)?;
    let record = Records::new(&bytes).next();
    Ok(record.filter(|(kind, _)| *kind == op::METADATA).and_then(|(_, body)| MetadataRecord::parse(body)))
}

/// The header record and the offset behind it.
fn read_header(source: &Source) -> std::io::Result<Option<(Header, u64)>> {
    let start = MAGIC.len() as u64;
    let Some((op::HEADER, body)) = prefix_at(source, start)? else { return Ok(None) };
    let end = (start + PREFIX).checked_add(body).filter(|end| *end <= source.len());
    let Some(end) = end else { return Ok(None) };
    let header = Header::parse(&source.read(start + PREFIX, body)?);
    Ok(header.map(|header| (header, end)))
}

/// Kind and content length of the record at `offset`, if so much is there.
fn prefix_at(source: &Source, offset: u64) -> std::io::Result<Option<(u8, u64)>> {
    if offset + PREFIX > source.len() {
        return Ok(None);
    }
    let bytes = source.read(offset, PREFIX)?;
    let mut f = Fields(&bytes);
    Ok(f.u8().zip(f.u64()))
}

impl FileIndex {
    /// Takes in schemas and channels. False if the record makes no sense.
    fn describe(&mut self, kind: u8, body: &[u8]) -> bool {
        match kind {
            op::SCHEMA => match SchemaRecord::parse(body) {
                Some(schema) => drop(self.schemas.insert(schema.id, schema)),
                None => return false,
            },
            op::CHANNEL => match ChannelRecord::parse(body) {
                Some(channel) => drop(self.channels.insert(channel.id, channel)),
                None => return false,
            },
            _ => {}
        }
        true
    }

    fn count(&mut self, message: &MessageRecord) {
        let s = &mut self.statistics;
        (s.start_ns, s.end_ns) = match s.messages {
            0 => (message.log_ns, message.log_ns),
            _ => (s.start_ns.min(message.log_ns), s.end_ns.max(message.log_ns)),
        };
        s.messages += 1;
        *s.per_channel.entry(message.channel).or_default() += 1;
    }
}

/// Reads a file from its start, record by record.
struct Scan<'a> {
    source: &'a Source,
    file: &'a str,
    index: FileIndex,
    /// Where the plain records since the last chunk start, and their earliest message.
    plain: Option<(u64, Option<u64>)>,
}

impl<'a> Scan<'a> {
    fn new(source: &'a Source, file: &'a str) -> Self {
        Self { source, file, index: FileIndex::default(), plain: None }
    }

    fn run(mut self) -> std::io::Result<FileIndex> {
        let mut offset = MAGIC.len() as u64;
        let mut ended = false;
        match read_header(self.source)? {
            Some((header, end)) => (self.index.header, offset) = (header, end),
            None => self.index.warnings.push(format!("{} has no readable header", self.file)),
        }
        while let Some((kind, length)) = prefix_at(self.source, offset)? {
            let end = (offset + PREFIX).checked_add(length);
            let Some(end) = end.filter(|end| *end <= self.source.len()) else {
                if kind == op::CHUNK {
                    self.chunk(offset, self.source.len())?;
                    offset = self.source.len();
                }
                break;
            };
            match kind {
                op::DATA_END | op::FOOTER => {
                    ended = true;
                    break;
                }
                op::CHUNK => self.chunk(offset, end)?,
                0 => break,
                _ => self.plain(kind, offset, end)?,
            }
            offset = end;
        }
        self.close_plain(offset);
        if ended && self.has_end_mark()? {
            let text = format!("{} has no sound index: it was read from its start", self.file);
            self.index.warnings.push(text);
        } else {
            let loss = self.breaks_off_at(offset)?;
            self.index.losses.push(loss);
        }
        Ok(self.index)
    }

    fn has_end_mark(&self) -> std::io::Result<bool> {
        let mark = MAGIC.len() as u64;
        let length = self.source.len();
        Ok(length >= 2 * mark && self.source.read(length - mark, mark)? == MAGIC)
    }

    /// What to say of a file without an end.
    fn breaks_off_at(&self, offset: u64) -> std::io::Result<Loss> {
        let (file, length) = (self.file.to_owned(), self.source.len());
        let tail =
            self.source.read(length.saturating_sub(8).max(MAGIC.len() as u64).min(length), 8).unwrap_or_default();
        if tail == MAGIC && offset < length {
            let reason = "a record there is longer than the file or of no kind".to_owned();
            return Ok(Loss::Garbled { file, offset, reason });
        }
        Ok(Loss::CutOff { file, length })
    }

    /// A chunk from `offset` to `end`, which may lie before the end that it declares.
    fn chunk(&mut self, offset: u64, end: u64) -> std::io::Result<()> {
        self.close_plain(offset);
        let lost = |reason| Loss::Chunk { file: self.file.to_owned(), offset, messages: None, reason };
        let body = self.source.read(offset + PREFIX, end - offset - PREFIX)?;
        let Some(chunk) = ChunkRecord::parse(&body) else {
            let loss = lost("its header is cut off or makes no sense".to_owned());
            self.index.losses.push(loss);
            return Ok(());
        };
        match unpack(&chunk, unpack_limit(self.source.len())) {
            Err(reason) => {
                let loss = lost(reason);
                self.index.losses.push(loss);
            }
            Ok(unpacked) => {
                let before = self.index.statistics.messages;
                let mut start_ns = None;
                for (kind, body) in Records::new(&unpacked.records) {
                    self.index.describe(kind, body);
                    if let Some(message) = MessageRecord::parse(body).filter(|_| kind == op::MESSAGE) {
                        start_ns = Some(start_ns.map_or(message.log_ns, |t: u64| t.min(message.log_ns)));
                        self.index.count(&message);
                    }
                }
                if let Some(reason) = unpacked.cut {
                    let read = self.index.statistics.messages - before;
                    self.index.losses.push(Loss::PartOfChunk { file: self.file.to_owned(), offset, read, reason });
                }
                if let Some(start_ns) = start_ns {
                    self.index.segments.push(Segment { offset, length: end - offset, start_ns, chunk: true });
                }
            }
        }
        Ok(())
    }

    /// A record outside a chunk.
    fn plain(&mut self, kind: u8, offset: u64, end: u64) -> std::io::Result<()> {
        let (first, mut start_ns) = self.plain.unwrap_or((offset, None));
        // Attachments and indexes can be large and are of no use here.
        if matches!(kind, op::SCHEMA | op::CHANNEL | op::MESSAGE | op::METADATA) {
            let body = self.source.read(offset + PREFIX, end - offset - PREFIX)?;
            self.index.describe(kind, &body);
            if kind == op::METADATA {
                self.index.metadata.extend(MetadataRecord::parse(&body));
            }
            if let Some(message) = MessageRecord::parse(&body).filter(|_| kind == op::MESSAGE) {
                start_ns = Some(start_ns.map_or(message.log_ns, |t: u64| t.min(message.log_ns)));
                self.index.count(&message);
            }
        }
        self.plain = Some((first, start_ns));
        // Pieces stay small, so that reading them back does.
        if end - first > 1 << 20 {
            self.close_plain(end);
        }
        Ok(())
    }

    fn close_plain(&mut self, end: u64) {
        if let Some((offset, Some(start_ns))) = self.plain.take() {
            self.index.segments.push(Segment { offset, length: end - offset, start_ns, chunk: false });
        }
    }
}
