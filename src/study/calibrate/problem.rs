//! The least-squares problem of a recording: each evaluation is a run of the twin, or the last run made use of.
//!
//! The force is proportional to the shear modulus, and the same curve read elsewhere for other shifts of contact and clock
//! (`compare::path`): these cost no run, but where the contact has moved by more than [`NEAR_M`].

use nalgebra::{DMatrix, DVector};

use super::paths::{directions, measured_along, path_of, paths_of, run};
use super::unknown::Sought;
use super::{CalibrateError, Forces, Parts, Task};
use crate::compare::path::ForcePath;
use crate::compare::rows::{Rows, at_rest};
use crate::compare::{Answer, At, Reading, Run, Watch, least_squares::Problem};
use crate::scene::{Override, Scene};

/// Change of a key for its derivative, as a share of it: far above the rounding of single precision, and what bends within it
/// is small against the steps of the search.
const DIFFERENCE: f64 = 0.01;
/// The same of a region's depth or modulus: each value is a run of its own, a depth makes another cloud, and two of them differ by up to
/// a per cent of the force, which the change has to stand out from.
const DIFFERENCE_OF_REGIONS: f64 = 0.1;
/// The force is proportional to this key (quasi-static, Poisson's ratio fixed), so another value of it needs no run. The second is a list
/// of one where it is sought.
const PROPORTIONAL: [&str; 2] = ["material.shear_modulus_pa", "material.ogden_shear_moduli_pa"];
/// Shift of the contact, m, within which the last run's own slope says what it does.
const NEAR_M: f64 = 2e-5;
/// Share of the poses that must be answered.
const ANSWERED: f64 = 0.9;

/// A key whose doubling changes the force by less than this share of it has no effect: what is left is rounding.
const NO_EFFECT: f64 = 1e-3;
/// Where a scene's retraction coefficient equals its deformation coefficient, they stay equal.
const TIED: (&str, &str) = ("instrument.retraction_coefficient", "instrument.deformation_coefficient");

/// A residual of more than so many medians of all residuals' sizes is a spike (for normal noise: six standard deviations).
const SPIKE: f64 = 9.0;
/// Largest share of the readings that may be spikes.
const MOST_LEFT_OUT: f64 = 0.02;

/// A run that is made use of again.
struct Kept {
    /// Values of the unknowns that it was made with.
    x: Vec<f64>,
    /// Of the force against the axis, then of those across it.
    paths: Vec<ForcePath>,
}

pub(super) struct Recorded<'a> {
    task: &'a Task<'a>,
    pub sought: Vec<Sought>,
    watch: &'a mut dyn Watch,
    tell: &'a mut dyn FnMut(&str),
    /// Of the rows.
    parts: Parts,
    /// Rows that are fitted: those of the part, less what was left out.
    fitted: Vec<usize>,
    /// Time, depth, measured and first predicted force of each row.
    forces: Forces,
    /// Directions across the axis that are fitted as well, and what was measured along each, N.
    directions: Vec<[f64; 3]>,
    across_n: Vec<Vec<f64>>,
    runs: u32,
    /// A key that takes the value of a wanted one, by its index.
    tied: Option<usize>,
    kept: Option<Kept>,
    /// Poses that the last run refused.
    refused: usize,
}

impl<'a> Recorded<'a> {
    pub fn new(
        task: &'a Task<'a>,
        sought: Vec<Sought>,
        watch: &'a mut dyn Watch,
        tell: &'a mut dyn FnMut(&str),
    ) -> Self {
        Self {
            task,
            sought,
            watch,
            tell,
            parts: Parts { fitted: 0..0, held_out: None },
            fitted: Vec::new(),
            forces: Forces::default(),
            directions: Vec::new(),
            across_n: Vec::new(),
            runs: 0,
            tied: tied(task),
            kept: None,
            refused: 0,
        }
    }

    /// Runs the scene as it is, over the motion as it was recorded but for a shift of the contact.
    pub fn first(&mut self, contact_m: f64) -> Result<Run, CalibrateError> {
        let run = self.run(self.task.scene, contact_m)?;
        match run.diverged {
            Some(reason) => Err(CalibrateError::Diverged(reason)),
            None => Ok(run),
        }
    }

