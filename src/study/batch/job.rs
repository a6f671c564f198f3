//! One recording with every candidate.

use std::fs;
use std::path::{Path, PathBuf};

use xxhash_rust::xxh3::Xxh3;

use super::{Candidate, Curve, Entry, Fit, HeldOut, Key, Manifest, Row};
use crate::compare::{self, Answer, At, Collector, ForceSeries, Keep, Reading, Run, Watch};
use crate::input::Recording;
use crate::scene::{Override, Scene, file as scene_file};
use crate::study::calibrate::{Calibration, HoldOut, LoadCell, Task, calibrate};

/// Readings at the end of what was predicted whose mean is the force there.
const AT_THE_END: usize = 5;

/// Whether to end.
pub type Stop<'a> = &'a (dyn Fn() -> bool + Sync);

struct Quiet<'a>(Stop<'a>);

impl Watch for Quiet<'_> {
    fn progress(&mut self, _done: usize, _answer: Option<&Answer>) {}

    fn stop(&self) -> bool {
        (self.0)()
    }
}

/// A recording of a manifest.
#[derive(Clone, Copy, Debug)]
pub struct Job<'a> {
    /// The manifest.
    pub manifest: &'a Manifest,
    /// Which of its recordings.
    pub number: usize,
}

impl Job<'_> {
    /// What is said of it.
    #[must_use]
    pub fn entry(&self) -> &Entry {
        &self.manifest.recordings[self.number]
    }

    /// Name of its row.
    #[must_use]
    pub fn name(&self) -> &str {
        self.entry().name.as_deref().unwrap_or_default()
    }

    fn files(&self) -> Vec<PathBuf> {
        let entry = self.entry();
        entry.file.iter().chain(&entry.force_file).map(PathBuf::from).collect()
    }

    /// The scene with the changes of the entry and of a candidate.
    fn scene(&self, candidate: &Candidate, recording: Option<&Recording>) -> Result<Scene, String> {
        let named = self.entry().scene.as_deref().or_else(|| recording.and_then(|r| r.scene.as_deref()));
        let name = named.ok_or("no scene: name one in the manifest")?;
        let beside = self.manifest.folder.join(name);
        let path = if beside.is_file() { beside.to_string_lossy().into_owned() } else { name.to_owned() };
        let scene = scene_file::load(&path).map_err(|e| e.to_string())?;
        let texts = self.entry().set.iter().flatten().chain(&candidate.set);
        let changes = texts.map(|text| Override::parse(text, "set")).collect::<Result<Vec<_>, _>>();
        let changes = changes.map_err(|e| e.to_string())?;
        if changes.is_empty() { Ok(scene) } else { scene.with(&changes).map_err(|e| e.to_string()) }
    }

    /// Hash of all that the row depends on: what the manifest says, the files' bytes, the scenes, and the version.
    #[must_use]
    pub fn fingerprint(&self) -> String {
        let mut hash = Xxh3::new();
        let mut add = |bytes: &[u8]| {
            hash.update(&(bytes.len() as u64).to_le_bytes());
            hash.update(bytes);
        };
        add(crate::WRITER.as_bytes());
        // of the same file in another folder the row is the same
        let said = Entry { file: None, force_file: None, scene: None, ..self.entry().clone() };
        add(&serde_json::to_vec(&said).unwrap_or_default());
        add(&serde_json::to_vec(&self.manifest.candidates).unwrap_or_default());
        add(format!("{} of {}", self.number, self.manifest.recordings.len()).as_bytes());
        for file in self.files() {
            add_file(&file, &mut add);
        }
        for candidate in &self.manifest.candidates {
            let scene = self.scene(candidate, None).map_or_else(|e| e, |scene| scene.to_toml());
            add(scene.as_bytes());
        }
        format!("{:032x}", hash.digest128())
    }

    /// The row: what fails is said in it.
    #[must_use]
    pub fn run(&self, stop: Stop) -> Row {
        let entry = self.entry();
        let sample = entry.sample.clone().unwrap_or_default();
        let row = Row {
            number: self.number,
            of: self.manifest.recordings.len(),
            name: self.name().to_owned(),
            group: entry.group.clone().unwrap_or_else(|| sample.clone()),
            sample,
            fingerprint: self.fingerprint(),
            failed: None,
            losses: Vec::new(),
            fits: Vec::new(),
        };
        let recording = match Recording::open(&self.files(), &entry.selection()) {
            Ok(recording) => recording,
            Err(error) => return Row { failed: Some(error.to_string()), ..row },
        };
        let losses = recording.losses.iter().map(ToString::to_string).collect();
        let fits: Vec<Fit> = self.manifest.candidates.iter().map(|c| self.fit(c, &recording, stop)).collect();
        // every candidate failed: so did the recording
        let failed = fits.iter().all(|fit| fit.failed.is_some()).then(|| fits.first()?.failed.clone()).flatten();
        Row { failed, losses, fits, ..row }
    }

    fn fit(&self, candidate: &Candidate, recording: &Recording, stop: Stop) -> Fit {
        self.tried(candidate, recording, stop).unwrap_or_else(|reason| Fit {
            candidate: candidate.name.clone(),
            scene: String::new(),
            failed: Some(reason),
            explains: "no measurement".to_owned(),
            reduced_chi_square: None,
            reasons: Vec::new(),
            keys: Vec::new(),
            contact_depth_m: 0.0,
            force_zero_n: 0.0,
            peak_n: 0.0,
            rmse_n: None,
            held_out: None,
            curve: Curve::default(),
        })
    }

    fn tried(&self, candidate: &Candidate, recording: &Recording, stop: Stop) -> Result<Fit, String> {
        let scene = self.scene(candidate, Some(recording))?;
        let entry = self.entry();
        let wanted = entry.wanted(candidate)?;
        let readings = readings(recording, entry.to_depth_m);
        let measured = ForceSeries::new(recording.forces.iter().map(|s| (s.time_s, s.force_n)).collect());
        let measured = measured.on_one_clock(recording.one_clock);
        let mut watch = Quiet(stop);
        let twin = compare::build(&scene).map_err(|e| e.to_string())?;
        if let Some(what) = compare::scale::mistaken(&twin.0, &readings, &measured, recording.scene.as_deref()) {
            return Err(what);
        }
        if wanted.is_empty() {
            let collector = Collector::new(&twin.0, "batch", 0.0, Keep::ANSWERS);
            let mut twin = twin.0;
            let run = compare::drive(&mut twin, readings, Some(&measured), collector, &mut watch);
            return if stop() { Err("interrupted".to_owned()) } else { Ok(replayed(candidate, &run)) };
        }
        let task = Task {
            scene: &scene,
            readings: &readings,
            measured: &measured,
            wanted: &wanted,
            load_cell: load_cell(entry.load_cell.as_deref())?,
            force_error: compare::uncertainty::FORCE_ERROR,
            part: entry.fit_to_depth_m.map_or(HoldOut::Nothing, HoldOut::Beyond),
        };
        let found = calibrate(&task, &mut watch, &mut |_| {}).map_err(|e| e.to_string())?;
        Ok(calibrated(candidate, &found, &readings))
    }
}

