//! Whether the model explains a measurement: compares the residuals with what noise, load cell and discretisation
//! explain.
//!
//! The residuals in contact and under load, r = F - F_measured, are averaged over blocks of neighbouring readings. If the model is
//! right, the block means have the covariance
//!
//! ```text
//! V_ab = s_b^2 / n_b delta_ab  +  s^2 g_a g_b K(d_a, d_b)  +  z^2  +  w^2 t_a t_b         g = |F| + 0.05 F_max
//! K    = 0.45 (exp(-D^2 / 2 (0.5 d_max)^2) + exp(-D^2 / 2 (0.1 d_max)^2)) + 0.1 delta_ab,     D = d_a - d_b
//! ```
//!
//! The terms are: the noise s_b, estimated about a straight line within the blocks (correlated readings count for
//! fewer); a relative force error s that varies over the depth (`uncertainty`); and the load cell's zero error z and
//! drift w.
//!
//! The reduced chi-square is r^T V^-1 r over the number of blocks minus that of fitted parameters: about 1 or less if
//! the model explains the measurement. In it, a force that is wrong by a constant factor is one deviation among many
//! blocks. So each block is also judged alone: the mean of r_a^2 / V_aa, after the likely zero and drift are
//! subtracted, up to three of their standard deviations. For this a value of 9 (three standard deviations) is scaled to [`EXPLAINED`]. The larger of the two is
//! the reported figure.
//!
//! If the load cell measured a vector, each of its components in frame `sample` is judged in the same way, with zero
//! and drift relative to the whole force's peak; the worst one is the verdict. If the figure is too large, the
//! longest beginning or end of the motion that is explained is searched for.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};

use super::Run;
use super::rows::Rows;
use super::uncertainty::FORCE_ERROR;

/// Number of blocks.
const BLOCKS: usize = 96;
/// Fewest readings under load, and per block, for a verdict.
const LEAST_READINGS: usize = 64;
const LEAST_IN_BLOCK: usize = 5;
/// Share of the peak above which the instrument counts as loaded.
const LOADED: f64 = 0.02;
/// Shares of the force error's variance for the two correlation lengths (over the largest depth), and independent
/// from block to block (the ripple of the cloud's layers).
const LENGTHS: [(f64, f64); 2] = [(0.45, 0.5), (0.45, 0.1)];
const RIPPLE: f64 = 0.1;
/// Every force has at least the error of this share of the largest force.
const FLOOR: f64 = 0.05;
/// Standard uncertainty of a load cell's zero, and of its drift over the run, relative to the peak force.
const ZERO: f64 = 0.02;
const DRIFT: f64 = 0.02;
/// Reduced chi-square up to which the model explains the measurement.
pub const EXPLAINED: f64 = 2.0;
/// A block whose mean residual deviates by more than this, in standard deviations, is not explained.
const FAR: f64 = 3.0;
/// Smallest share of the blocks in a partial explanation, and number of steps of the search for it.
const PART: f64 = 0.5;
const CUTS: usize = 24;
/// Number of depth intervals for which the residual's variance is reported.
const TENTHS: usize = 10;

/// Whether a model explains a measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Explains {
    /// The residuals are explained by noise, load cell and discretisation.
    Yes,
    /// Only at some depths.
    InPart,
    /// The residuals are not explained.
    No,
    /// There is no measurement, or too little under load.
    #[default]
    NoMeasurement,
}

impl Explains {
    /// The name in files.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Yes => "yes",
            Self::InPart => "in part",
            Self::No => "no",
            Self::NoMeasurement => "no measurement",
        }
    }

    /// The verdict as a clause of a sentence.
    #[must_use]
    pub(crate) const fn sentence(self) -> &'static str {
        match self {
            Self::Yes => "the model explains the measurement",
            Self::InPart => "the model explains the measurement in part",
            Self::No => "the model does not explain the measurement",
            Self::NoMeasurement => "no measurement to judge the model by",
        }
    }
}

/// See the module.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Verdict {
    /// The verdict.
    pub explains: Explains,
    /// Reasons, the worst first; empty if the model explains everything.
    pub reasons: Vec<String>,
    /// Chi-square over the number of blocks minus that of fitted parameters.
    pub reduced_chi_square: Option<f64>,
    /// Correlation of neighbouring residuals.
    pub autocorrelation: Option<f64>,
    /// Noise of one reading, N.
    pub noise_n: Option<f64>,
    /// Share of the residual's sum of squares in each tenth of the depth.
    pub share_over_depth: Vec<f64>,
    /// Whether there is a measurement, but too little of it under load. The first reason states it.
    pub too_little: bool,
    /// Whether the recording has a hole, over which no model can be judged.
    pub has_hole: bool,
}

