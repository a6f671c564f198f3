//! Slices cut into disjoint parts, one for each thread that asks.
//!
//! A [`Disjoint`] value borrows its slices mutably and is used up by [`super::pool::Pool::each`], which hands out every
//! part once. So the borrow checker sees one exclusive borrow for the whole phase, and no caller needs unsafe code.

use std::marker::PhantomData;

/// Nodes per part of a phase over nodes. Under Miri so few that a tiny model has several parts.
pub(super) const NODES_PER_CHUNK: usize = if cfg!(miri) { 8 } else { 256 };

/// Work that falls into parts that different threads may hold at the same time.
///
/// # Safety
/// Parts with different indices must not overlap, and it must be sound to use a part on any thread.
pub(crate) unsafe trait Disjoint: Sync {
    type Part;

    fn len(&self) -> usize;

    /// The part with index `i`.
    ///
    /// # Safety
    /// `i` is below [`Disjoint::len`], and no part with this index is taken twice from the same value.
    unsafe fn part(&self, i: usize) -> Self::Part;
}

/// A mutable slice by its address, so that threads can take parts of it.
struct Slice<'a, T> {
    at: *mut T,
    len: usize,
    life: PhantomData<&'a mut [T]>,
}

// SAFETY: elements are reached through `Slice::range` alone, whose contract forbids two holders of one element; moving
// an exclusive reference to a `T` between threads needs `T: Send`.
unsafe impl<T: Send> Sync for Slice<'_, T> {}

impl<'a, T> Slice<'a, T> {
    fn new(slice: &'a mut [T]) -> Self {
        Self { at: slice.as_mut_ptr(), len: slice.len(), life: PhantomData }
    }

    /// Elements `from..to`.
    ///
    /// # Safety
    /// `from <= to <= len`, and nobody else takes an element of the range from this value.
    unsafe fn range(&self, from: usize, to: usize) -> &'a mut [T] {
        debug_assert!(from <= to && to <= self.len);
        // SAFETY: `from` is within the slice by the caller's promise.
        let first = unsafe { self.at.add(from) };
        // SAFETY: in bounds and held by nobody else by the caller's promise; `new` borrowed the slice for 'a.
        unsafe { std::slice::from_raw_parts_mut(first, to - from) }
    }
}

/// The elements of a slice, one to a part.
pub(super) struct Each<'a, T>(Slice<'a, T>);

impl<'a, T> Each<'a, T> {
    /// Borrows the slice for one phase.
    pub(super) fn new(slice: &'a mut [T]) -> Self {
        Self(Slice::new(slice))
    }
}

// SAFETY: part i is element i.
unsafe impl<'a, T: Send> Disjoint for Each<'a, T> {
    type Part = &'a mut T;

    fn len(&self) -> usize {
        self.0.len
    }

    unsafe fn part(&self, i: usize) -> &'a mut T {
        // SAFETY: `i` is below `len` and asked for once, by the caller's promise.
        unsafe { &mut self.0.range(i, i + 1)[0] }
    }
}

/// Runs of `size` elements; the last may be shorter.
pub(super) struct Chunks<'a, T> {
    slice: Slice<'a, T>,
    size: usize,
}

impl<'a, T> Chunks<'a, T> {
    /// Borrows the slice for one phase.
    pub(super) fn new(slice: &'a mut [T], size: usize) -> Self {
        assert!(size > 0, "a run has at least one element");
        Self { slice: Slice::new(slice), size }
    }
}

// SAFETY: part i is the elements from i * size up to (i + 1) * size.
unsafe impl<'a, T: Send> Disjoint for Chunks<'a, T> {
    type Part = &'a mut [T];

    fn len(&self) -> usize {
        self.slice.len.div_ceil(self.size)
    }

    unsafe fn part(&self, i: usize) -> &'a mut [T] {
        let from = i * self.size;
        // SAFETY: `i` is below `len`, so `from` is within the slice; asked for once, by the caller's promise.
        unsafe { self.slice.range(from, (from + self.size).min(self.slice.len)) }
    }
}

/// Where runs of given lengths begin in a slice that holds them one after another.
#[derive(Clone, Debug)]
pub(super) struct Offsets(Vec<usize>);

