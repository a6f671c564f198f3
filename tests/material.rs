//! Contract of the neo-Hookean law: stress from energy, objectivity, small-strain moduli, states with known answers.
#![allow(clippy::unwrap_used)]

use approx::assert_abs_diff_eq;
use nalgebra::{Matrix3, Rotation3, Vector3};
use needle_twin::material::neo_hookean::{cofactor, determinant, distortional_energy, first_piola};
use proptest::prelude::*;

const MU: f64 = 1678.0;
/// kappa = 2 mu (1 + nu) / (3 (1 - 2 nu)) at nu = 0.49.
const KAPPA: f64 = 2.0 * MU * 1.49 / 0.06;

fn row_major(f: &Matrix3<f64>) -> [f64; 9] {
    std::array::from_fn(|i| f[(i / 3, i % 3)])
}

fn stress(f: &Matrix3<f64>) -> Matrix3<f64> {
    let f = row_major(f);
    let cof = cofactor(&f);
    let j = determinant(&f, &cof);
    Matrix3::from_row_slice(&first_piola(&f, &cof, j, MU, KAPPA * (j - 1.0)))
}

fn energy(f: &Matrix3<f64>) -> f64 {
    let f = row_major(f);
    let j = determinant(&f, &cofactor(&f));
    distortional_energy(&f, j, MU) + 0.5 * KAPPA * (j - 1.0) * (j - 1.0)
}

/// Any deformation that keeps at least 30 % of the volume.
fn deformation() -> impl Strategy<Value = Matrix3<f64>> {
    prop::array::uniform9(-0.5..0.5).prop_map(|a| Matrix3::identity() + Matrix3::from_row_slice(&a)).prop_filter(
        "volume ratio of a tissue",
        |f| {
            let j = f.determinant();
            j > 0.3 && j < 3.0
        },
    )
}

proptest! {
    #[test]
    fn stress_is_the_derivative_of_the_energy(f in deformation()) {
        let p = stress(&f);
        for i in 0..9 {
            let h = 1e-5;
            let moved = |h: f64| { let mut g = f; g[(i / 3, i % 3)] += h; energy(&g) };
            let slope = (moved(h) - moved(-h)) / (2.0 * h);
            // truncation h^2 W'''/6 is 1e-10 times some tens of kappa
            prop_assert!((slope - p[(i / 3, i % 3)]).abs() < 1e-7 * KAPPA, "component {i}: {slope} {}", p[(i / 3, i % 3)]);
        }
    }

    #[test]
    fn a_rotation_of_space_rotates_the_stress(f in deformation(), axis in prop::array::uniform3(-3.0..3.0)) {
        let q = Rotation3::new(Vector3::from(axis)).into_inner();
        let off = Matrix3::amax(&(stress(&(q * f)) - q * stress(&f)));
        prop_assert!(off < 1e-11 * KAPPA, "P(QF) - Q P(F) = {off:.1e} Pa");
        prop_assert!((energy(&(q * f)) - energy(&f)).abs() < 1e-11 * KAPPA);
    }

    #[test]
    fn the_law_is_isotropic(f in deformation(), axis in prop::array::uniform3(-3.0..3.0)) {
        let q = Rotation3::new(Vector3::from(axis)).into_inner();
        prop_assert!((stress(&(f * q)) - stress(&f) * q).amax() < 1e-11 * KAPPA);
    }

    #[test]
    fn the_cauchy_stress_is_symmetric(f in deformation()) {
        let tau = stress(&f) * f.transpose();
        prop_assert!((tau - tau.transpose()).amax() < 1e-11 * KAPPA);
    }

    #[test]
    fn single_precision_follows_double(f in deformation()) {
        let double = row_major(&stress(&f));
        let f = row_major(&f).map(|x| x as f32);
        let cof = cofactor(&f);
        let j = determinant(&f, &cof);
        let single = first_piola(&f, &cof, j, MU as f32, KAPPA as f32 * (j - 1.0));
        for i in 0..9 {
            // f32 rounds J - 1 at 6e-8 times the size of J's terms, and kappa multiplies it
            prop_assert!((f64::from(single[i]) - double[i]).abs() < 3e-6 * KAPPA, "{} {}", single[i], double[i]);
        }
    }
}

