//! Identification while it runs: stiffness, needle coefficient and load-cell offset, reading by reading.
//!
//! An extended Kalman filter (Gelb, Applied Optimal Estimation, 1974, chapter 6) of the load cell's reading z, with F the
//! twin's force and a, c, b what is estimated:
//!
//! ```text
//! z = F a c + b + noise       a = mu / mu_scene,   c = C_D / C_D,scene (1 before the puncture),   b: offset, N
//! H = (F c, F a, 1)           x += K (z - h(x)),   K = P H^T / (H P H^T + R),   P = (I - K H) P + Q dt
//! ```
//!
//! The force is proportional to the shear modulus (quasi-static, Poisson's ratio fixed), and nearly so to the deformation
//! coefficient, if the retraction coefficient goes with it: what the needle holds moves by C_D, and the tissue's answer to that is
//! nearly linear. `tests/ros/identify.rs` holds both against runs of the twin. So the two have the same effect on a needle's
//! force: only one of them can be found from it.
//!
//! R is the noise as it is seen in second differences of the residual. A residual that jumps, or that stays outside what noise and
//! model error explain, shows that the model does not hold (slip, puncture, a fault of the sensor): nothing is learnt then, and
//! what was learnt shortly before is discarded. Plain numbers: nothing is allocated per reading.

use nalgebra::{Matrix3, Vector3};

use super::uncertainty::FORCE_ERROR;

/// What can be identified.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parameter {
    /// `material.shear_modulus_pa`, Pa.
    ShearModulus,
    /// `instrument.deformation_coefficient`, the retraction coefficient in proportion.
    DeformationCoefficient,
    /// `load_cell.offset_n`, N.
    Offset,
}

impl Parameter {
    /// All, in the order of the state.
    pub const ALL: [Self; 3] = [Self::ShearModulus, Self::DeformationCoefficient, Self::Offset];

    /// Its name: the scene's key, or what is not a part of the scene.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::ShearModulus => "material.shear_modulus_pa",
            Self::DeformationCoefficient => "instrument.deformation_coefficient",
            Self::Offset => "load_cell.offset_n",
        }
    }

    /// The parameter of a name.
    #[must_use]
    pub fn of_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|p| p.name() == name)
    }

    const fn index(self) -> usize {
        match self {
            Self::ShearModulus => 0,
            Self::DeformationCoefficient => 1,
            Self::Offset => 2,
        }
    }
}

/// How the identification is doing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum State {
    /// It learns; the errors are still too large.
    Learning,
    /// Every parameter is known to [`CONVERGED_SHARE`], the offset to the noise of one reading.
    Converged,
    /// It doesn't learn, since the model is wrong.
    Frozen(Cause),
}

/// Why nothing is learnt.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Cause {
    /// The residual jumped by so much, N.
    Jump(f64),
    /// The residual stays at so much, N, outside what noise and model error explain.
    Level(f64),
    /// The load cell is at fault.
    Sensor,
}

impl std::fmt::Display for Cause {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Jump(n) => write!(f, "the residual jumped by {n:.5} N: slip, puncture, or a knock on the load cell"),
            Self::Level(n) => {
                write!(f, "the residual stays at {n:.5} N, more than noise and model error explain: the model is wrong")
            }
            Self::Sensor => f.write_str("the load cell is at fault"),
        }
    }
}

/// Relative standard error below which a value counts as known.
pub const CONVERGED_SHARE: f64 = 0.03;
/// Standard deviations before the first reading: shares of the scene's values, N.
const PRIOR: [f64; 3] = [0.5, 0.5, 0.1];
/// Process noise: standard deviation of the drift of the true values in a second: shares, N.
const WANDER: [f64; 3] = [1e-3, 1e-3, 5e-5];
/// Readings at the start that are used only to estimate the noise.
const WARM_UP: u32 = 20;
/// Time over which the noise is averaged, s.
const NOISE_S: f64 = 1.0;
/// Smallest noise that is assumed, N: quantised readings can repeat exactly.
const LEAST_NOISE_N: f64 = 1e-5;
/// Residuals of neighbouring readings are correlated: so many readings count as one independent reading.
const CORRELATED: f64 = 2.0;
/// A reading farther off than this, in standard deviations, counts less.
const OUTLIER: f64 = 3.0;
/// Times over which the residual is averaged, s: the present one, and the one before it.
const AVERAGE_S: [f64; 2] = [0.02, 0.2];
/// A residual is unexplained beyond so many standard deviations plus such a share of the force: for its level, for a jump.
const WRONG: [(f64, f64); 2] = [(5.0, 0.05), (5.0, 0.02)];
/// It has to be unexplained for so long to freeze, s; and explained (within half of that) for so long to continue, s.
const PERSISTENT_S: [f64; 2] = [0.1, 0.5];
/// Interval at which the estimate is saved, s; a freeze goes back to the last but one.
const ASIDE_S: f64 = 0.5;
/// After a longer gap between readings the residual before it is not used, s.
const GAP_S: f64 = 0.5;

