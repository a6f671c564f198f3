//! A mesh as its file has it, and what can be wrong with it.

use std::collections::BTreeMap;

use mtled::cloud::hexahedron::{Hexahedron, cut};

/// What is wrong in a file.
#[derive(Debug)]
pub(super) struct Flaw {
    /// Line, from 1.
    pub line: Option<usize>,
    pub reason: String,
}

impl Flaw {
    pub(super) fn of_file(reason: impl Into<String>) -> Self {
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
    pub(super) fn add(&mut self, name: u64, corners: &[u32]) -> Result<usize, String> {
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
