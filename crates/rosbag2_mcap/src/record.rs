//! Records of an MCAP file (<https://mcap.dev/spec>), parsed without trusting a length.
//!
//! mcap's own parser is not used for files from outside: what is read here must survive any bytes, use no more memory
//! than there are bytes, and go on behind a damaged part.

use std::collections::BTreeMap;
use std::sync::Arc;

/// First and last bytes of every MCAP file.
pub(super) const MAGIC: [u8; 8] = *b"\x89MCAP0\r\n";

/// Kinds of record (the first byte).
pub(super) mod op {
    pub(crate) const HEADER: u8 = 0x01;
    pub(crate) const FOOTER: u8 = 0x02;
    pub(crate) const SCHEMA: u8 = 0x03;
    pub(crate) const CHANNEL: u8 = 0x04;
    pub(crate) const MESSAGE: u8 = 0x05;
    pub(crate) const CHUNK: u8 = 0x06;
    pub(crate) const CHUNK_INDEX: u8 = 0x08;
    pub(crate) const STATISTICS: u8 = 0x0b;
    pub(crate) const METADATA: u8 = 0x0c;
    pub(crate) const METADATA_INDEX: u8 = 0x0d;
    pub(crate) const DATA_END: u8 = 0x0f;
}

/// Length of a record's kind and length fields.
pub(super) const PREFIX: u64 = 9;

/// Reads little-endian fields; `None` where the bytes end.
#[derive(Clone, Copy)]
pub(super) struct Fields<'a>(pub &'a [u8]);

impl<'a> Fields<'a> {
    pub(super) fn bytes(&mut self, count: usize) -> Option<&'a [u8]> {
        let (head, tail) = self.0.split_at_checked(count)?;
        self.0 = tail;
        Some(head)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.bytes(N)?.try_into().ok()
    }

    pub(super) fn u8(&mut self) -> Option<u8> {
        self.array::<1>().map(|[b]| b)
    }

    pub(super) fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    pub(super) fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    pub(super) fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    fn block(&mut self) -> Option<&'a [u8]> {
        let length = self.u32()?;
        self.bytes(usize::try_from(length).ok()?)
    }

    fn string(&mut self) -> Option<String> {
        std::str::from_utf8(self.block()?).ok().map(str::to_owned)
    }

    fn map(&mut self) -> Option<BTreeMap<String, String>> {
        let mut entries = Fields(self.block()?);
        let mut map = BTreeMap::new();
        while !entries.0.is_empty() {
            let key = entries.string()?;
            map.insert(key, entries.string()?);
        }
        Some(map)
    }
}

/// File header.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Header {
    pub profile: String,
    pub library: String,
}

impl Header {
    pub(super) fn parse(body: &[u8]) -> Option<Self> {
        let mut f = Fields(body);
        Some(Self { profile: f.string()?, library: f.string()? })
    }
}

/// Description of a type.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct SchemaRecord {
    pub id: u16,
    pub name: String,
    pub encoding: String,
    pub text: Arc<str>,
}

impl SchemaRecord {
    pub(super) fn parse(body: &[u8]) -> Option<Self> {
        let mut f = Fields(body);
        let (id, mut name, encoding) = (f.u16()?, f.string()?, f.string()?);
        // some writers leave out the middle of package/msg/Type
        if let Some((package, of)) = name.split_once('/').filter(|(_, of)| !of.contains('/')) {
            name = format!("{package}/msg/{of}");
        }
        Some(Self { id, name, encoding, text: String::from_utf8_lossy(f.block()?).as_ref().into() })
    }
}

/// A topic within the file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct ChannelRecord {
    pub id: u16,
    pub schema_id: u16,
    pub topic: String,
    pub encoding: String,
    pub metadata: BTreeMap<String, String>,
}

impl ChannelRecord {
    pub(super) fn parse(body: &[u8]) -> Option<Self> {
        let mut f = Fields(body);
        Some(Self { id: f.u16()?, schema_id: f.u16()?, topic: f.string()?, encoding: f.string()?, metadata: f.map()? })
    }
}

/// A message's header; its content is what follows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct MessageRecord<'a> {
    pub channel: u16,
    pub sequence: u32,
    pub log_ns: u64,
    pub publish_ns: u64,
    pub data: &'a [u8],
}

