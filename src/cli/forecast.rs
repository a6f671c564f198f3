//! `needle_twin forecast`: twin and baselines fitted to the first part of recordings, against the measured rest.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use rayon::prelude::*;

use super::interrupt::Interrupt;
use super::options::{SetOptions, ThreadOptions};
use super::output::OutputFolder;
use super::progress::Bar;
use super::recorded::{DEFAULT_SCENE, SourceOptions, TopicOptions};
use super::summary::{screen, written};
use super::{CliError, Outcome, print, scene_file, warn};
use needle_core::scene::Scene;
use needle_core::twin::Twin;
use needle_estimate::calibrate::{LoadCell, Wanted};
use needle_estimate::compare::scale::mistaken;
use needle_estimate::compare::{Cancel, Curve};
use needle_estimate::forecast::{self, Blind, Of, Prediction, default_keys};
use needle_estimate::learnt_law::{self, Fits};
use needle_recording::{At, Recording};
use needle_report::{Forecasted, forecast_json};

/// Fit twin and baselines (spring, exponential, ...) to the first part of recordings and predict the rest, blind: the measured rest
/// is read after the prediction is written
///
/// The table says for each recording the error of the twin and of every baseline over the same readings, and whether the twin is
/// better. With several recordings of one scene, the mean curve of the others is a baseline too.
#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// rosbag2 folders, .mcap files or tables (CSV, TSV, .xlsx, .npy, .npz)
    #[arg(value_name = "RECORDING", required = true)]
    recordings: Vec<PathBuf>,

    /// Share of the depth, time or number of insertions that is fitted
    #[arg(long, value_name = "SHARE", default_value_t = 0.5, value_parser = inner_share, help_heading = "Fit")]
    fit_to: f64,

    /// What the share is of
    #[arg(long, value_enum, default_value_t = Whole::Depth, help_heading = "Fit")]
    of: Whole,

    /// Key to fit, with bounds where the key's own range is too wide (may be repeated) [default: material.shear_modulus_pa; friction
    /// and cutting force too of a needle with friction]
    #[arg(long, value_name = "KEY[=LOW..HIGH]", num_args = 1.., value_parser = Wanted::parse, help_heading = "Fit")]
    fit: Vec<Wanted>,

    /// Preset or scene file [default: the one that the bag names, needle_insertion if it names none]
    #[arg(long, value_name = "NAME|FILE", help_heading = "Scene")]
    scene: Option<String>,

    #[command(flatten)]
    set: SetOptions,

    #[command(flatten)]
    topics: TopicOptions,

    #[command(flatten)]
    sources: SourceOptions,

    /// Where the law of tissue comes from: with three recordings or more, a neo-Hookean scene gets a stiffening law that the whole of the
    /// other recordings fit best, if it fits them much better
    #[arg(long, value_enum, default_value_t = Law::Learnt, help_heading = "Fit")]
    law: Law,

    /// Go on where units, signs or scene of a recording look wrong
    #[arg(long, help_heading = "Run")]
    force: bool,

    #[command(flatten)]
    threads: ThreadOptions,

    /// Write NAME.csv of each recording before its rest is read, then NAME.svg, forecast.csv and forecast.json into this folder
    #[arg(long, value_name = "DIR", help_heading = "Output")]
    out: Option<PathBuf>,

    /// Print forecast.json instead of a summary
    #[arg(long, help_heading = "Output")]
    json: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Law {
    /// Learnt from the other recordings
    Learnt,
    /// The scene's own
    Scene,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Whole {
    /// The deepest depth
    Depth,
    /// The time from the first reading to the last
    Time,
    /// The number of insertions
    Insertion,
}

impl From<Whole> for Of {
    fn from(whole: Whole) -> Self {
        match whole {
            Whole::Depth => Self::Depth,
            Whole::Time => Self::Time,
            Whole::Insertion => Self::Insertion,
        }
    }
}

fn inner_share(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|x| *x > 0.0 && *x < 1.0);
    number.ok_or_else(|| "a share between 0 and 1, as 0.5".to_owned())
}

