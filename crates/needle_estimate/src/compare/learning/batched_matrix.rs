//! Small matrices, batched over all candidates.
//!
//! Every operation is done for all N candidates at once, for vectorisation: each element is an array. A symmetric
//! matrix is stored as its lower triangle, row by row.

/// Index of an element of the triangle, k <= i.
#[inline(always)]
pub(super) fn at(i: usize, k: usize) -> usize {
    i * (i + 1) / 2 + k
}

/// Adds a b.
#[inline(always)]
pub(super) fn add<const N: usize>(to: &mut [f64; N], a: &[f64; N], b: &[f64; N]) {
    for j in 0..N {
        to[j] += a[j] * b[j];
    }
}

/// Subtracts a b.
#[inline(always)]
pub(super) fn subtract<const N: usize>(from: &mut [f64; N], a: &[f64; N], b: &[f64; N]) {
    for j in 0..N {
        from[j] -= a[j] * b[j];
    }
}

/// Scales by factors.
#[inline(always)]
pub(super) fn scale<const N: usize>(a: &mut [f64; N], by: &[f64; N]) {
    for j in 0..N {
        a[j] *= by[j];
    }
}

/// Weighted sum over the candidates with a non-zero weight.
#[inline(always)]
pub(super) fn mean<const N: usize>(weight: &[f64; N], of: &[f64; N]) -> f64 {
    let mut parts = [0.0; 8];
    for (weight, of) in weight.chunks(8).zip(of.chunks(8)) {
        for ((part, weight), of) in parts.iter_mut().zip(weight).zip(of) {
            let product = weight * of;
            *part += if *weight > 0.0 { product } else { 0.0 };
        }
    }
    parts.iter().sum()
}

/// a' C a.
#[inline(always)]
pub(super) fn form<const N: usize>(c: &[[f64; N]], a: &[[f64; N]]) -> [f64; N] {
    let mut form = [0.0; N];
    for i in 0..a.len() {
        let mut others = [0.0; N];
        (0..i).for_each(|k| add(&mut others, &c[at(i, k)], &a[k]));
        for j in 0..N {
            form[j] += a[i][j] * (2.0 * others[j] + c[at(i, i)][j] * a[i][j]);
        }
    }
    form
}

/// P^-1 b and P^-1 of a symmetric matrix, in place. Returns b . P^-1 b and ln |P|, not finite where P is not positive
/// definite.
///
/// ```text
/// P = L L',   L h = b,   b . P^-1 b = h . h,   ln |P| = ln prod_i L_ii^2,   L' m = h,   M = L^-1,   P^-1 = M' M
/// ```
#[inline(always)]
pub(super) fn solve<const N: usize>(p: &mut [[f64; N]], b: &mut [[f64; N]]) -> [[f64; N]; 2] {
    let n = b.len();
    let (mut square, mut ln, mut product) = ([0.0; N], [0.0; N], [1.0; N]);
    // h, and L with the diagonal inverted
    for i in 0..n {
        for k in 0..=i {
            let mut l = p[at(i, k)];
            (0..k).for_each(|q| subtract(&mut l, &p[at(i, q)], &p[at(k, q)]));
            if k < i {
                scale(&mut l, &p[at(k, k)]);
            } else {
                scale(&mut product, &l);
                l = l.map(|square| 1.0 / square.sqrt());
            }
            p[at(i, k)] = l;
        }
        let mut h = b[i];
        (0..i).for_each(|k| subtract(&mut h, &p[at(i, k)], &b[k]));
        scale(&mut h, &p[at(i, i)]);
        add(&mut square, &h, &h);
        b[i] = h;
        // one logarithm for four factors
        if i % 4 == 3 || i + 1 == n {
            ln.iter_mut().zip(&product).for_each(|(ln, product)| *ln += product.ln());
            product = [1.0; N];
        }
    }
    for i in (0..n).rev() {
        let mut m = b[i];
        (i + 1..n).for_each(|k| subtract(&mut m, &p[at(k, i)], &b[k]));
        scale(&mut m, &p[at(i, i)]);
        b[i] = m;
    }
    for i in 0..n {
        for k in 0..i {
            let mut m = [0.0; N];
            (k..i).for_each(|q| subtract(&mut m, &p[at(i, q)], &p[at(q, k)]));
            scale(&mut m, &p[at(i, i)]);
            p[at(i, k)] = m;
        }
    }
    for i in 0..n {
        for k in 0..=i {
            let mut c = [0.0; N];
            (i..n).for_each(|q| add(&mut c, &p[at(q, i)], &p[at(q, k)]));
            p[at(i, k)] = c;
        }
    }
    [square, ln]
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;

    #[test]
    fn what_is_solved_for_many_is_solved_for_each() {
        let n = 4;
        let of = |j: usize| {
            let rows = DMatrix::from_fn(n, n, |i, k| ((3 * i + 5 * k + 7 * j) as f64).sin());
            &rows * rows.transpose() + DMatrix::identity(n, n)
        };
        let each: [DMatrix<f64>; 3] = std::array::from_fn(of);
        let lower = (0..n).flat_map(|i| (0..=i).map(move |k| (i, k)));
        let mut side: Vec<[f64; 3]> = lower.clone().map(|at| std::array::from_fn(|j| each[j][at])).collect();
        let b: Vec<[f64; 3]> = (0..n).map(|i| [i as f64, 1.0, -2.0]).collect();
        let mut m = b.clone();
        let [square, ln] = solve(&mut side, &mut m);
        let again = form(&side, &b);
        for (j, one) in each.iter().enumerate() {
            let inverse = one.clone().cholesky().map(|root| root.inverse()).unwrap_or_default();
            assert!(lower.clone().all(|(i, k)| (side[at(i, k)][j] - inverse[(i, k)]).abs() < 1e-12));
            assert!((ln[j] - one.determinant().ln()).abs() < 1e-12);
            let b = nalgebra::DVector::from_fn(n, |i, _| b[i][j]);
            let by_hand = inverse * &b;
            assert!([square[j], again[j]].into_iter().all(|x| (x - b.dot(&by_hand)).abs() < 1e-12));
            assert!((0..n).all(|i| (m[i][j] - by_hand[i]).abs() < 1e-12));
        }
        let weights: [f64; 19] = std::array::from_fn(|j| j as f64);
        let numbers = std::array::from_fn(|j| if j == 0 { f64::NAN } else { 2.0 });
        assert_eq!(mean(&weights, &numbers), 342.0);
        // a matrix that is not positive definite has no inverse
        let [_, [ln]] = solve(&mut [[-1.0]], &mut [[0.0]]);
        assert!(!ln.is_finite());
    }
}
