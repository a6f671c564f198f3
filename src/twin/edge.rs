//! The edge of contact: where the surface that a bonded instrument holds meets the free surface.

use rayon::prelude::*;

/// Cells that have a node at the edge of contact, one next to such a node, or one within `reach` metres of it. The edge is
/// where triangles of the `surface` have nodes both held by the instrument and free.
#[must_use]
pub fn cells(points: &[[f64; 3]], cells: &[[u32; 4]], surface: &[[u32; 3]], held: &[u32], reach: f64) -> Vec<u32> {
    let nodes = points.len();
    let mut is_held = vec![false; nodes];
    held.iter().for_each(|&n| is_held[n as usize] = true);
    let mut near = vec![false; nodes];
    for triangle in surface {
        let count = triangle.iter().filter(|&&n| is_held[n as usize]).count();
        if (1..3).contains(&count) {
            triangle.iter().filter(|&&n| is_held[n as usize]).for_each(|&n| near[n as usize] = true);
        }
    }
    let touching = |near: &[bool]| -> Vec<u32> {
        (0..cells.len() as u32).filter(|&c| cells[c as usize].iter().any(|&n| near[n as usize])).collect()
    };
    let edge: Vec<[f64; 3]> = points.iter().zip(&near).filter(|(_, near)| **near).map(|(p, _)| *p).collect();
    for c in touching(&near) {
        cells[c as usize].iter().for_each(|&n| near[n as usize] = true);
    }
    near.par_iter_mut().zip(points).for_each(|(near, p)| {
        let square = |e: &[f64; 3]| (0..3).map(|k| (e[k] - p[k]).powi(2)).sum::<f64>();
        *near |= edge.iter().any(|e| square(e) < reach * reach);
    });
    touching(&near)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_edge_of_contact_is_found() {
        // a strip of triangles, each the top of a tetrahedron of its own; the first three nodes are held
        let surface: Vec<[u32; 3]> = (0..8).map(|i| [i, i + 1, i + 2]).collect();
        let tetrahedra: Vec<[u32; 4]> = (0..8).map(|i| [i, i + 1, i + 2, 10 + i]).collect();
        // nodes 1 and 2 are at the edge, 0 to 4 next to it
        let points: Vec<[f64; 3]> = (0..18).map(|n| [f64::from(n), 0.0, 0.0]).collect();
        assert_eq!(cells(&points, &tetrahedra, &surface, &[0, 1, 2], 0.5), [0, 1, 2, 3, 4]);
        assert_eq!(cells(&points, &tetrahedra, &surface, &[0, 1, 2], 3.5), [0, 1, 2, 3, 4, 5], "node 5 is 3 m away");
        assert!(cells(&points, &tetrahedra, &surface, &[], 3.5).is_empty());
        let all: Vec<u32> = (0..10).collect();
        assert!(cells(&points, &tetrahedra, &surface, &all, 3.5).is_empty(), "no free surface, no edge");
    }
}
