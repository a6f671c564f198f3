//! The playback thread: publishes what the player says is due, and `/clock`.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender};
use ros2_client::qos::{Durability, History};
use ros2_client::{MessageTypeName, QosProfile};

use crate::bag::{BagReader, Message, Topic};
use crate::rig::{Player, Step};
use crate::ros::messages::builtin_interfaces::Time;
use crate::ros::messages::rosgraph_msgs::Clock;
use crate::ros::participant::{Output, Participant};
use crate::ros::qos;
use crate::ros::raw::RawCdr;
use crate::ros::start::NodeError;

/// What the services ask of the playback thread.
pub(super) enum Command {
    SetPaused(bool),
    Toggle,
    State(Sender<(bool, f64)>),
    SetRate(f64, Sender<bool>),
    Seek(i64, Sender<bool>),
    PlayNext(Sender<bool>),
    Burst(u64, Sender<u64>),
    Stop,
}

/// The publishers of a bag's topics.
pub(super) struct Outputs {
    by_topic: BTreeMap<usize, Output<RawCdr>>,
    clock: Option<(Output<Clock>, Duration)>,
}

impl Outputs {
    /// One publisher per topic that is played, with the QoS that was recorded.
    pub fn new(participant: &mut Participant, player: &Player, clock_hz: f64) -> Result<Self, NodeError> {
        let mut by_topic = BTreeMap::new();
        for (index, topic) in player.bag().topics().iter().enumerate().filter(|(i, _)| player.plays(*i)) {
            if topic.name == "/clock" && clock_hz > 0.0 {
                tracing::info!(
                    "the bag's own /clock is not played: this node publishes it (clock_hz:=0 to change that)"
                );
                continue;
            }
            let Some((package, name)) = topic.type_name.split_once("/msg/").filter(|_| topic.encoding == "cdr") else {
                tracing::warn!(
                    "{} can't be played: type `{}`, encoding `{}` (expected package/msg/Type and cdr)",
                    topic.name,
                    topic.type_name,
                    topic.encoding
                );
                continue;
            };
            let type_name = MessageTypeName::new(package, name);
            by_topic.insert(index, participant.publisher_of(&topic.name, type_name, recorded(topic))?);
        }
        let clock = if clock_hz > 0.0 {
            // rosbag2's player: best effort, so that nothing waits for a reader of the time.
            Some((participant.publisher("/clock", qos::sensor(1))?, Duration::from_secs_f64(1.0 / clock_hz)))
        } else {
            None
        };
        Ok(Self { by_topic, clock })
    }
}

/// The QoS that was recorded; reliable where the bag says nothing.
fn recorded(topic: &Topic) -> QosProfile {
    let Some(first) = topic.qos.first() else { return qos::reliable(10) };
    let depth = usize::try_from(first.depth).unwrap_or(0).clamp(10, 1000);
    let mut profile = if first.is_reliable() { qos::reliable(depth) } else { qos::sensor(depth) };
    if topic.qos.iter().any(crate::bag::Qos::is_transient_local) {
        profile = profile.durability(Durability::TransientLocal).history(History::KeepLast { depth: 1 });
    }
    profile
}

/// How late messages left, against the time at which they were due.
#[derive(Debug)]
pub(super) struct Report {
    pub played: u64,
    pub late: hdrhistogram::Histogram<u64>,
    pub losses: Vec<String>,
}

/// Plays until the end, `Stop`, or until `commands` is closed.
pub(super) fn run(mut player: Player, outputs: &Outputs, commands: &Receiver<Command>, delay: Duration) -> Report {
    precise_timers();
    #[allow(clippy::expect_used)] // constant bounds that the library accepts
    let late = hdrhistogram::Histogram::new_with_bounds(100, 100_000_000_000, 2).expect("constant bounds");
    let mut playback = Playback { outputs, late, refused: BTreeMap::new(), bag: player.bag().clone() };
    // The delay, cut short when the node stops.
    let begin = Instant::now() + delay;
    while !delay.is_zero() {
        match commands.recv_deadline(begin) {
            Ok(Command::Stop) | Err(RecvTimeoutError::Disconnected) => return playback.report(&player),
            Ok(command) => playback.obey(&mut player, command),
            Err(RecvTimeoutError::Timeout) => break,
        }
    }
    let (start, _) = player.span_ns();
    player.seek(Instant::now(), start);
    let mut clock_due = Instant::now();
    loop {
        let now = Instant::now();
        if let Some((clock, period)) = &outputs.clock
            && now >= clock_due
        {
            clock_due = if now - clock_due > *period { now + *period } else { clock_due + *period };
            clock.send(Clock { clock: Time::from_nanos(player.now_ns(now)) });
        }
        let wake = match player.step(now) {
            Step::Publish(message) => {
                playback.publish(&player, message);
                continue;
            }
            Step::Looped => {
                tracing::info!("the bag starts anew");
                continue;
            }
            Step::Ended => break,
            Step::WaitUntil(due) if outputs.clock.is_some() => due.min(clock_due),
            Step::WaitUntil(due) => due,
            Step::Paused => {
                if outputs.clock.is_some() {
                    clock_due
                } else {
                    now + Duration::from_secs(1)
                }
            }
        };
        match commands.recv_deadline(wake) {
            Ok(Command::Stop) | Err(RecvTimeoutError::Disconnected) => break,
            Ok(command) => playback.obey(&mut player, command),
            Err(RecvTimeoutError::Timeout) => {}
        }
    }
    playback.report(&player)
}

