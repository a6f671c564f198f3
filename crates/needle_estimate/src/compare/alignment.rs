//! Alignment of a recording with the model: the depth of first contact, the clock of the force against that of the
//! position, the load cell's zero.
//!
//! ```text
//! F_measured(t) = a F(d(t - tau) - c) + b + w t        c: contact depth, tau: time offset, b: zero, w: drift
//! ```
//!
//! The factor a is free, so that a wrong modulus is not mistaken for a wrong alignment. A grid over c and tau gives
//! the start (a, b and w follow from it by linear least squares). Gauss-Newton steps refine it. Both use the force
//! curve of one run (`path`).
//!
//! If the model's curve has another curvature than the tissue's, a wrong contact improves the overall fit. It can be
//! off by millimetres, with a small standard error. So the contact is also estimated from the beginning of the force
//! alone, where the curvature has little effect. If the two estimates differ by more than noise, the one from the
//! beginning is used, with their difference as its error (`steady`).
//!
//! If the load cell measured a vector and the model predicts one, the components across the axis are used too
//! (`beside`). They share shifts and factor with the axial force. Each has its own zero and drift and is weighted by
//! its noise (`components`). They determine the clock offset of a needle that moves laterally at constant
//! depth.
//!
//! Errors are those of [`super::uncertainty`]. A motion at constant speed can't distinguish c from tau. Then tau is
//! 0, without an error.

mod problem;

use super::path::ForcePath;
use super::rows::Rows;
use super::uncertainty::{FORCE_ERROR, Uncertainty};
use super::{Answer, Run};
pub(super) use problem::reach_m;
use problem::{LINEAR, Problem};

pub use problem::Beside;

/// Number of readings used by the grid, and by the refinement.
const GRID_ROWS: usize = 250;
const SEARCH_ROWS: usize = 1500;
/// Iterations of the refinement.
const ITERATIONS: usize = 12;
/// A shift is significant if it exceeds this many standard errors, and also a tolerance: of the contact in m, of the
/// clock in s. Smaller shifts are within the error of a displacement sensor and of the interpolation of readings.
const SIGNIFICANT: f64 = 3.0;
const TOLERANCE: [f64; 2] = [5e-5, 5e-3];

/// A value and its standard error; no error if the recording can't determine the value.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Found {
    /// In its unit.
    pub value: f64,
    /// Standard error in the same unit.
    pub error: Option<f64>,
}

impl Found {
    fn is_off(&self, least: f64) -> bool {
        self.error.is_some_and(|e| self.value.abs() > (SIGNIFICANT * e).max(least))
    }
}

/// See the module.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Alignment {
    /// Recorded depth at which the instrument touches the sample, m.
    pub contact_depth_m: Found,
    /// Delay of the force's stamps against the position's, s.
    pub time_offset_s: Found,
    /// Reading of the load cell without load, N.
    pub force_zero_n: Found,
    /// Factor of the measured force over the predicted one.
    pub size: f64,
}

impl Alignment {
    /// Whether the contact differs significantly from the recorded one.
    #[must_use]
    pub(crate) fn contact_is_off(&self) -> bool {
        self.contact_depth_m.is_off(TOLERANCE[0])
    }

    /// Whether the clocks differ significantly.
    #[must_use]
    pub(crate) fn clock_is_off(&self) -> bool {
        self.time_offset_s.is_off(TOLERANCE[1])
    }

    /// The significant deviations, each with a remedy.
    #[must_use]
    pub fn reasons(&self) -> Vec<String> {
        let mut reasons = Vec::new();
        if self.clock_is_off() {
            let Found { value, error } = self.time_offset_s;
            let word = if value > 0.0 { "later" } else { "earlier" };
            reasons.push(format!(
                "the force's stamps are {:.3} s {word} than the position's (standard error {:.3} s): give the sensors one clock, or \
                 --time-offset-s {value:.3}; `calibrate` takes it out",
                value.abs(),
                error.unwrap_or(0.0)
            ));
        }
        if self.contact_is_off() {
            let Found { value, error } = self.contact_depth_m;
            reasons.push(format!(
                "the sample is touched at a recorded depth of {:.3} mm (standard error {:.3} mm): zero the displacement sensor at first \
                 contact, or give its reading there with --position-zero; `calibrate` takes it out",
                1e3 * value,
                1e3 * error.unwrap_or(0.0)
            ));
        }
        reasons
    }
}

/// Share of the peak force that defines the beginning of the force, and fewest readings of it.
const BEGINNING: f64 = 0.25;
const LEAST_READINGS: usize = 24;

/// Aligns measured forces with those of a run; `None` if there is no contact or too little is measured.
#[must_use]
pub fn align(path: &ForcePath, rows: &Rows, beside: &[Beside]) -> Option<Alignment> {
    let coarse = Problem::new(path, rows, beside, GRID_ROWS);
    let start = coarse.grid(rows.deepest_m(), rows.one_clock.then_some(0.0))?;
    let fine = Problem::new(path, rows, beside, SEARCH_ROWS);
    let found = if rows.one_clock {
        search(&fine, rows, start, false)?
    } else {
        let both = search(&fine, rows, start, true)?;
        let told_apart = both.time_offset_s.error.is_some() && both.contact_depth_m.error.is_some();
        let alone = || search(&fine, rows, [start[0], 0.0], false).unwrap_or(both);
        if told_apart { both } else { alone() }
    };
    Some(steady(path, rows, found))
}