impl Verdict {
    /// This verdict, or that of a component of the force if it explains less.
    #[must_use]
    pub(crate) fn or_worse(self, other: Self, component: &str) -> Self {
        let chi = |v: &Self| v.reduced_chi_square.unwrap_or(0.0);
        if chi(&other) <= chi(&self).max(EXPLAINED) {
            return self;
        }
        let named = |reason: String| format!("the force along {component}: {reason}");
        let turned = "a load cell that is turned against the sample shows this as well: --sensor-rotation W,X,Y,Z";
        let reasons = other.reasons.into_iter().map(named).chain([turned.to_owned()]).collect();
        Self { reasons, ..other }
    }

    /// Lowers the verdict because of intervals without recorded data, which no model explains.
    pub(crate) fn over_holes(&mut self, holes: &[[f64; 2]]) {
        let Some([from, to]) = holes.first() else { return };
        self.has_hole = true;
        if self.explains == Explains::Yes {
            self.explains = Explains::InPart;
        }
        self.reasons.push(format!(
            "the recording has a hole from {from:.3} to {to:.3} s: what is on its other side was reached by a motion that is not known"
        ));
    }

    /// The first line of a summary: the verdict and its chi-square.
    #[must_use]
    pub fn line(&self) -> String {
        let chi = self.reduced_chi_square.map_or_else(String::new, |c| format!(" (reduced chi-square {c:.2})"));
        if self.too_little {
            return "too little was measured to judge the model by".to_owned();
        }
        if self.has_hole && self.explains == Explains::InPart {
            return format!("no verdict on the whole: the recording has a hole{}", chi.replace("(", "(outside of it "));
        }
        format!("{}{chi}", self.explains.sentence())
    }
}

/// Judges residuals in contact: before it, vibration, cables or a zero that is not yet at rest say nothing of the model. `fitted` is the number of parameters fitted to these readings. `force_error` is the relative
/// standard uncertainty of the force's size.
#[must_use]
pub fn judge(rows: &Rows, fitted: usize, force_error: f64) -> Verdict {
    let all = rows;
    let rows = &all.in_contact(LOADED);
    let Some(blocks) = Blocks::of(rows, all) else {
        let too_little = !all.is_empty();
        let reasons = if too_little { vec![too_few(rows)] } else { Vec::new() };
        return Verdict { reasons, too_little, ..Verdict::default() };
    };
    let expected = blocks.expected(force_error);
    let n = expected.residuals.len();
    let Some((chi, deviations)) = expected.chi(0..n, fitted) else { return Verdict::default() };
    let factor = if chi > EXPLAINED { blocks.factor(&expected, fitted) } else { None };
    // a wrong factor applies everywhere, also where the load cell's zero could hide it
    let part = if chi > EXPLAINED && factor.is_none() { expected.explained_part() } else { None };
    let explains = match (chi <= EXPLAINED, &part) {
        (true, _) => Explains::Yes,
        (false, Some(_)) => Explains::InPart,
        (false, None) => Explains::No,
    };
    let mut verdict = Verdict {
        explains,
        reasons: Vec::new(),
        reduced_chi_square: Some(chi),
        autocorrelation: rows.autocorrelation(),
        noise_n: Some(blocks.noise_n),
        share_over_depth: rows.shares(TENTHS),
        too_little: false,
        has_hole: false,
    };
    if explains != Explains::Yes {
        verdict.reasons.extend(part.map(|part| blocks.explained(&part)));
        verdict.reasons.push(blocks.misfit(&deviations));
        verdict.reasons.extend(factor);
    }
    verdict
}

/// The blocks' residuals, and their expected covariance.
#[derive(Clone)]
struct Expected {
    residuals: DVector<f64>,
    /// V without the load cell's zero and drift.
    covariance: DMatrix<f64>,
    /// Effect of zero and drift on each block, for one standard deviation of each.
    cell: DMatrix<f64>,
}

