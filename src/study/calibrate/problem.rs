//! The least-squares problem of a recording: each evaluation is a run of the twin.

use nalgebra::{DMatrix, DVector};

use super::{CalibrateError, Forces, LoadCell, Parts, Task};
use crate::compare::{self, Answer, Collector, ForceSeries, Keep, Reading, Run, Watch, least_squares::Problem};
use crate::scene::{Override, Scene};
use crate::twin::Phase;

/// Change of a key for its derivative, as a share of it: far above the rounding of single precision, and what bends within it
/// is small against the steps of the search.
const DIFFERENCE: f64 = 0.01;
/// The force is proportional to this key (quasi-static, Poisson's ratio fixed), so its derivative needs no run.
const PROPORTIONAL: &str = "material.shear_modulus_pa";

/// A key whose doubling changes the force by less than this share of it has no effect: what is left is rounding.
const NO_EFFECT: f64 = 1e-3;
/// Where a scene's retraction coefficient equals its deformation coefficient, they stay equal.
const TIED: (&str, &str) = ("instrument.retraction_coefficient", "instrument.deformation_coefficient");

/// A residual of more than so many medians of all residuals' sizes is a spike (for normal noise: six standard deviations).
const SPIKE: f64 = 9.0;
/// After a bonded instrument has lifted off, the twin's tissue oscillates for less than this, s; the force is not quasi-static then.
const SWINGS_S: f64 = 0.3;
/// Largest share of the readings that may be spikes.
const MOST_LEFT_OUT: f64 = 0.02;

/// What the load cell adds to the force.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LoadCellTerm {
    Offset,
    Drift,
}

impl LoadCellTerm {
    pub fn of(load_cell: LoadCell) -> &'static [Self] {
        match load_cell {
            LoadCell::Exact => &[],
            LoadCell::Offset => &[Self::Offset],
            LoadCell::Drift => &[Self::Offset, Self::Drift],
        }
    }

    const fn name(self) -> &'static str {
        match self {
            Self::Offset => "load_cell.offset_n",
            Self::Drift => "load_cell.drift_n_per_s",
        }
    }

    /// What one unit of it adds at a time.
    const fn at(self, time_s: f64) -> f64 {
        match self {
            Self::Offset => 1.0,
            Self::Drift => time_s,
        }
    }
}

pub(super) struct Recorded<'a> {
    task: &'a Task<'a>,
    terms: &'static [LoadCellTerm],
    watch: &'a mut dyn Watch,
    tell: &'a mut dyn FnMut(&str),
    /// Poses with a measured force, as indices of the answers of a run.
    rows: Vec<usize>,
    /// Answers of every run.
    answers: usize,
    /// Of the rows.
    parts: Parts,
    /// Rows that are fitted: those of the part, less what was left out.
    fitted: Vec<usize>,
    /// Time, depth, measured and first predicted force of each row.
    forces: Forces,
    runs: u32,
    /// A key that takes the value of a wanted one, by its index.
    tied: Option<usize>,
}

impl<'a> Recorded<'a> {
    /// Runs the scene as it is.
    pub fn new(
        task: &'a Task<'a>,
        terms: &'static [LoadCellTerm],
        watch: &'a mut dyn Watch,
        tell: &'a mut dyn FnMut(&str),
    ) -> Result<Self, CalibrateError> {
        let parts = Parts { fitted: 0..0, held_out: None };
        let (rows, forces, tied) = (Vec::new(), Forces::default(), tied(task));
        let mut new =
            Self { task, terms, watch, tell, rows, answers: 0, parts, fitted: Vec::new(), forces, runs: 0, tied };
        let first = new.run(task.scene)?;
        if let Some(reason) = first.diverged {
            return Err(CalibrateError::Diverged(reason));
        }
        new.take(&first)?;
        Ok(new)
    }

