//! The manifest of a batch: one entry per recording, with defaults, in TOML or CSV.

use std::fs;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::calibrate::Wanted;
use needle_recording::{Quantity, Selection, TableLayout, TopicNames, blocks, is_bag};

/// Why a manifest can't be used.
#[derive(Debug, thiserror::Error)]
#[error("{}: {reason}", .path.display())]
pub struct ManifestError {
    /// The manifest.
    pub path: PathBuf,
    /// What is wrong, and what to do.
    pub reason: String,
}

/// A candidate model: a set of changes to the scene.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Candidate {
    /// Its name in tables.
    pub name: String,
    /// Changes, `KEY=VALUE`.
    pub set: Vec<String>,
    /// Keys to identify, in addition to those of the recording.
    #[serde(default)]
    pub fit: Vec<String>,
}

/// Settings of one recording, or defaults for all.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Entry {
    /// Name of its row. Default: the name of the file.
    pub name: Option<String>,
    /// Bag or table, relative to the manifest's folder. `*` in a path component matches any text and gives one row
    /// per file.
    pub file: Option<String>,
    /// Table of the force, if it is a separate file.
    pub force_file: Option<String>,
    /// The sample. Recordings of one sample share its keys. `{name}`, `{folder}` and `{name:7}` (the first 7 letters)
    /// are replaced by parts of the file's path.
    pub sample: Option<String>,
    /// Kind of the sample.
    pub group: Option<String>,
    /// Kinds of samples for which one candidate is chosen jointly. Default: each group has its own choice.
    pub chosen_for: Option<String>,
    /// Scene file relative to the manifest's folder, or preset.
    pub scene: Option<String>,
    /// Changes of the scene, `KEY=VALUE`.
    pub set: Option<Vec<String>>,
    /// Keys to identify, `KEY` or `KEY=LOW..HIGH`. Without any, the recording is replayed.
    pub fit: Option<Vec<String>>,
    /// Which parameters of the load cell are estimated: `drift`, `offset` or `exact`.
    pub load_cell: Option<String>,
    /// Recorded depth up to which the model is fitted, m. The rest of the insertion is predicted.
    pub fit_to_depth_m: Option<f64>,
    /// Recorded depth up to which the recording is used, m.
    pub to_depth_m: Option<f64>,
    /// Depth from which the part up to `fit_to_depth_m` is predicted in order to choose among the candidates, m.
    pub choose_from_depth_m: Option<f64>,
    /// Source of the predicted forces: `runs` of the twin for each recording, or a `table` of curves that all
    /// recordings share.
    pub curves: Option<String>,
    /// Whether the recordings of a sample are also fitted jointly.
    pub together: Option<bool>,
    /// Topic or column of the depth.
    #[serde(alias = "position_topic")]
    pub position: Option<String>,
    /// Its unit.
    pub position_unit: Option<String>,
    /// 1 or -1.
    pub position_sign: Option<f64>,
    /// Recorded value of the position at first contact.
    pub position_zero: Option<f64>,
    /// Size of one recorded count of the position, in its unit.
    pub position_scale: Option<f64>,
    /// Topic or column of the force.
    #[serde(alias = "force_topic")]
    pub force: Option<String>,
    /// Its unit.
    pub force_unit: Option<String>,
    /// 1 or -1.
    pub force_sign: Option<f64>,
    /// Reading of the load cell without load, in its unit: one number, or x, y and z.
    pub force_zero: Option<Zero>,
    /// Delay of the force's stamps, s.
    pub time_offset_s: Option<f64>,
    /// Column of the time.
    pub time: Option<String>,
    /// Its unit.
    pub time_unit: Option<String>,
    /// Columns of the force's x, y and z.
    pub force_columns: Option<[String; 3]>,
    /// Columns of the tip's x, y and z, and of its quaternion x, y, z, w.
    pub pose_columns: Option<Vec<String>>,
    /// Rotates the force from the sensor's frame into the sample's: w, x, y, z.
    pub sensor_rotation: Option<[f64; 4]>,
    /// Pose of the sample in the frame of the poses: x, y, z in m, and the quaternion x, y, z, w.
    pub sample_pose: Option<[f64; 7]>,
    /// Index of the recording in a file with several, from 1. Default: one row for each.
    pub block: Option<usize>,
    /// Sheet of a workbook.
    pub sheet: Option<String>,
    /// Rows per second of a table without time.
    pub rate_hz: Option<f64>,
    /// The position is a strain over this gauge length, m.
    pub gauge_length_m: Option<f64>,
    /// Character between cells.
    pub separator: Option<char>,
    /// Numbers are written with a decimal comma (0,5).
    pub decimal_comma: Option<bool>,
    /// Line of the headers, from 1.
    pub header_line: Option<usize>,
    /// Joint whose position is the depth.
    pub joint: Option<String>,
    /// Readings of a series that are used at most; all if not given.
    pub most_readings: Option<usize>,
}

