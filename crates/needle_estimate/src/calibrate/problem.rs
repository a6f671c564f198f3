//! The least-squares problem of a recording. An evaluation is a run of the twin, or reuses the last run.
//!
//! The last run is reused without a new one in two cases (`compare::path`). For another shear modulus the force is
//! proportional to it. For another shift of contact or clock it is the same curve at other arguments, unless the
//! contact has moved by more than [`NEAR_M`].

use nalgebra::{DMatrix, DVector};

use super::common::Common;
use super::paths::path_of;
use super::spikes;
use super::tie::{PRESSURES, pressures, tied};
use super::unknown::Sought;
use super::{CalibrateError, Forces, Parts, Task};
use crate::compare::components::Component;
use crate::compare::path::ForcePath;
use crate::compare::rows::{Rows, at_rest};
use crate::compare::{Answer, Depths, Run, Watch, least_squares::Problem};
use needle_core::scene::{Override, Scene, Value};

/// Relative change of the ratio of pressures below which the ratio counts as constant.
const SAME_RATIO: f64 = 1e-12;
/// Largest shift of the contact, m, for which the slope of the last run's force gives the effect.
const NEAR_M: f64 = 2e-5;
/// A key whose doubling changes the force by less than this relative amount has no effect: the change is rounding.
const NO_EFFECT: f64 = 1e-3;
/// A run that is reused.
pub(super) struct Kept {
    /// Values of the unknowns of that run.
    pub x: Vec<f64>,
    /// Force against the axis, then across it.
    pub paths: Vec<ForcePath>,
    /// Regions of the tip.
    pub regions: Vec<Depths>,
}

pub(super) struct Recorded<'a> {
    pub(super) task: &'a Task<'a>,
    pub sought: Vec<Sought>,
    pub(super) watch: &'a mut dyn Watch,
    pub(super) tell: &'a mut dyn FnMut(&str),
    pub(super) common: Common,
    /// Fitted and held-out rows.
    parts: Parts,
    /// Fitted rows: those of the fitted part without the spikes.
    pub(super) fitted: Vec<usize>,
    /// Time, depth, measured and first predicted force of each row.
    pub(super) forces: Forces,
    /// Measured components across the axis at the rows, and whether the model predicts them.
    pub(super) across: Vec<Component>,
    pub(super) vectors: bool,
    pub(super) runs: u32,
    /// Keys that take the value of an unknown: the key, and the unknown's index.
    tied: Vec<(&'static str, usize)>,
    /// The unknowns that are pressures, if the force is proportional to all of them together; otherwise empty.
    pub(super) pressures: Vec<usize>,
    pub(super) kept: Option<Kept>,
    /// Number of poses that the last run refused.
    pub(super) refused: usize,
}

/// All constants of a scene's law in Pa, times a factor.
fn scaled(scene: &Scene, factor: f64) -> Vec<Override> {
    let of = |key: &&str| -> Option<Override> {
        let list: Vec<f64> = scene.get(key)?.as_list()?.iter().map(|x| factor * x).collect();
        let value =
            if *key == "material.ogden_shear_moduli_pa" { Value::of_numbers(list) } else { Value::Real(list[0]) };
        Some(Override::typed(key, value, "--fit"))
    };
    PRESSURES.iter().filter_map(of).collect()
}

impl<'a> Recorded<'a> {
    pub(crate) fn new(
        task: &'a Task<'a>,
        sought: Vec<Sought>,
        watch: &'a mut dyn Watch,
        tell: &'a mut dyn FnMut(&str),
    ) -> Self {
        Self {
            tied: tied(task.scene, &sought),
            pressures: pressures(task.scene, &sought),
            common: Common::new(task.scene, &sought),
            task,
            sought,
            watch,
            tell,
            parts: Parts { fitted: 0..0, held_out: None },
            fitted: Vec::new(),
            forces: Forces::default(),
            across: Vec::new(),
            vectors: false,
            runs: 0,
            kept: None,
            refused: 0,
        }
    }

