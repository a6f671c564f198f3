//! Accuracy against cost for one scene with many discretisations and step counts. For each, it measures the processor
//! time and the error of forces and displacements relative to independent finite elements ([`ReferenceSolution`]).
//!
//! A [`Case`] is one combination, [`plan`] lists them, and [`Case::run`] gives the [`Row`] of one. Runs share
//! nothing, so any number of them can run in parallel, each on its own thread. Cost is the processor time of that
//! thread. For short runs it is the smallest of up to five, which reduces the influence of other programs.

mod case;
mod drive;
mod error;
mod order;
mod pareto;
mod plan;
mod record;
mod row;
mod table;

pub use case::{Case, Steps};
pub use error::StudyError;
pub use order::{orders, refined};
pub use pareto::front;
pub use plan::{Extent, named, plan, work};
pub use record::csv;
pub use row::{Row, heading, largest_error};
pub use table::{Table, merge, read};

pub(super) use case::MOST_STEPS;
pub(super) use drive::{Driven, Watched, drive};
pub(super) use row::COMPARED_FROM;

use super::progress::Progress;
use super::reference_solution::ReferenceSolution;
use needle_core::scene::Scene;
use needle_estimate::compare::Cancel;

impl Case {
    /// Runs the case on the present rayon pool and compares it with a reference solution. A corrected case needs
    /// `study::correction::row`. `None` if it was cancelled.
    ///
    /// # Errors
    /// [`StudyError`] if the scene does not accept the case. A model that can't be built or diverges is a result, not
    /// an error.
    pub fn run(
        &self,
        scene: &Scene,
        reference_solution: &ReferenceSolution,
        cancel: &Cancel,
    ) -> Result<Option<Row>, StudyError> {
        self.row_of(
            &reference_solution.watched(&self.scene(scene)?),
            reference_solution,
            Watched::whole(&Progress::of(cancel)),
        )
    }

    /// The row of a scene that already has the case's keys.
    ///
    /// # Errors
    /// As [`Case::run`].
    pub(super) fn row_of(
        &self,
        scene: &Scene,
        reference_solution: &ReferenceSolution,
        watch: Watched,
    ) -> Result<Option<Row>, StudyError> {
        let depths: Vec<f64> = reference_solution.force.iter().map(|p| p.0).collect();
        let driven = drive(scene, self, &depths, watch)?;
        Ok((!driven.stopped).then(|| self.row(scene, reference_solution, driven)))
    }

    /// The row for the result of a run.
    pub(super) fn row(&self, scene: &Scene, reference_solution: &ReferenceSolution, driven: Driven) -> Row {
        let compared = reference_solution.displaced.iter().map(|(target, _)| target).eq(&scene.targets);
        Row {
            scene: scene.name.clone(),
            case: self.clone(),
            force_error: reference_solution.force_errors(&driven.path, &driven.vectors),
            displacement_error: reference_solution.displacement_error(&driven.targets).filter(|_| compared),
            way_error: reference_solution.way_error(&driven.at_depths).filter(|_| compared),
            nodes: driven.nodes,
            integration_points: driven.integration_points,
            simulated_s: driven.simulated_s,
            poses: driven.poses,
            steps: driven.steps,
            cost_s: driven.cost_s,
            min_jacobian: driven.min_jacobian,
            recoveries: driven.recoveries,
            ended: driven.ended,
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn coarse() -> (Scene, ReferenceSolution, Case) {
        let scene = Scene::preset("compression").unwrap();
        let reference_solution =
            ReferenceSolution { displaced: Vec::new(), ..ReferenceSolution::of(&scene, 0.001).unwrap() };
        let case = Case { pose_hz: 100.0, ..Case::of(&scene).unwrap().spaced(&scene, 2.0) };
        (scene, reference_solution, case)
    }

    #[test]
    fn at_rest_no_inertia_is_left() {
        let (scene, reference_solution, case) = coarse();
        let error = |steps| {
            let row =
                Case { steps, ..case.clone() }.run(&scene, &reference_solution, &Cancel::default()).unwrap().unwrap();
            assert_eq!((row.force_error.len(), row.displacement_error, row.ended), (4, None, None), "{steps}");
            row.force_error.iter().map(|p| p.1).collect::<Vec<_>>()
        };
        let (rest, many, few) = (error(Steps::Rest), error(Steps::Fixed(100)), error(Steps::Fixed(1)));
        let gap = |a: &[f64]| a.iter().zip(&rest).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(gap(&many) < 0.005, "many steps come near to rest: {many:?} {rest:?}");
        assert!(gap(&few) > 0.05, "one step does not: {few:?} {rest:?}");
    }

    #[test]
    fn a_case_that_is_stopped_has_no_row() {
        let (scene, reference_solution, case) = coarse();
        let cancel = Cancel::default();
        assert!(case.run(&scene, &reference_solution, &cancel).unwrap().is_some());
        cancel.cancel();
        assert_eq!(case.run(&scene, &reference_solution, &cancel).unwrap(), None);
    }
}
