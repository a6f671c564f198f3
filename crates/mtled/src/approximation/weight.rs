//! Weight functions of moving least squares, s = |x - x_j| / r_j (method: Most & Bucher 2005; Belytschko et al. 1996).

/// Weight and its reduced slope: `(w, (dw/ds)/s)`. The reduced slope stays finite at s = 0, so that
/// w_,k = ((dw/ds)/s) (x_k - x_jk) / r_j^2 needs no division by a distance.
pub(super) type Weight = (f64, f64);

/// Quartic spline: w = 1 - 6 s^2 + 8 s^3 - 3 s^4 for s <= 1.
pub(super) fn quartic(s: f64) -> Weight {
    if s >= 1.0 {
        return (0.0, 0.0);
    }
    let s2 = s * s;
    (1.0 - 6.0 * s2 + 8.0 * s2 * s - 3.0 * s2 * s2, -12.0 + 24.0 * s - 12.0 * s2)
}

/// Regularisation of the interpolating weight: phi_i(x_j) differs from delta_ij by about this much.
pub(super) const INTERPOLATING_EPSILON: f64 = 1e-6;

/// Quartic spline over (s^2 + e): almost singular at its own node, so that the field there equals the nodal value
/// and essential boundary conditions can be set directly (the idea of Most & Bucher's weight with the quartic's
/// smooth end).
pub(super) fn interpolating(s: f64) -> Weight {
    if s >= 1.0 {
        return (0.0, 0.0);
    }
    let (q, q_slope) = quartic(s);
    let d = s * s + INTERPOLATING_EPSILON;
    (q / d, q_slope / d - 2.0 * q / (d * d))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reduced_slope_is_the_derivative() {
        for f in [quartic as fn(f64) -> Weight, interpolating] {
            for s in [0.05, 0.3, 0.7, 0.95] {
                let h = 1e-6;
                let slope = (f(s + h).0 - f(s - h).0) / (2.0 * h) / s;
                assert!((slope - f(s).1).abs() < 1e-5 * slope.abs().max(1.0), "s = {s}");
            }
        }
    }
}
