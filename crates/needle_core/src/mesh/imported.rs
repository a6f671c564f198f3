//! A mesh as its file has it, and what can be wrong with it.

use std::collections::{BTreeMap, BTreeSet};

use mtled::cloud::hexahedron::{Hexahedron, cut};

/// Names of the two surfaces of a file that names none: the defaults of the scene's keys.
const BASE: &str = "base";
const CONTACT: &str = "contact";
/// Share of the height that counts as the base there.
const BASE_SHARE: f64 = 0.1;
/// Sine of the angle to the vertical within which a triangle is a side, 10 degrees.
const SIDE_SLOPE: f64 = 0.17;

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
    /// What else to do where such a surface can't be used.
    pub remedy: &'static str,
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

    /// Adds a triangle, or the two of a quadrangle.
    pub(super) fn add_facet(&mut self, corners: &[u32]) {
        let triangles = corners.windows(2).skip(1).map(|edge| [corners[0], edge[0], edge[1]]);
        self.surface.extend(triangles.filter(|[a, b, c]| a != b && b != c && c != a));
    }

    /// Names the two surfaces of a file that has a surface alone and names none: the base is what lies within a share of the height above the
    /// lowest point, the contact the rest. Upright sides are in neither.
    pub(super) fn name_by_height(&mut self, wanted: &[&str]) {
        if self.surface.is_empty() || !self.groups.is_empty() {
            return;
        }
        let corners = |t: &[u32; 3]| t.map(|n| self.points[n as usize]);
        let z = || self.surface.iter().flat_map(corners).map(|p| p[2]);
        let (low, high) = (z().fold(f64::INFINITY, f64::min), z().fold(f64::NEG_INFINITY, f64::max));
        let is_low = |t: &&[u32; 3]| corners(t).iter().all(|p| p[2] <= low + BASE_SHARE * (high - low));
        let lying = self.surface.iter().filter(|t| !is_upright(&corners(t)));
        let (base, contact): (Vec<&[u32; 3]>, Vec<&[u32; 3]>) = lying.partition(is_low);
        let nodes = |triangles: Vec<&[u32; 3]>| triangles.into_iter().flatten().copied().collect::<BTreeSet<u32>>();
        for (name, nodes) in [(BASE, nodes(base)), (CONTACT, nodes(contact))] {
            self.known_groups.push(name.to_owned());
            if wanted.contains(&name) {
                self.groups.insert(name.to_owned(), nodes.into_iter().collect());
            }
        }
        self.remarks.push(format!(
            "the file names no surfaces of the scene: \"{BASE}\" is what lies within {:.0} % of the height above its lowest point, \"{CONTACT}\" \
             the rest, and upright sides are neither (a group by its name is each solid of a text STL, each physical surface of Gmsh, each array of a \
             VTU)",
            100.0 * BASE_SHARE
        ));
    }
}

/// Whether a triangle is a part of a side.
fn is_upright([a, b, c]: &[[f64; 3]; 3]) -> bool {
    let [u, v]: [[f64; 3]; 2] = [b, c].map(|p| std::array::from_fn(|k| p[k] - a[k]));
    let normal: [f64; 3] = std::array::from_fn(|k| {
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        u[i] * v[j] - u[j] * v[i]
    });
    normal[2].powi(2) <= SIDE_SLOPE.powi(2) * normal.iter().map(|x| x * x).sum::<f64>()
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
