//! Start values of the search. A start close to the solution saves runs.

use super::CalibrateError;
use super::HoldOut;
use super::paths::{answered, paths_of};
use super::problem::{Kept, Recorded};
use super::unknown::Sought;
use crate::compare::{Run, least_squares::Unknown};
use crate::layers::{Known, of_recording};

/// A factor whose logarithm is below this leaves the start as it is.
const NEAR_SIZE: f64 = 0.2;
/// What resists a needle with friction, beside the modulus.
const RUBS: [&str; 3] = ["instrument.friction_n_per_m", "instrument.cutting_force_n", "instrument.puncture_force_n"];

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
        self.kept = x.zip(paths).filter(|_| answered(first, self.task)).map(|(x, paths)| Kept {
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

    /// Starts friction, cutting and puncture force of a needle in one material with what insertion and way out say of
    /// them without a run (`layers`). The search for them depends on its start.
    pub(crate) fn begin_at_layers(&self, unknowns: &mut [Unknown]) {
        let scene = self.task.scene;
        if self.task.part != HoldOut::Nothing || !scene.regions.is_empty() {
            return;
        }
        let sought = |key: &str| self.sought.iter().position(|s| matches!(s, Sought::Key(own) if own == key));
        let places = RUBS.map(sought);
        if places.iter().all(Option::is_none) {
            return;
        }
        let Ok(found) = of_recording(scene, self.task.readings, self.task.measured, 1) else { return };
        let (Some(layer), Some(end), None) = (found.layers.first(), found.parts.last(), found.beyond()) else { return };
        let value = |known: Option<Known>| known.map(|k| k.value);
        let cutting = value(layer.cutting_force_n).or(Some(end.at_the_tip_n()).filter(|n| *n > 0.0));
        let starts = [Some(layer.friction_n_per_m.value), cutting, value(layer.puncture_force_n)];
        for (place, start) in places.into_iter().zip(starts) {
            if let (Some(k), Some(start)) = (place, start) {
                let Unknown { bounds: [low, high], .. } = unknowns[k];
                unknowns[k].start = start.clamp(low, high);
            }
        }
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
