//! One time base for all topics of a bag: the messages' own stamps, the times of sending, or the times of recording.
//!
//! Stamps of two clocks can't be compared. So if one topic has no stamps, or stamps in whole seconds, the times of
//! all topics are taken from the recorder's clock. If the stamps of two topics have no time in common, the recorder's
//! clock gives the offset between them.

use std::collections::BTreeMap;

use super::order::Ordered;
use ros2_messages::builtin_interfaces::Time;
use rosbag2_mcap::Loss;

/// Largest share of messages with missing or repeated stamps for which the stamps are still used: single faults.
const FEW: f64 = 0.1;
/// A smaller number counts as single faults in any case, unless it is the majority.
const LEAST: usize = 8;
/// Stamps in the first day of a clock, as from simulations: here 0 is a valid time.
const FIRST_DAY_S: i32 = 86_400;
/// Smallest difference of two clocks, ns. Smaller differences come from the delay between stamping and recording.
const LATE_NS: i64 = 1_000_000_000;
const BILLION: u32 = 1_000_000_000;

/// Time of a message by three clocks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Arrival {
    pub stamp: Time,
    pub publish_ns: u64,
    pub log_ns: u64,
}

impl Arrival {
    fn is_stamped(&self) -> bool {
        !self.stamp.is_zero() && self.stamp.nanosec < BILLION
    }

    fn at(&self, base: Base) -> i64 {
        let recorded = |ns: u64| i64::try_from(ns).unwrap_or(i64::MAX);
        match base {
            Base::Stamps => self.stamp.nanos(),
            Base::Published => recorded(self.publish_ns),
            Base::Recorded => recorded(self.log_ns),
        }
    }
}

/// Values of one topic in the order of recording.
pub(super) struct Gathered<V> {
    pub topic: String,
    pub samples: Vec<(Arrival, V)>,
    pub frame: String,
    /// Number of messages without relevant content, by the reason.
    pub nothing: BTreeMap<String, u64>,
}

/// The clock that times are taken from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Base {
    Stamps,
    Published,
    Recorded,
}

/// Statistics of a topic on which the choice of the clock is based.
pub(super) struct Census {
    topic: String,
    all: usize,
    unstamped: usize,
    /// Number of those with more nanoseconds than a second has.
    invalid: usize,
    /// Whether stamps, and times of recording, step back by more than a second and go on from there.
    again: [bool; 2],
    /// Number of messages with the time of the previous one and another value, by each of the three clocks.
    repeats: [usize; 3],
    /// Median of stamp minus time of recording, ns, and its scatter.
    pub ahead: Option<(i64, i64)>,
    /// First and last stamp, ns.
    pub span: Option<(i64, i64)>,
}

const BASES: [Base; 3] = [Base::Stamps, Base::Published, Base::Recorded];

impl Census {
    pub(crate) fn of<V: PartialEq>(of: &Gathered<V>) -> Self {
        let stamped: Vec<&Arrival> = of.samples.iter().map(|(at, _)| at).filter(|at| at.is_stamped()).collect();
        let repeats = BASES.map(|base| {
            let same = |pair: &&[(Arrival, V)]| pair[0].0.at(base) == pair[1].0.at(base) && pair[0].1 != pair[1].1;
            of.samples.windows(2).filter(same).count()
        });
        let mut ahead: Vec<i64> =
            stamped.iter().map(|at| at.stamp.nanos().saturating_sub(at.at(Base::Recorded))).collect();
        ahead.sort_unstable();
        let quantile = |share: usize| ahead.get(ahead.len() * share / 4).copied();
        let stamps = || stamped.iter().map(|at| at.stamp.nanos());
        Self {
            topic: of.topic.clone(),
            all: of.samples.len(),
            unstamped: of.samples.len() - stamped.len(),
            invalid: of.samples.iter().filter(|(at, _)| at.stamp.nanosec >= BILLION).count(),
            again: [Base::Stamps, Base::Recorded].map(|base| {
                let times = || of.samples.iter().filter(|(at, _)| base != Base::Stamps || at.is_stamped());
                Ordered::new(times().map(|(at, _)| (at.at(base), ())).collect()).second > 0
            }),
            repeats,
            ahead: quantile(2).zip(quantile(1).zip(quantile(3)).map(|(a, b)| b.saturating_sub(a))),
            span: stamps().min().zip(stamps().max()),
        }
    }

