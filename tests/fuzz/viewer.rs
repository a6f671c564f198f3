//! What a viewer of the live page says: a request or a refusal.

use needle_twin::live::{Command, LONGEST_MARK, Request};

/// Reads it; what was taken keeps its bounds.
pub fn exercise(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    if let Ok(Request::Command { command: Command::Mark(mark), .. }) = Request::parse(text) {
        assert!(mark.chars().count() <= LONGEST_MARK && !mark.chars().any(char::is_control));
    }
}
