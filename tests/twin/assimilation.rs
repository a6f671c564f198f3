//! Contract of assimilation: forecasts hold what they say, also where the model is wrong or the load cell drifts; what is found of a
//! key holds the truth.
#![allow(clippy::unwrap_used, clippy::panic)]

use needle_twin::compare::ensemble::assimilate::{Assimilated, HORIZON_S, Observed, assimilate};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng as _;
use rand_distr::{Distribution as _, StandardNormal};

const MEMBERS: usize = 32;
const NOISE_N: f64 = 5e-4;
const TRUTH: f64 = 1.1;

/// Force of a needle at a time, N: at 1 mm/s to 8 mm.
fn force(stiffness: f64, time_s: f64) -> f64 {
    0.06 * stiffness * (time_s / 8.0).powf(1.6)
}

fn normal(random: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(random)
}

/// A recording of a seed with an error of the model (N at a time, s); members differ in stiffness and load cell's zero.
fn recorded(seed: u64, rate_hz: f64, error: impl Fn(f64) -> f64) -> (Vec<Observed>, Assimilated) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let values: Vec<Vec<f64>> =
        (0..MEMBERS).map(|_| vec![1.0 + 0.15 * normal(&mut random), 3e-3 * normal(&mut random)]).collect();
    let zero = 2e-3 * normal(&mut random);
    let observed: Vec<Observed> = (0..=(8.0 * rate_hz) as usize)
        .map(|i| {
            let time_s = i as f64 / rate_hz;
            let measured_n = force(TRUTH, time_s) + error(time_s) + zero + NOISE_N * normal(&mut random);
            Observed { time_s, measured_n, members_n: values.iter().map(|v| force(v[0], time_s) + v[1]).collect() }
        })
        .collect();
    let found = assimilate(&observed, &values).unwrap();
    (observed, found)
}

/// Share of the readings in their forecast's band, and the bands' mean width, N.
fn held(observed: &[Observed], found: &Assimilated) -> (f64, f64) {
    let both = observed.iter().zip(&found.forecasts).filter_map(|(o, f)| Some((o.measured_n, (*f)?)));
    let rows: Vec<(bool, f64)> = both.map(|(m, f)| (f.low_n <= m && m <= f.high_n, f.high_n - f.low_n)).collect();
    let count = rows.len() as f64;
    (rows.iter().filter(|r| r.0).count() as f64 / count, rows.iter().map(|r| r.1).sum::<f64>() / count)
}

#[test]
fn ninety_five_per_cent_bands_hold_and_intervals_have_the_truth() {
    for (name, wrong) in [("right", 0.0), ("wrong law", 0.15)] {
        let (mut shares, mut widths, mut hit) = (0.0, 0.0, 0);
        for seed in 1..=20 {
            let error = |t: f64| wrong * (1.25 * t).sin() * force(TRUTH, t);
            let (observed, found) = recorded(seed, 100.0, error);
            let (share, width) = held(&observed, &found);
            (shares, widths) = (shares + share / 20.0, widths + width / 20.0);
            let [mean, deviation] = found.keys[0];
            hit += usize::from((mean - TRUTH).abs() < 1.96 * deviation);
        }
        println!("{name}: {shares:.3} of the readings, {widths:.2e} N wide, truth in {hit} of 20");
        assert!((0.93..0.985).contains(&shares), "{name}: {shares}");
        assert!(hit >= 18, "{name}: {hit} of 20");
        // noise alone would make them 3.92 standard deviations wide
        let narrow = 3.92 * NOISE_N;
        assert!(if wrong == 0.0 { widths < 2.0 * narrow } else { widths > 2.0 * narrow }, "{name}: {widths} N");
    }
}

#[test]
fn what_is_forecast_comes_from_before() {
    let (observed, found) = recorded(3, 100.0, |_| 0.0);
    let first = found.forecasts.iter().position(Option::is_some).unwrap();
    assert_eq!(first, (HORIZON_S * 100.0).round() as usize, "nothing is forecast before a block was seen");
    // a knock in the last block changes no forecast
    let mut knocked = observed.clone();
    knocked.last_mut().unwrap().measured_n += 1.0;
    let values: Vec<Vec<f64>> = (0..MEMBERS).map(|k| vec![k as f64]).collect();
    let [a, b] = [&observed, &knocked].map(|rows| assimilate(rows, &values).unwrap());
    let last = |found: &Assimilated| found.forecasts.last().unwrap().unwrap().mean_n;
    assert!((last(&a) - last(&b)).abs() < 1e-9, "{} {}", last(&a), last(&b));
    assert!(a.keys[0][0] != b.keys[0][0]);
    // after a gap nothing is forecast, and a few members say nothing
    let gap: Vec<Observed> = observed.iter().filter(|o| !(2.0..3.0).contains(&o.time_s)).cloned().collect();
    let after = gap.iter().position(|o| o.time_s >= 3.0).unwrap();
    assert_eq!(assimilate(&gap, &values).unwrap().forecasts[after], None);
    assert!(assimilate(&observed, &values[..3]).is_none() && assimilate(&[], &values).is_none());
}