    /// Takes the readings to fit from the first run.
    pub(crate) fn take(&mut self, first: &Run, clock_s: f64) -> Result<(), CalibrateError> {
        let path = path_of(first).ok_or(CalibrateError::NoContact)?;
        // with a late force, an oscillation at a time of the run appears later in the measured readings
        let swings: Vec<bool> = at_rest(&first.answers).iter().map(|at_rest| !at_rest).collect();
        let swung = |time_s: f64| swings[first.answers.partition_point(|a| a.time_s < time_s).min(swings.len() - 1)];
        let usable = |a: &Answer| {
            let then = a.time_s - clock_s;
            a.residual_n().is_some() && path.covers(then) && !swung(then)
        };
        let rows: Vec<(usize, &Answer)> = first.answers.iter().enumerate().filter(|(_, a)| usable(a)).collect();
        let whole = Parts::of(first, self.task.part);
        let row = |answer: usize| rows.partition_point(|(i, _)| *i < answer);
        let range = |r: &std::ops::Range<usize>| row(r.start)..row(r.end);
        self.parts = Parts { fitted: range(&whole.fitted), held_out: whole.held_out.as_ref().map(range) };
        let (readings, unknowns) = (self.parts.fitted.len(), self.sought.len());
        if readings <= unknowns {
            let remedy = "is there a load cell whose stamps overlap the motion's? --time-offset-s says how far two clocks are apart, and `needle_twin bag info` \
                 shows the topics of a bag";
            return Err(CalibrateError::TooFew { readings, unknowns, remedy });
        }
        let fitted = &rows[self.parts.fitted.clone()];
        if fitted.iter().all(|(_, a)| a.predicted_n == 0.0) {
            return Err(CalibrateError::NoContact);
        }
        let column = |of: fn(&Answer) -> f64| -> Vec<f64> { rows.iter().map(|(_, a)| of(a)).collect() };
        let time_s = column(|a| a.time_s);
        self.forces = Forces {
            depth_m: time_s.iter().map(|t| path.depth_m(t - clock_s)).collect(),
            measured_n: column(|a| a.measured_n.unwrap_or(0.0)),
            start_n: time_s.iter().map(|t| path.force_n(t - clock_s, 0.0)).collect(),
            time_s,
            ..Forces::default()
        };
        self.fitted = self.parts.fitted.clone().collect();
        let answers: Vec<&Answer> = rows.iter().map(|(_, a)| *a).collect();
        self.take_components(first, &answers);
        self.kept = None;
        Ok(())
    }

    /// The keys' values as changes of the scene.
    pub(crate) fn changes(&self, x: &[f64]) -> Vec<Override> {
        let keys = self.sought.iter().zip(x).flat_map(|(s, value)| match s {
            scale if scale.is_scale() => scaled(self.task.scene, *value),
            Sought::Key(key) => vec![Override::typed(key, *value, "--fit")],
            _ => Vec::new(),
        });
        keys.chain(self.tied.iter().map(|(key, k)| Override::typed(key, x[*k], "--fit"))).collect()
    }

    /// Keys that took the value of another: (key, the other).
    pub(crate) fn tied(&self) -> Vec<(String, String)> {
        self.tied.iter().map(|(key, k)| ((*key).to_owned(), self.sought[*k].name().to_owned())).collect()
    }

    /// Names of the unknowns.
    pub(crate) fn names(&self) -> Vec<String> {
        self.sought.iter().map(|s| s.name().to_owned()).collect()
    }

    /// Which rows are fitted.
    pub(crate) const fn parts(&self) -> &Parts {
        &self.parts
    }

    /// Number of poses that the twin refused in the last run.
    pub(crate) const fn refused(&self) -> usize {
        self.refused
    }

    /// Number of runs of the twin so far.
    pub(crate) const fn runs(&self) -> u32 {
        self.runs
    }

    /// The error if the scene runs with its own values, but not with the start values of the search.
    pub(crate) fn beyond_start(&self) -> CalibrateError {
        let keys: Vec<&str> = self.task.wanted.iter().map(|w| w.key.as_str()).collect();
        CalibrateError::Diverged(format!("with {} near the start of the search", keys.join(", ")))
    }

    /// All forces, including those for the values x. The last run must have been made with these values.
    pub(crate) fn forces(&mut self, x: &[f64]) -> Result<Forces, CalibrateError> {
        if self.kept.as_ref().is_none_or(|kept| kept.x != x) {
            self.kept = None;
        }
        let model_n = self.predicted(x)?.ok_or_else(|| self.beyond_start())?;
        let fitted_n = model_n.iter().zip(&self.forces.time_s).map(|(f, &t)| f + self.added(x, t)).collect();
        Ok(Forces { model_n, fitted_n, ..self.forces.clone() })
    }

    /// The fitted rows, for the verdict and for the alignment with the last run.
    pub(crate) fn rows(&self, forces: &Forces, predicted_n: &[f64], x: &[f64]) -> Rows {
        let of = |column: &[f64]| -> Vec<f64> { self.fitted.iter().map(|&i| column[i]).collect() };
        let measured = self.fitted.iter().map(|&i| forces.measured_n[i] - self.added(x, forces.time_s[i]));
        Rows {
            time_s: of(&forces.time_s),
            depth_m: of(&forces.depth_m),
            predicted_n: of(predicted_n),
            measured_n: measured.collect(),
            one_clock: self.task.measured.one_clock(),
            readings: self.own_readings(),
            known: self.task.load_cell.known(),
            whole_n: 0.0,
            zero_n: 0.0,
        }
    }

