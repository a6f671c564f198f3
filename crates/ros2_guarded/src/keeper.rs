//! Starts the middleware process, forwards its messages, and replaces it when it dies or falls silent.

use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crossbeam_channel::Sender;
use rustix::event::{PollFd, PollFlags, Timespec};
use rustix::process::Signal;

use super::ARGUMENT;
use super::frames::Frames;
use super::health::Health;
use super::link::{Inlets, Link};
use super::silence::Silence;
use super::wire::{Head, Kind, Plan};
use crate::GuardError;
use crate::throttle::Throttle;
use named_threads::{join, spawn};

/// Looks in a row that find nothing, not even a pulse, until the process counts as stuck: a machine may be busy.
const SILENT_LOOKS: u32 = 10;
/// The same for a process that the system says is stopped.
const STOPPED_LOOKS: u32 = 2;
/// The same before the first process has said that it is ready, and before a later one has: a machine may be busy.
const STARTING_LOOKS: [u32; 2] = [67, 10];
/// Time for what was said last to go out, and for a process that is of no more use to end by itself.
const REST: Duration = Duration::from_millis(100);
/// A process that has lived so long is replaced at once.
const SOUND: Duration = Duration::from_secs(2);
/// Shortest and longest wait before the next one otherwise.
const PAUSES: [Duration; 2] = [Duration::from_millis(50), Duration::from_secs(1)];
/// Time for a clean leave.
const LEAVE: Duration = Duration::from_secs(2);
/// Longest silence about processes that end one after the other.
const COMPLAINTS: Duration = Duration::from_secs(1);

/// The thread that minds the process; dropping it leaves the network.
pub struct Middleware {
    link: Arc<Link>,
    health: Arc<Health>,
    thread: Option<JoinHandle<()>>,
}

impl Middleware {
    /// Starts the process and waits until it has made every endpoint.
    ///
    /// # Errors
    /// What could not be made, and why.
    pub fn start(
        plan: Plan,
        program: Option<PathBuf>,
        inlets: Inlets,
        link: Arc<Link>,
        woken: UnixStream,
    ) -> Result<Self, GuardError> {
        let health = Arc::new(Health::new(&inlets.overrun));
        let (first, ready) = crossbeam_channel::bounded(1);
        let mut keeper =
            Keeper { plan, program, inlets, link: Arc::clone(&link), woken, health: Arc::clone(&health), said: None };
        let mut first = Some(first);
        // The process dies with the thread that starts it, so that it can't outlive a node that was killed.
        let thread = spawn("middleware", move || keeper.run(&mut first))?;
        let middleware = Self { link, health, thread: Some(thread) };
        match ready.recv() {
            Ok(Ok(())) => Ok(middleware),
            Ok(Err(reason)) => Err(GuardError::Refused(reason)),
            Err(_) => Err(GuardError::Refused("the middleware thread has ended unexpectedly".to_owned())),
        }
    }

    /// Ends only with the node.
    pub fn thread(&self) -> Option<&JoinHandle<()>> {
        self.thread.as_ref()
    }

    /// How it goes.
    pub fn health(&self) -> &Arc<Health> {
        &self.health
    }
}

impl Drop for Middleware {
    fn drop(&mut self) {
        self.link.stop();
        self.thread.take().into_iter().for_each(join);
    }
}

type First = Option<Sender<Result<(), String>>>;

/// Why a process is no more.
enum End {
    /// The node leaves.
    Left,
    /// It could not make the endpoints.
    Refused(String),
    /// Anything else, in words that follow "the middleware process".
    Lost(String),
}

struct Keeper {
    plan: Plan,
    program: Option<PathBuf>,
    inlets: Inlets,
    link: Arc<Link>,
    woken: UnixStream,
    health: Arc<Health>,
    /// What the present process has said about why it ends.
    said: Option<String>,
}

impl Keeper {
    fn run(&mut self, first: &mut First) {
        let mut complaints = Throttle::new(COMPLAINTS);
        let mut pause = PAUSES[0];
        loop {
            let begun = Instant::now();
            let end = self.one(first).unwrap_or_else(|e| End::Lost(format!("can't be started: {e}")));
            self.link.disconnect();
            self.inlets.forget_peers();
            let reason = match end {
                End::Left => return,
                End::Refused(reason) | End::Lost(reason) => reason,
            };
            if let Some(first) = first.take() {
                // Fails only if the node has given up.
                let _ = first.send(Err(reason));
                return;
            }
            self.health.lost(&reason);
            if let Some(held) = complaints.pass() {
                let more = if held > 0 { format!(" ({held} more since the last such message)") } else { String::new() };
                tracing::error!("the middleware process {reason}: it is replaced, the node's state is kept{more}");
            }
            pause = if begun.elapsed() > SOUND { PAUSES[0] } else { (2 * pause).min(PAUSES[1]) };
            if begun.elapsed() <= SOUND && self.rests(pause) {
                return;
            }
        }
    }