impl<'a> MessageRecord<'a> {
    pub(super) fn parse(body: &'a [u8]) -> Option<Self> {
        let mut f = Fields(body);
        Some(Self { channel: f.u16()?, sequence: f.u32()?, log_ns: f.u64()?, publish_ns: f.u64()?, data: f.0 })
    }
}

/// A chunk's header and its packed records.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct ChunkRecord<'a> {
    pub uncompressed_size: u64,
    pub uncompressed_crc: u32,
    pub compression: String,
    pub data: &'a [u8],
    /// False: the chunk's record ends before its data does.
    pub whole: bool,
}

impl<'a> ChunkRecord<'a> {
    pub(super) fn parse(body: &'a [u8]) -> Option<Self> {
        let mut f = Fields(body);
        let (_start, _end) = (f.u64()?, f.u64()?);
        let (uncompressed_size, uncompressed_crc, compression) = (f.u64()?, f.u32()?, f.string()?);
        let compressed = f.u64()?;
        let available = f.0.len() as u64;
        let data = &f.0[..compressed.min(available) as usize];
        Some(Self { uncompressed_size, uncompressed_crc, compression, data, whole: compressed <= available })
    }
}

/// Where a chunk lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ChunkIndexRecord {
    pub start_ns: u64,
    pub end_ns: u64,
    pub offset: u64,
    pub length: u64,
}

impl ChunkIndexRecord {
    pub(super) fn parse(body: &[u8]) -> Option<Self> {
        let mut f = Fields(body);
        Some(Self { start_ns: f.u64()?, end_ns: f.u64()?, offset: f.u64()?, length: f.u64()? })
    }
}

/// Numbers of things in the file.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Statistics {
    pub messages: u64,
    pub channels: u32,
    pub chunks: u32,
    pub start_ns: u64,
    pub end_ns: u64,
    pub per_channel: BTreeMap<u16, u64>,
}

impl Statistics {
    pub(super) fn parse(body: &[u8]) -> Option<Self> {
        let mut f = Fields(body);
        let messages = f.u64()?;
        let (_schemas, channels) = (f.u16()?, f.u32()?);
        let (_attachments, _metadata, chunks) = (f.u32()?, f.u32()?, f.u32()?);
        let (start_ns, end_ns) = (f.u64()?, f.u64()?);
        let mut counts = Fields(f.block()?);
        let mut per_channel = BTreeMap::new();
        while !counts.0.is_empty() {
            let channel = counts.u16()?;
            per_channel.insert(channel, counts.u64()?);
        }
        Some(Self { messages, channels, chunks, start_ns, end_ns, per_channel })
    }
}

/// Named texts.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct MetadataRecord {
    pub name: String,
    pub entries: BTreeMap<String, String>,
}

impl MetadataRecord {
    pub(super) fn parse(body: &[u8]) -> Option<Self> {
        let mut f = Fields(body);
        Some(Self { name: f.string()?, entries: f.map()? })
    }
}

/// Where the summary starts, and its checksum.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Footer {
    pub summary_start: u64,
    pub summary_crc: u32,
}

impl Footer {
    /// Bytes of the footer's record and the end mark.
    pub(super) const TAIL: u64 = PREFIX + 20 + 8;

    /// From the last [`Footer::TAIL`] bytes of a file.
    pub(super) fn parse_tail(tail: &[u8]) -> Option<Self> {
        let mut f = Fields(tail);
        if f.u8()? != op::FOOTER || f.u64()? != 20 {
            return None;
        }
        let (summary_start, _offsets, summary_crc) = (f.u64()?, f.u64()?, f.u32()?);
        (f.0 == MAGIC).then_some(Self { summary_start, summary_crc })
    }
}

/// The records in a block of bytes, until the block ends or a record reaches beyond it.
pub(super) struct Records<'a> {
    fields: Fields<'a>,
    length: usize,
}

impl<'a> Records<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self { fields: Fields(bytes), length: bytes.len() }
    }

    /// Offset behind the last record.
    pub(super) fn position(&self) -> usize {
        self.length - self.fields.0.len()
    }
}

impl<'a> Iterator for Records<'a> {
    /// Kind and content.
    type Item = (u8, &'a [u8]);

    fn next(&mut self) -> Option<Self::Item> {
        let mut f = self.fields;
        let kind = f.u8()?;
        let length = f.u64()?;
        let body = f.bytes(usize::try_from(length).ok()?)?;
        self.fields = f;
        Some((kind, body))
    }
}
