//! Bytes of a bag file, on disk or compiled in.

use super::chunk::window_log;
use std::borrow::Cow;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// Memory that unpacked chunks of a file may take: this, and [`UNPACK_FACTOR`] times the file's size.
const UNPACK_BASE: u64 = 16 << 20;
/// See [`UNPACK_BASE`].
const UNPACK_FACTOR: u64 = 64;

/// Memory that the unpacked chunks of a file of this length may take.
pub(super) fn unpack_limit(file_length: u64) -> u64 {
    UNPACK_BASE.saturating_add(file_length.saturating_mul(UNPACK_FACTOR))
}

/// First bytes of what zstd has packed.
pub(super) const ZSTD: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

/// What zstd has packed, if it is no more than `limit` bytes. What is cut off gives its start.
pub(super) fn unpacked(packed: impl Read, limit: u64) -> io::Result<Vec<u8>> {
    let mut decoder = zstd::stream::read::Decoder::new(packed)?;
    decoder.window_log_max(window_log(limit))?;
    let mut bytes = Vec::new();
    let read = decoder.take(limit + 1).read_to_end(&mut bytes);
    if bytes.len() as u64 > limit {
        return Err(io::Error::other(format!("it has more than {limit} bytes")));
    }
    // a file that breaks off is salvaged as one that was never packed
    if bytes.is_empty() { read.map(|_| bytes) } else { Ok(bytes) }
}

/// Something with bytes at positions.
#[derive(Debug)]
pub(super) enum Source {
    /// A file and its length when it was opened.
    File(Mutex<File>, u64),
    /// Bytes in memory.
    Memory(Cow<'static, [u8]>),
}

impl Source {
    /// Opens a file; one that zstd has packed (rosbag2's compression of files) is unpacked into memory, as far as a file of its size may.
    pub(super) fn open(path: &Path) -> io::Result<Self> {
        let mut file = File::open(path)?;
        let length = file.metadata()?.len();
        let mut start = [0; 4];
        let packed = file.read_exact(&mut start).is_ok() && start == ZSTD;
        file.rewind()?;
        if !packed {
            return Ok(Self::File(Mutex::new(file), length));
        }
        let unpacked = unpacked(file, unpack_limit(length)).map_err(|e| {
            io::Error::other(format!(
                "it is packed with zstd and can't be unpacked ({e}): unpack it with `zstd -d`, or take another copy"
            ))
        })?;
        Ok(Self::Memory(Cow::Owned(unpacked)))
    }

    pub(super) fn len(&self) -> u64 {
        match self {
            Self::File(_, length) => *length,
            Self::Memory(bytes) => bytes.len() as u64,
        }
    }

    /// `length` bytes from `offset` on. Nothing is allocated for bytes that are not there.
    pub(super) fn read(&self, offset: u64, length: u64) -> io::Result<Vec<u8>> {
        if offset.checked_add(length).is_none_or(|end| end > self.len()) {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        match self {
            Self::File(file, _) => {
                let mut file = file.lock().unwrap_or_else(PoisonError::into_inner);
                file.seek(SeekFrom::Start(offset))?;
                let mut bytes = vec![0; length as usize];
                file.read_exact(&mut bytes)?;
                Ok(bytes)
            }
            Self::Memory(bytes) => Ok(bytes[offset as usize..(offset + length) as usize].to_vec()),
        }
    }
}