#[derive(Clone, Copy, Debug)]
struct Learnt {
    x: Vector3<f64>,
    p: Matrix3<f64>,
}

/// See the module.
#[derive(Clone, Debug)]
pub struct Identifier {
    wanted: [bool; 3],
    /// Values of the scene: what the shares are of.
    unit: [f64; 3],
    learnt: Learnt,
    aside: [Learnt; 2],
    aside_at_s: f64,
    state: State,
    last_s: Option<f64>,
    readings: u32,
    residuals: [f64; 2],
    variance: f64,
    average: [f64; 2],
    /// How long it has been wrong, and right, s.
    wrong_s: f64,
    right_s: f64,
    /// Largest jump since it has been wrong, N.
    jump_n: f64,
}

impl Identifier {
    /// Starts with the scene's shear modulus (Pa) and deformation coefficient; what is not wanted stays there.
    #[must_use]
    pub fn new(wanted: &[Parameter], shear_modulus_pa: f64, deformation_coefficient: f64) -> Self {
        let unit = [shear_modulus_pa, deformation_coefficient, 1.0];
        Self::fresh(Parameter::ALL.map(|p| wanted.contains(&p)), unit)
    }

    fn fresh(wanted: [bool; 3], unit: [f64; 3]) -> Self {
        let mut p = Matrix3::zeros();
        for k in (0..3).filter(|&k| wanted[k]) {
            p[(k, k)] = PRIOR[k] * PRIOR[k];
        }
        let learnt = Learnt { x: Vector3::new(1.0, 1.0, 0.0), p };
        Self {
            wanted,
            unit,
            learnt,
            aside: [learnt; 2],
            aside_at_s: 0.0,
            state: State::Learning,
            last_s: None,
            readings: 0,
            residuals: [0.0; 2],
            variance: 0.0,
            average: [0.0; 2],
            wrong_s: 0.0,
            right_s: 0.0,
            jump_n: 0.0,
        }
    }

    /// Begins anew with the same parameters.
    pub fn reset(&mut self) {
        *self = Self::fresh(self.wanted, self.unit);
    }

    /// How it is doing.
    #[must_use]
    pub const fn state(&self) -> State {
        self.state
    }

    /// Value and standard error of a parameter, model error included; `None` if it isn't wanted.
    #[must_use]
    pub fn estimate(&self, parameter: Parameter) -> Option<(f64, f64)> {
        let k = parameter.index();
        let share = if parameter == Parameter::Offset { 0.0 } else { FORCE_ERROR * self.learnt.x[k] };
        let error = self.learnt.p[(k, k)].max(0.0).sqrt().hypot(share);
        self.wanted[k].then(|| (self.learnt.x[k] * self.unit[k], error * self.unit[k]))
    }

    /// What the load cell should read at a predicted force, N, with what was learnt.
    #[must_use]
    pub fn expected_n(&self, predicted_n: f64, inserted: bool) -> f64 {
        let x = &self.learnt.x;
        predicted_n * x[0] * if inserted { x[1] } else { 1.0 } + x[2]
    }

    /// Takes a reading: the twin's force and the measured one at the same time, N. `inserted`: the needle has punctured
    /// the surface. Gives the state where it has changed.
    pub fn update(&mut self, time_s: f64, predicted_n: f64, inserted: bool, measured_n: f64) -> Option<State> {
        if !(time_s.is_finite() && predicted_n.is_finite() && measured_n.is_finite()) {
            return None;
        }
        let dt = self.elapsed(time_s)?;
        let x = self.learnt.x;
        let second = if inserted { x[1] } else { 1.0 };
        let h = Vector3::new(predicted_n * second, if inserted { predicted_n * x[0] } else { 0.0 }, 1.0);
        let residual = measured_n - self.expected_n(predicted_n, inserted);
        self.see_noise(residual, dt);
        self.readings += 1;
        if self.readings <= WARM_UP {
            self.average = [residual; 2];
            return None;
        }
        for (average, over) in self.average.iter_mut().zip(AVERAGE_S) {
            *average += (residual - *average) * (dt / over).min(1.0);
        }
        let before = self.state;
        let own = (h.transpose() * self.learnt.p * h)[0].max(0.0).sqrt();
        self.judge(dt, own, (measured_n - x[2]).abs().max(predicted_n.abs()));
        if !matches!(self.state, State::Frozen(_)) {
            self.learn(time_s, dt, &h, residual);
        }
        (before != self.state && !same_trouble(before, self.state)).then_some(self.state)
    }

    /// Takes note that the load cell is at fault. Gives the state if it has changed.
    pub fn fault(&mut self) -> Option<State> {
        self.right_s = 0.0;
        let new = !matches!(self.state, State::Frozen(_));
        self.freeze(Cause::Sensor);
        new.then_some(self.state)
    }

