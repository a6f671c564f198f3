//! Baselines: simple formulas that are fitted to the same readings as the twin and predict the same rest.
//!
//! A twin is worth its cost if it predicts a force better than these do. With the depth d >= 0, the force at contact
//! c and constants from linear least squares:
//!
//! ```text
//! spring        c + a d + b d^2
//! exponential   c + a (exp(d / l) - 1)                     l on a logarithmic grid
//! hertz         c + a d^(3/2)                              ball: H. Hertz 1882
//! punch         c + a d                                    flat indenter: I. N. Sneddon 1965
//! column        c + a (1 / s^2 - s),  s = 1 - d / H        plate: neo-Hookean column of height H, smooth plates
//! needle        c + a d + b d^2                            before the puncture at the depth p
//!               c + C [the tip cuts] + f d v               after it; v = 1 inwards, -1 outwards
//! last value    the mean of the last readings
//! others        c + a F(d),  F: mean curve of other recordings
//! ```
//!
//! The needle is the lumped model of Okamura, Simone and O'Leary (IEEE Transactions on Biomedical Engineering 51,
//! 2004). Its p is the one with the least Bayesian information criterion. Without one the model is the spring, and
//! is left out.

use nalgebra::{DMatrix, DVector, SMatrix, SVector};
use serde::{Deserialize, Serialize};

use crate::calibrate::{Calibration, rmse};
use crate::compare::rows::Rows;
use crate::compare::{Curve, Run};
use needle_core::scene::{IndenterTip, InstrumentKind, Scene};

/// Name of the mean of other recordings.
pub(crate) const OTHERS: &str = "others";
/// Fewest fitted readings under which nothing is said.
const LEAST_FITTED: usize = 5;
/// Number of lengths of the exponential that are tried, and their range over the deepest fitted depth.
const LENGTHS: usize = 96;
const LENGTH_RANGE: [f64; 2] = [0.05, 50.0];
/// Most fitted readings that are used, evenly spread.
const MOST_FITTED: usize = 2000;
/// Least height of a column over its height at rest.
const FLATTEST: f64 = 0.05;
/// Number of depths at which a puncture is tried, and then about the best of them.
const PUNCTURES: usize = 64;
const CLOSER: usize = 16;
/// Number of readings of which the last value is the mean.
const LAST: usize = 5;
/// Reversals of the motion below this share of the deepest depth are noise.
const TURN: f64 = 0.01;
/// Eigenvalues of the normal matrix below this share of the largest are zero.
const SINGULAR: f64 = 1e-9;
/// Part of the insertion that a recording without a fit is split at.
const HALF: f64 = 0.5;
/// Relative difference of two errors up to which one model is as good as the other.
const AS_GOOD: f64 = 0.1;

/// The force of a baseline at every depth of a motion.
#[derive(Clone, Debug, PartialEq)]
pub struct Forecast {
    /// Name of the formula.
    pub name: &'static str,
    /// Force at each depth, N, the load cell's zero included.
    pub force_n: Vec<f64>,
}

/// Baselines that apply to a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Contact {
    Ball,
    Flat,
    Plate { height_m: f64 },
    Needle,
    Unknown,
}

impl Contact {
    fn of(scene: Option<&Scene>) -> Self {
        let Some((scene, instrument)) = scene.and_then(|scene| Some((scene, scene.instrument?))) else {
            return Self::Unknown;
        };
        match instrument.kind {
            InstrumentKind::Plate => {
                scene.sample.shape.height().map_or(Self::Unknown, |h| Self::Plate { height_m: h.get() })
            }
            InstrumentKind::Indenter { tip: IndenterTip::Sphere, .. } => Self::Ball,
            InstrumentKind::Indenter { .. } => Self::Flat,
            InstrumentKind::Needle(_) => Self::Needle,
        }
    }
}

