//! Order along a Hilbert curve, so that neighbours in space are neighbours in memory.

use crate::vector::{Point, bounds};

/// Bits per axis of the curve.
const BITS: u32 = 20;

/// Position of a point of the box along the Hilbert curve through it (Skilling 2004, transposed form).
fn hilbert_key(mut x: [u32; 3]) -> u64 {
    let top = 1u32 << (BITS - 1);
    let mut q = top;
    while q > 1 {
        let p = q - 1;
        for i in 0..3 {
            if x[i] & q != 0 {
                x[0] ^= p;
            } else {
                let t = (x[0] ^ x[i]) & p;
                x[0] ^= t;
                x[i] ^= t;
            }
        }
        q >>= 1;
    }
    x[1] ^= x[0];
    x[2] ^= x[1];
    let mut t = 0;
    q = top;
    while q > 1 {
        if x[2] & q != 0 {
            t ^= q - 1;
        }
        q >>= 1;
    }
    let mut key = 0u64;
    for bit in (0..BITS).rev() {
        for v in x {
            key = key << 1 | u64::from((v ^ t) >> bit & 1);
        }
    }
    key
}

/// The order in which to number `points`: `order[new] = old`. Ties keep their order.
pub fn hilbert_order(points: &[Point]) -> Vec<u32> {
    let [low, high] = bounds(points);
    let size = (0..3).map(|k| high[k] - low[k]).fold(f64::MIN_POSITIVE, f64::max);
    let cells = f64::from((1u32 << BITS) - 1);
    let mut keys: Vec<(u64, u32)> = points
        .iter()
        .enumerate()
        .map(|(i, p)| (hilbert_key([0, 1, 2].map(|k| ((p[k] - low[k]) / size * cells) as u32)), i as u32))
        .collect();
    keys.sort_unstable();
    keys.into_iter().map(|(_, i)| i).collect()
}

/// Turns a cell's nodes so that the smallest comes first, keeping the sign of its volume; sorts the cells by their nodes.
pub fn sort_cells(cells: &mut [[u32; 4]]) {
    for c in cells.iter_mut() {
        // Even permutations only: swap two pairs to bring the smallest first, then rotate the other three.
        let at = (0..4).fold(0, |best, i| if c[i] < c[best] { i } else { best });
        if at != 0 {
            let others: [usize; 2] = match at {
                1 => [2, 3],
                2 => [1, 3],
                _ => [1, 2],
            };
            c.swap(0, at);
            c.swap(others[0], others[1]);
        }
        let second = (1..4).fold(1, |best, i| if c[i] < c[best] { i } else { best });
        c[1..].rotate_left(second - 1);
    }
    cells.sort_unstable();
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_along_the_curve_are_unit_steps_in_space() {
        let n = 8u32;
        let shift = BITS - 3;
        let mut keys: Vec<(u64, [u32; 3])> = (0..n * n * n)
            .map(|i| [i % n, i / n % n, i / n / n])
            .map(|x| (hilbert_key(x.map(|v| v << shift)), x))
            .collect();
        keys.sort_unstable();
        for pair in keys.windows(2) {
            let step: u32 = (0..3).map(|k| pair[0].1[k].abs_diff(pair[1].1[k])).sum();
            assert_eq!(step, 1, "{pair:?}");
        }
    }
}
