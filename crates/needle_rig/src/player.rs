//! Plays a bag: returns the next message and its time. It uses no sockets, threads or sleeping.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use super::clock::PlaybackClock;
use rosbag2_mcap::{BagReader, Loss, Message, Messages};

/// How a bag is played; the same as the options of `ros2 bag play`.
#[derive(Clone, Debug, PartialEq)]
pub struct PlayOptions {
    /// Bag seconds per wall second.
    pub rate: f64,
    /// Start again at the end.
    pub looping: bool,
    /// Where to start, from the start of the bag.
    pub start_offset: Duration,
    /// Wait for `resume`.
    pub start_paused: bool,
    /// Topics to play; empty: all.
    pub topics: Vec<String>,
    /// Topics not to play.
    pub exclude_topics: Vec<String>,
    /// Where to stop.
    pub stretch: Stretch,
}

/// Where playing stops, if not at the end of the bag; the earlier of the two applies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stretch {
    /// Time after the start.
    pub duration: Option<Duration>,
    /// At this bag time, ns since 1970.
    pub until_ns: Option<i64>,
}

impl Default for PlayOptions {
    fn default() -> Self {
        Self {
            rate: 1.0,
            looping: false,
            start_offset: Duration::ZERO,
            start_paused: false,
            topics: Vec::new(),
            exclude_topics: Vec::new(),
            stretch: Stretch::default(),
        }
    }
}

/// The caller's next action.
#[derive(Clone, Debug, PartialEq)]
pub enum Step {
    /// Publish this now.
    Publish(Message),
    /// Nothing is due before this.
    WaitUntil(Instant),
    /// The player is paused.
    Paused,
    /// The bag has restarted: time has jumped back.
    Looped,
    /// The end was reached.
    Ended,
}

/// See the module.
#[derive(Debug)]
pub struct Player {
    bag: BagReader,
    wanted: Vec<bool>,
    latched: Vec<bool>,
    messages: Messages,
    /// Latched messages from before the start, then the next message in order of time.
    pending: Vec<Message>,
    clock: PlaybackClock,
    looping: bool,
    /// First and last bag time.
    bounds: (i64, i64),
    start_ns: i64,
    end_ns: i64,
    played: u64,
    losses: Vec<Loss>,
}

impl Player {
    /// Prepares to play; `None` if the bag has no message on any of the requested topics.
    #[must_use]
    pub fn new(bag: BagReader, options: &PlayOptions, wall: Instant) -> Option<Self> {
        let wanted: Vec<bool> = bag
            .topics()
            .iter()
            .map(|t| {
                let asked = options.topics.is_empty() || options.topics.contains(&t.name);
                t.messages > 0 && asked && !options.exclude_topics.contains(&t.name)
            })
            .collect();
        if !wanted.contains(&true) {
            return None;
        }
        let (first, last) = bag.span_ns()?;
        let bounds = (signed(first), signed(last));
        let latched = bag.topics().iter().map(|t| t.qos.iter().any(rosbag2_mcap::Qos::is_transient_local)).collect();
        let messages = select(&bag, &wanted);
        let mut player = Self {
            wanted,
            latched,
            messages,
            pending: Vec::new(),
            clock: PlaybackClock::new(wall, bounds.0, options.rate, options.start_paused),
            looping: options.looping,
            bounds,
            start_ns: bounds.0,
            end_ns: bounds.1,
            played: 0,
            losses: Vec::new(),
            bag,
        };
        player.restart(wall, options.start_offset, options.stretch);
        Some(player)
    }

    /// Goes to an offset from the start of the bag and plays a section from there. A pause is kept.
    pub fn restart(&mut self, wall: Instant, offset: Duration, stretch: Stretch) {
        let (first, last) = self.bounds;
        let nanos = |d: Duration| i64::try_from(d.as_nanos()).unwrap_or(i64::MAX);
        self.start_ns = first.saturating_add(nanos(offset)).min(last);
        let after = stretch.duration.map_or(last, |d| self.start_ns.saturating_add(nanos(d)));
        self.end_ns = last.min(after).min(stretch.until_ns.unwrap_or(last)).max(self.start_ns);
        self.go_to(wall, self.start_ns);
    }

    /// The bag.
    #[must_use]
    pub fn bag(&self) -> &BagReader {
        &self.bag
    }

    /// Whether a topic (index into the bag's topics) is played.
    #[must_use]
    pub fn plays(&self, topic: usize) -> bool {
        self.wanted.get(topic).copied().unwrap_or(false)
    }

    /// First and last bag time to be played, ns since 1970.
    #[must_use]
    pub const fn span_ns(&self) -> (i64, i64) {
        (self.start_ns, self.end_ns)
    }

