//! Force curves of one elastic scene over its material constants. They are tabulated once and used for every
//! recording.
//!
//! If an elastic sample is indented slowly, the force depends on the depth alone, and is proportional to the moduli:
//!
//! ```text
//! F(d; mu_0, p) = mu_0 g(d; p)        p: exponents, friction, pressures over mu_0 (the small-strain shear modulus)
//! ```
//!
//! The twin computes g at the Chebyshev points of every p. Between them g is interpolated by Lagrange's polynomial in
//! its barycentric form (Berrut and Trefethen, SIAM Review 46, 2004). For a smooth g its error falls exponentially
//! with the number of points: it is below 0.2 % of the peak for an exponent. In the friction the runs themselves are
//! not smooth: a node at the rim either slips or sticks. That error is up to 1 % of the peak with any number of
//! points (docs/lab/phantoms.md). A calibration with a table needs no run.

use std::f64::consts::PI;

use rayon::prelude::*;

use super::paths;
use super::{CalibrateError, Wanted};
use crate::compare::{Answer, Cancel, Run};
use needle_core::scene::{ContactLaw, InstrumentKind, Override, Scene};
use needle_core::twin::Phase;
use needle_recording::{At, ForceSeries, Reading};

/// Points along each axis.
const POINTS: usize = 9;
/// Number of depths in a curve, and the speed of the indentation, m/s; the speed has no effect on an elastic sample.
const PLACES: usize = 200;
const SPEED_M_PER_S: f64 = 1e-3;
/// Depth range of a curve over that of the recording: the contact may be found above its first reading.
const DEEPER: f64 = 1.15;
/// Reversal of the motion, as a share of the largest depth, that is attributed to noise of the displacement sensor.
const WAY_BACK: f64 = 0.01;
/// Ranges of pressures over the small-strain modulus mu_0 in which a curve is tabulated. C01 <= mu_0 / 2 because
/// C10 > 0. The scene rejects a negative C20 of Yeoh's law if C30 is 0.
const RATIOS: [(&str, [f64; 2]); 3] =
    [("material.c01_pa", [0.0, 0.499]), ("material.c20_pa", [0.0, 0.5]), ("material.c30_pa", [0.0, 0.5])];
/// Keys that the force is proportional to. The first one that is sought gets the remainder of mu_0.
const MODULI: [&str; 3] = ["material.shear_modulus_pa", "material.ogden_shear_moduli_pa", "material.c10_pa"];

/// A key that curves are tabulated over.
#[derive(Clone, Debug, PartialEq)]
struct Axis {
    key: String,
    /// Whether the coordinate is the key divided by mu_0.
    pressure: bool,
    range: [f64; 2],
}

impl Axis {
    fn point(&self, k: usize) -> f64 {
        let [low, high] = self.range;
        0.5 * (low + high) - 0.5 * (high - low) * (PI * k as f64 / (POINTS - 1) as f64).cos()
    }

    /// Lagrange's basis at x; `None` outside the range.
    fn basis(&self, x: f64) -> Option<[f64; POINTS]> {
        let [low, high] = self.range;
        let near = 1e-9 * (high - low);
        if !(low - near..=high + near).contains(&x) {
            return None;
        }
        let mut basis = [0.0; POINTS];
        for (k, one) in basis.iter_mut().enumerate() {
            let apart = x - self.point(k);
            if apart.abs() <= near {
                basis = [0.0; POINTS];
                basis[k] = 1.0;
                return Some(basis);
            }
            let end = if k == 0 || k == POINTS - 1 { 0.5 } else { 1.0 };
            *one = if k % 2 == 0 { end } else { -end } / apart;
        }
        let sum: f64 = basis.iter().sum();
        Some(basis.map(|b| b / sum))
    }
}

/// See the module.
#[derive(Clone, Debug, PartialEq)]
pub struct CurveTable {
    scene: Scene,
    axes: Vec<Axis>,
    deepest_m: f64,
    /// g at equally spaced depths from 0 to the deepest, m2, for each combination of points; the last axis varies
    /// fastest.
    curves: Vec<Vec<f64>>,
}

fn refused(key: &str, reason: &str) -> CalibrateError {
    CalibrateError::Key { key: key.to_owned(), reason: format!("curves = \"table\": {reason}") }
}

impl CurveTable {
    /// A table with its curves, for recordings down to a depth in m.
    #[cfg(test)]
    pub(crate) fn new(
        scene: &Scene,
        wanted: &[Wanted],
        to_depth_m: f64,
        cancel: &Cancel,
    ) -> Result<Self, CalibrateError> {
        let mut table = Self::planned(scene, wanted, to_depth_m)?;
        table.run_all(cancel, &|| {})?;
        Ok(table)
    }

