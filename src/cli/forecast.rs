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
use needle_estimate::compare::{Cancel, Curve, depths};
use needle_estimate::forecast::{self, Blind, Of, Prediction, default_keys};
use needle_estimate::learnt_law;
use needle_estimate::prior::{self, Prior, Sample};
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

    /// What other recordings teach: with three or more, a neo-Hookean scene gets a stiffening law that the whole of the others fit best, if
    /// it fits them much better, and what the twin still lacks there is added to its force
    #[arg(long, value_enum, default_value_t = Law::Learnt, help_heading = "Fit")]
    law: Law,

    /// What earlier recordings have taught, beside the ones given here
    #[arg(long, value_name = "FILE", help_heading = "Fit")]
    prior: Option<PathBuf>,

    /// Write what all recordings teach into this file, for --prior
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    write_prior: Option<PathBuf>,

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

pub(super) fn run(arguments: &Arguments) -> Result<Outcome, CliError> {
    let folder = arguments.out.as_deref().map(OutputFolder::prepare).transpose()?;
    let names = names(&arguments.recordings);
    let interrupt = Interrupt::listen();
    let cancel = interrupt.cancel();
    let bar = Bar::new(names.len() as u64, "recordings");
    let earlier = arguments.prior.as_deref().map(Prior::read).transpose()?.unwrap_or_default();
    let taught = arguments.threads.install(|| arguments.taught(&names, &earlier, cancel))?;
    if let Some(path) = &arguments.write_prior {
        let samples = earlier.samples.iter().chain(taught.iter().flatten()).cloned().collect();
        Prior { samples }.write(path)?;
    }
    let one = |(i, (path, name)): (usize, (&PathBuf, &String))| -> Result<Made, CliError> {
        let here = (0..taught.len()).filter(|k| *k != i).filter_map(|k| taught[k].as_ref());
        // its own rest teaches it nothing
        let itself = |sample: &&Sample| taught[i].as_ref().is_some_and(|own| own.curve == sample.curve);
        let others: Vec<&Sample> = earlier.samples.iter().filter(|sample| !itself(sample)).chain(here).collect();
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
        let selection = self.topics.selection(&self.sources);
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

    /// What the whole of each recording says; nothing where it teaches no other. Laws are fitted to some, evenly spread.
    fn taught(&self, names: &[String], earlier: &Prior, cancel: &Cancel) -> Vec<Option<Sample>> {
        let many = self.recordings.len();
        let stride = many.div_ceil(learnt_law::MOST);
        let one = |(i, path): (usize, &PathBuf)| -> Option<Sample> {
            let teaches = many + earlier.samples.len() > learnt_law::FEWEST && self.law == Law::Learnt;
            if !teaches && self.write_prior.is_none() {
                return None;
            }
            let recording = self.open(path).ok()?;
            let scene = self.scene_of(&recording).ok()?;
            let by_pose = self.topics.readings(&recording).iter().any(|r| matches!(r.at, At::Pose(_)));
            let (keys, laws) = (self.keys(&scene), i % stride == 0);
            prior::sample(&recording, &names[i], &scene, &keys, by_pose, laws, &mut cancel.clone())
        };
        self.recordings.par_iter().enumerate().map(one).collect()
    }

    fn made(&self, path: &Path, name: &str, others: &[&Sample], cancel: &Cancel) -> Made {
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
        others: &[&Sample],
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
        let depths = depths(&twin, &readings);
        let blind =
            Blind::new(recording, &readings, &depths, self.fit_to, self.of.into()).map_err(|e| e.to_string())?;
        let known = blind.recording().aligned(&scene).measured();
        if known.is_empty() {
            return Err(format!("no force was measured up to {}", blind.words));
        }
        // the part that may be looked at
        let shown: Vec<_> = readings.iter().copied().take_while(|r| r.time_s <= blind.cut_s).collect();
        if let Some(what) = mistaken(&twin, &shown, &known, Some(blind.recording())).filter(|_| !self.force) {
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
        let alike = || others.iter().filter(|taught| taught.scene == scene.name && self.law == Law::Learnt).copied();
        let curves: Vec<&Curve> = alike().map(|taught| &taught.curve).collect();
        let taught = prior::law(&alike().collect::<Vec<_>>(), &scene, &keys).map_err(|e| e.to_string())?;
        let mut scene = scene.clone();
        if let Some(taught) = taught {
            made.law = Some(taught.words);
            (scene, keys) = (taught.scene, taught.wanted);
        }
        let mut watch = cancel.clone();
        // the tissue's relaxation would be taken for a drift, and carried on
        let load_cell = LoadCell::Offset;
        forecast::predict(&blind, &scene, &keys, load_cell, by_pose, &curves, &mut watch, &mut |_| {})
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
    let mut lines = needle_report::forecast_lines(all);
    lines.extend(files.first().map(|first| ("files", written(first, files))));
    screen(&lines)
}
