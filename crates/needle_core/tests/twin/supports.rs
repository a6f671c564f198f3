//! Bad supports are enlarged and counted; a cloud that no support can help is refused with the reason.
#![allow(clippy::unwrap_used, clippy::panic)]

use crate::clouds;
use crate::clouds::{MLS, MMLS, norm, random_cube, settings};
use mtled::approximation::axisymmetric::AxisymmetricApproximation;
use mtled::approximation::table::Approximation;
use mtled::approximation::{ApproximationError, Basis, Settings, ShapeTable};
use mtled::cloud::check::{Fault, check};
use needle_core::twin::Twin;
use testkit::coarse::{alone, press, scene};

/// Supports that end just beyond the next nodes.
fn tight(basis: Option<Basis>) -> Settings {
    Settings { support_factor: 1.02, ..settings(basis, 1) }
}

/// The corners of a cube of 10 mm and its five tetrahedra.
fn five_cells() -> (Vec<[f64; 3]>, Vec<[u32; 4]>) {
    let corner = |i: u32| [0, 1, 2].map(|k| 0.01 * f64::from(i >> k & 1));
    ((0..8).map(corner).collect(), vec![[0, 1, 2, 4], [3, 2, 1, 7], [5, 4, 7, 1], [6, 7, 4, 2], [1, 4, 7, 2]])
}

/// Largest g = L (sum_j |grad phi_j|^2)^(1/2), L the mean length of the edges at the cell's corners.
fn steepest(points: &[[f64; 3]], cells: &[[u32; 4]], table: &ShapeTable) -> f64 {
    let (mut sum, mut count) = (vec![0.0; points.len()], vec![0.0; points.len()]);
    for c in cells {
        for (a, b) in (0..4).flat_map(|a| (0..a).map(move |b| (c[a] as usize, c[b] as usize))) {
            let length = norm(clouds::minus(points[a], points[b]));
            [a, b].iter().for_each(|&n| sum[n] += length);
            [a, b].iter().for_each(|&n| count[n] += 1.0);
        }
    }
    let edge = |c: [u32; 4]| c.map(|n| sum[n as usize] / count[n as usize]).iter().sum::<f64>() / 4.0;
    let g = |p: usize| {
        let gradients = &table.gradient[table.start[p] as usize..table.start[p + 1] as usize];
        edge(cells[table.cell[p] as usize]) * gradients.iter().flatten().map(|g| g * g).sum::<f64>().sqrt()
    };
    (0..table.volume.len()).map(g).fold(0.0, f64::max)
}

#[test]
fn tight_supports_are_enlarged_until_the_fits_are_good() {
    let cloud = random_cube(3);
    for basis in [MLS, MMLS] {
        let mut approximation =
            Approximation::new(&cloud.points, &cloud.cells, vec![false; cloud.points.len()], tight(basis));
        let before = steepest(&cloud.points, &cloud.cells, &approximation.table().unwrap());
        let table = approximation.repaired_table(&cloud.points).unwrap();
        let (after, repaired) = (steepest(&cloud.points, &cloud.cells, &table), approximation.repaired_supports());
        println!("{basis:?}: {repaired} of {} supports enlarged, g from {before:.2} to {after:.2}", cloud.points.len());
        assert!(before > 5.0 && after <= 4.0 && repaired > 0);
        // one field with the supports that it then has
        assert_eq!(approximation.table().unwrap().gradient, table.gradient);
    }
}

#[test]
fn good_supports_are_left_alone() {
    let cloud = random_cube(3);
    for basis in [MLS, MMLS, None] {
        let mut approximation =
            Approximation::new(&cloud.points, &cloud.cells, vec![false; cloud.points.len()], settings(basis, 1));
        let before = approximation.table().unwrap();
        assert_eq!(approximation.repaired_table(&cloud.points).unwrap().gradient, before.gradient);
        assert_eq!(approximation.repaired_supports(), 0, "{basis:?}");
    }
}

