//! The twin, pose by pose.

use needle_core::twin::{self, Motion, Phase, Pose, StampedPose};
use numpy::{PyArray1, PyArray2};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;

use crate::error::{self, BuildError};
use crate::watch::detached;
use crate::{array, scene};

/// Longest difference of an axis from a unit vector that is taken for rounding.
const UNIT: f64 = 1e-3;

/// The digital twin: a pose comes in, the tissue follows, and the force comes out.
///
/// `Twin(scene, threads=0)` makes the model once (a fraction of a second to seconds); `scene` is a `Scene`, a preset's name or a path. `threads` = 0 is one
/// thread per core; results don't depend on it, to the last bit. Python's lock is released while the tissue steps.
///
/// >>> twin = needle_twin.Twin("needle_insertion")
/// >>> twin.step(0.1, depth_m=1e-4).force_n
#[pyclass(module = "needle_twin")]
pub struct Twin {
    twin: twin::Twin,
    last: Option<StampedPose>,
}

#[pymethods]
impl Twin {
    #[new]
    #[pyo3(signature = (scene, threads = 0))]
    fn new(py: Python<'_>, scene: &Bound<'_, PyAny>, threads: usize) -> PyResult<Self> {
        let scene = scene::of(scene)?;
        let built = detached(py, threads, |_| twin::Twin::new(&scene))?;
        let twin = built.map_err(|e| BuildError::new_err(format!("scene {}: {e}", scene.name)))?;
        Ok(Self { twin, last: None })
    }

    /// Advances the tissue to a pose and predicts the force.
    ///
    /// `time_s`: time of the pose, s, growing from pose to pose. Either `depth_m`: depth of the tip below the undeformed top along the scene's own instrument
    /// axis, m, positive into the sample; or `tip`: its position in frame `sample` (origin at the centre of the bottom face, z up), m, with
    /// `axis`: unit vector along the instrument, into the sample (straight down if absent).
    ///
    /// A jump is walked in small steps. Raises PoseRefused (the twin is as it was) or Diverged.
    #[pyo3(signature = (time_s, depth_m = None, *, tip = None, axis = None))]
    fn step(
        &mut self,
        py: Python<'_>,
        time_s: f64,
        depth_m: Option<f64>,
        tip: Option<[f64; 3]>,
        axis: Option<[f64; 3]>,
    ) -> PyResult<Prediction> {
        let pose = stamped(&self.twin, time_s, depth_m, tip, axis)?;
        let twin = &mut self.twin;
        let prediction = py.detach(|| twin.step(pose)).map_err(|halt| error::halt(&halt))?;
        self.last = Some(pose);
        Ok(Prediction::new(prediction, pose.pose.axis))
    }

    /// What a further motion along the instrument's axis would bring, from the last pose on; the twin itself is not changed.
    ///
    /// `distance_m`: how far, negative: back. `speed_m_per_s`: how fast, which matters only for a material that relaxes. `steps`: explicit steps
    /// to spend, at most. Returns the predictions on the way, the last one at the end.
    #[pyo3(signature = (distance_m, speed_m_per_s = 1e-3, steps = Motion::STEPS))]
    fn look_ahead(&self, py: Python<'_>, distance_m: f64, speed_m_per_s: f64, steps: u32) -> PyResult<Vec<Prediction>> {
        let from =
            self.last.ok_or_else(|| PyValueError::new_err("look_ahead starts at the last pose: call step first"))?;
        if !(distance_m.is_finite() && speed_m_per_s.is_finite() && speed_m_per_s > 0.0) {
            return Err(PyValueError::new_err("distance_m must be finite, speed_m_per_s finite and positive"));
        }
        let motion = Motion::new(distance_m, speed_m_per_s, steps);
        let twin = &self.twin;
        let mut out = Vec::new();
        let found = py.detach(|| twin.double().look_ahead(&from, &motion, &mut out));
        found.map_err(|halt| error::halt(&halt))?;
        Ok(out.into_iter().map(|p| Prediction::new(p, from.pose.axis)).collect())
    }

    /// Back to the undeformed state, before the first pose.
    fn reset(&mut self) {
        self.twin.reset();
        self.last = None;
    }

    /// The scene that this twin was made of.
    #[getter]
    fn scene(&self) -> scene::Scene {
        scene::Scene { scene: self.twin.scene().clone() }
    }

