//! Pooled estimates: for the recordings of one sample, and for samples of one kind.
//!
//! With `together = true` the recordings of a sample are one least-squares problem (`calibrate::joint`). Otherwise a
//! key that n recordings of a sample share is pooled from their separate fits, each with its own zero and contact
//! depth. Let x_i be the estimate of recording i, with standard error e_i. To second order of the sum of squares, the
//! pooled estimate equals that of one joint fit:
//!
//! ```text
//! x = sum w_i x_i / sum w_i,   w_i = 1 / (e_i^2 + t^2),   t^2 = max(0, (Q - (n - 1)) / (S1 - S2 / S1))
//! Q = sum (x_i - x_0)^2 / e_i^2,  S1 = sum 1 / e_i^2,  S2 = sum 1 / e_i^4,  x_0 the mean with t = 0
//! ```
//!
//! t is the spread of repeats beyond their errors (DerSimonian and Laird, Control. Clin. Trials 7, 1986). For the
//! spread within and between samples of one kind see `mixed`.
//!
//! Leave-one-out: each recording is predicted by the mean curve of the sample's other recordings, over the depth
//! since contact.

use std::collections::BTreeMap;

use serde::Serialize;

use super::choice::choose;
use super::mixed::Components;
use super::{Fit, Row, SampleRow};

/// Pooled estimate of a key over the recordings of one sample.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Pooled {
    /// Dotted path.
    pub key: String,
    /// Pooled estimate.
    pub value: f64,
    /// Its standard error, from noise and from the spread of the repeats.
    pub standard_error: Option<f64>,
    /// Standard deviation of the repeats.
    pub spread: Option<f64>,
    /// Number of recordings.
    pub count: usize,
    /// Whether the value is from one joint fit to all recordings. Otherwise it is the mean of separate fits.
    pub together: bool,
}

/// One sample.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Sample {
    /// Its name.
    pub name: String,
    /// Its kind.
    pub group: String,
    /// The candidate that was chosen for the kind.
    pub candidate: String,
    /// Pooled keys of that candidate.
    pub keys: Vec<Pooled>,
    /// For each recording its name and the relative error of its prediction by the others, divided by the peak force.
    pub left_one_out: Vec<(String, f64)>,
}

/// Samples of one kind.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Group {
    /// Its name.
    pub name: String,
    /// The candidate that was chosen.
    pub candidate: String,
    /// The error of each candidate on which the choice was based: root mean square over the recordings, divided by
    /// the peak force. It is the error of the prediction within the fitted part if that was requested, and otherwise
    /// of the fit.
    pub candidates: Vec<(String, Option<f64>)>,
    /// Key, mean, standard deviation within samples, standard deviation between samples.
    pub keys: Vec<(String, f64, Option<f64>, Option<f64>)>,
    /// Largest relative error, by magnitude, at the end of the predicted part.
    pub largest_end_error: Option<f64>,
    /// Mean of that error.
    pub mean_end_error: Option<f64>,
    /// Number of recordings that were predicted, and of those within 5 % at the end.
    pub predicted: usize,
    /// See `predicted`.
    pub within_5_percent: usize,
}

fn by(rows: &[Row], of: impl Fn(&Row) -> &String) -> BTreeMap<String, Vec<&Row>> {
    let mut all: BTreeMap<String, Vec<&Row>> = BTreeMap::new();
    rows.iter().for_each(|row| all.entry(of(row).clone()).or_default().push(row));
    all
}

/// Values of a key with their standard errors.
fn values(rows: &[&Row], candidate: &str, key: &str) -> Vec<(f64, Option<f64>)> {
    let of = |row: &&Row| row.fit(candidate)?.keys.iter().find(|k| k.key == key).map(|k| (k.value, k.noise_error));
    rows.iter().filter_map(of).collect()
}

fn keys(rows: &[&Row], candidate: &str) -> Vec<String> {
    let first = rows.iter().find_map(|row| row.fit(candidate));
    first.map_or_else(Vec::new, |fit| fit.keys.iter().map(|k| k.key.clone()).collect())
}

fn mean(x: &[f64]) -> f64 {
    x.iter().sum::<f64>() / x.len().max(1) as f64
}

fn squares(x: &[f64]) -> f64 {
    let m = mean(x);
    x.iter().map(|x| (x - m) * (x - m)).sum()
}

/// The pooled estimate; see the module.
fn pooled(key: &str, values: &[(f64, Option<f64>)]) -> Option<Pooled> {
    let n = values.len();
    let x: Vec<f64> = values.iter().map(|v| v.0).collect();
    let spread = (n > 1).then(|| (squares(&x) / (n - 1) as f64).sqrt());
    let errors: Option<Vec<f64>> = values.iter().map(|v| v.1.filter(|e| *e > 0.0)).collect();
    let Some(errors) = errors.filter(|e| !e.is_empty()) else {
        // without standard errors all values have equal weight
        let standard_error = spread.map(|s| s / (n as f64).sqrt());
        return (n > 0).then(|| Pooled {
            key: key.to_owned(),
            value: mean(&x),
            standard_error,
            spread,
            count: n,
            together: false,
        });
    };
    let weighted = |t2: f64| {
        let w: Vec<f64> = errors.iter().map(|e| 1.0 / (e * e + t2)).collect();
        let sum: f64 = w.iter().sum();
        (w.iter().zip(&x).map(|(w, x)| w * x).sum::<f64>() / sum, sum)
    };
    let (x0, s1) = weighted(0.0);
    let q: f64 = errors.iter().zip(&x).map(|(e, x)| ((x - x0) / e).powi(2)).sum();
    let s2: f64 = errors.iter().map(|e| e.powi(-4)).sum();
    let t2 = if n > 1 { ((q - (n - 1) as f64) / (s1 - s2 / s1)).max(0.0) } else { 0.0 };
    let (value, sum) = weighted(t2);
    Some(Pooled { key: key.to_owned(), value, standard_error: Some(sum.powf(-0.5)), spread, count: n, together: false })
}

