//! Words of a text with the line of each, and numbers that may stand in it as bytes.

use std::str::FromStr;

use super::imported::Flaw;

/// Reads a file in words and lines; its numbers too, as text or in little endian bytes.
pub(super) struct Words<'a> {
    bytes: &'a [u8],
    at: usize,
    /// Line of what was read last, from 1.
    line: usize,
    /// Whether [`Words::whole`], [`Words::size`] and [`Words::real`] read bytes.
    pub(super) binary: bool,
}

impl<'a> Words<'a> {
    pub(super) const fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0, line: 1, binary: false }
    }

    /// A flaw at the present line, or byte where lines say nothing.
    pub(super) fn flaw(&self, reason: impl Into<String>) -> Flaw {
        let reason = reason.into();
        match self.binary {
            true => Flaw::of_file(format!("at byte {}: {reason}", self.at)),
            false => Flaw { line: Some(self.line), reason },
        }
    }

    /// The next word; `None` at the end of the file. What is no text is no word that anything is called by.
    pub(super) fn next(&mut self) -> Option<&'a str> {
        let blank = self.rest().iter().take_while(|b| b.is_ascii_whitespace()).count();
        self.line += self.rest()[..blank].iter().filter(|b| **b == b'\n').count();
        self.at += blank;
        let length = self.rest().iter().take_while(|b| !b.is_ascii_whitespace()).count();
        let word = &self.rest()[..length];
        self.at += length;
        (length > 0).then(|| std::str::from_utf8(word).unwrap_or("\u{fffd}"))
    }

    fn rest(&self) -> &'a [u8] {
        &self.bytes[self.at..]
    }

    /// What is left of the present line, without its end.
    pub(super) fn rest_of_line(&mut self) -> Result<&'a str, Flaw> {
        let line = self.rest().split(|b| *b == b'\n').next().unwrap_or_default();
        self.at += line.len();
        std::str::from_utf8(line).map(str::trim).map_err(|e| self.flaw(format!("not UTF-8 text: {e}")))
    }

    /// Goes on behind the end of the present line, where bytes begin.
    pub(super) fn end_line(&mut self) -> Result<(), Flaw> {
        let rest = self.rest_of_line()?;
        self.at = (self.at + 1).min(self.bytes.len());
        self.line += 1;
        if rest.is_empty() { Ok(()) } else { Err(self.flaw(format!("\"{}\" where the line should end", short(rest)))) }
    }

    /// Goes on at a text, if it comes.
    pub(super) fn skip_to(&mut self, text: &str) -> bool {
        let found = self.rest().windows(text.len()).position(|w| w == text.as_bytes());
        self.line += self.rest()[..found.unwrap_or(0)].iter().filter(|b| **b == b'\n').count();
        self.at += found.unwrap_or(0);
        found.is_some()
    }

    /// The next word as a number. `what` says in messages what it should be.
    pub(super) fn number<T: FromStr>(&mut self, what: &str) -> Result<T, Flaw> {
        let Some(word) = self.next() else { return Err(self.cut_short(what)) };
        word.parse().map_err(|_| self.flaw(format!("\"{}\" is not {what}", short(word))))
    }

    fn cut_short(&self, what: &str) -> Flaw {
        self.flaw(format!("the file ends where {what} should be: it was cut short"))
    }

    fn take<const N: usize>(&mut self, what: &str) -> Result<[u8; N], Flaw> {
        let Some(bytes) = self.rest().first_chunk::<N>() else { return Err(self.cut_short(what)) };
        self.at += N;
        Ok(*bytes)
    }

    /// The next whole number: a word, or four bytes.
    pub(super) fn whole(&mut self, what: &str) -> Result<i64, Flaw> {
        if self.binary { Ok(i32::from_le_bytes(self.take(what)?).into()) } else { self.number(what) }
    }

    /// The next count or tag: a word, or eight bytes.
    pub(super) fn size(&mut self, what: &str) -> Result<u64, Flaw> {
        if self.binary { Ok(u64::from_le_bytes(self.take(what)?)) } else { self.number(what) }
    }

    /// The next real number: a word, or eight bytes.
    pub(super) fn real(&mut self, what: &str) -> Result<f64, Flaw> {
        if self.binary { Ok(f64::from_le_bytes(self.take(what)?)) } else { self.number(what) }
    }

    /// Skips so many real numbers.
    pub(super) fn skip_reals(&mut self, count: usize, what: &str) -> Result<(), Flaw> {
        (0..count).try_for_each(|_| self.real(what).map(drop))
    }
}

/// The beginning of a word, to be quoted.
pub(super) fn short(word: &str) -> String {
    word.chars().take(40).collect()
}
