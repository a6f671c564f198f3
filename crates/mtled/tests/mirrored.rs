//! Half of a body that is symmetric about a plane: the same forces as of the whole, on the same nodes.
#![allow(clippy::unwrap_used)]

mod clouds;

use clouds::{HEIGHT, KAPPA, MMLS, MU, TET4, norm, settings, uniform};
use mtled::approximation::ShapeTable;
use mtled::approximation::table::Approximation;
use mtled::cloud::{self, Axis, BASE, Cloud, Domain, Feature, Reflected, Spacing};
use mtled::material::Law;
use mtled::mirror::Mirror;
use mtled::solver::{Advance, Balance, Kernel, Pool, Precision, Role, Solver, SolverSettings, VolumeRatio};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

/// A half, and the whole of which it is the half: nodes of the half come first.
struct Bodies {
    mirror: Mirror,
    half: Cloud,
    whole: Cloud,
    /// Node of each image.
    original: Vec<u32>,
}

const PATH: Axis = Axis { entry: [0.001, 0.0], slope: [0.25, 0.0] };
const CAPTURE_RADIUS: f64 = 0.001;

/// A cylinder with an oblique path, in a plane of symmetry at an azimuth.
fn bodies(azimuth: f64) -> Bodies {
    let path = Feature::Path { axis: PATH, capture_radius: CAPTURE_RADIUS, length: 0.007, spacing: 0.0006 };
    let spacing = Spacing { far: 0.0032, growth: 0.35, features: vec![path] };
    let domain = Domain::Cylinder { radius: 0.015, height: HEIGHT };
    let mirror = Mirror::along([azimuth.cos(), azimuth.sin()]);
    let half = cloud::generate(&domain.half(), &spacing).unwrap().turned(&mirror);
    let Reflected { cloud: whole, original } = Reflected::new(half.clone(), &mirror);
    Bodies { mirror, half, whole, original }
}

impl Bodies {
    /// Base and path, whose parameters are to be values.
    fn held(&self, points: &[[f64; 3]], faces: &[u8]) -> Vec<Role> {
        let on_path = |p: &[f64; 3]| {
            let own = self.mirror.to_own_frame(*p);
            PATH.distance(HEIGHT, own) <= CAPTURE_RADIUS * (1.0 + 1e-9) && own[2] > HEIGHT - 0.004
        };
        let role = |(p, f): (&[f64; 3], &u8)| match f & BASE != 0 {
            true => Role::Base,
            false if on_path(p) => Role::Instrument,
            false => Role::Free,
        };
        points.iter().zip(faces).map(role).collect()
    }

    fn tables(&self, basis: Option<mtled::approximation::Basis>) -> [ShapeTable; 2] {
        self.approximations(basis).map(|(approximation, _)| approximation.table().unwrap())
    }

    /// Tables with consistent gradients.
    fn consistent(&self, basis: Option<mtled::approximation::Basis>) -> [ShapeTable; 2] {
        self.approximations(basis)
            .map(|(approximation, held)| approximation.consistent(approximation.table().unwrap(), &held).unwrap())
    }

    /// Of half and whole, and the nodes that are held.
    fn approximations(&self, basis: Option<mtled::approximation::Basis>) -> [(Approximation, Vec<bool>); 2] {
        let new = |cloud: &Cloud| {
            let held: Vec<bool> = self.held(&cloud.points, &cloud.faces).iter().map(|r| *r != Role::Free).collect();
            (Approximation::new(&cloud.points, &cloud.cells, held.clone(), settings(basis, 1)), held)
        };
        let (half, held) = new(&self.half);
        [(half.with_mirror(self.mirror, &self.mirror.holds(&self.half.points)), held), new(&self.whole)]
    }

