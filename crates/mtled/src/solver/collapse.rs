//! The pointwise part of the energy of volume, which keeps single points from collapsing (see [`super::dilatation`]).

use crate::material::neo_hookean::clamped;
use crate::number::Number;

/// J_0: volume ratio below which the pointwise part of the projected energy stiffens.
const CRUSHED: f64 = 0.4;

/// Energy and pressure of the pointwise part that resists collapse:
/// kappa_s/2 (J - 1)^2 (1 + q), kappa_s ((J - 1)(1 + q) - 2 (J - 1)^2 q / J), with q = (J_0/J)^4. Below J_m the pressure
/// goes on as that polynomial in J - 1, with J_m for J in q and in q / J, and the energy as its integral.
#[inline(always)]
pub(super) fn collapse<T: Number>(j: T, kappa: T) -> (T, T) {
    let (one, two) = (T::of(1.0), T::of(2.0));
    let (larger, lack) = clamped(j);
    let inverse = one / larger;
    let ratio = T::of(CRUSHED) * inverse;
    let square = ratio * ratio;
    let q = square * square;
    let dilation = j - one;
    let slope = kappa * dilation;
    // the integral of -2 (J - 1)^2 q / J from J_m to J: (x^3 - y^3) = (x - y)(x^2 + x y + y^2), zero above J_m
    let least = larger - one;
    let beyond = T::of(2.0 / 3.0) * q * inverse * lack * (dilation * dilation + dilation * least + least * least);
    (slope * dilation * (one + q) / two + kappa * beyond, slope * (one + q - two * dilation * q * inverse))
}

/// Second derivative of that energy, over kappa_s: 1 + q (1 - 8 (J - 1)/J + 10 (J - 1)^2 / J^2). Below J_m, with J_m for J,
/// more than it is.
#[inline(always)]
pub(super) fn collapse_curvature<T: Number>(j: T) -> T {
    let one = T::of(1.0);
    let inverse = one / j;
    let (dilation, ratio) = ((j - one) * inverse, T::of(CRUSHED) * inverse);
    let square = ratio * ratio;
    one + square * square * (one - T::of(8.0) * dilation + T::of(10.0) * dilation * dilation)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::material::neo_hookean::MIN_JACOBIAN;

    #[test]
    fn pressure_and_curvature_are_derivatives_of_the_energy() {
        let h = 1e-6;
        for j in [-0.5, 0.001_f64, 0.01, 0.019, 0.021, 0.03, 0.1, 0.25, 0.6, 1.0, 1.4, 5.0] {
            let h = h * f64::min(1.0, 20.0 * j.abs());
            let (kappa, energy, pressure) = (3.0, |j: f64| collapse(j, 3.0).0, |j: f64| collapse(j, 3.0).1);
            let slope = (energy(j + h) - energy(j - h)) / (2.0 * h);
            assert!((slope - pressure(j)).abs() < 1e-5 * (1.0 + slope.abs()), "{j}: {slope} {}", pressure(j));
            if j < MIN_JACOBIAN {
                assert!(
                    collapse_curvature(MIN_JACOBIAN) > (pressure(j + h) - pressure(j - h)) / (2.0 * h * kappa),
                    "{j}"
                );
                continue;
            }
            let curvature = (pressure(j + h) - pressure(j - h)) / (2.0 * h);
            let stated = kappa * collapse_curvature(j);
            assert!((curvature / stated - 1.0).abs() < 1e-5, "{j}: {curvature} {stated}");
        }
    }
}
