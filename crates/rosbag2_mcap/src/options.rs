//! How a bag is written.

use std::collections::BTreeMap;
use std::time::Duration;

/// How a bag is written.
#[derive(Clone, Debug)]
pub struct WriterOptions {
    /// Bytes before compression at which a chunk is closed. A crash, or damage to the file, loses whole chunks.
    pub chunk_bytes: u64,
    /// A chunk is also closed when it is this old. `None`: the same messages always give the same file.
    pub flush_after: Option<Duration>,
    /// Said in the bag itself (`custom_data` of metadata.yaml).
    pub custom_data: BTreeMap<String, String>,
    /// Program that writes, with its version, as the file's header has it.
    pub library: String,
    /// Level of zstd: 0 is zstd's own choice, 1 the fastest.
    pub compression_level: u32,
}

impl Default for WriterOptions {
    fn default() -> Self {
        Self {
            chunk_bytes: 1 << 20,
            flush_after: Some(Duration::from_secs(1)),
            custom_data: BTreeMap::new(),
            library: concat!("rosbag2_mcap ", env!("CARGO_PKG_VERSION")).to_owned(),
            compression_level: 0,
        }
    }
}

impl WriterOptions {
    /// As the crate that writes the records takes them.
    pub(super) fn of_file(&self) -> mcap::WriteOptions {
        mcap::WriteOptions::new()
            .profile("ros2")
            .library(&self.library)
            .compression_level(self.compression_level)
            .compression(Some(mcap::Compression::Zstd))
            // More threads would be nondeterministic in time and memory, and a chunk is compressed in milliseconds.
            .compression_threads(0)
            // Chunks are closed here, not by size there: space for them is set aside first.
            .chunk_size(None)
            // Whole chunks go to the disk at once; a file that was never closed has no half-written one in the middle.
            .disable_seeking(true)
    }
}
