//! The playback thread: publishes the messages that the player returns, and `/clock`.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender};

use super::outputs::Outputs;
use needle_rig::{Player, Step, Stretch};
use ros2_messages::builtin_interfaces::Time;
use ros2_messages::rosgraph_msgs::Clock;
use rosbag2_mcap::{BagReader, Message};

/// Commands of the services to the playback thread.
pub(super) enum Command {
    SetPaused(bool),
    Toggle,
    State(Sender<(bool, f64)>),
    SetRate(f64, Sender<bool>),
    Seek(i64, Sender<bool>),
    PlayNext(Sender<bool>),
    Burst(u64, Sender<u64>),
    /// Offset from the start of the bag, and where to stop.
    Play(Duration, Stretch, Sender<bool>),
    /// Ends the playback.
    Stop,
    /// Ends the node.
    Quit,
}

/// Delays of messages relative to their due times.
#[derive(Debug)]
pub(super) struct Report {
    pub played: u64,
    pub late: hdrhistogram::Histogram<u64>,
    pub losses: Vec<String>,
}

/// Plays until the end or `Stop` (with `stay`, it then waits for further commands), `Quit`, or until `commands` is
/// closed.
pub(super) fn run(
    mut player: Player,
    outputs: &Outputs,
    commands: &Receiver<Command>,
    delay: Duration,
    stay: bool,
) -> Report {
    precise_timers();
    let mut playback = Playback::new(&player, outputs, stay);
    if playback.wait(&mut player, commands, delay) {
        let (start, _) = player.span_ns();
        player.seek(Instant::now(), start);
        while playback.go_on(&mut player, commands) {}
    }
    playback.report(&player)
}

/// The next action after a step.
enum Next {
    /// Another step.
    Again,
    /// Wait until this time or for a command.
    Wait(Instant),
    /// End.
    Over,
}

struct Playback<'a> {
    outputs: &'a Outputs,
    late: hdrhistogram::Histogram<u64>,
    /// Messages that could not be played, by topic, and the reason for the first.
    refused: BTreeMap<usize, (u64, String)>,
    bag: BagReader,
    /// Whether the end was reached; it waits for a command.
    ended: bool,
    /// Whether to wait for commands at the end.
    stay: bool,
    clock_due: Instant,
}

impl<'a> Playback<'a> {
    fn new(player: &Player, outputs: &'a Outputs, stay: bool) -> Self {
        #[allow(clippy::expect_used)] // constant bounds that the library accepts
        let late = hdrhistogram::Histogram::new_with_bounds(100, 100_000_000_000, 2).expect("constant bounds");
        let (bag, refused) = (player.bag().clone(), BTreeMap::new());
        Self { outputs, late, refused, bag, ended: false, stay, clock_due: Instant::now() }
    }

    /// Waits for the initial delay; false if the node stops meanwhile.
    fn wait(&mut self, player: &mut Player, commands: &Receiver<Command>, delay: Duration) -> bool {
        let begin = Instant::now() + delay;
        while !delay.is_zero() {
            match commands.recv_deadline(begin) {
                Ok(Command::Stop | Command::Quit) | Err(RecvTimeoutError::Disconnected) => return false,
                Ok(command) => self.obey(player, command),
                Err(RecvTimeoutError::Timeout) => break,
            }
        }
        true
    }

    /// One step, and the wait after it; false at the end.
    fn go_on(&mut self, player: &mut Player, commands: &Receiver<Command>) -> bool {
        let now = Instant::now();
        self.tick(player, now);
        let wake = match self.act(player, now) {
            Next::Again => return true,
            Next::Over => return false,
            Next::Wait(until) => until,
        };
        match commands.recv_deadline(wake) {
            Ok(Command::Quit) | Err(RecvTimeoutError::Disconnected) => return false,
            Ok(Command::Stop) if !self.stay => return false,
            Ok(command) => {
                self.obey(player, command);
                self.clock_due = Instant::now();
            }
            Err(RecvTimeoutError::Timeout) => {}
        }
        true
    }

