//! Checks at run time whether the measurement fits the model: units, signs, contact depth, clocks, and the verdict.
//!
//! Samples of the comparison are stored, at most one per [`SPACING_S`]. The housekeeping thread checks them from time
//! to time, in parallel to the solver. The checks never change a prediction.

use std::time::{Duration, Instant};

use needle_estimate::compare::alignment::align;
use needle_estimate::compare::path::ForcePath;
use needle_estimate::compare::rows::Rows;
use needle_estimate::compare::scale::glance;
use needle_estimate::compare::uncertainty::FORCE_ERROR;
use needle_estimate::compare::verdict::judge;
use needle_estimate::compare::{Explains, Verdict};
use ros2_messages::needle_twin::ForceComparison;

/// Least time between two samples, s.
const SPACING_S: f64 = 0.02;
/// Number of stored samples: half a minute; then the older half is dropped.
const KEPT: usize = 1500;
/// Fewest samples in contact for a check of size and sign (half a second), and of the alignment.
const FIRST: usize = 25;
const ENOUGH: usize = 200;
/// Interval of the checks.
const LOOK: Duration = Duration::from_secs(4);

/// (time in s, depth in m, predicted and measured force in N).
type Sample = [f64; 4];

/// Recent comparisons.
#[derive(Clone, Debug, Default)]
pub(super) struct Samples(Vec<Sample>);

impl Samples {
    /// Takes a comparison.
    pub(crate) fn take(&mut self, message: &ForceComparison) {
        if !message.valid {
            return;
        }
        let time_s = message.header.stamp.nanos() as f64 * 1e-9;
        match self.0.last() {
            Some(last) if time_s < last[0] => self.0.clear(),
            Some(last) if time_s - last[0] < SPACING_S => return,
            _ => {}
        }
        if self.0.len() == KEPT {
            self.0.drain(..KEPT / 2);
        }
        self.0.push([time_s, message.depth_m, message.predicted_n, message.measured_n]);
    }

    /// Time of the latest, s.
    fn newest_s(&self) -> Option<f64> {
        self.0.last().map(|s| s[0])
    }

    fn rows(&self) -> Rows {
        let start = self.0.first().map_or(0.0, |s| s[0]);
        let column = |k: usize| self.0.iter().map(|s| s[k]).collect();
        Rows::new(self.0.iter().map(|s| s[0] - start).collect(), column(1), column(2), column(3))
    }
}

/// Checks the samples from time to time.
#[derive(Debug)]
pub(super) struct Watch {
    due: Instant,
    /// Whether the last check had a finding.
    seen: bool,
    said: Vec<String>,
    /// Time of the latest sample at the last check, s.
    newest_s: Option<f64>,
}

impl Watch {
    pub(crate) fn new() -> Self {
        Self { due: Instant::now() + LOOK, seen: false, said: Vec::new(), newest_s: None }
    }

    /// Whether a check is due: the interval has passed, and there are new samples.
    pub(crate) fn is_due(&mut self, samples: &Samples) -> bool {
        let due = Instant::now() >= self.due && samples.newest_s() != self.newest_s;
        if due {
            self.due = Instant::now() + LOOK;
            self.newest_s = samples.newest_s();
        }
        due
    }

    /// Findings in the samples, and the verdict on them; new findings are logged. With `identified`, deviations of
    /// the scene are expected.
    pub(crate) fn look(&mut self, samples: &Samples, identified: bool) -> (Vec<String>, Verdict) {
        let rows = samples.rows();
        let verdict = judge(&rows, 1, FORCE_ERROR);
        let seen = self.warnings(&rows, if identified { Explains::Yes } else { verdict.explains }, &verdict);
        // a finding counts if two consecutive checks have it
        let warnings = if self.seen && !seen.is_empty() { seen.clone() } else { Vec::new() };
        self.seen = !seen.is_empty();
        // the numbers change between checks; the log has each kind once
        if warnings.len() > self.said.len() {
            warnings.iter().for_each(|warning| tracing::warn!("{warning}"));
        }
        self.said.clone_from(&warnings);
        (warnings, verdict)
    }

    fn warnings(&self, rows: &Rows, explains: Explains, verdict: &Verdict) -> Vec<String> {
        let in_contact = rows.depth_m.iter().filter(|d| **d > 0.0).count();
        if in_contact < FIRST {
            return Vec::new();
        }
        if let Some(warning) = glance(rows) {
            return vec![warning];
        }
        let mut warnings = Vec::new();
        if in_contact >= ENOUGH {
            let path = ForcePath::new(rows.time_s.clone(), rows.depth_m.clone(), rows.predicted_n.clone());
            let reasons = path.and_then(|path| align(&path, rows, &[])).map(|found| found.reasons());
            warnings.extend(reasons.unwrap_or_default());
        }
        if explains == Explains::No && in_contact >= ENOUGH {
            let why = verdict.reasons.first().map_or("", String::as_str);
            warnings.push(format!("{}: {why}. Calibrate the scene with a recording of this rig", verdict.line()));
        }
        warnings
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ros2_messages::builtin_interfaces::Time;
    use ros2_messages::std_msgs::Header;

    /// Insertion at 1 mm/s to 8 mm, retraction at 4 mm/s; the force has a factor and a delay.
    fn samples(factor: f64, late_s: f64) -> Samples {
        let depth = |t: f64| if t < 9.0 { 1e-3 * (t - 1.0) } else { 8e-3 - 4e-3 * (t - 9.0) };
        let force = |t: f64| 700.0 * depth(t).max(0.0).powf(1.6);
        let mut samples = Samples::default();
        for i in 0..550 {
            let t = 0.02 * f64::from(i);
            let header = Header { stamp: Time::from_nanos((1e9 * (t + 5.0)) as i64), frame_id: String::new() };
            let noise = 1e-4 * ((i * 7919) % 13 - 6) as f64 / 6.0;
            samples.take(&ForceComparison {
                header,
                valid: true,
                depth_m: depth(t),
                predicted_n: force(t),
                measured_n: factor * (force(t - late_s) + noise),
                ..ForceComparison::default()
            });
        }
        samples
    }

    fn warnings(samples: &Samples) -> Vec<String> {
        let mut watch = Watch::new();
        watch.look(samples, true);
        watch.look(samples, true).0
    }

    #[test]
    fn another_unit_another_sign_and_a_late_clock_are_warned_of() {
        assert_eq!(warnings(&samples(1.0, 0.0)), Vec::<String>::new());
        assert_eq!(warnings(&samples(1.3, 0.0)), Vec::<String>::new(), "another modulus");
        for (factor, late_s, word) in
            [(1e3, 0.0, "mN"), (-1.0, 0.0, "sign of the force"), (1.0, 0.4, "later than the position")]
        {
            let found = warnings(&samples(factor, late_s));
            assert!(found.len() == 1 && found[0].contains(word), "{factor} {late_s}: {found:?}");
        }
        let mut watch = Watch::new();
        let softer = samples(1.3, 0.0);
        assert!(watch.look(&softer, false).0.is_empty(), "one look is none");
        let found = watch.look(&softer, false).0;
        assert!(found.len() == 1 && found[0].contains("does not explain"), "{found:?}");
    }
}
