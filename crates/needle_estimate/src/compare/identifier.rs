//! Online identification of stiffness, needle coefficient and load-cell offset, reading by reading.
//!
//! It is a `Learner` with three unknowns that need no run of the twin. With F the twin's force and z the load
//! cell's reading,
//!
//! ```text
//! z = F a c + b + error of the model + noise = F (1 + 0.5 w_a + 0.5 w_c) + 0.1 N w_b + ...,   w: normal, mean 0, variance 1
//! a = mu / mu_scene = 1 + 0.5 w_a,   c = C_D / C_D,scene = 1 + 0.5 w_c / a (1 before the puncture),   b = 0.1 N w_b: offset
//! ```
//!
//! The force is proportional to the shear modulus (quasi-static, Poisson's ratio fixed). It is nearly proportional to
//! the deformation coefficient, if the retraction coefficient changes in proportion: the nodes held by the needle
//! move by C_D, and the tissue's response to that is nearly linear. `tests/ros/identify.rs` compares both with runs
//! of the twin. So the two have the same effect on a needle's force, and only one of them can be identified from it.
//!
//! A residual that jumps, or that stays larger than noise and model error explain, shows that the model does not hold
//! (slip, puncture, a fault of the sensor). Then the update stops, and recent updates are discarded
//! ([`learning`](super::learning)).

use super::learning::{Learner, Reading};

/// A parameter that can be identified.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parameter {
    /// `material.shear_modulus_pa`, Pa.
    ShearModulus,
    /// `instrument.deformation_coefficient`; the retraction coefficient changes in proportion.
    DeformationCoefficient,
    /// `load_cell.offset_n`, N.
    Offset,
}

impl Parameter {
    /// All parameters, in the order of the state.
    pub const ALL: [Self; 3] = [Self::ShearModulus, Self::DeformationCoefficient, Self::Offset];

    /// Its name: the scene's key, or that of the load cell's parameter.
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

/// State of the identification.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum State {
    /// It is active; the errors are still too large.
    Learning,
    /// Every parameter is known to [`CONVERGED_SHARE`], the offset to the noise of one reading.
    Converged,
    /// It is stopped, because the model does not hold.
    Frozen(Cause),
}

/// Why the identification is stopped.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Cause {
    /// The residual jumped by this force, N.
    Jump(f64),
    /// The residual stays at this force, N, larger than noise and model error explain.
    Level(f64),
    /// The load cell is faulty.
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
/// A-priori standard deviations: relative to the scene's values; of the offset in N.
const PRIOR: [f64; 3] = [0.5, 0.5, 0.1];
/// Least noise that is assumed, N: quantised readings can repeat exactly.
const LEAST_NOISE_N: f64 = 1e-5;

/// See the module.
#[derive(Clone, Debug)]
pub struct Identifier {
    wanted: [bool; 3],
    /// Reference values: those of the scene.
    unit: [f64; 3],
    learner: Learner,
    /// Channel of the load cell in the learner.
    force: usize,
    /// Whether the load cell is faulty; cleared when the updates resume.
    fault: bool,
    state: State,
    /// Time of the last reading, and that since the first one, s.
    last_s: Option<f64>,
    clock_s: f64,
}

impl Identifier {
    /// Starts with the scene's shear modulus (Pa) and deformation coefficient. Parameters that are not wanted stay
    /// there.
    #[must_use]
    pub fn new(wanted: &[Parameter], shear_modulus_pa: f64, deformation_coefficient: f64) -> Self {
        let unit = [shear_modulus_pa, deformation_coefficient, 1.0];
        Self::fresh(Parameter::ALL.map(|p| wanted.contains(&p)), unit)
    }

    fn fresh(wanted: [bool; 3], unit: [f64; 3]) -> Self {
        let mut learner = Learner::default();
        let force = learner.add(LEAST_NOISE_N);
        Self { wanted, unit, learner, force, fault: false, state: State::Learning, last_s: None, clock_s: 0.0 }
    }

    /// Restarts with the same parameters.
    pub fn reset(&mut self) {
        *self = Self::fresh(self.wanted, self.unit);
    }

    /// The present state.
    #[must_use]
    pub const fn state(&self) -> State {
        self.state
    }

