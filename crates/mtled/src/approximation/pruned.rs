//! Supports by group: a support node that few of the points beside each other have is left out.
//!
//! The kernel takes integration points in groups of up to eight that lie close together, one to a lane, and visits each node of the union of
//! their supports once. Many nodes of a union are at the rim of one or two supports alone. But a support need not be a ball. With S_g the
//! support nodes of point g, and its group G of |G| points, node j is left out of the supports of the whole group where
//!
//! ```text
//! 8 |{g in G : j in S_g}|  <  k |G|                 k: fewest of eight points for a support node; 1 leaves none out
//! ```
//!
//! and each point is fitted once more, at its own place X_g and with the same weights, by the nodes that are left to it. Such a fit still
//! reproduces what its basis holds: linear fields stay exact. A point keeps all of its nodes where fewer than [`Form::fewest`] would be left,
//! where those give no fit, or where their gradients would be much steeper (1/m^2):
//!
//! ```text
//! sum_j |grad phi'_j|^2  >  1.2 sum_j |grad phi_j|^2
//! ```
//!
//! A node that every group would leave out stays in all of its supports: without any point it would have no stiffness.
//!
//! The sums over points that a balance of forces needs are another matter: gradients are made consistent afterwards. Fields at places, those
//! of targets for instance, keep their whole supports.

use rayon::prelude::*;

use super::mls::Neighbour;
use super::repair::Supported;
use super::shape_table::{Form, Row, ShapeTable};
use crate::number::LANES;

/// Squares of a point's gradients, over those with all of its nodes, up to which it is fitted by fewer.
const STEEPEST: f64 = 1.2;
/// Nodes that a fit needs at least beyond the monomials of a complete quadratic basis.
const SPARE: usize = 2;
/// Groups whose rows are held at a time.
const GROUPS_AT_A_TIME: usize = 512;

impl Form {
    /// Fewest support nodes that a point may be left with: two more than a complete quadratic basis has monomials, 10 in space and 6 in a
    /// half plane.
    #[must_use]
    pub const fn fewest(self) -> usize {
        match self {
            Self::Full | Self::Mirrored(_) => 10 + SPARE,
            Self::Axisymmetric => 6 + SPARE,
        }
    }
}

/// The table of a body without the support nodes that fewer than `least` of eight points beside each other have. `cells` by their corners,
/// with the places of the nodes, m.
pub(super) fn pruned<B: Supported>(
    body: &B,
    (cells, places): (&[[u32; 4]], &[[f64; 3]]),
    mut table: ShapeTable,
    least: u32,
) -> ShapeTable {
    if least <= 1 {
        return table;
    }
    let groups: Vec<(Vec<u32>, Vec<u32>)> = table
        .groups(cells, places)
        .into_par_iter()
        .map(|group| {
            let shared = shared(&table, &group, least as usize);
            (group, shared)
        })
        .collect();
    let mut kept = vec![false; places.len()];
    groups.iter().flat_map(|(_, shared)| shared).for_each(|&entry| kept[entry as usize % places.len()] = true);
    let mut left: Vec<usize> = (0..table.volume.len()).map(|p| table.entries(p).len()).collect();
    for groups in groups.chunks(GROUPS_AT_A_TIME) {
        let of_group = |(group, shared): &(Vec<u32>, Vec<u32>)| -> Vec<(usize, Row)> {
            let stays = |entry: u32| shared.binary_search(&entry).is_ok() || !kept[entry as usize % places.len()];
            group.iter().filter_map(|&p| Some((p as usize, refitted(body, &table, p as usize, stays)?))).collect()
        };
        let rows: Vec<Vec<(usize, Row)>> = groups.par_iter().map(of_group).collect();
        for (p, row) in rows.into_iter().flatten() {
            let from = table.start[p] as usize;
            left[p] = row.nodes.len();
            table.nodes[from..from + left[p]].copy_from_slice(&row.nodes);
            table.gradient[from..from + left[p]].copy_from_slice(&row.gradient);
        }
    }
    close_up(&mut table, &left);
    table
}

/// Leaves out the neighbours that are not `among` the entries, ascending; `entry` of a neighbour's index.
pub(super) fn keep(among: Option<&[u32]>, neighbours: &mut Vec<Neighbour>, entry: impl Fn(u32) -> u32) {
    if let Some(among) = among {
        neighbours.retain(|n| among.binary_search(&entry(n.node)).is_ok());
    }
}

/// Entries that enough points of a group have, ascending.
fn shared(table: &ShapeTable, group: &[u32], least: usize) -> Vec<u32> {
    let mut all: Vec<u32> = group.iter().flat_map(|&p| &table.nodes[table.entries(p as usize)]).copied().collect();
    all.sort_unstable();
    let enough = |same: &&[u32]| LANES * same.len() >= least * group.len();
    all.chunk_by(|a, b| a == b).filter(enough).map(|same| same[0]).collect()
}

/// A point's row by those of its nodes that stay; none where all do, and where it keeps the others.
fn refitted<B: Supported>(body: &B, table: &ShapeTable, p: usize, stays: impl Fn(u32) -> bool) -> Option<Row> {
    let own = &table.nodes[table.entries(p)];
    let mut among: Vec<u32> = own.iter().copied().filter(|&entry| stays(entry)).collect();
    if among.len() == own.len() || among.len() < table.form.fewest() {
        return None;
    }
    among.sort_unstable();
    let cell = table.cell[p];
    let first = table.cell.partition_point(|&c| c < cell);
    let point = body.points(cell as usize)[p - first];
    let row = body.row(cell as usize, point, Some(&among)).ok()?;
    let squares = |gradient: &[[f64; 3]]| gradient.iter().flatten().map(|g| g * g).sum::<f64>();
    (squares(&row.gradient) <= STEEPEST * squares(&table.gradient[table.entries(p)])).then_some(row)
}

/// Moves the rows together, of each of which the first `left` entries count.
fn close_up(table: &mut ShapeTable, left: &[usize]) {
    let mut end = 0;
    for (p, &left) in left.iter().enumerate() {
        let from = table.start[p] as usize;
        table.nodes.copy_within(from..from + left, end);
        table.gradient.copy_within(from..from + left, end);
        table.start[p] = end as u32;
        end += left;
    }
    table.start[left.len()] = end as u32;
    table.nodes.truncate(end);
    table.gradient.truncate(end);
}
