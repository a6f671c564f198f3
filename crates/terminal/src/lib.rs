//! Text from outside on its way to a terminal or a log: what a terminal would obey is shown instead.
//!
//! Names of topics, joints, frames, targets and scenes come from networks and files. An escape sequence in one of them could
//! hide a line, a line break could forge one, and a mark of writing direction could turn one round.
#![forbid(unsafe_code)]
#![warn(unreachable_pub)] // what is pub is for another crate

use std::borrow::Cow;

/// The text on one line: control characters and marks of direction as `\u001b`, line breaks and tabs as `\n`, `\r`, `\t`.
#[must_use]
pub fn line(text: &str) -> Cow<'_, str> {
    escaped(text, &[])
}

/// The same for a text whose own line breaks and tabs stay. What it escapes is escaped as JSON does it, so that JSON stays JSON.
#[must_use]
pub fn block(text: &str) -> Cow<'_, str> {
    escaped(text, &['\n', '\r', '\t'])
}

fn escaped<'a>(text: &'a str, kept: &[char]) -> Cow<'a, str> {
    let obeyed = |c: char| (c.is_control() && !kept.contains(&c)) || turns(c);
    if !text.contains(obeyed) {
        return Cow::Borrowed(text);
    }
    let mut shown = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        match c {
            '\n' | '\r' | '\t' if obeyed(c) => shown.extend(c.escape_default()),
            c if obeyed(c) => shown.push_str(&format!("\\u{:04x}", u32::from(c))),
            c => shown.push(c),
        }
    }
    Cow::Owned(shown)
}

/// Marks that change the direction of what follows (Unicode's bidirectional controls), and separators of lines.
const fn turns(c: char) -> bool {
    matches!(c, '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// Whether the process is to outlive its terminal: `nohup` has it ignore SIGHUP from the start.
#[must_use]
pub fn hangup_is_ignored() -> bool {
    const SIGHUP: u32 = 1;
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| u64::from_str_radix(line.strip_prefix("SigIgn:")?.trim(), 16).ok());
    ignored.is_some_and(|bits| bits >> (SIGHUP - 1) & 1 == 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_that_a_terminal_obeys_gets_through() {
        assert_eq!(line("a\x1b[2J\nerror: b\u{9b}1m\u{202e}c\u{7f}"), r"a\u001b[2J\nerror: b\u009b1m\u202ec\u007f");
        assert_eq!(block("a\tb\n\x1b[0m"), "a\tb\n\\u001b[0m");
        assert!(matches!(line("Ångström, µm, 力"), Cow::Borrowed(_)));
        let json = serde_json::json!({ "name": "x\u{9b}\x1b\n" }).to_string();
        let read: serde_json::Value = serde_json::from_str(&block(&json)).unwrap_or_default();
        assert_eq!(read["name"], "x\u{9b}\x1b\n");
    }
}
