//! Finds the intervals without data, or without force while the instrument moved. The forces in them are unknown.

use super::recording::{DepthSample, ForceSample, PoseSample};

/// A pause exceeds this many typical intervals, and `LEAST_S`.
const INTERVALS: f64 = 10.0;
const LEAST_S: f64 = 0.25;
/// The instrument has moved if it travelled by more than this share of the total travel.
const MOVED: f64 = 0.02;

/// A sample, where and when.
pub(super) trait Sample {
    /// s.
    fn time_s(&self) -> f64;
    /// m; 0 of a force.
    fn place(&self) -> [f64; 3];
}

impl Sample for DepthSample {
    fn time_s(&self) -> f64 {
        self.time_s
    }

    fn place(&self) -> [f64; 3] {
        [self.depth_m, 0.0, 0.0]
    }
}

impl Sample for PoseSample {
    fn time_s(&self) -> f64 {
        self.time_s
    }

    fn place(&self) -> [f64; 3] {
        self.tip
    }
}

impl Sample for ForceSample {
    fn time_s(&self) -> f64 {
        self.time_s
    }

    fn place(&self) -> [f64; 3] {
        [0.0; 3]
    }
}

/// Pauses of a series, from and to, s.
fn pauses<S: Sample>(series: &[S]) -> Vec<[f64; 2]> {
    let longer = |least: f64| {
        let pairs = series.windows(2).map(|pair| [pair[0].time_s(), pair[1].time_s()]);
        pairs.filter(move |[from, to]| to - from > least)
    };
    // of most series none is so long, and the usual interval need not be known
    if longer(LEAST_S).next().is_none() {
        return Vec::new();
    }
    let mut intervals: Vec<f64> = series.windows(2).map(|pair| pair[1].time_s() - pair[0].time_s()).collect();
    let middle = intervals.len() / 2;
    let median = *intervals.select_nth_unstable_by(middle, f64::total_cmp).1;
    longer((INTERVALS * median).max(LEAST_S)).collect()
}

/// The holes of a recording, in order of time. A sensor that publishes only changes is silent while the instrument
/// rests; that is not a hole.
pub(super) fn holes<M: Sample, F: Sample>(motion: &[M], force: &[F]) -> Vec<[f64; 2]> {
    let moved = |[from, to]: &[f64; 2], least: f64| {
        let (a, b) = (motion.partition_point(|m| m.time_s() < *from), motion.partition_point(|m| m.time_s() <= *to));
        extent(&motion[a..b]) > least
    };
    let least = MOVED * extent(motion);
    let silent = |[from, to]: &[f64; 2]| {
        let next = force.partition_point(|f| f.time_s() <= *from);
        !force.is_empty() && force.get(next).is_none_or(|f| f.time_s() >= *to)
    };
    let (first, last) = (motion.first().map_or(0.0, M::time_s), motion.last().map_or(0.0, M::time_s));
    let of_motion = pauses(motion).into_iter().filter(|pause| silent(pause) || moved(pause, least));
    let within = |[from, to]: &[f64; 2]| *to > first && *from < last;
    let of_force = pauses(force).into_iter().filter(|pause| within(pause) && moved(pause, least));
    let mut all: Vec<[f64; 2]> = of_motion.chain(of_force).collect();
    all.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]));
    all.dedup_by(|next, kept| {
        let same = next[0] <= kept[1];
        kept[1] = if same { kept[1].max(next[1]) } else { kept[1] };
        same
    });
    all
}

/// Largest extent of the positions along an axis, m.
fn extent<M: Sample>(places: &[M]) -> f64 {
    let along = |k: usize| {
        let values = places.iter().map(|p| p.place()[k]);
        values.clone().fold(f64::NEG_INFINITY, f64::max) - values.fold(f64::INFINITY, f64::min)
    };
    (0..3).map(along).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Insertion at 1 mm/s, a rest of 2 s, and retraction, at 100 Hz.
    fn motion() -> Vec<DepthSample> {
        let depth = |t: f64| if t < 4.0 { t } else { 4.0 - (t - 6.0).max(0.0) };
        (0..1000).map(|i| f64::from(i) * 0.01).map(|t| DepthSample { time_s: t, depth_m: 1e-3 * depth(t) }).collect()
    }

    fn without(of: &[DepthSample], from: f64, to: f64) -> Vec<DepthSample> {
        of.iter().copied().filter(|s| !(from..to).contains(&s.time_s)).collect()
    }

    #[test]
    fn holes_are_told_from_rests() {
        let all = motion();
        let forces = |of: &[DepthSample]| -> Vec<ForceSample> {
            of.iter().map(|s| ForceSample { time_s: s.time_s, force_n: [0.0; 3] }).collect()
        };
        assert_eq!(holes(&all, &forces(&all)), Vec::<[f64; 2]>::new());
        let hole = without(&all, 2.0, 7.0);
        let found = holes(&hole, &forces(&hole));
        assert!(found.len() == 1 && (found[0][1] - found[0][0] - 5.01).abs() < 1e-9, "{found:?}");
        let resting = without(&all, 4.1, 5.9);
        assert!(holes(&resting, &forces(&all)).is_empty(), "the position says nothing new while the force goes on");
        assert_eq!(holes(&resting, &forces(&resting)).len(), 1, "the recorder was off");
        assert_eq!(holes(&all, &forces(&hole)).len(), 1, "no force while it moved");
        assert!(holes(&all, &forces(&resting)).is_empty(), "no force while it rested");
        assert!(holes::<DepthSample, ForceSample>(&[], &[]).is_empty());
    }
}
