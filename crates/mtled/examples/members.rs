//! Time of a step of eight members of one cloud, each alone and all in a team, on one thread: a column of nodes is pressed into a
//! cylinder, in a half plane and in space.
#![allow(clippy::unwrap_used)] // an example may fail loudly

use std::sync::Arc;
use std::time::Instant;

use mtled::approximation::axisymmetric::AxisymmetricApproximation;
use mtled::approximation::table::Approximation;
use mtled::approximation::{Basis, Settings, ShapeTable};
use mtled::cloud::{self, Axis, BASE, Domain, Feature, Spacing};
use mtled::material::Law;
use mtled::solver::{Advance, Precision, Role, Solver, SolverSettings, Team, VolumeRatio};

const BODY: Domain = Domain::Cylinder { radius: 0.0175, height: 0.017 };
const SETTINGS: Settings = Settings {
    basis: Some(Basis::Quadratic { penalty: 1e-2 }),
    support_factor: 1.8,
    points_per_cell: 1,
    cells_per_point: 1,
};
/// m
const DEPTH: f64 = 1e-3;

fn main() {
    half_plane();
    space();
}

/// Spacing in metres, finer about the path.
fn spacing(far: f64) -> Spacing {
    let axis = Axis { entry: [0.0; 2], slope: [0.0; 2] };
    let path = Feature::Path { axis, capture_radius: 1e-3, length: 0.012, spacing: 8e-4 };
    Spacing { far, growth: 0.3, features: vec![path] }
}

fn roles(points: &[[f64; 3]], faces: &[u8]) -> Vec<Role> {
    let role = |(p, faces): (&[f64; 3], &u8)| match p {
        _ if faces & BASE != 0 => Role::Base,
        [x, y, z] if x.hypot(*y) <= 1e-9 && *z > 0.01 => Role::Instrument,
        _ => Role::Free,
    };
    points.iter().zip(faces).map(role).collect()
}

fn held(roles: &[Role]) -> Vec<bool> {
    roles.iter().map(|role| *role != Role::Free).collect()
}

fn half_plane() {
    let plane = cloud::meridian::meridian(&BODY, &spacing(0.002)).unwrap();
    let roles = roles(&plane.points, &plane.faces);
    let approximation = AxisymmetricApproximation::new(&plane.points, &plane.triangles, &held(&roles), SETTINGS);
    let cells: Vec<[u32; 4]> = plane.triangles.iter().map(|&[a, b, c]| [a, b, c, c]).collect();
    measure("half plane", &approximation.table().unwrap(), &cells, &plane.points, &roles, 4000);
}

fn space() {
    let body = cloud::generate(&BODY, &spacing(0.0016)).unwrap();
    let roles = roles(&body.points, &body.faces);
    let table = Approximation::new(&body.points, &body.cells, held(&roles), SETTINGS).table().unwrap();
    measure("space", &table, &body.cells, &body.points, &roles, 60);
}

fn law(k: usize) -> Law {
    Law::neo_hookean(1678.0 * (0.8 + 0.05 * k as f64), 83_340.0)
}

fn measure(name: &str, table: &ShapeTable, cells: &[[u32; 4]], points: &[[f64; 3]], roles: &[Role], poses: u32) {
    let settings = SolverSettings {
        law: law(0),
        volume_ratio: VolumeRatio::Projected,
        precision: Precision::F32,
        step_factor: 0.8,
        threads: 1,
    };
    let first = Solver::new(table, cells, points, roles.to_vec(), &settings);
    let new = || (0..Team::MOST).map(|k| Solver::of(Arc::new(first.model().with_laws(&[law(k)])), 1)).collect();
    let (mut alone, mut together): (Vec<Solver>, Vec<Solver>) = (new(), new());
    let mut team = Team::new(&together.iter().collect::<Vec<_>>(), None).unwrap();
    let travel = [0.0, 0.0, DEPTH / f64::from(poses)];
    let mut seconds = [0.0; 2];
    for pose in 1..=poses {
        for solver in alone.iter_mut().chain(&mut together) {
            let held = (0..roles.len()).filter(|&n| roles[n] == Role::Instrument);
            held.for_each(|n| solver.prescribe(n, [0.0, 0.0, -travel[2] * f64::from(pose)]));
        }
        let start = Instant::now();
        for solver in &mut alone {
            solver.refresh_if_due();
            solver.advance(&Advance { steps: 1, travel });
        }
        seconds[0] += start.elapsed().as_secs_f64();
        let start = Instant::now();
        let mut all = together.iter_mut();
        team.advance(&mut std::array::from_fn(|_| all.next()), &[1; Team::MOST], &[travel; Team::MOST]);
        seconds[1] += start.elapsed().as_secs_f64();
    }
    let force = |s: &Solver| s.balance().instrument[2];
    let off = alone.iter().zip(&together).map(|(a, b)| (force(a) / force(b) - 1.0).abs()).fold(0.0, f64::max);
    let [one, eight] = seconds.map(|s| 1e6 * s / f64::from(poses) / Team::MOST as f64);
    println!(
        "{name}, {} nodes, {} points: a member and step takes {one:.1} us alone, {eight:.1} us in a team, {:.2} times less; forces \
         differ by {off:.1e}",
        points.len(),
        table.volume.len(),
        one / eight
    );
}