    fn take(&mut self, first: &Run) -> Result<(), CalibrateError> {
        let at_rest = at_rest(&first.answers);
        let usable = |(i, a): &(usize, &Answer)| a.residual_n().is_some() && at_rest[*i];
        let rows: Vec<(usize, &Answer)> = first.answers.iter().enumerate().filter(usable).collect();
        let whole = Parts::of(first, self.task.part);
        let row = |answer: usize| rows.partition_point(|(i, _)| *i < answer);
        let range = |r: &std::ops::Range<usize>| row(r.start)..row(r.end);
        self.parts = Parts { fitted: range(&whole.fitted), held_out: whole.held_out.as_ref().map(range) };
        let (readings, unknowns) = (self.parts.fitted.len(), self.task.wanted.len() + self.terms.len());
        if readings <= unknowns {
            let remedy =
                "does the bag hold a load cell whose stamps overlap the motion's? `needle_twin bag info` shows it";
            return Err(CalibrateError::TooFew { readings, unknowns, remedy });
        }
        let fitted = &rows[self.parts.fitted.clone()];
        if fitted.iter().all(|(_, a)| a.predicted_n == 0.0) {
            return Err(CalibrateError::NoContact);
        }
        let column = |of: fn(&Answer) -> f64| -> Vec<f64> { rows.iter().map(|(_, a)| of(a)).collect() };
        self.forces = Forces {
            time_s: column(|a| a.time_s),
            depth_m: column(|a| a.depth_m),
            measured_n: column(|a| a.measured_n.unwrap_or(0.0)),
            start_n: column(|a| a.predicted_n),
            ..Forces::default()
        };
        self.fitted = self.parts.fitted.clone().collect();
        self.answers = first.answers.len();
        self.rows = rows.into_iter().map(|(i, _)| i).collect();
        Ok(())
    }

    /// Changes of the scene to the keys' values.
    pub fn changes(&self, x: &[f64]) -> Vec<Override> {
        let keys = self.task.wanted.iter().zip(x);
        let tied = self.tied.map(|k| Override::typed(TIED.0, x[k], "--fit"));
        keys.map(|(wanted, value)| Override::typed(&wanted.key, *value, "--fit")).chain(tied).collect()
    }

    /// Keys that took the value of another: (key, the other).
    pub fn tied(&self) -> Vec<(String, String)> {
        self.tied.iter().map(|_| (TIED.0.to_owned(), TIED.1.to_owned())).collect()
    }

    /// Names of the unknowns.
    pub fn names(&self) -> Vec<String> {
        let keys = self.task.wanted.iter().map(|wanted| wanted.key.clone());
        keys.chain(self.terms.iter().map(|term| term.name().to_owned())).collect()
    }

    /// Which rows are fitted.
    pub const fn parts(&self) -> &Parts {
        &self.parts
    }

    /// Rows that are fitted.
    pub fn fitted(&self) -> &[usize] {
        &self.fitted
    }

    /// Leaves out the rows whose residuals are far from all others; gives how many. A spike of a few readings (a bond that lets
    /// go, a knock) is no part of the model and would pull at every value. Where many are far off the model is wrong, and
    /// nothing is left out.
    pub fn leave_out(&mut self, residuals: &[f64]) -> usize {
        let mut sizes: Vec<f64> = residuals.iter().map(|r| r.abs()).collect();
        sizes.sort_unstable_by(f64::total_cmp);
        let most = SPIKE * sizes[sizes.len() / 2];
        let kept: Vec<usize> =
            self.fitted.iter().zip(residuals).filter(|(_, r)| r.abs() <= most).map(|(i, _)| *i).collect();
        let left = self.fitted.len() - kept.len();
        if left as f64 > MOST_LEFT_OUT * self.fitted.len() as f64 {
            return 0;
        }
        self.fitted = kept;
        left
    }

    /// Runs of the twin so far.
    pub const fn runs(&self) -> u32 {
        self.runs
    }

    /// What to say if the scene runs as it is, but not with the keys at the start of their search.
    pub fn beyond_start(&self) -> CalibrateError {
        let keys: Vec<&str> = self.task.wanted.iter().map(|w| w.key.as_str()).collect();
        CalibrateError::Diverged(format!("with {} near the start of the search", keys.join(", ")))
    }

    /// All forces, those with the values x among them.
    pub fn forces(&mut self, x: &[f64]) -> Result<Forces, CalibrateError> {
        let model_n = self.predicted(x)?.ok_or_else(|| self.beyond_start())?;
        let fitted_n = model_n.iter().zip(&self.forces.time_s).map(|(f, &t)| f + self.added(x, t)).collect();
        Ok(Forces { model_n, fitted_n, ..self.forces.clone() })
    }

    fn run(&mut self, scene: &Scene) -> Result<Run, CalibrateError> {
        self.runs += 1;
        run(scene, self.task.readings, self.task.measured, self.watch)
    }

    /// What the load cell adds at a time, with the unknowns x.
    fn added(&self, x: &[f64], time_s: f64) -> f64 {
        let terms = self.terms.iter().zip(&x[self.task.wanted.len()..]);
        terms.map(|(term, value)| value * term.at(time_s)).sum()
    }