    /// Number of the load cell's readings between the first and the last fitted row.
    fn own_readings(&self) -> Option<usize> {
        let time = |i: &usize| self.forces.time_s[*i] + self.task.readings.first().map_or(0.0, |r| r.time_s);
        let (first, last) = (self.fitted.first()?, self.fitted.last()?);
        Some(self.task.measured.between(time(first), time(last)))
    }

    /// The last run's force along its motion.
    pub(crate) fn path(&self) -> Option<&ForcePath> {
        self.kept.as_ref().map(|kept| &kept.paths[0])
    }

    /// Regions of the tip during the last run.
    pub(crate) fn regions(&self) -> &[Depths] {
        self.kept.as_ref().map_or(&[], |kept| &kept.regions)
    }

    /// Value of an unknown; 0 if it is not sought.
    pub(crate) fn value(&self, x: &[f64], of: &Sought) -> f64 {
        self.sought.iter().position(|s| s == of).map_or(0.0, |k| x[k])
    }

    /// What the load cell adds to the reading at a time, for the unknowns x.
    pub(super) fn added(&self, x: &[f64], time_s: f64) -> f64 {
        self.sought.iter().zip(x).map(|(s, value)| value * s.added(time_s)).sum()
    }

    /// The common factor of all pressures relative to the last run; `None` if there is no common factor.
    fn factor(&self, x: &[f64], kept: &Kept) -> Option<f64> {
        let Some(&first) = self.pressures.iter().find(|&&k| kept.x[k] != 0.0) else { return Some(1.0) };
        let factor = x[first] / kept.x[first];
        let alike = |&k: &usize| k == first || (x[k] - factor * kept.x[k]).abs() <= SAME_RATIO * x[k].abs();
        self.pressures.iter().all(alike).then_some(factor)
    }

    /// How the force for other values follows from the last run: a factor and the shift of the contact. `None` if a
    /// new run is needed.
    fn relative_to_kept(&self, x: &[f64]) -> Option<(f64, f64)> {
        let kept = self.kept.as_ref()?;
        let factor = self.factor(x, kept)?;
        let mut shift = 0.0;
        for (k, sought) in self.sought.iter().enumerate().filter(|(k, _)| !self.pressures.contains(k)) {
            match sought {
                Sought::Key(_) if x[k] != kept.x[k] => return None,
                Sought::Contact => shift = x[k] - kept.x[k],
                _ => {}
            }
        }
        (shift.abs() <= NEAR_M).then_some((factor, shift))
    }

    /// Predicted force at every row; `None` if the scene is not valid, diverges or refuses poses.
    pub(super) fn predicted(&mut self, x: &[f64]) -> Result<Option<Vec<f64>>, CalibrateError> {
        Ok(self.all_predicted(x)?.map(|mut all| all.swap_remove(0)))
    }

    /// The same against the axis, then along each direction across it.
    pub(super) fn all_predicted(&mut self, x: &[f64]) -> Result<Option<Vec<Vec<f64>>>, CalibrateError> {
        if self.relative_to_kept(x).is_none() {
            match self.run_with(x)? {
                Some(kept) => self.kept = Some(kept),
                None => return Ok(None),
            }
        }
        let Some((factor, shift)) = self.relative_to_kept(x) else { return Ok(None) };
        let clock = self.value(x, &Sought::Clock);
        let force = |path: &ForcePath, t: &f64| factor * path.force_n(t - clock, shift);
        let all = |path: &ForcePath| self.forces.time_s.iter().map(|t| force(path, t)).collect();
        Ok(self.kept.as_ref().map(|kept| kept.paths.iter().map(all).collect()))
    }

    /// Forces at the fitted rows against the axis and, if they are fitted, across it, N; and their depths, m.
    pub(crate) fn all_fitted(&mut self, x: &[f64]) -> Result<(Vec<f64>, Vec<f64>), CalibrateError> {
        let mut all = self.all_predicted(x)?.unwrap_or_default();
        all.truncate(1 + self.across_fitted().len());
        let force = all.iter().flat_map(|force| self.at_fitted(force)).collect();
        let depth = all.iter().flat_map(|_| self.at_fitted(&self.forces.depth_m)).collect();
        Ok((force, depth))
    }

