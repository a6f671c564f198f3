//! Cells joined in pairs, so that two share one integration point: half the work per step where the field is smooth.
//!
//! Two tetrahedra with a common face make one cell with the sum of their volumes, and its point is the centroid of the
//! pair. A cloud has five to six tetrahedra per node, more points than its field has use for at a tetrahedron each.
//! The same pairs are found on every machine.

use super::support::distance;

/// What a cell is integrated with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Share {
    /// Its own points.
    Own,
    /// One point for itself and this cell.
    With(u32),
    /// The point of the cell that it is joined to.
    Left,
    /// The points that the caller brings for it.
    Given,
}

/// A pair of cells with a common face that might be joined.
struct Candidate {
    /// Distance of the centroids over the cubic root of the volume, times 1 + |ln(V_a / V_b)|: compact pairs of like
    /// cells come first.
    length: f64,
    cells: [u32; 2],
}

/// Joins cells in pairs, compact ones first; each cell at most once. Of a pair the larger cell stands for both, and
/// every node remains a corner of a cell with a point. `region` of each cell, or none: a pair lies in one region.
pub(super) fn pairs(points: &[[f64; 3]], cells: &[[u32; 4]], volume: &[f64], region: &[u8]) -> Vec<Share> {
    let centre: Vec<[f64; 3]> = cells
        .iter()
        .map(|c| std::array::from_fn(|k| c.iter().map(|&n| points[n as usize][k]).sum::<f64>() / 4.0))
        .collect();
    let mut candidates: Vec<Candidate> = neighbours(cells)
        .into_iter()
        .filter(|[a, b]| region.get(*a as usize) == region.get(*b as usize))
        .map(|[a, b]| {
            let (va, vb) = (volume[a as usize], volume[b as usize]);
            let length =
                distance(centre[a as usize], centre[b as usize]) / (va + vb).cbrt() * (1.0 + (va / vb).ln().abs());
            Candidate { length, cells: [a, b] }
        })
        .collect();
    candidates.sort_by(|a, b| a.length.total_cmp(&b.length).then(a.cells.cmp(&b.cells)));
    let mut share = vec![Share::Own; cells.len()];
    let mut seen = vec![0_u32; points.len()];
    cells.iter().flatten().for_each(|&n| seen[n as usize] += 1);
    for Candidate { cells: [a, b], .. } in candidates {
        if share[a as usize] != Share::Own || share[b as usize] != Share::Own {
            continue;
        }
        let (large, small) = if volume[a as usize] >= volume[b as usize] { (a, b) } else { (b, a) };
        for (kept, left) in [(large, small), (small, large)] {
            let lost = &cells[left as usize];
            if lost.iter().any(|&n| seen[n as usize] < 2) {
                continue;
            }
            lost.iter().for_each(|&n| seen[n as usize] -= 1);
            share[kept as usize] = Share::With(left);
            share[left as usize] = Share::Left;
            break;
        }
    }
    share
}

/// Pairs of cells with a common face, the lower first.
fn neighbours(cells: &[[u32; 4]]) -> Vec<[u32; 2]> {
    let mut faces: Vec<([u32; 3], u32)> = Vec::with_capacity(4 * cells.len());
    for (c, &[i, j, k, l]) in cells.iter().enumerate() {
        for mut face in [[i, j, k], [i, j, l], [i, k, l], [j, k, l]] {
            face.sort_unstable();
            faces.push((face, c as u32));
        }
    }
    faces.sort_unstable();
    faces.windows(2).filter(|w| w[0].0 == w[1].0).map(|w| [w[0].1, w[1].1]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A row of tetrahedra round an edge: each shares a face with the next.
    fn fan(count: u32) -> (Vec<[f64; 3]>, Vec<[u32; 4]>) {
        let mut points = vec![[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
        points.extend((0..=count).map(|i| [(0.5 * f64::from(i)).cos(), (0.5 * f64::from(i)).sin(), 0.5]));
        let cells = (0..count).map(|i| [0, 1, 2 + i, 3 + i]).collect();
        (points, cells)
    }

    #[test]
    fn each_cell_has_one_point_to_it() {
        let (points, cells) = fan(9);
        let share = pairs(&points, &cells, &[1.0; 9], &[]);
        let joined = share.iter().filter(|s| matches!(s, Share::With(_))).count();
        assert_eq!(joined, share.iter().filter(|s| **s == Share::Left).count());
        assert!(joined >= 3, "{share:?}");
        for (c, s) in share.iter().enumerate() {
            if let Share::With(other) = s {
                assert_eq!(share[*other as usize], Share::Left);
                assert_eq!((*other as usize).abs_diff(c), 1, "they have no face in common: {share:?}");
            }
        }
    }

    #[test]
    fn no_node_is_left_without_a_point() {
        // the two ends of the fan have a node to themselves
        for count in 1..9 {
            let (points, cells) = fan(count);
            let share = pairs(&points, &cells, &vec![1.0; count as usize], &[]);
            for n in 0..points.len() as u32 {
                let held = cells.iter().zip(&share).any(|(c, s)| *s != Share::Left && c.contains(&n));
                assert!(held, "node {n} of {count} cells: {share:?}");
            }
        }
    }
}
