//! Distortion at the projected volume ratio: the neo-Hookean law as a mixed formulation.
//!
//! The law W = mu/2 (J^-2/3 I1 - 3) + U(J) depends on J twice. With the projected dilatation of [`super::dilatation`] for U alone, each
//! integration point still resists a change of its own J, by 5/9 mu I1: next to nothing at rest, and many times the bulk modulus
//! where tissue is sheared tenfold, as beside a needle's entry. That is volumetric locking again. So both take the
//! projected ratio theta_P = J_P:
//!
//! ```text
//! I_P   = 3 + sum_a V_a N_aP (I1 - 3)_a / V_P                                   a, P, V: as J_P in `dilatation`
//! W     = sum_P V_P (mu/2 (theta_P^-2/3 I_P - 3) + (kappa - kappa_s) u(theta_P)) + sum_g V_g kappa_s w(J_g)
//! P_g   = mu r_g F + (q_g + kappa_s w'(J_g)) cof F                               r, q: means of the corners, as p_g there
//! r_P   = theta_P^-2/3        q_P = (kappa - kappa_s) u'(theta_P) - mu/3 theta_P^-5/3 I_P
//! ```
//!
//! As the cloud becomes finer theta_P tends to J and W to the law's. Below theta_m = [`LEAST_RATIO`] the energy goes on along its tangent in
//! theta, as the law's own does below J_m. Stored are r - 1 and q + mu, which vanish at rest.

use crate::material::neo_hookean::{Gradient, clamped, cofactor, cofactor_in, determinant, determinant_in};
use crate::number::{LANES, Number, Real, Vector};

use super::collapse::{collapse, collapse_curvature};
use super::points::{Constants, LaneLaw, Projected, WideLaw, largest_square, mixed_stress, of_each};

/// theta_m: projected volume ratio below which the energy goes on along its tangent. Needles in space, which have this law, keep J above 0.26
/// at every point down to 15 mm, and theta is a mean.
const LEAST_RATIO: f64 = 0.1;

/// The law of a point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Mixed<N> {
    mu: N,
    pointwise: N,
    projected: N,
}

/// What a coarse node hands on.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Coarse<N> {
    /// q + mu, Pa.
    pub pressure: N,
    /// r - 1.
    pub shrinkage: N,
    /// Energy density without that of volume, J/m^3.
    pub energy: N,
}

/// Of mu (Pa), the pressure of volume (kappa - kappa_s) u' (Pa), theta - 1 and I_P - 3.
#[inline(always)]
pub(super) fn coarse<N: Number>(mu: N, pressure: N, dilation: N, square: N) -> Coarse<N> {
    let (one, three) = (N::of(1.0), N::of(3.0));
    let theta = one + dilation;
    let larger = theta.max(N::of(LEAST_RATIO));
    let root = larger.inverse_cube_root();
    let r = root * root;
    let i1 = three + square;
    let phi = r * (one + N::of(2.0 / 3.0) * (larger - theta) / larger);
    Coarse {
        pressure: pressure + mu * (one - r / larger * i1 / three),
        shrinkage: phi - one,
        energy: N::of(0.5) * mu * (phi * i1 - three),
    }
}

impl<T: Real> Mixed<T> {
    pub(super) fn new(constants: &Constants) -> Self {
        Self {
            mu: T::of(constants.law.shear_modulus()),
            pointwise: T::of(constants.pointwise),
            projected: T::of(constants.projected),
        }
    }
}

impl Constants {
    /// The law where the distortion sees the projected volume ratio.
    pub(super) fn of_mixed<T: Real>(&self) -> Option<Mixed<T>> {
        self.mixed.then(|| Mixed::new(self))
    }
}

impl<N: Number> WideLaw<N> for Mixed<N> {
    #[inline(always)]
    fn at<const AXISYMMETRIC: bool>(&self, f: &Gradient<N>, projected: Projected<N>) -> (N, Gradient<N>) {
        let cof = cofactor_in::<N, AXISYMMETRIC>(f);
        let (energy, own) = collapse(determinant_in::<N, AXISYMMETRIC>(f, &cof), self.pointwise);
        (energy, mixed_stress::<N, AXISYMMETRIC>(f, &cof, self.mu, projected, own))
    }

    /// Bound of a.A.a over unit vectors as [`Constants::stiffness`]: mu r + c^2 (kappa - kappa_s + kappa_s w'' + 5/9 mu theta^-8/3 I_P),
    /// the last term from q: 5/3 (kappa - kappa_s - (kappa - kappa_s + q) / theta).
    #[inline(always)]
    fn stiffness(&self, f: &Gradient<N>, projected: Projected<N>) -> N {
        let cof = cofactor(f);
        let (j, _) = clamped(determinant(f, &cof));
        let r = (N::of(1.0) + projected.shrinkage).max(N::of(0.01));
        // theta^-1 = r^(3/2)
        let inverse = r * r.sqrt();
        let kappa = self.projected;
        let distortion = N::of(5.0 / 3.0) * (kappa - (kappa + projected.pressure - self.mu) * inverse);
        let bulk = kappa + self.pointwise * collapse_curvature(j) + distortion.max(N::of(5.0 / 3.0) * self.mu);
        self.mu * r + bulk * largest_square(&cof)
    }
}

