//! How the middleware process notices that its own DDS is dead, deaf or was attacked.
//!
//! - RustDDS ends its event loops for good when a poll of theirs is interrupted, as by SIGSTOP and SIGCONT or a debugger
//!   that attaches; no signal mask keeps those away. Nothing in the middleware says so, but its threads are gone.
//! - An event loop that is busy for ever (a HEARTBEAT that announces 2^40 samples) is alive and hears nothing. So the
//!   process knocks at its own door: it sends itself a packet that is no RTPS, of which RustDDS must complain.
//! - What a lying packet has marked as received or void is refused for ever, while everything looks matched. RustDDS
//!   complains of most packets that it can't take: after a flood of complaints only a new participant is sure to hear.
//!   And it tells up to which number it takes messages for received: where no publisher ever comes, it was misled.

use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use crossbeam_channel::{Receiver, Sender};

use crate::GuardError;
use named_threads::spawn;

/// Time between two looks.
const LOOK: std::time::Duration = std::time::Duration::from_millis(200);
/// Knocks in a row that were not heard; the same before the first that was; before it is clear that none ever is.
const UNHEARD: [u32; 3] = [6, 10, 50];
/// Complaints within a second that make a flood.
const FLOOD: u64 = 20;
/// Complaints within a second that are none any more.
const EBB: u64 = 2;
/// Looks that make a second.
const SECOND: usize = 5;
/// Lines that may wait for the node's log.
const LINES: usize = 64;
/// Who complains when a packet can't be taken.
const COMPLAINERS: [&str; 6] = [
    "rustdds::rtps::message_receiver",
    "rustdds::rtps::reader",
    "rustdds::rtps::rtps_writer_proxy",
    "rustdds::rtps::fragment_assembler",
    "rustdds::messages",
    "rustdds::structure",
];
/// Who tells up to which number a publisher's messages count as received, and how.
const TELLER: (&str, &str) = ("rustdds::rtps::rtps_writer_proxy", "ack_base increased to ");
/// A number that no publisher reaches: 35 years at 1 kHz.
const UNHEARD_OF: u64 = 1 << 40;
/// Who complains of a knock.
const KNOCKED: &str = COMPLAINERS[0];

/// What a look finds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Finding {
    /// All is well.
    Well,
    /// Malformed packets come by the dozen; how many in the last second.
    Flooded(u64),
    /// They have ceased.
    Ebbed,
    /// No knock was ever heard, so that it can't be told whether the DDS is deaf.
    Untold,
    /// Nothing is heard any more; why.
    Deaf(&'static str),
}

/// The looks of one process.
pub(super) struct Watch {
    threads: Vec<PathBuf>,
    unheard: u32,
    heard: u64,
    /// A process before this one has heard its knocks, so this one must.
    hears: bool,
    complaints: VecDeque<u64>,
    flooded: bool,
}

impl Watch {
    /// `threads` are those that must live as long as the process does.
    pub(crate) fn new(hears: bool, threads: Vec<PathBuf>) -> Self {
        Self { threads, unheard: 0, heard: 0, hears, complaints: VecDeque::new(), flooded: false }
    }

    /// Looks; call it every [`LOOK`] with how many complaints and how many knocks were heard in all.
    pub(crate) fn look(&mut self, complaints: u64, heard: u64, knock: impl FnOnce()) -> Finding {
        if self.heard != heard {
            self.heard = heard;
            self.unheard = 0;
        }
        if !self.threads.iter().all(|thread| thread.exists()) {
            return Finding::Deaf("its DDS threads have ended (it was stopped by SIGSTOP or a debugger)");
        }
        // Where none was ever heard, RustDDS may complain in other words.
        let judged = self.hears || self.heard > 0;
        if judged && self.unheard >= UNHEARD[usize::from(self.heard == 0)] {
            return Finding::Deaf("its DDS does not take packets any more");
        }
        self.unheard = self.unheard.saturating_add(1);
        knock();
        if self.unheard == UNHEARD[2] {
            return Finding::Untold;
        }
        self.count(complaints)
    }