/// Fits every baseline that applies to the first readings of a motion, and evaluates it over all of it.
///
/// `depth_m` holds the depth of every pose, m. `measured` holds the index of a pose and the force there, N; poses
/// after the last of them are predicted. Empty if there are too few readings.
#[must_use]
pub(crate) fn forecasts(
    scene: Option<&Scene>,
    depth_m: &[f64],
    measured: &[(usize, f64)],
    others: &[&Curve],
) -> Vec<Forecast> {
    let loaded = measured.iter().filter(|(i, _)| depth_m[*i] > 0.0).count();
    if loaded < LEAST_FITTED {
        return Vec::new();
    }
    let thinned = measured.iter().copied().step_by(measured.len().div_ceil(MOST_FITTED)).collect();
    let fit = Fit { depth_m, measured: thinned };
    let contact = Contact::of(scene);
    let all = [
        Some(("spring", fit.spring())),
        Some(("exponential", fit.exponential())),
        fit.formula(contact),
        fit.others(others).map(|force_n| (OTHERS, force_n)),
        Some(("last value", last_value(measured, depth_m.len()))),
    ];
    let finite = |f: &Forecast| f.force_n.iter().all(|n| n.is_finite());
    all.into_iter().flatten().map(|(name, force_n)| Forecast { name, force_n }).filter(finite).collect()
}

/// Readings to which baselines are fitted.
struct Fit<'a> {
    depth_m: &'a [f64],
    measured: Vec<(usize, f64)>,
}

/// One term of a formula at a pose, by its index.
type Term<'a> = &'a dyn Fn(usize) -> f64;