    /// "axisymmetric", "mirrored" or "full".
    #[getter]
    fn dimension(&self) -> &'static str {
        use needle_core::scene::Word as _;
        self.twin.dimension().as_str()
    }

    /// Why it has that dimension, in one clause.
    #[getter]
    fn dimension_because(&self) -> &str {
        self.twin.dimension_because()
    }

    /// What is worth knowing about the scene and its mesh and is no error.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.twin.warnings().to_vec()
    }

    /// Number of the model's nodes.
    #[getter]
    fn nodes(&self) -> usize {
        self.twin.nodes()
    }

    /// Number of its integration points.
    #[getter]
    fn integration_points(&self) -> usize {
        self.twin.integration_points()
    }

    /// Threads that a step uses.
    #[getter]
    fn threads(&self) -> usize {
        self.twin.threads()
    }

    /// Explicit steps since the last reset.
    #[getter]
    fn steps(&self) -> u64 {
        self.twin.steps()
    }

    /// Times that the twin went back to its last good state and tried smaller steps, since the last reset.
    #[getter]
    fn recoveries(&self) -> u64 {
        self.twin.recoveries()
    }

    /// Height of the body under the instrument, m.
    #[getter]
    fn height_m(&self) -> f64 {
        self.twin.height_m()
    }

    /// Depth from which on poses are refused, m.
    #[getter]
    fn reach_m(&self) -> f64 {
        self.twin.reach_m()
    }

    /// Undeformed positions of the points that the tissue is shown by, m, shape (n, 3).
    #[getter]
    fn reference_points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        array::rows(py, self.twin.reference_points().to_vec())
    }

    /// Triangles of the surface, outward normals, as rows of three indices into `reference_points`, shape (m, 3).
    #[getter]
    fn surface<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        array::rows(py, self.twin.surface().to_vec())
    }

    /// Tetrahedra, as rows of four indices into `reference_points`, shape (m, 4).
    #[getter]
    fn cells<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        array::rows(py, self.twin.cells().to_vec())
    }

    /// Displacement of each of `reference_points` after the last pose, m, shape (n, 3).
    fn displacements<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let mut out = Vec::new();
        self.twin.displacements(&mut out);
        array::rows(py, out)
    }

    /// Volume ratio det F and von Mises stress in Pa at each of `reference_points`, each of shape (n,).
    fn jacobian_and_stress<'py>(&self, py: Python<'py>) -> (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>) {
        let (mut jacobian, mut stress) = (Vec::new(), Vec::new());
        self.twin.jacobian_and_stress(&mut jacobian, &mut stress);
        (array::numbers(py, jacobian), array::numbers(py, stress))
    }

    /// Names of the scene's targets.
    #[getter]
    fn target_names(&self) -> Vec<String> {
        self.twin.scene().targets.iter().map(|t| t.name.clone()).collect()
    }

    /// Present positions of the scene's targets, m, in their order, shape (k, 3).
    fn targets<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let mut out = Vec::new();
        self.twin.target_positions(&mut out);
        array::rows(py, out)
    }

    /// Places along a needle that bends, from the driver's clamp to its tip, m, shape (n, 3); no rows for another instrument.
    fn needle_shape<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let mut shape = Vec::new();
        self.twin.needle_shape(&mut shape);
        array::rows(py, shape.into_iter().map(|pose| pose.tip).collect())
    }

    /// Tip and axis at a depth along the scene's own instrument axis.
    fn pose_at_depth(&self, depth_m: f64) -> ([f64; 3], [f64; 3]) {
        let Pose { tip, axis, .. } = self.twin.pose_at_depth(depth_m);
        (tip, axis)
    }

    /// A second twin in the same state, on one thread; it shares the model. Results don't depend on the threads.
    fn __copy__(&self) -> Self {
        Self { twin: self.twin.double(), last: self.last }
    }

    fn __deepcopy__(&self, _memo: &Bound<'_, PyAny>) -> Self {
        self.__copy__()
    }

    /// As its scene, for worker processes. A state can't be pickled: send the poses again, or copy the twin in its own process.
    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, (scene::Scene, usize))> {
        let this = slf.borrow();
        if this.last.is_some() {
            return Err(PyTypeError::new_err(
                "a twin can be pickled before its first pose only: pickle its scene and send the poses again (twin.reset() undeforms it; \
                 copy.copy(twin) has the state, in this process)",
            ));
        }
        Ok((slf.get_type().into_any(), (this.scene(), this.twin.threads())))
    }

    fn __repr__(&self) -> String {
        let (scene, nodes, depth) = (&self.twin.scene().name, self.twin.nodes(), self.last);
        let at = depth.map_or("undeformed".to_owned(), |last| format!("at {:.6} m", self.twin.depth_of(&last.pose)));
        format!("<Twin of {scene}: {nodes} nodes, {}, {at}>", self.dimension())
    }
}

