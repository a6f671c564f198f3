//! The text of a table a piece at a time: a file of ten million rows is never in memory as a whole.

use std::fs::File;
use std::io::{self, Cursor, Read, Seek as _};
use std::path::Path;

use encoding_rs::{Decoder, Encoding, UTF_8};

use super::encoding;

/// Bytes that are read at once.
const BLOCK: usize = 1 << 18;

/// A text that is read as it is taken.
pub(super) struct Text {
    source: Box<dyn Read>,
    decoder: Decoder,
    block: Vec<u8>,
    /// Whether it is a file's own text, in which a row may be cut off.
    pub(super) is_file: bool,
    /// What was read and not taken.
    text: String,
    begun: bool,
    /// Its lines end with a carriage return alone.
    returns: bool,
    /// The source has ended.
    ended: bool,
}

impl Text {
    /// The text of a file. What can't be read twice, as a pipe, is read into memory.
    pub(crate) fn of_file(path: &Path) -> io::Result<Self> {
        let mut file = File::open(path)?;
        if !file.metadata()?.is_file() {
            let mut bytes = Vec::new();
            file.read_to_end(&mut bytes)?;
            return Self::of_bytes(bytes);
        }
        let (encoding, mark) = encoding::of(&mut file)?;
        file.seek(io::SeekFrom::Start(mark as u64))?;
        Ok(Self::new(Box::new(file), encoding))
    }

    /// The text of what a file holds.
    pub(crate) fn of_bytes(bytes: Vec<u8>) -> io::Result<Self> {
        let (encoding, mark) = encoding::of(&mut &bytes[..])?;
        let mut source = Cursor::new(bytes);
        source.set_position(mark as u64);
        Ok(Self::new(Box::new(source), encoding))
    }

    /// A text that is made here as it is read, UTF-8.
    pub(crate) fn made(source: impl Read + 'static) -> Self {
        Self { is_file: false, ..Self::new(Box::new(source), UTF_8) }
    }

    fn new(source: Box<dyn Read>, encoding: &'static Encoding) -> Self {
        let decoder = encoding.new_decoder_without_bom_handling();
        let (block, text) = (vec![0; BLOCK], String::new());
        Self { source, decoder, block, is_file: true, text, begun: false, returns: false, ended: false }
    }

    /// Reads on; the marks that may stand before a text are no part of it.
    fn read_on(&mut self) -> io::Result<()> {
        let length = self.source.read(&mut self.block)?;
        self.ended = length == 0;
        let needed = self.decoder.max_utf8_buffer_length(length).unwrap_or(4 * BLOCK);
        self.text.reserve(needed);
        let _ = self.decoder.decode_to_string(&self.block[..length], &mut self.text, self.ended);
        if !std::mem::replace(&mut self.begun, true) {
            self.text = self.text.trim_start_matches('\u{feff}').to_owned();
            self.returns = self.text.contains('\r') && !self.text.contains('\n');
        }
        if self.text.contains('\0') {
            // a disk that lost its power
            self.text.retain(|c| c != '\0');
        }
        if self.returns {
            self.text = self.text.replace('\r', "\n");
        }
        Ok(())
    }

    /// The text from here on, so many lines of it at least, or all that is left.
    pub(crate) fn head(&mut self, lines: usize) -> io::Result<&str> {
        let (mut from, mut seen) = (0, 0);
        loop {
            seen += self.text[from..].bytes().filter(|byte| *byte == b'\n').count();
            from = self.text.len();
            if seen >= lines || self.ended {
                return Ok(&self.text);
            }
            self.read_on()?;
        }
    }

    /// What [`Text::head`] has read so far.
    pub(crate) fn read(&self) -> &str {
        &self.text
    }

    /// Goes on by so many bytes of what [`Text::head`] showed.
    pub(crate) fn skip(&mut self, bytes: usize) {
        self.text.drain(..bytes);
    }

    /// The next lines, each whole; `None` at the end.
    pub(crate) fn take(&mut self) -> io::Result<Option<String>> {
        let mut from = 0;
        let end = loop {
            match self.text[from..].rfind('\n') {
                Some(at) => break from + at + 1,
                None if self.ended => break self.text.len(),
                None => {
                    from = self.text.len();
                    self.read_on()?;
                }
            }
        };
        let rest = self.text.split_off(end);
        let lines = std::mem::replace(&mut self.text, rest);
        Ok(Some(lines).filter(|lines| !lines.is_empty()))
    }

    /// Lines that come next, though they were taken already.
    pub(crate) fn put_back(&mut self, mut lines: String) {
        lines.push_str(&self.text);
        self.text = lines;
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn carriage_returns_end_lines_where_nothing_else_does() {
        let whole: String = (0..100_000).map(|i| format!("{i},{}\r", i * 7)).collect();
        let mut text = Text::of_bytes(whole.clone().into_bytes()).unwrap();
        let mut all = String::new();
        while let Some(lines) = text.take().unwrap() {
            all.push_str(&lines);
        }
        assert!(all == whole.replace('\r', "\n"));
        assert_eq!(Text::of_bytes(b"a\r\nb\r".to_vec()).unwrap().take().unwrap().as_deref(), Some("a\r\n"));
    }

    #[test]
    fn pieces_put_together_are_the_text() {
        let whole: String = (0..100_000).map(|i| format!("{i},{},µ\n", i * 7)).collect::<String>() + "the end";
        let mut text = Text::of_bytes([b"\xef\xbb\xbf", whole.as_bytes()].concat()).unwrap();
        assert!(text.head(400).unwrap().starts_with("0,0,µ\n"));
        text.skip("0,0,µ\n".len());
        let first = text.take().unwrap().unwrap();
        assert!(first.ends_with('\n') && first.len() < 2 * BLOCK, "{}", first.len());
        text.put_back(first);
        let mut all = String::new();
        while let Some(lines) = text.take().unwrap() {
            all.push_str(&lines);
        }
        assert!(all == whole["0,0,µ\n".len()..]);
    }
}
