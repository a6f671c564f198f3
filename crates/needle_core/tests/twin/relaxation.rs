//! Contract of the relaxing material: closed forms at a point, the long term of a held indentation, work and energy,
//! and that its memory is saved, restored and forgotten with the state.
#![allow(clippy::unwrap_used)]

use crate::clouds;
use crate::clouds::{KAPPA, MU, settings};
use approx::assert_relative_eq;
use mtled::approximation::table::Approximation;
use mtled::cloud::{BASE, Cloud};
use mtled::material::{Law, Prony};
use mtled::solver::{Advance, Role, Solver, SolverSettings};
use mtled::solver::{Precision, VolumeRatio};
use needle_core::twin::{Prediction, StampedPose, Twin};
use testkit::coarse::{digits, scene};

const SHARES: [f64; 2] = [0.3, 0.2];
const TIMES: [f64; 2] = [0.4, 3.0];

fn law(shares: &[f64], times: &[f64]) -> Law {
    Law { prony: Prony::new(shares, times).unwrap(), ..Law::neo_hookean(MU, KAPPA) }
}

/// g(t) of the two terms.
fn relaxation(t: f64) -> f64 {
    0.5 + SHARES.iter().zip(TIMES).map(|(g, tau)| g * (-t / tau).exp()).sum::<f64>()
}

fn solver(cloud: &Cloud, role: Vec<Role>, law: Law) -> Solver {
    let held = role.iter().map(|r| *r != Role::Free).collect();
    let table = Approximation::new(&cloud.points, &cloud.cells, held, settings(clouds::TET4, 1)).table().unwrap();
    let settings = SolverSettings {
        law,
        volume_ratio: VolumeRatio::Pointwise,
        precision: Precision::F64,
        step_factor: 0.9,
        threads: 1,
    };
    Solver::new(&table, &cloud.cells, &cloud.points, role, &settings)
}

/// A cube whose every node is held: one state of stress.
struct Point {
    cloud: Cloud,
    solver: Solver,
}

impl Point {
    fn new(law: Law) -> Self {
        let cloud = clouds::cube();
        let role = vec![Role::Instrument; cloud.points.len()];
        Self { solver: solver(&cloud, role, law), cloud }
    }

    /// Takes the point to a simple shear at a time.
    fn shear(&mut self, time_s: f64, gamma: f64) {
        for (n, x) in self.cloud.points.iter().enumerate() {
            self.solver.prescribe(n, [gamma * x[1], 0.0, 0.0]);
        }
        self.solver.relax_until(time_s);
        self.solver.advance(&Advance { steps: 1, travel: [0.0; 3] });
        self.solver.commit(time_s);
    }

    /// P12, Pa: J = 1, so the volume has no part in it.
    fn stress(&self) -> f64 {
        let mut first = None;
        self.solver.for_points(|_, _, p, _| {
            let stress = *first.get_or_insert(p[1]);
            assert!((p[1] - stress).abs() < 1e-9 * MU, "every point has the same stress");
        });
        first.unwrap()
    }
}

#[test]
fn a_sheared_point_relaxes_as_the_series_says() {
    let mut point = Point::new(law(&SHARES, &TIMES));
    point.shear(0.0, 0.0);
    point.shear(0.0, 0.5);
    // a jump in no time: the instantaneous modulus, at any strain
    assert_relative_eq!(point.stress(), 0.5 * MU, max_relative = 1e-12);
    let mut t: f64 = 0.0;
    for k in 0..60 {
        // steps of a hundredth of the shorter time to five times the longer one
        t += 0.004 * 1.15f64.powi(k);
        point.shear(t, 0.5);
        assert_relative_eq!(point.stress(), 0.5 * MU * relaxation(t), max_relative = 1e-12);
    }
}

#[test]
fn a_slow_ramp_has_the_stress_of_linear_viscoelasticity() {
    let rate = 1e-4;
    let mut point = Point::new(law(&SHARES, &TIMES));
    for k in 0..=50 {
        let t = 0.1 * f64::from(k);
        point.shear(t, rate * t);
        let lagging: f64 = SHARES.iter().zip(TIMES).map(|(g, tau)| g * tau * (1.0 - (-t / tau).exp())).sum();
        // the strain reaches 5e-4, its square is what the linear theory leaves out
        assert_relative_eq!(point.stress(), MU * rate * (0.5 * t + lagging), max_relative = 1e-6, epsilon = 1e-12);
    }
}

