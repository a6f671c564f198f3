//! The force components across the instrument's axis, for a load cell that measured a vector.
//!
//! Each component has its own noise, zero and drift. Zero and drift are linear in the residuals, so they are
//! projected out of residuals and derivatives. The other unknowns then have the values that they would have with zero
//! and drift among the unknowns (Frisch and Waugh, Econometrica 1, 1933). A component is weighted by its noise
//! relative to that of the force along the axis,
//!
//! ```text
//! w = s_along / s,   s^2 = noise^2 + (e FLOOR F)^2        F: largest force along the axis; e: relative standard error of the force
//! ```
//!
//! where the second term is the least error of any force ([`super::uncertainty`]).

use super::path::ForcePath;
use super::uncertainty::FLOOR;
use super::{Answer, Run};
use needle_core::scene::{Dimension, Word as _};

/// One component across the axis.
#[derive(Clone, Debug)]
pub struct Component {
    /// Name for messages.
    pub name: String,
    /// Unit vector along it, frame `sample`.
    pub unit: [f64; 3],
    /// Reading of the load cell along it at each of some answers, N.
    pub measured_n: Vec<f64>,
    /// w
    pub weight: f64,
}

impl Component {
    /// The run's force along it; `None` if the instrument does not enter the sample.
    #[must_use]
    pub(crate) fn path(&self, run: &Run) -> Option<ForcePath> {
        let force = |a: &Answer| dot(&a.predicted_vector_n, &self.unit);
        let finite = |a: &&Answer| [a.time_s, a.depth_m, force(a)].iter().all(|x| x.is_finite());
        let column = |of: &dyn Fn(&Answer) -> f64| run.answers.iter().filter(finite).map(of).collect();
        ForcePath::across(column(&|a| a.time_s), column(&|a| a.depth_m), column(&force))
    }
}

impl Run {
    /// Components across the instrument's axis at some of the answers, all of which have a measured force; empty for
    /// a load cell with one axis. `force_error` is the relative standard error of the force.
    #[must_use]
    pub fn across(&self, answers: &[&Answer], force_error: f64) -> Vec<Component> {
        if !self.measures_vectors() {
            return Vec::new();
        }
        let along: Vec<f64> = answers.iter().map(|a| a.measured_n.unwrap_or(0.0)).collect();
        let peak_n = along.iter().map(|f| f.abs()).fold(0.0, f64::max);
        let error = |readings: &[f64]| noise(readings).hypot(force_error * FLOOR * peak_n);
        let component = |(name, unit): (&str, [f64; 3])| {
            let of = |a: &&Answer| a.measured_vector_n.map_or(0.0, |f| dot(&f, &unit));
            let measured_n: Vec<f64> = answers.iter().map(of).collect();
            let weight = error(&along) / error(&measured_n);
            let weight = if weight.is_finite() { weight } else { 1.0 };
            Component { name: name.to_owned(), unit, measured_n, weight }
        };
        self.directions().into_iter().map(component).collect()
    }

    /// Whether the model predicts the force across the axis. A model with symmetry about the axis does not.
    #[must_use]
    pub(crate) fn predicts_vectors(&self) -> bool {
        self.dimension == Dimension::Full.as_str() || self.dimension == Dimension::Mirrored.as_str()
    }

    /// Directions across the axis, with their names.
    fn directions(&self) -> [(&'static str, [f64; 3]); 2] {
        let slope @ [x, y] = self.instrument.map_or([0.0; 2], |i| i.slope());
        // the axis points downwards along (x, y, -1)
        let unit = |v: [f64; 3]| v.map(|c| c / dot(&v, &v).sqrt());
        let (axis, first) = (unit([x, y, -1.0]), unit([1.0, 0.0, x]));
        let second = [
            first[1] * axis[2] - first[2] * axis[1],
            first[2] * axis[0] - first[0] * axis[2],
            first[0] * axis[1] - first[1] * axis[0],
        ];
        let names = if slope == [0.0; 2] { ["x", "y"] } else { ["x, across the axis", "y, across the axis"] };
        [(names[0], first), (names[1], second)]
    }
}

/// Subtracts from a column its mean (`free` = 1) or its regression line over time (2): the effects of a load cell's
/// zero and drift.
pub(crate) fn take_load_cell_off(column: &mut [f64], time_s: &[f64], free: usize) {
    let n = column.len().max(1) as f64;
    if free > 0 {
        let mean = column.iter().sum::<f64>() / n;
        column.iter_mut().for_each(|c| *c -= mean);
    }
    if free > 1 {
        let middle = time_s.iter().sum::<f64>() / n;
        let squares: f64 = time_s.iter().map(|t| (t - middle).powi(2)).sum();
        let slope = column.iter().zip(time_s).map(|(c, t)| c * (t - middle)).sum::<f64>() / squares;
        if slope.is_finite() {
            column.iter_mut().zip(time_s).for_each(|(c, t)| *c -= slope * (t - middle));
        }
    }
}

/// Noise of one reading, N: the root mean square of third differences divided by that of white noise, 20^1/2. Third
/// differences vanish for a force that is smooth over four readings. The largest hundredth of them is ignored:
/// knocks, and where a motion begins or ends.
fn noise(readings: &[f64]) -> f64 {
    let third = |w: &[f64]| (w[3] - 3.0 * (w[2] - w[1]) - w[0]).powi(2);
    let mut squares: Vec<f64> = readings.windows(4).map(third).collect();
    squares.sort_unstable_by(f64::total_cmp);
    let counted = squares.len() - squares.len() / 100;
    (squares[..counted].iter().sum::<f64>() / (20 * counted.max(1)) as f64).sqrt()
}

fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng as _;
    use rand_distr::{Distribution as _, StandardNormal};

    #[test]
    fn a_load_cell_leaves_neither_zero_nor_drift() {
        let time: Vec<f64> = (0..50).map(|i| 0.1 * f64::from(i)).collect();
        let made = |zero: f64, drift: f64| -> Vec<f64> { time.iter().map(|t| t * t + zero + drift * t).collect() };
        for free in 0..3 {
            let (mut plain, mut moved) = (made(0.0, 0.0), made(3.0, if free > 1 { -0.7 } else { 0.0 }));
            take_load_cell_off(&mut plain, &time, free);
            take_load_cell_off(&mut moved, &time, free);
            let apart = plain.iter().zip(&moved).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(if free == 0 { apart > 2.9 } else { apart < 1e-12 }, "{free} {apart}");
        }
    }

    #[test]
    fn noise_is_that_of_the_readings_and_not_of_the_force() {
        let mut generator = ChaCha8Rng::seed_from_u64(7);
        let mut normal = || -> f64 { StandardNormal.sample(&mut generator) };
        let readings: Vec<f64> = (0..1000).map(|i| (1e-3 * f64::from(i)).powi(2) + 1e-3 * normal()).collect();
        let found = noise(&readings);
        assert!((0.8e-3..1.2e-3).contains(&found), "{found}");
    }
}
