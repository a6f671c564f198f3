//! Text word by word, with the line of each word.

use std::str::FromStr;

use super::Flaw;

/// Reads a text in words and lines.
pub(super) struct Words<'a> {
    rest: &'a str,
    /// Line of what was read last, from 1.
    line: usize,
}

impl<'a> Words<'a> {
    pub(super) fn new(text: &'a str) -> Self {
        Self { rest: text, line: 1 }
    }

    /// A flaw at the present line.
    pub(super) fn flaw(&self, reason: impl Into<String>) -> Flaw {
        Flaw { line: Some(self.line), reason: reason.into() }
    }

    /// The next word; `None` at the end of the text.
    pub(super) fn next(&mut self) -> Option<&'a str> {
        let start = self.rest.find(|c: char| !c.is_ascii_whitespace()).unwrap_or(self.rest.len());
        self.line += self.rest.as_bytes()[..start].iter().filter(|b| **b == b'\n').count();
        let rest = &self.rest[start..];
        let end = rest.find(|c: char| c.is_ascii_whitespace()).unwrap_or(rest.len());
        self.rest = &rest[end..];
        (end > 0).then(|| &rest[..end])
    }

    /// What is left of the present line.
    pub(super) fn rest_of_line(&mut self) -> &'a str {
        let end = self.rest.find('\n').unwrap_or(self.rest.len());
        let line = &self.rest[..end];
        self.rest = &self.rest[end..];
        line.trim()
    }

    /// The next word as a number. `what` says in messages what it should be.
    pub(super) fn number<T: FromStr>(&mut self, what: &str) -> Result<T, Flaw> {
        let Some(word) = self.next() else {
            return Err(self.flaw(format!("the file ends where {what} should be: it was cut short")));
        };
        let short: String = word.chars().take(40).collect();
        word.parse().map_err(|_| self.flaw(format!("\"{short}\" is not {what}")))
    }

    /// Skips so many words.
    pub(super) fn skip(&mut self, count: usize, what: &str) -> Result<(), Flaw> {
        for _ in 0..count {
            self.number::<f64>(what)?;
        }
        Ok(())
    }
}