    /// Number of messages that were returned.
    #[must_use]
    pub const fn played(&self) -> u64 {
        self.played
    }

    /// Losses while reading the bag so far.
    #[must_use]
    pub fn losses(&self) -> Vec<Loss> {
        let mut all = self.bag.losses().to_vec();
        all.extend(self.losses.iter().chain(self.messages.losses()).cloned());
        all
    }

    /// Bag time; it stops at the end.
    #[must_use]
    pub fn now_ns(&self, wall: Instant) -> i64 {
        self.clock.now_ns(wall).min(self.end_ns)
    }

    /// The clock.
    #[must_use]
    pub const fn clock(&self) -> &PlaybackClock {
        &self.clock
    }

    /// The action at a wall time. After [`Step::Publish`] and [`Step::Looped`] call it again at once.
    pub fn step(&mut self, wall: Instant) -> Step {
        let Some(next) = self.peek() else {
            if self.looping && self.played > 0 {
                self.go_to(wall, self.start_ns);
                return Step::Looped;
            }
            return Step::Ended;
        };
        match self.clock.due(signed(next)) {
            None => Step::Paused,
            Some(due) if due > wall => Step::WaitUntil(due),
            Some(_) => self.take().map_or(Step::Ended, Step::Publish),
        }
    }

    /// Returns the next message and sets the clock to its time; for `play_next` while paused.
    pub fn play_next(&mut self, wall: Instant) -> Option<Message> {
        if !self.clock.is_paused() {
            return None;
        }
        let message = self.take()?;
        self.clock.jump(wall, signed(message.log_ns));
        Some(message)
    }

    /// Pauses or resumes.
    pub fn set_paused(&mut self, wall: Instant, paused: bool) {
        self.clock.set_paused(wall, paused);
    }

    /// Changes the rate; false unless it is a positive number.
    pub fn set_rate(&mut self, wall: Instant, rate: f64) -> bool {
        self.clock.set_rate(wall, rate)
    }

    /// Goes to a bag time; false if it is outside the bag. Latched messages from before it come first.
    pub fn seek(&mut self, wall: Instant, bag_ns: i64) -> bool {
        let inside = (self.bounds.0..=self.end_ns).contains(&bag_ns);
        if inside {
            self.go_to(wall, bag_ns);
        }
        inside
    }

    fn go_to(&mut self, wall: Instant, bag_ns: i64) {
        self.losses.extend_from_slice(self.messages.losses());
        self.losses.dedup();
        self.messages = select(&self.bag, &self.wanted);
        self.clock.jump(wall, bag_ns);
        let mut latched: BTreeMap<usize, Message> = BTreeMap::new();
        self.pending.clear();
        for message in self.messages.by_ref() {
            if signed(message.log_ns) >= bag_ns {
                self.pending.push(message);
                break;
            }
            if self.latched.get(message.topic).copied().unwrap_or(false) {
                latched.insert(message.topic, message);
            }
        }
        // This is a stack: the next message is on top.
        self.pending.extend(latched.into_values().rev());
    }

    fn peek(&mut self) -> Option<u64> {
        if self.pending.is_empty() {
            self.pending.extend(self.messages.next());
        }
        self.pending.last().map(|m| m.log_ns).filter(|t| signed(*t) <= self.end_ns)
    }

    fn take(&mut self) -> Option<Message> {
        self.peek()?;
        let message = self.pending.pop()?;
        self.played += 1;
        Some(message)
    }
}

fn select(bag: &BagReader, wanted: &[bool]) -> Messages {
    let names: Vec<(&str, &str)> = bag
        .topics()
        .iter()
        .zip(wanted)
        .filter(|(_, wanted)| **wanted)
        .map(|(t, _)| (t.name.as_str(), t.type_name.as_str()))
        .collect();
    bag.select(|t| names.contains(&(t.name.as_str(), t.type_name.as_str())))
}