    fn count(&mut self, complaints: u64) -> Finding {
        self.complaints.push_back(complaints);
        let then = if self.complaints.len() > SECOND { self.complaints.pop_front().unwrap_or(0) } else { 0 };
        let fresh = complaints - then;
        match (self.flooded, fresh) {
            (false, FLOOD..) => {
                self.flooded = true;
                Finding::Flooded(fresh)
            }
            (true, ..=EBB) => Finding::Ebbed,
            _ => Finding::Well,
        }
    }
}

/// Those of the process at present, as files that go when they do; none where the system does not show them.
pub(super) fn threads() -> Vec<PathBuf> {
    std::fs::read_dir("/proc/self/task").into_iter().flatten().flatten().map(|task| task.path()).collect()
}

/// How a knock begins: like no RTPS packet, and not like that of another process.
fn mark() -> [u8; 4] {
    let [a, b, c, _] = std::process::id().to_le_bytes();
    [a, b, c, b'?']
}

/// What RustDDS says of itself: complaints are counted, lines go to the node.
pub(super) struct Voice {
    complaints: AtomicU64,
    knocks: AtomicU64,
    misled: AtomicBool,
    /// What RustDDS says of a knock.
    echo: String,
    lines: Sender<(u8, String)>,
    verbosity: log::Level,
}

impl Voice {
    /// Listens; once per process. `verbosity` is the level from 1 (error) to 5 (trace) up to which lines are wanted.
    pub(crate) fn listen(verbosity: u8) -> (&'static Self, Receiver<(u8, String)>) {
        let (lines, received) = crossbeam_channel::bounded(LINES);
        let verbosity = log::Level::iter().find(|level| *level as u8 == verbosity).unwrap_or(log::Level::Error);
        // The logger of a process lives as long as the process.
        let (complaints, knocks, misled) = (AtomicU64::new(0), AtomicU64::new(0), AtomicBool::new(false));
        let echo = format!("{:x?}", mark());
        let voice: &'static Self = Box::leak(Box::new(Self { complaints, knocks, misled, echo, lines, verbosity }));
        log::set_max_level(verbosity.max(log::Level::Debug).to_level_filter());
        // Fails only if there was one before, and this is the first thing that a middleware process does.
        let _ = log::set_logger(voice);
        (voice, received)
    }

    /// A packet that is no RTPS and as long as the header of one.
    pub(crate) fn knock(&self) -> [u8; 20] {
        let mut packet = [0; 20];
        packet[..4].copy_from_slice(&mark());
        packet
    }

    /// Knocks that were heard, in all.
    pub(crate) fn heard(&self) -> u64 {
        self.knocks.load(Ordering::Relaxed)
    }

    /// Whether a packet has made the process deaf for a true publisher.
    pub(crate) fn misled(&self) -> bool {
        self.misled.load(Ordering::Relaxed)
    }

    /// Packets that could not be taken, in all.
    pub(crate) fn complaints(&self) -> u64 {
        self.complaints.load(Ordering::Relaxed)
    }
}

impl log::Log for Voice {
    fn enabled(&self, metadata: &log::Metadata<'_>) -> bool {
        metadata.level() <= self.verbosity.max(log::Level::Warn)
    }

    fn log(&self, record: &log::Record<'_>) {
        // First of all what is neither looked at nor wanted: RustDDS says much per packet.
        let told = record.level() == log::Level::Debug && record.target() == TELLER.0;
        if !told && !self.enabled(record.metadata()) {
            return;
        }
        if told && is_unheard_of(&record.args().to_string()) {
            self.misled.store(true, Ordering::Relaxed);
        }
        let complaint =
            record.level() <= log::Level::Warn && COMPLAINERS.iter().any(|c| record.target().starts_with(c));
        if complaint && record.target() == KNOCKED && record.args().to_string().contains(&self.echo) {
            self.knocks.fetch_add(1, Ordering::Relaxed);
            return;
        }
        if complaint {
            self.complaints.fetch_add(1, Ordering::Relaxed);
        }
        if record.level() <= self.verbosity && !self.lines.is_full() {
            // What is lost in a race for the last place is one line of many.
            let _ = self.lines.try_send((record.level() as u8, format!("{}\n{}", record.target(), record.args())));
        }
    }

