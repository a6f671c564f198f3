//! Runs one recording with every candidate.

use std::fs;
use std::path::{Path, PathBuf};

use xxhash_rust::xxh3::Xxh3;

use super::fit::{calibrated, replayed};
use super::tables::Content;
use super::{Candidate, Entry, Fit, Manifest, Needed, Row, Tables};
use crate::calibrate::{CurveTable, HoldOut, LoadCell, Task, Wanted, calibrate};
use crate::compare::{self, Cancel, Curve, Keep, Session};
use needle_core::scene::{Override, Scene, file as scene_file};
use needle_core::twin::Twin;
use needle_recording::Recording;
use needle_recording::{At, ForceSeries, Reading};

/// One recording of a manifest.
#[derive(Clone, Copy, Debug)]
pub struct Job<'a> {
    /// The manifest.
    pub manifest: &'a Manifest,
    /// Index of the recording in the manifest.
    pub number: usize,
    /// Curves that the recordings share.
    pub tables: &'a Tables,
}

impl<'a> Job<'a> {
    /// The manifest's entry for this recording.
    #[must_use]
    pub(crate) fn entry(&self) -> &Entry {
        &self.manifest.recordings[self.number]
    }

    /// Name of its row.
    #[must_use]
    pub fn name(&self) -> &str {
        self.entry().name.as_deref().unwrap_or_default()
    }

    pub(super) fn files(&self) -> Vec<PathBuf> {
        let entry = self.entry();
        entry.file.iter().chain(&entry.force_file).map(PathBuf::from).collect()
    }

    /// The scene, with the changes of the entry and of a candidate applied.
    pub(super) fn scene(&self, candidate: &Candidate, recording: Option<&Recording>) -> Result<Scene, String> {
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

    /// Hash of everything that the row depends on: the manifest's entry, the bytes of the files, the scenes and the
    /// version.
    #[must_use]
    pub fn fingerprint(&self) -> String {
        let mut hash = Xxh3::new();
        let mut add = |bytes: &[u8]| {
            hash.update(&(bytes.len() as u64).to_le_bytes());
            hash.update(bytes);
        };
        add(needle_core::WRITER.as_bytes());
        // the row must not depend on the folder that a file is in
        let said = Entry { file: None, force_file: None, scene: None, ..self.entry().clone() };
        add(&serde_json::to_vec(&said).unwrap_or_default());
        add(&serde_json::to_vec(&self.manifest.candidates).unwrap_or_default());
        add(format!("{} of {}", self.number, self.manifest.recordings.len()).as_bytes());
        for file in self.files() {
            add_file(&file, &mut add);
        }
        for candidate in &self.manifest.candidates {
            let scene = self.scene(candidate, None);
            add(scene.as_ref().map_or_else(String::clone, Scene::to_toml).as_bytes());
            add(scene.map_or_else(|_| String::new(), |scene| scene.sample.mesh_digest()).as_bytes());
        }
        format!("{:032x}", hash.digest128())
    }

    /// Computes the row. Failures are recorded in the row.
    #[must_use]
    pub fn run(&self, cancel: &Cancel) -> Row {
        let entry = self.entry();
        let sample = entry.sample.clone().unwrap_or_default();
        let group = entry.group.clone().unwrap_or_else(|| sample.clone());
        let row = Row {
            number: self.number,
            of: self.manifest.recordings.len(),
            name: self.name().to_owned(),
            chosen_for: entry.chosen_for.clone().unwrap_or_else(|| group.clone()),
            group,
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
        let fits: Vec<Fit> = self.manifest.candidates.iter().map(|c| self.fit(c, &recording, cancel)).collect();
        // if every candidate failed, the recording failed
        let failed = fits.iter().all(|fit| fit.failed.is_some()).then(|| fits.first()?.failed.clone()).flatten();
        Row { failed, losses, fits, ..row }
    }

    /// What identifies the table of curves for a candidate; `None` if the twin is to be run instead.
    fn curves(&self, candidate: &Candidate) -> Result<Option<Content>, String> {
        Content::of(self.entry(), candidate, || self.scene(candidate, None))
    }

    fn fit(&self, candidate: &Candidate, recording: &Recording, cancel: &Cancel) -> Fit {
        self.tried(candidate, recording, cancel).unwrap_or_else(|reason| Fit {
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
            forward_error: None,
            runs: 0,
            held_out: None,
            standing: None,
            curve: Curve::default(),
        })
    }

    /// Prepares the recording for a candidate's fit. The error describes what is wrong with the recording.
    pub(super) fn prepared(&self, candidate: &Candidate, recording: &Recording) -> Result<Prepared<'a>, String> {
        let entry = self.entry();
        let scene = self.scene(candidate, Some(recording))?;
        let recording = recording.aligned(&scene);
        let prepared = Prepared {
            scene,
            wanted: entry.wanted(candidate)?,
            readings: readings(&recording, entry.to_depth_m),
            measured: recording.measured(),
            load_cell: load_cell(entry.load_cell.as_deref())?,
            part: entry.fit_to_depth_m.map_or(HoldOut::Nothing, HoldOut::Beyond),
            table: self.curves(candidate)?.map(|content| self.tables.of(&content)).transpose()?,
        };
        prepared.table.map_or(Ok(()), |table| table.covers(&prepared.readings))?;
        Ok(prepared)
    }

    fn tried(&self, candidate: &Candidate, recording: &Recording, cancel: &Cancel) -> Result<Fit, String> {
        let prepared = self.prepared(candidate, recording)?;
        let Prepared { scene, readings, measured, .. } = &prepared;
        let mut watch = cancel.clone();
        // with a table, the unit checks give the same result for every candidate
        let first = self.manifest.candidates.first().is_none_or(|first| first.name == candidate.name);
        let looked_at = prepared.table.is_none() || first;
        let session =
            looked_at.then(|| Session::new(scene, "batch", Keep::ANSWERS).map_err(|e| e.to_string())).transpose()?;
        let untared = |twin: &Twin| compare::scale::untared(twin, readings, measured);
        let mistaken = |session: &Session| {
            let twin = session.twin();
            let found = compare::scale::mistaken(twin, readings, measured, Some(recording));
            // a fit finds the load cell's zero
            found.or_else(|| untared(twin).filter(|_| prepared.wanted.is_empty()))
        };
        if let Some(what) = session.as_ref().and_then(mistaken) {
            return Err(what);
        }
        if let (Some(session), true) = (session, prepared.wanted.is_empty()) {
            let run = session.compared_with(measured).run(readings.iter().copied(), &mut watch).run;
            return if cancel.is_cancelled() { Err("interrupted".to_owned()) } else { Ok(replayed(candidate, &run)) };
        }
        let found = calibrate(&prepared.task(), &mut watch, &mut |_| {}).map_err(|e| e.to_string())?;
        let fit = calibrated(candidate, &found, readings);
        let Some(from_m) = self.entry().choose_from_depth_m else { return Ok(fit) };
        // the choice must not use readings deeper than the fitted part
        let fitted: Vec<Reading> =
            self::readings(&recording.aligned(scene), self.entry().fit_to_depth_m.or(self.entry().to_depth_m));
        let task = Task { readings: &fitted, part: HoldOut::Beyond(from_m), ..prepared.task() };
        let found = calibrate(&task, &mut watch, &mut |_| {}).map_err(|e| e.to_string())?;
        let forward = found.held_out_rmse_n().map(|rmse| rmse / fit.peak_n).filter(|x| x.is_finite());
        Ok(Fit { forward_error: forward, runs: fit.runs + found.runs, ..fit })
    }
}

impl Needed {
    /// Collects the tables that some jobs need.
    #[must_use]
    pub fn of(jobs: &[Job]) -> Self {
        let mut needed = Self::default();
        for job in jobs {
            // an invalid entry is reported in its row
            let contents = job.manifest.candidates.iter().filter_map(|candidate| job.curves(candidate).ok()?);
            contents.for_each(|content| needed.add(&content));
        }
        needed
    }
}

/// A recording, prepared for the fit of one candidate.
pub(super) struct Prepared<'a> {
    scene: Scene,
    wanted: Vec<Wanted>,
    readings: Vec<Reading>,
    measured: ForceSeries,
    load_cell: LoadCell,
    part: HoldOut,
    table: Option<&'a CurveTable>,
}