/// Reading of a load cell without load.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Zero {
    /// Of a force that is one number.
    One(f64),
    /// Of a force with three components.
    Three([f64; 3]),
}

/// A manifest as it is written in the file.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Written {
    defaults: Entry,
    candidates: Vec<Candidate>,
    variants: Vec<Candidate>,
    recordings: Vec<Entry>,
}

/// Every candidate combined with every variant, in the order of the candidates.
fn crossed(candidates: Vec<Candidate>, variants: &[Candidate]) -> Vec<Candidate> {
    let candidates = if candidates.is_empty() { vec![Candidate::default()] } else { candidates };
    if variants.is_empty() {
        return candidates;
    }
    let joined = |a: &[String], b: &[String]| a.iter().chain(b).cloned().collect();
    let with = |a: &Candidate, b: &Candidate| {
        let name =
            [a.name.as_str(), b.name.as_str()].into_iter().filter(|n| !n.is_empty()).collect::<Vec<_>>().join(", ");
        Candidate { name, set: joined(&a.set, &b.set), fit: joined(&a.fit, &b.fit) }
    };
    candidates.iter().flat_map(|a| variants.iter().map(move |b| with(a, b))).collect()
}

/// All recordings, each with the defaults filled in.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Manifest {
    /// Base folder of the files' and scenes' paths.
    pub folder: PathBuf,
    /// Candidate models; at least one.
    pub candidates: Vec<Candidate>,
    /// One entry per recording. Name, file and sample are always set.
    pub recordings: Vec<Entry>,
}

/// Columns of a CSV manifest that hold several values, separated by `;`.
const LISTS: [&str; 6] = ["set", "fit", "force_columns", "pose_columns", "sensor_rotation", "sample_pose"];
/// Those of [`LISTS`], and others, whose values are numbers.
const NUMBERS: [&str; 3] = ["sensor_rotation", "sample_pose", "force_zero"];

impl Manifest {
    /// Reads a manifest, TOML or CSV. Paths are relative to `root`, or by default to the manifest's folder.
    ///
    /// # Errors
    /// [`ManifestError`].
    pub fn read(path: &Path, root: Option<&Path>) -> Result<Self, ManifestError> {
        let text = fs::read_to_string(path)
            .map_err(|e| ManifestError { path: path.to_owned(), reason: format!("can't be read: {e}") })?;
        Self::from_text(path, &text, root)
    }

    /// Same as [`Manifest::read`], with the content of the file given.
    ///
    /// # Errors
    /// [`ManifestError`].
    pub fn from_text(path: &Path, text: &str, root: Option<&Path>) -> Result<Self, ManifestError> {
        let error = |reason: String| ManifestError { path: path.to_owned(), reason };
        let table = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("csv"));
        let written = if table { from_csv(text) } else { toml::from_str(text).map_err(|e| e.to_string()) };
        let written = written.map_err(error)?;
        let folder = path.parent().map_or_else(PathBuf::new, Path::to_path_buf);
        let root = root.map_or_else(|| folder.clone(), Path::to_path_buf);
        let mut recordings = Vec::new();
        for entry in &written.recordings {
            recordings.extend(expanded(entry, &written.defaults, &root).map_err(error)?);
        }
        if recordings.is_empty() {
            return Err(error("it names no recordings: add [[recordings]] with file = \"...\"".to_owned()));
        }
        name_by_folder(&mut recordings);
        let mut names: Vec<&str> = recordings.iter().filter_map(|r| r.name.as_deref()).collect();
        names.sort_unstable();
        if let Some(twice) = names.windows(2).find(|w| w[0] == w[1]) {
            return Err(error(format!("two recordings are called {}: give each a name", twice[0])));
        }
        let candidates = crossed(written.candidates, &written.variants);
        Ok(Self { folder, candidates, recordings })
    }
}

