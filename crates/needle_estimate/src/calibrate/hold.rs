//! What a hold says of relaxation without a run: where the search for a Prony term begins.
//!
//! A linearly viscoelastic sample, G(t) = G (1 - g + g e^(-t/tau)), whose strain rises evenly over the time T and then stays, has the force
//! (R. M. Christensen, Theory of Viscoelasticity, 1982, 1.2)
//!
//! ```text
//! F(T + s) = a + b e^(-s/tau),     b / a = g tau (1 - e^(-T/tau)) / ((1 - g) T)
//! ```
//!
//! The force of a finite strain is not even in time, so these are starts and no results. The search itself gives value and interval.

use super::{Estimate, Task};
use crate::compare::depths;
use needle_core::scene::{Override, Scene};
use needle_core::twin::Twin;

/// The keys: a term's share and its time.
const SHARE: &str = "material.prony_shares[0]";
const TIME: &str = "material.prony_times_s[0]";
/// The instrument rests at a depth above this share of the deepest.
const AT_REST: f64 = 0.99;
/// Fewest readings in a hold.
const LEAST: usize = 10;
/// Times tau that are tried, over the hold's length, and their number.
const TIMES: [f64; 2] = [0.02, 5.0];
const TRIED: usize = 80;
/// A share that a start may have.
const SHARES: [f64; 2] = [0.01, 0.95];

/// Share and time of a term, from times s after the ramp (s), forces there (N, without the zero), and the ramp's duration, s.
fn term(s: &[f64], force: &[f64], ramp_s: f64) -> Option<[f64; 2]> {
    let whole = s.last()? - s.first()?;
    let fit = |tau: f64| {
        let decay: Vec<f64> = s.iter().map(|s| (-s / tau).exp()).collect();
        let n = s.len() as f64;
        let mean = |of: &[f64]| of.iter().sum::<f64>() / n;
        let (x, y) = (mean(&decay), mean(force));
        let (products, squares) =
            decay.iter().zip(force).fold((0.0, 0.0), |(p, q), (d, f)| (p + (d - x) * (f - y), q + (d - x).powi(2)));
        let b = products / squares;
        let a = y - b * x;
        (decay.iter().zip(force).map(|(d, f)| (a + b * d - f).powi(2)).sum::<f64>(), tau, a, b)
    };
    let [low, high] = TIMES.map(|share| share * whole);
    let tau = |k: usize| low * (high / low).powf(k as f64 / (TRIED - 1) as f64);
    let (_, tau, a, b) = (0..TRIED).map(|k| fit(tau(k))).min_by(|p, q| p.0.total_cmp(&q.0))?;
    let ratio = b / a;
    let share = ratio / (ratio + tau / ramp_s * -(-ramp_s / tau).exp_m1());
    (a > 0.0 && b > 0.0 && share.is_finite()).then(|| [share.clamp(SHARES[0], SHARES[1]), tau])
}

/// What a hold says.
pub(super) struct Held {
    /// The scene with share and time of the first term.
    pub scene: Scene,
    /// Length of the hold, s.
    whole_s: f64,
}

impl Held {
    /// Withholds the errors of a term whose time is longer than the hold: the force tells share over time alone.
    pub(super) fn withhold(&self, estimates: &mut [Estimate]) {
        let Some(tau_s) = estimates.iter().find(|e| e.name == TIME).map(|e| e.value).filter(|t| *t > self.whole_s)
        else {
            return;
        };
        let reason = format!(
            "the hold of {:.2} s is shorter than a relaxation in {tau_s:.2} s: it tells share over time alone",
            self.whole_s
        );
        let of_term = |e: &&mut Estimate| [SHARE, TIME].contains(&e.name.as_str());
        estimates
            .iter_mut()
            .filter(of_term)
            .for_each(|e| e.withheld = Some(e.withheld.take().unwrap_or_else(|| reason.clone())));
    }
}

/// What the hold says, if share and time of the first term are sought; a scene without a term gets one. `None` if there is no hold.
pub(super) fn begun(task: &Task) -> Option<Held> {
    let sought = |key: &str| task.wanted.iter().find(|w| w.key == key);
    let bounds = [sought(SHARE)?, sought(TIME)?].map(|wanted| wanted.bounds);
    let depth_m = depths(&Twin::new(task.scene).ok()?, task.readings);
    let axis = task.scene.instrument?.axis();
    let force = |i: usize| {
        Some(
            -(0..3)
                .map(|k| task.measured.at(task.readings[i].time_s).map_or(f64::NAN, |f| f[k]) * axis[k])
                .sum::<f64>(),
        )
        .filter(|f| f.is_finite())
    };
    let deepest = depth_m.iter().copied().fold(0.0, f64::max);
    let first = depth_m.iter().position(|d| *d >= AT_REST * deepest)?;
    let contact = depth_m.iter().position(|d| *d > 0.0)?;
    let end = first + depth_m[first..].iter().take_while(|d| **d >= AT_REST * deepest).count();
    let before: Vec<f64> = (0..contact).filter_map(force).collect();
    let zero_n = if before.is_empty() { 0.0 } else { before.iter().sum::<f64>() / before.len() as f64 };
    let time = |i: usize| task.readings[i].time_s;
    let (s, held): (Vec<f64>, Vec<f64>) =
        (first..end).filter_map(|i| Some((time(i) - time(first), force(i)? - zero_n))).unzip();
    if s.len() < LEAST || first <= contact {
        return None;
    }
    let term = term(&s, &held, time(first) - time(contact))?;
    let list = |key: &str, k: usize| {
        let (name, _) = key.split_once('[')?;
        let mut values = task.scene.get(name)?.as_list()?.to_vec();
        let [low, high] = bounds[k].unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
        let value = term[k].clamp(low, high);
        if values.is_empty() {
            values.push(value)
        } else {
            values[0] = value
        }
        Some(Override::text(name, &format!("{values:?}"), "what the hold says"))
    };
    let scene = task.scene.with(&[list(SHARE, 0)?, list(TIME, 1)?]).ok()?;
    Some(Held { scene, whole_s: *s.last()? })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// The closed form against the integral of a strain rate over the past, summed in small steps.
    #[test]
    fn share_and_time_of_a_linear_sample_are_found() {
        for (share, tau, ramp) in [(0.3, 1.5, 0.5), (0.6, 0.4, 2.0), (0.1, 5.0, 1.0)] {
            let force = |t: f64| {
                let steps = 4000;
                let dt = ramp / f64::from(steps);
                let relaxed = |age: f64| 1.0 - share + share * (-age / tau).exp();
                (0..steps).map(|k| relaxed(t - dt * (f64::from(k) + 0.5)) * dt).sum::<f64>()
            };
            let s: Vec<f64> = (0..200).map(|i| 0.03 * f64::from(i)).collect();
            let held: Vec<f64> = s.iter().map(|s| force(ramp + s)).collect();
            let [g, t] = term(&s, &held, ramp).unwrap();
            assert!((g / share - 1.0).abs() < 0.1 && (t / tau - 1.0).abs() < 0.08, "{g} for {share}, {t} for {tau}");
        }
        assert!(term(&[0.0, 1.0, 2.0], &[1.0, 1.1, 1.2], 1.0).is_none(), "it rises");
    }
}
