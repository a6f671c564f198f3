//! The shape table point by point: what a loop needs whose lanes are members.
//!
//! In the [blocks](super::super::block) eight points share a visit, so that a gradient is zero in half of the lanes or more: not
//! every point has every node. With members in the lanes each point visits its own nodes and no others.

use super::super::block::Block;
use crate::number::{LANES, Lanes, Real};

/// One block's points in the order of their slots.
#[derive(Debug)]
pub(super) struct PointTable<T> {
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
}

impl<T: Real> PointTable<T> {
    pub(super) fn new(block: &Block<T>) -> Self {
        let of = |lanes: &[Lanes<T>], slot: usize| lanes[slot / LANES].0[slot % LANES];
        let slots: Vec<usize> = block.occupied().map(|(slot, _)| slot).collect();
        let mut table = Self {
            start: vec![0],
            local: Vec::new(),
            gradient: Vec::new(),
            scale: slots.iter().map(|&s| of(&block.scale, s)).collect(),
            volume: slots.iter().map(|&s| of(&block.volume, s)).collect(),
            squares: slots.iter().map(|&s| of(&block.squares, s)).collect(),
            corners: slots.iter().map(|&s| block.corners[s / LANES].map(|corner| corner[s % LANES])).collect(),
            slot: slots.iter().map(|&s| s as u32).collect(),
        };
        for slot in slots {
            let (group, lane) = (slot / LANES, slot % LANES);
            let visits = block.start[group] as usize..block.start[group + 1] as usize;
            for visit in visits.filter(|&v| block.used[v] & (1 << lane) != 0) {
                table.local.push(block.local[visit]);
                table.gradient.push(block.gradient[visit].map(|g| T::load(g[lane])));
            }
            table.start.push(table.local.len() as u32);
        }
        table
    }

    pub(super) fn len(&self) -> usize {
        self.volume.len()
    }

    /// Lane of a point's group in which it stands.
    #[inline(always)]
    pub(super) fn lane(&self, point: usize) -> usize {
        self.slot[point] as usize % LANES
    }

    #[inline(always)]
    pub(super) fn visits(&self, point: usize) -> std::ops::Range<usize> {
        self.start[point] as usize..self.start[point + 1] as usize
    }
}
