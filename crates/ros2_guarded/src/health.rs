//! State of the middleware process, for people.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use ros2_messages::diagnostic_msgs::{DiagnosticStatus, KeyValue};

/// A replacement is news for so long.
const NEWS: Duration = Duration::from_secs(10);

/// See the module.
#[derive(Debug, Default)]
pub struct Health {
    replaced: AtomicU64,
    overrun: Arc<AtomicU64>,
    last: Mutex<Option<Replacement>>,
}

/// The last replacement.
#[derive(Clone, Debug)]
struct Replacement {
    /// Why, in words that follow "the middleware process".
    reason: String,
    /// When the process was noticed to be gone.
    lost: Instant,
    /// When the next one was ready; `None` if it is not yet.
    back: Option<Instant>,
}

impl Health {
    /// `overrun` counts what came faster than it was taken.
    pub(super) fn new(overrun: &Arc<AtomicU64>) -> Self {
        Self { overrun: Arc::clone(overrun), ..Self::default() }
    }

    /// A process is gone.
    pub(super) fn lost(&self, reason: &str) {
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        let ongoing = last.take().filter(|last| last.back.is_none());
        if ongoing.is_none() {
            self.replaced.fetch_add(1, Ordering::Relaxed);
        }
        let lost = ongoing.map_or_else(Instant::now, |last| last.lost);
        *last = Some(Replacement { reason: reason.to_owned(), lost, back: None });
    }

    /// A process is ready; how long there was none, unless it is the first.
    pub(super) fn back(&self) -> Option<Duration> {
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        let last = last.as_mut().filter(|last| last.back.is_none())?;
        last.back = Some(Instant::now());
        Some(last.lost.elapsed())
    }

    /// Why the process was replaced, as long as that is worth a warning.
    pub fn trouble(&self) -> Option<String> {
        self.last().filter(|last| last.back.is_none_or(|back| back.elapsed() < NEWS)).map(|last| last.reason)
    }

    /// For `/diagnostics`.
    pub fn diagnostic(&self, node: &str, hardware_id: &str) -> DiagnosticStatus {
        let value = |key: &str, value: String| KeyValue { key: key.to_owned(), value };
        let mut values = vec![
            value("replaced", self.replaced.load(Ordering::Relaxed).to_string()),
            value("not taken in time", self.overrun.load(Ordering::Relaxed).to_string()),
        ];
        if let Some(last) = self.last() {
            values.push(value("last replaced because it", last.reason));
            let apart = last.back.map(|back| (back - last.lost).as_secs_f64());
            values.extend(apart.map(|s| value("time without it (s)", format!("{s:.3}"))));
        }
        let (level, message) = match self.trouble() {
            Some(reason) => (DiagnosticStatus::WARN, format!("the middleware process {reason}: it was replaced")),
            None => (DiagnosticStatus::OK, "OK".to_owned()),
        };
        let (name, hardware_id) = (format!("{node}: middleware"), hardware_id.to_owned());
        DiagnosticStatus { level, name, message, hardware_id, values }
    }

    fn last(&self) -> Option<Replacement> {
        self.last.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tries_in_a_row_are_one_replacement() {
        let health = Health::new(&Arc::default());
        assert_eq!((health.back(), health.trouble()), (None, None), "the first process replaces none");
        for reason in ["was killed", "has ended with exit code 1"] {
            health.lost(reason);
        }
        assert!(health.back().is_some() && health.back().is_none());
        let said = health.diagnostic("twin", "");
        assert!(said.level == DiagnosticStatus::WARN && said.message.contains("exit code 1"), "{said:?}");
        assert!(said.values.iter().any(|v| v.key == "replaced" && v.value == "1"), "{said:?}");
    }
}
