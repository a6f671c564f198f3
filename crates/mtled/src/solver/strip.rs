//! N_aP of a run of nodes, and its products both ways.

use std::ops::Range;

use crate::number::{LANES, Lanes, Number, Real};

/// Fields that go through a strip together at most.
pub(super) const FIELDS: usize = 2;

/// A run of nodes in groups of [`LANES`]; each group has the coarse nodes P that any of its nodes has.
///
/// Both products read the same table in the same order. On the way to the coarse nodes each entry adds to its coarse
/// node in its own lane; the sums of a coarse node that several runs share are then added in a fixed order.
#[derive(Debug)]
pub(super) struct Strip<T> {
    nodes: Range<usize>,
    /// Global index of each local coarse node, ascending.
    pub coarse: Vec<u32>,
    /// Offsets into `local` and `value`, one more than groups.
    start: Vec<u32>,
    /// Local index of the coarse node.
    local: Vec<u16>,
    /// N_aP.
    value: Vec<Lanes<T>>,
}

#[derive(Debug)]
pub(super) struct StripScratch<T> {
    /// Of each local coarse node and field: sums by lane, zero between products.
    lanes: Vec<[Lanes<T>; FIELDS]>,
    /// What the coarse nodes hand on.
    handed: Vec<[T; FIELDS]>,
}

impl<T: Real> StripScratch<T> {
    pub(super) fn new(strip: &Strip<T>) -> Self {
        let coarse = strip.coarse.len();
        Self { lanes: vec![[Lanes::default(); FIELDS]; coarse], handed: vec![[T::default(); FIELDS]; coarse] }
    }
}

impl<T: Real> Strip<T> {
    /// Collects the (P, N_aP) of the nodes a; what is given twice is added.
    pub(super) fn new<I: Iterator<Item = (u32, f64)>>(nodes: Range<usize>, entries: impl Fn(usize) -> I) -> Self {
        let coarse = ascending(nodes.clone().flat_map(&entries).map(|e| e.0));
        let mut strip = Self { start: vec![0], local: Vec::new(), value: Vec::new(), nodes: nodes.clone(), coarse };
        for first in nodes.clone().step_by(LANES) {
            let group = first..(first + LANES).min(nodes.end);
            let columns = ascending(group.clone().flat_map(&entries).map(|e| e.0));
            let from = strip.value.len();
            strip.value.resize(from + columns.len(), Lanes::default());
            for (lane, a) in group.enumerate() {
                for (p, value) in entries(a) {
                    strip.value[from + columns.partition_point(|&c| c < p)].0[lane] += T::of(value);
                }
            }
            let local = |p: &u32| strip.coarse.partition_point(|c| c < p) as u16;
            strip.local.extend(columns.iter().map(local));
            strip.start.push(strip.value.len() as u32);
        }
        strip
    }

    /// Sums N_aP x_a over the run's nodes, for each of its coarse nodes; N fields at once.
    #[inline(always)]
    pub(super) fn sum_to_coarse<const N: usize>(
        &self,
        scratch: &mut StripScratch<T>,
        x: impl Fn(usize) -> [T; N],
        out: [&mut [T]; N],
    ) {
        for (group, first) in self.nodes.clone().step_by(LANES).enumerate() {
            let mut here = [Lanes::default(); N];
            for (lane, n) in (first..self.nodes.end).take(LANES).enumerate() {
                let x = x(n);
                (0..N).for_each(|k| here[k].0[lane] = x[k]);
            }
            let range = self.start[group] as usize..self.start[group + 1] as usize;
            for (&l, &value) in self.local[range.clone()].iter().zip(&self.value[range]) {
                let sum = &mut scratch.lanes[usize::from(l)];
                (0..N).for_each(|k| sum[k] = value.fma(here[k], sum[k]));
            }
        }
        for (k, out) in out.into_iter().enumerate() {
            for (sum, lanes) in out.iter_mut().zip(&mut scratch.lanes) {
                *sum = lanes[k].sum();
                lanes[k] = Lanes::default();
            }
        }
    }

