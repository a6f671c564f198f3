//! The messages of a bag, merged from its files and chunks.

use super::error::Loss;
use super::index::Segment;
use super::reader::{BagReader, Message, Topic};
use super::segment::{Entry, OpenSegment};
use super::source::{ZSTD, unpack_limit, unpacked};
use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet, BinaryHeap};

/// Messages in the order of their log times. Chunks are read when their time comes.
#[derive(Debug)]
pub struct Messages {
    bag: BagReader,
    wanted: Vec<bool>,
    /// Segments that are not open yet, the earliest last.
    waiting: Vec<(usize, Segment)>,
    open: BTreeMap<u64, OpenSegment>,
    /// Time of the next message of each open segment.
    next: BinaryHeap<Reverse<(u64, u64)>>,
    opened: u64,
    /// Bytes of all open segments.
    held: u64,
    limit: u64,
    unknown: BTreeMap<usize, u64>,
    /// Pieces whose loss was found when the bag was opened: their file's name and offset.
    known: BTreeSet<(String, u64)>,
    losses: Vec<Loss>,
}

/// File and offset of a chunk that is lost in part.
fn piece(loss: &Loss) -> Option<(String, u64)> {
    match loss {
        Loss::PartOfChunk { file, offset, .. } => Some((file.clone(), *offset)),
        _ => None,
    }
}

impl BagReader {
    /// All messages, in the order of their log times (equal times: in the order of the file).
    #[must_use]
    pub fn messages(&self) -> Messages {
        self.select(|_| true)
    }

    /// Messages of the topics that `wanted` accepts, in the order of their log times.
    #[must_use]
    pub fn select(&self, wanted: impl Fn(&Topic) -> bool) -> Messages {
        Messages::new(self, self.topics().iter().map(wanted).collect())
    }
}

impl Messages {
    fn new(bag: &BagReader, wanted: Vec<bool>) -> Self {
        let files = bag.files().iter().enumerate();
        let mut waiting: Vec<(usize, Segment)> =
            files.flat_map(|(f, file)| file.index.segments.iter().map(move |s| (f, *s))).collect();
        waiting.sort_by_key(|(file, s)| Reverse((s.start_ns, *file, s.offset)));
        Self {
            bag: bag.clone(),
            wanted,
            waiting,
            open: BTreeMap::new(),
            next: BinaryHeap::new(),
            opened: 0,
            held: 0,
            limit: unpack_limit(bag.size()),
            unknown: BTreeMap::new(),
            known: bag.losses().iter().filter_map(piece).collect(),
            losses: Vec::new(),
        }
    }

    /// What turned out to be lost while reading, beside [`BagReader::losses`]. Complete at the end.
    #[must_use]
    pub fn losses(&self) -> &[Loss] {
        &self.losses
    }

    /// Opens every segment that may hold the next message.
    fn open_due(&mut self) {
        while let Some(&(file, segment)) = self.waiting.last() {
            let due = self.next.peek().is_none_or(|Reverse((time, _))| segment.start_ns <= *time);
            if !due {
                return;
            }
            self.waiting.pop();
            self.open_segment(file, segment);
        }
    }

    fn open_segment(&mut self, file_number: usize, segment: Segment) {
        let bag = self.bag.clone();
        let Some(file) = bag.files().get(file_number) else { return };
        let left = self.limit.saturating_sub(self.held);
        let opened = OpenSegment::read(file_number, &file.source, segment, left.min(unpack_limit(file.source.len())));
        let (name, offset) = (&file.name, segment.offset);
        let open = match opened {
            Ok(open) => open,
            Err(reason) => {
                self.losses.push(Loss::Chunk { file: name.clone(), offset, messages: None, reason });
                return;
            }
        };
        if let Some(reason) = open.cut.clone() {
            let loss = Loss::PartOfChunk { file: name.clone(), offset, read: open.left(), reason };
            if piece(&loss).is_none_or(|piece| !self.known.contains(&piece)) {
                self.losses.push(loss);
            }
        }
        let (open, unknown) = open.keep(|channel| {
            let topic = file.topics.get(&channel)?;
            Some(self.wanted.get(*topic).copied().unwrap_or(false))
        });
        if unknown > 0 {
            *self.unknown.entry(file_number).or_default() += unknown;
        }
        if let Some(first) = open.peek() {
            self.opened += 1;
            self.held += open.size();
            self.next.push(Reverse((first.log_ns, self.opened)));
            self.open.insert(self.opened, open);
        }
    }

    fn take(&mut self, key: u64) -> Option<Message> {
        let open = self.open.get_mut(&key)?;
        let (entry, data) = open.pop()?;
        let Entry { channel, sequence, log_ns, publish_ns, .. } = entry;
        let file = self.bag.files().get(open.file)?;
        let topic = *file.topics.get(&channel)?;
        match open.peek().map(|next| next.log_ns) {
            Some(time) => self.next.push(Reverse((time, key))),
            None => {
                self.held -= open.size();
                self.open.remove(&key);
            }
        }
        // rosbag2's compression of messages; CDR begins with 0
        let packed = data.starts_with(&ZSTD);
        let data = if packed { unpacked(data.as_slice(), self.limit).unwrap_or(data) } else { data };
        Some(Message { topic, log_ns, publish_ns, sequence, data })
    }

    fn report_unknown(&mut self) {
        for (file, messages) in std::mem::take(&mut self.unknown) {
            let file = self.bag.files().get(file).map_or(String::new(), |f| f.name.clone());
            self.losses.push(Loss::UnknownChannel { file, messages });
        }
    }
}

impl Iterator for Messages {
    type Item = Message;

    fn next(&mut self) -> Option<Message> {
        self.open_due();
        let Some(Reverse((_, key))) = self.next.pop() else {
            self.report_unknown();
            return None;
        };
        self.take(key)
    }
}
