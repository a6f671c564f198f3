//! Finds the files of a bag from what the user names, and says what is there when it isn't one.

use super::error::{BagError, Loss};
use super::metadata::Metadata;
use super::record::MAGIC;
use super::source::Source;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// How a bag of another kind becomes one that can be read here.
fn convert(path: &Path) -> String {
    let bag = path.display();
    format!(
        "convert it with `rosbags-convert --src {bag} --dst NEW --dst-storage mcap` (pip install rosbags) and open NEW"
    )
}

/// Largest metadata.yaml that is read: a thousand topics are about a megabyte.
const METADATA_LIMIT: u64 = 16 << 20;

/// The files of a bag.
pub(super) struct Located {
    pub files: Vec<PathBuf>,
    pub metadata: Option<Metadata>,
    pub losses: Vec<Loss>,
    pub warnings: Vec<String>,
}

/// Finds the MCAP files behind `path`: a folder, its metadata.yaml, or a file.
pub(super) fn locate(path: &Path) -> Result<Located, BagError> {
    let about = fs::metadata(path).map_err(|source| BagError::Open { path: path.to_path_buf(), source })?;
    if about.is_dir() {
        return in_folder(path);
    }
    if path.file_name().is_some_and(|name| name == "metadata.yaml") {
        return in_folder(path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new(".")));
    }
    Ok(Located { files: vec![path.to_path_buf()], metadata: None, losses: Vec::new(), warnings: Vec::new() })
}

fn in_folder(folder: &Path) -> Result<Located, BagError> {
    let not_a_bag = |found: String, remedy: &str| BagError::NotABag {
        path: folder.to_path_buf(),
        found,
        remedy: remedy.to_owned(),
    };
    let mut warnings = Vec::new();
    let metadata = read_metadata(&folder.join("metadata.yaml"), &mut warnings);
    if let Some(metadata) = &metadata {
        // `ros2 bag reindex` leaves it empty
        if !["mcap", ""].contains(&metadata.storage_identifier.as_str()) {
            return Err(not_a_bag(
                format!("a bag with {} storage, not MCAP", metadata.storage_identifier),
                &convert(folder),
            ));
        }
        let (mode, format) = (metadata.compression_mode.to_ascii_uppercase(), metadata.compression_format.as_str());
        // files and messages that zstd has packed are read
        if !matches!(mode.as_str(), "" | "NONE") && !["zstd", ""].contains(&format) {
            return Err(not_a_bag(format!("a bag with {mode} compression by {format}"), &convert(folder)));
        }
    }
    let listed = metadata.iter().flat_map(|m| &m.relative_file_paths).filter_map(|f| inside(folder, f));
    let mut losses = Vec::new();
    let (mut files, mut seen) = (Vec::new(), BTreeSet::new());
    for file in listed {
        if !seen.insert(file.clone()) {
            // a file that is listed twice is read once
        } else if file.is_file() {
            files.push(file);
        } else {
            losses.push(Loss::MissingFile { file: file.display().to_string() });
        }
    }
    let present = mcap_files(folder).map_err(|source| BagError::Open { path: folder.to_path_buf(), source })?;
    if files.is_empty() {
        if metadata.is_some() && !present.is_empty() {
            let renamed = losses.len() == present.len();
            warnings
                .push("metadata.yaml lists no file that is there: all MCAP files of the folder were taken".to_owned());
            // as many as are listed: they were renamed
            losses.retain(|_| !renamed);
        }
        files = present;
        losses.extend(missing_pieces(&files, true));
    } else {
        if losses.is_empty() {
            // reindex lists what is there; a recorder may have thrown the first pieces away
            losses.extend(missing_pieces(&files, false));
        }
        if let Some(extra) = present.iter().find(|p| !seen.contains(*p)) {
            warnings.push(format!("{} is not listed in metadata.yaml and was left out", extra.display()));
        }
    }
    if files.is_empty() {
        return Err(nothing_in(folder));
    }
    Ok(Located { files, metadata, losses, warnings })
}

/// What to say of a folder without MCAP files.
fn nothing_in(folder: &Path) -> BagError {
    let paths: Vec<PathBuf> = fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path()).collect();
    let mut bags: Vec<String> = paths
        .iter()
        .filter(|p| p.join("metadata.yaml").is_file())
        .filter_map(|p| Some(p.file_name()?.to_string_lossy().into_owned()))
        .collect();
    bags.sort();
    let (found, remedy) = if paths.iter().any(|p| p.extension().is_some_and(|x| x == "db3")) {
        ("a bag with sqlite3 storage, not MCAP", convert(folder))
    } else if bags.is_empty() {
        ("no bag: there is no .mcap file in this folder", "name the folder that `ros2 bag record` made".to_owned())
    } else {
        ("no bag but a folder with bags", format!("name one of them: {}", bags.join(", ")))
    };
    BagError::NotABag { path: folder.to_path_buf(), found: found.to_owned(), remedy }
}

/// A file of the folder by the name that metadata.yaml gives: nothing outside the folder is opened.
fn inside(folder: &Path, name: &str) -> Option<PathBuf> {
    Path::new(name).file_name().map(|name| folder.join(name))
}

