//! What the verdict is about: readings in contact.
#![allow(clippy::unwrap_used)]

use needle_estimate::compare::Explains;
use needle_estimate::compare::rows::Rows;
use needle_estimate::compare::uncertainty::FORCE_ERROR;
use needle_estimate::compare::verdict::judge;

/// 20 s in the air and 10 s of a press to 5 mm, 100 readings a second; what the load cell reads in the air, and how far the prediction is off in contact.
fn rows(air: impl Fn(f64) -> f64, off: f64) -> Rows {
    let time_s: Vec<f64> = (0..3000).map(|i| 0.01 * f64::from(i)).collect();
    let depth_m: Vec<f64> = time_s.iter().map(|t| 5e-4 * (t - 20.0)).collect();
    let right = |d: f64| 40.0 * d.max(0.0) * (1.0 + 60.0 * d.max(0.0));
    let noise = |i: usize| 1e-4 * (((i * 7919) % 13) as f64 - 6.0);
    let measured_n = (0..3000).map(|i| if depth_m[i] > 0.0 { right(depth_m[i]) } else { air(time_s[i]) } + noise(i));
    let predicted_n = depth_m.iter().map(|d| (1.0 + off) * right(*d)).collect();
    Rows::new(time_s.clone(), depth_m.clone(), predicted_n, measured_n.collect())
}

/// A machine that shakes and a zero that settles before the contact, by a tenth of the peak: a prediction within 0.3 % was rejected.
#[test]
fn readings_before_the_contact_do_not_decide() {
    let shakes = |t: f64| if t > 10.0 { 0.03 * (2.0 * t).sin() } else { 0.0 };
    let settles = |t: f64| if t < 15.0 { 0.0 } else { 0.025 };
    for air in [&shakes as &dyn Fn(f64) -> f64, &settles] {
        let verdict = judge(&rows(air, 0.003), 1, FORCE_ERROR);
        println!("{}, {:?}", verdict.line(), verdict.reasons);
        assert_eq!(verdict.explains, Explains::Yes, "{:?}", verdict.reasons);
        assert_eq!(judge(&rows(air, 0.2), 1, FORCE_ERROR).explains, Explains::No, "and a wrong one is still wrong");
    }
    assert_eq!(judge(&rows(|_| 0.0, 0.003), 1, FORCE_ERROR).explains, Explains::Yes);
}

/// Tissue that pulls at the instrument above the surface is in contact, whatever the model says.
#[test]
fn tissue_that_sticks_on_the_way_out_counts() {
    let time_s: Vec<f64> = (0..4000).map(|i| 0.01 * f64::from(i)).collect();
    let depth_m: Vec<f64> = time_s.iter().map(|t| 5e-4 * (10.0 - (t - 20.0).abs())).collect();
    let right = |d: f64| 40.0 * d.max(0.0);
    let predicted_n: Vec<f64> = depth_m.iter().map(|d| right(*d)).collect();
    let pull = |i: usize| if i > 2000 && depth_m[i] < 0.0 { 20.0 * depth_m[i] } else { 0.0 };
    let measured = |sticks: f64| (0..4000).map(|i| right(depth_m[i]) + sticks * pull(i)).collect();
    let verdict = |sticks: f64| {
        judge(&Rows::new(time_s.clone(), depth_m.clone(), predicted_n.clone(), measured(sticks)), 1, FORCE_ERROR)
    };
    assert_eq!(verdict(0.0).explains, Explains::Yes);
    assert_ne!(verdict(1.0).explains, Explains::Yes);
}

/// On a press without a way out a wrong factor grows with the time, as a drift does; 20 % of the peak are no load cell's.
#[test]
fn a_wrong_factor_on_a_ramp_is_no_drift() {
    let time_s: Vec<f64> = (0..1000).map(|i| 0.01 * f64::from(i)).collect();
    let depth_m: Vec<f64> = time_s.iter().map(|t| 5e-4 * t).collect();
    let measured_n =
        (0..1000).map(|i| 40.0 * depth_m[i] + 1e-4 * (((i * 7919) % 13) as f64 - 6.0)).collect::<Vec<f64>>();
    let verdict = |factor: f64| {
        let predicted_n = depth_m.iter().map(|d| factor * 40.0 * d).collect();
        judge(&Rows::new(time_s.clone(), depth_m.clone(), predicted_n, measured_n.clone()), 1, FORCE_ERROR).explains
    };
    assert_eq!((verdict(1.01), verdict(1.2)), (Explains::Yes, Explains::No));
}
