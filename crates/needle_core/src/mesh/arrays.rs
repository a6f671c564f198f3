//! Arrays of VTK's XML formats (VTK file formats, "XML file formats"): ASCII, base64 inline or appended, raw
//! appended; uncompressed or zlib.

use std::io::Read as _;

use base64::{Engine as _, engine::general_purpose::STANDARD};
use flate2::read::ZlibDecoder;

use super::imported::Flaw;

/// Bytes that an array may unpack to, per byte of the file.
const LARGEST_RATIO: usize = 64;

/// How a file's arrays are written.
pub(super) struct Encoding<'a> {
    /// Big endian numbers.
    pub(super) big: bool,
    /// Bytes of a number in a header: 4 or 8.
    pub(super) header: usize,
    /// Whether binary arrays are compressed with zlib.
    pub(super) zlib: bool,
    pub(super) appended: Option<Appended<'a>>,
    /// Length of the file, bytes.
    pub(super) length: usize,
}

/// Content of `AppendedData`.
pub(super) struct Appended<'a> {
    /// What follows its underscore.
    pub(super) content: &'a [u8],
    pub(super) base64: bool,
}

/// Binary content at a place of the file: bytes, or base64 text.
struct Stream<'a> {
    rest: &'a [u8],
    base64: bool,
}

impl Stream<'_> {
    /// What so many bytes take here.
    fn taken(&self, bytes: usize) -> Result<&[u8], String> {
        let length = if self.base64 { bytes.div_ceil(3).checked_mul(4) } else { Some(bytes) };
        let taken = length.and_then(|n| self.rest.get(..n));
        taken.ok_or_else(|| {
            format!("it holds {} bytes where {bytes} are declared: the file was cut short", self.rest.len())
        })
    }

    fn peek(&self, bytes: usize) -> Result<Vec<u8>, String> {
        let taken = self.taken(bytes)?;
        if !self.base64 {
            return Ok(taken.to_vec());
        }
        let mut decoded = STANDARD.decode(taken).map_err(|e| format!("not base64: {e}"))?;
        if decoded.len() < bytes {
            return Err("its base64 text ends too early".to_owned());
        }
        decoded.truncate(bytes);
        Ok(decoded)
    }

    fn next(&mut self, bytes: usize) -> Result<Vec<u8>, String> {
        let (out, used) = (self.peek(bytes)?, self.taken(bytes)?.len());
        self.rest = &self.rest[used..];
        Ok(out)
    }
}