/// A pose as `step` takes it.
pub(crate) fn stamped(
    twin: &twin::Twin,
    time_s: f64,
    depth_m: Option<f64>,
    tip: Option<[f64; 3]>,
    axis: Option<[f64; 3]>,
) -> PyResult<StampedPose> {
    let pose = match (depth_m, tip, axis) {
        (Some(depth_m), None, None) => twin.pose_at_depth(depth_m),
        (None, Some(tip), axis) => Pose { tip, axis: axis.map_or(Ok([0.0, 0.0, -1.0]), unit)?, roll_rad: 0.0 },
        _ => return Err(PyValueError::new_err("give either depth_m, or tip and (where it is not straight down) axis")),
    };
    Ok(StampedPose { time_s, pose })
}

/// A direction, refused where it is no unit vector: a mistake in units or order would bend the needle without a word.
fn unit(axis: [f64; 3]) -> PyResult<[f64; 3]> {
    let length = axis.iter().map(|a| a * a).sum::<f64>().sqrt();
    if (length - 1.0).abs() > UNIT || !length.is_finite() {
        return Err(PyValueError::new_err(format!(
            "axis has length {length}: it must be a unit vector into the sample"
        )));
    }
    Ok(axis.map(|a| a / length))
}

/// The answer to one pose.
#[pyclass(module = "needle_twin", frozen)]
pub(crate) struct Prediction {
    prediction: twin::Prediction,
    axis: [f64; 3],
}

impl Prediction {
    fn new(prediction: twin::Prediction, axis: [f64; 3]) -> Self {
        Self { prediction, axis }
    }
}

#[pymethods]
impl Prediction {
    /// Time of the pose that this answers, s.
    #[getter]
    fn time_s(&self) -> f64 {
        self.prediction.time_s
    }

    /// Depth of the tip below the undeformed top along the instrument's axis, m.
    #[getter]
    fn depth_m(&self) -> f64 {
        self.prediction.depth_m
    }

    /// Force of the tissue on the instrument in frame `sample`, N, shape (3,).
    #[getter]
    fn force_n<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.prediction.force_n)
    }

    /// The same against the instrument's axis, N: positive resists insertion (what `force.csv` calls `predicted_n`).
    #[getter]
    fn predicted_n(&self) -> f64 {
        -(0..3).map(|k| self.prediction.force_n[k] * self.axis[k]).sum::<f64>()
    }

    /// Force of the tissue on the base, N, shape (3,).
    #[getter]
    fn base_force_n<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.prediction.base_force_n)
    }

    /// "approach", "indentation", "penetration" or "retraction".
    #[getter]
    fn phase(&self) -> &'static str {
        Phase::as_str(self.prediction.phase)
    }

    /// What happened since the last pose and at which depth in m, if anything: ("puncture", depth) of the surface or a membrane, ("layer", depth) where a
    /// needle with friction came into a region that no membrane closes.
    #[getter]
    fn event(&self) -> Option<(&'static str, f64)> {
        self.prediction.event.map(|event| (event.kind(), event.depth_m()))
    }

    /// Explicit steps that this pose took.
    #[getter]
    fn steps(&self) -> u32 {
        self.prediction.steps
    }

    /// Smallest volume ratio det F over all integration points.
    #[getter]
    fn min_jacobian(&self) -> f64 {
        self.prediction.health.min_jacobian
    }

    /// Kinetic over strain energy: small while the motion is quasi-static.
    #[getter]
    fn kinetic_to_strain_energy(&self) -> f64 {
        self.prediction.health.kinetic_to_strain_energy
    }

    /// |instrument force + base reaction| over the peak force so far.
    #[getter]
    fn force_imbalance(&self) -> f64 {
        self.prediction.health.force_imbalance
    }

    /// Estimated error of the force that discretisation and steps make, N.
    #[getter]
    fn model_error_n(&self) -> f64 {
        self.prediction.model_error_n()
    }

    /// Share of the strain energy in cells that have turned over: from 0.05 on the cloud does not resolve the tissue.
    #[getter]
    fn folded_energy(&self) -> f64 {
        self.prediction.health.folded_energy
    }

    fn __repr__(&self) -> String {
        let p = &self.prediction;
        let [x, y, z] = p.force_n;
        format!(
            "<Prediction at {:.4} s, depth {:.6} m: force ({x:.6}, {y:.6}, {z:.6}) N, {}>",
            p.time_s,
            p.depth_m,
            self.phase()
        )
    }
}