impl Fit<'_> {
    fn depth(&self, i: usize) -> f64 {
        self.depth_m[i].max(0.0)
    }

    fn deepest_fitted_m(&self) -> f64 {
        self.measured.iter().map(|(i, _)| self.depth(*i)).fold(0.0, f64::max)
    }

    /// Constants with which a sum of terms has the least sum of squares, and that sum, N^2.
    fn linear<const K: usize>(&self, terms: [Term; K]) -> ([f64; K], f64) {
        let row = |i: usize| SVector::<f64, K>::from_fn(|a, _| terms[a](i));
        let (mut normal, mut right) = (SMatrix::<f64, K, K>::zeros(), SVector::<f64, K>::zeros());
        for &(i, measured_n) in &self.measured {
            let row = row(i);
            normal += row * row.transpose();
            right += measured_n * row;
        }
        // columns of unit length, since powers of a depth in metres differ by orders of magnitude
        let size = SVector::<f64, K>::from_fn(|a, _| if normal[(a, a)] > 0.0 { normal[(a, a)].sqrt() } else { 1.0 });
        let scaled = SMatrix::<f64, K, K>::from_fn(|a, b| normal[(a, b)] / (size[a] * size[b]));
        // terms that the readings can't tell apart share their constant
        let eigen = DMatrix::from_iterator(K, K, scaled.iter().copied()).symmetric_eigen();
        let largest = eigen.eigenvalues.amax();
        let right = DVector::from_iterator(K, right.component_div(&size).iter().copied());
        let mut values = [0.0; K];
        for (value, vector) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
            if *value > SINGULAR * largest {
                let share = vector.dot(&right) / value;
                (0..K).for_each(|a| values[a] += share * vector[a] / size[a]);
            }
        }
        let force = |i: usize| row(i).dot(&SVector::from(values));
        let squares = self.measured.iter().map(|&(i, n)| (force(i) - n).powi(2)).sum();
        (values, squares)
    }

    /// The sum of terms at every pose, N.
    fn everywhere<const K: usize>(&self, terms: [Term; K], values: [f64; K]) -> Vec<f64> {
        (0..self.depth_m.len()).map(|i| (0..K).map(|a| values[a] * terms[a](i)).sum()).collect()
    }

    /// Fits and evaluates.
    fn of<const K: usize>(&self, terms: [Term; K]) -> Vec<f64> {
        self.everywhere(terms, self.linear(terms).0)
    }

    fn spring(&self) -> Vec<f64> {
        self.of([&|_| 1.0, &|i| self.depth(i), &|i| self.depth(i).powi(2)])
    }

    fn exponential(&self) -> Vec<f64> {
        let deepest = self.deepest_fitted_m();
        let [low, high] = LENGTH_RANGE;
        let length = |k: usize| deepest * low * (high / low).powf(k as f64 / (LENGTHS - 1) as f64);
        let misfit = |k: &usize| self.linear([&|_| 1.0, &|i| (self.depth(i) / length(*k)).exp_m1()]).1;
        let best = (0..LENGTHS).min_by(|a, b| misfit(a).total_cmp(&misfit(b))).unwrap_or(0);
        self.of([&|_| 1.0, &|i| (self.depth(i) / length(best)).exp_m1()])
    }

    /// The formula of the instrument.
    fn formula(&self, contact: Contact) -> Option<(&'static str, Vec<f64>)> {
        let of_depth = |term: &dyn Fn(f64) -> f64| self.of([&|_| 1.0, &|i| term(self.depth(i))]);
        match contact {
            Contact::Ball => Some(("hertz", of_depth(&|d| d.powf(1.5)))),
            Contact::Flat => Some(("punch", of_depth(&|d| d))),
            Contact::Plate { height_m } => {
                let stretch = |d: f64| (1.0 - d / height_m).max(FLATTEST);
                Some(("column", of_depth(&|d| stretch(d).powi(-2) - stretch(d))))
            }
            Contact::Needle => self.needle().map(|force_n| ("needle", force_n)),
            Contact::Unknown => None,
        }
    }

    fn needle(&self) -> Option<Vec<f64>> {
        let Passage { sign, farthest_m, cuts } = Passage::of(self.depth_m);
        let deepest = self.deepest_fitted_m();
        let place = |k: usize| deepest * k as f64 / PUNCTURES as f64;
        let before = |i: usize, p: f64, term: f64| if farthest_m[i] >= p { 0.0 } else { term };
        let inside = |i: usize, p: f64, term: f64| if farthest_m[i] >= p && self.depth(i) > 0.0 { term } else { 0.0 };
        let stiff = |i: usize, p: f64| before(i, p, self.depth(i));
        let stiffer = |i: usize, p: f64| before(i, p, self.depth(i).powi(2));
        let cutting = |i: usize, p: f64| inside(i, p, f64::from(u8::from(cuts[i])));
        let friction = |i: usize, p: f64| inside(i, p, sign[i] * self.depth(i));
        let with = |p: f64, fitted: bool| {
            let terms: [Term; 5] =
                [&|_| 1.0, &|i| stiff(i, p), &|i| stiffer(i, p), &|i| cutting(i, p), &|i| friction(i, p)];
            let (values, squares) = self.linear(terms);
            (squares, if fitted { self.everywhere(terms, values) } else { Vec::new() })
        };
        let misfit = |p: f64| (p, with(p, false).0);
        let least = |a: &(f64, f64), b: &(f64, f64)| a.1.total_cmp(&b.1);
        let (near, _) = (1..PUNCTURES).map(|k| misfit(place(k))).min_by(least)?;
        let closer = |k: usize| near + place(1) * (2.0 * k as f64 / CLOSER as f64 - 1.0);
        let (p, squares) = (1..CLOSER).map(|k| misfit(closer(k))).min_by(least)?;
        let spring = self.linear([&|_| 1.0, &|i| self.depth(i), &|i| self.depth(i).powi(2)]).1;
        // five constants and the depth of the puncture, against three
        (self.information(squares, 6.0) < self.information(spring, 3.0)).then(|| with(p, true).1)
    }

    /// Bayesian information criterion (G. Schwarz 1978) of a least-squares fit; lower is better.
    fn information(&self, squares: f64, unknowns: f64) -> f64 {
        let n = self.measured.len() as f64;
        n * (squares / n).max(f64::MIN_POSITIVE).ln() + unknowns * n.ln()
    }

    /// The mean curve of other recordings, scaled. `None` if none of them goes as deep as this one.
    fn others(&self, others: &[&Curve]) -> Option<Vec<f64>> {
        let deepest = self.depth_m.iter().copied().fold(0.0, f64::max);
        let reach = |curve: &&&Curve| curve.depth_m.last().is_some_and(|end| *end >= (1.0 - TURN) * deepest);
        let deep: Vec<&Curve> = others.iter().filter(reach).copied().collect();
        let mean = |i: usize| deep.iter().map(|c| c.at(&c.measured_n, self.depth(i))).sum::<f64>() / deep.len() as f64;
        (!deep.is_empty()).then(|| self.of([&|_| 1.0, &mean]))
    }
}

fn last_value(measured: &[(usize, f64)], poses: usize) -> Vec<f64> {
    let last = &measured[measured.len().saturating_sub(LAST)..];
    vec![last.iter().map(|(_, n)| n).sum::<f64>() / last.len().max(1) as f64; poses]
}

/// Direction of the motion at each pose, and how far the tip had been.
struct Passage {
    /// 1 inwards, -1 outwards; a stay keeps the direction before it.
    sign: Vec<f64>,
    /// Deepest depth so far, m.
    farthest_m: Vec<f64>,
    /// Whether the tip is where no tip was before.
    cuts: Vec<bool>,
}

