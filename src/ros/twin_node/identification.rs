//! Identification in the force thread, as configured by the parameter `identify`, and the publication of its results.
//!
//! The solver thread is not involved.

use ros2_client::ParameterValue;

use needle_core::scene::Scene;
use needle_estimate::compare::identifier::{Identifier, Parameter, State};
use ros2_messages::needle_twin::ForceComparison;
use ros2_node::start::NodeError;

/// Checks that the names in a parameter's value can be identified.
///
/// # Errors
/// The invalid name, and the valid ones.
pub(super) fn check(value: &ParameterValue) -> Result<(), String> {
    let ParameterValue::StringArray(names) = value else { return Ok(()) };
    match names.iter().find(|name| Parameter::of_name(name).is_none()) {
        Some(name) => Err(format!("`{name}` can't be identified while the node runs; {}", allowed())),
        None => Ok(()),
    }
}

fn allowed() -> String {
    format!("these can: {}", Parameter::ALL.map(Parameter::name).join(", "))
}

/// The identifier, the requested names, and the stamp of its time 0.
#[derive(Debug)]
pub(super) struct Identification {
    identifier: Identifier,
    wanted: Vec<Parameter>,
    origin_nanos: Option<i64>,
}

impl Identification {
    /// The identification for a scene and the parameter; `None` if nothing is to be identified.
    ///
    /// # Errors
    /// [`NodeError`] for a name that does not exist in the scene.
    pub(crate) fn new(scene: &Scene, names: &[String]) -> Result<Option<Self>, NodeError> {
        let mut wanted = Vec::new();
        for name in names {
            let parameter = Parameter::of_name(name)
                .ok_or_else(|| NodeError::Other(format!("identify: `{name}`: {}", allowed())))?;
            if parameter != Parameter::Offset && scene.get(name).is_none() {
                return Err(NodeError::Other(format!("identify: scene {} has no {name}", scene.name)));
            }
            if parameter == Parameter::ShearModulus && !scene.regions.is_empty() {
                return Err(NodeError::Other(format!(
                    "identify: the force of scene {} is not proportional to {name}, since it has regions: `needle_twin calibrate` \
                     fits it to a recording",
                    scene.name
                )));
            }
            if !wanted.contains(&parameter) {
                wanted.push(parameter);
            }
        }
        if wanted.is_empty() {
            return Ok(None);
        }
        if wanted.contains(&Parameter::ShearModulus) && wanted.contains(&Parameter::DeformationCoefficient) {
            tracing::warn!(
                "identify: {} and {} can't be told apart by the force of a needle: neither will converge. Take one of them, \
                 and the other from a compression test",
                Parameter::ShearModulus.name(),
                Parameter::DeformationCoefficient.name()
            );
        }
        let value = |p: Parameter| scene.get(p.name()).and_then(|v| v.as_real()).unwrap_or(1.0);
        let identifier =
            Identifier::new(&wanted, value(Parameter::ShearModulus), value(Parameter::DeformationCoefficient));
        Ok(Some(Self { identifier, wanted, origin_nanos: None }))
    }

    /// Restarts.
    pub(crate) fn reset(&mut self) {
        self.identifier.reset();
        self.origin_nanos = None;
    }

    /// Updates with a comparison and writes the present estimates into it. `inserted`: the needle is in the tissue.
    /// `doubt_n`: possible error of the twin's force, N.
    #[allow(clippy::cast_precision_loss)] // seconds of one run
    pub(crate) fn take(&mut self, message: &mut ForceComparison, stamp_nanos: i64, inserted: bool, doubt_n: f64) {
        let time_s = (stamp_nanos - *self.origin_nanos.get_or_insert(stamp_nanos)) as f64 * 1e-9;
        let changed = if message.valid {
            self.identifier.update(time_s, message.predicted_n, inserted, message.measured_n, doubt_n)
        } else {
            // A missing reading is no fault of the load cell: the next one decides.
            let missing = message.load_cell == ForceComparison::LOAD_CELL_MISSING;
            if missing { None } else { self.identifier.fault() }
        };
        if let Some(state) = changed {
            self.tell(state, message.depth_m);
        }
        self.write(message, inserted);
    }

