//! Small clouds, and the internal force on them, for tests of the numerical method itself.
#![allow(dead_code, clippy::unwrap_used)] // each test file takes what it needs; a test may fail loudly

pub mod patch;

use mtled::approximation::table::tetrahedron;
use mtled::approximation::{Basis, Settings, ShapeTable};
use mtled::cloud::{self, Axis, BASE, Cloud, Domain, Feature, Spacing};
use mtled::material::Law;
use mtled::solver::VolumeRatio;
use mtled::solver::{Kernel, Pool};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// Sylgard 527 as in the presets, Pa.
pub const MU: f64 = 1678.0;
/// kappa = 2 mu (1 + nu) / (3 (1 - 2 nu)) at nu = 0.49, Pa.
pub const KAPPA: f64 = 2.0 * MU * 1.49 / 0.06;

pub const MMLS: Option<Basis> = Some(Basis::Quadratic { penalty: 1e-2 });
pub const MLS: Option<Basis> = Some(Basis::Linear);
pub const TET4: Option<Basis> = None;

/// The three approximations, with the presets' penalty.
pub const METHODS: [(&str, Option<Basis>); 3] = [("mmls", MMLS), ("mls", MLS), ("tet4", TET4)];

/// Settings with the presets' support factor.
pub fn settings(basis: Option<Basis>, points_per_cell: u32) -> Settings {
    Settings { basis, support_factor: 1.8, points_per_cell, cells_per_point: 1 }
}

pub const HEIGHT: f64 = 0.017;
pub const CAPTURE_RADIUS: f64 = 0.001;

/// The presets' cylinder with a needle's path, and which nodes interpolate: base and path, as in a scene.
pub fn cylinder_with_path() -> (Cloud, Vec<bool>) {
    let path = Feature::Path {
        axis: Axis::vertical([0.0; 2]),
        capture_radius: CAPTURE_RADIUS,
        length: 0.011,
        spacing: 0.0005,
    };
    let spacing = Spacing { far: 0.003, growth: 0.3, features: vec![path] };
    let cloud = cloud::generate(&Domain::Cylinder { radius: 0.015, height: HEIGHT }, &spacing).unwrap();
    let held = |(p, f): (&[f64; 3], &u8)| f & BASE != 0 || p[0].hypot(p[1]) <= CAPTURE_RADIUS * (1.0 + 1e-9);
    let interpolating = cloud.points.iter().zip(&cloud.faces).map(held).collect();
    (cloud, interpolating)
}

/// A cube of 20 mm with nodes about 4 mm apart.
pub fn cube() -> Cloud {
    cloud::generate(&Domain::Box { size: [0.02; 3] }, &Spacing { far: 0.004, growth: 0.3, features: vec![] }).unwrap()
}

/// Uniform in [0, 1).
pub fn uniform(random: &mut ChaCha8Rng) -> f64 {
    (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64
}

/// A random point of the body: random barycentric coordinates in a random cell.
pub fn inside(cloud: &Cloud, random: &mut ChaCha8Rng) -> [f64; 3] {
    let cell = cloud.cells[(uniform(random) * cloud.cells.len() as f64) as usize];
    let share: [f64; 4] = std::array::from_fn(|_| 0.01 + uniform(random));
    let total: f64 = share.iter().sum();
    std::array::from_fn(|k| (0..4).map(|a| share[a] * cloud.points[cell[a] as usize][k] / total).sum())
}

/// Internal force on every node, N, in double precision and with the presets' volume ratio.
pub fn internal_force(points: &[[f64; 3]], cells: &[[u32; 4]], table: &ShapeTable, u: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let kernel =
        Kernel::<f64>::of_materials(table, cells, points, &[Law::neo_hookean(MU, KAPPA)], VolumeRatio::Projected);
    kernel.internal_force(&mut Pool::new(1), u).force
}

/// Euclidean length.
pub fn norm(v: [f64; 3]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// a - b.
pub fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| a[k] - b[k])
}

/// The cube with its interior nodes pushed at random by up to a seventh of the mean distance, each by less where a cell
/// would lose half of its volume.
pub fn random_cube(seed: u64) -> Cloud {
    let mut cloud = cube();
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let volume = |points: &[[f64; 3]], c: &[u32; 4]| tetrahedron(&c.map(|n| points[n as usize])).0;
    let before: Vec<f64> = cloud.cells.iter().map(|c| volume(&cloud.points, c)).collect();
    let distance = (before.iter().sum::<f64>() / cloud.points.len() as f64).cbrt();
    for n in (0..cloud.points.len()).filter(|&n| cloud.faces[n] == 0).collect::<Vec<_>>() {
        let old = cloud.points[n];
        let push: [f64; 3] = std::array::from_fn(|_| (2.0 * uniform(&mut random) - 1.0) * distance / 7.0);
        for share in [1.0, 0.5, 0.25, 0.0] {
            cloud.points[n] = std::array::from_fn(|k| old[k] + share * push[k]);
            let mut around = cloud.cells.iter().zip(&before).filter(|(c, _)| c.contains(&(n as u32)));
            if around.all(|(c, v)| volume(&cloud.points, c) > 0.5 * v) {
                break;
            }
        }
    }
    cloud
}
