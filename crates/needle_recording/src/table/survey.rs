//! What is known of a table's samples where they are not kept.

/// Stamps this far apart are of two times, ns.
const DAY_NS: i64 = 86_400 * 1_000_000_000;

/// Stamps of a series.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in super::super) struct Steps {
    /// Number of them.
    pub count: usize,
    /// First and last, ns; 0 if there are none.
    pub span: [i64; 2],
    /// Longest step, ns.
    pub longest: i64,
    /// Whether one was not above the one before, or a day above it.
    pub disordered: bool,
}

impl Steps {
    fn note(&mut self, stamp: i64) {
        if self.count == 0 {
            self.span[0] = stamp;
        } else {
            let step = stamp.saturating_sub(self.span[1]);
            self.longest = self.longest.max(step);
            self.disordered |= !(1..DAY_NS).contains(&step);
        }
        self.span[1] = stamp;
        self.count += 1;
    }

    /// First and last, ns.
    pub(in super::super) fn first_and_last(&self) -> Option<[i64; 2]> {
        (self.count > 0).then_some(self.span)
    }
}

/// Samples of a table, as far as the order of their times goes, and which axes of the force have numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in super::super) struct Survey {
    /// Rows with a sample.
    pub rows: Steps,
    /// Depths, poses, forces and markers.
    pub series: [Steps; 4],
    /// Number of forces by their finite components, bit 0 for x.
    pub finite: [u64; 8],
}

impl Survey {
    /// Takes a row into account; `is_some`: which of the series it has a sample of.
    pub(super) fn note(&mut self, stamp: i64, is_some: [bool; 4], force_n: Option<[f64; 3]>) {
        if is_some.contains(&true) {
            self.rows.note(stamp);
        }
        self.series.iter_mut().zip(is_some).filter(|(_, is_some)| *is_some).for_each(|(steps, _)| steps.note(stamp));
        if let Some(force_n) = force_n {
            let bits = (0..3).map(|k| usize::from(force_n[k].is_finite()) << k).sum::<usize>();
            self.finite[bits] += 1;
        }
    }
}
