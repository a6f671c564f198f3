//! Energy of a change of volume, U(J) = kappa u(J), and its pressure p = dU/dJ (positive in tension):
//!
//! ```text
//! quadratic     u = (J - 1)^2 / 2                  u' = J - 1              ABAQUS, D1 = 2/kappa
//! logarithmic   u = ((J^2 - 1)/2 - ln J) / 2       u' = (J - 1/J) / 2      Simo & Taylor 1982
//! ```
//!
//! Both have u(1) = u'(1) = 0 and u''(1) = 1, so kappa is the small-strain bulk modulus of either. The quadratic energy
//! of a point that is crushed to nothing is finite, kappa/2; the logarithmic one grows without bound as J -> 0.
//! Functions take the dilation J - 1, which keeps its digits where J is near 1, and give u, u' without kappa.

use super::neo_hookean::MIN_JACOBIAN;
use crate::number::Number;

/// Which energy (`material.volumetric`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Volumetric {
    /// `quadratic`: kappa/2 (J - 1)^2.
    #[default]
    Quadratic,
    /// `logarithmic`: kappa/2 ((J^2 - 1)/2 - ln J). Below `MIN_JACOBIAN` it goes on as a parabola with the same
    /// value, slope and curvature (some 1250 kappa), so that an inverted point is pushed back by a finite force.
    Logarithmic,
}

/// Dilation at [`MIN_JACOBIAN`].
const LEAST: f64 = MIN_JACOBIAN - 1.0;

impl Volumetric {
    /// u.
    #[must_use]
    pub fn energy(self, dilation: f64) -> f64 {
        match self {
            Self::Quadratic => 0.5 * dilation * dilation,
            Self::Logarithmic => {
                let d = dilation.max(LEAST);
                let below = dilation - d;
                0.5 * (d + 0.5 * d * d - d.ln_1p()) + below * (log_slope(d) + 0.5 * log_curvature(d) * below)
            }
        }
    }

    /// u' = p/kappa.
    #[must_use]
    pub fn slope(self, dilation: f64) -> f64 {
        match self {
            Self::Quadratic => dilation,
            Self::Logarithmic => {
                let d = dilation.max(LEAST);
                log_slope(d) + log_curvature(d) * (dilation - d)
            }
        }
    }

    /// u'', relative to kappa.
    #[inline(always)]
    pub(crate) fn curvature<N: Number>(self, dilation: N) -> N {
        match self {
            Self::Quadratic => N::of(1.0),
            Self::Logarithmic => log_curvature(dilation.max(N::of(LEAST))),
        }
    }

    /// The dilation at which u' has this value.
    #[must_use]
    #[inline(always)]
    pub fn dilation<N: Number>(self, slope: N) -> N {
        match self {
            Self::Quadratic => slope,
            Self::Logarithmic => {
                let (one, least) = (N::of(1.0), N::of(LEAST));
                let s = slope.max(log_slope(least));
                // J = s + (s^2 + 1)^1/2, less 1, with no difference of like numbers
                s + s * s / ((s * s + one).sqrt() + one) + (slope - s) / log_curvature(least)
            }
        }
    }
}

/// (J - 1/J)/2 with J = 1 + d.
#[inline(always)]
fn log_slope<N: Number>(d: N) -> N {
    N::of(0.5) * d * (N::of(2.0) + d) / (N::of(1.0) + d)
}

/// (1 + 1/J^2)/2.
#[inline(always)]
fn log_curvature<N: Number>(d: N) -> N {
    let half = N::of(0.5);
    half + half / ((N::of(1.0) + d) * (N::of(1.0) + d))
}
