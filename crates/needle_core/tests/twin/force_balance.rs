//! Balance of forces: what the instrument feels, the base gives back; and what the force must not depend on.
#![allow(clippy::unwrap_used)]

use crate::clouds;
use crate::clouds::{METHODS, internal_force, minus, norm, settings, uniform};
use mtled::approximation::table::Approximation;
use needle_core::scene::{Override, Scene};
use needle_core::twin::Twin;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use testkit::coarse::{press, scene, travel};

/// Depth of the indentations, m.
const DEPTH: f64 = 1e-3;

/// Vertical force at rest, N.
fn force(changes: &[(&str, &str)]) -> f64 {
    press(&mut Twin::new(&scene("indentation", changes)).unwrap(), DEPTH).force_n[2]
}

#[test]
fn the_base_gives_back_the_force_of_the_instrument() {
    for preset in ["indentation", "compression"] {
        let mut twin = Twin::new(&scene(preset, &[])).unwrap();
        let answer = press(&mut twin, DEPTH);
        let total = std::array::from_fn(|k| answer.force_n[k] + answer.base_force_n[k]);
        let gap = norm(total) / norm(answer.force_n);
        println!("{preset}: {:.5} N, gap {:.3} %", answer.force_n[2], 100.0 * gap);
        assert_eq!(answer.steps, 0, "{preset} comes to rest");
        assert!(answer.force_n[2] > 0.05, "{preset}: the tissue pushes the instrument out");
        assert!(gap < 0.005, "{preset}: {gap}");
        // an axisymmetric problem on an irregular cloud: lateral forces are errors of discretisation
        let side = answer.force_n[0].hypot(answer.force_n[1]) / answer.force_n[2];
        assert!(side < 0.02, "{preset}: lateral force {side}");
    }
}

/// One step per millisecond at 20 mm/s: the tissue lags behind, so that the forces on instrument and base are up to a third off
/// on either side of the force at rest. Without its inertia the force on the instrument is close to that.
#[test]
fn inertia_is_taken_out_of_the_force_on_a_moving_instrument() {
    let depths = [4e-3, 5e-3, 6e-3, 7e-3, 8e-3, 9e-3, 10e-3];
    let forces = |poses: u32, changes: &[(&str, &str)]| -> Vec<[f64; 2]> {
        let changes: Vec<_> = changes.iter().map(|(key, value)| Override::text(key, value, "test")).collect();
        let mut twin = Twin::new(&Scene::preset("needle_insertion").unwrap().with(&changes).unwrap()).unwrap();
        let answers = travel(&mut twin, 0.0, 10e-3, poses);
        let at = |d: &f64| &answers[(d / 10e-3 * f64::from(poses)).round() as usize - 1];
        depths.iter().map(at).map(|a| [a.force_n[2], -a.base_force_n[2]]).collect()
    };
    let slow = forces(20_000, &[("stepping.tolerance", "0.002")]);
    let fast = forces(500, &[("stepping.max_steps_per_pose", "1")]);
    for ((depth, [slow, base]), fast) in depths.iter().zip(&slow).zip(&fast) {
        assert!((slow / base - 1.0).abs() < 2e-3, "at rest, or nearly: {slow} {base}");
        let [own, base] = fast.map(|f| 100.0 * (f / slow - 1.0));
        println!("{:.0} mm: {slow:.5} N, instrument {own:+.2} %, base {base:+.2} %", 1e3 * depth);
        assert!(own.abs() < 0.4 * base.abs(), "{depth}: {own} % and {base} %");
    }
}

/// The free nodes move on until their forces vanish; all the nodes' forces together vanish in any state.
#[test]
fn internal_forces_sum_to_zero_in_any_state() {
    let (cloud, interpolating) = clouds::cylinder_with_path();
    let mut random = ChaCha8Rng::seed_from_u64(4);
    let u: Vec<[f64; 3]> =
        cloud.points.iter().map(|_| std::array::from_fn(|_| 1e-4 * (uniform(&mut random) - 0.5))).collect();
    for (name, basis) in METHODS {
        let settings = settings(basis, 1);
        let table = Approximation::new(&cloud.points, &cloud.cells, interpolating.clone(), settings).table().unwrap();
        let force = internal_force(&cloud.points, &cloud.cells, &table, &u);
        let sum = force.iter().fold([0.0; 3], |s, f| std::array::from_fn(|k| s[k] + f[k]));
        let total: f64 = force.iter().map(|f| norm(*f)).sum();
        println!("{name}: sum {:.1e} of {total:.3} N", norm(sum));
        assert!(total > 1e-3, "{name}: there are forces to sum");
        assert!(norm(sum) < 1e-12 * total, "{name}: {:.1e} of {total} N", norm(sum));
    }
}

