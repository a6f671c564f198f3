//! Sensor models of the simulated rig: readings of a displacement sensor and a load cell from the true values.
//!
//! The numbers are typical of the instruments that such a rig uses (data sheets of magnetostrictive sensors and of
//! subminiature load cells), chosen by us. They are not a calibration of any real instrument.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::TAU;

/// Properties of a displacement sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DisplacementModel {
    /// Smallest step of the reading, m.
    pub resolution_m: f64,
    /// Standard deviation of the noise of one reading, m.
    pub noise_m: f64,
    /// Amplitude of the deviation from a straight line, m.
    pub nonlinearity_m: f64,
    /// The deviation is a sine over the travel with this period, m.
    pub nonlinearity_period_m: f64,
}

impl DisplacementModel {
    /// A magnetostrictive sensor: 2 um resolution, 1 um noise, 10 um deviation with a period of 25 mm.
    pub const MAGNETOSTRICTIVE: Self =
        Self { resolution_m: 2e-6, noise_m: 1e-6, nonlinearity_m: 10e-6, nonlinearity_period_m: 25e-3 };

    /// A sensor without errors.
    pub const IDEAL: Self = Self { resolution_m: 0.0, noise_m: 0.0, nonlinearity_m: 0.0, nonlinearity_period_m: 1.0 };

    /// Systematic error at a depth, m: `a (sin(2 pi d / p + 1) - sin(1))`. It is zero at depth 0, where the rig is
    /// zeroed. The phase prevents the error from being an odd function.
    #[must_use]
    pub fn deviation_m(&self, depth_m: f64) -> f64 {
        self.nonlinearity_m * ((TAU * depth_m / self.nonlinearity_period_m + 1.0).sin() - 1f64.sin())
    }
}

/// Properties of a load cell for one axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoadCellModel {
    /// Readings are limited to plus and minus this, N.
    pub range_n: f64,
    /// Smallest step of the reading, N.
    pub resolution_n: f64,
    /// Standard deviation of the noise of one reading, N.
    pub noise_n: f64,
    /// Largest deviation from the straight line between zero and full range, as a fraction of the range.
    pub nonlinearity: f64,
    /// Reading without load at time 0, N: the remainder after taring.
    pub offset_n: f64,
    /// Change of the reading without load, N/s.
    pub drift_n_per_s: f64,
}

impl LoadCellModel {
    /// A subminiature cell of 2.5 N: non-linearity 0.25 % of the range, resolution 0.1 mN, noise 0.4 mN, remainder
    /// after taring 0.3 mN, drift 0.02 mN/s.
    pub const SUBMINIATURE: Self = Self {
        range_n: 2.5,
        resolution_n: 1e-4,
        noise_n: 4e-4,
        nonlinearity: 0.0025,
        offset_n: 3e-4,
        drift_n_per_s: 2e-5,
    };

    /// A cell without errors.
    pub const IDEAL: Self = Self {
        range_n: f64::INFINITY,
        resolution_n: 0.0,
        noise_n: 0.0,
        nonlinearity: 0.0,
        offset_n: 0.0,
        drift_n_per_s: 0.0,
    };

    /// Systematic deviation under a load, N: a parabola, 0 at no load and at full range, largest in between.
    #[must_use]
    pub fn deviation_n(&self, force_n: f64) -> f64 {
        if !self.range_n.is_finite() {
            return 0.0;
        }
        let x = (force_n / self.range_n).clamp(-1.0, 1.0);
        self.nonlinearity * self.range_n * 4.0 * x * (1.0 - x.abs())
    }
}

/// A displacement sensor with its noise.
#[derive(Clone, Debug)]
pub struct DisplacementSensor {
    model: DisplacementModel,
    noise: Noise,
}

impl DisplacementSensor {
    /// The same seed gives the same readings.
    #[must_use]
    pub fn new(model: DisplacementModel, seed: u64) -> Self {
        Self { model, noise: Noise::new(seed, 1) }
    }

