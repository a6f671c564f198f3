//! What was looked at, what was found, and what to do about it.

use serde::Serialize;

/// How something is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Verdict {
    /// Nothing has to be changed.
    Ok,
    /// Something works less well than it could, or only under a condition.
    Note,
    /// Something does not work.
    Problem,
}

impl Verdict {
    /// The word, as wide as the widest.
    pub(super) const fn word(self) -> &'static str {
        match self {
            Self::Ok => "ok     ",
            Self::Note => "note   ",
            Self::Problem => "PROBLEM",
        }
    }
}

/// One finding.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(super) struct Row {
    /// What was looked at.
    pub name: String,
    /// What was found.
    pub value: String,
    /// How it is.
    pub verdict: Verdict,
    /// What to change, in one sentence; there is one unless all is well.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub advice: Option<String>,
}

impl Row {
    pub(super) fn ok(name: impl Into<String>, value: impl Into<String>) -> Self {
        Self { name: name.into(), value: value.into(), verdict: Verdict::Ok, advice: None }
    }

    pub(super) fn note(name: impl Into<String>, value: impl Into<String>, advice: impl Into<String>) -> Self {
        Self { verdict: Verdict::Note, advice: Some(advice.into()), ..Self::ok(name, value) }
    }

    pub(super) fn problem(name: impl Into<String>, value: impl Into<String>, advice: impl Into<String>) -> Self {
        Self { verdict: Verdict::Problem, ..Self::note(name, value, advice) }
    }
}

/// Findings on one subject.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(super) struct Group {
    /// The subject.
    pub subject: &'static str,
    /// The findings.
    pub rows: Vec<Row>,
}
