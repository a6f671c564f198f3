//! Bad supports: those that do not determine the fit, or only just, are enlarged; what no support can help is refused.
//!
//! A fit is judged by its gradients over the distance of nodes there, L being the mean length of the edges at the corners of its cell:
//!
//! ```text
//! g = L (sum_j |grad phi_j|^2)^(1/2)
//! ```
//!
//! A linear tetrahedron with equal edges has g = sqrt 6 = 2.4. As the support nodes come to lie in one plane the moment
//! matrix tends to a singular one and g to infinity, and with it the stiffness of the point: the largest stable step
//! falls as 1/g (Joldes, Wittek, Miller 2012). Clouds of this crate have g below 3.1 with a support factor of 1.6 or more. A cell that is longer
//! than nodes are apart says nothing of its support; and supports that are enlarged beside a needle make it thicker, by what they reach across
//! what it holds.

use rayon::prelude::*;

use super::error::ApproximationError;
use super::mls::Neighbour;
use super::shape_table::{Form, Row, ShapeTable};
use crate::vector::{Point, dot, scale, sub};

/// g beyond which a support is enlarged.
pub(super) const WORST: f64 = 4.0;
/// Growth of a support from one try to the next.
const GROWTH: f64 = 1.2;
/// Tries for a point without a fit, whose support grows 4.3 times at most.
const TRIES: i32 = 8;
/// Tries for an ill-conditioned fit, 1.7 times at most: what is left then comes from the shape of the cell.
const ILL_TRIES: i32 = 3;
/// Height of a set of nodes over its length below which it counts as flat.
const FLAT: f64 = 1e-6;
/// Cells whose rows are held at a time: rows take the memory of the table once more.
const CELLS_AT_A_TIME: usize = 2048;

/// An approximation whose supports can grow.
pub(super) trait Supported: Sync {
    /// What the rows describe.
    fn form(&self) -> Form;
    fn cells(&self) -> usize;
    /// Places and volumes of a cell's integration points, m and m^3.
    fn points(&self, cell: usize) -> Vec<(Point, f64)>;
    /// Row of one of them, by the nodes of its support; of those `among` the entries, ascending, where they are given.
    fn row(&self, cell: usize, point: (Point, f64), among: Option<&[u32]>) -> Result<Row, ApproximationError>;
    fn cell(&self, cell: usize) -> Result<Vec<Row>, ApproximationError> {
        self.points(cell).into_iter().map(|point| self.row(cell, point, None)).collect()
    }
    /// Region of each cell; empty: one region.
    fn region(&self) -> &[u8];
    /// [`ShapeTable::filled`].
    fn filled(&self) -> &[bool] {
        &[]
    }
    /// Mean length of the edges at a cell's corners, m.
    fn edge(&self, cell: usize) -> f64;
    /// Whether the field has a value there.
    fn determined(&self, x: Point) -> Result<(), ApproximationError>;
    /// Gives `factor` times their first support to the nodes that then reach one of the points.
    fn enlarge(&mut self, factor: f64, at: &[Point]);
}

/// The shape table, after supports were enlarged until every row is well determined and there is a field at `also`.
/// Rows that stay ill-conditioned are kept: they are right, if stiff.
pub(super) fn repaired<B: Supported>(body: &mut B, also: &[Point]) -> Result<ShapeTable, ApproximationError> {
    for round in 1..=TRIES {
        let (table, mut bad) = judged(body, if round > ILL_TRIES { f64::INFINITY } else { WORST });
        let undetermined = also.par_iter().copied().filter(|&x| body.determined(x).is_err());
        bad.extend(undetermined.collect::<Vec<_>>());
        if bad.is_empty() {
            return table;
        }
        body.enlarge(GROWTH.powi(round), &bad);
    }
    also.iter().try_for_each(|&x| body.determined(x))?;
    table(body)
}

/// The shape table of the supports as they are.
pub(super) fn table<B: Supported>(body: &B) -> Result<ShapeTable, ApproximationError> {
    judged(body, f64::INFINITY).0
}

/// The shape table, or why there is none, and the places where a cell has no fit or one with g above `worst`.
fn judged<B: Supported>(body: &B, worst: f64) -> (Result<ShapeTable, ApproximationError>, Vec<Point>) {
    let (region, filled) = (body.region().to_vec(), body.filled().to_vec());
    let mut table = Ok(ShapeTable { start: vec![0], form: body.form(), region, filled, ..ShapeTable::default() });
    let mut bad_at = Vec::new();
    for first in (0..body.cells()).step_by(CELLS_AT_A_TIME) {
        let cells = first..(first + CELLS_AT_A_TIME).min(body.cells());
        let rows: Vec<_> = cells.clone().into_par_iter().map(|cell| body.cell(cell)).collect();
        for (cell, rows) in cells.zip(rows) {
            bad_at.extend(bad(&rows, worst / body.edge(cell)));
            match (&mut table, rows) {
                (Ok(table), Ok(rows)) => rows.iter().for_each(|row| table.push(cell, row)),
                (Ok(_), Err(refusal)) => table = Err(refusal),
                (Err(_), _) => {}
            }
        }
    }
    (table, bad_at)
}

/// Where a cell has no fit, or one with steeper gradients than allowed.
fn bad(rows: &Result<Vec<Row>, ApproximationError>, steepest: f64) -> Option<Point> {
    match rows {
        Err(refusal) => Some(refusal.at()),
        Ok(rows) => rows.iter().find(|r| r.squares.sqrt() > steepest).map(|r| r.at),
    }
}

/// Mean over a cell's corners of what each node has.
pub(super) fn mean<const K: usize>(of_node: &[f64], corners: &[u32; K]) -> f64 {
    corners.iter().map(|&n| of_node[n as usize]).sum::<f64>() / K as f64
}

/// The reason why these support nodes give no fit at x, in as many dimensions.
pub(super) fn refusal(at: Point, neighbours: &[Neighbour], dimensions: usize) -> ApproximationError {
    let nodes = neighbours.len();
    if nodes == 0 {
        return ApproximationError::Uncovered { at };
    }
    if rank(neighbours) < dimensions {
        let shape = if dimensions == 3 { "plane" } else { "line" };
        return ApproximationError::Coplanar { at, nodes, shape };
    }
    ApproximationError::Singular { at, nodes }
}

/// Dimensions that a set of nodes spans: a pivoted Gram-Schmidt process on their distances from the first one.
fn rank(neighbours: &[Neighbour]) -> usize {
    let length = |v: &Point| dot(*v, *v);
    let origin = neighbours[0].offset;
    let mut rest: Vec<Point> = neighbours.iter().map(|n| sub(n.offset, origin)).collect();
    let longest = rest.iter().map(length).fold(0.0, f64::max);
    (0..3)
        .find(|_| {
            let Some(axis) = rest.iter().copied().max_by(|a, b| length(a).total_cmp(&length(b))) else { return true };
            let square = length(&axis);
            for v in &mut rest {
                *v = sub(*v, scale(axis, dot(*v, axis) / square));
            }
            square <= FLAT * FLAT * longest || square == 0.0
        })
        .unwrap_or(3)
}
