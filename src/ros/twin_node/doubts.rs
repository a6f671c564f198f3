//! Watches, while it runs, whether the recording that comes in lies to the model as it should: units, signs, contact depth, clocks.
//!
//! Samples of the comparison are kept, at most one per [`SPACING_S`]; the housekeeping thread looks at them now and then, beside the
//! solver. A forecast is never changed by it.

use std::time::{Duration, Instant};

use crate::compare::alignment::align;
use crate::compare::path::ForcePath;
use crate::compare::rows::Rows;
use crate::compare::scale::glance;
use crate::ros::messages::needle_twin::ForceComparison;

/// Least time between two samples, s.
const SPACING_S: f64 = 0.02;
/// Samples that are kept: half a minute; then the older half goes.
const KEPT: usize = 1500;
/// Fewest samples in contact that say something of size and sign (half a second), and of the alignment.
const FIRST: usize = 25;
const ENOUGH: usize = 200;
/// Between two looks.
const LOOK: Duration = Duration::from_secs(2);

/// (time in s, depth in m, predicted and measured force in N).
type Sample = [f64; 4];

/// What was compared lately.
#[derive(Clone, Debug, Default)]
pub(super) struct Samples(Vec<Sample>);

impl Samples {
    /// Takes a comparison.
    pub fn take(&mut self, message: &ForceComparison) {
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

    fn rows(&self) -> Rows {
        let start = self.0.first().map_or(0.0, |s| s[0]);
        let column = |k: usize| self.0.iter().map(|s| s[k]).collect();
        Rows::new(self.0.iter().map(|s| s[0] - start).collect(), column(1), column(2), column(3))
    }
}

/// Looks at the samples now and then.
#[derive(Debug)]
pub(super) struct Watch {
    due: Instant,
    /// What the last look saw of the alignment: it counts when it is seen twice.
    seen: bool,
    said: Vec<String>,
}

impl Watch {
    pub fn new() -> Self {
        Self { due: Instant::now() + LOOK, seen: false, said: Vec::new() }
    }

    /// Whether a look is due.
    pub fn is_due(&mut self) -> bool {
        let due = Instant::now() >= self.due;
        if due {
            self.due = Instant::now() + LOOK;
        }
        due
    }

    /// What is to be doubted of the samples; new doubts go to the log.
    pub fn look(&mut self, samples: &Samples) -> Vec<String> {
        let doubts = self.doubts(&samples.rows());
        // numbers change from look to look; the log has each kind once
        if doubts.len() > self.said.len() {
            doubts.iter().for_each(|doubt| tracing::warn!("{doubt}"));
        }
        self.said.clone_from(&doubts);
        doubts
    }

    fn doubts(&mut self, rows: &Rows) -> Vec<String> {
        let in_contact = rows.loaded(0.02).len();
        if in_contact < FIRST {
            self.seen = false;
            return Vec::new();
        }
        if let Some(doubt) = glance(rows) {
            return vec![doubt];
        }
        if in_contact < ENOUGH {
            return Vec::new();
        }
        let path = ForcePath::new(rows.time_s.clone(), rows.depth_m.clone(), rows.predicted_n.clone());
        let reasons = path.and_then(|path| align(&path, rows)).map(|found| found.reasons()).unwrap_or_default();
        let before = std::mem::replace(&mut self.seen, !reasons.is_empty());
        if before { reasons } else { Vec::new() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ros::messages::builtin_interfaces::Time;
    use crate::ros::messages::std_msgs::Header;

    /// In at 1 mm/s to 8 mm, out at 4 mm/s; the force is what a factor and a delay make of it.
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

    fn doubts(samples: &Samples) -> Vec<String> {
        let mut watch = Watch::new();
        watch.look(samples);
        watch.look(samples)
    }

    #[test]
    fn another_unit_another_sign_and_a_late_clock_are_doubted() {
        assert_eq!(doubts(&samples(1.0, 0.0)), Vec::<String>::new());
        assert_eq!(doubts(&samples(1.3, 0.0)), Vec::<String>::new(), "another modulus");
        for (factor, late_s, word) in
            [(1e3, 0.0, "mN"), (-1.0, 0.0, "sign of the force"), (1.0, 0.4, "later than the position")]
        {
            let found = doubts(&samples(factor, late_s));
            assert!(found.len() == 1 && found[0].contains(word), "{factor} {late_s}: {found:?}");
        }
    }
}
