//! The shape table: for each integration point its support nodes, the gradients of their shape functions and the
//! volume that it stands for. Every method ends here; the internal-force kernel knows nothing else.

use std::ops::Range;

use crate::mirror::Mirror;

/// What the rows of a table describe.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub enum Form {
    /// A field in space.
    #[default]
    Full,
    /// A field in space that is symmetric about a plane, by the half on one side of it (see `super::mirrored`): entry `nodes + j` is the
    /// image of node j.
    Mirrored(Mirror),
    /// A field with symmetry of revolution, by its half plane (see [`super::axisymmetric`]): y holds the hoop strain,
    /// entry `nodes + j` is the image of node j beyond the axis, and a cell is a triangle whose last corner is repeated.
    Axisymmetric,
}

impl Form {
    /// Corners of a cell.
    #[must_use]
    pub const fn corners(self) -> usize {
        match self {
            Self::Full | Self::Mirrored(_) => 4,
            Self::Axisymmetric => 3,
        }
    }

    /// The plane of symmetry of a field in space.
    #[must_use]
    pub const fn mirror(self) -> Option<Mirror> {
        match self {
            Self::Mirrored(mirror) => Some(mirror),
            Self::Full | Self::Axisymmetric => None,
        }
    }
}

/// Per integration point: support nodes, gradients, volume, cell.
#[derive(Clone, Debug, Default)]
pub struct ShapeTable {
    /// Offsets into `nodes` and `gradient`, one more than points.
    pub start: Vec<u32>,
    /// Support nodes.
    pub nodes: Vec<u32>,
    /// d phi_j / d X_k, 1/m.
    pub gradient: Vec<[f64; 3]>,
    /// Reference volume of each point, m^3.
    pub volume: Vec<f64>,
    /// The cell that each point lies in.
    pub cell: Vec<u32>,
    /// What the rows describe.
    pub form: Form,
    /// Region of each cell; empty: one region.
    pub region: Vec<u8>,
    /// Whether each cell is one that a needle comes to fill; empty: none is. Such points share vectors with none but their like, and cost
    /// nothing behind the needle's tip.
    pub filled: Vec<bool>,
}

impl ShapeTable {
    /// Region that an integration point lies in.
    pub(crate) fn region_of(&self, point: usize) -> u8 {
        self.region_of_cell(self.cell[point] as usize)
    }

    pub(crate) fn region_of_cell(&self, cell: usize) -> u8 {
        self.region.get(cell).copied().unwrap_or(0)
    }

    /// Whether an integration point lies in a cell that a needle comes to fill.
    pub(crate) fn is_filled(&self, point: usize) -> bool {
        self.filled.get(self.cell[point] as usize).copied().unwrap_or(false)
    }

    /// Where the entries of an integration point stand in `nodes` and `gradient`.
    pub(crate) fn entries(&self, point: usize) -> Range<usize> {
        self.start[point] as usize..self.start[point + 1] as usize
    }

    pub(super) fn push(&mut self, cell: usize, row: &Row) {
        self.nodes.extend_from_slice(&row.nodes);
        self.gradient.extend_from_slice(&row.gradient);
        self.volume.push(row.volume);
        self.cell.push(cell as u32);
        self.start.push(self.nodes.len() as u32);
    }
}

/// One integration point of a table.
pub(super) struct Row {
    /// Where, m.
    pub at: [f64; 3],
    pub volume: f64,
    pub nodes: Vec<u32>,
    pub gradient: Vec<[f64; 3]>,
    /// sum_j |grad phi_j|^2, 1/m^2; 0 for a finite element, which has no support.
    pub squares: f64,
}
