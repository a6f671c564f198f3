//! Patch test and rigid motions of an approximation of a cloud.

use approx::assert_abs_diff_eq;
use mtled::approximation::ShapeTable;
use mtled::approximation::table::Approximation;
use mtled::cloud::Cloud;
use mtled::material::Law;
use mtled::solver::{Advance, Precision, Role, Solver, SolverSettings, VolumeRatio};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use super::{KAPPA, MU, inside, internal_force, minus, norm};

/// Stretch, compression and shear of up to 10 %, and a change of volume of about 1 %.
const A: [[f64; 3]; 3] = [[0.06, 0.08, -0.03], [0.02, -0.05, 0.1], [0.04, -0.02, 0.01]];

fn linear(x: [f64; 3]) -> [f64; 3] {
    A.map(|row| (0..3).map(|k| row[k] * x[k]).sum())
}

/// Nodes on the surface.
pub fn boundary(cloud: &Cloud) -> Vec<bool> {
    cloud.faces.iter().map(|f| *f != 0).collect()
}

/// Largest error of the field at a cube's nodes and at random points, over the largest displacement; `consistent`: with corrected gradients;
/// `least`: on supports without the nodes that fewer of eight points have.
pub fn patch_error(cloud: &Cloud, approximation: &Approximation, consistent: bool, least: u32) -> f64 {
    let boundary = boundary(cloud);
    let table = approximation.table().unwrap();
    assert_whole(cloud, &table);
    let table = approximation.pruned(table, least);
    let table = if consistent { approximation.consistent(table, &boundary).unwrap() } else { table };
    let role = boundary.iter().map(|b| if *b { Role::Instrument } else { Role::Free }).collect();
    let settings = SolverSettings {
        law: Law::neo_hookean(MU, KAPPA),
        volume_ratio: VolumeRatio::Projected,
        precision: Precision::F64,
        step_factor: 0.9,
        threads: 1,
    };
    let mut solver = Solver::new(&table, &cloud.cells, &cloud.points, role, &settings);
    for n in (0..boundary.len()).filter(|&n| boundary[n]) {
        solver.prescribe(n, linear(cloud.points[n]));
    }
    // the deviation dies down as exp(-omega n), or faster: exp(-30) is round-off
    let slowly = |times: f64| Advance { steps: (times / solver.slowest()).ceil() as u32, travel: [0.0; 3] };
    let (load, rest) = (slowly(2.0), slowly(30.0));
    solver.advance(&load);
    solver.advance(&rest);
    let mut random = ChaCha8Rng::seed_from_u64(2);
    let mut at = cloud.points.clone();
    at.extend((0..300).map(|_| inside(cloud, &mut random)));
    let field = approximation.field(&at).unwrap();
    let largest = at.iter().map(|x| norm(linear(*x))).fold(0.0, f64::max);
    let error = |i: usize| norm(minus(field.at(i, solver.parameters()), linear(at[i])));
    (0..at.len()).map(error).fold(0.0, f64::max) / largest
}

/// The points stand for the whole volume.
fn assert_whole(cloud: &Cloud, table: &ShapeTable) {
    let (cells, points): (f64, f64) = (cloud.volumes().iter().sum(), table.volume.iter().sum());
    assert!((points / cells - 1.0).abs() < 1e-12, "{points} of {cells} m^3");
}

/// Rigid motions cause no force, and come out as they are.
pub fn assert_rigid_motions(cloud: &Cloud, name: &str, approximation: &Approximation) {
    let turn = nalgebra::Rotation3::new(nalgebra::Vector3::new(0.9, -1.2, 0.4)).into_inner();
    let shift = [0.004, -0.02, 0.01];
    let translated = |_: [f64; 3]| shift;
    let rotated = |x: [f64; 3]| {
        let r = turn * nalgebra::Vector3::from(x);
        std::array::from_fn(|k| r[k] - x[k] + shift[k])
    };
    type Motion<'a> = (&'a str, &'a dyn Fn([f64; 3]) -> [f64; 3]);
    let motions: [Motion; 2] = [("translation", &translated), ("rotation", &rotated)];
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let at: Vec<_> = (0..300).map(|_| inside(cloud, &mut random)).collect();
    let (table, field) = (approximation.table().unwrap(), approximation.field(&at).unwrap());
    for (motion, displacement) in motions {
        let u: Vec<[f64; 3]> = cloud.points.iter().map(|x| displacement(*x)).collect();
        let force = internal_force(&cloud.points, &cloud.cells, &table, &u);
        let largest = force.iter().map(|f| norm(*f)).fold(0.0, f64::max);
        // the force of a unit strain on a cell's face is mu h^2; kappa is 50 mu, and round-off is 1e-16
        let unit = MU * 0.004 * 0.004;
        println!("{name}, {motion}: {:.1e}", largest / unit);
        assert!(largest < 1e-11 * unit, "{name}, {motion}: {:.1e} of mu h^2", largest / unit);
        for (i, x) in at.iter().enumerate() {
            let (got, want) = (field.at(i, &u), displacement(*x));
            (0..3).for_each(|k| assert_abs_diff_eq!(got[k], want[k], epsilon = 1e-14));
        }
    }
}