/// A recording whose rest has not been read.
struct Made {
    name: String,
    scene: String,
    law: Option<String>,
    prediction: Result<Prediction, String>,
    losses: Vec<String>,
}

/// What the whole of a recording says of laws, and the scene it is of.
struct Taught {
    scene: String,
    fits: Fits,
}

pub(super) fn run(arguments: &Arguments) -> Result<Outcome, CliError> {
    let folder = arguments.out.as_deref().map(OutputFolder::prepare).transpose()?;
    let names = names(&arguments.recordings);
    let interrupt = Interrupt::listen();
    let cancel = interrupt.cancel();
    let bar = Bar::new(names.len() as u64, "recordings");
    let taught = arguments.threads.install(|| arguments.taught(cancel))?;
    let one = |(i, (path, name)): (usize, (&PathBuf, &String))| -> Result<Made, CliError> {
        let others: Vec<&Taught> = (0..taught.len()).filter(|k| *k != i).filter_map(|k| taught[k].as_ref()).collect();
        let made = arguments.made(path, name, &others, cancel);
        if let (Some(folder), Ok(prediction)) = (&folder, &made.prediction) {
            needle_report::write_prediction(&folder.path, name, prediction)?;
        }
        bar.add(1, name);
        Ok(made)
    };
    let made = arguments.threads.install(|| {
        arguments.recordings.par_iter().zip(&names).enumerate().map(one).collect::<Result<Vec<Made>, CliError>>()
    })??;
    bar.finish();
    if cancel.is_cancelled() {
        warn("interrupted: the forecasts made so far are in --out, and nothing was compared");
        return Ok(Outcome::Lossy);
    }
    let judged = arguments.judged(made)?;
    let json = forecast_json(&judged, arguments.fit_to, &arguments.of.word());
    let files = match &folder {
        Some(folder) => needle_report::write_forecast(&folder.path, &judged, &json)?,
        None => Vec::new(),
    };
    let mut complete = true;
    for one in &judged {
        let failed = one.failed.iter().map(|reason| format!("{}: {reason}", one.name));
        let lost = one.losses.iter().map(|loss| format!("{}: {loss}", one.name));
        for text in failed.chain(lost) {
            complete = false;
            warn(&text);
        }
    }
    print(&if arguments.json { json } else { summary(&judged, &files) })?;
    Ok(if complete { Outcome::Complete } else { Outcome::Lossy })
}

/// The files' names without folder and ending; equal ones are numbered.
fn names(recordings: &[PathBuf]) -> Vec<String> {
    let mut seen = BTreeMap::<String, usize>::new();
    let name = |path: &PathBuf| {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let count = seen.entry(stem.clone()).and_modify(|n| *n += 1).or_insert(1);
        if *count == 1 { stem } else { format!("{stem}_{count}") }
    };
    recordings.iter().map(name).collect()
}

impl Whole {
    fn word(self) -> String {
        self.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
    }
}

impl Arguments {
    fn open(&self, path: &Path) -> Result<Recording, String> {
        let selection = self.sources.selection(self.topics.names());
        Recording::open(&[path.to_owned()], &selection).map_err(|e| CliError::from(e).to_string())
    }

    /// Scene of a recording.
    fn scene_of(&self, recording: &Recording) -> Result<Scene, String> {
        let name = self.scene.as_deref().or(recording.scene.as_deref()).unwrap_or(DEFAULT_SCENE);
        let scene = scene_file::load(name).map_err(|e| e.to_string())?;
        self.set.apply(&scene, []).map_err(|e| e.to_string())
    }

    fn keys(&self, scene: &Scene) -> Vec<Wanted> {
        if self.fit.is_empty() { default_keys(scene) } else { self.fit.clone() }
    }