/// A cell several times as long as nodes are apart has the gradients of its neighbours: its support is as good as theirs. Supports that were
/// enlarged round such a cell, beside an oblique path, made the force a tenth to a quarter too large.
#[test]
fn a_long_cell_among_evenly_spaced_nodes_is_left_alone() {
    let (points, mut cells) = lattice(9);
    let long = [[1, 1, 4], [7, 2, 4], [2, 7, 4], [6, 6, 3]].map(|[x, y, z]: [u32; 3]| 81 * z + 9 * y + x);
    cells.push(long);
    let corners = long.map(|n| points[n as usize]);
    let pairs = (0..4).flat_map(|a| (0..a).map(move |b| (a, b)));
    let edge = pairs.map(|(a, b)| norm(clouds::minus(corners[a], corners[b]))).sum::<f64>() / 6.0;
    for basis in [MLS, MMLS] {
        let narrow = Settings { support_factor: 1.3, ..settings(basis, 1) };
        let mut approximation = Approximation::new(&points, &cells, vec![false; points.len()], narrow);
        let table = approximation.repaired_table(&points).unwrap();
        let last = table.volume.len() - 1;
        let gradients = &table.gradient[table.start[last] as usize..table.start[last + 1] as usize];
        let by_its_own_edges = edge * gradients.iter().flatten().map(|g| g * g).sum::<f64>().sqrt();
        println!("{basis:?}: {by_its_own_edges:.2} by its own edges, at most {:.2}", steepest(&points, &cells, &table));
        assert!(by_its_own_edges > 4.0, "a cell that would have been taken for one with a bad support");
        assert_eq!(approximation.repaired_supports(), 0, "{basis:?}");
    }
}

/// Nodes 1 mm apart, n in each direction, and the six tetrahedra of each cube round its diagonal.
fn lattice(n: u32) -> (Vec<[f64; 3]>, Vec<[u32; 4]>) {
    let points = (0..n * n * n).map(|i| [i % n, i / n % n, i / (n * n)].map(|k| 1e-3 * f64::from(k))).collect();
    let step = [1, n, n * n];
    let orders = [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]];
    let mut cells = Vec::new();
    for i in (0..n * n * n).filter(|i| [i % n, i / n % n, i / (n * n)].iter().all(|k| *k < n - 1)) {
        for (k, [a, b, c]) in orders.into_iter().enumerate() {
            let [p, q, r] = [i + step[a], i + step[a] + step[b], i + step[a] + step[b] + step[c]];
            cells.push(if k < 3 { [i, p, q, r] } else { [i, q, p, r] });
        }
    }
    (points, cells)
}

/// Two sheets of nodes, each with cells that are squashed flat: no support reaches from one sheet to the other.
#[test]
fn support_nodes_in_one_plane_are_refused() {
    let sheet = |z: f64| (0..16).map(move |i| [1e-3 * f64::from(i / 4), 1e-3 * f64::from(i % 4), z]);
    let points: Vec<[f64; 3]> = sheet(0.0).chain(sheet(0.02)).collect();
    let cells = [[0, 1, 4, 5], [16, 17, 20, 21]];
    let mut approximation = Approximation::new(&points, &cells, vec![false; points.len()], settings(MLS, 1));
    let error = approximation.repaired_table(&[]).unwrap_err();
    assert!(matches!(error, ApproximationError::Coplanar { shape: "plane", .. }), "{error}");
    assert!(error.to_string().contains("lie in one plane") && error.to_string().contains("add nodes"), "{error}");
}

/// The same, a few supports apart: they are enlarged until they reach across.
#[test]
fn a_singular_support_is_enlarged() {
    let sheet = |z: f64| (0..16).map(move |i| [1e-3 * f64::from(i / 4), 1e-3 * f64::from(i % 4), z]);
    let points: Vec<[f64; 3]> = sheet(0.0).chain(sheet(0.004)).collect();
    let cells = [[0, 1, 4, 5], [16, 17, 20, 21]];
    let mut approximation = Approximation::new(&points, &cells, vec![false; points.len()], settings(MLS, 1));
    assert!(matches!(approximation.table(), Err(ApproximationError::Coplanar { .. })));
    let table = approximation.repaired_table(&[]).unwrap();
    assert!(approximation.repaired_supports() > 0);
    // d z / d z = 1
    let slope: f64 = (table.start[0]..table.start[1])
        .map(|e| e as usize)
        .map(|e| table.gradient[e][2] * points[table.nodes[e] as usize][2])
        .sum();
    assert!((slope - 1.0).abs() < 1e-9, "{slope}");
}