    /// Predicted force at every row; `None` where the scene can't be, diverges or refuses poses.
    fn predicted(&mut self, x: &[f64]) -> Result<Option<Vec<f64>>, CalibrateError> {
        let values: Vec<String> = self.task.wanted.iter().zip(x).map(|(w, v)| format!("{} = {v:.6}", w.key)).collect();
        (self.tell)(&format!("run {}: {}", self.runs + 1, values.join(", ")));
        let Ok(scene) = self.task.scene.with(&self.changes(x)) else { return Ok(None) };
        let run = match self.run(&scene) {
            Err(CalibrateError::Build { .. }) => return Ok(None),
            other => other?,
        };
        if run.diverged.is_some() || run.answers.len() != self.answers {
            return Ok(None);
        }
        Ok(Some(self.rows.iter().map(|&i| run.answers[i].predicted_n).collect()))
    }

    /// Derivative of the fitted rows' force by one key, from a second run; the other way where the first can't be.
    fn difference(&mut self, x: &[f64], k: usize, force: &[f64]) -> Result<Option<Vec<f64>>, CalibrateError> {
        let size = if x[k] == 0.0 { DIFFERENCE } else { DIFFERENCE * x[k].abs() };
        for change in [size, -size] {
            let mut beside = x.to_vec();
            beside[k] += change;
            if let Some(other) = self.predicted(&beside)? {
                let fitted = self.fitted.iter().map(|&i| other[i]);
                return Ok(Some(fitted.zip(force).map(|(a, b)| (a - b) / change).collect()));
            }
        }
        Ok(None)
    }
}

/// A run of a scene over a recording.
pub(super) fn run(
    scene: &Scene,
    readings: &[Reading],
    measured: &ForceSeries,
    watch: &mut dyn Watch,
) -> Result<Run, CalibrateError> {
    let built = compare::build(scene);
    let (mut twin, build_s) = built.map_err(|source| CalibrateError::Build { scene: scene.name.clone(), source })?;
    let collector = Collector::new(&twin, "calibrate", build_s, Keep::ANSWERS);
    let run = compare::drive(&mut twin, readings.iter().copied(), Some(measured), collector, watch);
    if watch.stop() { Err(CalibrateError::Interrupted) } else { Ok(run) }
}

/// Which answers are not of a tissue that an instrument has just let go.
fn at_rest(answers: &[Answer]) -> Vec<bool> {
    let mut left_s = f64::NEG_INFINITY;
    let mut at_rest = |a: &Answer| {
        if a.phase != Phase::Approach {
            left_s = a.time_s;
        }
        a.phase != Phase::Approach || a.time_s - left_s > SWINGS_S
    };
    answers.iter().map(&mut at_rest).collect()
}

/// The wanted key that another one goes with.
fn tied(task: &Task) -> Option<usize> {
    let one = |key| task.scene.get(key);
    let same = one(TIED.0).is_some() && one(TIED.0) == one(TIED.1);
    let alone = task.wanted.iter().all(|w| w.key != TIED.0);
    task.wanted.iter().position(|w| w.key == TIED.1).filter(|_| same && alone)
}

impl Problem for Recorded<'_> {
    type Error = CalibrateError;

    fn residuals(&mut self, x: &[f64]) -> Result<Option<DVector<f64>>, CalibrateError> {
        let Some(force) = self.predicted(x)? else { return Ok(None) };
        let residual = |i: usize| force[i] + self.added(x, self.forces.time_s[i]) - self.forces.measured_n[i];
        Ok(Some(DVector::from_iterator(self.fitted.len(), self.fitted.iter().map(|&i| residual(i)))))
    }

    fn jacobian(&mut self, x: &[f64], r: &DVector<f64>) -> Result<Option<DMatrix<f64>>, CalibrateError> {
        let keys = self.task.wanted.len();
        let rows = self.fitted.clone();
        let without = |i: usize| self.forces.measured_n[i] - self.added(x, self.forces.time_s[i]);
        let force: Vec<f64> = rows.iter().zip(r).map(|(&i, r)| r + without(i)).collect();
        let mut jacobian = DMatrix::zeros(rows.len(), x.len());
        for k in 0..keys {
            let column = if self.task.wanted[k].key == PROPORTIONAL {
                force.iter().map(|f| f / x[k]).collect()
            } else {
                let Some(column) = self.difference(x, k, &force)? else { return Ok(None) };
                column
            };
            let column = DVector::from_vec(column);
            let doubled = column.norm() * if x[k] == 0.0 { 1.0 } else { x[k].abs() };
            if doubled > NO_EFFECT * force.iter().map(|f| f * f).sum::<f64>().sqrt() {
                jacobian.set_column(k, &column);
            }
        }
        for (k, term) in self.terms.iter().enumerate() {
            let column = rows.iter().map(|&i| term.at(self.forces.time_s[i]));
            jacobian.set_column(keys + k, &DVector::from_iterator(rows.len(), column));
        }
        Ok(Some(jacobian))
    }
}