    /// What the whole of each recording says of laws; nothing of those that can't be fitted, or where no law is to be learnt.
    fn taught(&self, cancel: &Cancel) -> Vec<Option<Taught>> {
        let many = self.recordings.len();
        let stride = many.div_ceil(learnt_law::MOST);
        let one = |(i, path): (usize, &PathBuf)| -> Option<Taught> {
            if self.law == Law::Scene || many <= learnt_law::FEWEST || i % stride != 0 {
                return None;
            }
            let recording = self.open(path).ok()?;
            let scene = self.scene_of(&recording).ok()?;
            let keys = self.keys(&scene);
            if !learnt_law::is_open(&scene, &keys) {
                return None;
            }
            let by_pose = self.topics.readings(&recording).iter().any(|r| matches!(r.at, At::Pose(_)));
            let fits =
                learnt_law::fits(&recording, &scene, &keys, LoadCell::Offset, by_pose, &mut cancel.clone()).ok()?;
            Some(Taught { scene: scene.name, fits })
        };
        self.recordings.par_iter().enumerate().map(one).collect()
    }

    fn made(&self, path: &Path, name: &str, others: &[&Taught], cancel: &Cancel) -> Made {
        let mut made = Made {
            name: name.to_owned(),
            scene: String::new(),
            law: None,
            prediction: Err(String::new()),
            losses: Vec::new(),
        };
        made.prediction = self.predicted(path, &mut made, others, cancel);
        made
    }

    fn predicted(
        &self,
        path: &Path,
        made: &mut Made,
        others: &[&Taught],
        cancel: &Cancel,
    ) -> Result<Prediction, String> {
        let recording = self.open(path)?;
        made.losses.extend(recording.losses.iter().map(ToString::to_string));
        let scene = self.scene_of(&recording)?;
        scene.name.clone_into(&mut made.scene);
        let twin = Twin::new(&scene).map_err(|e| e.to_string())?;
        let begun = recording.aligned(&scene);
        let readings = self.topics.readings(&begun);
        let by_pose = readings.iter().any(|r| matches!(r.at, At::Pose(_)));
        let depth = |at: At| match at {
            At::Depth(depth_m) => depth_m,
            At::Pose(pose) => twin.depth_of(&pose),
        };
        let depths: Vec<f64> = readings.iter().map(|r| depth(r.at)).collect();
        let foreign = recording.scene.clone();
        let blind =
            Blind::new(recording, &readings, &depths, self.fit_to, self.of.into()).map_err(|e| e.to_string())?;
        let known = blind.recording().aligned(&scene).measured();
        if known.is_empty() {
            return Err(format!("no force was measured up to {}", blind.words));
        }
        // the part that may be looked at
        let shown: Vec<_> = readings.iter().copied().take_while(|r| r.time_s <= blind.cut_s).collect();
        if let Some(what) = mistaken(&twin, &shown, &known, foreign.as_deref()).filter(|_| !self.force) {
            return Err(format!("{what}; --force goes on all the same"));
        }
        drop(twin);
        let mut keys = self.keys(&scene);
        if keys.is_empty() {
            return Err(format!(
                "scene {} has no material.shear_modulus_pa: name the keys to fit with --fit",
                scene.name
            ));
        }
        let fits: Vec<&Fits> =
            others.iter().filter(|taught| taught.scene == scene.name).map(|taught| &taught.fits).collect();
        let (mut scene, mut samples) = (scene, Vec::new());
        if let Some(learnt) = learnt_law::learnt(&fits).filter(|_| learnt_law::is_open(&scene, &keys)) {
            made.law = Some(learnt.words());
            samples = learnt.samples(&scene).map_err(|e| e.to_string())?;
            keys = learnt.wanted(&keys, &scene);
            scene = learnt.scene(&scene).map_err(|e| e.to_string())?;
        }
        let mut watch = cancel.clone();
        // the tissue's relaxation would be taken for a drift, and carried on
        let load_cell = LoadCell::Offset;
        forecast::predict(&blind, &scene, &keys, load_cell, by_pose, &samples, &mut watch, &mut |_| {})
            .map_err(|e| e.to_string())
    }

