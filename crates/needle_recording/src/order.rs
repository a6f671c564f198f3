//! Sorts samples by their stamps. Small disorder is corrected; outlying stamps and a second recording are left out.

use super::middle::Middle;

/// Largest step in time that counts as disorder and is sorted, ns. A larger step back starts a second recording, or
/// ends a sequence of outlying stamps.
pub(super) const DISORDER_NS: i64 = 1_000_000_000;
/// Stamps this far from most others, ns, are outliers: no recording pauses for so long.
pub(super) const DAY_NS: i64 = 86_400 * 1_000_000_000;

/// Stamps at the start are outliers if this many times more samples follow.
const FEW: usize = 10;

/// Samples with their stamps in ns.
type Samples<V> = Vec<(i64, V)>;

/// Sorted samples, and the numbers of changed and lost ones.
#[derive(Debug, PartialEq)]
pub(super) struct Ordered<V> {
    /// Sorted; every stamp is unique.
    pub samples: Samples<V>,
    /// Number of samples with the stamp of another and another value. They are distributed over the time to the next
    /// stamp.
    pub spread: usize,
    /// Number of samples that could not be distributed because there is only one stamp.
    pub one_time: usize,
    /// Number of samples that were left out because their stamps are outliers.
    pub strays: usize,
    /// Number of samples of a second recording, which were left out.
    pub second: usize,
    /// Whether the samples were not in the order of their stamps.
    pub sorted: bool,
    /// Number of samples that repeated another one, stamp and value.
    pub repeated: usize,
}

impl<V> Ordered<V> {
    /// Samples of which nothing was changed.
    pub(super) const fn untouched(samples: Samples<V>) -> Self {
        Self { samples, spread: 0, one_time: 0, strays: 0, second: 0, sorted: false, repeated: 0 }
    }
}

impl<V: PartialEq> Ordered<V> {
    /// Sorts samples given in the order of recording.
    pub(crate) fn new(mut samples: Samples<V>) -> Self {
        let follows = |pair: &[(i64, V)]| pair[0].0 < pair[1].0 && pair[1].0.saturating_sub(pair[0].0) < DAY_NS;
        // nothing is to be done of most recordings, and no copy of them to be made
        if samples.windows(2).all(follows) {
            return Self::untouched(samples);
        }
        // the newest first, as some databases write them
        if samples.len() > 2 && samples.windows(2).all(|pair| pair[0].0 > pair[1].0) {
            samples.reverse();
            return Self { sorted: true, ..Self::new(samples) };
        }
        let all = samples.len();
        let (mut samples, second) = without_detours(of_one_time(samples));
        let strays = all - samples.len() - second;
        let sorted = !samples.is_sorted_by_key(|(time, _)| *time);
        samples.sort_by_key(|(time, _)| *time);
        let before = samples.len();
        let coarse = samples.windows(2).any(|pair| pair[0].0 == pair[1].0 && pair[0].1 != pair[1].1);
        let (mut spread, mut one_time) = (0, 0);
        if coarse {
            spread = spread_out(&mut samples);
            samples.dedup_by_key(|(time, _)| *time);
            one_time = before - samples.len();
        } else {
            samples.dedup_by_key(|(time, _)| *time);
        }
        Self { strays, second, sorted, repeated: before - samples.len() - one_time, spread, one_time, samples }
    }
}

/// How samples with the same stamp are distributed evenly up to the next stamp. The first and the last group of a recording may be
/// incomplete: they get the spacing of the other groups.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Spread {
    /// Usual time between stamps, ns.
    step: i64,
    /// Usual number of samples of one stamp.
    usual: i64,
}

impl Spread {
    /// `None` if all samples have one stamp.
    pub(super) fn of(steps: &Middle, sizes: &Middle) -> Option<Self> {
        Some(Self { step: steps.value()? as i64, usual: sizes.value()? as i64 })
    }

    /// Time of the first of some samples with one stamp, and from each to the next, ns; `next`: the next stamp.
    pub(super) fn times(&self, stamp: i64, count: usize, next: Option<i64>, is_first: bool) -> (i64, i64) {
        let (count, to_next) = (count as i64, next.map_or(self.step, |next| next - stamp));
        if count < 2 {
            return (stamp, 0);
        }
        let span = to_next.min(self.step);
        let at_end = is_first || next.is_none();
        let every = span / if at_end { self.usual.max(count) } else { count };
        let late = if is_first && to_next == self.step { span - every * count } else { 0 };
        (stamp + late, every)
    }
}

