//! A sparse matrix times a vector, eight rows at a time.

use super::lanes::{LANES, Lanes};
use super::real::{Number, Real};

/// Rows of a sparse matrix in groups of [`LANES`]; each group has the columns that any of its rows has.
#[derive(Clone, Debug, Default)]
pub struct Rows<T> {
    /// Offsets into `column` and `value`, one more than groups.
    start: Vec<u32>,
    column: Vec<u32>,
    value: Vec<Lanes<T>>,
}

impl<T: Real> Rows<T> {
    /// Collects `count` rows of (column, value) pairs; what is given twice is added.
    pub fn new(count: usize, row: impl Fn(usize) -> Vec<(u32, f64)>) -> Self {
        let mut rows = Self { start: vec![0], ..Self::default() };
        for first in (0..count).step_by(LANES) {
            let group: Vec<Vec<(u32, f64)>> = (first..(first + LANES).min(count)).map(&row).collect();
            let mut columns: Vec<u32> = group.iter().flatten().map(|e| e.0).collect();
            columns.sort_unstable();
            columns.dedup();
            let from = rows.value.len();
            rows.value.resize(from + columns.len(), Lanes::default());
            for (lane, row) in group.iter().enumerate() {
                for &(column, value) in row {
                    rows.value[from + columns.partition_point(|&c| c < column)].0[lane] += T::of(value);
                }
            }
            rows.column.extend(columns);
            rows.start.push(rows.column.len() as u32);
        }
        rows
    }

    /// Number of groups.
    pub fn groups(&self) -> usize {
        self.start.len().saturating_sub(1)
    }

    /// The products of one group of rows with `x`.
    #[inline(always)]
    pub fn times(&self, group: usize, x: &[T]) -> Lanes<T> {
        let range = self.start[group] as usize..self.start[group + 1] as usize;
        let (columns, values) = (&self.column[range.clone()], &self.value[range]);
        // two sums hide the latency of the additions
        let mut sums = [Lanes::default(); 2];
        let (columns, last_column) = columns.as_chunks::<2>();
        let (values, last_value) = values.as_chunks::<2>();
        for (c, v) in columns.iter().zip(values) {
            sums[0] = v[0].fma(Lanes::splat(x[c[0] as usize]), sums[0]);
            sums[1] = v[1].fma(Lanes::splat(x[c[1] as usize]), sums[1]);
        }
        for (&c, &v) in last_column.iter().zip(last_value) {
            sums[0] = v.fma(Lanes::splat(x[c as usize]), sums[0]);
        }
        sums[0] + sums[1]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_are_those_of_the_matrix() {
        let value = |r: usize, c: u32| (r as f64 - 3.5) * (f64::from(c) + 0.5);
        let row = |r: usize| (0..9).filter(|c| !(r as u32 + c).is_multiple_of(3)).map(|c| (c, value(r, c))).collect();
        let rows: Rows<f64> = Rows::new(13, row);
        let x: Vec<f64> = (0..9).map(|c| f64::from(c * c)).collect();
        assert_eq!(rows.groups(), 2);
        for r in 0..13 {
            let expected: f64 = row(r).iter().map(|(c, v)| v * x[*c as usize]).sum();
            assert!((rows.times(r / LANES, &x).0[r % LANES] - expected).abs() < 1e-9);
        }
        assert_eq!(rows.times(1, &x).0[LANES - 1], 0.0);
    }
}