    /// Sums N_aP p_P over the coarse nodes, for each of the run's nodes; N fields at once.
    #[inline(always)]
    pub(super) fn hand_to_nodes<const N: usize>(
        &self,
        scratch: &mut StripScratch<T>,
        p: [&[T]; N],
        out: [&mut [T]; N],
    ) {
        let handed = &mut scratch.handed;
        for (handed, &coarse) in handed.iter_mut().zip(&self.coarse) {
            (0..N).for_each(|k| handed[k] = p[k][coarse as usize]);
        }
        let mut out = out.map(|out| out.as_chunks_mut::<LANES>().0);
        for (group, range) in self.start.windows(2).enumerate() {
            let range = range[0] as usize..range[1] as usize;
            // two sums hide the latency of the additions
            let mut sums = [[Lanes::default(); 2]; N];
            let (locals, last_local) = self.local[range.clone()].as_chunks::<2>();
            let (values, last_value) = self.value[range].as_chunks::<2>();
            for (l, v) in locals.iter().zip(values) {
                let (a, b) = (handed[usize::from(l[0])], handed[usize::from(l[1])]);
                for (k, sums) in sums.iter_mut().enumerate() {
                    sums[0] = v[0].fma(Lanes::splat(a[k]), sums[0]);
                    sums[1] = v[1].fma(Lanes::splat(b[k]), sums[1]);
                }
            }
            for (&l, &v) in last_local.iter().zip(last_value) {
                let last = handed[usize::from(l)];
                (0..N).for_each(|k| sums[k][0] = v.fma(Lanes::splat(last[k]), sums[k][0]));
            }
            (0..N).for_each(|k| out[k][group] = (sums[k][0] + sums[k][1]).0);
        }
    }

    /// The first product for a number of each member of a team, with the same bits: x of all nodes; `lanes`: memory that is zero, of as many
    /// entries as there are coarse nodes here.
    #[inline(always)]
    pub(super) fn sum_members(&self, x: &[Lanes<T>], lanes: &mut [[Lanes<T>; LANES]], sums: &mut [Lanes<T>]) {
        for (group, first) in self.nodes.clone().step_by(LANES).enumerate() {
            let here = &x[first..(first + LANES).min(self.nodes.end)];
            let range = self.start[group] as usize..self.start[group + 1] as usize;
            for (&l, value) in self.local[range.clone()].iter().zip(&self.value[range]) {
                for ((x, value), sum) in here.iter().zip(value.0).zip(&mut lanes[usize::from(l)]) {
                    *sum = x.fma(Lanes::splat(value), *sum);
                }
            }
        }
        for (sum, lanes) in sums.iter_mut().zip(lanes) {
            *sum = Lanes::sum_of(lanes);
            *lanes = [Lanes::default(); LANES];
        }
    }

    /// The second product likewise: p of all coarse nodes, to x of the run's nodes.
    #[inline(always)]
    pub(super) fn hand_to_members(&self, p: &[Lanes<T>], x: &mut [Lanes<T>]) {
        for (group, first) in self.nodes.clone().step_by(LANES).enumerate() {
            let mut sums = [[Lanes::default(); LANES]; 2];
            let range = self.start[group] as usize..self.start[group + 1] as usize;
            for (i, (&l, value)) in self.local[range.clone()].iter().zip(&self.value[range]).enumerate() {
                let handed = p[self.coarse[usize::from(l)] as usize];
                for (sum, value) in sums[i % 2].iter_mut().zip(value.0) {
                    *sum = handed.fma(Lanes::splat(value), *sum);
                }
            }
            let of_nodes = x[first..self.nodes.end].iter_mut().zip(sums[0].iter().zip(&sums[1]));
            of_nodes.for_each(|(x, (even, odd))| *x = *even + *odd);
        }
    }
}

/// Each index once, in ascending order.
pub(super) fn ascending(indices: impl Iterator<Item = u32>) -> Vec<u32> {
    let mut v: Vec<u32> = indices.collect();
    v.sort_unstable();
    v.dedup();
    v
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_are_those_of_the_matrix() {
        let value = |a: usize, p: u32| (a as f64 - 3.5) * (f64::from(p) + 0.5);
        let entries =
            |a: usize| (0..9).filter(move |p| !(a as u32 + p).is_multiple_of(3)).map(move |p| (p, value(a, p)));
        let strip: Strip<f64> = Strip::new(4..17, entries);
        let mut scratch = StripScratch::new(&strip);
        assert_eq!(strip.coarse, (0..9).collect::<Vec<u32>>());
        let x = |a: usize| (a * a) as f64;
        let mut sums = [f64::NAN; 9];
        for again in 0..2 {
            strip.sum_to_coarse(&mut scratch, |a| [x(a)], [&mut sums]);
            for p in 0..9 {
                let all = (4..17).flat_map(|a| entries(a).filter(|e| e.0 == p).map(move |e| e.1 * x(a)));
                let expected: f64 = all.sum();
                assert!((sums[p as usize] - expected).abs() < 1e-9, "{again} {p}");
            }
        }
        let p: Vec<f64> = (0..9).map(|p| f64::from(p * p)).collect();
        let mut out = [f64::NAN; 16];
        strip.hand_to_nodes(&mut scratch, [&p], [&mut out]);
        for a in 4..17 {
            let expected: f64 = entries(a).map(|(p, v)| v * f64::from(p * p)).sum();
            assert!((out[a - 4] - expected).abs() < 1e-9, "{a}");
        }
        assert_eq!(out[13..], [0.0; 3], "beyond the run");
    }
}
