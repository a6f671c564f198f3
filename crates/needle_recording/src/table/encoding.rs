//! Finds the encoding of a text file.

use std::io::{self, Read};

use encoding_rs::{BIG5, EUC_JP, EUC_KR, Encoding, GBK, IBM866, KOI8_R, SHIFT_JIS};
use encoding_rs::{UTF_8, UTF_16BE, UTF_16LE, WINDOWS_1250, WINDOWS_1251, WINDOWS_1252};

use super::names;

/// Bytes that are looked at at once.
const BLOCK: usize = 1 << 18;
/// Bytes by which UTF-16 without a mark is recognised, and bytes in which headers are sought.
const START: u64 = 512;
const HEAD: usize = 1 << 14;
/// Older encodings in the order in which they are tried.
const OLDER: [&Encoding; 10] =
    [WINDOWS_1252, GBK, WINDOWS_1251, IBM866, KOI8_R, WINDOWS_1250, SHIFT_JIS, BIG5, EUC_KR, EUC_JP];

/// The encoding, and how long its mark is: UTF-8; UTF-16, with its mark or without; the older one in which most headers name a quantity;
/// GBK where every other character is one of Chinese text; else Latin-1, in which the units µm and °C stand in old files.
pub(super) fn of(source: &mut impl Read) -> io::Result<(&'static Encoding, usize)> {
    let mut start = Vec::new();
    source.by_ref().take(START).read_to_end(&mut start)?;
    if let Some(found) = Encoding::for_bom(&start) {
        return Ok(found);
    }
    let none = |from: usize| start.len() > 8 && start.iter().skip(from).step_by(2).all(|byte| *byte == 0);
    if let Some((_, encoding)) = [(1, UTF_16LE), (0, UTF_16BE)].into_iter().find(|(from, _)| none(*from)) {
        return Ok((encoding, 0));
    }
    let (mut chinese, mut unfinished, mut is_utf8) = (Chinese::default(), Vec::new(), true);
    let (mut block, mut head) = (start, Vec::new());
    loop {
        head.extend(block.iter().take(HEAD - head.len()));
        chinese.look_at(&block);
        if is_utf8 {
            // a character may be cut in two by the end of a block
            unfinished.append(&mut block);
            let valid =
                std::str::from_utf8(&unfinished).map_or_else(|e| (e.valid_up_to(), e.error_len()), |s| (s.len(), None));
            is_utf8 = valid.1.is_none();
            unfinished.drain(..valid.0);
        }
        block.resize(BLOCK, 0);
        let length = source.read(&mut block)?;
        block.truncate(length);
        if length == 0 || !(is_utf8 || chinese.possible || head.len() < HEAD) {
            break;
        }
    }
    let encoding = match (is_utf8 && unfinished.is_empty(), by_names(&head), chinese.is_text()) {
        (true, ..) => UTF_8,
        (_, Some(encoding), _) => encoding,
        (.., true) => GBK,
        (.., false) => WINDOWS_1252,
    };
    Ok((encoding, 0))
}

/// The older encoding in which most cells beyond ASCII name a quantity, and the first of two; `None` if none does in any.
fn by_names(head: &[u8]) -> Option<&'static Encoding> {
    let names = |encoding: &'static Encoding| {
        let (text, _) = encoding.decode_without_bom_handling(head);
        let cells = text.split([',', ';', '\t', '|', '\n']);
        // no header has characters that are none, or for private use
        let wrong = |c: char| c == char::REPLACEMENT_CHARACTER || ('\u{e000}'..='\u{f8ff}').contains(&c);
        cells.filter(|cell| !cell.is_ascii() && !cell.contains(wrong) && names::is_known(cell)).count()
    };
    OLDER
        .into_iter()
        .rev()
        .map(|encoding| (names(encoding), encoding))
        .max_by_key(|(count, _)| *count)
        .filter(|(count, _)| *count > 0)
        .map(|(_, encoding)| encoding)
}

/// Whether all bytes beyond ASCII come in pairs of GB 2312, most of them characters of its first level, the common ones: an accent of
/// Latin-1 mostly stands alone, and two in a row (as in German) are of the second level.
struct Chinese {
    possible: bool,
    /// First byte of a pair that has begun.
    first: Option<u8>,
    characters: usize,
    all: usize,
}

impl Default for Chinese {
    fn default() -> Self {
        Self { possible: true, first: None, characters: 0, all: 0 }
    }
}

impl Chinese {
    fn look_at(&mut self, bytes: &[u8]) {
        if !self.possible || (self.first.is_none() && bytes.is_ascii()) {
            return;
        }
        for &byte in bytes {
            match self.first.take() {
                None if byte.is_ascii() => {}
                None => self.first = Some(byte),
                Some(first) if (0xa1..=0xf7).contains(&first) && (0xa1..=0xfe).contains(&byte) => {
                    self.all += 1;
                    self.characters += usize::from((0xb0..=0xd7).contains(&first));
                }
                Some(_) => {
                    self.possible = false;
                    return;
                }
            }
        }
    }

    fn is_text(&self) -> bool {
        self.possible && self.first.is_none() && 2 * self.characters > self.all
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    /// Read a few bytes at a time: what is cut in two is put together.
    struct Bit<'a>(&'a [u8]);

    impl Read for Bit<'_> {
        fn read(&mut self, to: &mut [u8]) -> io::Result<usize> {
            let length = to.len().min(3);
            self.0.read(&mut to[..length])
        }
    }

    fn text(bytes: Vec<u8>) -> String {
        let (encoding, mark) = of(&mut Bit(&bytes)).unwrap();
        encoding.decode_without_bom_handling(&bytes[mark..]).0.into_owned()
    }

    #[test]
    fn the_encodings_of_old_files() {
        let word = "时间 (s),位移（毫米）,力 (N)";
        assert_eq!(text(GBK.encode(word).0.into_owned()), word);
        for word in ["Weg [µm]", "Prüfzeit;Standardweg", "température °C", "Größe", "Tid;Förlängning;Last"] {
            assert_eq!(text(WINDOWS_1252.encode(word).0.into_owned()), word);
            assert_eq!(text(word.as_bytes().to_vec()), word);
            let wide: Vec<u8> = word.encode_utf16().flat_map(u16::to_le_bytes).collect();
            assert_eq!(text([&[0xff, 0xfe][..], &wide].concat()), word);
        }
        for (encoding, word) in [
            (WINDOWS_1251, "Время, с;Перемещение, мм;Нагрузка, Н"),
            (WINDOWS_1251, "Сила (Н)"),
            (IBM866, "Время (с);Ход (мм);Усилие (Н)"),
            (KOI8_R, "Время (с);Ход (мм);Усилие (Н)"),
            (WINDOWS_1250, "Czas [s];Droga [mm];Siła [N]"),
            (SHIFT_JIS, "時間(s),ストローク(mm),荷重(N)"),
            (EUC_JP, "時間(s),変位(mm),荷重(N)"),
            (EUC_KR, "시간(s),변위(mm),하중(N)"),
            (BIG5, "時間(s),位移(mm),荷重(N)"),
        ] {
            assert_eq!(text(encoding.encode(word).0.into_owned()), word, "{encoding:?}");
        }
        let wide: Vec<u8> = "Time (s),Load".encode_utf16().flat_map(u16::to_be_bytes).collect();
        assert_eq!(text(wide), "Time (s),Load");
    }
}