    /// Whether the number exceeds that of single faults.
    fn many(&self, count: usize) -> bool {
        count as f64 > FEW * self.all as f64 && (count > LEAST || 2 * count > self.all)
    }
}

/// The clock for all topics. A warning states why it is not that of the stamps.
pub(super) fn choose(topics: [&Census; 2], warnings: &mut Vec<String>) -> Base {
    let without = topics.iter().find(|t| t.many(t.unstamped));
    let coarse = topics.iter().find(|t| t.many(t.repeats[0]) && t.repeats[2] < t.repeats[0]);
    let again = topics.iter().find(|t| t.again == [true, false]);
    let Some(one) = without.or(coarse).or(again) else { return Base::Stamps };
    let published = topics.iter().all(|t| !t.many(t.repeats[1]));
    let base = if published { Base::Published } else { Base::Recorded };
    let word = if published { "sent" } else { "recorded" };
    let why = match without {
        Some(t) if t.invalid == t.unstamped => {
            format!("{} of {} messages have a stamp with more than {} ns", t.invalid, t.all, BILLION - 1)
        }
        Some(t) if t.invalid > 0 => {
            let (all, most) = (t.all, BILLION - 1);
            format!("{} of {all} messages have no stamp, or one with more than {most} ns ({})", t.unstamped, t.invalid)
        }
        Some(t) => format!("{} of {} messages have no stamp", t.unstamped, t.all),
        None if coarse.is_none() => {
            "its stamps step back by more than a second, as of a clock that was set or began anew".to_owned()
        }
        None => format!("{} of {} messages have the stamp of the one before", one.repeats[0], one.all),
    };
    warnings.push(format!("{}: {why}; the times at which messages were {word} are used for all topics", one.topic));
    base
}

/// The samples with their times by a clock. Samples without a time are counted as losses.
pub(super) fn timed<V>(of: Gathered<V>, base: Base, losses: &mut Vec<Loss>) -> Vec<(i64, V)> {
    let simulated = base == Base::Stamps
        && of.samples.iter().all(|(at, _)| at.stamp.sec < FIRST_DAY_S)
        && of.samples.iter().any(|(at, _)| at.is_stamped());
    let usable = |at: &Arrival| base != Base::Stamps || at.is_stamped() || (simulated && at.stamp.is_zero());
    let all = of.samples.len();
    let samples: Vec<(i64, V)> =
        of.samples.into_iter().filter(|(at, _)| usable(at)).map(|(at, value)| (at.at(base), value)).collect();
    let count = (all - samples.len()) as u64;
    if count > 0 {
        let reason = format!("they have no stamp, or one with more than {} ns", BILLION - 1);
        losses.push(Loss::Samples { topic: of.topic, count, reason });
    }
    samples
}

/// Lead of the force's clock over the motion's, ns, if their stamps are apart and the recorder's clock determines it.
pub(super) fn ahead(motion: &Census, force: &Census, warnings: &mut Vec<String>) -> i64 {
    let (Some((a, a_scatter)), Some((b, b_scatter))) = (motion.ahead, force.ahead) else { return 0 };
    let (Some((from, to)), Some((start, end))) = (motion.span, force.span) else { return 0 };
    let apart = b.saturating_sub(a);
    let common = to.min(end).saturating_sub(from.max(start));
    let steady = a_scatter.max(b_scatter) < LATE_NS / 2;
    if apart.saturating_abs() <= LATE_NS || !steady {
        return 0;
    }
    let seconds = apart as f64 * 1e-9;
    let word = if apart > 0 { "ahead of" } else { "behind" };
    let what = format!(
        "{}: the force's stamps are {:.3} s {word} the position's, by the times at which both were recorded",
        force.topic,
        seconds.abs()
    );
    // stamps that overlap may be right; the messages may have been delayed
    if 2 * common > (to - from).min(end - start) {
        warnings.push(format!("{what}; if that is a clock's fault, --time-offset-s {seconds:.3} takes it off"));
        return 0;
    }
    warnings.push(format!("{what}: taken off, as --time-offset-s {seconds:.3} does"));
    apart
}
