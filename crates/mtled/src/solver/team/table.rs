//! The shape table point by point: what a loop needs whose lanes are members.
//!
//! In the [blocks](super::super::block) eight points share a visit, so that a gradient is zero in half of the lanes or more: not
//! every point has every node. With members in the lanes each point visits its own nodes and no others.

use super::super::block::Block;
use crate::number::{LANES, Lanes, Real};

/// One block's points, those with as many nodes side by side: the processor then knows where the loop over a point's nodes ends.
#[derive(Debug)]
pub struct PointTable<T> {
    /// Offsets into `local` and `gradient`, one more than points.
    pub start: Vec<u32>,
    /// Index of each node among those of the block.
    pub local: Vec<u16>,
    /// d phi_j / d X_k over the point's `scale`: the very numbers of the block.
    pub gradient: Vec<[T; 3]>,
    /// See [`Block`].
    pub scale: Vec<T>,
    pub volume: Vec<T>,
    pub squares: Vec<T>,
    pub corners: Vec<[u16; 4]>,
    /// Slot of each point in the block.
    pub slot: Vec<u32>,
    /// Place of each slot's point here.
    place: Vec<u32>,
}

impl<T: Real> PointTable<T> {
    /// The points of a block.
    pub fn new(block: &Block<T>) -> Self {
        let of = |lanes: &[Lanes<T>], slot: usize| lanes[slot / LANES].0[slot % LANES];
        let visits = |slot: usize| {
            let group = block.start[slot / LANES] as usize..block.start[slot / LANES + 1] as usize;
            group.filter(move |&v| block.used[v] & (1 << (slot % LANES)) != 0)
        };
        let mut slots: Vec<usize> = block.occupied().map(|(slot, _)| slot).collect();
        slots.sort_by_key(|&slot| visits(slot).count());
        let mut place = vec![0; block.point.len()];
        (0u32..).zip(&slots).for_each(|(at, &slot)| place[slot] = at);
        let mut table = Self {
            start: vec![0],
            local: Vec::new(),
            gradient: Vec::new(),
            scale: slots.iter().map(|&s| of(&block.scale, s)).collect(),
            volume: slots.iter().map(|&s| of(&block.volume, s)).collect(),
            squares: slots.iter().map(|&s| of(&block.squares, s)).collect(),
            corners: slots.iter().map(|&s| block.corners[s / LANES].map(|corner| corner[s % LANES])).collect(),
            slot: slots.iter().map(|&s| s as u32).collect(),
            place,
        };
        for slot in slots {
            for visit in visits(slot) {
                table.local.push(block.local[visit]);
                table.gradient.push(block.gradient[visit].map(|g| T::load(g[slot % LANES])));
            }
            table.start.push(table.local.len() as u32);
        }
        table
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.volume.len()
    }

    /// Place of the point in a slot of the block.
    pub fn place(&self, slot: usize) -> usize {
        self.place[slot] as usize
    }

    /// Where a point's nodes stand.
    #[inline(always)]
    pub fn visits(&self, point: usize) -> std::ops::Range<usize> {
        self.start[point] as usize..self.start[point + 1] as usize
    }
}