impl Encoding<'_> {
    /// The numbers of a `DataArray`.
    pub(super) fn numbers(&self, array: roxmltree::Node<'_, '_>) -> Result<Vec<f64>, Flaw> {
        let name = array.attribute("Name").unwrap_or("without a name");
        let text = array.text().unwrap_or_default();
        let kind = array.attribute("type").unwrap_or_default();
        let numbers = match array.attribute("format").unwrap_or("ascii") {
            "ascii" => ascii(text),
            "binary" => {
                let text: Vec<u8> = text.bytes().filter(|b| !b.is_ascii_whitespace()).collect();
                self.binary(Stream { rest: &text, base64: true }, kind)
            }
            "appended" => self.appended(array.attribute("offset")).and_then(|stream| self.binary(stream, kind)),
            other => Err(format!("format \"{other}\" is not known")),
        };
        numbers.map_err(|reason| {
            let line = array.document().text_pos_at(array.range().start).row as usize;
            Flaw { line: Some(line), reason: format!("array {name}: {reason}") }
        })
    }

    fn appended(&self, offset: Option<&str>) -> Result<Stream<'_>, String> {
        let appended = self.appended.as_ref().ok_or("it is appended, but the file has no AppendedData")?;
        let Appended { content, base64 } = appended;
        let offset = offset.and_then(|text| text.parse::<usize>().ok());
        let offset = offset.ok_or("its offset in AppendedData is not a whole number")?;
        let rest =
            content.get(offset..).ok_or_else(|| format!("its offset {offset} is beyond the end of AppendedData"))?;
        Ok(Stream { rest, base64: *base64 })
    }

    fn binary(&self, mut stream: Stream<'_>, kind: &str) -> Result<Vec<f64>, String> {
        if stream.rest.is_empty() {
            return Ok(Vec::new());
        }
        let bytes = if self.zlib { self.unpack(&mut stream)? } else { self.plain(&mut stream)? };
        self.convert(&bytes, kind)
    }

    /// A header with the length, then the bytes.
    fn plain(&self, stream: &mut Stream<'_>) -> Result<Vec<u8>, String> {
        let length = self.whole(&stream.peek(self.header)?)?;
        // some writers encode the header on its own: then its base64 text is padded
        if stream.base64 && stream.taken(self.header)?.ends_with(b"=") {
            stream.next(self.header)?;
            return stream.next(length);
        }
        let all = length.checked_add(self.header).ok_or("its length is absurd")?;
        Ok(stream.next(all)?.split_off(self.header))
    }

    /// A header with the number of blocks, the size of a block, that of the last one (0: full) and the packed sizes;
    /// then the blocks.
    fn unpack(&self, stream: &mut Stream<'_>) -> Result<Vec<u8>, String> {
        let h = self.header;
        let blocks = self.whole(&stream.peek(h)?)?;
        if blocks > stream.rest.len() {
            return Err(format!("{blocks} compressed blocks are declared, more than there is room for"));
        }
        let header = stream.next(h * (3 + blocks))?;
        let entry = |i: usize| self.whole(&header[h * i..h * (i + 1)]);
        let packed = (0..blocks).map(|i| entry(3 + i)).try_fold(0usize, |sum, size| {
            sum.checked_add(size?).ok_or_else(|| "its compressed size is absurd".to_owned())
        })?;
        let content = stream.next(packed)?;
        let limit = LARGEST_RATIO.saturating_mul(self.length);
        let (mut out, mut at) = (Vec::new(), 0);
        for i in 0..blocks {
            let size = entry(3 + i)?;
            let room = (limit - out.len()) as u64;
            let unpacked = ZlibDecoder::new(&content[at..at + size]).take(room + 1).read_to_end(&mut out);
            unpacked.map_err(|e| format!("its zlib data is damaged: {e}"))?;
            if out.len() > limit {
                return Err(format!("it unpacks to more than {LARGEST_RATIO} times the file"));
            }
            at += size;
        }
        Ok(out)
    }

    fn convert(&self, bytes: &[u8], kind: &str) -> Result<Vec<f64>, String> {
        macro_rules! convert {
            ($type:ty) => {{
                let (words, rest) = bytes.as_chunks::<{ size_of::<$type>() }>();
                if !rest.is_empty() {
                    return Err(format!("{} bytes are not a whole number of {kind}", bytes.len()));
                }
                let number =
                    |word: &_| if self.big { <$type>::from_be_bytes(*word) } else { <$type>::from_le_bytes(*word) };
                Ok(words.iter().map(|word| number(word) as f64).collect())
            }};
        }
        match kind {
            "Float64" => convert!(f64),
            "Float32" => convert!(f32),
            "Int64" => convert!(i64),
            "UInt64" => convert!(u64),
            "Int32" => convert!(i32),
            "UInt32" => convert!(u32),
            "Int16" => convert!(i16),
            "UInt16" => convert!(u16),
            "Int8" => convert!(i8),
            "UInt8" => convert!(u8),
            other => Err(format!("numbers of type \"{other}\" are not read")),
        }
    }

    fn whole(&self, bytes: &[u8]) -> Result<usize, String> {
        let mut word = [0; 8];
        if self.big {
            word[8 - bytes.len()..].copy_from_slice(bytes);
        } else {
            word[..bytes.len()].copy_from_slice(bytes);
        }
        let number = if self.big { u64::from_be_bytes(word) } else { u64::from_le_bytes(word) };
        usize::try_from(number).map_err(|_| "a length is absurd".to_owned())
    }
}

fn ascii(text: &str) -> Result<Vec<f64>, String> {
    let number = |word: &str| {
        let short = || word.chars().take(40).collect::<String>();
        word.parse().map_err(|_| format!("\"{}\" is not a number", short()))
    };
    text.split_ascii_whitespace().map(number).collect()
}