fn load_cell(word: Option<&str>) -> Result<LoadCell, String> {
    match word {
        None | Some("drift") => Ok(LoadCell::Drift),
        Some("offset") => Ok(LoadCell::Offset),
        Some("exact") => Ok(LoadCell::Exact),
        Some(other) => Err(format!("load_cell = \"{other}\": drift, offset or exact")),
    }
}

/// The content of a file, or of the files of a bag's folder.
fn add_file(path: &Path, add: &mut impl FnMut(&[u8])) {
    let mut inside: Vec<PathBuf> = fs::read_dir(path).into_iter().flatten().flatten().map(|e| e.path()).collect();
    inside.sort();
    let files = if inside.is_empty() { vec![path.to_owned()] } else { inside };
    files.iter().for_each(|file| add(&fs::read(file).unwrap_or_default()));
}

/// The motion up to the first reading beyond a depth.
fn readings(recording: &Recording, to_depth_m: Option<f64>) -> Vec<Reading> {
    if recording.depths.is_empty() {
        return recording.poses.iter().map(|s| Reading { time_s: s.time_s, at: At::Pose(s.pose()) }).collect();
    }
    let most = to_depth_m.unwrap_or(f64::INFINITY);
    let kept = recording.depths.iter().take_while(|s| s.depth_m <= most);
    kept.map(|s| Reading { time_s: s.time_s, at: At::Depth(s.depth_m) }).collect()
}

