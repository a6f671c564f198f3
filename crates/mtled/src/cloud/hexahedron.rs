//! Hexahedra among the background cells, and how hexahedra, wedges and pyramids are cut into tetrahedra.
//!
//! Nodes, supports, surface and projection know tetrahedra alone; a hexahedron is what its tetrahedra are integrated with together (see
//! [`crate::approximation`]). The cut is the cone of the corner with the lowest number over the faces that it is not on, and each quadrangle
//! is cut through its lowest corner, so cells that share a face cut it in the same way (Dompierre, Labbé, Vallet, Camarero 1999).

/// A hexahedron, and the tetrahedra among a cloud's cells that it is cut into.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Hexahedron {
    /// Corners: those of one face in turn, then those opposite to them.
    pub corners: [u32; 8],
    /// Its tetrahedra, five or six, by their places among the cells.
    pub cells: Vec<u32>,
}

/// Local coordinates of a hexahedron's corners, over 1: each is -1 or 1.
pub const CORNERS: [[i8; 3]; 8] =
    [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]];

/// Faces by places among the corners, counter-clockwise seen from outside.
const HEXAHEDRON: [&[usize]; 6] =
    [&[0, 3, 2, 1], &[4, 5, 6, 7], &[0, 1, 5, 4], &[1, 2, 6, 5], &[2, 3, 7, 6], &[3, 0, 4, 7]];
const WEDGE: [&[usize]; 5] = [&[0, 2, 1], &[3, 4, 5], &[0, 1, 4, 3], &[1, 2, 5, 4], &[2, 0, 3, 5]];
const PYRAMID: [&[usize]; 5] = [&[0, 3, 2, 1], &[0, 1, 4], &[1, 2, 4], &[2, 3, 4], &[3, 0, 4]];

/// The tetrahedra of a hexahedron (8 corners), a wedge (6), a pyramid (5) or a tetrahedron (4), of positive volume where the
/// second face of a hexahedron or wedge, or the tip, lies beyond its first; none of anything else.
#[must_use]
pub fn cut(corners: &[u32]) -> Vec<[u32; 4]> {
    let faces: &[&[usize]] = match *corners {
        [a, b, c, d] => return vec![[a, b, c, d]],
        [_, _, _, _, _] => &PYRAMID,
        [_, _, _, _, _, _] => &WEDGE,
        [_, _, _, _, _, _, _, _] => &HEXAHEDRON,
        _ => &[],
    };
    let lowest = |of: &[usize]| of.iter().copied().min_by_key(|&k| corners[k]).unwrap_or_default();
    let apex = (0..corners.len()).min_by_key(|&k| corners[k]).unwrap_or_default();
    let mut cells = Vec::with_capacity(6);
    for face in faces.iter().filter(|face| !face.contains(&apex)) {
        let first = lowest(face);
        let start = face.iter().position(|&k| k == first).unwrap_or_default();
        let turned: Vec<u32> = (0..face.len()).map(|k| corners[face[(start + k) % face.len()]]).collect();
        cells.extend(turned[1..].windows(2).map(|edge| [corners[apex], turned[0], edge[0], edge[1]]));
    }
    cells
}

#[cfg(test)]
mod tests {
    use super::super::quality::six_volumes;
    use super::*;

    /// The corner's place, in a body that is sheared so that no two edges are alike.
    fn place(k: usize) -> [f64; 3] {
        let [x, y, z] = CORNERS[k].map(|c| 0.5 * f64::from(c));
        [x + 0.2 * y, 1.1 * y, 0.9 * z - 0.1 * x]
    }

    fn volume(numbers: &[u32], places: &[usize]) -> (usize, f64) {
        let cells = cut(numbers);
        let at = |n: u32| place(places[numbers.iter().position(|m| *m == n).unwrap_or_default()]);
        let sum = cells.iter().map(|c| six_volumes(&c.map(at)) / 6.0).sum();
        (cells.len(), sum)
    }

    #[test]
    fn the_tetrahedra_fill_the_body_whichever_corner_is_lowest() {
        let whole = 1.1 * 0.9;
        for (places, cells, share) in [
            (&[0_usize, 1, 2, 3, 4, 5, 6, 7][..], 6, 1.0),
            (&[0, 1, 2, 4, 5, 6], 3, 0.5),
            (&[0, 1, 2, 3, 6], 2, 1.0 / 3.0),
        ] {
            for turn in 0..40_u32 {
                let n = places.len() as u32;
                // permutations of the numbers, not only rotations
                let mut numbers: Vec<u32> = (0..n).map(|k| (k * (1 + 2 * (turn % 2)) + turn) % n).collect();
                numbers.swap((turn as usize / 2) % places.len(), turn as usize % places.len());
                numbers.iter_mut().enumerate().for_each(|(k, m)| *m = 10 * *m + k as u32);
                let (count, volume) = volume(&numbers, places);
                assert_eq!(count, cells, "{numbers:?}");
                assert!((volume / (whole * share) - 1.0).abs() < 1e-12, "{numbers:?}: {volume}");
            }
        }
        assert_eq!(cut(&[3, 1, 2, 0]), [[3, 1, 2, 0]]);
        assert!(cut(&[0, 1, 2]).is_empty());
    }

    #[test]
    fn neighbours_cut_their_common_face_in_the_same_way() {
        let (one, other) = (cut(&[9, 4, 7, 2, 11, 5, 3, 8]), cut(&[11, 5, 3, 8, 20, 1, 22, 23]));
        let face = [11, 5, 3, 8];
        let halves = |cells: &[[u32; 4]]| {
            let on = |c: &[u32; 4]| {
                let mut on: Vec<u32> = c.iter().copied().filter(|n| face.contains(n)).collect();
                on.sort_unstable();
                on
            };
            let mut halves: Vec<Vec<u32>> = cells.iter().map(on).filter(|h| h.len() == 3).collect();
            halves.sort();
            halves
        };
        assert_eq!(halves(&one).len(), 2);
        assert_eq!(halves(&one), halves(&other));
    }
}