    /// Time since the last reading, s; `None` for one that isn't later.
    fn elapsed(&mut self, time_s: f64) -> Option<f64> {
        let last = self.last_s.replace(time_s).unwrap_or(time_s);
        let dt = time_s - last;
        if !(0.0..=GAP_S).contains(&dt) {
            self.readings = self.readings.min(WARM_UP - 3);
        }
        (dt > 0.0 || self.readings == 0).then_some(dt.clamp(0.0, GAP_S))
    }

    /// Noise of one reading: for white noise the second difference has six times its variance.
    fn see_noise(&mut self, residual: f64, dt: f64) {
        let [one, two] = self.residuals;
        self.residuals = [residual, one];
        if self.readings < 2 {
            return;
        }
        let seen = (residual - 2.0 * one + two).powi(2) / 6.0;
        if self.readings <= WARM_UP {
            self.variance += (seen - self.variance) / f64::from(self.readings - 1);
        } else {
            let most = OUTLIER * OUTLIER * self.variance.max(LEAST_NOISE_N * LEAST_NOISE_N);
            self.variance += (seen.min(most) - self.variance) * (dt / NOISE_S).min(1.0);
        }
    }

    fn noise(&self) -> f64 {
        self.variance.sqrt().max(LEAST_NOISE_N)
    }

    /// Whether noise, model error and what is not known yet explain the residual.
    fn judge(&mut self, dt: f64, own: f64, force_n: f64) {
        let most = |(deviations, share): (f64, f64)| {
            deviations * CORRELATED.sqrt() * self.noise() + share * force_n + OUTLIER * own
        };
        let level = self.average[0];
        let jump = self.average[0] - self.average[1];
        let far = [level / most(WRONG[0]), jump / most(WRONG[1])].map(f64::abs);
        let wrong = far[0] > 1.0 || far[1] > 1.0;
        self.wrong_s = if wrong { self.wrong_s + dt } else { 0.0 };
        if !wrong {
            self.jump_n = 0.0;
        } else if far[1] > 1.0 && jump.abs() > self.jump_n.abs() {
            self.jump_n = jump;
        }
        self.right_s = if far[0] < 0.5 { self.right_s + dt } else { 0.0 };
        if matches!(self.state, State::Frozen(_)) {
            if self.right_s >= PERSISTENT_S[1] {
                self.state = State::Learning;
            }
        } else if self.wrong_s >= PERSISTENT_S[0] {
            self.freeze(if self.jump_n == 0.0 { Cause::Level(level) } else { Cause::Jump(self.jump_n) });
        }
    }

    /// Stops learning and goes back to a saved estimate.
    fn freeze(&mut self, cause: Cause) {
        if !matches!(self.state, State::Frozen(_)) {
            self.learnt = self.aside[1];
            self.aside = [self.learnt; 2];
            self.right_s = 0.0;
            self.state = State::Frozen(cause);
        }
    }

    fn learn(&mut self, time_s: f64, dt: f64, h: &Vector3<f64>, residual: f64) {
        if time_s - self.aside_at_s >= ASIDE_S || time_s < self.aside_at_s {
            self.aside = [self.learnt, self.aside[0]];
            self.aside_at_s = time_s;
        }
        let Learnt { x, p } = &mut self.learnt;
        for k in (0..3).filter(|&k| self.wanted[k]) {
            p[(k, k)] += WANDER[k] * WANDER[k] * dt;
        }
        let noise = CORRELATED * self.variance.max(LEAST_NOISE_N * LEAST_NOISE_N);
        let spread = (h.transpose() * *p * h)[0] + noise;
        // Huber's weight: an outlier has no more influence than a reading at the threshold
        let weight = (OUTLIER * spread.sqrt() / residual.abs()).min(1.0);
        let spread = spread + noise * (1.0 / weight - 1.0);
        let gain = *p * h / spread;
        *x += gain * residual;
        // earlier residuals as the present estimate would have made them, so that an update does not look like a jump
        let learnt = (h.transpose() * gain)[0] * residual;
        for earlier in self.average.iter_mut().chain(&mut self.residuals) {
            *earlier -= learnt;
        }
        let left = Matrix3::identity() - gain * h.transpose();
        // Joseph's form keeps P symmetric and positive
        *p = left * *p * left.transpose() + gain * gain.transpose() * (noise / weight);
        for k in 0..2 {
            x[k] = x[k].clamp(0.01, 100.0);
        }
        self.state = if self.is_known() { State::Converged } else { State::Learning };
    }

    fn is_known(&self) -> bool {
        let known = |k: usize| {
            let error = self.learnt.p[(k, k)].sqrt();
            !self.wanted[k] || error <= if k == 2 { self.noise() } else { CONVERGED_SHARE * self.learnt.x[k] }
        };
        (0..3).all(known)
    }
}

fn same_trouble(a: State, b: State) -> bool {
    matches!((a, b), (State::Frozen(_), State::Frozen(_)))
}
