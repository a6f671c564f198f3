//! Which integration points share a vector: up to eight that lie close together, so that they share most of their support nodes. One visit
//! to such a node then serves eight points.

use super::shape_table::ShapeTable;
use crate::number::LANES;
use crate::shares::Shares;

impl ShapeTable {
    /// The points in groups that share a vector, each in one region; `cells` by their corners, with the places (m) of these. Supports make no
    /// difference.
    pub(crate) fn groups(&self, cells: &[[u32; 4]], places: &[[f64; 3]]) -> Vec<Vec<u32>> {
        let corners = |p: usize| &cells[self.cell[p] as usize];
        let centre = |p| std::array::from_fn(|k| corners(p).iter().map(|&n| places[n as usize][k]).sum::<f64>() / 4.0);
        let centres: Vec<[f64; 3]> = (0..self.volume.len()).map(centre).collect();
        groups(&centres, |p| corners(p), |p| (self.region_of(p), self.is_filled(p)), places.len())
    }
}

/// Points in groups of up to [`LANES`], each grown from the first point left over, in the order of the points, by the
/// nearest to its centre among those that share a node with it. `nodes(i)` are the nodes by which point i has
/// neighbours, below `count`; all points of a group are of one `kind`. The result depends on the points alone.
fn groups<'a, K: PartialEq>(
    at: &[[f64; 3]],
    nodes: impl Fn(usize) -> &'a [u32],
    kind: impl Fn(usize) -> K,
    count: usize,
) -> Vec<Vec<u32>> {
    let nodes = &nodes;
    let all = (0..at.len()).flat_map(move |i| nodes(i).iter().map(move |&n| (n, i as u32)));
    // points by node
    let users = Shares::of_pairs(all, count);
    let mut left = vec![true; at.len()];
    // the group that last looked at a point
    let mut seen = vec![u32::MAX; at.len()];
    let mut groups: Vec<Vec<u32>> = Vec::with_capacity(at.len() / LANES + 1);
    let mut near: Vec<u32> = Vec::new();
    for first in 0..at.len() as u32 {
        if !left[first as usize] {
            continue;
        }
        let mut group = Vec::with_capacity(LANES);
        near.clear();
        let mut sum = [0.0; 3];
        let mut next = first;
        loop {
            left[next as usize] = false;
            group.push(next);
            if group.len() == LANES {
                break;
            }
            (0..3).for_each(|k| sum[k] += at[next as usize][k]);
            for &n in nodes(next as usize) {
                for &q in users.of_index(n as usize) {
                    let like = kind(q as usize) == kind(first as usize);
                    if left[q as usize] && like && seen[q as usize] != groups.len() as u32 {
                        seen[q as usize] = groups.len() as u32;
                        near.push(q);
                    }
                }
            }
            let centre = sum.map(|s| s / group.len() as f64);
            let distance = |q: u32| -> f64 { (0..3).map(|k| (at[q as usize][k] - centre[k]).powi(2)).sum() };
            let nearest = near.iter().enumerate().map(|(i, &q)| (distance(q), i)).min_by(|a, b| a.0.total_cmp(&b.0));
            let Some((_, i)) = nearest else { break };
            next = near.swap_remove(i);
        }
        groups.push(group);
    }
    groups
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_point_is_in_one_group_of_neighbours() {
        // a row of points, each with the two nodes at its ends, numbered at random
        let place = |i: u32| (i * 37) % 101;
        let at: Vec<[f64; 3]> = (0..101).map(|i| [f64::from(place(i)), 0.0, 0.0]).collect();
        let nodes: Vec<[u32; 2]> = (0..101).map(|i| [place(i), place(i) + 1]).collect();
        let groups = groups(&at, |i| &nodes[i], |_| false, 102);
        let mut all: Vec<u32> = groups.concat();
        all.sort_unstable();
        assert_eq!(all, (0..101).collect::<Vec<u32>>());
        for group in &groups {
            let mut places: Vec<u32> = group.iter().map(|&i| place(i)).collect();
            places.sort_unstable();
            assert!(places.len() <= LANES && places.windows(2).all(|w| w[1] == w[0] + 1), "{places:?}");
        }
    }

    #[test]
    fn points_of_a_kind_are_among_their_like() {
        let at: Vec<[f64; 3]> = (0..40).map(|i| [f64::from(i), 0.0, 0.0]).collect();
        let nodes: Vec<[u32; 2]> = (0..40).map(|i| [i, i + 1]).collect();
        let apart = |p: usize| (13..29).contains(&p);
        let groups = groups(&at, |i| &nodes[i], apart, 41);
        assert_eq!(groups.concat().len(), 40);
        for group in &groups {
            let of = group.iter().filter(|&&p| apart(p as usize)).count();
            assert!(of == 0 || of == group.len(), "{group:?}");
        }
        // none of the sixteen is in a group with lanes to spare
        assert_eq!(groups.iter().filter(|g| apart(g[0] as usize)).count(), 2);
    }
}
