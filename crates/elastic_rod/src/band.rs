//! A symmetric matrix of 3 by 3 blocks whose rows reach two blocks to either side, and its Cholesky factor.

/// Entries below the diagonal that a column has: two blocks, and what is left of its own.
const BELOW: usize = 8;

/// Lower half, column by column; the first block stands for the vertex after the clamp.
#[derive(Clone, Debug)]
pub(crate) struct Band {
    columns: Vec<[f64; BELOW + 1]>,
}

impl Band {
    pub(crate) fn new(size: usize) -> Self {
        Self { columns: vec![[0.0; BELOW + 1]; size] }
    }

    pub(crate) fn clear(&mut self) {
        self.columns.fill([0.0; BELOW + 1]);
    }

    /// Adds to the entry of row r of vertex a and column c of vertex b; those of the clamp, and those above the diagonal, are left out.
    pub(crate) fn add(&mut self, a: usize, b: usize, (r, c): (usize, usize), value: f64) {
        if a == 0 || b == 0 {
            return;
        }
        let (row, column) = (3 * (a - 1) + r, 3 * (b - 1) + c);
        if row >= column {
            self.columns[column][row - column] += value;
        }
    }

    /// Adds what joins two vertices by weights.
    pub(crate) fn join(&mut self, a: usize, b: usize, weights: [f64; 2], at: (usize, usize), value: f64) {
        for (i, wi) in [(a, weights[0]), (b, weights[1])] {
            for (j, wj) in [(a, weights[0]), (b, weights[1])] {
                self.add(i, j, at, wi * wj * value);
            }
        }
    }

    /// Takes over a matrix, with a shift of its diagonal.
    pub(crate) fn copy_from(&mut self, other: &Self, shift: f64) {
        self.columns.copy_from_slice(&other.columns);
        self.columns.iter_mut().for_each(|column| column[0] += shift);
    }

    /// Cholesky factor in place; false where the matrix is not positive definite.
    pub(crate) fn factorise(&mut self) -> bool {
        let size = self.columns.len();
        for j in 0..size {
            let pivot = self.columns[j][0];
            if pivot.is_nan() || pivot <= 0.0 {
                return false;
            }
            let root = pivot.sqrt();
            self.columns[j][0] = root;
            let below = BELOW.min(size - 1 - j);
            self.columns[j][1..=below].iter_mut().for_each(|x| *x /= root);
            let column = self.columns[j];
            for k in 1..=below {
                for i in k..=below {
                    self.columns[j + k][i - k] -= column[i] * column[k];
                }
            }
        }
        true
    }

    /// Solves with the factor, in place.
    pub(crate) fn solve(&self, x: &mut [f64]) {
        let size = self.columns.len();
        for j in 0..size {
            x[j] /= self.columns[j][0];
            for i in 1..=BELOW.min(size - 1 - j) {
                x[j + i] -= self.columns[j][i] * x[j];
            }
        }
        for j in (0..size).rev() {
            for i in 1..=BELOW.min(size - 1 - j) {
                x[j] -= self.columns[j][i] * x[j + i];
            }
            x[j] /= self.columns[j][0];
        }
    }
}
