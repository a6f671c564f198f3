//! A cloud from a mesh of tetrahedra or hexahedra that another program made.
//!
//! ```text
//! .msh ─► msh ─┐
//!              ├─► Imported ─► assemble (unit, groups, checks, order) ─► Cloud
//! .vtu ─► vtu ─┘
//! .stl ─► stl ─────────────► skin (closed? outward?) ─► Cloud without cells
//! ```
//! An .msh or .vtu of triangles alone is read as an .stl is.
//!
//! Nothing is allocated by what a file declares, only by what it holds: at most about 64 bytes per byte of the file.

mod arrays;
mod assemble;
mod imported;
mod msh;
mod skin;
mod stl;
mod vtu;
mod words;

use std::path::Path;

use mtled::cloud::Cloud;

use imported::Flaw;
pub use imported::{Imported, Volumes, Wanted};

/// Largest file that is read, bytes.
const LONGEST: u64 = 1 << 30;

/// Why a mesh can't be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{place}: {reason}")]
pub struct ImportError {
    /// The file, and the line where there is one.
    pub place: String,
    /// What is wrong, and what to do.
    pub reason: String,
}

/// Reads a mesh, or a closed surface alone, by the ending of its name (`.msh`, `.vtu`, `.stl`), with the nodes of the groups that are `wanted`.
///
/// # Errors
/// [`ImportError`]: the file can't be read, or is not of a form that is read here.
pub fn read(path: &Path, wanted: &[&str]) -> Result<Imported, ImportError> {
    let reader = reader_of(path)?;
    let bytes = content(path).map_err(|reason| ImportError { place: path.display().to_string(), reason })?;
    parse(path, reader, &bytes, wanted)
}

type Reader = fn(&[u8], &[&str]) -> Result<Imported, Flaw>;

fn reader_of(path: &Path) -> Result<Reader, ImportError> {
    let ending = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    match ending.as_str() {
        "msh" => Ok(msh::read),
        "vtu" => Ok(vtu::read),
        "stl" => Ok(stl::read),
        _ => Err(ImportError {
            place: path.display().to_string(),
            reason: "neither .msh, .vtu nor .stl: save the mesh as Gmsh 4.1 or as VTK XML unstructured grid, or a closed surface as STL"
                .to_owned(),
        }),
    }
}

fn parse(path: &Path, reader: Reader, bytes: &[u8], wanted: &[&str]) -> Result<Imported, ImportError> {
    reader(bytes, wanted).map_err(|flaw| ImportError {
        place: match flaw.line {
            Some(line) => format!("{}:{line}", path.display()),
            None => path.display().to_string(),
        },
        reason: flaw.reason,
    })
}

fn content(path: &Path) -> Result<Vec<u8>, String> {
    let about = std::fs::metadata(path).map_err(|e| format!("can't be read: {e}"))?;
    if !about.is_file() {
        return Err("not a file".to_owned());
    }
    if about.len() > LONGEST {
        return Err(format!("{} bytes long; at most {LONGEST} are read: use a coarser mesh", about.len()));
    }
    std::fs::read(path).map_err(|e| format!("can't be read: {e}"))
}

/// A cloud from a mesh file, and what is worth knowing about it that is no error.
///
/// `faces` has [`mtled::cloud::BASE`] and [`mtled::cloud::TOP`] where surface nodes belong to the two groups, and the first bit of
/// [`mtled::cloud::SIDE`] on the rest of the surface. The shape of the cells is measured, not judged.
///
/// # Errors
/// [`ImportError`]: the file can't be read, lacks a group, or its cells don't make one body.
pub fn load(path: &Path, wanted: &Wanted<'_>) -> Result<(Cloud, Vec<String>), ImportError> {
    load_with_volumes(path, wanted).map(|(cloud, _, warnings)| (cloud, warnings))
}

/// The same with the volume groups of its cells.
///
/// # Errors
/// [`ImportError`], as [`load`].
pub fn load_with_volumes(path: &Path, wanted: &Wanted<'_>) -> Result<(Cloud, Volumes, Vec<String>), ImportError> {
    assemble_from(path, read(path, &groups(wanted))?, wanted)
}

/// As [`load`], from the content of a file. `path` only says its form, and where it is from.
///
/// # Errors
/// [`ImportError`], as [`load`].
pub fn from_bytes(path: &Path, bytes: &[u8], wanted: &Wanted<'_>) -> Result<(Cloud, Vec<String>), ImportError> {
    let imported = parse(path, reader_of(path)?, bytes, &groups(wanted))?;
    assemble_from(path, imported, wanted).map(|(cloud, _, warnings)| (cloud, warnings))
}

fn groups<'a>(wanted: &Wanted<'a>) -> Vec<&'a str> {
    std::iter::once(wanted.base).chain(wanted.contact).collect()
}

fn assemble_from(
    path: &Path,
    imported: Imported,
    wanted: &Wanted<'_>,
) -> Result<(Cloud, Volumes, Vec<String>), ImportError> {
    let assembled = if imported.surface.is_empty() { assemble::assemble } else { skin::skin };
    let remedy = imported.remedy;
    assembled(imported, wanted)
        .map_err(|reason| ImportError { place: path.display().to_string(), reason: reason + remedy })
}
