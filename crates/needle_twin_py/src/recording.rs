//! Recordings: bags and tables.

use std::path::{Path, PathBuf};

use needle_recording::{Quantity, Selection, Table, TableLayout, TopicNames};
use numpy::{PyArray1, PyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::array;
use crate::error::{RecordingError, in_python};
use crate::memory::{self, Memory};

/// A recording: the instrument's place and the measured force over time, from a rosbag2 folder, an .mcap file, or tables (CSV, TSV, .xlsx, .npy, .npz).
///
/// `paths`: one path, or two where position and force are tables of their own; or a table in memory: a dict of columns by their headers, a frame
/// of pandas or polars, or an array with a row for each reading. The options are those of the command line's `replay`: topics of a bag
/// or columns of a table (a header's text, or a number from 1), their units, and -1 for a sign that is the other way round. What isn't
/// given is seen from the file where it can be.
///
/// >>> recording = needle_twin.Recording("run.csv", position="Compression (mm)", force="Load (N)", time="Time (s)")
/// >>> recording = needle_twin.Recording({"Time (s)": time_s, "Depth (mm)": depth_mm, "Load (N)": force_n})
#[pyclass(module = "needle_twin", frozen)]
pub(crate) struct Recording {
    pub recording: needle_recording::Recording,
    pub pose_wanted: bool,
}

#[pymethods]
impl Recording {
    #[new]
    #[pyo3(signature = (paths, *, position = None, position_unit = None, position_sign = 1, position_zero = 0.0, position_scale = None, force = None, force_unit = None,
        force_sign = 1, force_zero = None, force_columns = None, sensor_rotation = None, time = Texts::default(), time_unit = Texts::default(), rate_hz = None, time_offset_s = 0.0, pose_columns = None, sample_pose = None,
        marker_columns = Texts::default(), gauge_length_m = None, separator = None, decimal_comma = None, header_line = None, comment = None, sheet = None, block = None,
        measured_cp = None, joint = "insertion", frame_id = "sample"))]
    #[allow(clippy::too_many_arguments)] // keywords, one for each option of the command line
    fn new(
        paths: &Bound<'_, PyAny>,
        position: Option<String>,
        position_unit: Option<String>,
        position_sign: i32,
        position_zero: f64,
        position_scale: Option<f64>,
        force: Option<String>,
        force_unit: Option<String>,
        force_sign: i32,
        force_zero: Option<Zero>,
        force_columns: Option<[String; 3]>,
        sensor_rotation: Option<[f64; 4]>,
        time: Texts,
        time_unit: Texts,
        rate_hz: Option<f64>,
        time_offset_s: f64,
        pose_columns: Option<PoseColumns>,
        sample_pose: Option<[f64; 7]>,
        marker_columns: Texts,
        gauge_length_m: Option<f64>,
        separator: Option<char>,
        decimal_comma: Option<bool>,
        header_line: Option<usize>,
        comment: Option<String>,
        sheet: Option<String>,
        block: Option<usize>,
        measured_cp: Option<String>,
        joint: &str,
        frame_id: &str,
    ) -> PyResult<Self> {
        let pose_wanted = measured_cp.is_some();
        let (pose, orientation) = match pose_columns {
            Some(PoseColumns::Tip(tip)) => (Some(tip), None),
            Some(PoseColumns::Pose([x, y, z, i, j, k, w])) => (Some([x, y, z]), Some([i, j, k, w])),
            None => (None, None),
        };
        let mut selection = Selection {
            names: TopicNames {
                pose: measured_cp,
                joint: joint.to_owned(),
                frame_id: frame_id.to_owned(),
                ..TopicNames::default()
            },
            position: Quantity {
                zero: finite("position_zero", position_zero)?,
                factor: positive("position_scale", position_scale)?,
                ..quantity("position", position, position_unit, position_sign)?
            },
            force: Quantity {
                zero: if let Some(Zero::One(zero)) = force_zero { finite("force_zero", zero)? } else { 0.0 },
                ..quantity("force", force, force_unit, force_sign)?
            },
            force_zeros: match force_zero {
                Some(Zero::Three(zeros)) => {
                    zeros.iter().try_for_each(|zero| finite("force_zero", *zero).map(drop))?;
                    Some(zeros)
                }
                _ => None,
            },
            time_offset_s,
            time: time.0,
            time_unit: time_unit.0,
            rate_hz: positive("rate_hz", rate_hz)?,
            pose,
            orientation,
            forces: force_columns,
            sensor_rotation,
            sample_pose,
            markers: marker_columns.0,
            gauge_length_m: positive("gauge_length_m", gauge_length_m)?,
            layout: TableLayout { separator, decimal_comma, header_line, comment, block, sheet },
            most_readings: None,
        };
        if let Some(memory) = memory::of(paths)? {
            memory.lay_out(&mut selection.layout);
            return Self::of_memory(memory, &selection, pose_wanted);
        }
        Self::open(&files(paths)?, &selection, pose_wanted)
    }

    /// Where it comes from.
    #[getter]
    fn source(&self) -> &str {
        &self.recording.source
    }

    /// The scene that it names, if it names one.
    #[getter]
    fn scene(&self) -> Option<&str> {
        self.recording.scene.as_deref()
    }

    /// Times of the depths, s, shape (n,).
    #[getter]
    fn time_s<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array::numbers(py, self.recording.depths.iter().map(|s| s.time_s).collect())
    }

    /// Depths, m, shape (n,).
    #[getter]
    fn depth_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array::numbers(py, self.recording.depths.iter().map(|s| s.depth_m).collect())
    }

    /// Times of the tip's poses, s, shape (p,); empty where the recording has none.
    #[getter]
    fn pose_time_s<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array::numbers(py, self.recording.poses.iter().map(|s| s.time_s).collect())
    }

    /// Positions of the tip in frame `sample`, m, shape (p, 3).
    #[getter]
    fn tip<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        array::rows(py, self.recording.poses.iter().map(|s| s.tip).collect())
    }

    /// Times of the forces, s, shape (m,).
    #[getter]
    fn force_time_s<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array::numbers(py, self.recording.forces.iter().map(|s| s.time_s).collect())
    }

    /// Forces of the tissue on the instrument in frame `sample`, N, shape (m, 3); a load cell of one axis has z alone.
    #[getter]
    fn force_n<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        array::rows(py, self.recording.forces.iter().map(|s| s.force_n).collect())
    }

    /// What was not understood, but is no loss.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.recording.warnings.clone()
    }

    /// What was lost.
    #[getter]
    fn losses(&self) -> Vec<String> {
        self.recording.losses.iter().map(ToString::to_string).collect()
    }

    /// Writes it as a rosbag2 folder, which must not exist, and returns the path of its .mcap file; `scene`: the scene that the bag names.
    #[pyo3(signature = (folder, scene = None))]
    fn save(&self, folder: PathBuf, scene: Option<&str>) -> PyResult<PathBuf> {
        let written = self.recording.write(&folder, scene);
        written.map(|made| made.folder).map_err(|e| RecordingError::new_err(in_python(&e.to_string())))
    }

    fn __repr__(&self) -> String {
        let r = &self.recording;
        format!(
            "<Recording {}: {} depths, {} poses, {} forces>",
            r.source,
            r.depths.len(),
            r.poses.len(),
            r.forces.len()
        )
    }
}