/// Puts the folder before names that came from equal file names in several folders.
fn name_by_folder(recordings: &mut [Entry]) {
    let mut counts = std::collections::BTreeMap::<String, usize>::new();
    recordings.iter().filter_map(|r| r.name.clone()).for_each(|name| *counts.entry(name).or_default() += 1);
    for entry in recordings {
        let (Some(name), Some(file)) = (&entry.name, &entry.file) else { continue };
        let file = Path::new(file);
        let part = |path: Option<&std::ffi::OsStr>| path.map(|p| p.to_string_lossy().into_owned()).unwrap_or_default();
        let (stem, folder) = (part(file.file_stem()), part(file.parent().and_then(Path::file_name)));
        if counts.get(name).is_some_and(|n| *n > 1) && name.starts_with(&stem) && !folder.is_empty() {
            entry.name = Some(format!("{folder}_{name}"));
        }
    }
}

/// Parses one entry per line. Empty cells are left out so that the default applies.
fn from_csv(text: &str) -> Result<Written, String> {
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).comment(Some(b'#')).from_reader(text.as_bytes());
    let headers = reader.headers().map_err(|e| e.to_string())?.clone();
    let mut recordings = Vec::new();
    for record in reader.records() {
        let record = record.map_err(|e| e.to_string())?;
        let cells = headers.iter().zip(&record).filter(|(_, cell)| !cell.is_empty());
        let value = |key: &str, cell: &str| {
            let number = |part: &str| serde_json::from_str(part).unwrap_or_else(|_| Value::from(part));
            let one = |part: &str| if NUMBERS.contains(&key) { number(part) } else { part.into() };
            if LISTS.contains(&key) || (key == "force_zero" && cell.contains(';')) {
                return Value::from_iter(cell.split(';').map(|part| one(part.trim())));
            }
            // only these columns hold numbers and booleans; a name may look like a number
            let numeric = key.ends_with("_m") || key.ends_with("_s") || key.ends_with("_sign") || key.ends_with("_hz");
            let typed = numeric || key == "header_line" || key == "decimal_comma" || key == "together";
            let typed = typed || ["position_zero", "position_scale", "force_zero", "block"].contains(&key);
            if typed { serde_json::from_str(cell).unwrap_or_else(|_| cell.into()) } else { cell.into() }
        };
        let object: Map<String, Value> = cells.map(|(key, cell)| (key.to_owned(), value(key, cell))).collect();
        let line = record.position().map_or(0, csv::Position::line);
        recordings.push(serde_json::from_value(object.into()).map_err(|e| format!("line {line}: {e}"))?);
    }
    Ok(Written { recordings, ..Written::default() })
}

/// Expands an entry to one recording for each file that its pattern matches.
fn expanded(entry: &Entry, defaults: &Entry, root: &Path) -> Result<Vec<Entry>, String> {
    let entry = entry.or(defaults);
    let Some(pattern) = entry.file.as_deref() else { return Err("a recording has no file = \"...\"".to_owned()) };
    entry.check().map_err(|reason| format!("{pattern}: {reason}"))?;
    let files = if pattern.contains('*') { found(root, pattern) } else { vec![root.join(pattern)] };
    if files.is_empty() {
        return Err(format!("no file is called {pattern} in {}; name the folder with --root", root.display()));
    }
    let several = pattern.contains('*');
    let with_blocks = files.iter().flat_map(|file| {
        let count = if entry.block.is_some() || is_bag(file) { 1 } else { blocks(file, &entry.selection()) };
        (1..=count).map(move |block| (file, (count > 1).then_some(block)))
    });
    let one = |(file, block): (&PathBuf, Option<usize>)| {
        let part = |path: Option<&std::ffi::OsStr>| path.map(|p| p.to_string_lossy().into_owned()).unwrap_or_default();
        let (stem, folder) = (part(file.file_stem()), part(file.parent().and_then(Path::file_name)));
        let fill = |text: &String| filled(text, &stem, &folder);
        let name = entry.name.as_ref().filter(|_| !several).map_or_else(|| stem.clone(), fill);
        // recordings in one file belong to one sample, unless the manifest gives the sample
        let sample = entry.sample.as_ref().map_or_else(|| name.clone(), fill);
        let name = block.map_or_else(|| name.clone(), |block| format!("{name}_{block}"));
        Entry {
            sample: Some(sample),
            block: block.or(entry.block),
            group: entry.group.as_ref().map(fill),
            chosen_for: entry.chosen_for.as_ref().map(fill),
            file: Some(file.to_string_lossy().into_owned()),
            force_file: entry.force_file.as_ref().map(|f| root.join(f).to_string_lossy().into_owned()),
            name: Some(name.replace(['/', '\\'], "_")),
            ..entry.clone()
        }
    };
    Ok(with_blocks.map(one).collect())
}

