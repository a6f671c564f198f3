//! The checksum of a file's data, which tells an altered file from the one that was written.

use crate::record::{Fields, Footer, PREFIX, op};
use crate::source::Source;

/// Saved and found checksum of everything before the data-end record, where there is one.
pub(super) fn data_checksum(source: &Source) -> std::io::Result<Option<(u32, u32)>> {
    const DATA_END: u64 = PREFIX + 4;
    let Some(tail) = source.len().checked_sub(Footer::TAIL) else { return Ok(None) };
    let Some(footer) = Footer::parse_tail(&source.read(tail, Footer::TAIL)?) else { return Ok(None) };
    let end = if footer.summary_start == 0 { tail } else { footer.summary_start };
    let Some(data_end) = end.checked_sub(DATA_END) else { return Ok(None) };
    let bytes = source.read(data_end, DATA_END)?;
    let mut f = Fields(&bytes);
    let (kind, length, saved) = (f.u8(), f.u64(), f.u32());
    let Some(saved) = saved.filter(|s| *s != 0 && kind == Some(op::DATA_END) && length == Some(4)) else {
        return Ok(None);
    };
    let mut hasher = crc32fast::Hasher::new();
    let mut at = 0;
    while at < data_end {
        let piece = (data_end - at).min(1 << 20);
        hasher.update(&source.read(at, piece)?);
        at += piece;
    }
    Ok(Some((saved, hasher.finalize())))
}