    fn flush(&self) {}
}

/// Whether a line tells of a number that no publisher reaches.
fn is_unheard_of(line: &str) -> bool {
    let number = line.strip_prefix(TELLER.1).and_then(|rest| rest.split(" by").next()).unwrap_or_default();
    let digits: String = number.chars().filter(char::is_ascii_digit).collect();
    digits.parse::<u64>().is_ok_and(|n| n >= UNHEARD_OF)
}

/// One now and one every [`LOOK`], until nobody takes them.
pub(super) fn ticks() -> Result<smol::channel::Receiver<()>, GuardError> {
    let (sender, ticks) = smol::channel::bounded(1);
    spawn("ticks", move || {
        while !matches!(sender.try_send(()), Err(smol::channel::TrySendError::Closed(()))) {
            std::thread::sleep(LOOK);
        }
    })?;
    Ok(ticks)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flood_is_noticed_and_its_end_too() {
        let mut watch = Watch::new(false, Vec::new());
        let mut found = Vec::new();
        let mut total = 0;
        for look in 0..30_u64 {
            total += match look {
                5..10 => 50,
                _ => u64::from(look % 5 == 0),
            };
            let finding = watch.look(total, look + 1, || ());
            if finding != Finding::Well {
                found.push((look, finding));
                if found.len() == 2 {
                    break;
                }
            }
        }
        assert!(matches!(found[..], [(5, Finding::Flooded(50)), (14, Finding::Ebbed)]), "{found:?}");
    }

    #[test]
    fn a_thread_that_ends_is_missed() {
        let here = threads();
        let (end, ended) = crossbeam_channel::bounded::<()>(0);
        let thread = std::thread::spawn(move || ended.recv().is_ok());
        let more = threads().into_iter().filter(|task| !here.contains(task)).collect::<Vec<_>>();
        // Other tests have threads too: what matters is that this one's end is seen.
        let mut watch = Watch::new(false, more.clone());
        drop(end);
        let _ = thread.join();
        let seen = (0..100).any(|_| {
            std::thread::sleep(std::time::Duration::from_millis(10));
            matches!(watch.look(0, 0, || ()), Finding::Deaf(_))
        });
        assert!(seen || more.is_empty(), "{more:?}");
    }

    #[test]
    fn numbers_that_no_publisher_reaches_are_seen() {
        let line = |n: u64| {
            format!("ack_base increased to SequenceNumber({n}) by irrelevant_changes_range 9 to 9000000000000000")
        };
        assert!(
            is_unheard_of(&line(1 << 62))
                && !is_unheard_of(&line(1 << 32))
                && !is_unheard_of("ack_base 99999999999999")
        );
    }

    #[test]
    fn who_does_not_hear_himself_is_deaf() {
        for (heard, hears, expected) in [(1, false, (Some(6), 6)), (0, true, (Some(10), 10))] {
            let (mut watch, mut sent) = (Watch::new(hears, Vec::new()), 0);
            let deaf = (0..40).find(|_| matches!(watch.look(0, heard, || sent += 1), Finding::Deaf(_)));
            assert_eq!((deaf, sent), expected);
        }
        let mut watch = Watch::new(false, Vec::new());
        let untold = (0..400).filter(|_| watch.look(0, 0, || ()) != Finding::Well).collect::<Vec<_>>();
        assert_eq!(untold, [49], "not known whether it would hear");
    }
}