    /// Takes the readings to fit from the first run.
    pub fn take(&mut self, first: &Run, clock_s: f64) -> Result<(), CalibrateError> {
        let path = path_of(first).ok_or(CalibrateError::NoContact)?;
        // what swings in the run's time is seen later by a force that is late
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
            let remedy =
                "does the bag hold a load cell whose stamps overlap the motion's? `needle_twin bag info` shows it";
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
        self.directions = directions(first);
        let answers: Vec<&Answer> = rows.iter().map(|(_, a)| *a).collect();
        self.across_n = self.directions.iter().map(|d| measured_along(&answers, d)).collect();
        Ok(())
    }

    /// Changes of the scene to the keys' values.
    pub fn changes(&self, x: &[f64]) -> Vec<Override> {
        let keys = self.sought.iter().zip(x).filter_map(|(s, value)| match s {
            Sought::Key(key) => Some(Override::typed(key, *value, "--fit")),
            _ => None,
        });
        let tied = self.tied.map(|k| Override::typed(TIED.0, x[k], "--fit"));
        keys.chain(tied).collect()
    }

    /// Keys that took the value of another: (key, the other).
    pub fn tied(&self) -> Vec<(String, String)> {
        self.tied.iter().map(|_| (TIED.0.to_owned(), TIED.1.to_owned())).collect()
    }

    /// Names of the unknowns.
    pub fn names(&self) -> Vec<String> {
        self.sought.iter().map(|s| s.name().to_owned()).collect()
    }

    /// Which rows are fitted.
    pub const fn parts(&self) -> &Parts {
        &self.parts
    }

    /// Poses that the twin refused in the last run.
    pub const fn refused(&self) -> usize {
        self.refused
    }

