//! Readings, and those of a block.

use nalgebra::DVector;

use super::basis::Basis;
use crate::compare::uncertainty::FORCE_ERROR;

/// A number that was measured.
#[derive(Clone, Debug, PartialEq)]
pub struct Reading<R = Vec<f64>> {
    /// What was measured, less what was expected.
    pub off: f64,
    /// What each unknown adds to that, for one standard deviation of it.
    pub row: R,
    /// The force that was expected, N; `None` for a number whose size says nothing of the error of the model.
    pub force_n: Option<f64>,
    /// How far what was expected may be off by itself, with the readings beside it: standard deviation.
    pub doubt: f64,
}

impl Reading {
    /// What was measured, the effect of the size of the force, and those along the directions of a basis; what is left of the row.
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
    /// How many each has.
    each: usize,
}

impl Readings {
    pub fn push(&mut self, reading: &Reading<impl AsRef<[f64]>>) {
        let row = reading.row.as_ref();
        self.numbers.extend([reading.off, reading.force_n.unwrap_or(0.0), reading.doubt * reading.doubt]);
        self.numbers.extend_from_slice(row);
        self.each = 3 + row.len();
    }

    fn iter(&self) -> impl Iterator<Item = &[f64]> {
        self.numbers.chunks(self.each)
    }

    pub fn mean(&self) -> Reading {
        let mut mean = vec![0.0; self.each];
        self.iter().for_each(|one| mean.iter_mut().zip(one).for_each(|(sum, x)| *sum += x));
        let share = self.each as f64 / self.numbers.len() as f64;
        mean.iter_mut().for_each(|sum| *sum *= share);
        let row = mean.split_off(3);
        Reading { off: mean[0], row, force_n: Some(mean[1]), doubt: mean[2].sqrt() }
    }

    /// What is left of each, if the size of the force and the unknowns along a basis have mean m.
    pub fn unexplained(&self, basis: &Basis, m: &[f64]) -> Vec<f64> {
        let mut unknowns = DVector::zeros(self.each - 3);
        basis.add(&m[1..], &mut unknowns);
        let explained =
            |row: &[f64]| row.iter().zip(unknowns.as_slice()).map(|(effect, mean)| effect * mean).sum::<f64>();
        self.iter().map(|one| one[0] - FORCE_ERROR * one[1] * m[0] - explained(&one[3..])).collect()
    }

    pub fn is_empty(&self) -> bool {
        self.numbers.is_empty()
    }

    pub fn clear(&mut self) {
        self.numbers.clear();
    }
}