impl Offsets {
    /// Offsets of runs with these lengths; one more than runs, ascending.
    pub(super) fn of(lengths: impl Iterator<Item = usize>) -> Self {
        let mut offsets = vec![0];
        let mut end = 0_usize;
        offsets.extend(lengths.map(|length| {
            end = end.saturating_add(length);
            end
        }));
        Self(offsets)
    }

    pub(super) fn len(&self) -> usize {
        self.0.len() - 1
    }

    pub(super) fn run(&self, i: usize) -> std::ops::Range<usize> {
        self.0[i]..self.0[i + 1]
    }

    pub(super) fn total(&self) -> usize {
        self.0.last().copied().unwrap_or(0)
    }
}

/// Runs of given lengths, one after another.
pub(super) struct Runs<'a, T> {
    slice: Slice<'a, T>,
    offsets: &'a Offsets,
}

impl<'a, T> Runs<'a, T> {
    /// Borrows the slice for one phase.
    ///
    /// # Panics
    /// If the slice is shorter than the runs.
    pub(super) fn new(slice: &'a mut [T], offsets: &'a Offsets) -> Self {
        assert!(offsets.total() <= slice.len(), "{} elements for runs of {}", slice.len(), offsets.total());
        Self { slice: Slice::new(slice), offsets }
    }
}

// SAFETY: offsets ascend by construction, so runs don't overlap, and `new` has checked that they lie in the slice.
unsafe impl<'a, T: Send> Disjoint for Runs<'a, T> {
    type Part = &'a mut [T];

    fn len(&self) -> usize {
        self.offsets.len()
    }

    unsafe fn part(&self, i: usize) -> &'a mut [T] {
        // SAFETY: the run lies in the slice (see the impl) and is asked for once, by the caller's promise.
        unsafe { self.slice.range(self.offsets.0[i], self.offsets.0[i + 1]) }
    }
}

macro_rules! zipped {
    ($($t:ident $n:tt),*) => {
        // SAFETY: parts with different indices are made of parts with different indices.
        unsafe impl<$($t: Disjoint),*> Disjoint for ($($t,)*) {
            type Part = ($($t::Part,)*);

            fn len(&self) -> usize {
                $(assert_eq!(self.0.len(), self.$n.len(), "lists of parts that belong together have one length");)*
                self.0.len()
            }

            unsafe fn part(&self, i: usize) -> Self::Part {
                // SAFETY: all lists have the same length (see `len`), and each is asked for `i` as often as this one.
                ($(unsafe { self.$n.part(i) },)*)
            }
        }
    };
}
zipped!(A 0, B 1);
zipped!(A 0, B 1, C 2);
zipped!(A 0, B 1, C 2, D 3);
zipped!(A 0, B 1, C 2, D 3, E 4);

#[cfg(test)]
mod tests {
    use super::*;

    /// Every part once, in any order: what a phase does.
    fn all<D: Disjoint>(work: &D) -> Vec<D::Part> {
        // SAFETY: each index once.
        (0..work.len()).rev().map(|i| unsafe { work.part(i) }).collect()
    }

    #[test]
    fn parts_cover_a_slice_without_overlap() {
        let mut x = [0_u32; 10];
        for part in all(&Each::new(&mut x)) {
            *part += 1;
        }
        for part in all(&Chunks::new(&mut x, 4)) {
            part.iter_mut().for_each(|x| *x += 10);
        }
        let offsets = Offsets::of([3, 0, 5, 2].into_iter());
        for part in all(&Runs::new(&mut x, &offsets)) {
            part.iter_mut().for_each(|x| *x += 100);
        }
        assert_eq!(x, [111; 10]);
    }

    #[test]
    #[should_panic(expected = "9 elements for runs of 10")]
    fn runs_beyond_the_slice_are_refused() {
        let offsets = Offsets::of([4, 6].into_iter());
        let _ = Runs::new(&mut [0_u8; 9], &offsets);
    }

    #[test]
    #[should_panic(expected = "one length")]
    fn lists_of_unequal_length_are_refused() {
        let _ = (Each::new(&mut [0_u8; 2]), Each::new(&mut [0_u8; 3])).len();
    }
}