fn read_metadata(path: &Path, warnings: &mut Vec<String>) -> Option<Metadata> {
    let text = match fs::metadata(path) {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
            warnings.push(
                "there is no metadata.yaml: all MCAP files of the folder were taken (`ros2 bag reindex` makes it)"
                    .into(),
            );
            return None;
        }
        Ok(about) if about.len() > METADATA_LIMIT => Err(format!("it has {} bytes", about.len())),
        _ => fs::read_to_string(path).map_err(|e| e.to_string()),
    };
    match text.and_then(|text| Metadata::parse(&text)) {
        Ok(metadata) => Some(metadata),
        Err(reason) => {
            let reason = reason.lines().next().unwrap_or_default();
            warnings.push(format!("metadata.yaml can't be used ({reason}): all MCAP files of the folder were taken"));
            None
        }
    }
}

/// The MCAP files of a folder in the order of recording: `NAME_2.mcap` before `NAME_10.mcap`.
fn mcap_files(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let mut files: Vec<PathBuf> = fs::read_dir(folder)?
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| ends(path).is_some() && path.is_file())
        .collect();
    files.sort_by_key(|path| {
        let (name, number) = piece(path);
        (name, number.unwrap_or(0), path.clone())
    });
    Ok(files)
}

/// How the name of an MCAP file ends, packed or not.
fn ends(path: &Path) -> Option<&'static str> {
    let name = path.file_name()?.to_string_lossy();
    [".mcap", ".mcap.zstd", ".mcap.zst"].into_iter().find(|end| name.ends_with(end))
}

/// Name of a recording, and the number of a piece of it.
fn piece(path: &Path) -> (String, Option<u64>) {
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let stem = ends(path).and_then(|end| name.strip_suffix(end)).unwrap_or(&name);
    let digits = stem.chars().rev().take_while(char::is_ascii_digit).count();
    let (name, number) = stem.split_at(stem.len() - digits);
    (name.to_owned(), number.parse().ok())
}

/// Pieces of a recording that are not there: `NAME_1.mcap` between `NAME_0.mcap` and `NAME_2.mcap`, and `NAME_0.mcap` before several others, as
/// rosbag2 counts from 0. `from_0`: whether the latter count.
fn missing_pieces(files: &[PathBuf], from_0: bool) -> Vec<Loss> {
    const MOST: u64 = 1000;
    let numbered = |path: &PathBuf| {
        let (name, number) = piece(path);
        number.filter(|_| name.ends_with('_')).map(|number| (name, number))
    };
    let loss = |before: &PathBuf, name: &str, numbers: std::ops::Range<u64>| -> Vec<Loss> {
        let end = ends(before).unwrap_or_default();
        numbers.map(|number| Loss::MissingPiece { file: format!("{name}{number}{end}") }).collect()
    };
    let between = |pair: &[PathBuf]| match (numbered(&pair[0]), numbered(&pair[1])) {
        (Some((name, before)), Some((next, after))) if name == next => {
            loss(&pair[0], &name, before + 1..after.min(before + MOST))
        }
        _ => Vec::new(),
    };
    let first = match files {
        [first, second, ..] if from_0 => numbered(first)
            .filter(|(name, number)| *number < MOST && piece(second).0 == *name)
            .map_or_else(Vec::new, |(name, number)| loss(first, &name, 0..number)),
        _ => Vec::new(),
    };
    first.into_iter().chain(files.windows(2).flat_map(between)).collect()
}

/// Looks at the first bytes of a file.
///
/// # Errors
/// [`BagError::NotABag`] if they are not those of an MCAP file.
pub(super) fn check_start(path: &Path, source: &Source) -> Result<(), BagError> {
    let open = |source| BagError::Open { path: path.to_path_buf(), source };
    let start = source.read(0, source.len().min(16)).map_err(open)?;
    if start.starts_with(&MAGIC) {
        return Ok(());
    }
    let again = "record it again, or take another copy";
    let convert = convert(path);
    let (found, remedy) = if start.is_empty() {
        ("an empty file", again)
    } else if MAGIC.starts_with(&start) {
        ("an MCAP file that was cut off within its first 8 bytes", again)
    } else if start.starts_with(b"SQLite format 3") {
        ("a bag with sqlite3 storage, not MCAP", convert.as_str())
    } else if start.starts_with(b"#ROSBAG") {
        ("a ROS 1 bag", convert.as_str())
    } else {
        ("not a bag: it does not start like an MCAP file", "name a rosbag2 folder or an .mcap file")
    };
    Err(BagError::NotABag { path: path.to_path_buf(), found: found.to_owned(), remedy: remedy.to_owned() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_are_counted_from_0() {
        let of = |names: &[&str]| -> Vec<String> {
            let files: Vec<PathBuf> = names.iter().map(PathBuf::from).collect();
            missing_pieces(&files, true)
                .into_iter()
                .map(|loss| loss.to_string().split(' ').next().unwrap_or_default().to_owned())
                .collect()
        };
        assert_eq!(of(&["run_0.mcap", "run_1.mcap"]), [""; 0]);
        assert_eq!(of(&["run_0.mcap", "run_2.mcap.zstd"]), ["run_1.mcap"]);
        assert_eq!(of(&["run_2.mcap", "run_3.mcap"]), ["run_0.mcap", "run_1.mcap"]);
        // one file may have any number, and so may a date
        assert_eq!(of(&["gel_7.mcap"]), [""; 0]);
        assert_eq!(of(&["a_3.mcap", "b_4.mcap"]), [""; 0]);
        assert_eq!(of(&["gel_20260304.mcap", "gel_20260305.mcap"]), [""; 0]);
    }
}