impl Expected {
    /// The figure of the module documentation for some of the blocks, and the deviation of each in standard
    /// deviations, after the likely zero and drift are subtracted.
    fn chi(&self, of: Range<usize>, fitted: usize) -> Option<(f64, DVector<f64>)> {
        let (from, n) = (of.start, of.len());
        let r = self.residuals.rows(from, n).into_owned();
        let v = self.covariance.view((from, from), (n, n)).into_owned();
        let cell = self.cell.rows(from, n).into_owned();
        let variance = v.diagonal();
        let factor = v.cholesky()?;
        let (solved, projected) = (factor.solve(&r), factor.solve(&cell));
        let likely =
            (DMatrix::identity(2, 2) + cell.transpose() * projected).cholesky()?.solve(&(cell.transpose() * &solved));
        // a larger one is not the load cell's, but of the model: a wrong factor on a ramp looks like a drift
        let left = &r - &cell * likely.map(|deviations| deviations.clamp(-FAR, FAR));
        let together =
            (r.dot(&solved) - (cell.transpose() * &solved).dot(&likely)) / n.saturating_sub(fitted).max(1) as f64;
        let deviations = DVector::from_fn(n, |a, _| left[a] / variance[a].sqrt());
        let alone = deviations.norm_squared() / n as f64;
        Some((together.max(alone * EXPLAINED / (FAR * FAR)), deviations))
    }

    /// The longest beginning or end of the blocks that is explained, if it is long enough.
    fn explained_part(&self) -> Option<Range<usize>> {
        let n = self.residuals.len();
        let lengths =
            (0..CUTS).map(|k| n - 1 - k * (n - 1) / CUTS).take_while(|length| *length as f64 >= PART * n as f64);
        let mut parts = lengths.flat_map(|length| [0..length, n - length..n]);
        parts.find(|part| self.chi(part.clone(), 0).is_some_and(|(chi, _)| chi <= EXPLAINED))
    }
}

fn too_few(rows: &Rows) -> String {
    if rows.deepest_m() <= 0.0 {
        return "the instrument stays above the sample: the force says nothing of the model".to_owned();
    }
    let n = (rows.loaded(LOADED).len() as f64 * rows.own_share()).round();
    format!("{n} readings of the load cell under load say too little; {LEAST_READINGS} are needed")
}

/// One block of neighbouring readings.
struct Block {
    time: f64,
    depth_m: f64,
    predicted_n: f64,
    residual_n: f64,
    /// Variance of the mean because of noise.
    variance: f64,
}

struct Blocks {
    all: Vec<Block>,
    noise_n: f64,
    peak_n: f64,
    deepest_m: f64,
}

impl Blocks {
    /// Blocks of the rows in contact; a load cell drifts over all of them.
    fn of(rows: &Rows, all: &Rows) -> Option<Self> {
        let loaded = rows.loaded(LOADED);
        // forces between two readings say nothing of their own
        let own = rows.own_share();
        if own * (loaded.len() as f64) < LEAST_READINGS as f64 || rows.deepest_m() <= 0.0 {
            return None;
        }
        let size = loaded.len().div_ceil(BLOCKS).max(LEAST_IN_BLOCK);
        let groups: Vec<&[usize]> = loaded.chunks(size).filter(|c| c.len() >= LEAST_IN_BLOCK).collect();
        let mut scatter: Vec<(f64, f64)> = groups.iter().map(|g| rows.scatter(g)).collect();
        let middle = scatter.len() / 2;
        scatter.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let noise_n = scatter[middle].0;
        scatter.sort_unstable_by(|a, b| a.1.total_cmp(&b.1));
        let alike = scatter[middle].1.clamp(0.0, 0.95);
        let (begin, end) = (all.time_s[0], all.time_s[all.len() - 1]);
        let mean = |g: &[usize], of: &dyn Fn(usize) -> f64| g.iter().map(|&i| of(i)).sum::<f64>() / g.len() as f64;
        let block = |g: &&[usize]| Block {
            time: mean(g, &|i| rows.time_s[i] - begin) / (end - begin).max(f64::MIN_POSITIVE),
            depth_m: mean(g, &|i| rows.depth_m[i]),
            predicted_n: mean(g, &|i| rows.predicted_n[i]),
            residual_n: mean(g, &|i| rows.residual(i)),
            variance: noise_n * noise_n / (own * g.len() as f64) * (1.0 + alike) / (1.0 - alike),
        };
        Some(Self {
            all: groups.iter().map(block).collect(),
            noise_n,
            peak_n: rows.peak_n(),
            deepest_m: rows.deepest_m(),
        })
    }

