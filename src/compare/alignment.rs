//! Alignment of a recording with the model: the depth of first contact, the clock of the force against that of the position, the load cell's zero.
//!
//! ```text
//! F_measured(t) = a F(d(t - tau) - c) + b + w t        c: contact depth, tau: time offset, b: zero, w: drift
//! ```
//!
//! The size a is free here, so that a wrong modulus is not taken for a wrong alignment. A grid over c and tau gives the start
//! (a, b and w follow from it by linear least squares), Gauss and Newton's steps the rest, all on the curve of one run (`path`).
//! A law whose curve bends otherwise than the tissue's buys a better fit of the whole with a contact that is elsewhere, by millimetres and
//! with a small standard error. So the contact is found a second time by the beginning of the force alone, where a wrong bend does little;
//! where the two differ by more than noise, that of the beginning is taken, with their difference for its error (`steady`).
//!
//! Errors are those of [`super::uncertainty`]. A motion of one speed can't tell c from tau: tau is taken as 0 then, without an error.

use nalgebra::{DMatrix, DVector};

use super::Run;
use super::path::ForcePath;
use super::rows::Rows;
use super::uncertainty::{FORCE_ERROR, Uncertainty};

/// Largest shifts of the grid: share of the recording's time and of its largest depth, s and m; and its steps on either side.
const MOST_S: (f64, f64) = (0.25, 3.0);
const MOST_M: (f64, f64) = (0.3, 3e-3);
const STEPS: [i32; 2] = [40, 20];
/// Readings that the grid looks at, and the search.
const GRID_ROWS: usize = 250;
const SEARCH_ROWS: usize = 1500;
/// Steps of the search.
const ITERATIONS: usize = 12;
/// A shift counts from so many standard errors on, and from so much on: of the contact in m, of the clock in s. Less is within what
/// a displacement sensor and the interpolation of readings are off.
const SIGNIFICANT: f64 = 3.0;
const TOLERANCE: [f64; 2] = [5e-5, 5e-3];

/// A value and its standard error; without one the recording can't tell.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Found {
    /// In its unit.
    pub value: f64,
    /// The same unit.
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
    /// How late the force's stamps are against the position's, s.
    pub time_offset_s: Found,
    /// What the load cell reads without load, N.
    pub force_zero_n: Found,
    /// Size of the measured force over the predicted one.
    pub size: f64,
}

impl Alignment {
    /// Whether the contact is elsewhere than recorded.
    #[must_use]
    pub fn contact_is_off(&self) -> bool {
        self.contact_depth_m.is_off(TOLERANCE[0])
    }

    /// Whether the clocks differ.
    #[must_use]
    pub fn clock_is_off(&self) -> bool {
        self.time_offset_s.is_off(TOLERANCE[1])
    }

    /// What of it is off, with the remedy.
    #[must_use]
    pub fn reasons(&self) -> Vec<String> {
        let mut reasons = Vec::new();
        if self.clock_is_off() {
            let Found { value, error } = self.time_offset_s;
            let word = if value > 0.0 { "later" } else { "earlier" };
            reasons.push(format!(
                "the force's stamps are {:.3} s {word} than the position's (standard error {:.3} s): give the sensors one clock; \
                 `calibrate` takes it out",
                value.abs(),
                error.unwrap_or(0.0)
            ));
        }
        if self.contact_is_off() {
            let Found { value, error } = self.contact_depth_m;
            reasons.push(format!(
                "the sample is touched at a recorded depth of {:.3} mm (standard error {:.3} mm): zero the displacement sensor at first \
                 contact; `calibrate` takes it out",
                1e3 * value,
                1e3 * error.unwrap_or(0.0)
            ));
        }
        reasons
    }
}

/// Share of the peak force up to which the force begins, and fewest readings of that.
const BEGINNING: f64 = 0.25;
const LEAST_READINGS: usize = 24;