fn replayed(candidate: &Candidate, run: &Run) -> Fit {
    let verdict = run.verdict();
    let aligned = run.alignment().unwrap_or_default();
    let rows = compare::rows::Rows::of(run);
    Fit {
        candidate: candidate.name.clone(),
        scene: run.scene.clone(),
        failed: run.diverged.clone(),
        explains: verdict.explains.as_str().to_owned(),
        reduced_chi_square: verdict.reduced_chi_square,
        reasons: verdict.reasons,
        keys: Vec::new(),
        contact_depth_m: aligned.contact_depth_m.value,
        force_zero_n: rows.zero_n,
        peak_n: rows.measured_n.iter().map(|f| f.abs()).fold(0.0, f64::max),
        rmse_n: run.force_metrics().rmse_n,
        held_out: None,
        curve: Curve::of(&rows.depth_m, &rows.measured_n, &rows.predicted_n),
    }
}

/// Recorded depth at a time since the first reading, m: a calibration that has moved the contact has it in its own depths.
fn recorded_depth(readings: &[Reading], time_s: f64) -> f64 {
    let begin = readings.first().map_or(0.0, |r| r.time_s);
    let depth = |r: &Reading| if let At::Depth(depth_m) = r.at { depth_m } else { 0.0 };
    let next = readings.partition_point(|r| r.time_s - begin < time_s).clamp(1, readings.len().max(2) - 1);
    let (Some(a), Some(b)) = (readings.get(next - 1), readings.get(next)) else { return 0.0 };
    let share = ((time_s - (a.time_s - begin)) / (b.time_s - a.time_s)).clamp(0.0, 1.0);
    depth(a) + share * (depth(b) - depth(a))
}

fn calibrated(candidate: &Candidate, found: &Calibration, readings: &[Reading]) -> Fit {
    let keys = found.estimates[..found.keys].iter().map(|e| Key {
        key: e.name.clone(),
        value: e.value,
        standard_error: e.standard_error(),
        noise_error: e.noise_error,
    });
    let aligned = found.alignment.unwrap_or_default();
    // what was not taken out of the recording is not taken off its depths
    let contact = if found.realigned[0] { aligned.contact_depth_m.value } else { 0.0 };
    let forces = &found.forces;
    // the load cell's zero and drift, as they were found
    let less_zero: Vec<f64> =
        (0..forces.model_n.len()).map(|i| forces.measured_n[i] - (forces.fitted_n[i] - forces.model_n[i])).collect();
    let recorded: Vec<f64> = forces.time_s.iter().map(|t| recorded_depth(readings, *t)).collect();
    let depth: Vec<f64> = recorded.iter().map(|d| d - contact).collect();
    let peak_n = less_zero[found.parts.fitted.clone()].iter().map(|f| f.abs()).fold(0.0, f64::max);
    let mean = |of: &[f64], end: usize| {
        let from = end.saturating_sub(AT_THE_END);
        of[from..end].iter().sum::<f64>() / (end - from).max(1) as f64
    };
    let held_out = found.parts.held_out.clone().filter(|held| !held.is_empty()).map(|held| HeldOut {
        rmse_n: found.held_out_rmse_n().unwrap_or(0.0),
        end_depth_m: mean(&recorded, held.end),
        end_measured_n: mean(&less_zero, held.end),
        end_predicted_n: mean(&forces.model_n, held.end),
    });
    Fit {
        candidate: candidate.name.clone(),
        scene: found.scene.name.clone(),
        failed: None,
        explains: found.verdict.explains.as_str().to_owned(),
        reduced_chi_square: found.verdict.reduced_chi_square,
        reasons: found.verdict.reasons.clone(),
        keys: keys.collect(),
        contact_depth_m: contact,
        force_zero_n: less_zero.first().map_or(0.0, |f| forces.measured_n[0] - f),
        peak_n,
        rmse_n: Some(found.rmse_n()),
        held_out,
        curve: Curve::of(&depth, &less_zero, &forces.model_n),
    }
}