#[test]
fn the_undeformed_state_is_free_of_stress_and_energy() {
    assert!(stress(&Matrix3::identity()).amax() < 1e-12 * MU);
    assert_abs_diff_eq!(energy(&Matrix3::identity()), 0.0, epsilon = 1e-12 * MU);
}

#[test]
fn the_tangent_at_rest_has_the_small_strain_moduli() {
    let h = 1e-6;
    let lambda = KAPPA - 2.0 / 3.0 * MU;
    for (k, l) in (0..9).map(|c| (c / 3, c % 3)) {
        let moved = |h: f64| {
            let mut f = Matrix3::identity();
            f[(k, l)] += h;
            stress(&f)
        };
        let tangent = (moved(h) - moved(-h)) / (2.0 * h);
        for (i, j) in (0..9).map(|c| (c / 3, c % 3)) {
            let is = |a: usize, b: usize| f64::from(a == b);
            let exact = lambda * is(i, j) * is(k, l) + MU * (is(i, k) * is(j, l) + is(i, l) * is(j, k));
            assert_abs_diff_eq!(tangent[(i, j)], exact, epsilon = 1e-7 * KAPPA);
        }
    }
}

/// Engineering compression, lateral stretch, volume ratio, nominal stress in Pa: rows of the project's table of
/// homogeneous states, computed from the closed formulas mu J^-2/3 (l_t^2 - I1/3) + kappa J (J - 1) = 0 and
/// P11 = mu J^-2/3 (l - I1/(3 l)) + kappa J (J - 1)/l, independently of this code.
const UNIAXIAL: [(f64, f64, f64, f64); 6] = [
    (0.00, 1.0, 1.0, 0.0),
    (0.01, 1.0049372765, 0.9997999405, -50.514418),
    (0.05, 1.0254641117, 0.9989978122, -263.492506),
    (0.10, 1.0530312762, 0.9979873819, -557.984513),
    (0.15, 1.0830033609, 0.9969618377, -890.940707),
    (0.20, 1.1157466801, 0.9959125234, -1272.227313),
];

#[test]
fn uniaxial_compression_has_the_known_stress() {
    for (compression, lateral, ratio, nominal) in UNIAXIAL {
        let state = |l: f64| Matrix3::from_diagonal(&Vector3::new(1.0 - compression, l, l));
        // the side is free: bisect for the stretch without lateral stress
        let (mut low, mut high) = (0.9, 1.3);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if stress(&state(middle))[(1, 1)] > 0.0 { high = middle } else { low = middle }
        }
        let f = state(0.5 * (low + high));
        // half a unit of the table's last digit, and a little for the bisection
        assert_abs_diff_eq!(f[(1, 1)], lateral, epsilon = 6e-11);
        assert_abs_diff_eq!(f.determinant(), ratio, epsilon = 6e-11);
        assert_abs_diff_eq!(stress(&f)[(0, 0)], nominal, epsilon = 6e-7);
    }
}

/// Shear, Cauchy sigma_12, sigma_11, sigma_22 in Pa, from the same table.
const SHEAR: [(f64, f64, f64, f64); 4] = [
    (0.0, 0.0, 0.0, 0.0),
    (0.1, 167.8, 11.186667, -5.593333),
    (0.5, 839.0, 279.666667, -139.833333),
    (1.0, 1678.0, 1118.666667, -559.333333),
];

#[test]
fn simple_shear_has_the_known_stress() {
    for (g, s12, s11, s22) in SHEAR {
        let mut f = Matrix3::identity();
        f[(0, 1)] = g;
        let p = stress(&f);
        let cauchy = p * f.transpose();
        for (got, want) in [(cauchy[(0, 1)], s12), (cauchy[(0, 0)], s11), (cauchy[(1, 1)], s22), (p[(0, 1)], MU * g)] {
            assert_abs_diff_eq!(got, want, epsilon = 6e-7);
        }
        let second = f.try_inverse().unwrap() * p;
        assert_abs_diff_eq!(second[(0, 1)], MU * g * (1.0 + g * g / 3.0), epsilon = 1e-9 * MU);
    }
}