#[test]
fn points_outside_every_support_are_refused() {
    let cloud = random_cube(1);
    let mut approximation =
        Approximation::new(&cloud.points, &cloud.cells, vec![false; cloud.points.len()], settings(MMLS, 1));
    let far = [0.0, 0.0, 0.5];
    let error = approximation.repaired_table(&[far]).unwrap_err();
    assert_eq!(error, ApproximationError::Uncovered { at: far });
    assert!(error.to_string().contains("outside the support of every node"), "{error}");
    assert_eq!(approximation.repaired_supports(), 0, "nothing was enlarged in vain");
}

/// A quadratic basis without a penalty takes ten nodes; a cube has eight.
#[test]
fn a_cloud_too_small_for_its_basis_is_refused() {
    let (points, cells) = five_cells();
    check(&points, &cells).unwrap();
    let table = |basis| Approximation::new(&points, &cells, vec![false; 8], settings(basis, 1)).repaired_table(&points);
    let error = table(Some(Basis::Quadratic { penalty: 0.0 })).unwrap_err();
    assert!(matches!(error, ApproximationError::Singular { nodes: 8, .. }), "{error}");
    assert!(error.to_string().contains("penalty > 0") && error.to_string().contains("mls"), "{error}");
    for basis in [MLS, MMLS, None] {
        table(basis).unwrap();
    }
}

/// All nodes in one plane: the cells have no volume, and so the cloud is no body.
#[test]
fn a_flat_cloud_is_no_body() {
    let (mut points, cells) = five_cells();
    points.iter_mut().for_each(|p| p[2] = 0.5 * p[0]);
    assert!(matches!(check(&points, &cells), Err(Fault::Duplicate { .. } | Fault::Flat { .. })));
}

#[test]
fn a_half_plane_is_repaired_as_well() {
    use mtled::cloud::{Domain, Spacing, meridian::meridian};
    let spacing = Spacing { far: 0.002, growth: 0.3, features: vec![] };
    let plane = meridian(&Domain::Cylinder { radius: 0.015, height: 0.017 }, &spacing).unwrap();
    for basis in [MLS, MMLS] {
        let mut approximation = AxisymmetricApproximation::new(
            &plane.points,
            &plane.triangles,
            &vec![false; plane.points.len()],
            tight(basis),
        );
        approximation.repaired_table(&plane.points).unwrap();
        println!("{basis:?}: {} of {} supports enlarged", approximation.repaired_supports(), plane.points.len());
        assert!(approximation.repaired_supports() > 0);
    }
    // far from the axis, beyond which their images would be
    let line: Vec<[f64; 3]> = (0..6).map(|i| [0.02 + 1e-3 * f64::from(i), 0.0, 2e-3 * f64::from(i)]).collect();
    let triangles = [[0, 1, 2], [3, 4, 5]];
    let error = AxisymmetricApproximation::new(&line, &triangles, &[false; 6], settings(MLS, 1))
        .repaired_table(&[])
        .unwrap_err();
    assert!(matches!(error, ApproximationError::Coplanar { shape: "line", .. }), "{error}");
}

/// A scene that asks for supports too small has the force of one that doesn't.
#[test]
fn a_scene_with_tight_supports_is_repaired_and_says_so() {
    let model = |factor: &str, dimension: &str| {
        let keys = [("discretisation.support_factor", factor), ("discretisation.dimension", dimension)];
        alone(|| {
            let mut twin = Twin::new(&scene("indentation", &keys)).unwrap();
            (twin.repaired_supports(), press(&mut twin, 1e-3).force_n[2])
        })
    };
    for dimension in ["full", "axisymmetric"] {
        let ((none, expected), (repaired, force)) = (model("1.8", dimension), model("1.05", dimension));
        println!("{dimension}: {repaired} supports enlarged, {force:.5} N of {expected:.5} N");
        assert_eq!(none, 0);
        assert!(repaired > 0 && (force / expected - 1.0).abs() < 0.1, "{repaired} {force} {expected}");
    }
}
