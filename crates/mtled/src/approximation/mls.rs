//! Moving least squares and its modified form (MMLS): shape functions and their exact derivatives at a point.
//!
//! u_h(x) = p^T(x) a(x), where a minimises J = sum_j w_j (p^T(x_j) a - u_j)^2 + eta sum_j w_j sum_k s_k (r_j^2 a_k)^2,
//! the last sum over the six quadratic coefficients (Joldes et al. 2015; weighted and scaled so that eta has no
//! dimension and a factor on the weights or a node at the rim of its support changes nothing; s_k = 1/2 on the mixed
//! terms, so that a rotation of the axes changes nothing either). With M = sum_j w_j p_j p_j^T + H,
//! H = eta sum_j w_j (r_j / L)^4 diag(0, 0, 0, 0, s_k):
//!
//! ```text
//! phi_j   = w_j p_j . y                        M y   = p(x)
//! phi_j,k = w_j,k p_j . y + w_j p_j . z_k      M z_k = p_,k(x) - M_,k y
//! ```
//!
//! Coordinates are xi = (X - x)/L with L the mean support radius, so p(x) = e_1 and M is well conditioned.

use super::weight::Weight;

/// Number of monomials of the quadratic basis 1, x, y, z, x2, y2, z2, xy, yz, xz.
const QUADRATIC: usize = 10;
/// The same in a meridian half plane: 1, x, z, x2, z2, xz (y is the direction of the hoop, along which nothing varies).
const PLANE_QUADRATIC: usize = 6;

/// Polynomial basis of the fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Basis {
    /// 1, x, y, z.
    Linear,
    /// Complete quadratic with the penalty eta on the six quadratic coefficients, half of it on the mixed ones: so it
    /// is a multiple of the squared norm of the second derivatives, which no rotation of the axes changes.
    Quadratic {
        /// eta, dimensionless.
        penalty: f64,
    },
}

/// A node within reach of the point: position and weight (with reduced slope), support radius.
#[derive(Clone, Copy, Debug)]
pub struct Neighbour {
    /// Node.
    pub node: u32,
    /// x_j - x, m.
    pub offset: [f64; 3],
    /// Support radius r_j, m.
    pub radius: f64,
    /// Weight at the point.
    pub weight: Weight,
}

/// The moment matrix could not be factorised: too few nodes, or all in one plane.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Singular;

/// Scratch of the fit, reused from point to point.
#[derive(Clone, Debug, Default)]
pub struct Fit {
    p: Vec<[f64; QUADRATIC]>,
    /// phi_j at the point.
    pub value: Vec<f64>,
    /// phi_j,k at the point, 1/m.
    pub gradient: Vec<[f64; 3]>,
}

/// Share of the penalty on a monomial's coefficient: half on the mixed ones, which come last.
const fn share<const D: usize>(monomial: usize) -> f64 {
    if monomial < 1 + 2 * D { 1.0 } else { 0.5 }
}

/// The d-th of the D axes that the basis knows.
const fn axis<const D: usize>(d: usize) -> usize {
    if D == 3 { d } else { 2 * d }
}

impl Fit {
    /// Fills `value` (and `gradient` if asked) for the given neighbours.
    ///
    /// # Errors
    /// [`Singular`] if the moment matrix is not positive definite.
    pub fn evaluate(&mut self, neighbours: &[Neighbour], basis: Basis, with_gradient: bool) -> Result<(), Singular> {
        match basis {
            Basis::Linear => self.fit::<3, 4>(neighbours, 0.0, with_gradient),
            Basis::Quadratic { penalty } => self.fit::<3, QUADRATIC>(neighbours, penalty, with_gradient),
        }
    }

    /// The same for nodes of a meridian half plane (x = r, y = 0, z): the basis knows x and z alone, and the gradient
    /// has no y.
    ///
    /// # Errors
    /// [`Singular`] if the moment matrix is not positive definite.
    pub(crate) fn evaluate_in_plane(
        &mut self,
        neighbours: &[Neighbour],
        basis: Basis,
        with_gradient: bool,
    ) -> Result<(), Singular> {
        match basis {
            Basis::Linear => self.fit::<2, 3>(neighbours, 0.0, with_gradient),
            Basis::Quadratic { penalty } => self.fit::<2, PLANE_QUADRATIC>(neighbours, penalty, with_gradient),
        }
    }