    /// A table whose curves have not been computed yet.
    ///
    /// # Errors
    /// [`CalibrateError`] if the force of the scene is not a function of the depth and these keys.
    pub(crate) fn planned(scene: &Scene, wanted: &[Wanted], to_depth_m: f64) -> Result<Self, CalibrateError> {
        check(scene)?;
        let keys = wanted.iter().filter(|w| !w.key.starts_with("align.") && !MODULI.contains(&w.key.as_str()));
        let axes = keys.map(axis).collect::<Result<Vec<_>, _>>()?;
        if !wanted.iter().any(|w| MODULI.contains(&w.key.as_str())) {
            return Err(refused(MODULI[0], "the modulus has to be among the keys that are sought"));
        }
        Ok(Self { scene: scene.clone(), axes, deepest_m: DEEPER * to_depth_m, curves: Vec::new() })
    }

    /// Number of runs of the twin that the table needs.
    #[must_use]
    pub(crate) fn runs(&self) -> usize {
        POINTS.pow(self.axes.len() as u32)
    }

    /// Computes the curves. `done` is called after each.
    ///
    /// # Errors
    /// [`CalibrateError`] if a run fails.
    pub(crate) fn run_all(&mut self, cancel: &Cancel, done: &(dyn Fn() + Sync)) -> Result<(), CalibrateError> {
        let one = |n: usize| self.curve(n, cancel).inspect(|_| done());
        self.curves = (0..self.runs()).into_par_iter().map(one).collect::<Result<_, CalibrateError>>()?;
        Ok(())
    }

    /// The curves, for storage.
    #[must_use]
    pub(crate) fn curves(&self) -> &[Vec<f64>] {
        &self.curves
    }

    /// Takes stored curves; returns false if their number is wrong.
    pub(crate) fn take(&mut self, curves: Vec<Vec<f64>>) -> bool {
        let fits = curves.len() == self.runs() && curves.iter().all(|curve| (2..=PLACES).contains(&curve.len()));
        if fits {
            self.curves = curves;
        }
        fits
    }

    /// Scenes at every second point of every axis: possible starts of a search.
    pub(super) fn coarse(&self) -> impl Iterator<Item = Scene> {
        let axes = self.axes.len() as u32;
        let even = move |n: &usize| (0..axes).all(|a| (n / POINTS.pow(a) % POINTS).is_multiple_of(2));
        (0..self.curves.len()).filter(even).filter_map(|n| self.scene_at(&self.coordinates(n)).ok())
    }

    /// Coordinates of a curve.
    fn coordinates(&self, number: usize) -> Vec<f64> {
        let axes = self.axes.len() as u32;
        (0..axes).map(|a| self.axes[a as usize].point(number / POINTS.pow(axes - 1 - a) % POINTS)).collect()
    }

    /// The scene with these coordinates and its own small-strain modulus.
    fn scene_at(&self, coordinates: &[f64]) -> Result<Scene, CalibrateError> {
        let modulus = self.scene.material.shear_modulus();
        let mut changes: Vec<Override> = Vec::new();
        for (axis, x) in self.axes.iter().zip(coordinates) {
            let value = if axis.pressure { x * modulus } else { *x };
            changes.push(Override::typed(&axis.key, value, "--fit"));
            let tied = self.scene.tied_to(&axis.key).map(|key| Override::typed(key, value, "--fit"));
            changes.extend(tied);
        }
        // mu_0 = 2 (C10 + C01)
        let c01 = self.axes.iter().zip(coordinates).find(|(axis, _)| axis.key == "material.c01_pa");
        if let (Some((_, x)), Some(_)) = (c01, self.scene.get("material.c10_pa")) {
            changes.push(Override::typed("material.c10_pa", (0.5 - x) * modulus, "--fit"));
        }
        Ok(self.scene.with(&changes)?)
    }

    fn curve(&self, number: usize, cancel: &Cancel) -> Result<Vec<f64>, CalibrateError> {
        let scene = self.scene_at(&self.coordinates(number))?;
        let reading = |i: usize| {
            let depth_m = self.deepest_m * i as f64 / (PLACES - 1) as f64;
            Reading { time_s: depth_m / SPEED_M_PER_S, at: At::Depth(depth_m) }
        };
        let readings: Vec<Reading> = (0..PLACES).map(reading).collect();
        let none = ForceSeries::new(Vec::new());
        let run = paths::run(&scene, None, &readings, &none, &mut cancel.clone())?;
        if let Some(reason) = run.diverged {
            return Err(CalibrateError::Diverged(reason));
        }
        let modulus = scene.material.shear_modulus();
        // poses that the twin refuses lie beyond the depth that the scene allows
        let mut curve: Vec<f64> = run.answers.iter().map(|a| a.predicted_n / modulus).collect();
        curve[0] = 0.0;
        Ok(curve)
    }

