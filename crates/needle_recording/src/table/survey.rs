//! What is known of a table's samples where they are not kept.

use super::super::middle::Middle;
use super::super::order::{DAY_NS, DISORDER_NS, Ordered, Spread};
use super::row::Row;
use needle_core::twin::Pose;

/// Stamps of a series.
#[derive(Clone, Debug)]
pub(in super::super) struct Steps<V> {
    /// Number of samples, and of stamps.
    pub count: usize,
    groups: usize,
    /// First and last stamp, ns; 0 if there are none.
    span: [i64; 2],
    /// Shortest step from a stamp to the next, and the first one, ns.
    shortest: i64,
    first_step: Option<i64>,
    /// Number of samples of the first stamp, of the last, and of the one with most.
    sizes: [usize; 3],
    /// All steps, and the numbers of samples of all stamps but the last.
    middle: [Middle; 2],
    /// Whether a stamp was below the one before, or a day above it.
    pub disordered: bool,
    /// Whether two samples of one stamp differ.
    coarse: bool,
    last: Option<V>,
    /// Stamp of the sample that came last in the file, and whether one was below that before it.
    arrived: Option<i64>,
    sorted: bool,
}

impl<V> Default for Steps<V> {
    fn default() -> Self {
        Self {
            count: 0,
            groups: 0,
            span: [0; 2],
            shortest: i64::MAX,
            first_step: None,
            sizes: [0; 3],
            middle: Default::default(),
            disordered: false,
            coarse: false,
            last: None,
            arrived: None,
            sorted: false,
        }
    }
}

impl<V: PartialEq> Steps<V> {
    /// Takes a stamp into account in the order of the file.
    fn arrive(&mut self, stamp: i64) {
        self.sorted |= self.arrived.replace(stamp).is_some_and(|before| stamp < before);
    }

    /// Takes a sample into account in the order of time.
    fn note(&mut self, stamp: i64, value: V) {
        let [first, last, most] = &mut self.sizes;
        if self.count > 0 && stamp == self.span[1] {
            *last += 1;
            self.coarse |= self.last.as_ref() != Some(&value);
        } else {
            if self.count == 0 {
                self.span[0] = stamp;
            } else {
                let step = stamp.saturating_sub(self.span[1]);
                self.disordered |= !(1..DAY_NS).contains(&step);
                self.shortest = self.shortest.min(step);
                self.first_step.get_or_insert(step);
                self.middle[0].note(step as f64);
                self.middle[1].note(*last as f64);
            }
            self.groups += 1;
            *last = 1;
        }
        if self.groups == 1 {
            *first = *last;
        }
        *most = (*most).max(*last);
        self.span[1] = stamp;
        self.count += 1;
        self.last = Some(value);
    }

    /// How samples of one stamp are spread; `None` if one of each stamp is taken.
    pub(in super::super) fn spread(&self) -> Option<Spread> {
        let [steps, sizes] = &self.middle;
        let mut sizes = sizes.clone();
        sizes.note(self.sizes[1] as f64);
        Spread::of(steps, &sizes).filter(|_| self.coarse)
    }

    /// Whether there is time enough between two stamps for the samples of one.
    pub(in super::super) fn have_room(&self) -> bool {
        !self.coarse || self.groups < 2 || self.sizes[2] as i64 <= self.shortest
    }

    /// What becomes of the samples, and how many are left, without the samples.
    pub(in super::super) fn ordered(&self) -> (Ordered<()>, usize) {
        let repeated = self.count - self.groups;
        let one_time = if self.coarse && self.groups == 1 { repeated } else { 0 };
        let spread = if self.coarse { repeated - one_time } else { 0 };
        let repeated = repeated - one_time - spread;
        let left = self.count - one_time - repeated;
        (Ordered { sorted: self.sorted, spread, one_time, repeated, ..Ordered::untouched(Vec::new()) }, left)
    }

    /// Time of the first sample, ns.
    pub(in super::super) fn first(&self) -> Option<i64> {
        let first = |spread: Spread| {
            let next = self.first_step.map(|step| self.span[0] + step);
            spread.times(self.span[0], self.sizes[0], next, true).0
        };
        (self.count > 0).then(|| self.spread().map_or(self.span[0], first))
    }
}

/// Samples of a table, as far as the order of their times goes, and which axes of the force have numbers.
#[derive(Clone, Debug, Default)]
pub(in super::super) struct Survey {
    /// Rows with a sample.
    pub rows: Steps<()>,
    pub depths: Steps<f64>,
    pub poses: Steps<Pose>,
    /// 0 where a component is not finite.
    pub forces: Steps<[f64; 3]>,
    pub markers: Steps<Vec<[f64; 3]>>,
    /// Number of forces by their finite components, bit 0 for x.
    pub finite: [u64; 8],
}

impl Survey {
    /// Takes a row into account in the order of the file. `before_ns`: how far it lies before the latest one.
    pub(super) fn arrive(&mut self, stamp: i64, row: &Row, before_ns: i64) {
        self.rows.disordered |= before_ns > DISORDER_NS;
        row.depth_m.iter().for_each(|_| self.depths.arrive(stamp));
        row.pose.iter().for_each(|_| self.poses.arrive(stamp));
        row.force_n.iter().for_each(|_| self.forces.arrive(stamp));
        row.markers.iter().for_each(|_| self.markers.arrive(stamp));
    }

    /// Takes a row into account in the order of time.
    pub(super) fn note(&mut self, stamp: i64, Row { depth_m, pose, force_n, markers, .. }: Row) {
        self.rows.note(stamp, ());
        depth_m.into_iter().for_each(|depth_m| self.depths.note(stamp, depth_m));
        pose.into_iter().for_each(|pose| self.poses.note(stamp, pose));
        markers.into_iter().for_each(|markers| self.markers.note(stamp, markers));
        if let Some(force_n) = force_n {
            let bits = (0..3).map(|k| usize::from(force_n[k].is_finite()) << k).sum::<usize>();
            self.finite[bits] += 1;
            self.forces.note(stamp, force_n.map(|f| if f.is_finite() { f } else { 0.0 }));
        }
    }
}
