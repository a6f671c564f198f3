//! Counters and figures shared by the node's threads. The solver thread never takes this lock.

use std::collections::{BTreeMap, VecDeque};
use std::sync::atomic::{AtomicU8, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, RwLock};
use std::time::{Duration, Instant};

use hdrhistogram::Histogram;

use super::answer::{Answer, Progress};
use super::declared::Settings;
use super::inbox::Handoff;
use super::warnings::Samples;
use needle_core::twin::{Along, Event};
use needle_estimate::compare::Verdict;
use needle_estimate::live_spring::SoFar;
use needle_recording::Refusal;
use ros2_messages::needle_twin::ForceComparison;
use ros2_node::clock::NodeClock;
use ros2_node::lifecycle::State;

/// Why a pose was rejected.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Reject {
    NotFinite,
    NoSuchJoint,
    WrongFrame,
    OutOfOrder,
    TooOld,
    Future,
    SecondSource,
    ByTwin,
    Diverged,
}

impl From<&Refusal> for Reject {
    fn from(refusal: &Refusal) -> Self {
        match refusal {
            Refusal::NoSuchJoint { .. } | Refusal::NoPosition { .. } => Self::NoSuchJoint,
            Refusal::WrongFrame { .. } | Refusal::OtherTool { .. } | Refusal::SeveralTools(..) => Self::WrongFrame,
            _ => Self::NotFinite,
        }
    }
}

impl Reject {
    pub(crate) const fn word(self) -> &'static str {
        match self {
            Self::NotFinite => "not finite",
            Self::NoSuchJoint => "no such joint",
            Self::WrongFrame => "wrong frame",
            Self::OutOfOrder => "out of order or repeated",
            Self::TooOld => "too old",
            Self::Future => "from the future",
            Self::SecondSource => "second source",
            Self::ByTwin => "refused by the twin",
            Self::Diverged => "the twin has diverged",
        }
    }
}

/// Why the data of a topic are used but prove nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Doubt {
    /// Two nodes publish it.
    Two(&'static str),
    /// Its messages have no stamps.
    Unstamped(&'static str),
    /// Its sensor is noisy, but its reading has stopped changing.
    Frozen(&'static str),
}

impl Doubt {
    pub(crate) const fn topic(self) -> &'static str {
        match self {
            Self::Two(topic) | Self::Unstamped(topic) | Self::Frozen(topic) => topic,
        }
    }
}

/// Latencies in ns with two significant digits.
#[derive(Clone, Debug)]
pub(super) struct Latency(Histogram<u64>);

impl Default for Latency {
    fn default() -> Self {
        // 1 us to 1000 s: bounds that the library accepts.
        #[allow(clippy::expect_used)]
        Self(Histogram::new_with_bounds(1_000, 1_000_000_000_000, 2).expect("constant bounds"))
    }
}

impl Latency {
    pub(crate) fn record(&mut self, elapsed: Duration) {
        self.0.saturating_record(u64::try_from(elapsed.as_nanos()).unwrap_or(u64::MAX));
    }

    /// Quantile in s; 0 if nothing was recorded.
    #[allow(clippy::cast_precision_loss)]
    pub(crate) fn quantile(&self, q: f64) -> f64 {
        if self.0.is_empty() { 0.0 } else { self.0.value_at_quantile(q) as f64 * 1e-9 }
    }

    #[allow(clippy::cast_precision_loss)]
    pub(crate) fn max(&self) -> f64 {
        if self.0.is_empty() { 0.0 } else { self.0.max() as f64 * 1e-9 }
    }
}

/// Sums over about one second.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Window {
    pub seconds: f64,
    pub received: u64,
    pub answered: u64,
    pub coalesced: u64,
    pub rejected: u64,
    pub withheld: u64,
    pub steps: u64,
    pub stepping_s: f64,
    pub input_s: f64,
}

/// The last valid comparison with the load cell.
#[derive(Clone, Copy, Debug)]
#[cfg_attr(not(feature = "page"), allow(dead_code))] // the page shows them
pub(super) struct Compared {
    pub stamp_nanos: i64,
    pub depth_m: f64,
    pub predicted_n: f64,
    pub measured_n: f64,
}

