//! Unpacks a chunk of messages with a limit on memory.

use super::record::ChunkRecord;
use std::io::Read;

/// A chunk's records.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Unpacked {
    /// The records.
    pub records: Vec<u8>,
    /// Why the end is missing, if it is.
    pub cut: Option<String>,
}

/// Unpacks a chunk. One that the file's end cuts off gives its start; one that is damaged gives nothing, since nothing
/// in it can be vouched for.
///
/// # Errors
/// What is wrong with the chunk.
pub(super) fn unpack(chunk: &ChunkRecord, limit: u64) -> Result<Unpacked, String> {
    let size = chunk.uncompressed_size;
    if size > limit {
        return Err(format!("it declares {size} bytes, more than the {limit} that a file of this size may unpack to"));
    }
    // One byte more than declared is enough to see that there is more.
    let (records, error) = match chunk.compression.as_str() {
        "" => (chunk.data[..chunk.data.len().min(size as usize + 1)].to_vec(), None),
        "zstd" => {
            let decoder = zstd::stream::read::Decoder::with_buffer(chunk.data).and_then(|mut decoder| {
                decoder.window_log_max(window_log(limit))?;
                Ok(decoder)
            });
            read(decoder.map_err(|e| e.to_string())?, size)
        }
        "lz4" => read(lz4::Decoder::new(chunk.data).map_err(|e| e.to_string())?, size),
        other => return Err(format!("it is compressed with {other:?}, which is not known here (zstd and lz4 are)")),
    };
    let read = records.len() as u64;
    if !chunk.whole && read < size {
        return Ok(Unpacked { records, cut: Some(format!("the file ends after {read} of its {size} bytes")) });
    }
    if let Some(error) = error {
        return Err(error);
    }
    if read != size {
        return Err(format!(
            "it holds {} bytes, not {size}",
            if read > size { "more".to_owned() } else { read.to_string() }
        ));
    }
    let crc = crc32fast::hash(&records);
    if chunk.uncompressed_crc != 0 && chunk.uncompressed_crc != crc {
        return Err(format!("its checksum is {crc:08x}, not {:08x}", chunk.uncompressed_crc));
    }
    Ok(Unpacked { records, cut: None })
}

/// Reads up to `size` bytes and one more; the buffer grows with what really comes.
fn read(decoder: impl Read, size: u64) -> (Vec<u8>, Option<String>) {
    let mut records = Vec::new();
    let error = decoder.take(size + 1).read_to_end(&mut records).err();
    (records, error.map(|e| format!("it can't be unpacked: {e}")))
}

/// Window that the zstd decoder may allocate: what a chunk may unpack to, at least 8 MiB (any level up to 19 of a
/// common encoder), at most 128 MiB.
pub(super) fn window_log(limit: u64) -> u32 {
    limit.next_power_of_two().ilog2().clamp(23, 27)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn chunk<'a>(compression: &str, data: &'a [u8], size: u64, crc: u32) -> ChunkRecord<'a> {
        ChunkRecord {
            uncompressed_size: size,
            uncompressed_crc: crc,
            compression: compression.into(),
            data,
            whole: true,
        }
    }

    #[test]
    fn packed_and_unpacked() {
        let plain: Vec<u8> = (0..100_000u32).flat_map(|i| (i / 7).to_le_bytes()).collect();
        let crc = crc32fast::hash(&plain);
        let zstd = zstd::encode_all(&plain[..], 3).unwrap();
        let mut lz4 = lz4::EncoderBuilder::new().build(Vec::new()).unwrap();
        std::io::Write::write_all(&mut lz4, &plain).unwrap();
        let lz4 = lz4.finish().0;
        for (name, data) in [("", &plain), ("zstd", &zstd), ("lz4", &lz4)] {
            let good = chunk(name, data, plain.len() as u64, crc);
            assert_eq!(unpack(&good, 1 << 24).unwrap(), Unpacked { records: plain.clone(), cut: None }, "{name}");
            assert!(unpack(&ChunkRecord { uncompressed_crc: crc ^ 1, ..good.clone() }, 1 << 24).is_err());
            assert!(
                unpack(&ChunkRecord { uncompressed_size: good.uncompressed_size - 1, ..good.clone() }, 1 << 24)
                    .is_err()
            );
            assert!(
                unpack(&ChunkRecord { uncompressed_size: good.uncompressed_size + 1, ..good.clone() }, 1 << 24)
                    .is_err()
            );
            assert!(unpack(&ChunkRecord { uncompressed_size: u64::MAX, ..good.clone() }, 1 << 24).is_err());
            let half = ChunkRecord { data: &data[..data.len() / 2], whole: false, ..good };
            let cut = unpack(&half, 1 << 24).unwrap();
            assert!(cut.cut.is_some() && plain.starts_with(&cut.records), "{name}");
        }
        assert!(unpack(&chunk("brotli", &plain, 5, 0), 1 << 24).is_err());
    }

    #[test]
    fn a_bomb_stops_at_what_it_declares() {
        let bomb = zstd::encode_all(&vec![0u8; 64 << 20][..], 19).unwrap();
        assert!(bomb.len() < 10_000);
        assert!(unpack(&chunk("zstd", &bomb, 1000, 0), 1 << 24).unwrap_err().contains("more"));
    }
}
