//! A law for a recording, learnt from other recordings of the same scene.
//!
//! The first part of a recording says little of how its tissue stiffens further on; other samples of the kind do. The laws are
//!
//! ```text
//! Ogden               W = 2 mu / a^2 (l1^a + l2^a + l3^a - 3)                   shape: a, above 0 or below; 2 is neo-Hookean
//! Veronda-Westmann    W = mu / b (exp(b (I1 - 3)) - 1) - mu / 2 (I2 - 3)        shape: b
//! Yeoh                W = mu / 2 (x + c2 x^2 + c3 x^3),  x = I1 - 3             shape: c2, c3
//! ```
//!
//! each with Poisson's ratio. All are fitted to the whole of every other recording. The shear modulus mu differs from sample to sample; the shape is taken to be the
//! tissue's. A recording gets the law whose fits to the *others* have the least median error, with the mean of their shapes. Nothing of the
//! recording itself is used, so a forecast with it is blind. Then its modulus is fitted to its first part: forces are proportional to all
//! constants of a law in Pa together. What the scene says stays if a shape is worth little to the others.

use crate::calibrate::{CalibrateError, HoldOut, LoadCell, SCALE_KEY, Task, Wanted, calibrate};
use crate::compare::Watch;
use crate::compare::uncertainty::FORCE_ERROR;
use needle_core::scene::{MaterialModel, Override, Scene, SceneError};
use needle_recording::Recording;
use serde::{Deserialize, Serialize};

/// The key of the modulus in scenes whose law can be learnt.
const MODULUS: &str = "material.shear_modulus_pa";
/// Median error of a law over that of one with a shape parameter less, up to which it is taken.
const WORTH_A_SHAPE: f64 = 0.8;
/// Fewest other recordings that a law is learnt from.
pub const FEWEST: usize = 2;
/// Of more recordings so many, evenly spread, are fitted.
pub const MOST: usize = 24;

/// A constant of a law.
struct Constant {
    /// Its key; an element of a list has its index.
    key: &'static str,
    /// Where the search begins, over the shear modulus if it is in Pa.
    start: f64,
    bounds: Option<[f64; 2]>,
    pressure: bool,
}

struct Law {
    model: &'static str,
    constants: &'static [Constant],
}

const fn pressure(key: &'static str, start: f64) -> Constant {
    Constant { key, start, bounds: None, pressure: true }
}

const fn shape(key: &'static str, start: f64, bounds: [f64; 2]) -> Constant {
    Constant { key, start, bounds: Some(bounds), pressure: false }
}

const OGDEN_MODULUS: Constant = pressure("material.ogden_shear_moduli_pa[0]", 1.0);
const OGDEN_EXPONENT: &str = "material.ogden_exponents[0]";
const POISSON: Constant = shape("material.poisson_ratio", 0.495, [0.45, 0.4995]);
/// Those with fewer constants first.
const LAWS: [Law; 4] = [
    Law { model: "ogden", constants: &[OGDEN_MODULUS, shape(OGDEN_EXPONENT, 4.0, [1.0, 30.0]), POISSON] },
    Law { model: "ogden", constants: &[OGDEN_MODULUS, shape(OGDEN_EXPONENT, -4.0, [-30.0, -1.0]), POISSON] },
    Law {
        model: "veronda_westmann",
        constants: &[pressure(MODULUS, 1.0), shape("material.stiffening_exponent", 0.3, [0.01, 10.0]), POISSON],
    },
    Law {
        model: "yeoh",
        constants: &[
            pressure("material.c10_pa", 0.5),
            pressure("material.c20_pa", 0.01),
            pressure("material.c30_pa", 0.005),
            POISSON,
        ],
    },
];

/// A law's fit to a whole recording.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Shape {
    /// Root mean square error over the largest measured force.
    error: f64,
    /// The constants, those in Pa over the shear modulus.
    constants: Vec<f64>,
}

/// What a whole recording says of laws.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fits {
    /// Error of the scene's own law, as in [`Shape`].
    own: f64,
    /// Fits of [`LAWS`]; `None` where there is none.
    laws: Vec<Option<Shape>>,
}

/// A law that other recordings have taught.
#[derive(Clone, Debug, PartialEq)]
pub struct Learnt {
    law: usize,
    constants: Vec<f64>,
    /// Number of recordings it comes from.
    from: usize,
}