struct Playback<'a> {
    outputs: &'a Outputs,
    late: hdrhistogram::Histogram<u64>,
    refused: BTreeMap<usize, u64>,
    bag: BagReader,
}

impl Playback<'_> {
    fn publish(&mut self, player: &Player, message: Message) {
        let due = player.clock().due(i64::try_from(message.log_ns).unwrap_or(i64::MAX));
        let late = due.map(|due| Instant::now().saturating_duration_since(due));
        // What was due before the start (latched messages) is not late.
        if let Some(late) = late.filter(|late| *late < Duration::from_secs(60))
            && self.outputs.by_topic.contains_key(&message.topic)
        {
            self.late.saturating_record(u64::try_from(late.as_nanos()).unwrap_or(u64::MAX));
        }
        self.send(message);
    }

    fn send(&mut self, message: Message) {
        let Some(output) = self.outputs.by_topic.get(&message.topic) else { return };
        match RawCdr::from_bag(message.data) {
            Ok(raw) => {
                output.send(raw);
            }
            Err(start) => {
                let count = self.refused.entry(message.topic).or_default();
                *count += 1;
                if *count == 1 {
                    let name = self.bag.topics().get(message.topic).map_or("?", |t| t.name.as_str());
                    tracing::warn!("{name}: a message starts with {start}, which is not little-endian CDR: not played");
                }
            }
        }
    }

    fn obey(&mut self, player: &mut Player, command: Command) {
        let now = Instant::now();
        match command {
            Command::SetPaused(paused) => set_paused(player, now, paused),
            Command::Toggle => set_paused(player, now, !player.clock().is_paused()),
            Command::State(reply) => answer(&reply, (player.clock().is_paused(), player.clock().rate())),
            Command::SetRate(rate, reply) => {
                let done = player.set_rate(now, rate);
                if done {
                    tracing::info!("rate {rate}");
                }
                answer(&reply, done);
            }
            Command::Seek(time, reply) => answer(&reply, player.seek(now, time)),
            Command::PlayNext(reply) => answer(&reply, self.play_next(player, now)),
            Command::Burst(wanted, reply) => {
                let mut played = 0;
                while (wanted == 0 || played < wanted) && self.play_next(player, now) {
                    played += 1;
                }
                answer(&reply, played);
            }
            // Handled where the commands are taken.
            Command::Stop => {}
        }
    }

    fn play_next(&mut self, player: &mut Player, now: Instant) -> bool {
        player.play_next(now).map(|message| self.send(message)).is_some()
    }

    fn report(self, player: &Player) -> Report {
        let mut losses: Vec<String> = player.losses().iter().map(ToString::to_string).collect();
        losses.extend(self.refused.iter().map(|(topic, n)| {
            let name = self.bag.topics().get(*topic).map_or("?", |t| t.name.as_str());
            format!("{name}: {n} messages are not little-endian CDR")
        }));
        Report { played: player.played(), late: self.late, losses }
    }
}

fn set_paused(player: &mut Player, now: Instant, paused: bool) {
    player.set_paused(now, paused);
    tracing::info!("{}", if paused { "paused" } else { "resumed" });
}

fn answer<T>(reply: &Sender<T>, value: T) {
    // Fails only if the caller has given up.
    let _ = reply.try_send(value);
}

/// Linux may wake a sleeper 50 us late to save power; a player of recordings must not be.
fn precise_timers() {
    #[cfg(target_os = "linux")]
    // SAFETY: this option takes one integer and touches nothing but the calling thread's timer slack.
    unsafe {
        libc::prctl(libc::PR_SET_TIMERSLACK, 1 as libc::c_ulong, 0, 0, 0);
    }
}