impl Recording {
    fn open(files: &[PathBuf], selection: &Selection, pose_wanted: bool) -> PyResult<Self> {
        let read = needle_recording::Recording::open(files, selection);
        read.map(|recording| Self { recording, pose_wanted })
            .map_err(|e| RecordingError::new_err(in_python(&e.to_string())))
    }

    fn of_memory(memory: Memory, selection: &Selection, pose_wanted: bool) -> PyResult<Self> {
        let error = |e: &dyn std::fmt::Display| RecordingError::new_err(in_python(&e.to_string()));
        let bytes = memory.text.into_bytes();
        let table = Table::from_bytes(Path::new(memory.name), bytes, selection, 0).map_err(|e| error(&e))?;
        let recording = needle_recording::Recording::of_tables(&mut [table], selection).map_err(|e| error(&e))?;
        Ok(Self { recording, pose_wanted })
    }
}

/// A recording from what a user gave, by what is done with it: a [`Recording`] or a path.
pub(crate) fn with<T>(given: &Bound<'_, PyAny>, work: impl FnOnce(&Recording) -> PyResult<T>) -> PyResult<T> {
    if let Ok(recording) = given.cast::<Recording>() {
        return work(recording.get());
    }
    if let Some(memory) = memory::of(given)? {
        let mut selection = Selection::default();
        memory.lay_out(&mut selection.layout);
        return work(&Recording::of_memory(memory, &selection, false)?);
    }
    work(&Recording::open(&files(given)?, &Selection::default(), false)?)
}

/// One text or several.
#[derive(Default)]
pub(crate) struct Texts(Vec<String>);

impl<'py> FromPyObject<'_, 'py> for Texts {
    type Error = PyErr;

    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let one = given.extract::<String>().map(|one| vec![one]);
        one.or_else(|_| given.extract::<Vec<String>>()).map(Self)
    }
}

/// What a load cell reads without load: one number, or x, y and z.
#[derive(FromPyObject)]
enum Zero {
    One(f64),
    Three([f64; 3]),
}

/// Columns of the tip, x, y and z, and of the orientation, a quaternion x, y, z, w.
#[derive(FromPyObject)]
enum PoseColumns {
    Tip([String; 3]),
    Pose([String; 7]),
}

/// One path or several.
fn files(paths: &Bound<'_, PyAny>) -> PyResult<Vec<PathBuf>> {
    let several = paths.extract::<PathBuf>().map(|one| vec![one]);
    several.or_else(|_| paths.extract::<Vec<PathBuf>>())
}

fn quantity(name: &str, place: Option<String>, unit: Option<String>, sign: i32) -> PyResult<Quantity> {
    let reversed = match sign {
        1 => false,
        -1 => true,
        _ => return Err(PyValueError::new_err(format!("{name}_sign = {sign}: 1 or -1"))),
    };
    Ok(Quantity { place, unit, reversed, ..Quantity::default() })
}

fn finite(name: &str, number: f64) -> PyResult<f64> {
    if number.is_finite() {
        Ok(number)
    } else {
        Err(PyValueError::new_err(format!("{name} = {number}: a finite number")))
    }
}

fn positive(name: &str, number: Option<f64>) -> PyResult<Option<f64>> {
    match number {
        Some(x) if !(x.is_finite() && x > 0.0) => {
            Err(PyValueError::new_err(format!("{name} = {x}: a positive number")))
        }
        _ => Ok(number),
    }
}