/// Replaces the pooled estimate by that of the joint fit, if there is one.
fn together(pooled: Pooled, joint: &[SampleRow], sample: &str, candidate: &str) -> Pooled {
    let row = joint.iter().find(|row| row.name == sample);
    let fit = row.and_then(|row| row.fits.iter().find(|fit| fit.candidate == candidate && fit.failed.is_none()));
    match fit.and_then(|fit| fit.keys.iter().find(|key| key.key == pooled.key)) {
        Some(key) => Pooled { value: key.value, standard_error: key.standard_error, together: true, ..pooled },
        None => pooled,
    }
}

/// Error of each recording's prediction by the mean of the others.
fn left_one_out(rows: &[&Row], candidate: &str) -> Vec<(String, f64)> {
    let fits: Vec<(&str, &Fit)> =
        rows.iter().filter_map(|row| Some((row.name.as_str(), row.fit(candidate)?))).collect();
    let one = |(i, (name, fit)): (usize, &(&str, &Fit))| {
        let others: Vec<&Fit> = fits.iter().enumerate().filter(|(j, _)| *j != i).map(|(_, f)| f.1).collect();
        let peak = fit.curve.measured_n.iter().map(|f| f.abs()).fold(0.0, f64::max);
        if others.is_empty() || peak == 0.0 {
            return None;
        }
        let error = |(d, m): (&f64, &f64)| {
            let sum: f64 = others.iter().map(|o| o.curve.at(&o.curve.predicted_n, *d)).sum();
            (sum / others.len() as f64 - m).powi(2)
        };
        // compare only down to the depth that all of them reach
        let common = others.iter().filter_map(|o| o.curve.depth_m.last().copied()).fold(f64::INFINITY, f64::min);
        let places = fit.curve.depth_m.iter().zip(&fit.curve.measured_n).filter(|(d, _)| **d <= common);
        let squares: Vec<f64> = places.map(error).collect();
        Some(((*name).to_owned(), mean(&squares).sqrt() / peak))
    };
    fits.iter().enumerate().filter_map(one).collect()
}

/// All groups and samples of the rows.
pub(super) fn pool(rows: &[Row], joint: &[SampleRow]) -> (Vec<Group>, Vec<Sample>) {
    let (mut groups, mut samples) = (Vec::new(), Vec::new());
    let choices: BTreeMap<String, _> =
        by(rows, |row| &row.chosen_for).into_iter().map(|(name, of)| (name, choose(&of))).collect();
    for (name, of_group) in by(rows, |row| &row.group) {
        let of_group_alone = || choose(&of_group);
        let choice = of_group.first().and_then(|row| choices.get(&row.chosen_for)).cloned();
        let (candidates, candidate) = choice.unwrap_or_else(of_group_alone);
        let mut of_samples: BTreeMap<&str, Vec<&Row>> = BTreeMap::new();
        of_group.iter().for_each(|row| of_samples.entry(&row.sample).or_default().push(row));
        for (sample, rows) in &of_samples {
            let keys = keys(rows, &candidate);
            samples.push(Sample {
                name: (*sample).to_owned(),
                group: name.clone(),
                candidate: candidate.clone(),
                keys: keys
                    .iter()
                    .filter_map(|key| pooled(key, &values(rows, &candidate, key)))
                    .map(|one| together(one, joint, sample, &candidate))
                    .collect(),
                left_one_out: left_one_out(rows, &candidate),
            });
        }
        let components = keys(&of_group, &candidate).into_iter().filter_map(|key| {
            let each: Vec<Vec<f64>> = of_samples
                .values()
                .map(|rows| values(rows, &candidate, &key).iter().map(|v| v.0).collect())
                .filter(|v: &Vec<f64>| !v.is_empty())
                .collect();
            let found = Components::of(&each);
            found.map(|Components { mean, within, between, .. }| (key, mean, within, between))
        });
        let ends: Vec<f64> = of_group
            .iter()
            .filter_map(|row| row.fit(&candidate)?.held_out.as_ref().map(super::HeldOut::end_error))
            .filter(|e| e.is_finite())
            .collect();
        groups.push(Group {
            keys: components.collect(),
            largest_end_error: ends.iter().copied().max_by(|a, b| a.abs().total_cmp(&b.abs())),
            mean_end_error: (!ends.is_empty()).then(|| mean(&ends)),
            predicted: ends.len(),
            within_5_percent: ends.iter().filter(|e| e.abs() <= 0.05).count(),
            name,
            candidate,
            candidates,
        });
    }
    (groups, samples)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn repeats_that_agree_are_weighted_by_their_errors() {
        let joint = pooled("k", &[(1.0, Some(0.1)), (1.1, Some(0.2))]).unwrap();
        assert!((joint.value - (1.0 / 0.01 + 1.1 / 0.04) / (1.0 / 0.01 + 1.0 / 0.04)).abs() < 1e-12);
        assert!((joint.standard_error.unwrap() - 125f64.powf(-0.5)).abs() < 1e-12);
        // if the values differ by far more than their errors, the weights are equal and the error is that of their
        // spread
        let apart = pooled("k", &[(1.0, Some(1e-3)), (2.0, Some(2e-3))]).unwrap();
        assert!((apart.value - 1.5).abs() < 1e-3 && (apart.standard_error.unwrap() - 0.5).abs() < 1e-2, "{apart:?}");
    }
}
