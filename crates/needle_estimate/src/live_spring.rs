//! Whether the twin predicts better than a spring, while readings come.
//!
//! The spring c + a d + b d^2 is fitted by least squares to all readings so far, each time that the instrument has come twice as deep. It
//! predicts the readings until then, so none was fitted before it was predicted. The twin gets what the spring gets of the load cell's zero:
//! the mean residual over the readings that the spring was fitted to. Nothing is stored but sums.

use nalgebra::{Matrix3, Vector3};

use crate::baseline::Against;

/// Fewest loaded readings to which a spring is fitted, and fewest predicted ones that are judged.
const LEAST: u64 = 5;
/// The spring is fitted anew at this multiple of the depth.
const DEEPER: f64 = 2.0;
/// Added to the normal matrix, over its trace: terms that the readings can't tell apart share their constant.
const RIDGE: f64 = 1e-9;

/// A spring that the twin is compared with.
#[derive(Clone, Copy, Debug, Default)]
pub struct LiveSpring {
    /// Sums over all readings: of the products of 1, d, d^2, of these with the force, and of measured - predicted force.
    normal: Matrix3<f64>,
    right: Vector3<f64>,
    lacking: f64,
    count: u64,
    loaded: u64,
    /// Deepest depth so far, m.
    deepest_m: f64,
    fitted: Option<Fitted>,
    predicted: u64,
    /// Sums of squared errors over the predicted readings, N^2.
    twin: f64,
    spring: f64,
}

#[derive(Clone, Copy, Debug)]
struct Fitted {
    /// c, a, b.
    constants: Vector3<f64>,
    /// The zero of the load cell for the twin, N.
    zero_n: f64,
    to_m: f64,
}

/// Errors so far.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SoFar {
    /// Root mean square error of the twin, N.
    pub twin_rmse_n: f64,
    /// That of the spring.
    pub spring_rmse_n: f64,
    /// Number of readings that were predicted.
    pub readings: u64,
}

impl LiveSpring {
    /// Takes a reading. Those that aren't finite are left out.
    pub fn take(&mut self, depth_m: f64, predicted_n: f64, measured_n: f64) {
        if ![depth_m, predicted_n, measured_n].iter().all(|x| x.is_finite()) {
            return;
        }
        let d = depth_m.max(0.0);
        let row = Vector3::new(1.0, d, d * d);
        self.deepest_m = self.deepest_m.max(d);
        if self.loaded >= LEAST && self.deepest_m >= self.fitted.map_or(0.0, |f| DEEPER * f.to_m) {
            self.fit();
        }
        if let Some(Fitted { constants, zero_n, .. }) = self.fitted.filter(|f| d > f.to_m) {
            self.predicted += 1;
            self.twin += (predicted_n + zero_n - measured_n).powi(2);
            self.spring += (constants.dot(&row) - measured_n).powi(2);
        }
        self.normal += row * row.transpose();
        self.right += measured_n * row;
        self.lacking += measured_n - predicted_n;
        self.count += 1;
        self.loaded += u64::from(d > 0.0);
    }

    /// Fits the spring to all readings so far, those before the present one.
    fn fit(&mut self) {
        let deepest = self.deepest_m;
        // depths of the size of 1, since powers of a depth in metres differ by orders of magnitude
        let size = Vector3::new(1.0, deepest, deepest * deepest);
        let scaled = self.normal.component_div(&(size * size.transpose()));
        let ridge = Matrix3::identity() * (RIDGE * scaled.trace());
        let found = (scaled + ridge).cholesky().map(|c| c.solve(&self.right.component_div(&size)).component_div(&size));
        #[allow(clippy::cast_precision_loss)]
        let zero_n = self.lacking / self.count as f64;
        self.fitted = found.map(|constants| Fitted { constants, zero_n, to_m: deepest }).or(self.fitted);
    }

    /// Errors so far, if enough was predicted.
    #[must_use]
    #[allow(clippy::cast_precision_loss)]
    pub fn so_far(&self) -> Option<SoFar> {
        let rms = |squares: f64| (squares / self.predicted as f64).sqrt();
        (self.predicted >= LEAST).then(|| SoFar {
            twin_rmse_n: rms(self.twin),
            spring_rmse_n: rms(self.spring),
            readings: self.predicted,
        })
    }
}

impl SoFar {
    /// The twin against the spring.
    #[must_use]
    pub(crate) fn against(&self) -> Against {
        Against::of(self.twin_rmse_n, self.spring_rmse_n)
    }

    /// Both errors in words.
    #[must_use]
    pub fn words(&self) -> String {
        let word = match self.against() {
            Against::Better => "better than a spring",
            Against::AsGood => "as good as a spring",
            Against::Worse => "worse than a spring",
            Against::NoMeasurement => "not comparable with a spring",
        };
        let [twin, spring] = [self.twin_rmse_n, self.spring_rmse_n].map(|n| 1e3 * n);
        format!("{word}: {twin:.3} against {spring:.3} mN over {} readings", self.readings)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// An insertion and its way out, of a force over depth, with another one predicted.
    fn run(force: impl Fn(f64) -> f64, twin: impl Fn(f64) -> f64) -> Option<SoFar> {
        let mut spring = LiveSpring::default();
        for i in 0..2000 {
            let d = 1e-5 * f64::from(if i < 1000 { i } else { 2000 - i }) - 1e-4;
            spring.take(d, twin(d.max(0.0)), force(d.max(0.0)));
        }
        spring.so_far()
    }

    #[test]
    fn a_spring_foretells_a_spring_and_nothing_that_stiffens_otherwise() {
        let spring = |d: f64| 0.02 + 30.0 * d + 900.0 * d * d;
        let found = run(spring, |d| 1.02 * (spring(d) - 0.02)).unwrap();
        assert!(found.spring_rmse_n < 1e-6, "{found:?}");
        assert_eq!(found.against(), Against::Worse);
        assert!(found.words().starts_with("worse than a spring: "), "{}", found.words());
        let stiffening = |d: f64| 0.01 * (d / 2e-3).exp_m1();
        // the load cell's zero does not count against the twin
        let found = run(|d| stiffening(d) + 0.05, |d| 1.01 * stiffening(d)).unwrap();
        assert_eq!(found.against(), Against::Better, "{found:?}");
        assert!(found.twin_rmse_n < 0.02 && found.readings > 900, "{found:?}");
        assert_eq!(run(spring, |d| spring(d) + 1e-9).unwrap().readings, found.readings);
    }

    #[test]
    fn too_little_says_nothing() {
        let mut spring = LiveSpring::default();
        for i in 0..8 {
            spring.take(1e-4 * f64::from(i), 0.0, f64::from(i));
            spring.take(f64::NAN, 0.0, 1.0);
        }
        assert_eq!(spring.so_far(), None);
        spring.take(1e-2, f64::INFINITY, 1.0);
        assert_eq!(spring.so_far(), None);
    }
}
