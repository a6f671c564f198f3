//! Moves interior nodes to the middle of the cells round them: evens out edge lengths between two triangulations.

use crate::packing::Packing;
use crate::quality::six_volumes;
use crate::vector::{Point, add, scale};

/// Distance kept from the surface, as a fraction of the spacing.
const CLEARANCE: f64 = 0.4;

/// One sweep of centroidal-patch smoothing (Chen 2004), graded: each free interior node goes to the mean of its cells'
/// centroids, weighted by volume over h³, that is by the number of nodes that a cell stands for.
pub(crate) fn smooth(packing: &Packing, points: &mut [Point], faces: &[u8], fixed: &[bool], cells: &[[u32; 4]]) {
    let mut sums = vec![([0.0; 3], 0.0); points.len()];
    for c in cells {
        let p = c.map(|v| points[v as usize]);
        let middle = scale(add(add(p[0], p[1]), add(p[2], p[3])), 0.25);
        let weight = six_volumes(&p).max(0.0) / packing.h(middle).powi(3);
        for &v in c {
            let (sum, total) = &mut sums[v as usize];
            *sum = add(*sum, scale(middle, weight));
            *total += weight;
        }
    }
    for (i, (sum, total)) in sums.into_iter().enumerate() {
        if faces[i] != 0 || fixed[i] || total <= 0.0 {
            continue;
        }
        let q = scale(sum, 1.0 / total);
        let h = packing.h(q);
        if packing.domain.depth_to(q, h).min(packing.spacing.interface_distance(packing.domain.height(), q))
            > CLEARANCE * h
            && !packing.reserved(q)
        {
            points[i] = q;
        }
    }
}