impl Compared {
    pub(crate) fn of(message: &ForceComparison) -> Self {
        let ForceComparison { depth_m, predicted_n, measured_n, .. } = *message;
        Self { stamp_nanos: message.header.stamp.nanos(), depth_m, predicted_n, measured_n }
    }
}

/// The members' band at a pose.
#[derive(Clone, Copy, Debug)]
#[cfg_attr(not(feature = "page"), allow(dead_code))] // the page shows them
pub(super) struct Banded {
    pub stamp_nanos: i64,
    pub low_n: f64,
    pub high_n: f64,
}

/// An event for viewers of the page.
#[derive(Clone, Debug)]
#[cfg_attr(not(feature = "page"), allow(dead_code))] // the page shows them
pub(super) struct Noted {
    pub stamp_nanos: i64,
    pub depth_m: f64,
    /// `puncture`, `layer`, `slip` or `mark`.
    pub kind: &'static str,
    /// The region that the tip entered, or the text of a viewer.
    pub text: String,
}

/// Number of stored events; the oldest are dropped first.
const NOTED: usize = 32;

/// See the module. Counts are since the last reset.
#[derive(Debug, Default)]
pub(super) struct Live {
    pub received: u64,
    pub answered: u64,
    pub rejected: u64,
    pub rejects: BTreeMap<Reject, u64>,
    pub coalesced: u64,
    pub missed: u64,
    /// `received`, `coalesced` and `missed` when the pending reset was requested.
    pub before_reset: Option<[u64; 3]>,
    pub withheld: u64,
    pub not_finite: u64,
    pub steps: u64,
    /// Wall time of stepping, s.
    pub stepping_s: f64,
    pub last: Option<Answer>,
    /// Whether an answer has been published.
    pub spoken: bool,
    /// Progress of the twin's motion in parts to a distant pose.
    pub under_way: Option<Progress>,
    pub puncture_depth_m: Option<f64>,
    /// Regions along the path of the tip.
    pub along: Arc<Along>,
    pub halted: Option<String>,
    /// Time for which the solver has not returned, s.
    pub stuck_s: Option<f64>,
    /// Why the node is about to end on its own.
    pub dying: Option<String>,
    /// Other twins on the same names.
    pub rivals: Vec<String>,
    /// Depth of the instrument at the first pose, m.
    pub first_seen_m: Option<f64>,
    pub gaps: Gaps,
    pub refused: Option<String>,
    pub last_pose: Option<LastPose>,
    /// Time at which simulated time last advanced.
    pub last_clock: Option<Instant>,
    /// When the housekeeping thread last looked for other twins, silent inputs and old figures.
    pub watched: Option<Instant>,
    /// Lead of the stamps of the newest pose and reading over the node's clock at reception, s.
    pub ahead_s: [Option<f64>; 2],
    /// Why a measurement is not evidence, and when that was last detected.
    pub doubts: BTreeMap<Doubt, (String, Instant)>,
    /// Largest derivative of the force by the depth along the scene's own motion, N/m; 0 until it is known.
    pub steepest_n_per_m: f64,
    pub input_age: Latency,
    pub queue: Latency,
    pub stepping: Latency,
    pub total: Latency,
    pub load_cell: Option<u8>,
    pub residual: Option<(f64, f64, f64)>,
    pub against_spring: Option<SoFar>,
    pub measured: u64,
    pub compared: Option<Compared>,
    /// The latest band of the members.
    pub band: Option<Banded>,
    /// The latest [`NOTED`] events.
    pub events: VecDeque<Noted>,
    /// Stamp of the first answer.
    pub first_stamp_nanos: Option<i64>,
    pub identified: Option<Identified>,
    /// Recent comparisons, and the problems found in them.
    pub samples: Samples,
    pub warnings: Vec<String>,
    pub verdict: Verdict,
    pub window: Window,
    pub last_window: Window,
    window_begun: Option<Instant>,
    last_stamp_nanos: Option<i64>,
}