    /// D: dimensions; N: monomials.
    fn fit<const D: usize, const N: usize>(
        &mut self,
        neighbours: &[Neighbour],
        eta: f64,
        with_gradient: bool,
    ) -> Result<(), Singular> {
        if neighbours.len() <= D {
            return Err(Singular);
        }
        let inv_l = neighbours.len() as f64 / neighbours.iter().map(|n| n.radius).sum::<f64>();
        self.p.clear();
        self.p.extend(neighbours.iter().map(|n| monomials::<D>(n.offset, inv_l)));
        let mut m = [[0.0; N]; N];
        let mut penalty = 0.0;
        for (n, p) in neighbours.iter().zip(&self.p) {
            penalty += n.weight.0 * (n.radius * inv_l).powi(4);
            for r in 0..N {
                let wp = n.weight.0 * p[r];
                for c in 0..=r {
                    m[r][c] += wp * p[c];
                }
            }
        }
        for k in D + 1..N {
            m[k][k] += eta * share::<D>(k) * penalty;
        }
        cholesky(&mut m)?;
        let mut y = [0.0; N];
        y[0] = 1.0;
        solve(&m, &mut y);
        self.value.clear();
        self.value.extend(neighbours.iter().zip(&self.p).map(|(n, p)| n.weight.0 * dot(p, &y)));
        if with_gradient {
            self.derivatives::<D, N>(neighbours, &m, &y, inv_l, eta);
        }
        Ok(())
    }

    fn derivatives<const D: usize, const N: usize>(
        &mut self,
        neighbours: &[Neighbour],
        m: &[[f64; N]; N],
        y: &[f64; N],
        inv_l: f64,
        eta: f64,
    ) {
        let mut z = [[0.0; N]; D];
        for (n, p) in neighbours.iter().zip(&self.p) {
            let py = dot(p, y);
            for (d, zk) in z.iter_mut().enumerate() {
                let w_k = weight_gradient(n, axis::<D>(d));
                for (zi, pi) in zk.iter_mut().zip(p) {
                    *zi -= w_k * py * pi;
                }
            }
        }
        for (d, zk) in z.iter_mut().enumerate() {
            let k = axis::<D>(d);
            // H varies with the point through the sum of the weights
            let penalty: f64 = neighbours.iter().map(|n| weight_gradient(n, k) * (n.radius * inv_l).powi(4)).sum();
            (D + 1..N).for_each(|r| zk[r] -= eta * share::<D>(r) * penalty * y[r]);
            zk[d + 1] += inv_l;
            solve(m, zk);
        }
        self.gradient.clear();
        self.gradient.extend(neighbours.iter().zip(&self.p).map(|(n, p)| {
            let py = dot(p, y);
            let mut gradient = [0.0; 3];
            for (d, zk) in z.iter().enumerate() {
                gradient[axis::<D>(d)] = weight_gradient(n, axis::<D>(d)) * py + n.weight.0 * dot(p, zk);
            }
            gradient
        }));
    }
}

/// w_j,k = ((dw/ds)/s) (x_k - x_jk) / r_j^2.
fn weight_gradient(n: &Neighbour, k: usize) -> f64 {
    -n.weight.1 * n.offset[k] / (n.radius * n.radius)
}

fn monomials<const D: usize>(offset: [f64; 3], inv_l: f64) -> [f64; QUADRATIC] {
    let [x, y, z] = offset.map(|c| c * inv_l);
    if D == 3 {
        [1.0, x, y, z, x * x, y * y, z * z, x * y, y * z, x * z]
    } else {
        [1.0, x, z, x * x, z * z, x * z, 0.0, 0.0, 0.0, 0.0]
    }
}

fn dot<const N: usize>(p: &[f64; QUADRATIC], y: &[f64; N]) -> f64 {
    p.iter().zip(y).map(|(a, b)| a * b).sum()
}

/// Relative size of a pivot below which the moment matrix counts as singular.
const PIVOT: f64 = 1e-13;

/// In-place Cholesky factor (lower triangle).
pub(super) fn cholesky<const N: usize>(m: &mut [[f64; N]; N]) -> Result<(), Singular> {
    for c in 0..N {
        let diagonal = m[c][c];
        for k in 0..c {
            m[c][c] -= m[c][k] * m[c][k];
        }
        // a pivot that is not a number is no better than one that is too small
        if m[c][c].is_nan() || m[c][c] <= PIVOT * diagonal {
            return Err(Singular);
        }
        let root = m[c][c].sqrt();
        m[c][c] = root;
        for r in c + 1..N {
            for k in 0..c {
                m[r][c] -= m[r][k] * m[c][k];
            }
            m[r][c] /= root;
        }
    }
    Ok(())
}

/// Solves with the factor of [`cholesky`], in place.
pub(super) fn solve<const N: usize>(l: &[[f64; N]; N], b: &mut [f64; N]) {
    for r in 0..N {
        for k in 0..r {
            b[r] -= l[r][k] * b[k];
        }
        b[r] /= l[r][r];
    }
    for r in (0..N).rev() {
        for k in r + 1..N {
            b[r] -= l[k][r] * b[k];
        }
        b[r] /= l[r][r];
    }
}