/// The readings of the insertion before the force exceeds [`BEGINNING`] of its peak.
fn beginning(rows: &Rows, zero_n: f64) -> Option<Rows> {
    let least = BEGINNING * rows.peak_n();
    let end = rows.measured_n.iter().position(|m| m - zero_n > least).filter(|end| *end >= LEAST_READINGS)?;
    let kept = |column: &[f64]| column[..end].to_vec();
    Some(Rows {
        time_s: kept(&rows.time_s),
        depth_m: kept(&rows.depth_m),
        predicted_n: kept(&rows.predicted_n),
        measured_n: kept(&rows.measured_n),
        ..*rows
    })
}

/// Compares the contact with the estimate from the beginning of the force; see the module.
fn steady(path: &ForcePath, rows: &Rows, found: Alignment) -> Alignment {
    let Found { value: whole, error: Some(_) } = found.contact_depth_m else { return found };
    let with = |contact: Found| Alignment { contact_depth_m: contact, ..found };
    let [least, most] = reach_m(rows.deepest_m());
    if whole <= least || whole >= most {
        return with(Found { value: whole, error: None });
    }
    let clock = found.time_offset_s.value;
    let early = beginning(rows, found.force_zero_n.value - rows.zero_n).and_then(|early| {
        let problem = Problem::new(path, &early, &[], SEARCH_ROWS);
        let start = Problem::new(path, &early, &[], GRID_ROWS).grid(rows.deepest_m(), Some(clock))?;
        search(&problem, &early, start, false)
    });
    let Some(Found { value, error: Some(early_error) }) = early.map(|early| early.contact_depth_m) else {
        return found;
    };
    // without enough readings before the contact, the zero and the contact depth can't be separated
    let idle = rows.depth_m.iter().filter(|d| **d < whole.min(value)).count();
    if rows.known < 2 && idle < LEAST_READINGS {
        return with(Found { value: whole, error: None });
    }
    let apart = (value - whole).abs();
    if apart > (SIGNIFICANT * early_error).max(TOLERANCE[0]) {
        return with(Found { value, error: Some(early_error.max(apart)) });
    }
    found
}

/// Gauss-Newton steps, halved if they increase the residual. The clock offset is fixed unless `timed`.
fn search(problem: &Problem, rows: &Rows, start: [f64; 2], timed: bool) -> Option<Alignment> {
    let mut at = start;
    let (mut linear, mut left) = problem.linear(at)?;
    for _ in 0..ITERATIONS {
        let (r, j) = problem.jacobian(at, linear);
        let j = j.columns(0, 2 + problem.free).into_owned();
        let j = if timed { j } else { j.remove_column(1) };
        let Some(step) = (j.transpose() * &j).cholesky().map(|n| n.solve(&-(j.transpose() * r))) else { break };
        let mut share = 1.0;
        let next = loop {
            let tau = if timed { at[1] + share * step[1] } else { start[1] };
            let [least, most] = reach_m(rows.deepest_m());
            let to = [(at[0] + share * step[0]).clamp(least, most), tau];
            match problem.linear(to) {
                Some((x, l)) if l < left => break Some((to, x, l)),
                _ if share < 0.01 => break None,
                _ => share *= 0.5,
            }
        };
        let Some((to, x, l)) = next else { break };
        let done = left - l < 1e-6 * left;
        (at, linear, left) = (to, x, l);
        if done {
            break;
        }
    }
    Some(judged(problem, rows, at, linear, timed))
}

fn judged(problem: &Problem, rows: &Rows, at: [f64; 2], linear: [f64; LINEAR], timed: bool) -> Alignment {
    let (r, mut j) = problem.jacobian(at, linear);
    (2 + problem.free..2 + LINEAR).for_each(|k| j.column_mut(k).fill(0.0));
    if !timed {
        j.column_mut(1).fill(0.0);
    }
    let times: Vec<f64> = problem.time_s.iter().map(|t| t - at[1]).filter(|t| problem.path.covers(*t)).collect();
    let beside = problem.beside.iter().map(|(path, _, weight)| (*path, *weight));
    let (paths, weights): (Vec<_>, Vec<f64>) = std::iter::once((problem.path, 1.0)).chain(beside).unzip();
    let of = |path: &&ForcePath| -> Vec<f64> { times.iter().map(|t| linear[0] * path.force_n(*t, at[0])).collect() };
    let force: Vec<f64> = paths.iter().flat_map(of).collect();
    let depth: Vec<f64> = paths.iter().flat_map(|_| times.iter().map(|t| problem.path.depth_m(*t) - at[0])).collect();
    let about = Uncertainty::new(&j);
    let covariance = about.noise(&j, r.as_slice()) + about.systematic(&j, &force, &depth, FORCE_ERROR, &weights);
    let together = about.indistinguishable().iter().any(|g| g.contains(&0) && g.contains(&1));
    let found = |k: usize, value: f64| {
        let error = covariance[(k, k)].max(0.0).sqrt();
        let known = about.is_determined(k) && error.is_finite() && !(k < 2 && together);
        Found { value, error: known.then_some(error) }
    };
    let mut zero = found(3, linear[1]);
    zero.value += rows.zero_n;
    Alignment { contact_depth_m: found(0, at[0]), time_offset_s: found(1, at[1]), force_zero_n: zero, size: linear[0] }
}