    /// The curve of a scene that differs in the tabulated keys and its moduli, N; `None` outside the table.
    fn of(&self, scene: &Scene) -> Option<Vec<f64>> {
        let modulus = scene.material.shear_modulus();
        let number = |key: &str| scene.get(key).and_then(|v| v.as_list()).and_then(|list| list.first().copied());
        let coordinate = |axis: &Axis| {
            let x = number(&axis.key)?;
            axis.basis(if axis.pressure { x / modulus } else { x })
        };
        let bases = self.axes.iter().map(coordinate).collect::<Option<Vec<_>>>()?;
        let least = self.curves.iter().map(Vec::len).min()?;
        let mut sum = vec![0.0; least];
        for (n, curve) in self.curves.iter().enumerate() {
            let axes = bases.len() as u32;
            let weight: f64 = (0..axes).map(|a| bases[a as usize][n / POINTS.pow(axes - 1 - a) % POINTS]).product();
            if weight != 0.0 {
                sum.iter_mut().zip(curve).for_each(|(s, g)| *s += weight * modulus * g);
            }
        }
        Some(sum)
    }

    /// The equivalent of a run of the twin over the readings. Poses deeper than the table are refused.
    pub(super) fn run(&self, scene: &Scene, readings: &[Reading], measured: &ForceSeries) -> Option<Run> {
        let curve = self.of(scene)?;
        let begin_s = readings.first().map_or(0.0, |r| r.time_s);
        let step_m = self.deepest_m / (PLACES - 1) as f64;
        let answer = |reading: &Reading| {
            let At::Depth(depth_m) = reading.at else { return None };
            let place = depth_m.max(0.0) / step_m;
            let after = (place as usize + 1).min(curve.len() - 1);
            let share = place - (after - 1) as f64;
            let predicted_n = curve[after - 1] + share * (curve[after] - curve[after - 1]);
            let vector = measured.at(reading.time_s);
            (share <= 1.0).then_some(Answer {
                time_s: reading.time_s - begin_s,
                depth_m,
                predicted_n,
                measured_n: vector.map(|f| f[2]),
                predicted_vector_n: [0.0, 0.0, predicted_n],
                measured_vector_n: vector,
                model_error_n: f64::NAN,
                phase: if depth_m > 0.0 { Phase::Indentation } else { Phase::Approach },
                event: None,
                steps: 0,
                latency_s: 0.0,
            })
        };
        let answers = readings.iter().filter_map(answer).collect();
        Some(Run { scene: scene.name.clone(), answers, one_clock: measured.one_clock(), ..Run::default() })
    }

    /// Whether the table is valid for a motion.
    ///
    /// # Errors
    /// Why it is not, and what to do.
    pub(crate) fn covers(&self, readings: &[Reading]) -> Result<(), String> {
        let depth = |r: &Reading| if let At::Depth(depth_m) = r.at { Some(depth_m) } else { None };
        let Some(depths) = readings.iter().map(depth).collect::<Option<Vec<f64>>>() else {
            return Err("curves = \"table\" takes depths, and this recording has poses".to_owned());
        };
        let mut deepest = f64::NEG_INFINITY; // a recording begins above the sample
        let mut back: f64 = 0.0;
        for depth in depths {
            deepest = deepest.max(depth);
            back = back.max(deepest - depth);
        }
        if back > WAY_BACK * deepest {
            return Err(format!(
                "curves = \"table\" holds the way in, and this recording goes back by {:.3} mm: end it with to_depth_m",
                1e3 * back
            ));
        }
        Ok(())
    }
}

fn axis(wanted: &Wanted) -> Result<Axis, CalibrateError> {
    let ratio = RATIOS.iter().find(|(key, _)| *key == wanted.key).map(|(_, range)| *range);
    let range = ratio.or(wanted.bounds).ok_or_else(|| {
        refused(&wanted.key, "give the bounds between which it is tabulated, as in material.ogden_exponents=1..12")
    })?;
    Ok(Axis { key: wanted.key.clone(), pressure: ratio.is_some(), range })
}

