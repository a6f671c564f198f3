//! Contract of the presets' law in homogeneous states whose stress is known.
#![allow(clippy::unwrap_used)]

use approx::assert_abs_diff_eq;
use mtled::material::neo_hookean::{cofactor, determinant, first_piola};
use nalgebra::{Matrix3, Vector3};

const MU: f64 = 1678.0;
/// kappa = 2 mu (1 + nu) / (3 (1 - 2 nu)) at nu = 0.49.
const KAPPA: f64 = 2.0 * MU * 1.49 / 0.06;

fn stress(f: &Matrix3<f64>) -> Matrix3<f64> {
    let f: [f64; 9] = std::array::from_fn(|i| f[(i / 3, i % 3)]);
    let cof = cofactor(&f);
    let j = determinant(&f, &cof);
    Matrix3::from_row_slice(&first_piola(&f, &cof, j, MU, KAPPA * (j - 1.0)))
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
