//! Decodes the bytes of a text file.

use encoding_rs::{Encoding, GBK, UTF_16BE, UTF_16LE, WINDOWS_1252};

/// UTF-8; UTF-16, with or without a byte-order mark; GBK if at least every other character is typical of Chinese
/// text; otherwise Latin-1 (Windows-1252), in which old files write the units µm and °C.
pub(super) fn text(bytes: Vec<u8>) -> String {
    if let Some((encoding, mark)) = Encoding::for_bom(&bytes) {
        return encoding.decode_without_bom_handling(&bytes[mark..]).0.into_owned();
    }
    let start = &bytes[..bytes.len().min(512)];
    let none = |from: usize| start.len() > 8 && start.iter().skip(from).step_by(2).all(|byte| *byte == 0);
    let wide = [(1, UTF_16LE), (0, UTF_16BE)].into_iter().find(|(from, _)| none(*from));
    match (wide, String::from_utf8(bytes)) {
        (Some((_, encoding)), Ok(text)) => encoding.decode(text.as_bytes()).0.into_owned(),
        (Some((_, encoding)), Err(e)) => encoding.decode(e.as_bytes()).0.into_owned(),
        (None, Ok(text)) => text,
        (None, Err(e)) => {
            let encoding = if is_chinese(e.as_bytes()) { GBK } else { WINDOWS_1252 };
            encoding.decode(e.as_bytes()).0.into_owned()
        }
    }
}

/// Whether all bytes beyond ASCII are pairs of GB 2312, most of them characters of its first level, the common ones.
/// Accents of Latin-1 are mostly single, and two in a row (as in German) are of the second level.
fn is_chinese(bytes: &[u8]) -> bool {
    let (mut rest, mut characters, mut all) = (bytes, 0_usize, 0_usize);
    while let [first, tail @ ..] = rest {
        rest = tail;
        if first.is_ascii() {
            continue;
        }
        let [second, tail @ ..] = rest else { return false };
        if !(0xa1..=0xf7).contains(first) || !(0xa1..=0xfe).contains(second) {
            return false;
        }
        rest = tail;
        all += 1;
        characters += usize::from((0xb0..=0xd7).contains(first));
    }
    2 * characters > all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_encodings_of_old_files() {
        let word = "时间 (s),位移（毫米）,力 (N)";
        assert_eq!(text(GBK.encode(word).0.into_owned()), word);
        for word in ["Weg [µm]", "Prüfzeit;Standardweg", "température °C", "Größe"] {
            assert_eq!(text(WINDOWS_1252.encode(word).0.into_owned()), word);
            assert_eq!(text(word.as_bytes().to_vec()), word);
            let wide: Vec<u8> = word.encode_utf16().flat_map(u16::to_le_bytes).collect();
            assert_eq!(text([&[0xff, 0xfe][..], &wide].concat()), word);
        }
        let wide: Vec<u8> = "Time (s),Load".encode_utf16().flat_map(u16::to_be_bytes).collect();
        assert_eq!(text(wide), "Time (s),Load");
    }
}