fn signed(ns: u64) -> i64 {
    i64::try_from(ns).unwrap_or(i64::MAX)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use ros2_messages::std_msgs::Float64;
    use rosbag2_mcap::{BagWriter, Qos, WriterOptions};

    const START: u64 = 1_700_000_000_000_000_000;
    const MS: u64 = 1_000_000;

    /// `/a` every 10 ms with its number, `/latched` once at the start.
    fn bag() -> (tempfile::TempDir, BagReader) {
        let folder = tempfile::tempdir().unwrap();
        let mut writer = BagWriter::create(folder.path().join("b"), WriterOptions::default()).unwrap();
        let a = writer.add_topic::<Float64>("/a", &Qos::reliable(10)).unwrap();
        let latched = writer.add_topic::<Float64>("/latched", &Qos::transient_local(1)).unwrap();
        writer.write(latched, START, START, &Float64 { data: -1.0 }).unwrap();
        for i in 0..100_u32 {
            let t = START + u64::from(i) * 10 * MS;
            writer.write(a, t, t, &Float64 { data: f64::from(i) }).unwrap();
        }
        let written = writer.finish().unwrap();
        let reader = BagReader::open(written.folder).unwrap();
        (folder, reader)
    }

    fn value(player: &Player, step: &Step) -> Option<f64> {
        let Step::Publish(message) = step else { return None };
        Some(player.bag().decode::<Float64>(message).unwrap().data)
    }

    #[test]
    fn relative_times_are_exact_at_any_rate() {
        let (_folder, bag) = bag();
        let t0 = Instant::now();
        let mut player =
            Player::new(bag, &PlayOptions { rate: 2.0, topics: vec!["/a".into()], ..Default::default() }, t0).unwrap();
        for i in 0..100_u32 {
            let due = t0 + Duration::from_millis(5) * i;
            if i > 0 {
                assert_eq!(player.step(due - Duration::from_nanos(1)), Step::WaitUntil(due));
            }
            let step = player.step(due);
            assert_eq!(value(&player, &step), Some(f64::from(i)));
        }
        assert_eq!(player.step(t0), Step::Ended);
        assert_eq!(player.played(), 100);
    }

    #[test]
    fn offset_keeps_latched_messages_and_loop_starts_anew() {
        let (_folder, bag) = bag();
        let t0 = Instant::now();
        let options = PlayOptions { start_offset: Duration::from_millis(905), looping: true, ..PlayOptions::default() };
        let mut player = Player::new(bag, &options, t0).unwrap();
        let late = t0 + Duration::from_secs(10);
        let values: Vec<Option<f64>> = (0..12)
            .map(|_| {
                let step = player.step(late);
                value(&player, &step)
            })
            .collect();
        let expected = [-1.0, 91.0, 92.0, 93.0, 94.0, 95.0, 96.0, 97.0, 98.0, 99.0].map(Some);
        assert_eq!(values[..10], expected);
        assert_eq!(values[10], None, "looped");
        assert_eq!(values[11], Some(-1.0));
    }

    #[test]
    fn a_stretch_is_played_and_then_another() {
        let (_folder, bag) = bag();
        let t0 = Instant::now();
        let stretch = Stretch { duration: Some(Duration::from_millis(15)), until_ns: None };
        let options = PlayOptions {
            start_offset: Duration::from_millis(100),
            exclude_topics: vec!["/latched".into()],
            stretch,
            ..Default::default()
        };
        let mut player = Player::new(bag, &options, t0).unwrap();
        let late = t0 + Duration::from_secs(10);
        let all = |player: &mut Player| {
            let steps: Vec<Step> =
                std::iter::repeat_with(|| player.step(late)).take_while(|s| *s != Step::Ended).collect();
            steps.iter().map(|s| value(player, s).unwrap()).collect::<Vec<_>>()
        };
        assert_eq!(all(&mut player), [10.0, 11.0]);
        assert!(!player.seek(t0, signed(START + 200 * MS)), "beyond the stretch");
        player.restart(
            t0,
            Duration::from_millis(970),
            Stretch { duration: None, until_ns: Some(signed(START + 980 * MS)) },
        );
        assert_eq!(all(&mut player), [97.0, 98.0]);
        player.restart(t0, Duration::from_millis(990), Stretch::default());
        assert_eq!(all(&mut player), [99.0]);
    }

    #[test]
    fn pause_play_next_and_seek() {
        let (_folder, bag) = bag();
        let t0 = Instant::now();
        let options = PlayOptions { start_paused: true, topics: vec!["/a".into()], ..PlayOptions::default() };
        let mut player = Player::new(bag, &options, t0).unwrap();
        assert_eq!(player.step(t0 + Duration::from_secs(5)), Step::Paused);
        assert!(player.play_next(t0).is_some());
        assert_eq!(player.played(), 1);
        assert!(player.seek(t0, signed(START + 500 * MS)));
        assert!(!player.seek(t0, signed(START + 5_000 * MS)));
        assert_eq!(player.now_ns(t0), signed(START + 500 * MS));
        player.set_paused(t0, false);
        assert!(player.play_next(t0).is_none(), "only while paused");
        let step = player.step(t0);
        assert_eq!(value(&player, &step), Some(50.0));
        assert_eq!(player.step(t0), Step::WaitUntil(t0 + Duration::from_millis(10)));
    }

    #[test]
    fn a_bag_without_the_wanted_topics_is_none() {
        let (_folder, bag) = bag();
        let options = PlayOptions { topics: vec!["/nothing".into()], ..PlayOptions::default() };
        assert!(Player::new(bag, &options, Instant::now()).is_none());
    }
}