#[test]
fn a_mirrored_body_has_mirrored_forces() {
    let (cloud, interpolating) = clouds::cylinder_with_path();
    let mirror = |x: &[f64; 3]| [-x[0], x[1], x[2]];
    let points: Vec<_> = cloud.points.iter().map(mirror).collect();
    let cells: Vec<_> = cloud.cells.iter().map(|c| [c[0], c[2], c[1], c[3]]).collect();
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let u: Vec<[f64; 3]> =
        points.iter().map(|_| std::array::from_fn(|_| 1e-4 * (uniform(&mut random) - 0.5))).collect();
    let mirrored: Vec<_> = u.iter().map(mirror).collect();
    for (name, basis) in METHODS {
        let settings = settings(basis, 1);
        let table = |points: &[[f64; 3]], cells: &[[u32; 4]]| {
            Approximation::new(points, cells, interpolating.clone(), settings).table().unwrap()
        };
        let a = internal_force(&cloud.points, &cloud.cells, &table(&cloud.points, &cloud.cells), &u);
        let b = internal_force(&points, &cells, &table(&points, &cells), &mirrored);
        let largest = a.iter().map(|f| norm(*f)).fold(0.0, f64::max);
        let off = a.iter().zip(&b).map(|(a, b)| norm(minus(mirror(a), *b))).fold(0.0, f64::max);
        assert!(off < 1e-10 * largest, "{name}: {:.1e}", off / largest);
    }
}

#[test]
fn three_times_the_modulus_is_three_times_the_force() {
    let ratio = force(&[("material.shear_modulus_pa", "5034.0")]) / force(&[]);
    println!("force ratio {ratio:.6}");
    assert!((ratio / 3.0 - 1.0).abs() < 0.003, "{ratio}");
    let ogden = |moduli| {
        force(&[
            ("material.model", "ogden"),
            ("material.ogden_shear_moduli_pa", moduli),
            ("material.ogden_exponents", "2, -4"),
            ("material.volumetric", "logarithmic"),
        ])
    };
    let ratio = ogden("3000, 2034") / ogden("1000, 678");
    println!("force ratio {ratio:.6} with Ogden's law");
    assert!((ratio / 3.0 - 1.0).abs() < 0.003, "{ratio}");
}

/// The law with exponent 2 in the twin, through the kernel's other loop.
#[test]
fn ogden_with_exponent_2_has_the_neo_hookean_force() {
    let ogden = [
        ("material.model", "ogden"),
        ("material.ogden_shear_moduli_pa", "1678"),
        ("material.ogden_exponents", "2"),
        ("discretisation.precision", "f64"),
    ];
    let off = force(&ogden) / force(&ogden[3..]) - 1.0;
    println!("Ogden against neo-Hooke: {off:.1e}");
    assert!(off.abs() < 1e-6, "{off}");
}

#[test]
fn single_precision_has_the_force_of_double() {
    let off = force(&[("discretisation.precision", "f32")]) / force(&[("discretisation.precision", "f64")]) - 1.0;
    println!("f32 against f64: {:.4} %", 100.0 * off);
    assert!(off.abs() < 0.001, "{off}");
}

/// Poses ten times as dense and a tolerance ten times as tight ask for many more steps, not for another force.
#[test]
fn the_force_at_rest_does_not_depend_on_the_pace() {
    let off = force(&[("stepping.tolerance", "0.001")]) / force(&[]) - 1.0;
    println!("tight against default tolerance: {:.4} %", 100.0 * off);
    assert!(off.abs() < 0.002, "{off}");
}