    /// Derivative of the fitted rows' force by an unknown that needs no run; `None` otherwise.
    fn derivative(&self, x: &[f64], k: usize, force: &[f64]) -> Option<Vec<f64>> {
        let (kept, (factor, shift)) = (self.kept.as_ref()?, self.relative_to_kept(x)?);
        let clock = self.value(x, &Sought::Clock);
        let times = || self.fitted.iter().map(|&i| self.forces.time_s[i]);
        let each = |of: &dyn Fn(&ForcePath, f64) -> f64| -> Vec<f64> {
            self.one_column(kept.paths.iter().map(|path| times().map(|t| of(path, t)).collect()))
        };
        Some(match &self.sought[k] {
            Sought::Key(_) if self.pressures == [k] => force.iter().map(|f| f / x[k]).collect(),
            Sought::Key(_) => return None,
            Sought::Contact => each(&|path, t| -factor * path.stiffness(t - clock, shift)),
            Sought::Clock => each(&|path, t| -factor * path.rate(t - clock, shift)),
            // the contributions across the axis are projected out
            added => times().map(|t| added.added(t)).chain(vec![0.0; force.len() - self.fitted.len()]).collect(),
        })
    }
}

impl Recorded<'_> {
    /// Leaves out the rows whose residuals are outliers, and returns their number.
    pub(crate) fn leave_out(&mut self, residuals: &[f64]) -> usize {
        let kept = spikes::without(&self.fitted, residuals);
        let left = self.fitted.len() - kept.len();
        self.fitted = kept;
        left
    }

    /// Predicted - measured at the fitted rows, N.
    fn difference_to_measured(&mut self, x: &[f64]) -> Result<Option<DVector<f64>>, CalibrateError> {
        let Some(force) = self.all_predicted(x)? else { return Ok(None) };
        let along = |i: usize| force[0][i] + self.added(x, self.forces.time_s[i]) - self.forces.measured_n[i];
        let across = force[1..].iter().zip(self.across_fitted());
        let across = across.map(|(f, c)| self.fitted.iter().map(|&i| f[i] - c.measured_n[i]).collect());
        let along: Vec<f64> = self.fitted.iter().map(|&i| along(i)).collect();
        Ok(Some(DVector::from_vec(self.one_column(std::iter::once(along).chain(across)))))
    }

    /// Whether outliers of residuals and derivatives are limited: the force falls at punctures, whose depth is not
    /// what is sought.
    fn limits(&self) -> bool {
        self.task.scene.instrument.is_some_and(|instrument| instrument.is_frictional())
            && !self.sought.iter().any(|sought| sought.name().ends_with("puncture_force_n"))
    }
}

impl Problem for Recorded<'_> {
    type Error = CalibrateError;

    fn residuals(&mut self, x: &[f64]) -> Result<Option<DVector<f64>>, CalibrateError> {
        let mut r = self.difference_to_measured(x)?;
        if let Some(r) = r.as_mut().filter(|_| self.limits()) {
            spikes::limit(r.as_mut_slice());
        }
        Ok(r)
    }

    fn jacobian(&mut self, x: &[f64], _: &DVector<f64>) -> Result<Option<DMatrix<f64>>, CalibrateError> {
        // the last run is that of x, so this costs none
        let Some(r) = self.difference_to_measured(x)? else { return Ok(None) };
        let force: Vec<f64> = self.all_measured(x).iter().zip(&r).map(|(m, r)| r + m).collect();
        let largest_residual = if self.limits() { spikes::largest(r.as_slice()) } else { f64::INFINITY };
        let whole = force.iter().map(|f| f * f).sum::<f64>().sqrt();
        let mut jacobian = DMatrix::zeros(force.len(), x.len());
        // the force is homogeneous in the pressures: the derivative by the largest follows from the others' (Euler)
        let largest = self.pressures.iter().copied().max_by(|&a, &b| x[a].abs().total_cmp(&x[b].abs()));
        let last = largest.filter(|_| self.pressures.len() > 1);
        for k in (0..x.len()).filter(|k| Some(*k) != last).chain(last) {
            if Some(k) == last {
                let others: DVector<f64> = self
                    .pressures
                    .iter()
                    .filter(|&&p| p != k)
                    .fold(DVector::from_column_slice(&force), |rest, &p| rest - jacobian.column(p) * x[p]);
                jacobian.set_column(k, &(others / x[k]));
                continue;
            }
            let column = match self.derivative(x, k, &force) {
                Some(column) => column,
                None => match self.difference(x, k, &force)? {
                    Some(mut column) => {
                        if self.limits() {
                            spikes::limit(&mut column);
                        }
                        column
                    }
                    None => return Ok(None),
                },
            };
            let column = DVector::from_vec(column);
            let size = if self.pressures.contains(&k) { largest.map_or(x[k], |l| x[l]) } else { x[k] };
            let doubled = column.norm() * if size == 0.0 { 1.0 } else { size.abs() };
            if !matches!(self.sought[k], Sought::Key(_)) || doubled > NO_EFFECT * whole {
                jacobian.set_column(k, &column);
            }
        }
        // a limited residual does not change
        for row in (0..r.len()).filter(|&row| r[row].abs() > largest_residual) {
            jacobian.row_mut(row).fill(0.0);
        }
        Ok(Some(jacobian))
    }
}
