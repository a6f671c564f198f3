//! Samples in the order of their stamps: small disorder sorted, stray stamps and a second recording left out.

/// Largest step in time that is taken for disorder and sorted, ns. A larger one back is a second recording, or the end of stamps
/// that had gone astray.
const DISORDER_NS: i64 = 1_000_000_000;
/// No recording pauses for so long, ns: what is so far from most of the stamps has gone astray.
const DAY_NS: i64 = 86_400 * 1_000_000_000;

/// As many times more samples follow a few that have gone astray at the start.
const FEW: usize = 10;

/// Samples with their stamps in ns.
type Samples<V> = Vec<(i64, V)>;

/// Samples in order, and what became of the others.
#[derive(Debug, PartialEq)]
pub(super) struct Ordered<V> {
    /// In order, no stamp twice.
    pub samples: Samples<V>,
    /// Samples that were left out since their stamps are of another time.
    pub strays: usize,
    /// Samples of a second recording, which were left out.
    pub second: usize,
    /// Whether the order was not that of the stamps.
    pub sorted: bool,
    /// Samples that repeated a stamp.
    pub repeated: usize,
}

impl<V> Ordered<V> {
    /// Orders samples that come as they were recorded.
    pub fn new(samples: Samples<V>) -> Self {
        let all = samples.len();
        let (mut samples, second) = without_detours(of_one_time(samples));
        let strays = all - samples.len() - second;
        let sorted = !samples.is_sorted_by_key(|(time, _)| *time);
        samples.sort_by_key(|(time, _)| *time);
        let before = samples.len();
        samples.dedup_by_key(|(time, _)| *time);
        Self { strays, second, sorted, repeated: before - samples.len(), samples }
    }
}

/// The largest group of samples with no pause of a day in it.
fn of_one_time<V>(mut samples: Samples<V>) -> Samples<V> {
    let mut times: Vec<i64> = samples.iter().map(|(time, _)| *time).collect();
    times.sort_unstable();
    let groups = times.chunk_by(|a, b| b.saturating_sub(*a) < DAY_NS);
    // of groups of one size the first
    let largest = groups.max_by_key(|group| (group.len(), std::cmp::Reverse(group.first().copied())));
    if let Some(([first, ..], last)) = largest.map(|group| (group, group.last())) {
        let (first, last) = (*first, last.copied().unwrap_or(*first));
        samples.retain(|(time, _)| (first..=last).contains(time));
    }
    samples
}

/// Leaves out stamps that leap ahead and come back to where they were. At any other large step back a second recording begins:
/// what follows is cut off and counted.
fn without_detours<V>(samples: Samples<V>) -> (Samples<V>, usize) {
    let all = samples.len();
    let mut kept: Samples<V> = Vec::with_capacity(all);
    // the latest stamp, and what it was before the last leap ahead, with the number of samples up to there
    let (mut latest, mut leap): (Option<i64>, Option<(i64, usize)>) = (None, None);
    for (at, sample) in samples.into_iter().enumerate() {
        let (time, last) = (sample.0, latest.unwrap_or(sample.0));
        if last.saturating_sub(time) > DISORDER_NS {
            let detour = match leap {
                // the fewer have gone astray
                Some((before, count)) => (before.saturating_sub(time) <= DISORDER_NS && kept.len() - count <= all - at)
                    .then_some((Some(before), count)),
                // without a leap only a few at the start have: else it is the first of two recordings
                None => (kept.len() * FEW <= all - at).then_some((None, 0)),
            };
            let Some((before, count)) = detour else { return (kept, all - at) };
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

    /// Tenths of a second.
    #[test]
    fn only_the_stamps_that_have_gone_astray_are_left_out() {
        assert_eq!(order(&[0, 1, 2, 4, 3, 5]), (vec![0, 1, 2, 3, 4, 5], 0, 0));
        for far in [36_000, 10_000_000_000] {
            assert_eq!(order(&[0, 1, far, 2, 3, 4]), (vec![0, 1, 2, 3, 4], 1, 0), "{far}");
            assert_eq!(order(&[0, 1, far, far + 1, 2, far + 3, 3, 4]), (vec![0, 1, 2, 3, 4], 3, 0), "{far}");
            let rest: Vec<i64> = (0..20).collect();
            assert_eq!(order(&[&[far][..], &rest].concat()), (rest, 1, 0), "{far}");
        }
        assert_eq!(order(&[0, 1, 2, 10_000_000_000]), (vec![0, 1, 2], 1, 0));
        assert_eq!(order(&[-10_000_000_000, 0, 1, 2]), (vec![0, 1, 2], 1, 0));
    }

    /// Time of this thread on a processor, ns: other programs have no part in it.
    #[cfg(target_os = "linux")]
    fn spent() -> f64 {
        let stat = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap();
        stat.split(' ').next().unwrap().parse().unwrap()
    }

    /// Every second stamp an hour ahead: eight times as many samples take eight times as long, and not 64 times.
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
        // the system counts in steps of some milliseconds
        assert!(many < 24.0 * (few + 1e7), "{many} ns for eight times what took {few} ns");
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