/// Intervals without a pose, longer than `input_timeout_s` each.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Gaps {
    pub count: u64,
    pub longest_s: f64,
    /// Total displacement of the instrument that was not observed, m.
    pub unseen_m: f64,
}

/// Result of the identification, for display.
#[derive(Clone, Debug)]
pub(super) struct Identified {
    /// One of the `IDENTIFICATION_` constants.
    pub state: u8,
    /// Why it is frozen.
    pub reason: String,
    /// Name, value and standard error of each parameter.
    pub values: Vec<(String, f64, f64)>,
}

/// Time of the last pose: wall time, and node time in ns.
#[derive(Clone, Copy, Debug)]
pub(super) struct LastPose {
    pub wall: Instant,
    pub node_nanos: Option<i64>,
}

impl Live {
    /// Time without a pose, s, on the node's clock: while simulated time stands still, nothing is late. Without a
    /// publisher of that time (`clock_gone`) the wall clock is used.
    #[allow(clippy::cast_precision_loss)] // a duration for display
    pub(crate) fn silence_s(&self, clock: &NodeClock, clock_gone: bool) -> Option<f64> {
        let last = self.last_pose?;
        let simulated = last.node_nanos.zip(clock.now_nanos()).filter(|_| clock.is_simulated() && !clock_gone);
        Some(match simulated {
            Some((then, now)) => (now - then).max(0) as f64 * 1e-9,
            None => last.wall.elapsed().as_secs_f64(),
        })
    }

    pub(crate) fn pose(&mut self, handoff: Handoff, age_s: f64, node_nanos: Option<i64>) {
        self.received += 1;
        self.window.received += 1;
        self.coalesced += u64::from(handoff.coalesced);
        self.window.coalesced += u64::from(handoff.coalesced);
        self.missed += u64::from(handoff.missed);
        self.last_pose = Some(LastPose { wall: Instant::now(), node_nanos });
        if age_s >= 0.0 {
            self.input_age.record(Duration::try_from_secs_f64(age_s).unwrap_or(Duration::MAX));
        }
    }

    /// Notes that a measurement is not evidence at present.
    pub(crate) fn doubt(&mut self, doubt: Doubt, words: impl FnOnce() -> String) {
        let seen = self.doubts.entry(doubt).or_insert_with(|| (words(), Instant::now()));
        seen.1 = Instant::now();
    }

    /// The doubts of the last `timeout_s`, s.
    pub(crate) fn doubts(&self, timeout_s: f64) -> impl Iterator<Item = (Doubt, &str)> {
        let fresh = move |seen: &Instant| seen.elapsed().as_secs_f64() < timeout_s;
        self.doubts.iter().filter(move |(_, (_, seen))| fresh(seen)).map(|(doubt, (words, _))| (*doubt, words.as_str()))
    }

    pub(crate) fn reject(&mut self, why: Reject) {
        self.rejected += 1;
        self.window.rejected += 1;
        *self.rejects.entry(why).or_default() += 1;
    }

    #[allow(clippy::cast_precision_loss)] // seconds between two poses
    pub(crate) fn answer(&mut self, answer: &Answer) {
        self.answered += 1;
        self.steps += u64::from(answer.prediction.steps);
        if let Some(Event::Puncture { depth_m, .. }) = answer.prediction.event {
            self.puncture_depth_m = Some(depth_m);
        }
        self.queue.record(answer.begun - answer.received);
        self.stepping.record(answer.done - answer.begun);
        self.window.answered += 1;
        self.window.steps += u64::from(answer.prediction.steps);
        let stepping_s = (answer.done - answer.begun).as_secs_f64();
        self.stepping_s += stepping_s;
        self.window.stepping_s += stepping_s;
        let stamp = answer.stamp.nanos();
        self.first_stamp_nanos.get_or_insert(stamp);
        if let Some(before) = self.last_stamp_nanos.replace(stamp) {
            self.window.input_s += (stamp - before).max(0) as f64 * 1e-9;
        }
        self.last = Some(*answer);
    }

