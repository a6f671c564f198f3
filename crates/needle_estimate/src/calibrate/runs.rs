//! Runs of the twin with trial values, and derivatives by finite differences of two runs.
//!
//! The derivative by a layer's depth or modulus must exceed the difference that discretisation makes between two
//! runs. So if such a key is sought, all runs use one cloud whose nodes move with the interfaces
//! ([`Twin::on_cloud_of`]). If the search converges far from the values that the cloud was made for, a new cloud is
//! made there and the search continues. All runs also take the same steps. The twin normally chooses the number of
//! steps of a pose as it goes, a whole number. At a tolerance of 0.01 that alone changes the force by up to 1 %
//! between two runs (docs/lab/layers.md).

use super::CalibrateError;
use super::paths::{answered, paths_of, run};
use super::problem::{Kept, Recorded};
use super::unknown::Sought;
use crate::compare::Run;
use needle_core::scene::Scene;
use needle_core::twin::Twin;
use needle_recording::{At, Reading};

/// Relative change of a key for its finite difference. It is far above the rounding of single precision. The
/// curvature within it is small compared with the steps of the search.
const DIFFERENCE: f64 = 0.01;
/// The same for a region's depth or modulus.
const DIFFERENCE_OF_REGIONS: f64 = 0.05;
/// The same if each value has a cloud of its own: the forces on two clouds differ by up to a per cent.
const DIFFERENCE_OF_CLOUDS: f64 = 0.1;
/// The same of a share or a time of relaxation: where a hold is short the two do almost the same, and only the difference between their effects
/// tells them apart.
const DIFFERENCE_OF_RELAXATION: f64 = 0.05;
/// Least number of steps of a pose if a key of a region is sought, over the mean number in contact in the first run.
const STEADY: f64 = 2.0;
/// Ratio of a layer's thickness to that of the cloud from which on a new cloud is made.
const REMADE: f64 = 1.1;

impl Recorded<'_> {
    /// The first key for whose values unrelated clouds are made.
    pub(crate) fn of_many_clouds(&self) -> Option<&str> {
        let shapes = self.sought.iter().map(Sought::name).find(|name| name.starts_with("regions."));
        shapes.filter(|_| self.common.made_for.is_none())
    }

    /// Whether further runs take other steps than the first. If so, they do from then on.
    pub(crate) fn makes_steady(&mut self, first: &Run) -> bool {
        let touching = first.answers.iter().filter(|a| a.predicted_n != 0.0 && a.steps > 0);
        let (steps, poses) = touching.fold((0.0, 0.0), |(s, n), a| (s + f64::from(a.steps), n + 1.0));
        if self.common.of_regions && self.task.table.is_none() && poses > 0.0 {
            self.common.steps = Some((STEADY * steps / poses).ceil() as u32);
        }
        self.common.steps.is_some()
    }

    /// Whether the layers for the values x are so far from those of the cloud that a new one is needed. If so, it is
    /// used from then on.
    pub(crate) fn makes_anew(&mut self, x: &[f64]) -> Result<bool, CalibrateError> {
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

    /// Runs the twin with the values x.
    pub(super) fn run_with(&mut self, x: &[f64]) -> Result<Option<Kept>, CalibrateError> {
        let values = self.sought.iter().zip(x).filter(|(s, _)| matches!(s, Sought::Key(_) | Sought::Contact));
        let values: Vec<String> = values.map(|(s, v)| format!("{} = {v:.6}", s.name())).collect();
        (self.tell)(&format!("run {}: {}", self.runs + 1, values.join(", ")));
        let Ok(scene) = self.task.scene.with(&self.changes(x)) else { return Ok(None) };
        let run = match self.run(&scene, self.value(x, &Sought::Contact)) {
            Err(CalibrateError::Build { .. } | CalibrateError::OutsideTable) => return Ok(None),
            other => other?,
        };
        let paths =
            paths_of(&run, &self.across).filter(|_| run.diverged.is_none() && answered(&run, self.task.readings));
        Ok(paths.map(|paths| Kept { x: x.to_vec(), paths, regions: run.regions_over_depth() }))
    }

    /// Derivative of the fitted rows' force by one key, from a second run. If the scene is invalid on one side, the
    /// difference is taken on the other.
    pub(super) fn difference(
        &mut self,
        x: &[f64],
        k: usize,
        force: &[f64],
    ) -> Result<Option<Vec<f64>>, CalibrateError> {
        let share = match self.sought[k].is_of_regions() {
            true if self.common.made_for.is_some() => DIFFERENCE_OF_REGIONS,
            true => DIFFERENCE_OF_CLOUDS,
            false if self.sought[k].is_of_relaxation() => DIFFERENCE_OF_RELAXATION,
            false => DIFFERENCE,
        };
        // a pressure that is small relative to the others is changed by as much as they are
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