impl Passage {
    fn of(depth_m: &[f64]) -> Self {
        let least = TURN * depth_m.iter().copied().fold(0.0, f64::max);
        let mut sign = vec![1.0; depth_m.len()];
        // the farthest pose in the present direction
        let (mut now, mut turn) = (1.0, 0);
        for i in 0..depth_m.len() {
            let beyond = now * (depth_m[i] - depth_m[turn]);
            if beyond < -least {
                now = -now;
                sign[turn + 1..i].fill(now);
            }
            if beyond >= 0.0 || beyond < -least {
                turn = i;
            }
            sign[i] = now;
        }
        let mut farthest = 0.0_f64;
        let farthest_m: Vec<f64> = depth_m.iter().map(|d| (farthest = farthest.max(*d), farthest).1).collect();
        let cuts = (0..depth_m.len()).map(|i| sign[i] > 0.0 && depth_m[i] > farthest_m[i] - least).collect();
        Self { sign, farthest_m, cuts }
    }
}

/// Whether a twin predicts better than the best baseline.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Against {
    /// Its error is smaller by more than a tenth.
    Better,
    /// The errors differ by less.
    AsGood,
    /// Its error is larger by more than a tenth.
    Worse,
    /// There is no measurement, or too little of it.
    #[default]
    NoMeasurement,
}

impl Against {
    /// The name in files.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Better => "better",
            Self::AsGood => "as good",
            Self::Worse => "worse",
            Self::NoMeasurement => "no measurement",
        }
    }

    /// Compares two errors.
    #[must_use]
    pub(crate) fn of(twin_n: f64, baseline_n: f64) -> Self {
        if !twin_n.is_finite() || !baseline_n.is_finite() {
            Self::NoMeasurement
        } else if twin_n <= baseline_n / (1.0 + AS_GOOD) {
            Self::Better
        } else if twin_n <= baseline_n * (1.0 + AS_GOOD) {
            Self::AsGood
        } else {
            Self::Worse
        }
    }
}

/// The error of one baseline.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Baseline {
    /// Name of the formula.
    pub name: String,
    /// Root mean square of its force - measured over the predicted readings, N.
    pub rmse_n: f64,
}

/// Errors of a twin and of the baselines over the same readings.
#[derive(Clone, Debug, PartialEq, Default, Serialize, Deserialize)]
pub struct Standing {
    /// What the baselines were fitted to, in words.
    pub fitted_to: String,
    /// Whether the readings that are compared come after those that were fitted. Otherwise they are the same.
    pub predicted: bool,
    /// Number of readings that are compared.
    pub readings: usize,
    /// Root mean square of the twin's force - measured over them, N.
    pub twin_rmse_n: f64,
    /// The same of c + a F with the twin's force F, fitted to what the baselines are fitted to; where nothing of the twin was fitted.
    #[serde(default)]
    pub scaled_rmse_n: Option<f64>,
    /// The baselines.
    pub baselines: Vec<Baseline>,
}

impl Standing {
    /// Compares over some of the readings. `twin_n` and `measured_n` have one entry for each pose.
    #[must_use]
    pub(crate) fn over(readings: &[usize], twin_n: &[f64], measured_n: &[f64], forecasts: &[Forecast]) -> Option<Self> {
        let measured: Vec<f64> = readings.iter().map(|&i| measured_n[i]).collect();
        let error = |of: &[f64]| rmse(&measured, &readings.iter().map(|&i| of[i]).collect::<Vec<f64>>());
        (!readings.is_empty()).then(|| Self {
            fitted_to: String::new(),
            predicted: true,
            readings: readings.len(),
            twin_rmse_n: error(twin_n),
            scaled_rmse_n: None,
            baselines: forecasts
                .iter()
                .map(|f| Baseline { name: f.name.to_owned(), rmse_n: error(&f.force_n) })
                .collect(),
        })
    }

    /// The baseline with the least error.
    #[must_use]
    pub fn best(&self) -> Option<&Baseline> {
        self.baselines.iter().min_by(|a, b| a.rmse_n.total_cmp(&b.rmse_n))
    }

    /// The twin against the best of them.
    #[must_use]
    pub fn against(&self) -> Against {
        self.best().map_or(Against::NoMeasurement, |best| Against::of(self.twin_rmse_n, best.rmse_n))
    }