    /// A field on the half, within the plane on it, and the symmetric one on the whole.
    fn field(&self, size: f64, seed: u64) -> [Vec<[f64; 3]>; 2] {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let on_plane = self.mirror.holds(&self.half.points);
        let half: Vec<[f64; 3]> = on_plane
            .iter()
            .map(|on| {
                let v = std::array::from_fn(|_| size * (2.0 * uniform(&mut random) - 1.0));
                if *on { self.mirror.within(&v) } else { v }
            })
            .collect();
        let images = self.original.iter().map(|&n| self.mirror.image(&half[n as usize]));
        let whole = half.iter().copied().chain(images).collect();
        [half, whole]
    }
}

#[test]
fn forces_are_those_of_the_whole_to_round_off() {
    for (azimuth, basis, consistent) in [(0.0, MMLS, false), (0.7, MMLS, false), (0.7, TET4, false), (0.7, MMLS, true)]
    {
        let bodies = bodies(azimuth);
        let [half, whole] = if consistent { bodies.consistent(basis) } else { bodies.tables(basis) };
        let [u, all] = bodies.field(1e-4, 3);
        let law = Law::neo_hookean(MU, KAPPA);
        let force = |table: &ShapeTable, cloud: &Cloud, u: &[[f64; 3]]| {
            let kernel =
                Kernel::<f64>::of_materials(table, &cloud.cells, &cloud.points, &[law], VolumeRatio::Pointwise);
            kernel.internal_force(&mut Pool::new(1), u)
        };
        let (half, whole) = (force(&half, &bodies.half, &u), force(&whole, &bodies.whole, &all));
        let largest = whole.force.iter().map(|f| norm(*f)).fold(0.0, f64::max);
        let on_plane = bodies.mirror.holds(&bodies.half.points);
        let mut worst = 0.0_f64;
        for n in 0..u.len() {
            let mine = if on_plane[n] { bodies.mirror.within(&half.force[n]).map(|f| 2.0 * f) } else { half.force[n] };
            worst = worst.max((0..3).map(|k| (mine[k] - whole.force[n][k]).abs()).fold(0.0, f64::max));
        }
        println!("azimuth {azimuth}: largest force {largest:.3e} N, difference {worst:.1e} N");
        assert!(worst < 1e-11 * largest, "{worst} of {largest}");
        assert!((2.0 * half.energy / whole.energy - 1.0).abs() < 1e-12, "{} {}", half.energy, whole.energy);
    }
}

/// With the projected pressure, too, the force is what the energy loses: along any direction that keeps the symmetry.
#[test]
fn the_force_is_the_slope_of_the_energy() {
    let bodies = bodies(0.4);
    let [table, _] = bodies.tables(MMLS);
    let law = Law::neo_hookean(MU, KAPPA);
    let Cloud { points, cells, .. } = &bodies.half;
    let kernel = Kernel::<f64>::of_materials(&table, cells, points, &[law], VolumeRatio::Projected);
    let ([u, _], [way, _]) = (bodies.field(1e-4, 5), bodies.field(1.0, 6));
    let mut pool = Pool::new(1);
    let mut energy = |h: f64| {
        let moved: Vec<[f64; 3]> = u.iter().zip(&way).map(|(u, w)| std::array::from_fn(|k| u[k] + h * w[k])).collect();
        kernel.internal_force(&mut pool, &moved).energy
    };
    let h = 1e-7;
    let slope = (8.0 * (energy(h) - energy(-h)) - (energy(2.0 * h) - energy(-2.0 * h))) / (12.0 * h);
    let force = kernel.internal_force(&mut pool, &u).force;
    let work: f64 = force.iter().zip(&way).map(|(f, w)| (0..3).map(|k| f[k] * w[k]).sum::<f64>()).sum();
    println!("{slope:.9e} {work:.9e}");
    assert!((slope / work - 1.0).abs() < 1e-7, "{slope} {work}");
}