/// Unknowns besides the two shifts: size, zero and drift, in which the force is linear.
const LINEAR: usize = 3;

/// Readings that are aligned.
struct Problem<'a> {
    path: &'a ForcePath,
    time_s: Vec<f64>,
    measured_n: Vec<f64>,
    /// How many of size, zero and drift are free.
    free: usize,
}

impl<'a> Problem<'a> {
    fn new(path: &'a ForcePath, rows: &Rows, most: usize) -> Self {
        let step = rows.len().div_ceil(most).max(1);
        let every = |v: &[f64]| v.iter().copied().step_by(step).collect();
        let free = LINEAR - rows.known.min(LINEAR - 1);
        Self { path, time_s: every(&rows.time_s), measured_n: every(&rows.measured_n), free }
    }

    fn force(&self, i: usize, [c, tau]: [f64; 2]) -> f64 {
        self.path.force_n(self.time_s[i] - tau, c)
    }

    /// Size, zero and drift for given shifts, and the residual's sum of squares per reading; readings that the shifted run doesn't
    /// cover are left out.
    fn linear(&self, at: [f64; 2]) -> Option<([f64; LINEAR], f64)> {
        let (mut n, mut y, mut squares, mut count) = ([[0.0; LINEAR]; LINEAR], [0.0; LINEAR], 0.0, 0.0);
        let start = self.time_s[0];
        for i in (0..self.time_s.len()).filter(|&i| self.path.covers(self.time_s[i] - at[1])) {
            let (columns, m) = ([self.force(i, at), 1.0, self.time_s[i] - start], self.measured_n[i]);
            for a in 0..self.free {
                (0..self.free).for_each(|b| n[a][b] += columns[a] * columns[b]);
                y[a] += columns[a] * m;
            }
            squares += m * m;
            count += 1.0;
        }
        // what is known stays 0
        (self.free..LINEAR).for_each(|a| n[a][a] = 1.0);
        let x = nalgebra::Matrix3::from_fn(|a, b| n[a][b]).cholesky()?.solve(&nalgebra::Vector3::from(y));
        let left = squares - (0..LINEAR).map(|a| x[a] * y[a]).sum::<f64>();
        (x[0] > 0.0 && count > 2.0 * LINEAR as f64).then_some(([x[0], x[1], x[2]], left.max(0.0) / count))
    }

    /// The shifts of a grid that leave the least; of the contact alone where the clock's is given, s.
    fn grid(&self, deepest_m: f64, clock: Option<f64>) -> Option<[f64; 2]> {
        let whole = self.time_s.last()? - self.time_s.first()?;
        let most = [most_m(deepest_m), (MOST_S.0 * whole).min(MOST_S.1)];
        let value = |k: usize, i: i32| most[k] * f64::from(i) / f64::from(STEPS[1 - k]);
        let shifts = (-STEPS[1]..=STEPS[1]).flat_map(|i| {
            let only = |j: &i32| clock.is_none() || *j == 0;
            (-STEPS[0]..=STEPS[0]).filter(only).map(move |j| [value(0, i), clock.unwrap_or(0.0) + value(1, j)])
        });
        let left = shifts.filter_map(|at| self.linear(at).map(|(_, left)| (at, left)));
        left.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(at, _)| at)
    }

    /// Residuals and their derivatives by contact depth, time offset, size, zero and drift.
    fn jacobian(&self, at: [f64; 2], linear: [f64; LINEAR]) -> (DVector<f64>, DMatrix<f64>) {
        let used: Vec<usize> = (0..self.time_s.len()).filter(|&i| self.path.covers(self.time_s[i] - at[1])).collect();
        let since = |i: usize| self.time_s[i] - self.time_s[0];
        let residual =
            |&i: &usize| linear[0] * self.force(i, at) + linear[1] + linear[2] * since(i) - self.measured_n[i];
        let r = DVector::from_iterator(used.len(), used.iter().map(residual));
        let j = DMatrix::from_fn(used.len(), 2 + LINEAR, |row, k| {
            let i = used[row];
            let time = self.time_s[i] - at[1];
            match k {
                0 => -linear[0] * self.path.stiffness(time, at[0]),
                1 => -linear[0] * self.path.rate(time, at[0]),
                2 => self.force(i, at),
                3 => 1.0,
                _ => since(i),
            }
        });
        (r, j)
    }
}