/// Whether a law can be learnt: the sample is of one material, neo-Hookean as in a scene that names no other, and its modulus is fitted.
#[must_use]
pub(crate) fn is_open(scene: &Scene, wanted: &[Wanted]) -> bool {
    let neo_hookean = matches!(scene.material.model, MaterialModel::NeoHookean { .. });
    let frictional = scene.instrument.is_some_and(|instrument| instrument.is_frictional());
    neo_hookean && scene.regions.is_empty() && !frictional && wanted.iter().any(|key| key.key == MODULUS)
}

/// Fits the scene's own law and the others to a whole recording.
///
/// # Errors
/// [`CalibrateError`] if the scene's own law has no fit, or the search was interrupted.
pub(crate) fn fits(
    recording: &Recording,
    scene: &Scene,
    wanted: &[Wanted],
    load_cell: LoadCell,
    by_pose: bool,
    watch: &mut dyn Watch,
) -> Result<Fits, CalibrateError> {
    let begun = recording.aligned(scene);
    let readings = begun.readings(by_pose);
    let measured = begun.measured();
    let mut found = |scene: &Scene, wanted: &[Wanted]| {
        let (force_error, part) = (FORCE_ERROR, HoldOut::Nothing);
        let task =
            Task { scene, readings: &readings, measured: &measured, wanted, load_cell, force_error, part, table: None };
        let calibration = calibrate(&task, watch, &mut |_| {})?;
        let peak = calibration.forces.measured_n.iter().map(|f| f.abs()).fold(0.0, f64::max);
        Ok::<_, CalibrateError>((calibration.rmse_n() / peak, calibration))
    };
    let (own, calibration) = found(scene, wanted)?;
    // from there the others begin
    let modulus = calibration.scene.material.shear_modulus();
    let mut laws = Vec::new();
    for law in &LAWS {
        let start: Vec<f64> = law.constants.iter().map(|constant| constant.start).collect();
        let others = wanted.iter().filter(|key| key.key != MODULUS).cloned();
        let own = law.constants.iter().map(|c| Wanted { key: c.key.to_owned(), bounds: c.bounds });
        let keys: Vec<Wanted> = own.chain(others).collect();
        let fit =
            law.scene(scene, modulus, &start).map_err(CalibrateError::from).and_then(|scene| found(&scene, &keys));
        laws.push(match fit {
            Ok((error, calibration)) if error.is_finite() => {
                let modulus = calibration.scene.material.shear_modulus();
                let value = |(c, e): (&Constant, &crate::calibrate::Estimate)| {
                    if c.pressure { e.value / modulus } else { e.value }
                };
                Some(Shape { error, constants: law.constants.iter().zip(&calibration.estimates).map(value).collect() })
            }
            Err(CalibrateError::Interrupted) => return Err(CalibrateError::Interrupted),
            _ => None,
        });
    }
    Ok(Fits { own, laws })
}

/// What the fits to other recordings teach; `None` if they are too few, or the scene's own law does as well.
#[must_use]
pub(crate) fn learnt(others: &[&Fits]) -> Option<Learnt> {
    if others.len() < FEWEST {
        return None;
    }
    let mut best: (f64, usize, Option<Learnt>) = (median(others.iter().map(|fit| fit.own).collect())?, 1, None);
    for (law, Law { constants, .. }) in LAWS.iter().enumerate() {
        let shapes: Vec<&Shape> = others.iter().filter_map(|fits| fits.laws.get(law)?.as_ref()).collect();
        if shapes.len() < FEWEST.max(others.len().div_ceil(2)) {
            continue;
        }
        let error = median(shapes.iter().map(|shape| shape.error).collect())?;
        let worth = if constants.len() > best.1 { WORTH_A_SHAPE } else { 1.0 };
        if error < worth * best.0 {
            // a mean of constants in Pa is the mean of the force curves
            let mean = |k: usize| shapes.iter().map(|shape| shape.constants[k]).sum::<f64>() / shapes.len() as f64;
            let constants = (0..constants.len()).map(mean).collect::<Vec<f64>>();
            best = (error, constants.len(), Some(Learnt { law, constants, from: shapes.len() }));
        }
    }
    best.2
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_unstable_by(f64::total_cmp);
    let middle = values.len() / 2;
    match values.len() {
        0 => None,
        n if n % 2 == 1 => Some(values[middle]),
        _ => Some(0.5 * (values[middle - 1] + values[middle])),
    }
}

