//! Runs of the twin with trial values, and derivatives by differences of two.
//!
//! Derivatives by a layer's depth or modulus have to stand out from what two runs differ by. So where such a key is sought, all runs are on
//! one cloud, whose nodes move with the interfaces ([`Twin::on_cloud_of`]); once the search has come to rest far from where that was
//! made, another is made there and the search goes on. And they take the same steps: how many a pose is worth is a whole number that the
//! twin finds as it goes, and by which two runs at a tolerance of 0.01 differ by up to 1 % of the force (docs/lab/layers.md).

use super::CalibrateError;
use super::paths::{answered, paths_of, run};
use super::problem::{Kept, Recorded};
use super::unknown::Sought;
use crate::compare::Run;
use needle_core::scene::{Region, Scene};
use needle_core::twin::Twin;
use needle_recording::{At, Reading};

/// Change of a key for its derivative, as a share of it: far above the rounding of single precision, and what bends within it
/// is small against the steps of the search.
const DIFFERENCE: f64 = 0.01;
/// The same of a region's depth or modulus.
const DIFFERENCE_OF_REGIONS: f64 = 0.05;
/// The same where each value has a cloud of its own: two of them differ by up to a per cent of the force.
const DIFFERENCE_OF_CLOUDS: f64 = 0.1;
/// Least number of steps of a pose over the mean of those that the first run took in contact, where a key of a region is sought.
const STEADY: f64 = 2.0;
/// A layer this many times as thick or thin as the cloud was made for gets another.
const REMADE: f64 = 1.1;

/// What all runs have in common where a key of a region or its material is sought.
pub(super) struct Common {
    of_regions: bool,
    /// Regions for which the cloud was made; `None`: each run has its own.
    made_for: Option<Vec<Region>>,
    /// Least number of steps of a pose in motion; `None`: as many as it is worth.
    steps: Option<u32>,
}

impl Common {
    pub fn new(scene: &Scene, sought: &[Sought]) -> Self {
        let of_regions = sought.iter().any(Sought::is_of_regions);
        let moves = of_regions && Twin::stretch_from(scene, &scene.regions).is_some();
        Self { of_regions, made_for: moves.then(|| scene.regions.clone()), steps: None }
    }

    /// The scene as it is run: more steps are for the first poses alone, where contact begins with an impulse.
    pub fn posed(&self, scene: &Scene) -> Scene {
        let mut scene = scene.clone();
        let stepping = &mut scene.stepping;
        let steps = self.steps.unwrap_or(0).min(stepping.max_steps_per_pose);
        stepping.min_steps_per_pose = stepping.min_steps_per_pose.max(steps);
        scene
    }
}

impl Recorded<'_> {
    /// The first key for whose values clouds are made that have nothing to do with each other.
    pub fn of_many_clouds(&self) -> Option<&str> {
        let shapes = self.sought.iter().map(Sought::name).find(|name| name.starts_with("regions."));
        shapes.filter(|_| self.common.made_for.is_none())
    }

    /// Whether further runs are to take other steps than the first, as they do from then on.
    pub fn makes_steady(&mut self, first: &Run) -> bool {
        let touching = first.answers.iter().filter(|a| a.predicted_n != 0.0 && a.steps > 0);
        let (steps, poses) = touching.fold((0.0, 0.0), |(s, n), a| (s + f64::from(a.steps), n + 1.0));
        if self.common.of_regions && self.task.table.is_none() && poses > 0.0 {
            self.common.steps = Some((STEADY * steps / poses).ceil() as u32);
        }
        self.common.steps.is_some()
    }

    /// Whether layers with the values x are so far from those that the cloud was made for that another is: from then on it is.
    pub fn makes_anew(&mut self, x: &[f64]) -> Result<bool, CalibrateError> {
        let scene = self.task.scene.with(&self.changes(x))?;
        let Some(made_for) = &mut self.common.made_for else { return Ok(false) };
        let far = Twin::stretch_from(&scene, made_for).is_none_or(|most| most > REMADE);
        if far {
            *made_for = scene.regions;
            self.kept = None;
        }
        Ok(far)
    }

    pub(super) fn run(&mut self, scene: &Scene, contact_m: f64) -> Result<Run, CalibrateError> {
        let shifted = |r: &Reading| match r.at {
            At::Depth(depth) => Reading { at: At::Depth(depth - contact_m), ..*r },
            At::Pose(mut pose) => {
                (0..3).for_each(|k| pose.tip[k] -= contact_m * pose.axis[k]);
                Reading { at: At::Pose(pose), ..*r }
            }
        };
        let readings: Vec<Reading> = self.task.readings.iter().map(shifted).collect();
        let tabulated = self.task.table.map(|table| table.run(scene, &readings, self.task.measured));
        let run = match tabulated {
            Some(run) => run.ok_or(CalibrateError::OutsideTable)?,
            None => {
                self.runs += 1;
                let regions = self.common.made_for.as_deref();
                run(&self.common.posed(scene), regions, &readings, self.task.measured, self.watch)?
            }
        };
        self.refused = readings.len() - run.answers.len();
        Ok(run)
    }

    /// A run with the values x.
    pub(super) fn run_with(&mut self, x: &[f64]) -> Result<Option<Kept>, CalibrateError> {
        let values = self.sought.iter().zip(x).filter(|(s, _)| matches!(s, Sought::Key(_) | Sought::Contact));
        let values: Vec<String> = values.map(|(s, v)| format!("{} = {v:.6}", s.name())).collect();
        (self.tell)(&format!("run {}: {}", self.runs + 1, values.join(", ")));
        let Ok(scene) = self.task.scene.with(&self.changes(x)) else { return Ok(None) };
        let run = match self.run(&scene, self.value(x, &Sought::Contact)) {
            Err(CalibrateError::Build { .. } | CalibrateError::OutsideTable) => return Ok(None),
            other => other?,
        };
        let paths = paths_of(&run, &self.across).filter(|_| run.diverged.is_none() && answered(&run, self.task));
        Ok(paths.map(|paths| Kept { x: x.to_vec(), paths, regions: run.regions_over_depth() }))
    }

    /// Derivative of the fitted rows' force by one key, from a second run; the other way where the first can't be.
    pub(super) fn difference(
        &mut self,
        x: &[f64],
        k: usize,
        force: &[f64],
    ) -> Result<Option<Vec<f64>>, CalibrateError> {
        let share = match self.sought[k].is_of_regions() {
            true if self.common.made_for.is_some() => DIFFERENCE_OF_REGIONS,
            true => DIFFERENCE_OF_CLOUDS,
            false => DIFFERENCE,
        };
        // a pressure that is small against the others is changed as they are
        let alike = self.pressures.iter().filter(|_| self.pressures.contains(&k)).map(|&p| x[p].abs());
        let size = share * Some(alike.fold(x[k].abs(), f64::max)).filter(|size| *size > 0.0).unwrap_or(1.0);
        for change in [size, -size] {
            let mut beside = x.to_vec();
            beside[k] += change;
            if let Some(kept) = self.run_with(&beside)? {
                let clock = self.value(x, &Sought::Clock);
                let times = || self.fitted.iter().map(|&i| self.forces.time_s[i] - clock);
                let other = self.one_column(kept.paths.iter().map(|p| times().map(|t| p.force_n(t, 0.0)).collect()));
                return Ok(Some(other.iter().zip(force).map(|(a, b)| (a - b) / change).collect()));
            }
        }
        Ok(None)
    }
}
