//! What the twin lacks, learnt from other recordings of the same scene.
//!
//! With the twin's force T, a factor s and the load cell's zero c, a recording is
//!
//! ```text
//! F(d) = c + s y(d)          c, s: least squares of c + s T over the first part, up to the cut
//! z = (ln s, y / T(cut))     at equally spaced depths d
//! z ~ N(m, S),  m ~ N(z_T, S / k)
//! ```
//!
//! z_T is the twin, y = T, which counts as k recordings; S is how samples differ, in softness, in shape, and in both together. With n other
//! recordings of mean e, of scatter matrix A, and with x the mean over the depths of (e - z_T)^2 over the variance between recordings:
//!
//! ```text
//! k = n / (1 + (n - 1) max(x - 1/n, 0))                    E (e - z_T)^2 = S (1/k + 1/n), damped by one degree of freedom
//! A' = A + k n / (k + n) (e - z_T)(e - z_T)^T              conjugate: A. Gelman et al., Bayesian Data Analysis 3.6
//! m = (k z_T + n e) / (k + n)
//! S = (A' + v W) / (n - 1 + v) (1 + 1 / (k + n))           W: variances of A', correlations of a Wiener process of the depth
//! ```
//!
//! W keeps S of full rank where n is small. The first part of the new recording conditions it, and the rest follows as the mean of a Gaussian
//! process would (C. E. Rasmussen and C. K. I. Williams 2006, 2.2). The band has Student's t of n degrees of freedom.

use nalgebra::{DMatrix, DVector};
use statrs::distribution::{ContinuousCDF, StudentsT};

use crate::calibrate::INTERVAL_95;
use crate::compare::Curve;

/// Fewest other recordings.
pub(crate) const FEWEST: usize = 2;
/// Number of equally spaced depths.
const PLACES: usize = 40;
/// Fewest of them in the first part.
const LEAST_SEEN: usize = 4;
/// v: what the Wiener process counts, in recordings.
const SMOOTH: f64 = 2.0;
/// Standard deviation of a depth's mean force that no other place shares, over the force at the cut.
const NOISE: f64 = 0.005;
/// That of ln s.
const LEVEL_NOISE: f64 = 0.01;
/// Share of the deepest depth by which another recording may be shallower.
const SHALLOWER: f64 = 0.01;
/// Share of the variance of a recording's first part that the twin has to explain: of a load cell that is dead, say, nothing is learnt.
const FOLLOWS: f64 = 0.5;
/// Least variance that counts as one.
const TINY: f64 = 1e-12;

/// The force with what others have taught.
#[derive(Clone, Debug, PartialEq)]
pub struct Corrected {
    /// At every pose, N, with the load cell's zero.
    pub force_n: Vec<f64>,
    /// A 1.96th of half the 95 % band, N.
    pub deviation_n: Vec<f64>,
    /// Recordings that the twin counts as.
    pub worth: f64,
    /// Number of other recordings.
    pub from: usize,
}

impl Corrected {
    /// Where it comes from, in words.
    #[must_use]
    pub(crate) fn words(&self) -> String {
        format!("corrected by {} other recordings; the twin counts as {:.1}", self.from, self.worth)
    }
}

/// Factor s and zero c with which c + s `twin` is nearest to `force`; `None` unless s > 0, and the force follows the twin.
fn affine(twin: &[f64], force: &[f64]) -> Option<[f64; 2]> {
    let n = twin.len().min(force.len()) as f64;
    let mean = |of: &[f64]| of.iter().sum::<f64>() / n;
    let (a, b) = (mean(twin), mean(force));
    let sum = |of: &dyn Fn(f64, f64) -> f64| twin.iter().zip(force).map(|(t, f)| of(t - a, f - b)).sum::<f64>();
    let (products, squares, variance) = (sum(&|t, f| t * f), sum(&|t, _| t * t), sum(&|_, f| f * f));
    let s = products / squares;
    let follows = products * s >= FOLLOWS * variance;
    (s > 0.0 && s.is_finite() && follows).then_some([s, b - s * a])
}

