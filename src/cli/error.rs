//! Why a command failed.

use std::io;
use std::path::PathBuf;

use needle_core::scene::SceneError;
use needle_core::twin::BuildError;
use needle_estimate::batch::{ManifestError, MergeError};
use needle_estimate::calibrate::CalibrateError;
use needle_estimate::compare::ensemble::EnsembleError;
use needle_estimate::layers::LayersError;
use needle_estimate::plan::PlanError;
use needle_estimate::prior::PriorError;
use needle_recording::RecordingError;
use needle_report::ReportError;
use needle_studies::accuracy::StudyError;
use needle_studies::sensitivity::RunsError;
use needle_studies::speed::SpeedError;
#[cfg(feature = "ros")]
use ros2_node::start::NodeError;
use rosbag2_mcap::BagError;

/// Why a command failed: what, where, what to do. Printed once, at the edge.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub(crate) enum CliError {
    /// The scene is wrong.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The twin of a scene can't be built.
    #[error("scene {scene} can't be discretised: {source}")]
    Build {
        /// Its name.
        scene: String,
        /// Why.
        source: BuildError,
    },
    /// There is no plan.
    #[error("no plan: {0}")]
    Plan(Box<PlanError>),
    /// A sample that has no simple shape needs a file for its surface.
    #[error("the sample of scene {scene} is a mesh: say with --mesh FILE.stl where its surface is to be written")]
    NoMeshFile {
        /// Its name.
        scene: String,
    },
    /// A scene has no motion of its own.
    #[error("scene {scene} has no [motion] of its own; give --depth-m (and --speed-m-per-s, --pose-hz)")]
    NoMotion {
        /// Its name.
        scene: String,
    },
    /// No time series with that interval.
    #[error(
        "--save-every {every}: a positive number of seconds is needed, for this motion at least {shortest:.3} (2000 files)"
    )]
    SaveEvery {
        /// What was asked for, s.
        every: f64,
        /// Shortest interval, s.
        shortest: f64,
    },
    /// The bag can't be read.
    #[error("{source}{}", bag_remedy(.source))]
    Bag {
        /// What is wrong with it.
        #[from]
        source: BagError,
    },
    /// The recording can't be read.
    #[error("{}", recording_error(.0))]
    Recording(#[from] RecordingError),
    /// The recording can hardly be one of the scene.
    #[error("{0}. Nothing was run; go on all the same with --force")]
    Mistaken(String),
    /// A study can't be run.
    #[error("study: {0}")]
    Study(#[from] StudyError),
    /// A model can't be timed.
    #[error("study speed: {0}")]
    Speed(#[from] SpeedError),
    /// Nothing can be fitted.
    #[error("calibrate: {0}")]
    Calibrate(#[from] CalibrateError),
    /// A recording says nothing of layers.
    #[error("calibrate --layers: {0}")]
    Layers(#[from] LayersError),
    /// There is no ensemble.
    #[error("--members: {0}")]
    Ensemble(#[from] EnsembleError),
    /// [`RunsError`]
    #[error(transparent)]
    Sensitivity(#[from] RunsError),
    /// A manifest can't be used.
    #[error(transparent)]
    Manifest(#[from] ManifestError),
    /// Rows can't be put together.
    #[error(transparent)]
    Merge(#[from] MergeError),
    /// The output can't be written.
    #[error(transparent)]
    Report(#[from] ReportError),
    /// What earlier recordings have taught can't be read or written.
    #[error("prior {0}")]
    Prior(#[from] PriorError),
    /// The threads can't be started.
    #[error("can't start {threads} threads: {source}; give fewer with --threads")]
    Threads {
        /// How many were wanted.
        threads: usize,
        /// Why.
        source: rayon::ThreadPoolBuildError,
    },
    /// Some of several scenes are wrong; each has been named.
    #[error("{bad} of {all} scenes can't be used")]
    ScenesRefused {
        /// How many are wrong.
        bad: usize,
        /// How many there are.
        all: usize,
    },
    /// A bag breaks rules that readers rely on; each has been named.
    #[error("{}: {errors} errors: some readers will refuse this bag or believe something false", .bag.display())]
    BagRefused {
        /// The bag.
        bag: PathBuf,
        /// How many.
        errors: usize,
    },
    /// A ROS 2 node can't be started or reached.
    #[cfg(feature = "ros")]
    #[error(transparent)]
    Node(#[from] NodeError),
    /// The demo can't be played.
    #[cfg_attr(not(feature = "ros"), allow(dead_code, reason = "made by commands that need ROS"))]
    #[error("demo: {0}")]
    Demo(String),
    /// A node that this program starts does not run.
    #[cfg_attr(not(feature = "ros"), allow(dead_code, reason = "made by commands that need ROS"))]
    #[error("{0}")]
    Nodes(String),
    /// What is for a report of a fault can't be written.
    #[error("{}: can't be written ({source}); give another file with --bundle", .path.display())]
    Bundle {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// stdout can't be written.
    #[error("stdout: {0}")]
    Stdout(io::Error),
}

fn recording_error(error: &RecordingError) -> String {
    let remedy = if let RecordingError::Bag(bag) = error { bag_remedy(bag) } else { "" };
    format!("{error}{remedy}")
}

/// What to do where there is no bag at all.
fn bag_remedy(error: &BagError) -> &'static str {
    match error {
        BagError::Open { source, .. } if source.kind() == io::ErrorKind::NotFound => {
            ". Name a rosbag2 folder or an .mcap file; `needle_twin bag make --scene needle_insertion --out DIR` makes one"
        }
        _ => "",
    }
}