    /// The comparison in one sentence.
    #[must_use]
    pub fn sentence(&self) -> String {
        let word = match self.against() {
            Against::Better => "the twin is better than every baseline",
            Against::AsGood => "the twin is as good as the best baseline",
            Against::Worse => "the twin is worse than the best baseline",
            Against::NoMeasurement => return "no baseline could be fitted".to_owned(),
        };
        let all: Vec<String> = self.baselines.iter().map(|b| format!("{} {:.6} N", b.name, b.rmse_n)).collect();
        let over = if self.predicted { "in the rest" } else { "over the same readings" };
        let scaled = self
            .scaled_rmse_n
            .map_or_else(String::new, |n| format!(", its force scaled to the same readings {n:.6} N"));
        format!(
            "{word}: {over} twin {:.6} N{scaled}, {} (fitted to {})",
            self.twin_rmse_n,
            all.join(", "),
            self.fitted_to
        )
    }
}

impl Run {
    /// Baselines that are fitted to the insertion up to half of its depth, against the twin in the rest. Nothing of
    /// the twin is fitted. `None` if nothing was measured there.
    #[must_use]
    pub fn standing(&self) -> Option<Standing> {
        let rows = Rows::of(self);
        let half = HALF * rows.deepest_m();
        let cut = rows.depth_m.iter().position(|d| *d > half)?;
        let measured: Vec<(usize, f64)> = rows.measured_n[..cut].iter().copied().enumerate().collect();
        let scene: Option<Scene> = Scene::from_toml(&self.scene_toml, &self.scene).ok();
        let forecasts = forecasts(scene.as_ref(), &rows.depth_m, &measured, &[]);
        let rest: Vec<usize> = (cut..rows.len()).collect();
        let standing = Standing::over(&rest, &rows.predicted_n, &rows.measured_n, &forecasts)
            .filter(|standing| !standing.baselines.is_empty())?;
        let thinned = measured.iter().copied().step_by(measured.len().div_ceil(MOST_FITTED)).collect();
        let scaled = Fit { depth_m: &rows.depth_m, measured: thinned }.of([&|_| 1.0, &|i| rows.predicted_n[i]]);
        let [scaled, known] = [&scaled, &rows.measured_n].map(|of| rest.iter().map(|&i| of[i]).collect::<Vec<f64>>());
        let fitted_to = format!("{cut} readings before {:.3} mm", 1e3 * half);
        Some(Standing { fitted_to, scaled_rmse_n: Some(rmse(&known, &scaled)), ..standing })
    }
}

