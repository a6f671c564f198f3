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
use super::table::{Form, Row, ShapeTable};
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
    let mut left: Vec<usize> = (0..table.volume.len()).map(|p| entries(&table, p).len()).collect();
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
    let mut all: Vec<u32> = group.iter().flat_map(|&p| &table.nodes[entries(table, p as usize)]).copied().collect();
    all.sort_unstable();
    let enough = |same: &&[u32]| LANES * same.len() >= least * group.len();
    all.chunk_by(|a, b| a == b).filter(enough).map(|same| same[0]).collect()
}

/// A point's row by those of its nodes that stay; none where all do, and where it keeps the others.
fn refitted<B: Supported>(body: &B, table: &ShapeTable, p: usize, stays: impl Fn(u32) -> bool) -> Option<Row> {
    let own = &table.nodes[entries(table, p)];
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
    (squares(&row.gradient) <= STEEPEST * squares(&table.gradient[entries(table, p)])).then_some(row)
}

fn entries(table: &ShapeTable, p: usize) -> std::ops::Range<usize> {
    table.start[p] as usize..table.start[p + 1] as usize
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

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::approximation::axisymmetric::AxisymmetricApproximation;
    use crate::approximation::table::Approximation;
    use crate::approximation::{Basis, Settings};
    use crate::cloud::{self, Cloud, Domain, Meridian, Spacing, meridian::meridian};

    const MMLS: Settings = Settings {
        basis: Some(Basis::Quadratic { penalty: 1e-2 }),
        support_factor: 1.8,
        points_per_cell: 1,
        cells_per_point: 2,
    };
    const BODY: Domain = Domain::Cylinder { radius: 0.012, height: 0.012 };
    const GRADED: f64 = 0.003;

    fn spacing() -> Spacing {
        Spacing { far: GRADED, growth: 0.3, features: vec![cloud::Feature::Rim { top: true, spacing: 0.0012 }] }
    }

    fn body() -> (Cloud, Approximation, ShapeTable) {
        let cloud = cloud::generate(&BODY, &spacing()).unwrap();
        let approximation = Approximation::new(&cloud.points, &cloud.cells, vec![false; cloud.points.len()], MMLS);
        let table = approximation.table().unwrap();
        (cloud, approximation, table)
    }

    /// Visits per group.
    fn visits(table: &ShapeTable, cells: &[[u32; 4]], places: &[[f64; 3]]) -> f64 {
        let groups = table.groups(cells, places);
        let union = |group: &Vec<u32>| shared(table, group, 0).len();
        groups.iter().map(union).sum::<usize>() as f64 / groups.len() as f64
    }

    /// Largest error of the gradient of X_c, c = 0, 1, 2, over all points.
    fn of_linear_fields(table: &ShapeTable, places: &[[f64; 3]]) -> f64 {
        let slope = |p: usize, c: usize, k: usize| -> f64 {
            entries(table, p).map(|e| table.gradient[e][k] * places[table.nodes[e] as usize][c]).sum()
        };
        let off = |p, c, k| (slope(p, c, k) - f64::from(u8::from(c == k))).abs();
        let of = |p| (0..9).map(move |i| off(p, i / 3, i % 3));
        (0..table.volume.len()).flat_map(of).fold(0.0, f64::max)
    }

    #[test]
    fn visits_become_fewer_and_linear_fields_stay_exact() {
        let (cloud, approximation, table) = body();
        let mut before = visits(&table, &cloud.cells, &cloud.points);
        let nodes = |table: &ShapeTable| table.nodes.len() as f64 / table.volume.len() as f64;
        println!("{} points, all: {:.1} nodes, {before:.1} visits", table.volume.len(), nodes(&table));
        for least in [2, 3] {
            let pruned = approximation.pruned(table.clone(), least);
            let now = visits(&pruned, &cloud.cells, &cloud.points);
            let off = of_linear_fields(&pruned, &cloud.points);
            println!("{least}: {:.1} nodes, {now:.1} visits, linear fields {off:.1e}", nodes(&pruned));
            assert!(now < 0.9 * before && nodes(&pruned) < nodes(&table), "{now} {before}");
            assert!(off < 1e-11, "{off}");
            assert!(
                (0..pruned.volume.len())
                    .all(|p| entries(&pruned, p).len() >= Form::Full.fewest().min(entries(&table, p).len()))
            );
            assert_eq!((&pruned.volume, &pruned.cell), (&table.volume, &table.cell));
            let mut has = vec![false; cloud.points.len()];
            pruned.nodes.iter().for_each(|&n| has[n as usize] = true);
            assert!(has.into_iter().all(|has| has), "each node has a point");
            before = now;
        }
    }

    #[test]
    fn one_leaves_none_out() {
        let (_, approximation, table) = body();
        let same = approximation.pruned(table.clone(), 1);
        assert_eq!((&same.start, &same.nodes, &same.gradient), (&table.start, &table.nodes, &table.gradient));
        let elements = Settings { basis: None, ..MMLS };
        let (cloud, ..) = body();
        let approximation = Approximation::new(&cloud.points, &cloud.cells, vec![false; cloud.points.len()], elements);
        let table = approximation.table().unwrap();
        assert_eq!(approximation.pruned(table.clone(), 4).nodes, table.nodes, "elements have no supports");
    }

    #[test]
    fn any_number_of_threads_gives_the_same_bits() {
        let (_, approximation, table) = body();
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| approximation.pruned(table.clone(), 3))
        };
        let (one, two) = (on(1), on(2));
        assert_eq!((one.start, one.nodes, one.gradient), (two.start, two.nodes, two.gradient));
    }

    /// Groups of one region leave the others' points alone, and several points of a cell are told apart.
    #[test]
    fn regions_and_cells_of_four_points_have_their_own() {
        let (cloud, ..) = body();
        let region: Vec<u8> = cloud.cells.iter().map(|c| u8::from(cloud.points[c[0] as usize][2] > 0.006)).collect();
        let new = |settings| Approximation::new(&cloud.points, &cloud.cells, vec![false; cloud.points.len()], settings);
        for approximation in [
            new(MMLS).with_regions(&region).with_four_points(&[false, true]),
            new(Settings { points_per_cell: 4, ..MMLS }),
        ] {
            let table = approximation.table().unwrap();
            let pruned = approximation.pruned(table.clone(), 2);
            let off = of_linear_fields(&pruned, &cloud.points);
            assert!(pruned.nodes.len() < table.nodes.len() && off < 1e-11, "{off}");
            for group in pruned.groups(&cloud.cells, &cloud.points) {
                assert!(group.iter().all(|&p| pruned.region_of(p as usize) == pruned.region_of(group[0] as usize)));
            }
        }
    }

    #[test]
    fn a_half_plane_has_fewer_visits_as_well() {
        let Meridian { points, triangles, .. } = meridian(&BODY, &spacing()).unwrap();
        let approximation = AxisymmetricApproximation::new(&points, &triangles, &vec![false; points.len()], MMLS);
        let cells: Vec<[u32; 4]> = triangles.iter().map(|&[a, b, c]| [a, b, c, c]).collect();
        let table = approximation.table().unwrap();
        let pruned = approximation.pruned(table.clone(), 2);
        let [before, after] = [&table, &pruned].map(|table| visits(table, &cells, &points));
        println!("{before:.1} visits, {after:.1}");
        assert!(after < 0.95 * before, "{after} {before}");
        // u = (r, 0, 0) and (0, 0, z): images have -u_r
        for p in 0..pruned.volume.len() {
            let strain = |component: usize, k: usize| -> f64 {
                let of = |e: usize| {
                    let entry = pruned.nodes[e] as usize;
                    let (node, image) = (entry % points.len(), entry >= points.len());
                    let sign = if image && component == 0 { -1.0 } else { 1.0 };
                    sign * points[node][component] * pruned.gradient[e][k]
                };
                entries(&pruned, p).map(of).sum()
            };
            let off = [strain(0, 0) - 1.0, strain(0, 1) - 1.0, strain(0, 2), strain(2, 2) - 1.0, strain(2, 0)];
            assert!(off.iter().all(|off| off.abs() < 1e-10), "{p}: {off:?}");
        }
    }
}