impl Run {
    /// Alignment of the recording with the model; `None` where there is no contact, or too little is measured.
    #[must_use]
    pub fn alignment(&self) -> Option<Alignment> {
        self.alignment_of(Rows::of(self))
    }

    /// The alignment from a subset of the readings.
    #[must_use]
    pub(crate) fn alignment_of(&self, rows: Rows) -> Option<Alignment> {
        if rows.is_empty() || rows.loaded(0.02).len() < 64 {
            return None;
        }
        let all: Vec<_> = self
            .answers
            .iter()
            .filter(|a| [a.time_s, a.depth_m, a.predicted_n].iter().all(|x| x.is_finite()))
            .collect();
        let column = |of: fn(&Answer) -> f64| all.iter().map(|a| of(a)).collect();
        if !all.is_sorted_by(|a, b| a.time_s < b.time_s) {
            return None;
        }
        let path = ForcePath::new(column(|a| a.time_s), column(|a| a.depth_m), column(|a| a.predicted_n))?;
        align(&path, &rows, &self.beside(&rows))
    }

    /// The components across the axis at the rows, if load cell and model have them.
    fn beside(&self, rows: &Rows) -> Vec<Beside> {
        let at = |t: &f64| &self.answers[self.answers.partition_point(|a| a.time_s < *t).min(self.answers.len() - 1)];
        let answers: Vec<&Answer> = rows.time_s.iter().map(at).collect();
        let across = if self.predicts_vectors() { self.across(&answers, FORCE_ERROR) } else { Vec::new() };
        let beside = across.into_iter();
        let one = |c: super::components::Component| {
            Some(Beside { path: c.path(self)?, measured_n: c.measured_n, weight: c.weight })
        };
        beside.map(one).collect::<Option<_>>().unwrap_or_default()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng as _;
    use rand_distr::{Distribution as _, StandardNormal};

    /// An indentation to 9 mm at 1 mm/s, starting `above_m` over the recorded surface.
    struct Case {
        above_m: f64,
        contact_m: f64,
        /// Exponents of the force over the depth, of the model and of the tissue.
        powers: [f64; 2],
        known: usize,
        noise: f64,
        seed: u64,
    }

    impl Case {
        fn found(&self) -> Option<Alignment> {
            let mut generator = ChaCha8Rng::seed_from_u64(self.seed);
            let force = |d: f64, power: f64| 20.0 * (d.max(0.0) / 9e-3).powf(power);
            let end = (self.above_m + 9e-3) / 1e-3;
            let time: Vec<f64> = (0..600).map(|i| end * f64::from(i) / 599.0).collect();
            let depth: Vec<f64> = time.iter().map(|t| 1e-3 * t - self.above_m).collect();
            let model: Vec<f64> = depth.iter().map(|d| force(*d, self.powers[0])).collect();
            let mut reading = |d: &f64| {
                let white: f64 = StandardNormal.sample(&mut generator);
                1.2 * force(d - self.contact_m, self.powers[1]) + 20.0 * self.noise * white
            };
            let measured: Vec<f64> = depth.iter().map(&mut reading).collect();
            let path = ForcePath::new(time.clone(), depth.clone(), model.clone()).unwrap();
            let rows = Rows { one_clock: true, known: self.known, ..Rows::new(time, depth, model, measured) };
            align(&path, &rows, &[])
        }
    }

    #[test]
    fn a_law_of_another_bend_is_no_contact_elsewhere() {
        let mut found_off = 0;
        for (seed, known) in (0..60).zip([0, 1, 2].into_iter().cycle()) {
            for above_m in [0.0, 1e-3] {
                for powers in [[1.2, 1.2], [1.6, 1.6], [1.2, 1.3], [1.2, 1.1], [1.6, 1.75], [1.6, 1.45]] {
                    let contact_m = 2e-4 * ((seed % 9) as f64 - 4.0);
                    let case = Case { above_m, contact_m, powers, known, noise: 2e-3, seed };
                    let Some(found) = case.found() else { continue };
                    let error = (found.contact_depth_m.value - contact_m).abs();
                    let off = found.contact_is_off();
                    if off && powers[0] != powers[1] {
                        assert!(error < 4e-4, "{powers:?} {known} {above_m} {contact_m} {seed}: {found:?}");
                    }
                    if powers[0] == powers[1] && known > 0 && above_m > 0.0 && contact_m > 3e-4 {
                        assert!(off && error < 5e-5, "{powers:?} {known} {contact_m} {seed}: {found:?}");
                        found_off += 1;
                    }
                }
            }
        }
        assert!(found_off > 20, "{found_off}");
    }
}
