//! A cloud from a mesh of tetrahedra or hexahedra that another program made.
//!
//! ```text
//! .msh ─► msh ─┐
//!              ├─► Imported ─► assemble (unit, groups, checks, order) ─► Cloud
//! .vtu ─► vtu ─┘
//! .stl ─► stl ─────────────► skin (closed? outward?) ─► Cloud without cells
//! ```
//!
//! Nothing is allocated by what a file declares, only by what it holds: at most about 64 bytes per byte of the file.

mod arrays;
mod assemble;
mod msh;
mod skin;
mod stl;
mod vtu;
mod words;

use std::collections::BTreeMap;
use std::path::Path;

use mtled::cloud::Cloud;
use mtled::cloud::hexahedron::{Hexahedron, cut};

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

/// What is wrong in a file.
#[derive(Debug)]
struct Flaw {
    /// Line, from 1.
    line: Option<usize>,
    reason: String,
}

impl Flaw {
    fn of_file(reason: impl Into<String>) -> Self {
        Self { line: None, reason: reason.into() }
    }
}

/// A mesh as its file has it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Imported {
    /// Coordinates of the nodes in the file's unit.
    pub points: Vec<[f64; 3]>,
    /// What the file calls each node: its tag (.msh) or its number from 0 (.vtu).
    pub node_names: Vec<u64>,
    /// Tetrahedra by their nodes' places in `points`, in whichever orientation.
    pub cells: Vec<[u32; 4]>,
    /// What the file calls each cell.
    pub cell_names: Vec<u64>,
    /// Hexahedra, whose tetrahedra are among the cells.
    pub hexahedra: Vec<Hexahedron>,
    /// Nodes of the groups that were asked for and that the file has, sorted.
    pub groups: BTreeMap<String, Vec<u32>>,
    /// All groups that the file has.
    pub known_groups: Vec<String>,
    /// Triangles of a file that has a surface and no cells.
    pub surface: Vec<[u32; 3]>,
    /// What is worth knowing of the file and is no error.
    pub remarks: Vec<String>,
    /// Volume groups that the file has, and the one of each cell that is in one; empty where the form carries none.
    pub volumes: Volumes,
}

impl Imported {
    /// Adds a tetrahedron, or those that a pyramid, wedge or hexahedron is cut into; how many there are.
    fn add(&mut self, name: u64, corners: &[u32]) -> Result<usize, String> {
        let twice = |k: usize| corners[..k].contains(&corners[k]);
        if corners.len() > 4 && (0..corners.len()).any(twice) {
            return Err(format!(
                "element {name} of {} corners has a node twice: save it as a wedge, pyramid or tetrahedron",
                corners.len()
            ));
        }
        let cells = cut(corners);
        if let Ok(corners) = <[u32; 8]>::try_from(corners) {
            let first = self.cells.len() as u32;
            self.hexahedra.push(Hexahedron { corners, cells: (first..first + cells.len() as u32).collect() });
        }
        self.cell_names.extend(cells.iter().map(|_| name));
        self.cells.extend(&cells);
        Ok(cells.len())
    }
}

/// Volume groups of a mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Volumes {
    /// Their names.
    pub names: Vec<String>,
    /// Groups of each volume, by their places among the names; a volume may be in several.
    pub sets: Vec<Vec<u32>>,
    /// Volume of each cell, by its place among the sets.
    pub of_cell: Vec<Option<u32>>,
}

impl Volumes {
    /// Whether a volume (a place among the sets) is in a group.
    #[must_use]
    pub fn is_in(&self, volume: u32, group: &str) -> bool {
        self.sets[volume as usize].iter().any(|&g| self.names[g as usize] == group)
    }
}

/// What an imported mesh has to provide.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wanted<'a> {
    /// Metres per unit of the file.
    pub unit_m: f64,
    /// Group of the nodes that are held.
    pub base: &'a str,
    /// Group of the surface that an instrument may touch; `None`: nothing touches it.
    pub contact: Option<&'a str>,
}

/// Reads a mesh by the ending of its name, `.msh` or `.vtu`, or the closed surface of an `.stl`, with the nodes of the groups that are `wanted`.
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
    assembled(imported, wanted).map_err(|reason| ImportError { place: path.display().to_string(), reason })
}