impl Law {
    /// The scene with this law. `constants`: those in Pa over the modulus.
    fn scene(&self, scene: &Scene, modulus: f64, constants: &[f64]) -> Result<Scene, SceneError> {
        const FROM: &str = "learnt from other recordings";
        let set = |(c, value): (&Constant, &f64)| {
            let number = if c.pressure { value * modulus } else { *value };
            // a list with this as its only number
            let (key, text) =
                c.key.split_once('[').map_or((c.key, number.to_string()), |(list, _)| (list, format!("[{number}]")));
            Override::text(key, &text, FROM)
        };
        let model = Override::text("material.model", self.model, FROM);
        let changes: Vec<Override> =
            std::iter::once(model).chain(self.constants.iter().zip(constants).map(set)).collect();
        scene.with(&changes)
    }
}

impl Learnt {
    /// The scene with that law; the modulus is where the search for it begins.
    ///
    /// # Errors
    /// [`SceneError`] if the scene does not take it.
    pub(crate) fn scene(&self, scene: &Scene) -> Result<Scene, SceneError> {
        LAWS[self.law].scene(scene, scene.material.shear_modulus(), &self.constants)
    }

    /// The keys to fit: the factor on all constants in Pa in place of the modulus, over as many times it.
    #[must_use]
    pub(crate) fn wanted(&self, wanted: &[Wanted], scene: &Scene) -> Vec<Wanted> {
        let modulus = scene.material.shear_modulus();
        let renamed = |key: &Wanted| match key.key == MODULUS {
            true => {
                Wanted { key: SCALE_KEY.to_owned(), bounds: key.bounds.map(|bounds| bounds.map(|pa| pa / modulus)) }
            }
            false => key.clone(),
        };
        wanted.iter().map(renamed).collect()
    }

    /// Law, shape and where they come from, in words.
    #[must_use]
    pub(crate) fn words(&self) -> String {
        let Law { model, constants } = &LAWS[self.law];
        let one = |(c, value): (&Constant, &f64)| {
            let name = c.key.trim_start_matches("material.");
            if c.pressure { format!("{name} {value:.4} of the shear modulus") } else { format!("{name} {value:.4}") }
        };
        let shapes: Vec<String> = constants.iter().zip(&self.constants).skip(1).map(one).collect();
        format!("{model}, {}, learnt from {} other recordings", shapes.join(", "), self.from)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn fits(own: f64, ogden: [f64; 2], yeoh: f64) -> Fits {
        let shape = |error: f64, constants: &[f64]| Some(Shape { error, constants: constants.to_vec() });
        Fits {
            own,
            laws: vec![shape(ogden[0], &[1.0, ogden[1], 0.49]), None, None, shape(yeoh, &[0.5, 0.01, 0.02, 0.49])],
        }
    }

    /// The law that fits the others best, with the mean of their shapes; a further constant has to be worth it.
    #[test]
    fn the_law_that_fits_the_others_best_is_taken() {
        let [a, b, c] = [fits(0.1, [0.02, 5.0], 0.018), fits(0.1, [0.01, 7.0], 0.018), fits(0.1, [0.03, 6.0], 0.018)];
        let found = learnt(&[&a, &b, &c]).unwrap();
        assert_eq!((found.law, &found.constants, found.from), (0, &vec![1.0, 6.0, 0.49], 3));
        let better = fits(0.1, [0.02, 5.0], 0.001);
        assert_eq!(learnt(&[&better, &better]).unwrap().law, 3);
        assert!(learnt(&[&a]).is_none());
        let worthless = fits(0.02, [0.018, 5.0], 0.017);
        assert!(learnt(&[&worthless, &worthless]).is_none());
    }

    /// Every law takes its constants, and has the modulus that it was given.
    #[test]
    fn the_scene_and_the_keys_are_those_of_the_law() {
        let scene = Scene::preset("compression").unwrap();
        let modulus = scene.material.shear_modulus();
        let wanted = [Wanted { key: MODULUS.to_owned(), bounds: Some([0.5 * modulus, 2.0 * modulus]) }];
        assert!(is_open(&scene, &wanted) && !is_open(&scene, &[]));
        for (law, Law { constants, .. }) in LAWS.iter().enumerate() {
            let start: Vec<f64> = constants.iter().map(|c| c.start).collect();
            let learnt = Learnt { law, constants: start, from: 2 };
            let changed = learnt.scene(&scene).unwrap();
            assert!((changed.material.shear_modulus() / modulus - 1.0).abs() < 1e-9, "{}", learnt.words());
            let keys = learnt.wanted(&wanted, &scene);
            assert_eq!((keys[0].key.as_str(), keys[0].bounds), (SCALE_KEY, Some([0.5, 2.0])));
            assert!(!is_open(&changed, &keys));
        }
    }
}