impl<T: Real> LaneLaw<T> for Mixed<T> {
    type Wide<V: Vector<T>> = Mixed<V>;

    #[inline(always)]
    fn splat<V: Vector<T>>(&self) -> Mixed<V> {
        Mixed { mu: V::splat(self.mu), pointwise: V::splat(self.pointwise), projected: V::splat(self.projected) }
    }

    #[inline(always)]
    fn side_by_side<V: Vector<T>>(laws: &[Self; LANES]) -> Mixed<V> {
        let projected = of_each(laws, |law| law.projected);
        Mixed { mu: of_each(laws, |law| law.mu), pointwise: of_each(laws, |law| law.pointwise), projected }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A uniform field, whose coarse nodes see what each point sees: the bound holds for plane waves, by the second difference of the
    /// energy along a (x) N.
    #[test]
    fn no_plane_wave_is_stiffer_than_the_bound() {
        let law = crate::material::Law::neo_hookean(1678.0, 83_340.0);
        let constants = Constants::new(&law, crate::solver::VolumeRatio::Mixed);
        let point = Mixed::<f64>::new(&constants);
        let (mu, kappa) = (1678.0, constants.projected);
        let parts = |f: &Gradient<f64>| {
            let j = determinant(f, &cofactor(f));
            (j, coarse(mu, kappa * (j - 1.0), j - 1.0, f.iter().map(|x| x * x).sum::<f64>() - 3.0))
        };
        let energy = |f: &Gradient<f64>| {
            let (j, coarse) = parts(f);
            coarse.energy + 0.5 * kappa * (j - 1.0).powi(2) + collapse(j, constants.pointwise).0
        };
        for size in [0.0_f64, 0.1, 0.4, 2.0, 8.0] {
            // a shear, and a little of everything
            let f: Gradient<f64> = std::array::from_fn(|i: usize| {
                f64::from(u8::from(i.is_multiple_of(4)))
                    + if i == 2 { size } else { 0.05 * size.min(1.0) * (1.7 * i as f64).sin() }
            });
            let (_, at) = parts(&f);
            let bound = point.stiffness(&f, Projected { pressure: at.pressure, shrinkage: at.shrinkage });
            for k in 0..60 {
                let angle = |n: usize| (1.3 + n as f64) * f64::from(k) + n as f64;
                let unit = |n: usize| {
                    let (p, q) = (angle(n), angle(n + 1));
                    [p.cos() * q.cos(), p.sin() * q.cos(), q.sin()]
                };
                let (a, n) = (unit(0), unit(2));
                let moved = |h: f64| energy(&std::array::from_fn(|i| f[i] + h * a[i / 3] * n[i % 3]));
                let h = 1e-3;
                let found = (moved(h) - 2.0 * moved(0.0) + moved(-h)) / (h * h);
                // the largest singular value of cof F is a weighted mean of all: low by some per cent where they are alike
                assert!(found < 1.1 * bound, "{size} {k}: {found} Pa, bound {bound} Pa");
            }
        }
    }

    #[test]
    fn what_a_coarse_node_hands_on_is_the_derivative_of_its_energy() {
        let (mu, h) = (1678.0, 1e-6);
        for theta in [-0.2, 0.05, 0.09, 0.11, 0.5, 1.0, 1.3] {
            for square in [0.0, 0.4, 60.0] {
                let energy = |theta: f64, square: f64| coarse(mu, 0.0, theta - 1.0, square).energy;
                let found = coarse(mu, 0.0, theta - 1.0, square);
                let by_theta = (energy(theta + h, square) - energy(theta - h, square)) / (2.0 * h);
                assert!(
                    (by_theta - (found.pressure - mu)).abs() < 1e-5 * by_theta.abs(),
                    "{theta} {square}: {by_theta}"
                );
                // P = dW/dF has mu r F, and I1 the derivative 2 F
                let by_square = (energy(theta, square + h) - energy(theta, square - h)) / (2.0 * h);
                assert!((2.0 * by_square / mu - (1.0 + found.shrinkage)).abs() < 1e-6 * by_square, "{theta} {square}");
            }
        }
        let rest = coarse(mu, 0.0, 0.0, 0.0);
        assert!(rest.pressure.abs() < 1e-9 && rest.shrinkage.abs() < 1e-12 && rest.energy.abs() < 1e-9, "{rest:?}");
    }
}
