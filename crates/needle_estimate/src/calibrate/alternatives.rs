//! What else explains a recording: the same fit with another assumption that a scene makes and a lab often can't check.
//!
//! An interval holds for the model that was chosen. On a squat sample smooth plates explain a press with a modulus a third higher
//! than bonded ones do, each within 2 %. Where two models explain the readings, nothing of the recording decides between
//! them, and the interval has to hold both.
//!
//! ```text
//! ends       plates and faces: bonded where they were frictionless, frictionless where they were bonded
//! contact    the depth of the first contact is fitted too
//! law        Ogden's law, one term, its exponent fitted, where the law is neo-Hookean
//! ```

use super::{Alternative, CalibrateError, Calibration, Estimate, Task, Wanted, calibrate, unknown};
use crate::compare::Watch;
use needle_core::scene::{ContactLaw, InstrumentKind, MaterialModel, Override, Scene};

const MODULUS: &str = "material.shear_modulus_pa";
const OGDEN: &str = "material.ogden_shear_moduli_pa[0]";
/// Exponents of Ogden's law: bounds, and the start of the search.
const EXPONENT: (&str, [f64; 2], &str) = ("material.ogden_exponents[0]", [1.0, 30.0], "[3]");
const FROM: &str = "an alternative";

/// An assumption that is varied.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Assumption {
    /// How plates and faces hold the sample.
    Ends,
    /// The depth of the first contact.
    Contact,
    /// The constitutive law.
    Law,
}

/// Fits again with each assumption that is not `certain` changed. Only of plates and indenters: they leave most open.
/// Assumptions under which the scene can't be run are left out.
///
/// # Errors
/// [`CalibrateError::Interrupted`].
pub fn alternatives(
    task: &Task,
    found: &Calibration,
    certain: &[Assumption],
    watch: &mut dyn Watch,
    tell: &mut dyn FnMut(&str),
) -> Result<Vec<Alternative>, CalibrateError> {
    let mut all = Vec::new();
    for assumption in [Assumption::Ends, Assumption::Contact, Assumption::Law] {
        let Some((what, scene, wanted)) =
            (!certain.contains(&assumption)).then(|| assumption.changed(task, found)).flatten()
        else {
            continue;
        };
        tell(&format!("with {what}"));
        match calibrate(&Task { scene: &scene, wanted: &wanted, table: None, ..task.clone() }, watch, tell) {
            Ok(fit) => all.push(of(what, task, fit)),
            Err(CalibrateError::Interrupted) => return Err(CalibrateError::Interrupted),
            Err(_) => {}
        }
    }
    Ok(all)
}

fn of(what: String, task: &Task, fit: Calibration) -> Alternative {
    let rmse_n = fit.rmse_n();
    let named = |(e, wanted): (&Estimate, &Wanted)| Estimate { name: wanted.key.clone(), ..e.clone() };
    let estimates = fit.estimates.iter().zip(task.wanted).map(named).collect();
    Alternative { what, estimates, verdict: fit.verdict, rmse_n, runs: fit.runs }
}

impl Assumption {
    /// The assumption in words, the scene and the keys; `None` where there is nothing to change.
    fn changed(self, task: &Task, found: &Calibration) -> Option<(String, Scene, Vec<Wanted>)> {
        let scene = task.scene;
        let instrument = scene.instrument?;
        let plate = matches!(instrument.kind, InstrumentKind::Plate);
        if !plate && !matches!(instrument.kind, InstrumentKind::Indenter { .. }) {
            return None;
        }
        let with = |changes: &[(&str, &str)]| {
            let changes: Vec<Override> = changes.iter().map(|(key, text)| Override::text(key, text, FROM)).collect();
            scene.with(&changes).ok()
        };
        let mut wanted = task.wanted.to_vec();
        let more = |key: &str, bounds| Wanted { key: key.to_owned(), bounds };
        let (what, scene) = match self {
            Self::Ends => {
                let other = match instrument.contact {
                    ContactLaw::Bonded => "frictionless",
                    ContactLaw::Frictionless => "bonded",
                    ContactLaw::Coulomb { .. } => return None,
                };
                let base = [("instrument.contact", other), ("sample.base", other)];
                let (changes, ends) = if plate { (&base[..], "plates") } else { (&base[..1], "contact") };
                (format!("{other} {ends}"), with(changes)?)
            }
            Self::Contact => {
                if found.realigned[0] || wanted.iter().any(|w| w.key == unknown::CONTACT_KEY) {
                    return None;
                }
                wanted.push(more(unknown::CONTACT_KEY, None));
                ("the contact fitted too".to_owned(), scene.clone())
            }
            Self::Law => {
                let modulus = wanted.iter_mut().find(|w| w.key == MODULUS)?;
                if !matches!(scene.material.model, MaterialModel::NeoHookean { .. }) || !scene.regions.is_empty() {
                    return None;
                }
                OGDEN.clone_into(&mut modulus.key);
                let start = format!("[{}]", found.estimate(MODULUS)?.value);
                let (key, bounds, exponent) = EXPONENT;
                wanted.push(more(key, Some(bounds)));
                let law = [
                    ("material.model", "ogden"),
                    ("material.ogden_shear_moduli_pa", start.as_str()),
                    ("material.ogden_exponents", exponent),
                ];
                ("Ogden's law".to_owned(), with(&law)?)
            }
        };
        Some((what, scene, wanted))
    }
}