    fn tick(&mut self, player: &Player, now: Instant) {
        let Some((clock, period)) = &self.outputs.clock else { return };
        if now >= self.clock_due {
            self.clock_due = if now - self.clock_due > *period { now + *period } else { self.clock_due + *period };
            clock.send(Clock { clock: Time::from_nanos(player.now_ns(now)) });
        }
    }

    fn act(&mut self, player: &mut Player, now: Instant) -> Next {
        let ticks = self.outputs.clock.is_some();
        match if self.ended { Step::Ended } else { player.step(now) } {
            Step::Publish(message) => self.publish(player, message),
            Step::Looped => {
                tracing::info!("the bag starts anew");
                // Subscribers of the clock must receive the jump before the first message.
                self.clock_due = now;
            }
            Step::Ended if !self.stay => return Next::Over,
            Step::Ended if !self.ended => {
                self.ended = true;
                tracing::info!("at the end: waiting for ~/play or ~/seek");
            }
            Step::WaitUntil(due) => return Next::Wait(if ticks { due.min(self.clock_due) } else { due }),
            Step::Paused | Step::Ended if ticks => return Next::Wait(self.clock_due),
            Step::Paused | Step::Ended => return Next::Wait(now + Duration::from_secs(1)),
        }
        Next::Again
    }

    fn publish(&mut self, player: &Player, message: Message) {
        let due = player.clock().due(i64::try_from(message.log_ns).unwrap_or(i64::MAX));
        let late = due.map(|due| Instant::now().saturating_duration_since(due));
        // Messages from before the start (latched messages) are not late.
        if let Some(late) = late.filter(|late| *late < Duration::from_secs(60))
            && self.outputs.plays(message.topic)
        {
            self.late.saturating_record(u64::try_from(late.as_nanos()).unwrap_or(u64::MAX));
        }
        self.send(message);
    }

    fn send(&mut self, message: Message) {
        let topic = message.topic;
        if let Err(reason) = self.outputs.send(&self.bag, message) {
            let (count, first) = self.refused.entry(topic).or_insert((0, reason.clone()));
            *count += 1;
            if *count == 1 {
                let name = self.bag.topics().get(topic).map_or("?", |t| t.name.as_str());
                tracing::warn!("{name}: a message is not played: {first}");
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
            Command::Seek(time, reply) => {
                let done = player.seek(now, time);
                self.ended &= !done;
                answer(&reply, done);
            }
            // As in rosbag2: only a player that is not playing can be started.
            Command::Play(offset, stretch, reply) => {
                let idle = std::mem::take(&mut self.ended);
                if idle {
                    player.restart(now, offset, stretch);
                    tracing::info!("playing from {:.3} s", offset.as_secs_f64());
                }
                answer(&reply, idle);
            }
            Command::PlayNext(reply) => answer(&reply, self.play_next(player, now)),
            Command::Burst(wanted, reply) => {
                let mut played = 0;
                while (wanted == 0 || played < wanted) && self.play_next(player, now) {
                    played += 1;
                }
                answer(&reply, played);
            }
            Command::Stop => self.ended = true,
            // Handled where the commands are received.
            Command::Quit => {}
        }
    }

    fn play_next(&mut self, player: &mut Player, now: Instant) -> bool {
        player.play_next(now).map(|message| self.send(message)).is_some()
    }

    fn report(self, player: &Player) -> Report {
        let mut losses: Vec<String> = player.losses().iter().map(ToString::to_string).collect();
        losses.extend(self.refused.iter().map(|(topic, (n, reason))| {
            let name = self.bag.topics().get(*topic).map_or("?", |t| t.name.as_str());
            format!("{name}: {n} messages were not played: {reason}")
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

/// Disables Linux's timer slack of 50 us, which saves power but delays messages.
fn precise_timers() {
    #[cfg(target_os = "linux")]
    // If the system refuses, the player is slightly less punctual.
    let _ = rustix::thread::set_current_timer_slack(std::num::NonZeroU64::new(1));
}