/// Replaces `{name}`, `{folder}` and `{name:N}` in one pass: braces in a file's name are not expanded again.
fn filled(text: &str, name: &str, folder: &str) -> String {
    let (mut out, mut rest) = (String::new(), text);
    while let Some((before, behind)) = rest.split_once('{') {
        out.push_str(before);
        let field = behind.split_once('}').and_then(|(key, after)| Some((value(key, name, folder)?, after)));
        if let Some((value, after)) = field {
            out.push_str(&value);
            rest = after;
        } else {
            out.push('{');
            rest = behind;
        }
    }
    out + rest
}

/// The replacement of `{key}`; `None` if there is no such field.
fn value(key: &str, name: &str, folder: &str) -> Option<String> {
    let letters = |count: i64| {
        let count_or = |n: i64| usize::try_from(n.unsigned_abs()).unwrap_or(usize::MAX);
        // a negative count drops that many characters at the end
        let end = if count < 0 { name.chars().count().saturating_sub(count_or(count)) } else { count_or(count) };
        name.chars().take(end).collect()
    };
    match key {
        "name" => Some(name.to_owned()),
        "folder" => Some(folder.to_owned()),
        _ => key.strip_prefix("name:")?.parse().ok().map(letters),
    }
}

/// Files below a folder whose path matches a pattern, sorted by name.
fn found(root: &Path, pattern: &str) -> Vec<PathBuf> {
    let mut paths = vec![root.to_path_buf()];
    for part in pattern.split('/') {
        paths = paths
            .iter()
            .flat_map(|path| {
                if !part.contains('*') {
                    return vec![path.join(part)].into_iter().filter(|p| p.exists()).collect();
                }
                let entries = fs::read_dir(path).into_iter().flatten().flatten();
                let mut inside: Vec<PathBuf> =
                    entries.filter(|e| fits(&e.file_name().to_string_lossy(), part)).map(|e| e.path()).collect();
                inside.sort();
                inside
            })
            .collect();
    }
    paths
}

/// Whether a name matches a pattern with `*`. Each part is matched at its first position after the part before; the
/// last part must match at the end.
fn fits(name: &str, pattern: &str) -> bool {
    let Some((start, rest)) = pattern.split_once('*') else { return name == pattern };
    let (inner, end) = rest.rsplit_once('*').unwrap_or(("", rest));
    let Some(name) = name.strip_prefix(start).and_then(|name| name.strip_suffix(end)) else { return false };
    let behind = |name: &str, part: &str| name.find(part).map(|at| at + part.len());
    inner.split('*').try_fold(name, |name, part| behind(name, part).map(|at| &name[at..])).is_some()
}

macro_rules! first_of {
    ($own:expr, $other:expr, $($field:ident),+) => {
        Entry { $($field: $own.$field.clone().or_else(|| $other.$field.clone())),+ }
    };
}