    /// Reading at a true depth, m.
    pub fn read(&mut self, depth_m: f64) -> f64 {
        let m = &self.model;
        let noise = self.noise.next() * m.noise_m;
        to_step(depth_m + m.deviation_m(depth_m) + noise, m.resolution_m)
    }
}

/// One axis of a load cell with its noise.
#[derive(Clone, Debug)]
pub struct LoadCell {
    model: LoadCellModel,
    noise: Noise,
}

impl LoadCell {
    /// The same seed gives the same readings.
    #[must_use]
    pub fn new(model: LoadCellModel, seed: u64) -> Self {
        Self { model, noise: Noise::new(seed, 2) }
    }

    /// Reading at a true force, N, `time_s` after the cell was tared.
    pub fn read(&mut self, force_n: f64, time_s: f64) -> f64 {
        let m = &self.model;
        let noise = self.noise.next() * m.noise_n;
        let reading = force_n + m.deviation_n(force_n) + m.offset_n + m.drift_n_per_s * time_s + noise;
        to_step(reading, m.resolution_n).clamp(-m.range_n, m.range_n)
    }
}

/// White noise of unit variance; each sensor has its own stream.
#[derive(Clone, Debug)]
struct Noise(ChaCha8Rng);

impl Noise {
    fn new(seed: u64, stream: u64) -> Self {
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        generator.set_stream(stream);
        Self(generator)
    }

    fn next(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }
}

fn to_step(value: f64, step: f64) -> f64 {
    if step > 0.0 { (value / step).round() * step } else { value }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn displacement_is_within_what_the_model_says() {
        let model = DisplacementModel::MAGNETOSTRICTIVE;
        let mut sensor = DisplacementSensor::new(model, 1);
        let errors: Vec<f64> = (0..20_000).map(|_| sensor.read(4e-3) - 4e-3 - model.deviation_m(4e-3)).collect();
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        let variance = errors.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / errors.len() as f64;
        // Rounding to steps adds step^2 / 12.
        let expected = model.noise_m.powi(2) + model.resolution_m.powi(2) / 12.0;
        assert!((variance / expected - 1.0).abs() < 0.1, "{variance} {expected}");
        assert!(model.deviation_m(0.0) == 0.0 && model.deviation_m(4e-3).abs() <= 2.0 * model.nonlinearity_m);
        let steps = sensor.read(4e-3) / model.resolution_m;
        assert!((steps - steps.round()).abs() < 1e-6);
    }

    #[test]
    fn load_cell_saturates_drifts_and_bends() {
        let model = LoadCellModel { noise_n: 0.0, ..LoadCellModel::SUBMINIATURE };
        let mut cell = LoadCell::new(model, 1);
        assert_eq!(cell.read(3.0, 0.0), 2.5);
        assert_eq!(cell.read(-3.0, 0.0), -2.5);
        assert!((cell.read(0.0, 0.0) - 3e-4).abs() < 1e-9);
        assert!((cell.read(0.0, 100.0) - 2.3e-3).abs() < 1e-9);
        assert!((model.deviation_n(1.25) - 0.0025 * 2.5).abs() < 1e-12);
        assert!(model.deviation_n(2.5).abs() < 1e-12);
    }

    #[test]
    fn ideal_sensors_tell_the_truth_and_seeds_decide() {
        assert_eq!(DisplacementSensor::new(DisplacementModel::IDEAL, 3).read(1.234e-3), 1.234e-3);
        assert_eq!(LoadCell::new(LoadCellModel::IDEAL, 3).read(0.0567, 9.0), 0.0567);
        let read = |seed| {
            let mut sensor = DisplacementSensor::new(DisplacementModel::MAGNETOSTRICTIVE, seed);
            (0..100).map(|_| sensor.read(0.0)).collect::<Vec<_>>()
        };
        assert_eq!(read(5), read(5));
        assert_ne!(read(5), read(6));
    }
}
