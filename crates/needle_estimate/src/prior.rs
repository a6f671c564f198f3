//! What a laboratory's recordings teach, kept in a file for the next one.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::calibrate::{LoadCell, Wanted};
use crate::compare::{Curve, Watch, depths};
use crate::learnt_law::{self, Fits};
use needle_core::scene::{Scene, SceneError};
use needle_core::twin::Twin;
use needle_recording::Recording;

/// What the whole of one recording says.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sample {
    /// Its name.
    pub name: String,
    /// The scene it is of, by name.
    pub scene: String,
    /// Its force over the depth of the insertion.
    pub curve: Curve,
    /// Fits of the laws, where one can be learnt.
    pub fits: Option<Fits>,
}

/// What is known before a recording is looked at.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Prior {
    /// The recordings it comes from.
    pub samples: Vec<Sample>,
}

/// Why a prior can't be read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PriorError {
    /// The file.
    #[error("{0}: {1}")]
    File(String, std::io::Error),
    /// Its content.
    #[error("{0}: {1}")]
    Content(String, serde_json::Error),
}

impl Prior {
    /// Reads one that [`Prior::write`] wrote.
    ///
    /// # Errors
    /// [`PriorError`] naming the file.
    pub fn read(path: &Path) -> Result<Self, PriorError> {
        let name = || path.display().to_string();
        let text = std::fs::read_to_string(path).map_err(|e| PriorError::File(name(), e))?;
        serde_json::from_str(&text).map_err(|e| PriorError::Content(name(), e))
    }

    /// Writes it as JSON.
    ///
    /// # Errors
    /// [`PriorError`] naming the file.
    pub fn write(&self, path: &Path) -> Result<(), PriorError> {
        let name = || path.display().to_string();
        let text = serde_json::to_string(self).map_err(|e| PriorError::Content(name(), e))?;
        std::fs::write(path, text).map_err(|e| PriorError::File(name(), e))
    }
}

/// A scene whose law other recordings have taught.
#[derive(Clone, Debug)]
pub struct Taught {
    /// The scene with that law.
    pub scene: Scene,
    /// The keys, with the factor on the law in place of the modulus.
    pub wanted: Vec<Wanted>,
    /// Law and shape, in words.
    pub words: String,
}

/// The law that recordings of a scene teach; `None` if they teach none, or none can be learnt.
///
/// # Errors
/// [`SceneError`] if the scene does not take it.
pub fn law(samples: &[&Sample], scene: &Scene, wanted: &[Wanted]) -> Result<Option<Taught>, SceneError> {
    let alike = samples.iter().filter(|sample| sample.scene == scene.name);
    let fits: Vec<&Fits> = alike.filter_map(|sample| sample.fits.as_ref()).collect();
    let learnt = learnt_law::learnt(&fits).filter(|_| learnt_law::is_open(scene, wanted));
    let taught = |learnt: learnt_law::Learnt| {
        Ok(Taught { scene: learnt.scene(scene)?, wanted: learnt.wanted(wanted, scene), words: learnt.words() })
    };
    learnt.map(taught).transpose()
}

/// What a whole recording says; with the fits of the laws if `laws`, and one can be learnt. `None` if no force was measured, or the scene can't be built.
#[must_use]
pub fn sample(
    recording: &Recording,
    name: &str,
    scene: &Scene,
    wanted: &[Wanted],
    by_pose: bool,
    laws: bool,
    watch: &mut dyn Watch,
) -> Option<Sample> {
    let begun = recording.aligned(scene);
    let readings = begun.readings(by_pose);
    let depth_m = depths(&Twin::new(scene).ok()?, &readings);
    let times: Vec<f64> = readings.iter().map(|r| r.time_s).collect();
    let measured = crate::forecast::measured(&begun, scene, &times);
    let (depth_m, measured_n): (Vec<f64>, Vec<f64>) = measured.iter().map(|&(i, n)| (depth_m[i], n)).unzip();
    let curve = Curve::averaged(&depth_m, &measured_n);
    let open = laws && learnt_law::is_open(scene, wanted);
    let fits = open.then(|| learnt_law::fits(recording, scene, wanted, LoadCell::Offset, by_pose, watch).ok());
    (!curve.depth_m.is_empty()).then(|| Sample {
        name: name.to_owned(),
        scene: scene.name.clone(),
        curve,
        fits: fits.flatten(),
    })
}
