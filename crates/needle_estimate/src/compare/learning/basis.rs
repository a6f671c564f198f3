//! Subspace of the unknowns that readings have observed.
//!
//! A hundred members differ in a few keys, so that their forces span only a few directions. Outside that subspace the
//! unknowns keep their prior, and nothing has to be computed. The directions q are orthonormal. A row a has the
//! components a' q. Its residual is added as a new direction if it is larger than a share of the noise.

use nalgebra::DVector;

/// Share of the noise below which the residual of a row is neglected.
const SEEN: f64 = 0.01;

/// See the module.
#[derive(Clone, Debug, Default)]
pub(super) struct Basis(Vec<DVector<f64>>);

impl Basis {
    /// Components of a row along the directions, and the residual.
    pub(crate) fn of(&self, row: &[f64]) -> (Vec<f64>, DVector<f64>) {
        let mut left = DVector::from_row_slice(row);
        let along = self.0.iter().map(|q| {
            let along = q.dot(&left);
            left.axpy(-along, q, 1.0);
            along
        });
        (along.collect(), left)
    }

    /// Adds the direction of a row, if its residual is not negligible. Returns whether it was added.
    pub(crate) fn grow(&mut self, row: &[f64], noise: f64) -> bool {
        let (_, left) = self.of(row);
        let grows = left.norm() > SEEN * noise && self.0.len() < row.len();
        if grows {
            // orthogonalise twice: a residual that is small relative to the row is not orthogonal after one pass
            let (_, left) = self.of(left.as_slice());
            self.0.push(left.normalize());
        }
        grows
    }

    /// Adds the vector with these components to another.
    pub(crate) fn add(&self, along: &[f64], to: &mut DVector<f64>) {
        self.0.iter().zip(along).for_each(|(q, along)| to.axpy(*along, q, 1.0));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_put_together_again_from_few_directions() {
        let rows = |k: usize| -> Vec<f64> {
            (0..40).map(|i| (k as f64).sin() + 0.1 * k as f64 * i as f64 + 1e-9 * ((i * k) as f64).cos()).collect()
        };
        let mut basis = Basis::default();
        let grown = (0..20).filter(|k| basis.grow(&rows(*k), 1e-3)).count();
        assert_eq!(grown, 2, "a constant and a slope");
        let (along, left) = basis.of(&rows(7));
        assert!(left.norm() < 1e-5);
        let mut again = left;
        basis.add(&along, &mut again);
        assert!(again.iter().zip(rows(7)).all(|(a, b)| (a - b).abs() < 1e-12));
    }
}
