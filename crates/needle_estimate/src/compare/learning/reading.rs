//! Readings, and the readings of a block.

use nalgebra::DVector;

use super::basis::Basis;
use crate::compare::uncertainty::FORCE_ERROR;

/// A measured number.
#[derive(Clone, Debug, PartialEq)]
pub struct Reading<R = Vec<f64>> {
    /// Measured minus expected value.
    pub off: f64,
    /// Effect of each unknown on it, for one standard deviation of the unknown.
    pub row: R,
    /// The expected force, N; `None` for a number whose size does not bound the model error.
    pub force_n: Option<f64>,
    /// Standard deviation of a further error of the expected value, common to neighbouring readings.
    pub doubt: f64,
}

impl Reading {
    /// Deviation, effect of the force's size, and components along the directions of a basis; and the residual of the
    /// row.
    pub(super) fn along(&self, basis: &Basis) -> (Vec<f64>, DVector<f64>) {
        let (along, left) = basis.of(&self.row);
        let size = FORCE_ERROR * self.force_n.unwrap_or(0.0);
        ([self.off, size].into_iter().chain(along).collect(), left)
    }
}

/// Readings of a block.
#[derive(Clone, Debug, Default)]
pub(super) struct Readings {
    /// `off`, the force, the square of `doubt` and `row`, one reading after the other.
    numbers: Vec<f64>,
    /// Numbers per reading.
    each: usize,
}

impl Readings {
    pub(crate) fn push(&mut self, reading: &Reading<impl AsRef<[f64]>>) {
        let row = reading.row.as_ref();
        self.numbers.extend([reading.off, reading.force_n.unwrap_or(0.0), reading.doubt * reading.doubt]);
        self.numbers.extend_from_slice(row);
        self.each = 3 + row.len();
    }

    fn iter(&self) -> impl Iterator<Item = &[f64]> {
        self.numbers.chunks(self.each)
    }

    pub(crate) fn mean(&self) -> Reading {
        let mut mean = vec![0.0; self.each];
        self.iter().for_each(|one| mean.iter_mut().zip(one).for_each(|(sum, x)| *sum += x));
        let share = self.each as f64 / self.numbers.len() as f64;
        mean.iter_mut().for_each(|sum| *sum *= share);
        let row = mean.split_off(3);
        Reading { off: mean[0], row, force_n: Some(mean[1]), doubt: mean[2].sqrt() }
    }

    /// Residual of each reading, if the size of the force and the unknowns along a basis have mean m.
    pub(crate) fn unexplained(&self, basis: &Basis, m: &[f64]) -> Vec<f64> {
        let mut unknowns = DVector::zeros(self.each - 3);
        basis.add(&m[1..], &mut unknowns);
        let explained =
            |row: &[f64]| row.iter().zip(unknowns.as_slice()).map(|(effect, mean)| effect * mean).sum::<f64>();
        self.iter().map(|one| one[0] - FORCE_ERROR * one[1] * m[0] - explained(&one[3..])).collect()
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.numbers.is_empty()
    }

    pub(crate) fn clear(&mut self) {
        self.numbers.clear();
    }
}
