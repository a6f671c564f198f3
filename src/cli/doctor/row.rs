//! What was looked at, what was found, and what to do about it.

use std::fmt::Write as _;

use serde::Serialize;
use serde_json::json;

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

fn count(groups: &[Group], verdict: Verdict) -> usize {
    groups.iter().flat_map(|group| &group.rows).filter(|row| row.verdict == verdict).count()
}

pub(super) fn worst(groups: &[Group]) -> Verdict {
    groups.iter().flat_map(|group| &group.rows).map(|row| row.verdict).max().unwrap_or(Verdict::Ok)
}

/// A line for each finding, below it what to change.
pub(super) fn text(groups: &[Group]) -> String {
    let mut text = String::new();
    let width = groups.iter().flat_map(|group| &group.rows).map(|row| row.name.chars().count()).max().unwrap_or(0);
    for group in groups {
        let _ = writeln!(text, "{}", group.subject); // a String takes everything
        for row in &group.rows {
            let value = terminal::line(&row.value);
            let _ = writeln!(text, "  {}  {:width$}  {value}", row.verdict.word(), terminal::line(&row.name));
            if let Some(advice) = &row.advice {
                let _ = writeln!(text, "           {}", terminal::line(advice));
            }
        }
    }
    let [problems, notes] = [Verdict::Problem, Verdict::Note].map(|verdict| count(groups, verdict));
    let plural = |n: usize, word: &str| format!("{n} {word}{}", if n == 1 { "" } else { "s" });
    let _ = writeln!(text, "{}, {}", plural(problems, "problem"), plural(notes, "note"));
    text
}

pub(super) fn json(groups: &[Group]) -> String {
    let [problems, notes] = [Verdict::Problem, Verdict::Note].map(|verdict| count(groups, verdict));
    format!("{:#}\n", json!({ "verdict": worst(groups), "problems": problems, "notes": notes, "groups": groups }))
}