    /// Adds an event.
    pub(crate) fn note(&mut self, event: Noted) {
        if self.events.len() == NOTED {
            self.events.pop_front();
        }
        self.events.push_back(event);
    }

    /// Stores the identification's result from a comparison.
    pub(crate) fn identified(&mut self, message: &ForceComparison) {
        let both = message.identified_values.iter().zip(&message.identified_standard_errors);
        self.identified = (message.identification != ForceComparison::IDENTIFICATION_OFF).then(|| Identified {
            state: message.identification,
            reason: message.identification_reason.clone(),
            values: message.identified_names.iter().cloned().zip(both).map(|(n, (v, e))| (n, *v, *e)).collect(),
        });
    }

    /// Notes that a reset was requested: what comes from now on belongs to the run after it.
    pub(crate) fn expect_reset(&mut self) {
        self.before_reset = Some([self.received, self.coalesced, self.missed]);
    }

    /// Resets everything that belongs to the run; what belongs to the node remains.
    pub(crate) fn reset(&mut self) {
        let now = [self.received, self.coalesced, self.missed];
        let before = self.before_reset.unwrap_or(now);
        let [received, coalesced, missed] = [0, 1, 2].map(|k| now[k].saturating_sub(before[k]));
        *self = Self {
            received,
            coalesced,
            missed,
            last_pose: self.last_pose,
            last_clock: self.last_clock,
            doubts: std::mem::take(&mut self.doubts),
            steepest_n_per_m: self.steepest_n_per_m,
            load_cell: self.load_cell,
            stuck_s: self.stuck_s,
            dying: self.dying.take(),
            along: Arc::clone(&self.along),
            rivals: std::mem::take(&mut self.rivals),
            ..Self::default()
        };
    }

    /// Region of the tip; empty outside of the sample.
    pub(crate) fn region(&self) -> &str {
        self.last.as_ref().map_or("", |a| self.along.name(a.prediction.depth_m, a.prediction.phase))
    }

    /// Closes the window after a second.
    pub(crate) fn roll(&mut self, now: Instant) {
        self.watched = Some(now);
        let begun = *self.window_begun.get_or_insert(now);
        let seconds = (now - begun).as_secs_f64();
        if seconds >= 1.0 {
            self.last_window = Window { seconds, ..self.window };
            self.window = Window::default();
            self.window_begun = Some(now);
        }
    }
}

/// State shared by the threads.
#[derive(Debug)]
pub(super) struct Shared {
    live: Mutex<Live>,
    settings: RwLock<Arc<Settings>>,
    pub clock: NodeClock,
    state: AtomicU8,
}

impl Shared {
    pub(crate) fn new(settings: Settings, clock: NodeClock) -> Self {
        let state = AtomicU8::new(State::Unconfigured as u8);
        Self { live: Mutex::default(), settings: RwLock::new(Arc::new(settings)), clock, state }
    }

    /// Sets the state of the managed node.
    pub(crate) fn set_state(&self, state: State) {
        self.state.store(state as u8, Ordering::Relaxed);
    }

    /// State of the managed node.
    pub(crate) fn state(&self) -> State {
        let id = self.state.load(Ordering::Relaxed);
        State::ALL.into_iter().find(|s| *s as u8 == id).unwrap_or(State::Unconfigured)
    }

    /// Whether poses are answered.
    pub(crate) fn is_active(&self) -> bool {
        self.state.load(Ordering::Relaxed) == State::Active as u8
    }

    pub(crate) fn lock(&self) -> MutexGuard<'_, Live> {
        // A panic elsewhere can't leave counters in an inconsistent state.
        self.live.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn settings(&self) -> Arc<Settings> {
        Arc::clone(&self.settings.read().unwrap_or_else(PoisonError::into_inner))
    }

    pub(crate) fn set_settings(&self, settings: Settings) {
        *self.settings.write().unwrap_or_else(PoisonError::into_inner) = Arc::new(settings);
    }
}