/// Largest shift of the contact that is looked for, m.
fn most_m(deepest_m: f64) -> f64 {
    (MOST_M.0 * deepest_m).min(MOST_M.1)
}

/// Aligns measured forces with a run's; `None` where there is no contact or too little is measured.
#[must_use]
pub fn align(path: &ForcePath, rows: &Rows) -> Option<Alignment> {
    let coarse = Problem::new(path, rows, GRID_ROWS);
    let start = coarse.grid(rows.deepest_m(), rows.one_clock.then_some(0.0))?;
    let fine = Problem::new(path, rows, SEARCH_ROWS);
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

/// The readings of the way in before the force has passed [`BEGINNING`] of its peak.
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

/// The contact held against that of the force's beginning; see the module.
fn steady(path: &ForcePath, rows: &Rows, found: Alignment) -> Alignment {
    let Found { value: whole, error: Some(_) } = found.contact_depth_m else { return found };
    let with = |contact: Found| Alignment { contact_depth_m: contact, ..found };
    if whole.abs() >= most_m(rows.deepest_m()) {
        return with(Found { value: whole, error: None });
    }
    let clock = found.time_offset_s.value;
    let early = beginning(rows, found.force_zero_n.value - rows.zero_n).and_then(|early| {
        let problem = Problem::new(path, &early, SEARCH_ROWS);
        let start = Problem::new(path, &early, GRID_ROWS).grid(rows.deepest_m(), Some(clock))?;
        search(&problem, &early, start, false)
    });
    let Some(Found { value, error: Some(early_error) }) = early.map(|early| early.contact_depth_m) else {
        return found;
    };
    // a zero that no reading before the contact tells stands for a contact
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

/// Gauss and Newton's steps, halved where they lead up; the clock's only if it is `timed`.
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
            let most = most_m(rows.deepest_m());
            let to = [(at[0] + share * step[0]).clamp(-most, most), tau];
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
    let force: Vec<f64> = times.iter().map(|t| linear[0] * problem.path.force_n(*t, at[0])).collect();
    let depth: Vec<f64> = times.iter().map(|t| problem.path.depth_m(*t) - at[0]).collect();
    let about = Uncertainty::new(&j);
    let covariance = about.noise(&j, r.as_slice()) + about.systematic(&j, &force, &depth, FORCE_ERROR);
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

    /// The same by some of its readings.
    #[must_use]
    pub fn alignment_of(&self, rows: Rows) -> Option<Alignment> {
        if rows.is_empty() || rows.loaded(0.02).len() < 64 {
            return None;
        }
        let all: Vec<_> = self
            .answers
            .iter()
            .filter(|a| [a.time_s, a.depth_m, a.predicted_n].iter().all(|x| x.is_finite()))
            .collect();
        let column = |of: fn(&super::Answer) -> f64| all.iter().map(|a| of(a)).collect();
        if !all.is_sorted_by(|a, b| a.time_s < b.time_s) {
            return None;
        }
        let path = ForcePath::new(column(|a| a.time_s), column(|a| a.depth_m), column(|a| a.predicted_n))?;
        align(&path, &rows)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng as _;
    use rand_distr::{Distribution as _, StandardNormal};

    /// A press to 9 mm at 1 mm/s, from `above_m` over the recorded surface.
    struct Case {
        above_m: f64,
        contact_m: f64,
        /// Powers of the depth that model and tissue go with.
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
            align(&path, &rows)
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