    /// Waits; true if the node leaves meanwhile.
    fn rests(&mut self, pause: Duration) -> bool {
        let until = Instant::now() + pause;
        while !self.link.is_stopped() && Instant::now() < until {
            poll([(&self.woken, PollFlags::IN)], until - Instant::now());
            self.drain_nudges();
        }
        self.link.is_stopped()
    }

    /// One process from its start to its end.
    fn one(&mut self, first: &mut First) -> io::Result<End> {
        let (socket, theirs) = UnixStream::pair()?;
        socket.set_nonblocking(true)?;
        let child = Process(launch(self.program.as_deref(), theirs.into())?);
        let mut frame = Vec::new();
        Head::new(Kind::Plan)
            .frame(&mut frame, |b| serde_json::to_writer(b, &self.plan).map_err(|e| e.to_string()))
            .map_err(io::Error::other)?;
        io::Write::write_all(&mut &socket, &frame)?;
        self.said = None;
        let mut frames = Frames::new();
        let end = self.attend(child.0.id(), &socket, &mut frames, first)?;
        if matches!(end, End::Left) {
            self.link.disconnect();
            say_goodbye(&socket);
        }
        Ok(match (end, child.end(if self.link.is_stopped() { LEAVE } else { REST })) {
            (End::Lost(reason), status) => End::Lost(self.said.take().unwrap_or_else(|| why(reason, status))),
            (other, _) => other,
        })
    }

    /// Hands on what the process says until it ends or falls silent, or the node leaves.
    fn attend(&mut self, pid: u32, socket: &UnixStream, frames: &mut Frames, first: &mut First) -> io::Result<End> {
        let (mut ready, mut silence) = (false, Silence::new(Instant::now()));
        loop {
            let more = self.link.flush();
            let interest = if more { PollFlags::IN | PollFlags::OUT } else { PollFlags::IN };
            poll([(socket, interest), (&self.woken, PollFlags::IN)], silence.left(Instant::now()));
            let patience = match (ready, first.is_some()) {
                (true, _) => SILENT_LOOKS,
                (false, first) => STARTING_LOOKS[usize::from(!first)],
            };
            let silent = silence.looks;
            if silent >= STOPPED_LOOKS && is_stopped(pid) {
                return Ok(End::Lost("is stopped (SIGSTOP, or a debugger)".to_owned()));
            }
            if silent >= patience {
                return Ok(End::Lost("gives no sign of life".to_owned()));
            }
            self.drain_nudges();
            if self.link.is_stopped() {
                self.flush_all(socket);
                return Ok(End::Left);
            }
            let read = frames.read(socket);
            silence.look(read.is_ok(), Instant::now());
            match read {
                Ok(0) => return Ok(End::Lost("has ended".to_owned())),
                Ok(_) => {}
                Err(e) if [io::ErrorKind::WouldBlock, io::ErrorKind::Interrupted].contains(&e.kind()) => continue,
                Err(e) if e.kind() == io::ErrorKind::ConnectionReset => return Ok(End::Lost("has ended".to_owned())),
                Err(e) => return Err(e),
            }
            while let Some((head, body)) = frames.next()? {
                match head.kind {
                    Kind::Message => self.inlets.put(&head, body),
                    Kind::Request | Kind::Response => {
                        self.inlets.put(&head, body);
                        self.link.bell.ring();
                    }
                    Kind::Ready => {
                        ready = true;
                        self.plan.predecessor = head.stamp.first_chunk().copied();
                        self.link.connect(socket.try_clone()?);
                        self.back(first);
                    }
                    Kind::Refused => return Ok(End::Refused(text(body))),
                    Kind::Farewell => self.said = Some(text(body)),
                    Kind::Matched => self.note(&head, body),
                    Kind::Failed => self.failed(&head),
                    Kind::Log => relay(head.flag, &text(body)),
                    Kind::Pulse => self.plan.hears |= head.flag != 0,
                    Kind::Plan => {}
                }
            }
        }
    }

    /// What was said before the leave still goes out.
    fn flush_all(&self, socket: &UnixStream) {
        let until = Instant::now() + REST;
        while self.link.flush() && Instant::now() < until {
            poll([(socket, PollFlags::OUT)], REST);
        }
    }

    fn back(&self, first: &mut First) {
        if let Some(first) = first.take() {
            // Fails only if the node has given up.
            let _ = first.send(Ok(()));
        }
        if let Some(apart) = self.health.back() {
            tracing::info!(
                "a new middleware process is ready after {:.3} s; what was said to this node meanwhile is missed",
                apart.as_secs_f64()
            );
        }
    }