    /// Leaves out the rows whose residuals are far from all others; gives how many. A spike of a few readings (a bond that lets
    /// go, a knock) is no part of the model and would pull at every value. Where many are far off the model is wrong, and
    /// nothing is left out.
    pub fn leave_out(&mut self, residuals: &[f64]) -> usize {
        let residuals = &residuals[..self.fitted.len()]; // those along the axis
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

    /// All forces, those with the values x among them, from a run with just these values.
    pub fn forces(&mut self, x: &[f64]) -> Result<Forces, CalibrateError> {
        if self.kept.as_ref().is_none_or(|kept| kept.x != x) {
            self.kept = None;
        }
        let model_n = self.predicted(x)?.ok_or_else(|| self.beyond_start())?;
        let fitted_n = model_n.iter().zip(&self.forces.time_s).map(|(f, &t)| f + self.added(x, t)).collect();
        Ok(Forces { model_n, fitted_n, ..self.forces.clone() })
    }

    /// The fitted rows, for the verdict on them and for their alignment with the last run.
    pub fn rows(&self, forces: &Forces, predicted_n: &[f64], x: &[f64]) -> Rows {
        let of = |column: &[f64]| -> Vec<f64> { self.fitted.iter().map(|&i| column[i]).collect() };
        let measured = self.fitted.iter().map(|&i| forces.measured_n[i] - self.added(x, forces.time_s[i]));
        Rows {
            time_s: of(&forces.time_s),
            depth_m: of(&forces.depth_m),
            predicted_n: of(predicted_n),
            measured_n: measured.collect(),
            one_clock: self.task.measured.one_clock(),
            known: self.task.load_cell.known(),
            zero_n: 0.0,
        }
    }

    /// The last run's force along its motion.
    pub fn path(&self) -> Option<&ForcePath> {
        self.kept.as_ref().map(|kept| &kept.paths[0])
    }

    /// Value of an unknown that may not be sought; 0 then.
    pub fn value(&self, x: &[f64], of: &Sought) -> f64 {
        self.sought.iter().position(|s| s == of).map_or(0.0, |k| x[k])
    }

    fn run(&mut self, scene: &Scene, contact_m: f64) -> Result<Run, CalibrateError> {
        self.runs += 1;
        let shifted = |r: &Reading| match r.at {
            At::Depth(depth) => Reading { at: At::Depth(depth - contact_m), ..*r },
            At::Pose(mut pose) => {
                (0..3).for_each(|k| pose.tip[k] -= contact_m * pose.axis[k]);
                Reading { at: At::Pose(pose), ..*r }
            }
        };
        let readings: Vec<Reading> = self.task.readings.iter().map(shifted).collect();
        let run = run(scene, &readings, self.task.measured, self.watch)?;
        self.refused = readings.len() - run.answers.len();
        Ok(run)
    }

    /// What the load cell adds at a time, with the unknowns x.
    fn added(&self, x: &[f64], time_s: f64) -> f64 {
        self.sought.iter().zip(x).map(|(s, value)| value * s.added(time_s)).sum()
    }

    /// Whether another value of a key multiplies the force. The modulus of one of several regions does not.
    fn scales_the_force(&self, key: &str) -> bool {
        PROPORTIONAL.contains(&key) && self.task.scene.regions.is_empty()
    }

    /// How the last run's force follows for other values: its factor and the shift of the contact from it; `None` where it can't.
    fn relative_to_kept(&self, x: &[f64]) -> Option<(f64, f64)> {
        let kept = self.kept.as_ref()?;
        let (mut factor, mut shift) = (1.0, 0.0);
        for ((sought, new), old) in self.sought.iter().zip(x).zip(&kept.x) {
            match sought {
                Sought::Key(key) if self.scales_the_force(key) => factor = new / old,
                Sought::Key(_) if new != old => return None,
                Sought::Contact => shift = new - old,
                _ => {}
            }
        }
        (shift.abs() <= NEAR_M).then_some((factor, shift))
    }

    /// Predicted force at every row; `None` where the scene can't be, diverges or refuses poses.
    fn predicted(&mut self, x: &[f64]) -> Result<Option<Vec<f64>>, CalibrateError> {
        Ok(self.all_predicted(x)?.map(|mut all| all.swap_remove(0)))
    }

    /// The same against the axis, then along each direction across it.
    fn all_predicted(&mut self, x: &[f64]) -> Result<Option<Vec<Vec<f64>>>, CalibrateError> {
        if self.relative_to_kept(x).is_none() {
            match self.paths_with(x)? {
                Some(paths) => self.kept = Some(Kept { x: x.to_vec(), paths }),
                None => return Ok(None),
            }
        }
        let Some((factor, shift)) = self.relative_to_kept(x) else { return Ok(None) };
        let clock = self.value(x, &Sought::Clock);
        let force = |path: &ForcePath, t: &f64| factor * path.force_n(t - clock, shift);
        let all = |path: &ForcePath| self.forces.time_s.iter().map(|t| force(path, t)).collect();
        Ok(self.kept.as_ref().map(|kept| kept.paths.iter().map(all).collect()))
    }

    /// What was measured along the axis less what the load cell adds, then across it, at the fitted rows.
    fn all_measured(&self, x: &[f64]) -> Vec<f64> {
        let along = self.fitted.iter().map(|&i| self.forces.measured_n[i] - self.added(x, self.forces.time_s[i]));
        let across = self.across_n.iter().flat_map(|m| self.fitted.iter().map(|&i| m[i]));
        along.chain(across).collect()
    }

    /// The fitted rows of the forces against the axis and across it, N, and their depths, m.
    pub fn all_fitted(&mut self, x: &[f64]) -> Result<(Vec<f64>, Vec<f64>), CalibrateError> {
        let all = self.all_predicted(x)?.unwrap_or_default();
        let force = all.iter().flat_map(|force| self.fitted.iter().map(|&i| force[i])).collect();
        let depth = all.iter().flat_map(|_| self.fitted.iter().map(|&i| self.forces.depth_m[i])).collect();
        Ok((force, depth))
    }

    /// A run with the values x.
    fn paths_with(&mut self, x: &[f64]) -> Result<Option<Vec<ForcePath>>, CalibrateError> {
        let values = self.sought.iter().zip(x).filter(|(s, _)| matches!(s, Sought::Key(_) | Sought::Contact));
        let values: Vec<String> = values.map(|(s, v)| format!("{} = {v:.6}", s.name())).collect();
        (self.tell)(&format!("run {}: {}", self.runs + 1, values.join(", ")));
        let Ok(scene) = self.task.scene.with(&self.changes(x)) else { return Ok(None) };
        let run = match self.run(&scene, self.value(x, &Sought::Contact)) {
            Err(CalibrateError::Build { .. }) => return Ok(None),
            other => other?,
        };
        let answered = run.answers.len() as f64 >= ANSWERED * self.task.readings.len() as f64;
        Ok(paths_of(&run, &self.directions).filter(|_| run.diverged.is_none() && answered))
    }

    /// Derivative of the fitted rows' force by one key, from a second run; the other way where the first can't be.
    fn difference(&mut self, x: &[f64], k: usize, force: &[f64]) -> Result<Option<Vec<f64>>, CalibrateError> {
        let share = if self.sought[k].is_of_regions() { DIFFERENCE_OF_REGIONS } else { DIFFERENCE };
        let size = if x[k] == 0.0 { share } else { share * x[k].abs() };
        for change in [size, -size] {
            let mut beside = x.to_vec();
            beside[k] += change;
            if let Some(paths) = self.paths_with(&beside)? {
                let clock = self.value(x, &Sought::Clock);
                let times = || self.fitted.iter().map(|&i| self.forces.time_s[i] - clock);
                let other = paths.iter().flat_map(|path| times().map(|t| path.force_n(t, 0.0)));
                return Ok(Some(other.zip(force).map(|(a, b)| (a - b) / change).collect()));
            }
        }
        Ok(None)
    }

    /// Derivative of the fitted rows' force by one unknown that needs no run.
    fn derivative(&self, x: &[f64], k: usize, force: &[f64]) -> Option<Vec<f64>> {
        let (kept, (factor, shift)) = (self.kept.as_ref()?, self.relative_to_kept(x)?);
        let clock = self.value(x, &Sought::Clock);
        let times = || self.fitted.iter().map(|&i| self.forces.time_s[i]);
        let each = |of: &dyn Fn(&ForcePath, f64) -> f64| -> Vec<f64> {
            kept.paths.iter().flat_map(|path| times().map(|t| of(path, t))).collect()
        };
        Some(match &self.sought[k] {
            Sought::Key(key) if self.scales_the_force(key) => force.iter().map(|f| f / x[k]).collect(),
            Sought::Key(_) => return None,
            Sought::Contact => each(&|path, t| -factor * path.stiffness(t - clock, shift)),
            Sought::Clock => each(&|path, t| -factor * path.rate(t - clock, shift)),
            // across the axis its zero is taken off beforehand
            added => times().map(|t| added.added(t)).chain(vec![0.0; force.len() - self.fitted.len()]).collect(),
        })
    }
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
        let Some(force) = self.all_predicted(x)? else { return Ok(None) };
        let along = |i: usize| force[0][i] + self.added(x, self.forces.time_s[i]) - self.forces.measured_n[i];
        let across = force[1..].iter().zip(&self.across_n);
        let across = across.flat_map(|(f, m)| self.fitted.iter().map(|&i| f[i] - m[i]));
        Ok(Some(DVector::from_vec(self.fitted.iter().map(|&i| along(i)).chain(across).collect())))
    }

    fn jacobian(&mut self, x: &[f64], r: &DVector<f64>) -> Result<Option<DMatrix<f64>>, CalibrateError> {
        if self.predicted(x)?.is_none() {
            return Ok(None);
        }
        let force: Vec<f64> = self.all_measured(x).iter().zip(r).map(|(m, r)| r + m).collect();
        let whole = force.iter().map(|f| f * f).sum::<f64>().sqrt();
        let mut jacobian = DMatrix::zeros(force.len(), x.len());
        for k in 0..x.len() {
            let column = match self.derivative(x, k, &force) {
                Some(column) => column,
                None => match self.difference(x, k, &force)? {
                    Some(column) => column,
                    None => return Ok(None),
                },
            };
            let column = DVector::from_vec(column);
            let doubled = column.norm() * if x[k] == 0.0 { 1.0 } else { x[k].abs() };
            if !matches!(self.sought[k], Sought::Key(_)) || doubled > NO_EFFECT * whole {
                jacobian.set_column(k, &column);
            }
        }
        Ok(Some(jacobian))
    }
}
