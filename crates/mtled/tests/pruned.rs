//! Supports by group: fewer visits, exact linear fields, the same bits on any number of threads.
#![allow(clippy::unwrap_used)]

use mtled::approximation::axisymmetric::AxisymmetricApproximation;
use mtled::approximation::table::Approximation;
use mtled::approximation::{Basis, Form, Settings, ShapeTable};
use mtled::cloud::{self, Cloud, Domain, Meridian, Spacing, meridian::meridian};
use mtled::material::Law;
use mtled::solver::{Precision, Role, Solver, SolverSettings, VolumeRatio};

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

fn entries(table: &ShapeTable, p: usize) -> std::ops::Range<usize> {
    table.start[p] as usize..table.start[p + 1] as usize
}

/// Bytes that the visits of a step stream per point.
fn visits(table: &ShapeTable, cells: &[[u32; 4]], places: &[[f64; 3]]) -> f64 {
    let settings = SolverSettings {
        law: Law::neo_hookean(1000.0, 50_000.0),
        volume_ratio: VolumeRatio::Projected,
        precision: Precision::F32,
        step_factor: 0.6,
        threads: 1,
    };
    // less the deformation gradient, out and in
    Solver::new(table, cells, places, vec![Role::Free; places.len()], &settings).work().bytes - 72.0
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
    for approximation in
        [new(MMLS).with_regions(&region).with_four_points(&[false, true]), new(Settings { points_per_cell: 4, ..MMLS })]
    {
        let table = approximation.table().unwrap();
        let pruned = approximation.pruned(table.clone(), 2);
        let off = of_linear_fields(&pruned, &cloud.points);
        assert!(pruned.nodes.len() < table.nodes.len() && off < 1e-11, "{off}");
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