/// Corrects a twin's force. `depth_m`, `twin_n`: at every pose, without the load cell's zero. `fitted`: what was measured in the first part, as index of the pose and force.
/// `None` if the others are too few or not as deep, or the first part is too short.
#[must_use]
pub(crate) fn corrected(
    depth_m: &[f64],
    twin_n: &[f64],
    fitted: &[(usize, f64)],
    others: &[&Curve],
) -> Option<Corrected> {
    let deepest = depth_m.iter().copied().fold(0.0, f64::max);
    let place = |k: usize| deepest * (k + 1) as f64 / PLACES as f64;
    let (seen_m, seen_n): (Vec<f64>, Vec<f64>) = fitted.iter().map(|&(i, n)| (depth_m[i], n)).unzip();
    let seen_to = seen_m.iter().copied().fold(0.0, f64::max);
    let seen = (0..PLACES).take_while(|k| place(*k) <= seen_to).count();
    let at = |curve: &Curve| (0..PLACES).map(|k| curve.at(&curve.measured_n, place(k))).collect::<Vec<f64>>();
    let twin = at(&Curve::averaged(depth_m, twin_n));
    if seen < LEAST_SEEN || twin.iter().any(|t| *t <= 0.0) {
        return None;
    }
    let own = at(&Curve::averaged(&seen_m, &seen_n));
    let [s, zero_n] = affine(&twin[..seen], &own[..seen])?;
    // ln s, then the shape; the force at the cut is 1
    let unit = twin[seen - 1];
    let state = |force: &[f64], [s, c]: [f64; 2]| {
        DVector::from_iterator(1 + PLACES, std::iter::once(s.ln()).chain(force.iter().map(|f| (f - c) / (s * unit))))
    };
    let deep = |curve: &&&Curve| curve.depth_m.last().is_some_and(|end| *end >= (1.0 - SHALLOWER) * deepest);
    let one = |curve: &&Curve| -> Option<DVector<f64>> {
        let force = at(curve);
        Some(state(&force, affine(&twin[..seen], &force[..seen])?))
    };
    let states: Vec<DVector<f64>> = others.iter().filter(deep).filter_map(one).collect();
    if states.len() < FEWEST {
        return None;
    }
    let n = states.len() as f64;
    let mean = states.iter().sum::<DVector<f64>>() / n;
    let mut lacking = &mean - state(&twin, [1.0, 0.0]);
    lacking[0] = 0.0; // the twin says nothing of softness
    let mut scatter = states.iter().fold(DMatrix::zeros(1 + PLACES, 1 + PLACES), |sum, state| {
        let apart = state - &mean;
        sum + &apart * apart.transpose()
    });
    let between = (scatter.trace() - scatter[(0, 0)]) / (n - 1.0);
    let unexplained = (lacking.norm_squared() / between.max(TINY) - 1.0 / n).max(0.0);
    let worth = n / (1.0 + (n - 1.0) * unexplained);
    scatter += worth * n / (worth + n) * &lacking * lacking.transpose();
    let expected = &mean - &lacking * (worth / (worth + n));

    let alike = |a: usize, b: usize| match (a, b) {
        (0, 0) => 1.0,
        (0, _) | (_, 0) => 0.0,
        (a, b) => (a.min(b) as f64 / a.max(b) as f64).sqrt(),
    };
    let size = |a: usize| (scatter[(a, a)] / (n - 1.0)).max(TINY).sqrt();
    let covariance = DMatrix::from_fn(1 + PLACES, 1 + PLACES, |a, b| {
        let smooth = SMOOTH * alike(a, b) * size(a) * size(b);
        (scatter[(a, b)] + smooth) / (n - 1.0 + SMOOTH) * (1.0 + 1.0 / (worth + n))
    });
    let seen = 1 + seen;
    let noise = |a: usize| if a == 0 { LEVEL_NOISE } else { NOISE };
    let mut known = covariance.view((0, 0), (seen, seen)).into_owned();
    (0..seen).for_each(|a| known[(a, a)] += noise(a).powi(2));
    let known = known.cholesky()?;
    let cross = covariance.rows(0, seen);
    let own = state(&own, [s, zero_n]);
    let shape = &expected + cross.transpose() * known.solve(&(own.rows(0, seen) - expected.rows(0, seen)));
    let gain = known.solve(&cross);
    let variance = |a: usize| (covariance[(a, a)] - cross.column(a).dot(&gain.column(a))).max(0.0) + NOISE.powi(2);

    let t95 = StudentsT::new(0.0, 1.0, n).ok()?.inverse_cdf(0.975) / INTERVAL_95;
    let along = |values: &[f64], d: f64| {
        let x = (d / place(0) - 1.0).clamp(0.0, (PLACES - 1) as f64);
        let a = (x as usize).min(PLACES - 2);
        values[a] + (x - a as f64) * (values[a + 1] - values[a])
    };
    let factor: Vec<f64> = (0..PLACES).map(|k| shape[1 + k] * unit / twin[k]).collect();
    let wide: Vec<f64> = (0..PLACES).map(|k| s * unit * t95 * variance(1 + k).sqrt()).collect();
    let poses = || depth_m.iter().zip(twin_n);
    Some(Corrected {
        force_n: poses().map(|(d, t)| zero_n + s * t * along(&factor, *d)).collect(),
        deviation_n: poses().map(|(d, _)| along(&wide, *d)).collect(),
        worth,
        from: states.len(),
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    const POSES: usize = 400;

    /// A sample whose stiffening the twin, a line, lacks: by 1 on average, by `spread` from sample to sample, more where it is soft.
    fn sample(random: &mut ChaCha8Rng, spread: f64) -> (Vec<f64>, Vec<f64>) {
        let mut normal = || -> f64 { StandardNormal.sample(random) };
        let soft = normal();
        let (level, stiffening) = ((0.5 * soft).exp(), 1.0 - spread * (0.7 * soft + 0.7 * normal()));
        let depth: Vec<f64> = (0..POSES).map(|i| 0.01 * i as f64 / (POSES - 1) as f64).collect();
        let force = |d: &f64| level * (100.0 * d + stiffening * (100.0 * d).powi(4) + 2e-3 * normal());
        (depth.clone(), depth.iter().map(force).collect())
    }

    /// Error over the peak of the twin corrected by `n` others, that of the twin alone, and the share of the rest in the band; means over samples.
    fn tried(n: usize, spread: f64) -> [f64; 3] {
        let mut random = ChaCha8Rng::seed_from_u64(7);
        let mut sum = [0.0; 3];
        let samples = 60;
        for _ in 0..samples {
            let others: Vec<Curve> = (0..n)
                .map(|_| {
                    let (depth, force) = sample(&mut random, spread);
                    Curve::averaged(&depth, &force)
                })
                .collect();
            let (depth, force) = sample(&mut random, spread);
            let cut = POSES / 2;
            let fitted: Vec<(usize, f64)> = force[..cut].iter().copied().enumerate().collect();
            let found = corrected(&depth, &depth, &fitted, &others.iter().collect::<Vec<&Curve>>()).unwrap();
            assert_eq!(found.from, n);
            let rest = || cut..POSES;
            let rms = |of: &[f64]| (rest().map(|i| (of[i] - force[i]).powi(2)).sum::<f64>() / cut as f64).sqrt();
            let [s, c] = affine(&depth[..cut], &force[..cut]).unwrap();
            let alone: Vec<f64> = depth.iter().map(|d| c + s * d).collect();
            let inside = |i: &usize| (found.force_n[*i] - force[*i]).abs() <= INTERVAL_95 * found.deviation_n[*i];
            let peak = force[POSES - 1];
            let one =
                [rms(&found.force_n) / peak, rms(&alone) / peak, rest().filter(inside).count() as f64 / cut as f64];
            (0..3).for_each(|k| sum[k] += one[k] / f64::from(samples));
        }
        sum
    }

    #[test]
    fn others_teach_what_the_twin_lacks_and_the_band_holds() {
        for (n, spread, most) in [(2, 0.2, 0.07), (5, 0.2, 0.05), (20, 0.2, 0.04), (20, 0.02, 0.01)] {
            let [error, alone, held] = tried(n, spread);
            println!("{n} others, spread {spread}: {error} for {alone}, the band holds {held}");
            assert!(error < most && error < 0.5 * alone, "{n} others: {error} for {alone}");
            assert!(held > 0.88, "{n} others: {held}");
        }
    }

    /// Where the twin is right it counts for much, and where it is wrong for little.
    #[test]
    fn the_twin_counts_by_how_right_it_was() {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let samples: Vec<(Vec<f64>, Vec<f64>)> = (0..9).map(|_| sample(&mut random, 0.1)).collect();
        let curves: Vec<Curve> = samples[1..].iter().map(|(d, f)| Curve::averaged(d, f)).collect();
        let others: Vec<&Curve> = curves.iter().collect();
        let (depth, force) = &samples[0];
        let fitted: Vec<(usize, f64)> = force[..POSES / 2].iter().copied().enumerate().collect();
        let right: Vec<f64> = depth.iter().map(|d| 100.0 * d + (100.0 * d).powi(4)).collect();
        let worth = |twin: &[f64]| corrected(depth, twin, &fitted, &others).unwrap().worth;
        assert!(worth(&right) > 0.5 && worth(depth) < 0.1, "{} {}", worth(&right), worth(depth));
        // shallow ones and one alone say nothing
        assert!(corrected(depth, depth, &fitted, &others[..1]).is_none());
        let shallow = Curve::averaged(&depth[..200], &force[..200]);
        assert!(corrected(depth, depth, &fitted, &[&shallow, others[0]]).is_none());
        assert!(corrected(depth, depth, &fitted[..9], &others).is_none());
        // nor does a load cell that reads noise
        let dead =
            Curve::averaged(depth, &(0..POSES).map(|i| 1e-3 * f64::from((i * 7919 % 13) as u8)).collect::<Vec<f64>>());
        assert_eq!(corrected(depth, depth, &fitted, &[&dead, others[0], others[1]]).unwrap().from, 2);
    }
}
