//! Finds the intervals without data, or without force while the instrument moved. The forces in them are unknown.

/// A pause exceeds this many typical intervals, and `LEAST_S`.
const INTERVALS: f64 = 10.0;
const LEAST_S: f64 = 0.25;
/// The instrument has moved if it travelled by more than this share of the total travel.
const MOVED: f64 = 0.02;

/// Position of an instrument: time in s, and a position in m.
pub(super) type Place = (f64, [f64; 3]);

/// Pauses of a series, from and to, s.
fn pauses(times: &[f64]) -> Vec<[f64; 2]> {
    let mut intervals: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    intervals.sort_unstable_by(f64::total_cmp);
    let Some(median) = intervals.get(intervals.len() / 2) else { return Vec::new() };
    let longest = (INTERVALS * median).max(LEAST_S);
    times.windows(2).filter(|pair| pair[1] - pair[0] > longest).map(|pair| [pair[0], pair[1]]).collect()
}

/// The holes of a recording, in order of time. A sensor that publishes only changes is silent while the instrument
/// rests; that is not a hole.
pub(super) fn holes(motion: &[Place], force_s: &[f64]) -> Vec<[f64; 2]> {
    let moved = |[from, to]: &[f64; 2], least: f64| {
        let (a, b) = (motion.partition_point(|m| m.0 < *from), motion.partition_point(|m| m.0 <= *to));
        extent(&motion[a..b]) > least
    };
    let least = MOVED * extent(motion);
    let silent = |[from, to]: &[f64; 2]| {
        let next = force_s.partition_point(|t| *t <= *from);
        !force_s.is_empty() && force_s.get(next).is_none_or(|t| *t >= *to)
    };
    let times: Vec<f64> = motion.iter().map(|m| m.0).collect();
    let (first, last) = (times.first().copied().unwrap_or(0.0), times.last().copied().unwrap_or(0.0));
    let of_motion = pauses(&times).into_iter().filter(|pause| silent(pause) || moved(pause, least));
    let within = |[from, to]: &[f64; 2]| *to > first && *from < last;
    let of_force = pauses(force_s).into_iter().filter(|pause| within(pause) && moved(pause, least));
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
fn extent(places: &[Place]) -> f64 {
    let along = |k: usize| {
        let values = places.iter().map(|p| p.1[k]);
        values.clone().fold(f64::NEG_INFINITY, f64::max) - values.fold(f64::INFINITY, f64::min)
    };
    (0..3).map(along).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Insertion at 1 mm/s, a rest of 2 s, and retraction, at 100 Hz.
    fn motion() -> Vec<Place> {
        let depth = |t: f64| if t < 4.0 { t } else { 4.0 - (t - 6.0).max(0.0) };
        (0..1000).map(|i| f64::from(i) * 0.01).map(|t| (t, [1e-3 * depth(t), 0.0, 0.0])).collect()
    }

    fn without(of: &[Place], from: f64, to: f64) -> Vec<Place> {
        of.iter().copied().filter(|(t, _)| !(from..to).contains(t)).collect()
    }

    #[test]
    fn holes_are_told_from_rests() {
        let all = motion();
        let times = |of: &[Place]| of.iter().map(|m| m.0).collect::<Vec<f64>>();
        assert_eq!(holes(&all, &times(&all)), Vec::<[f64; 2]>::new());
        let hole = without(&all, 2.0, 7.0);
        let found = holes(&hole, &times(&hole));
        assert!(found.len() == 1 && (found[0][1] - found[0][0] - 5.01).abs() < 1e-9, "{found:?}");
        let resting = without(&all, 4.1, 5.9);
        assert!(holes(&resting, &times(&all)).is_empty(), "the position says nothing new while the force goes on");
        assert_eq!(holes(&resting, &times(&resting)).len(), 1, "the recorder was off");
        assert_eq!(holes(&all, &times(&hole)).len(), 1, "no force while it moved");
        assert!(holes(&all, &times(&resting)).is_empty(), "no force while it rested");
        assert!(holes(&[], &[]).is_empty());
    }
}
