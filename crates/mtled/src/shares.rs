//! Lists turned round: for each index, where it is named.

/// What each of a number of indices has, one index after another.
#[derive(Clone, Debug, Default)]
pub(crate) struct Shares {
    /// Offsets, one more than indices.
    pub start: Vec<u32>,
    /// Ascending for each index, if they come so.
    pub at: Vec<u32>,
}

impl Shares {
    /// Positions of every index in `0..count` in lists of them (those of blocks, strips or cells), one after another.
    pub(crate) fn of<'a>(lists: impl Iterator<Item = &'a [u32]> + Clone, count: usize) -> Self {
        Self::of_pairs(lists.flatten().copied().zip(0..), count)
    }

    /// What stands beside each index in `0..count`, in this order.
    pub(crate) fn of_pairs(pairs: impl Iterator<Item = (u32, u32)> + Clone, count: usize) -> Self {
        let mut start = vec![0u32; count + 1];
        for (n, _) in pairs.clone() {
            start[n as usize + 1] += 1;
        }
        for n in 0..count {
            start[n + 1] += start[n];
        }
        let mut at = vec![0; start[count] as usize];
        let mut next = start.clone();
        for (n, own) in pairs {
            at[next[n as usize] as usize] = own;
            next[n as usize] += 1;
        }
        Self { start, at }
    }

    /// Those of one index.
    #[inline]
    pub(crate) fn of_index(&self, n: usize) -> &[u32] {
        &self.at[self.start[n] as usize..self.start[n + 1] as usize]
    }
}