impl Calibration {
    /// Baselines that are fitted to the same readings, over the readings held out; without such, over the fitted
    /// ones.
    #[must_use]
    pub fn standing(&self) -> Option<Standing> {
        let (forces, fitted) = (&self.forces, self.parts.fitted.clone());
        let measured: Vec<(usize, f64)> = fitted.clone().map(|i| (i, forces.measured_n[i])).collect();
        let forecasts = forecasts(Some(&self.scene), &forces.depth_m, &measured, &[]);
        let held = self.parts.held_out.clone().filter(|held| !held.is_empty());
        let over: Vec<usize> = held.clone().unwrap_or(fitted).collect();
        let standing = Standing::over(&over, &forces.fitted_n, &forces.measured_n, &forecasts)
            .filter(|standing| !standing.baselines.is_empty())?;
        let fitted_to = format!("the {} readings that the twin was fitted to", measured.len());
        Some(Standing { fitted_to, predicted: held.is_some(), ..standing })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn ramp(n: usize, to_m: f64) -> Vec<f64> {
        (0..n).map(|i| to_m * i as f64 / (n - 1) as f64).collect()
    }

    fn first(depth: &[f64], force: impl Fn(usize) -> f64, share: f64) -> Vec<(usize, f64)> {
        (0..(share * depth.len() as f64) as usize).map(|i| (i, force(i))).collect()
    }

    fn named<'a>(all: &'a [Forecast], name: &str) -> &'a Forecast {
        all.iter().find(|f| f.name == name).expect("it applies")
    }

    proptest! {
        /// A baseline predicts the rest of a force that follows its own formula.
        #[test]
        fn a_spring_finds_a_spring(a in -50.0..50.0f64, b in -1e4..1e4f64, c in -1.0..1.0f64) {
            let depth = ramp(200, 0.01);
            let force = |i: usize| c + a * depth[i] + b * depth[i] * depth[i];
            let all = forecasts(None, &depth, &first(&depth, force, 0.5), &[]);
            let spring = named(&all, "spring");
            for i in 0..depth.len() {
                prop_assert!((spring.force_n[i] - force(i)).abs() < 1e-6 * (1.0 + a.abs() * 0.01 + b.abs() * 1e-4));
            }
        }

        #[test]
        fn an_exponential_finds_an_exponential(l in 0.001..0.01f64) {
            let depth = ramp(200, 0.01);
            let force = |i: usize| 0.01 * (depth[i] / l).exp_m1();
            let all = forecasts(None, &depth, &first(&depth, force, 0.7), &[]);
            let end = named(&all, "exponential").force_n[199];
            prop_assert!((end / force(199) - 1.0).abs() < 0.15, "{end} for {}", force(199));
        }
    }

    #[test]
    fn the_lumped_needle_finds_friction_and_cutting_and_turns_round() {
        let scene = Scene::preset("needle_insertion").expect("a preset");
        let mut depth = ramp(300, 0.02);
        depth.extend(ramp(300, 0.02).into_iter().rev());
        let force = |i: usize| match (i < 300, depth[i] < 0.004) {
            (true, true) => 20.0 * depth[i],
            (true, false) => 0.03 + 4.0 * depth[i],
            (false, _) => -4.0 * depth[i],
        };
        // fitted to the insertion and a little of the way out
        let all = forecasts(Some(&scene), &depth, &first(&depth, force, 0.55), &[]);
        let needle = named(&all, "needle");
        for i in 310..600 {
            assert!((needle.force_n[i] - force(i)).abs() < 4e-3, "{} for {}", needle.force_n[i], force(i));
        }
        assert!((named(&all, "spring").force_n[500] - force(500)).abs() > 0.02, "a spring does not turn round");
    }

    #[test]
    fn formulas_are_those_of_the_instrument() {
        let depth = ramp(100, 0.005);
        let of = |name: &str, set: &[&str]| -> Vec<&'static str> {
            let changes: Vec<_> =
                set.iter().map(|s| needle_core::scene::Override::parse(s, "test").expect("a change")).collect();
            let scene = Scene::preset(name).expect("a preset").with(&changes).expect("it is valid");
            forecasts(Some(&scene), &depth, &first(&depth, |i| depth[i], 0.5), &[]).iter().map(|f| f.name).collect()
        };
        assert_eq!(of("indentation", &[]), ["spring", "exponential", "punch", "last value"]);
        assert!(of("indentation", &["instrument.tip=sphere"]).contains(&"hertz"));
        assert!(of("compression", &[]).contains(&"column"));
    }

    #[test]
    fn too_few_readings_have_no_baseline_and_a_tenth_is_as_good() {
        let depth = ramp(100, 0.005);
        assert!(forecasts(None, &depth, &[(1, 0.0), (2, 0.1)], &[]).is_empty());
        assert_eq!(Against::of(1.0, 1.2), Against::Better);
        assert_eq!(Against::of(1.0, 1.05), Against::AsGood);
        assert_eq!(Against::of(1.05, 1.0), Against::AsGood);
        assert_eq!(Against::of(1.2, 1.0), Against::Worse);
        assert_eq!(Against::of(f64::NAN, 1.0), Against::NoMeasurement);
    }

    #[test]
    fn other_recordings_are_scaled_and_must_go_as_deep() {
        let depth = ramp(100, 0.005);
        let curve = |end: f64| {
            let depth_m = ramp(49, end);
            let measured_n = depth_m.iter().map(|d| d.powi(3)).collect();
            Curve { predicted_n: vec![0.0; 49], depth_m, measured_n }
        };
        let force = |i: usize| 0.5 + 3e6 * depth[i].powi(3);
        let (deep, shallow) = (curve(0.006), curve(0.003));
        let all = forecasts(None, &depth, &first(&depth, force, 0.6), &[&deep, &shallow]);
        assert!((named(&all, "others").force_n[99] / force(99) - 1.0).abs() < 0.01);
        let all = forecasts(None, &depth, &first(&depth, force, 0.6), &[&shallow]);
        assert!(all.iter().all(|f| f.name != "others"));
    }
}
