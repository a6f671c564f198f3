//! Finds the intervals without data, or without force while the instrument moved. The forces in them are unknown.

use super::middle::Middle;
use super::sample::Sample;

/// A pause exceeds this many typical intervals, and `LEAST_S`.
const INTERVALS: f64 = 10.0;
const LEAST_S: f64 = 0.25;
/// The instrument has moved if it travelled by more than this share of the total travel.
const MOVED: f64 = 0.02;

/// A pause that may be a hole.
struct Pause {
    from_to_s: [f64; 2],
    /// How far the instrument went in it along an axis, m.
    travel_m: f64,
    /// Whether the force had no reading within it.
    silent: bool,
}

/// Times of a series, and its pauses.
#[derive(Default)]
struct Times {
    first_s: Option<f64>,
    last_s: Option<f64>,
    intervals: Middle,
    pauses: Vec<Pause>,
}

impl Times {
    /// The next time; `travel_m` and `silent` as in [`Pause`], since the last one.
    fn note(&mut self, time_s: f64, travel_m: f64, silent: bool) {
        self.first_s.get_or_insert(time_s);
        if let Some(last_s) = self.last_s.replace(time_s) {
            self.intervals.note(time_s - last_s);
            if time_s - last_s > LEAST_S {
                self.pauses.push(Pause { from_to_s: [last_s, time_s], travel_m, silent });
            }
        }
    }

    /// The pauses that are long beside the usual interval.
    fn found(self) -> impl Iterator<Item = Pause> {
        let least_s = INTERVALS * self.intervals.value().unwrap_or_default();
        self.pauses.into_iter().filter(move |Pause { from_to_s: [from, to], .. }| to - from > least_s)
    }
}

/// Least and largest coordinates of places.
#[derive(Clone, Copy)]
struct Extent([[f64; 2]; 3]);

impl Extent {
    const NONE: Self = Self([[f64::INFINITY, f64::NEG_INFINITY]; 3]);

    fn take(&mut self, place: [f64; 3]) {
        self.0.iter_mut().zip(place).for_each(|(range, x)| *range = [range[0].min(x), range[1].max(x)]);
    }

    /// Along the axis on which it is largest, m.
    fn size(&self) -> f64 {
        self.0.iter().map(|[low, high]| high - low).fold(0.0, f64::max)
    }
}

/// Looks for holes while the samples of a recording go by in order of time. A sensor that publishes only changes is silent while the
/// instrument rests; that is not a hole.
pub(super) struct Holes {
    by_pose: bool,
    motion: Times,
    force: Times,
    place: [f64; 3],
    /// All places, and those from the last force on.
    all: Extent,
    since: Extent,
}

impl Holes {
    /// `by_pose`: whether the motion is that of the poses.
    pub(super) fn new(by_pose: bool) -> Self {
        let (motion, force) = (Times::default(), Times::default());
        Self { by_pose, motion, force, place: [0.0; 3], all: Extent::NONE, since: Extent::NONE }
    }

    pub(super) fn note(&mut self, sample: &Sample) {
        match sample {
            Sample::Depth(s) if !self.by_pose => self.moved(s.time_s, [s.depth_m, 0.0, 0.0]),
            Sample::Pose(s) if self.by_pose => self.moved(s.time_s, s.tip),
            Sample::Force(s) => {
                self.force.note(s.time_s, self.since.size(), true);
                self.since = Extent::NONE;
                if self.motion.last_s == Some(s.time_s) {
                    self.since.take(self.place);
                }
            }
            _ => {}
        }
    }

    fn moved(&mut self, time_s: f64, place: [f64; 3]) {
        let travel_m = (0..3).map(|k| (place[k] - self.place[k]).abs()).fold(0.0, f64::max);
        self.motion.note(time_s, travel_m, self.force.last_s <= self.motion.last_s);
        self.place = place;
        self.all.take(place);
        self.since.take(place);
    }

    /// The holes, in order of time, s.
    pub(super) fn found(self) -> Vec<[f64; 2]> {
        let least_m = MOVED * self.all.size();
        let [first_s, last_s] = [self.motion.first_s, self.motion.last_s].map(Option::unwrap_or_default);
        let has_force = self.force.last_s.is_some();
        let of_motion = self.motion.found().filter(|pause| pause.silent && has_force || pause.travel_m > least_m);
        let within = |[from, to]: [f64; 2]| to > first_s && from < last_s;
        let of_force = self.force.found().filter(|pause| within(pause.from_to_s) && pause.travel_m > least_m);
        let mut all: Vec<[f64; 2]> = of_motion.chain(of_force).map(|pause| pause.from_to_s).collect();
        all.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]));
        all.dedup_by(|next, kept| {
            let same = next[0] <= kept[1];
            kept[1] = if same { kept[1].max(next[1]) } else { kept[1] };
            same
        });
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::{DepthSample, ForceSample};

    /// Holes of a motion and the forces.
    fn holes(motion: &[DepthSample], forces: &[ForceSample]) -> Vec<[f64; 2]> {
        let mut holes = Holes::new(false);
        let mut forces = forces.iter().copied().peekable();
        for depth in motion {
            while let Some(force) = forces.next_if(|force| force.time_s < depth.time_s) {
                holes.note(&Sample::Force(force));
            }
            holes.note(&Sample::Depth(*depth));
        }
        forces.for_each(|force| holes.note(&Sample::Force(force)));
        holes.found()
    }

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
        assert!(holes(&[], &[]).is_empty());
    }
}
