//! The force along a run: against the instrument's axis, and across it where the load cell measured a vector.

use super::{CalibrateError, Task};
use crate::compare::path::ForcePath;
use crate::compare::rows::Rows;
use crate::compare::{self, Answer, Collector, ForceSeries, Keep, Reading, Run, Watch};
use crate::scene::{Dimension, Region, Scene, Word as _};

/// Share of the poses that must be answered.
const ANSWERED: f64 = 0.9;

/// Whether enough poses were answered.
pub(super) fn answered(run: &Run, task: &Task) -> bool {
    run.answers.len() as f64 >= ANSWERED * task.readings.len() as f64
}

/// A run of a scene over a recording, on its own cloud or on that for other regions.
pub(super) fn run(
    scene: &Scene,
    regions: Option<&[Region]>,
    readings: &[Reading],
    measured: &ForceSeries,
    watch: &mut dyn Watch,
) -> Result<Run, CalibrateError> {
    let built = regions.map_or_else(|| compare::build(scene), |regions| compare::build_on(scene, regions));
    let (mut twin, build_s) = built.map_err(|source| CalibrateError::Build { scene: scene.name.clone(), source })?;
    let collector = Collector::new(&twin, "calibrate", build_s, Keep::ANSWERS);
    let run = compare::drive(&mut twin, readings.iter().copied(), Some(measured), collector, watch);
    if watch.stop() { Err(CalibrateError::Interrupted) } else { Ok(run) }
}

/// The force along a run; `None` where the instrument doesn't go into the sample.
pub(super) fn path_of(run: &Run) -> Option<ForcePath> {
    path(run, |a| a.predicted_n)
}

/// The same, and its components along `directions`.
pub(super) fn paths_of(run: &Run, directions: &[[f64; 3]]) -> Option<Vec<ForcePath>> {
    let across = directions.iter().map(|d| path(run, |a| dot(&a.predicted_vector_n, d)));
    std::iter::once(path_of(run)).chain(across).collect()
}

fn path(run: &Run, force: impl Fn(&Answer) -> f64) -> Option<ForcePath> {
    let column = |of: &dyn Fn(&Answer) -> f64| run.answers.iter().map(of).collect();
    ForcePath::new(column(&|a| a.time_s), column(&|a| a.depth_m), column(&force))
}

/// Unit vectors across the instrument's axis along which load cell and model both know the force; none for a load cell of one axis, or a
/// model with symmetry about the axis.
pub(super) fn directions(run: &Run) -> Vec<[f64; 3]> {
    if !run.measures_vectors() || run.dimension != Dimension::Full.as_str() {
        return Vec::new();
    }
    let [x, y] = run.instrument.map_or([0.0; 2], |i| i.slope());
    // the axis goes down along (x, y, -1)
    let unit = |v: [f64; 3]| v.map(|c| c / dot(&v, &v).sqrt());
    let axis = unit([x, y, -1.0]);
    let first = unit([1.0, 0.0, x]);
    let second = [
        axis[1] * first[2] - axis[2] * first[1],
        axis[2] * first[0] - axis[0] * first[2],
        axis[0] * first[1] - axis[1] * first[0],
    ];
    vec![first, second]
}

/// What the load cell measured along a direction, less its zero, N; 0 where it measured nothing.
pub(super) fn measured_along(answers: &[&Answer], direction: &[f64; 3]) -> Vec<f64> {
    let column = |of: &dyn Fn(&Answer) -> f64| -> Vec<f64> { answers.iter().map(|a| of(a)).collect() };
    let measured = column(&|a| a.measured_vector_n.map_or(0.0, |f| dot(&f, direction)));
    Rows::new(column(&|a| a.time_s), column(&|a| a.depth_m), vec![0.0; answers.len()], measured).measured_n
}

fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