    fn tell(&self, state: State, depth_m: f64) {
        match state {
            State::Frozen(cause) => tracing::warn!("identification stops at depth {depth_m:.6} m: {cause}"),
            State::Learning => tracing::info!("identification goes on"),
            State::Converged => {
                let known: Vec<String> = self.known().map(|(n, v, e)| format!("{n} = {v:.6} +- {e:.6}")).collect();
                tracing::info!("identified: {}", known.join(", "));
            }
        }
    }

    /// Name, value and standard error of each.
    fn known(&self) -> impl Iterator<Item = (&'static str, f64, f64)> {
        let all = self.wanted.iter().filter_map(|p| self.identifier.estimate(*p).map(|(v, e)| (p.name(), v, e)));
        all.filter(|(_, value, error)| value.is_finite() && error.is_finite())
    }

    fn write(&self, message: &mut ForceComparison, inserted: bool) {
        message.identification = match self.identifier.state() {
            State::Learning => ForceComparison::IDENTIFICATION_LEARNING,
            State::Converged => ForceComparison::IDENTIFICATION_CONVERGED,
            State::Frozen(cause) => {
                message.identification_reason = cause.to_string();
                ForceComparison::IDENTIFICATION_FROZEN
            }
        };
        message.identified_n = self.identifier.expected_n(message.predicted_n, inserted);
        for (name, value, error) in self.known() {
            message.identified_names.push(name.to_owned());
            message.identified_values.push(value);
            message.identified_standard_errors.push(error);
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn wanted() -> Identification {
        let names = ["material.shear_modulus_pa".to_owned(), "load_cell.offset_n".to_owned()];
        Identification::new(&Scene::preset("compression").unwrap(), &names).unwrap().unwrap()
    }

    /// The published message for reading number `i`, at 200 Hz, with a gel 20 % stiffer than the scene.
    fn said(identification: &mut Identification, i: u32, load_cell: u8) -> ForceComparison {
        let predicted_n = 0.001 * f64::from(i.saturating_sub(150));
        let noise = if i.is_multiple_of(2) { 2e-4 } else { -2e-4 };
        let mut message = ForceComparison {
            valid: load_cell == ForceComparison::LOAD_CELL_OK,
            load_cell,
            predicted_n,
            measured_n: 1.2 * predicted_n + 0.01 + noise,
            ..ForceComparison::default()
        };
        identification.take(&mut message, i64::from(i) * 5_000_000, false, 0.0);
        message
    }

    #[test]
    fn a_fault_of_the_load_cell_freezes_and_says_why() {
        let mut identification = wanted();
        let last = (0..400).map(|i| said(&mut identification, i, ForceComparison::LOAD_CELL_OK)).last().unwrap();
        assert_eq!(last.identification, ForceComparison::IDENTIFICATION_CONVERGED);
        assert_eq!(last.identified_names, ["material.shear_modulus_pa", "load_cell.offset_n"]);
        assert!((last.identified_values[0] / (1.2 * 1678.0) - 1.0).abs() < 0.01, "{last:?}");
        assert!((last.identified_n - last.measured_n).abs() < 2e-3, "{last:?}");
        let missing = said(&mut identification, 400, ForceComparison::LOAD_CELL_MISSING);
        assert_eq!(missing.identification, ForceComparison::IDENTIFICATION_CONVERGED, "one reading less is no fault");
        let stuck = said(&mut identification, 401, ForceComparison::LOAD_CELL_STUCK);
        assert_eq!(stuck.identification, ForceComparison::IDENTIFICATION_FROZEN);
        assert!(stuck.identification_reason.contains("load cell"), "{stuck:?}");
        assert!((stuck.identified_values[0] / last.identified_values[0] - 1.0).abs() < 0.01, "{stuck:?}");
        identification.reset();
        let anew = said(&mut identification, 402, ForceComparison::LOAD_CELL_OK);
        assert_eq!(anew.identification, ForceComparison::IDENTIFICATION_LEARNING);
        assert_eq!(anew.identified_values, [1678.0, 0.0]);
    }

    #[test]
    fn what_the_scene_does_not_have_is_refused() {
        let scene = Scene::preset("compression").unwrap();
        let ask = |name: &str| Identification::new(&scene, &[name.to_owned()]);
        assert!(ask("instrument.deformation_coefficient").unwrap_err().to_string().contains("compression"));
        assert!(ask("material.poisson_ratio").unwrap_err().to_string().contains("these can"));
        assert!(Identification::new(&scene, &[]).unwrap().is_none());
    }
}
