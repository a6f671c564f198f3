//! Points of a low-discrepancy sequence: Sobol's, with Owen's scrambling by hashing (B. Burley, J. Comput. Graph.
//! Tech. 9(4), 2020).
//!
//! The first 2^m points fill the unit cube more evenly than random ones, so that mean and quantiles need fewer
//! members.

/// Most points of a sequence.
pub(crate) const MOST: usize = 1 << 16;

/// Most dimensions of a point.
pub(crate) const DIMENSIONS: usize = 256;

/// Coordinate `dimension` of point `index`, in (0, 1).
#[must_use]
#[allow(clippy::cast_possible_truncation)] // index and dimension are checked to be small; the seed is truncated
pub fn coordinate(index: usize, dimension: usize, seed: u64) -> f64 {
    let seed = (seed ^ (seed >> 32)) as u32;
    // multiples of 2^-24 from 0 on; the middle of each such interval is neither 0 nor 1
    f64::from(sobol_burley::sample(index as u32, dimension as u32, seed)) + 2f64.powi(-25)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_power_of_two_fills_every_axis_evenly() {
        for (dimension, seed) in [(0, 0), (3, 7), (17, 1)] {
            let mut cells: Vec<usize> = (0..64).map(|i| (64.0 * coordinate(i, dimension, seed)) as usize).collect();
            cells.sort_unstable();
            assert_eq!(cells, (0..64).collect::<Vec<_>>());
        }
        assert!((0..100).any(|i| coordinate(i, 0, 0).to_bits() != coordinate(i, 0, 1).to_bits()), "the seed matters");
    }
}