    /// Reads the recordings once more, and compares.
    fn judged(&self, made: Vec<Made>) -> Result<Vec<Forecasted>, CliError> {
        let whole: Vec<Result<Recording, String>> = self.recordings.iter().map(|path| self.open(path)).collect();
        let curve = |(made, whole): (&Made, &Result<Recording, String>)| -> Option<Curve> {
            Some(made.prediction.as_ref().ok()?.judged(whole.as_ref().ok()?, &[]).curve)
        };
        let curves: Vec<Option<Curve>> = made.iter().zip(&whole).map(curve).collect();
        let scenes: Vec<String> = made.iter().map(|m| m.scene.clone()).collect();
        let judge = |(i, (made, whole)): (usize, (Made, Result<Recording, String>))| {
            let others: Vec<&Curve> = (0..curves.len())
                .filter(|k| *k != i && scenes[*k] == scenes[i])
                .filter_map(|k| curves[k].as_ref())
                .collect();
            let Made { name, scene, law, prediction, mut losses } = made;
            let mut one = Forecasted { name, scene, law, ..Forecasted::default() };
            match prediction.and_then(|prediction| Ok((whole?, prediction))) {
                Ok((whole, prediction)) => {
                    let judged = prediction.judged(&whole, &others);
                    losses.extend(prediction.losses.iter().cloned());
                    if judged.standing.is_none() {
                        losses.push("nothing was compared: no force was measured in the rest".to_owned());
                    }
                    one.made = Some((prediction, judged));
                }
                Err(reason) => one.failed = Some(reason),
            }
            Forecasted { losses, ..one }
        };
        Ok(made.into_iter().zip(whole).enumerate().map(judge).collect())
    }
}

fn summary(all: &[Forecasted], files: &[PathBuf]) -> String {
    let mut lines = Vec::new();
    for one in all {
        let Some((prediction, judged)) = &one.made else {
            lines.push(("failed", one.name.clone()));
            continue;
        };
        let found: Vec<String> = prediction.calibration.estimates[..prediction.calibration.keys]
            .iter()
            .map(|e| format!("{} {:.5e}", e.name, e.value))
            .collect();
        lines.push((
            "forecast",
            format!("{}, scene {}, after {}: {}", one.name, one.scene, prediction.words, found.join(", ")),
        ));
        lines.extend(one.law.iter().map(|law| ("law", law.clone())));
        if let Some(standing) = &judged.standing {
            let share = |n: f64| if judged.peak_n > 0.0 { 100.0 * n / judged.peak_n } else { 0.0 };
            let models: Vec<String> = std::iter::once(("twin", standing.twin_rmse_n))
                .chain(standing.baselines.iter().map(|b| (b.name.as_str(), b.rmse_n)))
                .map(|(name, rmse)| format!("{name} {:.1} %", share(rmse)))
                .collect();
            lines.push((
                "error",
                format!(
                    "{} of the peak {:.4} N (root mean square, {} readings)",
                    models.join(", "),
                    judged.peak_n,
                    standing.readings
                ),
            ));
            let coverage = judged
                .coverage
                .map_or_else(String::new, |c| format!("; its band holds {:.0} % of the readings", 1e2 * c));
            lines.push(("verdict", format!("{} than the best baseline{coverage}", against(standing))));
        }
    }
    if all.len() > 1 {
        lines.extend(needle_report::forecast_totals(all).into_iter().map(|line| ("all", line)));
    }
    lines.extend(files.first().map(|first| ("files", written(first, files))));
    screen(&lines)
}

fn against(standing: &needle_estimate::baseline::Standing) -> &'static str {
    use needle_estimate::baseline::Against;
    match standing.against() {
        Against::Better => "better",
        Against::AsGood => "no better and no worse",
        Against::Worse => "worse",
        Against::NoMeasurement => "not comparable",
    }
}
