//! Members' own fields into the lanes and back.

use super::super::block::Block;
use super::passes::Vectors;
use crate::approximation::Form;
use crate::mirror::Mirror;
use crate::number::{LANES, Lanes, Loop, Real};
use crate::shares::Shares;

/// Displacements of a block's nodes and images, relative to its first node as in [`Block::deform`].
pub(super) struct Load<'a, T: Real> {
    pub block: &'a Block<T>,
    pub from: &'a [&'a [[f64; 3]]; LANES],
    /// Of each node, its [`dimensions`](super::passes::dimensions).
    pub to: &'a mut [Lanes<T>],
}

impl<T: Real> Loop for Load<'_, T> {
    #[inline(always)]
    fn go(self) {
        let Self { block, from, to } = self;
        // all of one length, which is compared once
        let nodes = from[0].len();
        let from = from.map(|u| &u[..nodes]);
        let (own, images) = block.nodes.split_at(block.originals);
        let mut origin = gathered(&from, block.nodes[0]);
        match block.form {
            Form::Full => load::<T, 3>(&from, &origin, own, to),
            Form::Mirrored(mirror) => {
                let (to, of_images) = to.as_chunks_mut::<3>().0.split_at_mut(own.len());
                load::<T, 3>(&from, &origin, own, to.as_flattened_mut());
                for (to, &n) in of_images.iter_mut().zip(images) {
                    let image = mirrored(&mirror, &gathered(&from, n));
                    *to = std::array::from_fn(|c| Lanes::narrow(image[c] - origin[c]));
                }
            }
            Form::Axisymmetric => {
                // only a motion along the axis is rigid
                origin[0] = Lanes::default();
                let (to, of_images) = to.as_chunks_mut::<2>().0.split_at_mut(own.len());
                load::<T, 2>(&from, &origin, own, to.as_flattened_mut());
                load::<T, 2>(&from, &origin, images, of_images.as_flattened_mut());
                of_images.iter_mut().take(images.len()).for_each(|to| to[0] = -to[0]);
            }
        }
    }
}

/// Three components of a vector, or x and z.
#[inline(always)]
fn load<T: Real, const D: usize>(
    from: &[&[[f64; 3]]; LANES],
    origin: &Vectors<f64>,
    nodes: &[u32],
    to: &mut [Lanes<T>],
) {
    for (to, &n) in to.as_chunks_mut::<D>().0.iter_mut().zip(nodes) {
        let u = gathered(from, n);
        for (k, c) in of_vector(D).enumerate() {
            to[k] = Lanes::narrow(u[c] - origin[c]);
        }
    }
}

/// Components of a vector of which so many are kept: see [`dimensions`](super::passes::dimensions).
#[inline(always)]
fn of_vector(kept: usize) -> impl Iterator<Item = usize> {
    (0..3).step_by(4 - kept)
}

/// A node's vector of each member.
#[inline(always)]
fn gathered(from: &[&[[f64; 3]]; LANES], n: u32) -> Vectors<f64> {
    let mut all = [Lanes::default(); 3];
    for k in 0..LANES {
        let [x, y, z] = from[k][n as usize];
        (all[0].0[k], all[1].0[k], all[2].0[k]) = (x, y, z);
    }
    all
}

/// Adds up what the lanes of the groups have added to each node, and leaves zero in them.
pub(super) struct SumLanes<'a, T: Real, const D: usize> {
    /// Of each node and lane, its [`dimensions`](super::passes::dimensions).
    pub from: &'a mut [Lanes<T>],
    pub to: &'a mut [Vectors<T>],
}

impl<T: Real, const D: usize> Loop for SumLanes<'_, T, D> {
    #[inline(always)]
    fn go(self) {
        let by_lane = self.from.as_chunks_mut::<D>().0.as_chunks_mut::<LANES>().0;
        for (from, to) in by_lane.iter_mut().zip(self.to) {
            for (k, c) in of_vector(D).enumerate() {
                let mut lanes = [Lanes::default(); LANES];
                for (lane, from) in lanes.iter_mut().zip(from.iter()) {
                    *lane = from[k];
                }
                to[c] = Lanes::sum_of(&lanes);
            }
            *from = [[Lanes::default(); D]; LANES];
        }
    }
}

/// Each member's own sums over the blocks, in the order in which [`Kernel::node_force`](super::super::kernel::Kernel) has them.
pub(super) struct Store<'a, 'f, T: Real> {
    pub shares: &'a Shares,
    /// Of each block on each of its nodes, block after block.
    pub from: &'a [Vectors<T>],
    pub to: &'a mut [Option<&'f mut [[f64; 3]]>; LANES],
}

impl<T: Real> Loop for Store<'_, '_, T> {
    #[inline(always)]
    fn go(self) {
        for n in 0..self.shares.start.len() - 1 {
            let mut sum: Vectors<f64> = [Lanes::default(); 3];
            for &at in self.shares.of_index(n) {
                let share = &self.from[at as usize];
                for c in 0..3 {
                    sum[c] += share[c].wide();
                }
            }
            for (k, to) in self.to.iter_mut().enumerate() {
                if let Some(to) = to {
                    to[n] = [sum[0].0[k], sum[1].0[k], sum[2].0[k]];
                }
            }
        }
    }
}

/// The image of each member's vector.
#[inline(always)]
pub(super) fn mirrored(mirror: &Mirror, v: &Vectors<f64>) -> Vectors<f64> {
    let mut out = *v;
    for k in 0..LANES {
        let image = mirror.image(&[v[0].0[k], v[1].0[k], v[2].0[k]]);
        (0..3).for_each(|c| out[c].0[k] = image[c]);
    }
    out
}