    fn note(&self, head: &Head, body: &[u8]) {
        if let (Some(inlet), Ok(count)) = (self.inlets.get(head.endpoint), body.try_into()) {
            inlet.matched.store(u32::from_ne_bytes(count) as usize, Ordering::Relaxed);
        }
    }

    fn failed(&self, head: &Head) {
        if let Some(inlet) = self.inlets.get(head.endpoint) {
            inlet.failed.fetch_add(1, Ordering::Relaxed);
        }
    }

    fn drain_nudges(&mut self) {
        let mut nudges = [0; 64];
        while io::Read::read(&mut self.woken, &mut nudges).is_ok_and(|n| n == nudges.len()) {}
    }
}

/// A process that is killed and waited for when it is dropped.
struct Process(Child);

impl Process {
    /// Its status, if it ends by itself in time.
    fn end(mut self, patience: Duration) -> Option<ExitStatus> {
        let begun = Instant::now();
        while begun.elapsed() < patience {
            if let Ok(Some(status)) = self.0.try_wait() {
                return Some(status);
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        None
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        if !matches!(self.0.try_wait(), Ok(Some(_))) {
            // Both fail only if it has just ended by itself.
            let _ = self.0.kill();
            let _ = self.0.wait();
        }
    }
}

/// Starts this same program, even if its file has been replaced since, or another one.
fn launch(program: Option<&Path>, socket: OwnedFd) -> io::Result<Child> {
    #[cfg(target_os = "linux")]
    let own = PathBuf::from("/proc/self/exe");
    #[cfg(not(target_os = "linux"))]
    let own = std::env::current_exe()?;
    let mut command = Command::new(program.unwrap_or(&own));
    if let Some(name) = std::env::args_os().next() {
        command.arg0(name);
    }
    command.arg(ARGUMENT).stdin(Stdio::from(socket)).stdout(Stdio::null()).spawn()
}

/// Whether a process is stopped; where the system does not show it, none is.
fn is_stopped(pid: u32) -> bool {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    // The name before it may hold anything.
    stat.rsplit_once(") ").is_some_and(|(_, rest)| rest.starts_with(['T', 't']))
}

fn say_goodbye(socket: &UnixStream) {
    // Fails only if it is gone already.
    let _ = socket.shutdown(std::net::Shutdown::Write);
    // a process that still writes to the socket must not block
    let _ = socket.set_nonblocking(false);
    let _ = socket.set_read_timeout(Some(LEAVE));
    let (mut rest, until) = (Frames::new(), Instant::now() + LEAVE);
    while Instant::now() < until && rest.read(socket).is_ok_and(|n| n > 0) {
        while rest.next().is_ok_and(|frame| frame.is_some()) {}
    }
}

fn why(reason: String, status: Option<ExitStatus>) -> String {
    match status.map(|s| (s.signal(), s.code())) {
        Some((Some(n), _)) if n == Signal::ABORT.as_raw() => {
            "has failed (most likely it has reached middleware_memory_mib)".to_owned()
        }
        Some((Some(n), _)) if n == Signal::KILL.as_raw() => {
            "was killed (by somebody, or for want of memory)".to_owned()
        }
        Some((Some(n), _)) => format!("was ended by signal {n}"),
        Some((None, Some(code))) => format!("has ended with exit code {code}"),
        _ => reason,
    }
}

fn text(body: &[u8]) -> String {
    String::from_utf8_lossy(body).into_owned()
}

/// A line of the process as a line of the node: its target stands in the first line of the body, or nothing if it is
/// the node's own.
fn relay(level: u8, body: &str) {
    let (target, message) = body.split_once('\n').unwrap_or(("", body));
    match (target, level) {
        ("", 1) => return tracing::error!("{message}"),
        ("", 2) => return tracing::warn!("{message}"),
        ("", _) => return tracing::info!("{message}"),
        _ => {}
    }
    let level = match level {
        1 => log::Level::Error,
        2 => log::Level::Warn,
        3 => log::Level::Info,
        4 => log::Level::Debug,
        _ => log::Level::Trace,
    };
    log::logger().log(&log::Record::builder().level(level).target(target).args(format_args!("{message}")).build());
}

/// Waits until something can be done with one of the sockets; false if nothing could in time.
fn poll<const N: usize>(sockets: [(&UnixStream, PollFlags); N], patience: Duration) -> bool {
    let mut entries = sockets.map(|(socket, interest)| PollFd::new(socket, interest));
    // an interrupted wait does not count as silence
    !matches!(rustix::event::poll(&mut entries, Timespec::try_from(patience).ok().as_ref()), Ok(0))
}
