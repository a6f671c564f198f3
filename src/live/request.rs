//! Messages that a viewer may send: that it is ready, or, with the token, a command. Any other message ends its
//! connection.

use serde::Deserialize;

/// Largest request, bytes.
pub(crate) const LONGEST_REQUEST: usize = 1024;
/// Longest text of a mark, characters.
pub const LONGEST_MARK: usize = 80;

/// A command to the process that runs the twin.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Command {
    /// Take the present reading of the load cell as zero.
    Tare,
    /// Reset to the undeformed state.
    Reset,
    /// Record this time, with a text.
    Mark(String),
}

/// One message of a viewer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Request {
    /// It has drawn the last content and is ready for more.
    Next,
    /// A command with the token.
    Command {
        /// The token, as sent.
        token: String,
        /// The command.
        command: Command,
    },
}

#[derive(Deserialize)]
#[serde(tag = "ask", rename_all = "lowercase", deny_unknown_fields)]
enum Raw {
    Next,
    Tare { token: String },
    Reset { token: String },
    Mark { token: String, text: String },
}

impl Request {
    /// Parses `{"ask": "next"}`, `{"ask": "tare", "token": "..."}`, `{"ask": "mark", "token": "...", "text": "..."}`.
    ///
    /// # Errors
    /// What is wrong with it, for the viewer.
    pub fn parse(text: &str) -> Result<Self, &'static str> {
        if text.len() > LONGEST_REQUEST {
            return Err("a request of more than 1024 bytes");
        }
        let raw: Raw = serde_json::from_str(text).map_err(|_| "no request that this page knows")?;
        let (token, command) = match raw {
            Raw::Next => return Ok(Self::Next),
            Raw::Tare { token } => (token, Command::Tare),
            Raw::Reset { token } => (token, Command::Reset),
            Raw::Mark { token, text } => (token, Command::Mark(mark(&text)?)),
        };
        Ok(Self::Command { token, command })
    }
}

/// Validates the text of a mark, since it is shown in logs and on other viewers' pages.
fn mark(text: &str) -> Result<String, &'static str> {
    if text.chars().count() > LONGEST_MARK {
        return Err("a mark of more than 80 characters");
    }
    if text.chars().any(char::is_control) {
        return Err("a mark with control characters");
    }
    Ok(text.trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_request_is_read_whole_or_refused() {
        assert_eq!(Request::parse(r#"{"ask":"next"}"#), Ok(Request::Next));
        let token = "t".to_owned();
        let mark = Command::Mark("here, µm".to_owned());
        let asked = Request::parse(r#"{"ask":"mark","token":"t","text":" here, µm "}"#);
        assert_eq!(asked, Ok(Request::Command { token, command: mark }));
        for wrong in [
            "",
            "next",
            "{}",
            r#"{"ask":"tare"}"#,
            r#"{"ask":"stop","token":"t"}"#,
            r#"{"ask":"tare","token":"t","more":1}"#,
            r#"{"ask":"mark","token":"t","text":"a\u001bb"}"#,
            &format!(r#"{{"ask":"mark","token":"t","text":"{}"}}"#, "x".repeat(81)),
            &format!(r#"{{"ask":"tare","token":"{}"}}"#, "x".repeat(1024)),
        ] {
            assert!(Request::parse(wrong).is_err(), "{wrong}");
        }
    }
}