/// Accepts only scenes whose force is a function of the depth: elastic, of one material, indented and not punctured.
fn check(scene: &Scene) -> Result<(), CalibrateError> {
    let pressed = scene.instrument.is_some_and(|i| {
        matches!(i.kind, InstrumentKind::Plate | InstrumentKind::Indenter { .. })
            && matches!(i.contact, ContactLaw::Bonded | ContactLaw::Frictionless | ContactLaw::Coulomb { .. })
    });
    if !pressed {
        return Err(refused(
            "instrument.kind",
            "the force of a needle is no function of the depth alone; leave it out",
        ));
    }
    if !scene.material.prony.shares().is_empty() {
        return Err(refused(
            "material.prony_shares",
            "the force of a material that relaxes depends on the time; leave it out",
        ));
    }
    if !scene.regions.is_empty() {
        return Err(refused(
            "regions",
            "the force of several materials is not proportional to one modulus; leave it out",
        ));
    }
    Ok(())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    const BLOCK: &str = "name = \"block\"\n[sample]\nshape = \"cylinder\"\ndiameter_m = 0.05\nheight_m = 0.03\n\
        [material]\nmodel = \"ogden\"\nogden_shear_moduli_pa = [1e4]\nogden_exponents = [3]\npoisson_ratio = 0.49\n\
        density_kg_per_m3 = 1000\n[instrument]\nkind = \"plate\"\ncontact = \"coulomb\"\nfriction_coefficient = 0.2\n\
        [discretisation]\nmethod = \"mmls\"\nspacing_m = 0.0075\nedge_refinement = 0.3\ngrowth = 0.35\n";

    fn wanted(text: &str) -> Wanted {
        Wanted::parse(text).unwrap()
    }

    #[test]
    fn between_its_points_the_table_is_what_a_run_gives() {
        let scene = Scene::from_toml(BLOCK, "block").unwrap();
        let modulus = wanted("material.ogden_shear_moduli_pa");
        // where a plate changes from slip to stick the curve is not smooth in the friction, and the polynomial
        // converges slowly
        let exponents = ("material.ogden_exponents=0.5..12", 4.7, 2e-3);
        let friction = ("instrument.friction_coefficient=0.0..0.6", 0.13, 1e-2);
        for (key, x, bound) in [exponents, friction] {
            let key = wanted(key);
            let table = CurveTable::new(&scene, &[modulus.clone(), key.clone()], 9e-3, &Cancel::default()).unwrap();
            assert_eq!(table.runs(), POINTS);
            let at = [Override::typed(&key.key, x, "test"), Override::typed(&modulus.key, 2.5e3, "test")];
            let scene = scene.with(&at).unwrap();
            let readings: Vec<Reading> =
                (0..180).map(|i| Reading { time_s: f64::from(i) * 0.05, at: At::Depth(f64::from(i) * 5e-5) }).collect();
            let none = ForceSeries::new(Vec::new());
            let run = paths::run(&scene, None, &readings, &none, &mut Cancel::default()).unwrap();
            let read = table.run(&scene, &readings, &none).unwrap();
            assert_eq!(run.answers.len(), read.answers.len());
            let peak = run.answers.last().unwrap().predicted_n;
            for (a, b) in run.answers.iter().zip(&read.answers) {
                let error = (a.predicted_n - b.predicted_n).abs() / peak;
                assert!(error < bound, "{key:?} at {} m: {} {}", a.depth_m, a.predicted_n, b.predicted_n);
            }
            let beyond = scene.with(&[Override::typed(&key.key, 20.0, "test")]).unwrap();
            assert!(table.run(&beyond, &readings, &none).is_none(), "nothing is made up outside");
        }
    }

    #[test]
    fn what_is_no_function_of_the_depth_is_refused() {
        let scene = Scene::from_toml(BLOCK, "block").unwrap();
        let relaxing = Override::parse("material.prony_shares=[0.3]", "test").unwrap();
        let times = Override::parse("material.prony_times_s=[1.0]", "test").unwrap();
        let modulus = [wanted("material.ogden_shear_moduli_pa")];
        let error =
            CurveTable::new(&scene.with(&[relaxing, times]).unwrap(), &modulus, 9e-3, &Cancel::default()).unwrap_err();
        assert!(error.to_string().contains("relaxes"), "{error}");
        let unbounded = [modulus[0].clone(), wanted("material.ogden_exponents")];
        let error = CurveTable::new(&scene, &unbounded, 9e-3, &Cancel::default()).unwrap_err();
        assert!(error.to_string().contains("bounds"), "{error}");
        let table = CurveTable { scene, axes: Vec::new(), deepest_m: 9e-3, curves: vec![vec![0.0; PLACES]] };
        let back = [0.0, 5e-3, 4e-3].map(|d| Reading { time_s: 0.0, at: At::Depth(d) });
        assert!(table.covers(&back).unwrap_err().contains("1.000 mm"));
    }
}
