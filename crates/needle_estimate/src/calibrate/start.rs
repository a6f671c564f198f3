//! Start values of the search. A start close to the solution saves runs.

use super::paths::{answered, paths_of};
use super::problem::{Kept, Recorded};
use super::unknown::Sought;
use super::{CalibrateError, HoldOut, Task};
use crate::compare::{Run, least_squares::Unknown};
use crate::layers::{Known, of_recording};
use needle_core::scene::{Override, Scene};

/// A factor whose logarithm is below this leaves the start as it is.
const NEAR_SIZE: f64 = 0.2;
/// What resists a needle with friction, beside the modulus.
const RUBS: [&str; 3] = ["instrument.friction_n_per_m", "instrument.cutting_force_n", "instrument.puncture_force_n"];

/// The scene with what insertion and way out say of friction, cutting and puncture force without a run (`layers`), of those
/// that are sought: the search for them depends on its start, and with some starts the twin is lost. `None` if they say nothing.
pub(super) fn begun(task: &Task) -> Option<Scene> {
    let sought = |key: &str| task.wanted.iter().find(|w| w.key == key);
    if task.part != HoldOut::Nothing || !task.scene.regions.is_empty() || RUBS.iter().all(|key| sought(key).is_none()) {
        return None;
    }
    let found = of_recording(task.scene, task.readings, task.measured, 1).ok()?;
    let (layer, end, None) = (found.layers.first()?, found.parts.last()?, found.beyond()) else { return None };
    let value = |known: Option<Known>| known.map(|k| k.value);
    let cutting = value(layer.cutting_force_n).or(Some(end.at_the_tip_n()).filter(|n| *n > 0.0));
    let told = [Some(layer.friction_n_per_m.value), cutting, value(layer.puncture_force_n)];
    let within = |(key, told): (&&str, Option<f64>)| {
        let [low, high] = sought(key)?.bounds.unwrap_or([0.0, f64::INFINITY]);
        Some(Override::typed(key, told?.clamp(low, high), "what the recording says"))
    };
    let changes: Vec<Override> = RUBS.iter().zip(told).filter_map(within).collect();
    task.scene.with(&changes).ok()
}

impl Recorded<'_> {
    /// Runs the scene with its own values over the recorded motion, with the contact shifted.
    pub(crate) fn first(&mut self, contact_m: f64) -> Result<Run, CalibrateError> {
        let run = self.run(self.task.scene, contact_m)?;
        match run.diverged {
            Some(reason) => Err(CalibrateError::Diverged(reason)),
            None => Ok(run),
        }
    }

    /// Adds a shift of the recording to the unknowns. The last run was made without one.
    pub(crate) fn seek(&mut self, shift: Sought) {
        self.sought.push(shift);
        if let Some(kept) = &mut self.kept {
            kept.x.push(0.0);
        }
    }

    /// Keeps the first run for reuse, if the search starts with the scene's own values and the contact of that run.
    pub(crate) fn keep(&mut self, first: &Run, contact_m: f64) {
        let at = |sought: &Sought| match sought {
            scale if scale.is_scale() => Some(1.0),
            Sought::Key(key) => self.task.scene.get(key)?.as_list()?.first().copied(),
            Sought::Contact => Some(contact_m),
            _ => Some(0.0),
        };
        let x: Option<Vec<f64>> = self.sought.iter().map(at).collect();
        let paths = paths_of(first, &self.across);
        self.kept = x.zip(paths).filter(|_| answered(first, self.task.readings)).map(|(x, paths)| Kept {
            x,
            paths,
            regions: first.regions_over_depth(),
        });
    }

    /// Starts the search at the point of the table with the smallest residual after scaling the pressures. Friction
    /// and exponents can have several local minima.
    pub(crate) fn begin_in_table(&mut self, unknowns: &mut [Unknown]) -> Result<(), CalibrateError> {
        let Some(table) = self.task.table else { return Ok(()) };
        let mut best: Option<(f64, Vec<f64>)> = None;
        for scene in table.coarse() {
            let at = |(k, sought): (usize, &Sought)| match sought {
                Sought::Key(key) => scene.get(key).and_then(|v| v.as_list()).and_then(|list| list.first().copied()),
                _ => Some(unknowns[k].start),
            };
            let Some(mut x) = self.sought.iter().enumerate().map(at).collect::<Option<Vec<f64>>>() else { continue };
            let Some(force) = self.predicted(&x)? else { continue };
            let (mut products, mut squares) = ([0.0; 2], 0.0);
            for &i in &self.fitted {
                let measured = self.forces.measured_n[i];
                products = [products[0] + force[i] * measured, products[1] + force[i] * force[i]];
                squares += measured * measured;
            }
            let left = squares - products[0] * products[0] / products[1];
            let size = products[0] / products[1];
            if size > 0.0 && best.as_ref().is_none_or(|(least, _)| left < *least) {
                self.pressures.iter().for_each(|&k| x[k] *= size);
                best = Some((left, x));
            }
        }
        for (unknown, x) in unknowns.iter_mut().zip(best.into_iter().flat_map(|(_, x)| x)) {
            unknown.start = x.clamp(unknown.bounds[0], unknown.bounds[1]);
        }
        Ok(())
    }

    /// Scales the start values of the pressures by the factor that the first run's force lacks. A factor near 1
    /// leaves them as they are.
    pub(crate) fn begin_at_size(&self, size: f64, unknowns: &mut [Unknown]) {
        if !size.is_finite() || size <= 0.0 || size.ln().abs() < NEAR_SIZE {
            return;
        }
        for &k in &self.pressures {
            let Unknown { start, bounds: [low, high], .. } = unknowns[k];
            unknowns[k].start = (start * size).clamp(low, high);
        }
    }
}
