//! Hexahedra, wedges and pyramids of a mesh: how they are cut into tetrahedra.
#![allow(clippy::unwrap_used)]

use mtled_cloud::hexahedron::{CORNERS, cut};
use mtled_cloud::quality::six_volumes;

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
    for (places, cells, share) in
        [(&[0_usize, 1, 2, 3, 4, 5, 6, 7][..], 6, 1.0), (&[0, 1, 2, 4, 5, 6], 3, 0.5), (&[0, 1, 2, 3, 6], 2, 1.0 / 3.0)]
    {
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
