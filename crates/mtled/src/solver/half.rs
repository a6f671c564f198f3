//! A body with a plane of symmetry, of which the model holds one half.
//!
//! Nodes on the plane stay there: the other half pulls them as hard the other way. Forces of half the body on what holds it are half of
//! those within the plane, and cancel across it:
//!
//! ```text
//! F = 2 (F_half - (n . F_half) n)        M = 2 (n . M_half) n
//! ```

use super::inertia::Sums;
use crate::mirror::Mirror;

/// The plane, and the nodes on it.
#[derive(Clone, Debug)]
pub(super) struct Half {
    mirror: Mirror,
    on_plane: Vec<bool>,
}

impl Half {
    /// Of the nodes of one half, m.
    pub(super) fn new(mirror: Mirror, points: &[[f64; 3]]) -> Self {
        Self { mirror, on_plane: mirror.holds(points) }
    }

    /// A node's vector: on the plane the part within it.
    #[inline]
    pub(super) fn of_node(&self, n: usize, v: [f64; 3]) -> [f64; 3] {
        if self.on_plane[n] { self.mirror.within(&v) } else { v }
    }

    /// Share of a node that the half has.
    pub(super) fn share(&self, n: usize) -> f64 {
        if self.on_plane[n] { 0.5 } else { 1.0 }
    }

    /// Sum of a vector of node n and of its image, and of how many nodes that is.
    pub(super) fn with_image(&self, n: usize, v: &[f64; 3]) -> ([f64; 3], f64) {
        let within = self.mirror.within(v);
        if self.on_plane[n] { (within, 1.0) } else { (within.map(|x| 2.0 * x), 2.0) }
    }

    /// The sums over the whole body.
    pub(super) fn whole(&self, half: &Sums) -> Sums {
        let twice = |v: &[f64; 3]| self.mirror.within(v).map(|x| 2.0 * x);
        let within = self.mirror.within(&half.moment);
        Sums {
            instrument: twice(&half.instrument),
            base: twice(&half.base),
            moment: std::array::from_fn(|k| 2.0 * (half.moment[k] - within[k])),
            kinetic: 2.0 * half.kinetic,
            learnt: half.learnt.map(|x| 2.0 * x),
            present: 2.0 * half.present,
        }
    }
}