impl Prepared<'_> {
    pub(crate) fn task(&self) -> Task<'_> {
        Task {
            scene: &self.scene,
            readings: &self.readings,
            measured: &self.measured,
            wanted: &self.wanted,
            load_cell: self.load_cell,
            force_error: compare::uncertainty::FORCE_ERROR,
            part: self.part,
            table: self.table,
        }
    }
}

fn load_cell(word: Option<&str>) -> Result<LoadCell, String> {
    match word {
        None | Some("drift") => Ok(LoadCell::Drift),
        Some("auto") => Ok(LoadCell::Auto),
        Some("offset") => Ok(LoadCell::Offset),
        Some("exact") => Ok(LoadCell::Exact),
        Some(other) => Err(format!("load_cell = \"{other}\": auto, drift, offset or exact")),
    }
}

/// Feeds the content of a file, or of all files in a bag's folder, to `add`.
fn add_file(path: &Path, add: &mut impl FnMut(&[u8])) {
    let mut inside: Vec<PathBuf> = fs::read_dir(path).into_iter().flatten().flatten().map(|e| e.path()).collect();
    inside.sort();
    let files = if inside.is_empty() { vec![path.to_owned()] } else { inside };
    files.iter().for_each(|file| add(&fs::read(file).unwrap_or_default()));
}

/// The motion up to the first reading beyond a depth.
fn readings(recording: &Recording, to_depth_m: Option<f64>) -> Vec<Reading> {
    let most = to_depth_m.unwrap_or(f64::INFINITY);
    let within = |r: &Reading| if let At::Depth(depth_m) = r.at { depth_m <= most } else { true };
    recording.readings(false).into_iter().take_while(within).collect()
}