/// Large strain: against the convolution integral of the second Piola-Kirchhoff stress, by the midpoint rule.
#[test]
fn a_large_ramp_converges_to_the_convolution_integral() {
    // J = 1: Pi = mu (I - I1/3 C^-1), with C of the simple shear
    let reference = |g: f64| {
        let third = (3.0 + g * g) / 3.0;
        [MU * (1.0 - third * (1.0 + g * g)), MU * (1.0 - third), MU * (1.0 - third), MU * third * g, 0.0, 0.0]
    };
    let (end, total) = (0.8, 2.0);
    let fine = 40_000;
    let mut pi = [0.0; 6];
    for k in 0..fine {
        let at = |k: f64| reference(total * k / f64::from(fine));
        let (a, b) = (at(f64::from(k)), at(f64::from(k + 1)));
        let left = end * (1.0 - (f64::from(k) + 0.5) / f64::from(fine));
        (0..6).for_each(|i| pi[i] += relaxation(left) * (b[i] - a[i]));
    }
    let f = [1.0, total, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let cof = mtled::material::neo_hookean::cofactor(&f);
    let exact = mtled::material::prony::held(&f, &cof, 1.0, &pi).1[1];
    let error = |steps: u32| {
        let mut point = Point::new(law(&SHARES, &TIMES));
        for k in 0..=steps {
            let share = f64::from(k) / f64::from(steps);
            point.shear(end * share, total * share);
        }
        (point.stress() / exact - 1.0).abs()
    };
    let (coarse, fine) = (error(8), error(32));
    println!("error in 8 steps {coarse:.1e}, in 32 {fine:.1e}");
    assert!(coarse < 5e-3 && fine < coarse / 10.0, "second order: {coarse:.1e} {fine:.1e}");
}

#[test]
fn infinitely_fast_and_slow_relaxation_is_elastic() {
    for (times, share) in [([1e-9, 1e-8], 0.5), ([1e8, 1e9], 1.0)] {
        let mut point = Point::new(law(&SHARES, &times));
        point.shear(0.0, 0.0);
        for k in 1..=5 {
            let t = f64::from(k);
            point.shear(t, 0.1 * t);
            assert_relative_eq!(point.stress(), share * MU * 0.1 * t, max_relative = 1e-7);
        }
    }
}

#[test]
fn memory_is_restored_and_forgotten_with_the_state() {
    let mut point = Point::new(law(&SHARES, &TIMES));
    let history = |point: &mut Point| {
        point.shear(0.0, 0.0);
        point.shear(0.3, 0.4);
        point.solver.save();
        point.shear(0.7, -0.2);
        point.shear(0.9, 0.3);
        point.stress()
    };
    let first = history(&mut point);
    for (n, x) in point.cloud.points.iter().enumerate() {
        point.solver.prescribe(n, [0.3 * x[1], 0.0, 0.0]);
    }
    // what lay between is forgotten: one increment from the kept state
    point.solver.restore(1.0);
    point.solver.relax_again(0.9);
    point.solver.advance(&Advance { steps: 3, travel: [0.0; 3] });
    let again = point.stress();
    point.solver.reset();
    point.shear(0.0, 0.0);
    point.shear(0.3, 0.4);
    point.shear(0.9, 0.3);
    assert_relative_eq!(again, point.stress(), max_relative = 1e-12);
    assert!((again / first - 1.0).abs() > 1e-3, "the way there matters: {again} {first}");
    point.solver.reset();
    assert_eq!(history(&mut point).to_bits(), first.to_bits());
}

/// Energy goes on without a jump from increment to increment, so it is the work done on the body, stored or lost.
#[test]
fn the_energy_is_the_work_done() {
    let cloud = clouds::cube();
    let role = |(x, f): (&[f64; 3], &u8)| match *f {
        f if f & BASE != 0 => Role::Base,
        _ if x[2] > 0.02 - 1e-9 => Role::Instrument,
        _ => Role::Free,
    };
    let role: Vec<Role> = cloud.points.iter().zip(&cloud.faces).map(role).collect();
    let mut solver = solver(&cloud, role.clone(), law(&SHARES, &TIMES));
    let still = Advance { steps: (8.0 / solver.slowest()).ceil() as u32, travel: [0.0; 3] };
    // largest difference, largest work and work of the whole cycle
    let mut cycle = |poses: i32| {
        solver.reset();
        let (mut off, mut most, mut work) = (0.0f64, 0.0f64, 0.0);
        for k in 1..=poses {
            let share = |k: i32| f64::from(k) / f64::from(poses);
            let depth = |k: i32| 2e-3 * (share(k) * std::f64::consts::PI).sin();
            // the force falls with no work done, then the body moves and comes to rest
            solver.relax_again(3.0 * share(k));
            let before = solver.balance().instrument[2];
            let held = (0..role.len()).filter(|&n| role[n] == Role::Instrument);
            held.for_each(|n| solver.prescribe(n, [0.0, 0.0, -depth(k)]));
            solver.advance(&still);
            solver.advance(&still);
            solver.commit(3.0 * share(k));
            let balance = solver.balance();
            work += 0.5 * (before + balance.instrument[2]) * (depth(k) - depth(k - 1));
            most = most.max(work);
            off = off.max((balance.strain - work).abs());
        }
        (off / most, most, work / most)
    };
    let (coarse, fine) = (cycle(30), cycle(120));
    println!(
        "{:.1} % of {:.3e} J is lost in the cycle; energy and work differ by {:.2} %, {:.2} %",
        100.0 * fine.2,
        fine.1,
        100.0 * coarse.0,
        100.0 * fine.0
    );
    assert!(fine.2 > 0.05, "a cycle costs energy");
    assert!(fine.0 < 0.02 && fine.0 < 0.4 * coarse.0, "in shorter increments they agree: {} {}", coarse.0, fine.0);
}

fn at(twin: &mut Twin, time_s: f64, depth_m: f64) -> Prediction {
    twin.step(StampedPose { time_s, pose: twin.pose_at_depth(depth_m) }).unwrap()
}

const HELD: f64 = 1e-3;

/// Presses in no time and rests, still in no time.
fn press(twin: &mut Twin) -> f64 {
    for k in 1..=20 {
        at(twin, 0.0, HELD * f64::from(k) / 20.0);
    }
    for _ in 0..1000 {
        let answer = at(twin, 0.0, HELD);
        if answer.steps == 0 {
            return answer.force_n[2];
        }
    }
    f64::NAN
}

const RELAXING: [(&str, &str); 2] = [("material.prony_shares", "0.3, 0.2"), ("material.prony_times_s", "0.4, 3.0")];

/// Poisson's ratio of a material whose shear modulus has fallen to half while its bulk modulus stays.
fn long_term_ratio(nu: f64) -> f64 {
    let kappa_over_mu = 2.0 * 2.0 * (1.0 + nu) / (3.0 * (1.0 - 2.0 * nu));
    (3.0 * kappa_over_mu - 2.0) / (2.0 * (3.0 * kappa_over_mu + 1.0))
}

/// The volume does not relax, so the tissue in the end is softer and less compressible: at nu = 0.499, where that
/// makes no difference, the force falls by the long-term share.
#[test]
fn a_held_indentation_relaxes_to_the_long_term_force() {
    let research = [("averaged", 0.499)].into_iter().filter(|_| cfg!(feature = "research"));
    for (ratio, nu) in [("projected", 0.49), ("pointwise", 0.49)].into_iter().chain(research) {
        let [nu_text, long_nu] = [nu, long_term_ratio(nu)].map(|nu| nu.to_string());
        let common = ("discretisation.volume_ratio", ratio);
        let elastic = |mu: &str, nu: &str| {
            let changes = [common, ("material.shear_modulus_pa", mu), ("material.poisson_ratio", nu)];
            press(&mut Twin::new(&scene("indentation", &changes)).unwrap())
        };
        let changes = [common, RELAXING[0], RELAXING[1], ("material.poisson_ratio", &nu_text)];
        let mut twin = Twin::new(&scene("indentation", &changes)).unwrap();
        let instant = press(&mut twin);
        let off = instant / elastic("1678", &nu_text) - 1.0;
        assert!(off.abs() < 1e-3, "{ratio}, {nu}: a jump is elastic, {off}");
        let mut curve = Vec::new();
        for k in 1..=1000 {
            let answer = at(&mut twin, 0.02 * f64::from(k), HELD);
            curve.push((answer.force_n[2], answer.steps));
        }
        for k in [5, 20, 50, 150, 999] {
            let (t, share) = (0.02 * (k as f64 + 1.0), curve[k].0 / instant);
            println!("{ratio}, {nu}: after {t:.2} s {share:.4}, series {:.4}", relaxation(t));
            assert!(nu < 0.499 || (share / relaxation(t) - 1.0).abs() < 0.01, "after {t} s {share}");
        }
        let steps: u32 = curve.iter().map(|c| c.1).sum();
        println!("{ratio}, {nu}: {steps} steps in 20 s of rest");
        let end = curve[999].0;
        let off = end / elastic("839", &long_nu) - 1.0;
        println!(
            "{ratio}, {nu}: in the end {:.4} of the instant, {:.2} % off the long-term elastic force",
            end / instant,
            100.0 * off
        );
        // the projected volume ratio's kappa_s stays that of the instant, which on this coarse cloud costs 0.8 %
        assert!(off.abs() < if ratio == "projected" { 0.015 } else { 0.01 }, "{ratio}, {nu}: {off}");
        assert!(curve[900..].iter().filter(|c| c.1 > 0).count() < 20, "{ratio}: the relaxed tissue rests");
    }
}

#[test]
fn a_relaxing_twin_repeats_itself_on_any_number_of_threads() {
    let ogden = [
        RELAXING[0],
        RELAXING[1],
        ("material.model", "ogden"),
        ("material.ogden_shear_moduli_pa", "1000, 678"),
        ("material.ogden_exponents", "2, -4"),
        ("material.volumetric", "logarithmic"),
    ];
    for (preset, changes) in [("indentation", &ogden[..]), ("needle_insertion", &ogden[..2])] {
        let run = |threads: usize| {
            rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
                let mut twin = Twin::new(&scene(preset, changes)).unwrap();
                let mut run = || {
                    twin.reset();
                    let depth = |k: i32| 1e-3 * f64::from(k.min(20)) / 20.0;
                    let answers: Vec<_> = (0..40).map(|k| at(&mut twin, 0.02 * f64::from(k), depth(k))).collect();
                    assert!(answers[20].force_n[2] > answers[39].force_n[2], "{preset}: the hold relaxes");
                    digits(&answers)
                };
                let first = run();
                assert!(first == run(), "{preset}: a reset twin is a new twin");
                first
            })
        };
        assert!(run(1) == run(2), "{preset}: threads change a bit");
    }
}
