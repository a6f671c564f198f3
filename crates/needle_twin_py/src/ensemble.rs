//! Many twins of one scene, pose by pose.

use needle_core::scene::Uncertain;
use needle_core::twin;
use needle_estimate::compare::ensemble::{self, Band, Live, Size};
use numpy::{IntoPyArray as _, PyArray1, PyArray2, PyArray3, PyArrayMethods as _};
use pyo3::prelude::*;

use crate::error::{self, BuildError, Diverged};
use crate::twin::stamped;
use crate::watch::detached;
use crate::{array, scene};

/// Many twins of one scene in step, each with other values of the keys in the scene's `[uncertainty]`.
///
/// `Ensemble(scene, members=24, seed=0)` draws the values (low-discrepancy, the same for the same seed) and builds the twins; those that differ in nothing
/// that the tissue sees share one. `scene` is a Scene, a preset's name or a path, with priors:
///
/// >>> scene = needle_twin.Scene("needle_insertion", {"uncertainty.material.shear_modulus_pa": {"normal": [2000, 200]}})
/// >>> ensemble = needle_twin.Ensemble(scene, 24)
/// >>> band = ensemble.step(0.1, depth_m=1e-4)
/// >>> band.low_n, band.mean_n, band.high_n
///
/// The members step one after the other in the thread that calls, without Python's lock.
#[pyclass(module = "needle_twin")]
pub(crate) struct Ensemble {
    live: Live,
    twin: twin::Twin,
    keys: Vec<String>,
    values: Vec<Vec<f64>>,
}

#[pymethods]
impl Ensemble {
    #[new]
    #[pyo3(signature = (scene, members = 24, seed = 0))]
    fn new(py: Python<'_>, scene: &Bound<'_, PyAny>, members: usize, seed: u64) -> PyResult<Self> {
        let scene = scene::of(scene)?;
        let size = Size { members, seed };
        let drawn = ensemble::members(&scene, size).map_err(error::ensemble)?;
        ensemble::check_live(&drawn).map_err(error::ensemble)?;
        let build = |_: &mut _| {
            let mut trouble = None;
            let live = Live::build(&drawn, |k, why| trouble = trouble.take().or(Some((k, why))));
            live.map(|live| (live, twin::Twin::new(&scene), trouble))
        };
        let (live, twin, trouble) = detached(py, 1, build)?.map_err(error::ensemble)?;
        if let Some((k, why)) = trouble {
            return Err(BuildError::new_err(format!("member {k} of scene {}: {why}", scene.name)));
        }
        let twin = twin.map_err(|e| BuildError::new_err(format!("scene {}: {e}", scene.name)))?;
        let values = drawn.into_iter().map(|member| member.values).collect();
        Ok(Self { live, twin, keys: scene.uncertainty.into_iter().map(|Uncertain { key, .. }| key).collect(), values })
    }

    /// Advances every member to a pose and returns the band of their forces.
    ///
    /// The arguments are those of `Twin.step`. A member that has no answer is left out of the band (`ForceBand.members` counts the others) until it comes back by
    /// itself. Raises PoseRefused or Diverged where none has an answer.
    #[pyo3(signature = (time_s, depth_m = None, *, tip = None, axis = None))]
    fn step(
        &mut self,
        py: Python<'_>,
        time_s: f64,
        depth_m: Option<f64>,
        tip: Option<[f64; 3]>,
        axis: Option<[f64; 3]>,
    ) -> PyResult<ForceBand> {
        let pose = stamped(&self.twin, time_s, depth_m, tip, axis)?;
        let live = &mut self.live;
        py.detach(|| live.step(&pose));
        let Some((band, members)) = live.band() else {
            return Err(live.halt().map_or_else(|| Diverged::new_err("no member has an answer"), error::halt));
        };
        Ok(ForceBand { band, members, time_s, depth_m: self.twin.depth_of(&pose.pose) })
    }

    /// Force of each member at the last pose against the instrument's axis, N, shape (members,); NaN where it has no answer.
    #[getter]
    fn predicted_n<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array::numbers(py, self.live.forces().collect())
    }

    /// The scene's targets at the last pose: mean positions, m, shape (k, 3), and their covariances over the members, m^2, shape (k, 3, 3). Both have no row
    /// before the first pose.
    fn targets<'py>(&self, py: Python<'py>) -> PyResult<Spreads<'py>> {
        let spreads = self.live.targets();
        let means = array::rows(py, spreads.iter().map(|spread| spread.mean_m).collect())?;
        let all: Vec<f64> = spreads.iter().flat_map(|spread| spread.covariance_m2.into_iter().flatten()).collect();
        Ok((means, all.into_pyarray(py).reshape([spreads.len(), 3, 3])?))
    }

    /// Keys that were drawn.
    #[getter]
    fn keys(&self) -> Vec<String> {
        self.keys.clone()
    }

    /// Their values, in SI units, shape (members, keys).
    #[getter]
    fn values<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let flat: Vec<f64> = self.values.iter().flatten().copied().collect();
        flat.into_pyarray(py).reshape([self.values.len(), self.keys.len()])
    }

    /// All members undeformed again.
    fn reset(&mut self) {
        self.live.reset();
    }

    fn __len__(&self) -> usize {
        self.values.len()
    }

    fn __repr__(&self) -> String {
        format!("<Ensemble of {}: {} members, {}>", self.twin.scene().name, self.values.len(), self.keys.join(", "))
    }
}

/// Mean positions and their covariances.
type Spreads<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray3<f64>>);

/// Where the members' forces against the instrument's axis lie at one pose.
#[pyclass(module = "needle_twin", frozen)]
pub(crate) struct ForceBand {
    band: Band,
    members: usize,
    time_s: f64,
    depth_m: f64,
}

#[pymethods]
impl ForceBand {
    /// Time of the pose that this answers, s.
    #[getter]
    fn time_s(&self) -> f64 {
        self.time_s
    }

    /// Depth of the tip below the undeformed top along the instrument's axis, m.
    #[getter]
    fn depth_m(&self) -> f64 {
        self.depth_m
    }

    /// Mean, N.
    #[getter]
    fn mean_n(&self) -> f64 {
        self.band.mean_n
    }

    /// Standard deviation, N.
    #[getter]
    fn standard_deviation_n(&self) -> f64 {
        self.band.standard_deviation_n
    }

    /// Force below which 2.5 % lie, N.
    #[getter]
    fn low_n(&self) -> f64 {
        self.band.low_n
    }

    /// Force below which 97.5 % lie, N.
    #[getter]
    fn high_n(&self) -> f64 {
        self.band.high_n
    }

    /// Members that have an answer.
    #[getter]
    fn members(&self) -> usize {
        self.members
    }

    fn __repr__(&self) -> String {
        let Band { low_n, high_n, .. } = self.band;
        format!(
            "<ForceBand at {:.4} s, depth {:.6} m: {low_n:.6} to {high_n:.6} N, {} members>",
            self.time_s, self.depth_m, self.members
        )
    }
}