/// Spreads samples with the same stamp, and returns their number.
fn spread_out<V>(samples: &mut Samples<V>) -> usize {
    let groups: Vec<(i64, usize)> =
        samples.chunk_by(|a, b| a.0 == b.0).map(|group| (group[0].0, group.len())).collect();
    let (mut steps, mut sizes) = (Middle::default(), Middle::default());
    groups.windows(2).for_each(|pair| steps.note((pair[1].0 - pair[0].0) as f64));
    groups.iter().for_each(|(_, size)| sizes.note(*size as f64));
    let Some(spread) = Spread::of(&steps, &sizes) else { return 0 };
    let mut at = 0;
    for (number, &(stamp, count)) in groups.iter().enumerate() {
        let next = groups.get(number + 1).map(|next| next.0);
        let (from, every) = spread.times(stamp, count, next, number == 0);
        samples[at..at + count].iter_mut().zip(0..).for_each(|(sample, k)| sample.0 = from + every * k);
        at += count;
    }
    samples.len() - groups.len()
}

/// The largest group of samples without a pause of a day.
fn of_one_time<V>(mut samples: Samples<V>) -> Samples<V> {
    let mut times: Vec<i64> = samples.iter().map(|(time, _)| *time).collect();
    times.sort_unstable();
    let groups = times.chunk_by(|a, b| b.saturating_sub(*a) < DAY_NS);
    // of groups with equal size, the first
    let largest = groups.max_by_key(|group| (group.len(), std::cmp::Reverse(group.first().copied())));
    if let Some(([first, ..], last)) = largest.map(|group| (group, group.last())) {
        let (first, last) = (*first, last.copied().unwrap_or(*first));
        samples.retain(|(time, _)| (first..=last).contains(time));
    }
    samples
}