    fn expected(&self, share: f64) -> Expected {
        let n = self.all.len();
        let uncertain: Vec<f64> =
            self.all.iter().map(|b| share * (b.predicted_n.abs() + FLOOR * self.peak_n)).collect();
        let covariance = DMatrix::from_fn(n, n, |i, j| {
            let (a, b) = (&self.all[i], &self.all[j]);
            let apart = (a.depth_m - b.depth_m) / self.deepest_m.max(f64::MIN_POSITIVE);
            let alike: f64 = LENGTHS.iter().map(|(part, length)| part * (-0.5 * (apart / length).powi(2)).exp()).sum();
            let own = if i == j { a.variance + RIPPLE * uncertain[i] * uncertain[i] } else { 0.0 };
            own + uncertain[i] * uncertain[j] * alike
        });
        Expected {
            residuals: DVector::from_iterator(n, self.all.iter().map(|b| b.residual_n)),
            covariance,
            cell: DMatrix::from_fn(n, 2, |i, k| self.peak_n * if k == 0 { ZERO } else { DRIFT * self.all[i].time }),
        }
    }

    /// Depths of some of the blocks, in words.
    fn place(&self, of: &Range<usize>) -> String {
        let deepest = self.all.iter().enumerate().max_by(|a, b| a.1.depth_m.total_cmp(&b.1.depth_m)).map_or(0, |d| d.0);
        let (a, b) = (1e3 * self.all[of.start].depth_m, 1e3 * self.all[of.end - 1].depth_m);
        match (of.start > deepest, of.end - 1 > deepest) {
            (false, true) => format!("from {a:.1} mm on the way in to {b:.1} mm on the way out"),
            (out, _) => format!("from {a:.1} to {b:.1} mm on the way {}", if out { "out" } else { "in" }),
        }
    }

    fn explained(&self, part: &Range<usize>) -> String {
        format!("it does so {}: what happens in the rest is not in the model", self.place(part))
    }

    /// Where the residual is not explained: the two longest sequences of blocks.
    fn misfit(&self, deviations: &DVector<f64>) -> String {
        let mut stretches: Vec<Range<usize>> = Vec::new();
        for i in (0..deviations.len()).filter(|&i| deviations[i].abs() > FAR) {
            match stretches.last_mut() {
                Some(last) if last.end == i => last.end = i + 1,
                _ => stretches.push(i..i + 1),
            }
        }
        let outside: usize = stretches.iter().map(Range::len).sum();
        stretches.sort_by_key(|s| std::cmp::Reverse(s.len()));
        stretches.truncate(2);
        stretches.sort_by_key(|s| s.start);
        let places: Vec<String> = stretches.iter().map(|s| self.place(s)).collect();
        if places.is_empty() {
            return "the residuals follow each other more than noise, load cell and discretisation make them: they have a \
                    pattern that the model lacks"
                .to_owned();
        }
        let worst = deviations.iter().map(|z| z.abs()).fold(0.0, f64::max);
        format!(
            "{:.0} % of the readings under load are outside what noise, load cell and discretisation explain, most of them {}, by up \
             to {worst:.0} standard deviations",
            100.0 * outside as f64 / deviations.len() as f64,
            places.join(" and ")
        )
    }

    /// The factor on the force that would explain the measurement, if there is one.
    fn factor(&self, expected: &Expected, fitted: usize) -> Option<String> {
        let f = DVector::from_iterator(self.all.len(), self.all.iter().map(|b| b.predicted_n));
        let whole = &expected.covariance + &expected.cell * expected.cell.transpose();
        let solved = whole.cholesky()?.solve(&f);
        let change = -solved.dot(&expected.residuals) / solved.dot(&f);
        let scaled = Expected { residuals: &expected.residuals + &f * change, ..expected.clone() };
        (scaled.chi(0..self.all.len(), fitted + 1)?.0 <= EXPLAINED).then(|| {
            format!(
                "a force {:.3} times the predicted one would explain it: calibrate material.shear_modulus_pa, or \
                 instrument.deformation_coefficient of a needle",
                1.0 + change
            )
        })
    }
}

impl Run {
    /// Whether the model explains the measurement as recorded and run. Only the load cell's zero is fitted.
    #[must_use]
    pub fn verdict(&self) -> Verdict {
        let mut verdict = judge(&Rows::of(self), 1, FORCE_ERROR);
        if self.measures_vectors() {
            for (k, name) in ["x", "y", "z"].into_iter().enumerate() {
                verdict = verdict.or_worse(judge(&Rows::of_component(self, k), 1, FORCE_ERROR), name);
            }
        }
        if verdict.explains != Explains::Yes && verdict.explains != Explains::NoMeasurement {
            verdict.reasons.extend(self.alignment().map(|a| a.reasons()).unwrap_or_default());
        }
        verdict.over_holes(&self.holes);
        verdict.reasons.extend(self.unstable());
        if let Some(reason) = &self.diverged {
            verdict.reasons.push(format!("the model diverged: {reason}"));
        }
        verdict
    }
}