/// What a body exerts after its path was pushed obliquely, and at rest.
fn pushed(bodies: &Bodies, table: &ShapeTable, cloud: &Cloud, ratio: VolumeRatio, threads: usize) -> [Balance; 2] {
    let role = bodies.held(&cloud.points, &cloud.faces);
    let law = Law::neo_hookean(MU, KAPPA);
    let settings = SolverSettings { law, volume_ratio: ratio, precision: Precision::F64, step_factor: 0.8, threads };
    let mut solver = Solver::new(table, &cloud.cells, &cloud.points, role.clone(), &settings);
    let (way, poses) = (bodies.mirror.from_own_frame([3e-4, 0.0, -8e-4]), 60);
    for pose in 1..=poses {
        let place = way.map(|w| w * f64::from(pose) / f64::from(poses));
        (0..role.len()).filter(|&n| role[n] == Role::Instrument).for_each(|n| solver.prescribe(n, place));
        let travel = [way[0], way[1], -way[2]].map(|w| w / f64::from(poses));
        solver.advance(&Advance { steps: 4, travel });
        solver.refresh_if_due();
    }
    let moving = solver.balance();
    for _ in 0..30 {
        solver.advance(&Advance { steps: 20, travel: [0.0; 3] });
        solver.refresh_if_due();
    }
    [moving, solver.balance()]
}

#[test]
fn steps_of_the_half_give_the_balance_of_the_whole() {
    let bodies = bodies(0.7);
    let [half, whole] = bodies.tables(MMLS);
    for (ratio, moving_within, at_rest_within) in
        [(VolumeRatio::Pointwise, 1e-3, 1e-6), (VolumeRatio::Projected, 2e-3, 1e-3)]
    {
        let mine = pushed(&bodies, &half, &bodies.half, ratio, 1);
        assert_eq!(mine, pushed(&bodies, &half, &bodies.half, ratio, 3), "any number of threads");
        let theirs = pushed(&bodies, &whole, &bodies.whole, ratio, 1);
        for ((mine, theirs), within) in mine.iter().zip(&theirs).zip([moving_within, at_rest_within]) {
            let size = norm(theirs.instrument);
            let apart = |a: &[f64; 3], b: &[f64; 3]| norm(std::array::from_fn(|k| a[k] - b[k]));
            let moment = apart(&mine.moment, &theirs.moment) / norm(theirs.moment);
            let [force, base] =
                [(&mine.instrument, &theirs.instrument), (&mine.base, &theirs.base)].map(|(a, b)| apart(a, b) / size);
            let strain = (mine.strain / theirs.strain - 1.0).abs();
            println!(
                "{ratio:?}: force {:?} N, apart {force:.1e}, base {base:.1e}, moment {moment:.1e}, energy {strain:.1e}",
                theirs.instrument
            );
            assert!(force < within && base < within && moment < within && strain < within, "{mine:?} {theirs:?}");
            assert!(bodies.mirror.across(&mine.instrument).abs() < 1e-12 * size, "{:?}", mine.instrument);
        }
    }
}

/// Groups of points of a half are not those of the whole, so other nodes are left out of supports: near, and not the same.
#[test]
fn with_pruned_supports_the_half_is_near_the_whole() {
    let bodies = bodies(0.7);
    for least in [2, 3] {
        let [half, whole] = bodies.approximations(MMLS).map(|(approximation, held)| {
            let table = approximation.pruned(approximation.table().unwrap(), least);
            approximation.consistent(table, &held).unwrap()
        });
        let [_, mine] = pushed(&bodies, &half, &bodies.half, VolumeRatio::Projected, 1);
        let [_, theirs] = pushed(&bodies, &whole, &bodies.whole, VolumeRatio::Projected, 1);
        let apart = norm(std::array::from_fn(|k| mine.instrument[k] - theirs.instrument[k])) / norm(theirs.instrument);
        println!("{least} points: {:?} N, apart {apart:.1e}", theirs.instrument);
        assert!(apart > 0.0 && apart < 0.02, "{least} points: {mine:?} {theirs:?}");
    }
}