/// Removes stamps that jump ahead and later return to the previous time, and a few that jump back while the others go on. Any other large step back starts a second
/// recording: the samples from there on are cut off and counted.
fn without_detours<V>(samples: Samples<V>) -> (Samples<V>, usize) {
    let all = samples.len();
    let mut kept: Samples<V> = Vec::with_capacity(all);
    // the latest stamp; the stamp before the last jump ahead, and the number of samples up to there
    let (mut latest, mut leap): (Option<i64>, Option<(i64, usize)>) = (None, None);
    let times: Vec<i64> = samples.iter().map(|(time, _)| *time).collect();
    // up to here samples are left out
    let mut skipped_to = 0;
    for (at, sample) in samples.into_iter().enumerate() {
        if at < skipped_to {
            continue;
        }
        let (time, last) = (sample.0, latest.unwrap_or(sample.0));
        if last.saturating_sub(time) > DISORDER_NS {
            let detour = match leap {
                // the smaller part is outlying
                Some((before, count)) => (before.saturating_sub(time) <= DISORDER_NS && kept.len() - count <= all - at)
                    .then_some((Some(before), count)),
                // without a jump ahead, only a few samples at the start can be outlying; otherwise these are two
                // recordings
                None => (kept.len() * FEW <= all - at).then_some((None, 0)),
            };
            let Some((before, count)) = detour else {
                let few = &times[at..all.min(at + kept.len() / FEW + 1)];
                match few.iter().position(|time| last.saturating_sub(*time) <= DISORDER_NS) {
                    // they return by a jump; a clock that was set back goes on from there
                    Some(number) if few[number].saturating_sub(few[number.saturating_sub(1)]) > DISORDER_NS / 2 => {
                        skipped_to = at + number;
                        continue;
                    }
                    _ => return (kept, all - at),
                }
            };
            kept.truncate(count);
            (latest, leap) = (before, None);
        }
        let last = latest.unwrap_or(time);
        if time.saturating_sub(last) > DISORDER_NS {
            leap = Some((last, kept.len()));
        }
        latest = Some(last.max(time));
        kept.push(sample);
    }
    (kept, 0)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    const S: i64 = 1_000_000_000;

    fn order(seconds: &[i64]) -> (Vec<i64>, usize, usize) {
        let ordered = Ordered::new(seconds.iter().map(|s| (s * S / 10, ())).collect());
        (ordered.samples.iter().map(|(time, _)| time * 10 / S).collect(), ordered.strays, ordered.second)
    }

    /// Times are in tenths of a second.
    #[test]
    fn only_the_stamps_that_have_gone_astray_are_left_out() {
        assert_eq!(order(&[0, 1, 2, 4, 3, 5]), (vec![0, 1, 2, 3, 4, 5], 0, 0));
        let (up, down): (Vec<i64>, Vec<i64>) = ((0..60).collect(), (0..60).rev().collect());
        assert_eq!(order(&down), (up, 0, 0), "the newest first");
        for far in [36_000, 10_000_000_000] {
            assert_eq!(order(&[0, 1, far, 2, 3, 4]), (vec![0, 1, 2, 3, 4], 1, 0), "{far}");
            assert_eq!(order(&[0, 1, far, far + 1, 2, far + 3, 3, 4]), (vec![0, 1, 2, 3, 4], 3, 0), "{far}");
            let rest: Vec<i64> = (0..20).collect();
            assert_eq!(order(&[&[far][..], &rest].concat()), (rest, 1, 0), "{far}");
        }
        // one of a clock that was not set yet, while the others go on
        let (early, late): (Vec<i64>, Vec<i64>) = ((0..40).collect(), (40..60).collect());
        assert_eq!(order(&[&early[..], &[0], &late].concat()), ((0..60).collect(), 1, 0));
        assert_eq!(order(&[0, 1, 2, 10_000_000_000]), (vec![0, 1, 2], 1, 0));
        assert_eq!(order(&[-10_000_000_000, 0, 1, 2]), (vec![0, 1, 2], 1, 0));
    }

    /// Processor time of this thread, ns; it does not depend on other programs.
    #[cfg(target_os = "linux")]
    fn spent() -> f64 {
        let stat = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap();
        stat.split(' ').next().unwrap().parse().unwrap()
    }

    /// Every second stamp is an hour ahead. Eight times as many samples must take about eight times as long, not 64
    /// times.
    #[cfg(target_os = "linux")]
    #[test]
    fn time_grows_with_the_number_of_stray_stamps() {
        let spent = |pairs: i64| {
            let samples: Vec<(i64, ())> =
                (0..pairs).flat_map(|i| [(i * S / 1000, ()), (i * S / 1000 + 3600 * S, ())]).collect();
            let begun = spent();
            let ordered = Ordered::new(samples);
            assert_eq!((ordered.samples.len() as i64, ordered.strays as i64), (pairs + 1, pairs - 1));
            spent() - begun
        };
        let few = spent(40_000);
        let many = spent(320_000);
        // the system's clock has a resolution of some milliseconds
        assert!(many < 24.0 * (few + 1e7), "{many} ns for eight times what took {few} ns");
    }

    #[test]
    fn readings_of_one_stamp_are_spread_up_to_the_next() {
        // a reading each quarter of a second from 0.5 s on, stamped in whole seconds
        let stamped: Vec<(i64, i64)> = (2..15).map(|i| (i / 4 * S, i)).collect();
        let ordered = Ordered::new(stamped);
        assert_eq!((ordered.samples.len(), ordered.spread, ordered.repeated), (13, 9, 0));
        for (time, i) in &ordered.samples {
            assert_eq!(*time, i * S / 4, "{i}");
        }
        let twice = Ordered::new(vec![(0, 1), (0, 1), (S, 2)]);
        assert_eq!((twice.samples.len(), twice.spread, twice.repeated), (2, 0, 1), "the same message twice is one");
        let one = Ordered::new(vec![(S, 1), (S, 2), (S, 3)]);
        assert_eq!((one.samples.len(), one.one_time), (1, 2));
    }

    #[test]
    fn a_pause_is_none_and_a_second_recording_is_cut_off() {
        assert_eq!(order(&[0, 1, 2, 100, 101, 102]), (vec![0, 1, 2, 100, 101, 102], 0, 0));
        let first: Vec<i64> = (0..50).collect();
        let both: Vec<i64> = first.iter().chain(&first).copied().collect();
        assert_eq!(order(&both), (first.clone(), 0, 50));
        assert_eq!(order(&[&both[..], &[500, 501, 0, 1]].concat()).0, first);
        assert_eq!(order(&[]), (vec![], 0, 0));
    }
}