    /// Relative value of a parameter (of the offset: N) and its standard error.
    fn known(&self, parameter: Parameter) -> (f64, f64) {
        let state = |row: [f64; 3]| {
            let row: [f64; 3] = std::array::from_fn(|k| if self.wanted[k] { row[k] } else { 0.0 });
            let (mean, variance) = self.learner.state(&row);
            (mean, variance.sqrt())
        };
        let (more, error) = state([PRIOR[0], 0.0, 0.0]);
        let stiffer = Self::share(more);
        match parameter {
            Parameter::ShearModulus => (stiffer, error),
            Parameter::DeformationCoefficient => {
                let more = state([0.0, PRIOR[1], 0.0]).0 / stiffer;
                // w_c / a is linearised in both
                let error = state([-more * PRIOR[0] / stiffer, PRIOR[1] / stiffer, 0.0]).1;
                (Self::share(more), error)
            }
            Parameter::Offset => state([0.0, 0.0, PRIOR[2]]),
        }
    }

    fn share(more: f64) -> f64 {
        (1.0 + more).clamp(0.01, 100.0)
    }

    /// Value and standard error of a parameter, model error included; `None` if it is not wanted.
    #[must_use]
    pub fn estimate(&self, parameter: Parameter) -> Option<(f64, f64)> {
        let k = parameter.index();
        let (value, error) = self.known(parameter);
        self.wanted[k].then_some((value * self.unit[k], error * self.unit[k]))
    }

    /// Expected reading of the load cell for a predicted force, N, with the identified values.
    #[must_use]
    pub fn expected_n(&self, predicted_n: f64, inserted: bool) -> f64 {
        predicted_n + self.learner.state(&self.effects(predicted_n, inserted)).0
    }

    /// Effect of each of the three unknowns on a reading for one standard deviation, N.
    fn effects(&self, predicted_n: f64, inserted: bool) -> [f64; 3] {
        let of = [predicted_n, if inserted { predicted_n } else { 0.0 }, 1.0];
        std::array::from_fn(|k| if self.wanted[k] { PRIOR[k] * of[k] } else { 0.0 })
    }

    /// Takes a reading: the twin's force and the measured one at the same time, N. `inserted`: the needle has
    /// punctured the surface. `doubt_n`: possible error of the twin's force because its tissue oscillates
    /// ([`Swing`](super::learning::Swing)), N. Returns the state if it has changed.
    pub fn update(
        &mut self,
        time_s: f64,
        predicted_n: f64,
        inserted: bool,
        measured_n: f64,
        doubt_n: f64,
    ) -> Option<State> {
        if ![time_s, predicted_n, measured_n, doubt_n].iter().all(|x| x.is_finite()) {
            return None;
        }
        // a clock that jumps back gives no interval; the time continues from there
        let since_s = time_s - self.last_s.replace(time_s).unwrap_or(f64::NEG_INFINITY);
        if since_s <= 0.0 {
            return None;
        }
        self.clock_s += if since_s.is_finite() { since_s } else { 0.0 };
        let row = self.effects(predicted_n, inserted);
        let before = self.learner.tally(self.force);
        self.learner.take(
            self.force,
            self.clock_s,
            Reading { off: measured_n - predicted_n, row, force_n: Some(predicted_n), doubt: doubt_n },
        );
        // the estimates do not change within a block
        if self.learner.tally(self.force) == before { None } else { self.judge() }
    }

    /// Reports a fault of the load cell. Returns the state if it has changed.
    pub fn fault(&mut self) -> Option<State> {
        let healthy = !matches!(self.state, State::Frozen(_));
        self.fault |= healthy;
        self.learner.fault();
        if healthy { self.judge() } else { None }
    }

    fn judge(&mut self) -> Option<State> {
        let before = self.state;
        self.fault &= self.learner.trouble().is_some();
        self.state = match self.learner.trouble() {
            Some(_) if self.fault => State::Frozen(Cause::Sensor),
            Some((residual_n, true)) => State::Frozen(Cause::Jump(residual_n)),
            Some((residual_n, false)) => State::Frozen(Cause::Level(residual_n)),
            None if self.is_known() => State::Converged,
            None => State::Learning,
        };
        (before != self.state && !same_trouble(before, self.state)).then_some(self.state)
    }

    fn is_known(&self) -> bool {
        let known = |parameter: Parameter| {
            let (value, error) = self.known(parameter);
            let offset = parameter == Parameter::Offset;
            error <= if offset { self.learner.noise(self.force) } else { CONVERGED_SHARE * value }
        };
        Parameter::ALL.into_iter().filter(|parameter| self.wanted[parameter.index()]).all(known)
    }
}

fn same_trouble(a: State, b: State) -> bool {
    matches!((a, b), (State::Frozen(_), State::Frozen(_)))
}