impl Entry {
    /// Rejects values that no recording can have, as the command line does.
    fn check(&self) -> Result<(), String> {
        let positive = [
            ("rate_hz", self.rate_hz),
            ("gauge_length_m", self.gauge_length_m),
            ("position_scale", self.position_scale),
        ];
        for (key, value) in positive {
            if value.is_some_and(|x| !(x.is_finite() && x > 0.0)) {
                return Err(format!("{key} = {}: a positive number is needed", value.unwrap_or_default()));
            }
        }
        if let Some(names) = self.pose_columns.as_ref().filter(|names| ![3, 7].contains(&names.len())) {
            return Err(format!("pose_columns = {names:?}: three columns, or seven with a quaternion"));
        }
        let finite = [("time_offset_s", self.time_offset_s), ("position_zero", self.position_zero)];
        let zeros = match &self.force_zero {
            Some(Zero::One(zero)) => &[*zero][..],
            Some(Zero::Three(zeros)) => zeros,
            None => &[],
        };
        let mut finite = finite.into_iter().chain(zeros.iter().map(|zero| ("force_zero", Some(*zero))));
        let wrong = finite.find_map(|(key, value)| Some((key, value.filter(|x| !x.is_finite())?)));
        wrong.map_or(Ok(()), |(key, x)| Err(format!("{key} = {x}: a finite number is needed")))
    }

    /// Fills the fields that are not set here from `other`.
    fn or(&self, other: &Self) -> Self {
        first_of!(
            self,
            other,
            name,
            file,
            force_file,
            sample,
            group,
            chosen_for,
            scene,
            set,
            fit,
            load_cell,
            fit_to_depth_m,
            to_depth_m,
            choose_from_depth_m,
            curves,
            together,
            position,
            position_unit,
            position_sign,
            force,
            force_unit,
            force_sign,
            force_zero,
            time_offset_s,
            time,
            time_unit,
            position_zero,
            position_scale,
            force_columns,
            pose_columns,
            sensor_rotation,
            sample_pose,
            block,
            sheet,
            rate_hz,
            gauge_length_m,
            separator,
            decimal_comma,
            header_line,
            joint,
            most_readings
        )
    }

    /// How the recording's columns are to be read.
    #[must_use]
    pub fn selection(&self) -> Selection {
        let quantity = |place: &Option<String>, unit: &Option<String>, sign: Option<f64>| Quantity {
            place: place.clone(),
            unit: unit.clone(),
            reversed: sign.is_some_and(|sign| sign < 0.0),
            ..Quantity::default()
        };
        let position = quantity(&self.position, &self.position_unit, self.position_sign);
        let pose = self.pose_columns.as_deref().unwrap_or_default();
        let names = TopicNames::default();
        Selection {
            names: TopicNames { joint: self.joint.clone().unwrap_or(names.joint.clone()), ..names },
            position: Quantity { zero: self.position_zero.unwrap_or(0.0), factor: self.position_scale, ..position },
            force: Quantity {
                zero: if let Some(Zero::One(zero)) = self.force_zero { zero } else { 0.0 },
                ..quantity(&self.force, &self.force_unit, self.force_sign)
            },
            force_zeros: if let Some(Zero::Three(zeros)) = self.force_zero { Some(zeros) } else { None },
            time_offset_s: self.time_offset_s.unwrap_or(0.0),
            time: self.time.iter().cloned().collect(),
            time_unit: self.time_unit.iter().cloned().collect(),
            rate_hz: self.rate_hz,
            pose: pose.get(..3).and_then(|tip| tip.to_vec().try_into().ok()),
            orientation: pose.get(3..7).and_then(|axis| axis.to_vec().try_into().ok()),
            forces: self.force_columns.clone(),
            sensor_rotation: self.sensor_rotation,
            sample_pose: self.sample_pose,
            markers: Vec::new(),
            gauge_length_m: self.gauge_length_m,
            layout: TableLayout {
                separator: self.separator,
                decimal_comma: self.decimal_comma,
                header_line: self.header_line,
                comment: None,
                block: self.block,
                sheet: self.sheet.clone(),
            },
            most_readings: self.most_readings,
        }
    }

    /// Keys to identify, including those of a candidate.
    ///
    /// # Errors
    /// If a text is not a key with bounds.
    pub fn wanted(&self, candidate: &Candidate) -> Result<Vec<Wanted>, String> {
        self.fit.iter().flatten().chain(&candidate.fit).map(|text| Wanted::parse(text)).collect()
    }
}

#[cfg(test)]
mod tests;
