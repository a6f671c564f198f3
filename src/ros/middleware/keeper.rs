//! Starts the middleware process, hands on what it says, and replaces it when it dies or falls silent.

use std::io;
use std::os::fd::{AsRawFd, OwnedFd, RawFd};
use std::os::unix::net::UnixStream;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crossbeam_channel::Sender;

use super::ARGUMENT;
use super::link::{Inlets, Link};
use super::wire::{Frames, Head, Kind, Plan};
use crate::ros::logging::Throttle;
use crate::ros::messages::diagnostic_msgs::{DiagnosticStatus, KeyValue};
use crate::ros::start::NodeError;
use crate::ros::threads::{join, spawn};

/// Time between two looks at a silent socket.
const LOOK: Duration = Duration::from_millis(100);
/// Looks in a row that find nothing, not even a pulse: the process is stopped or stuck.
const SILENT_LOOKS: u32 = 10;
/// The same before the process has said that it is ready: a machine may be busy.
const STARTING_LOOKS: u32 = 200;
/// A process that has lived so long is replaced at once.
const SOUND: Duration = Duration::from_secs(5);
/// Shortest and longest wait before the next one otherwise.
const PAUSES: [Duration; 2] = [Duration::from_millis(50), Duration::from_secs(1)];
/// Time for a clean leave.
const LEAVE: Duration = Duration::from_secs(2);
/// A replacement is news for so long.
const NEWS: Duration = Duration::from_secs(10);
/// Longest silence about processes that end one after the other.
const COMPLAINTS: Duration = Duration::from_secs(10);

/// How it goes with the middleware, for people.
#[derive(Debug, Default)]
pub(in crate::ros) struct Health {
    replaced: AtomicU64,
    overrun: Arc<AtomicU64>,
    last: Mutex<Option<Replacement>>,
}

/// The last replacement.
#[derive(Clone, Debug)]
struct Replacement {
    /// Why, in words that follow "the middleware process".
    reason: String,
    /// When the process was noticed to be gone.
    lost: Instant,
    /// When the next one was ready; `None` if it is not yet.
    back: Option<Instant>,
}

impl Health {
    /// Why the process was replaced, as long as that is worth a warning.
    pub fn trouble(&self) -> Option<String> {
        self.last().filter(|last| last.back.is_none_or(|back| back.elapsed() < NEWS)).map(|last| last.reason)
    }

    /// Level, message and values for `/diagnostics`.
    pub fn describe(&self) -> (u8, String, Vec<KeyValue>) {
        let value = |key: &str, value: String| KeyValue { key: key.to_owned(), value };
        let mut values = vec![
            value("replaced", self.replaced.load(Ordering::Relaxed).to_string()),
            value("not taken in time", self.overrun.load(Ordering::Relaxed).to_string()),
        ];
        if let Some(last) = self.last() {
            values.push(value("last replaced because it", last.reason));
            let apart = last.back.map(|back| (back - last.lost).as_secs_f64());
            values.extend(apart.map(|s| value("time without it (s)", format!("{s:.3}"))));
        }
        match self.trouble() {
            Some(reason) => (DiagnosticStatus::WARN, format!("the middleware process {reason}: it was replaced"), values),
            None => (DiagnosticStatus::OK, "OK".to_owned(), values),
        }
    }

    /// The last replacement.
    fn last(&self) -> Option<Replacement> {
        self.last.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn set(&self, last: Replacement) {
        *self.last.lock().unwrap_or_else(PoisonError::into_inner) = Some(last);
    }
}

/// The thread that minds the process; dropping it leaves the network.
pub(in crate::ros) struct Middleware {
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
        plan: &Plan,
        program: Option<PathBuf>,
        inlets: Inlets,
        link: Arc<Link>,
        woken: UnixStream,
    ) -> Result<Self, NodeError> {
        let plan = serde_json::to_vec(plan).map_err(|e| NodeError::Other(format!("the middleware's plan: {e}")))?;
        let health = Arc::new(Health { overrun: Arc::clone(&inlets.overrun), ..Health::default() });
        let (first, ready) = crossbeam_channel::bounded(1);
        let mut keeper =
            Keeper { plan, program, inlets, link: Arc::clone(&link), woken, health: Arc::clone(&health), said: None };
        let mut first = Some(first);
        // The process dies with the thread that starts it, so that it can't outlive a node that was killed.
        let thread = spawn("middleware", move || keeper.run(&mut first))?;
        let middleware = Self { link, health, thread: Some(thread) };
        match ready.recv() {
            Ok(Ok(())) => Ok(middleware),
            Ok(Err(reason)) => Err(NodeError::Other(reason)),
            Err(_) => Err(NodeError::Other("the middleware thread has ended unexpectedly".to_owned())),
        }
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
    plan: Vec<u8>,
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
            let ongoing = self.health.last().filter(|last| last.back.is_none());
            if ongoing.is_none() {
                self.health.replaced.fetch_add(1, Ordering::Relaxed);
            }
            let lost = ongoing.map_or_else(Instant::now, |last| last.lost);
            if let Some(held) = complaints.pass() {
                let more = if held > 0 { format!(" ({held} more since the last such message)") } else { String::new() };
                tracing::error!("the middleware process {reason}: it is replaced, the node's state is kept{more}");
            }
            self.health.set(Replacement { reason, lost, back: None });
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
            poll(&mut [(self.woken.as_raw_fd(), libc::POLLIN)], until - Instant::now());
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
            .frame(&mut frame, |b| {
                b.extend(&self.plan);
                Ok(())
            })
            .map_err(io::Error::other)?;
        io::Write::write_all(&mut &socket, &frame)?;
        self.said = None;
        let mut frames = Frames::new();
        let end = self.attend(&socket, &mut frames, first)?;
        if matches!(end, End::Left) {
            self.link.disconnect();
            say_goodbye(&socket);
        }
        Ok(match (end, child.end(if self.link.is_stopped() { LEAVE } else { LOOK })) {
            (End::Lost(reason), status) => End::Lost(self.said.take().unwrap_or_else(|| why(reason, status))),
            (other, _) => other,
        })
    }

    /// Hands on what the process says until it ends or falls silent, or the node leaves.
    fn attend(&mut self, socket: &UnixStream, frames: &mut Frames, first: &mut First) -> io::Result<End> {
        let (mut ready, mut silent) = (false, 0);
        loop {
            let more = self.link.flush();
            let interest = if more { libc::POLLIN | libc::POLLOUT } else { libc::POLLIN };
            let mut sockets = [(socket.as_raw_fd(), interest), (self.woken.as_raw_fd(), libc::POLLIN)];
            // Looks are counted and not time: a node that was stopped itself must not take its own sleep for silence.
            silent = if poll(&mut sockets, LOOK) { 0 } else { silent + 1 };
            if silent >= if ready { SILENT_LOOKS } else { STARTING_LOOKS } {
                return Ok(End::Lost("gives no sign of life".to_owned()));
            }
            self.drain_nudges();
            if self.link.is_stopped() {
                self.flush_all(socket);
                return Ok(End::Left);
            }
            match frames.read(socket) {
                Ok(0) => return Ok(End::Lost("has ended".to_owned())),
                Ok(_) => {}
                Err(e) if [io::ErrorKind::WouldBlock, io::ErrorKind::Interrupted].contains(&e.kind()) => continue,
                Err(e) if e.kind() == io::ErrorKind::ConnectionReset => return Ok(End::Lost("has ended".to_owned())),
                Err(e) => return Err(e),
            }
            while let Some((head, body)) = frames.next()? {
                match head.kind {
                    Kind::Message | Kind::Request | Kind::Response => self.inlets.put(&head, body),
                    Kind::Ready => {
                        ready = true;
                        self.link.connect(socket.try_clone()?);
                        self.back(first);
                    }
                    Kind::Refused => return Ok(End::Refused(text(body))),
                    Kind::Farewell => self.said = Some(text(body)),
                    Kind::Matched => self.note(&head, body),
                    Kind::Failed => self.failed(&head),
                    Kind::Log => relay(head.flag, &text(body)),
                    Kind::Plan | Kind::Pulse => {}
                }
            }
        }
    }

    /// What was said before the leave still goes out.
    fn flush_all(&self, socket: &UnixStream) {
        let until = Instant::now() + LOOK;
        while self.link.flush() && Instant::now() < until {
            poll(&mut [(socket.as_raw_fd(), libc::POLLOUT)], LOOK);
        }
    }

    fn back(&self, first: &mut First) {
        if let Some(first) = first.take() {
            // Fails only if the node has given up.
            let _ = first.send(Ok(()));
        }
        if let Some(last) = self.health.last().filter(|last| last.back.is_none()) {
            tracing::info!(
                "a new middleware process is ready after {:.3} s; what was said to this node meanwhile is missed",
                last.lost.elapsed().as_secs_f64()
            );
            self.health.set(Replacement { back: Some(Instant::now()), ..last });
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

fn say_goodbye(socket: &UnixStream) {
    // Fails only if it is gone already.
    let _ = socket.shutdown(std::net::Shutdown::Write);
    // Who still has something to say must not be stuck with it.
    let _ = socket.set_nonblocking(false);
    let _ = socket.set_read_timeout(Some(LEAVE));
    let (mut rest, until) = (Frames::new(), Instant::now() + LEAVE);
    while Instant::now() < until && rest.read(socket).is_ok_and(|n| n > 0) {
        while rest.next().is_ok_and(|frame| frame.is_some()) {}
    }
}

fn why(reason: String, status: Option<ExitStatus>) -> String {
    match status.map(|s| (s.signal(), s.code())) {
        Some((Some(libc::SIGABRT), _)) => "has failed (most likely it has reached middleware_memory_mib)".to_owned(),
        Some((Some(libc::SIGKILL), _)) => "was killed (by somebody, or for want of memory)".to_owned(),
        Some((Some(signal), _)) => format!("was ended by signal {signal}"),
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
fn poll(sockets: &mut [(RawFd, libc::c_short)], patience: Duration) -> bool {
    let mut entries: Vec<libc::pollfd> =
        sockets.iter().map(|(fd, events)| libc::pollfd { fd: *fd, events: *events, revents: 0 }).collect();
    let millis = libc::c_int::try_from(patience.as_millis()).unwrap_or(libc::c_int::MAX);
    // SAFETY: the entries live as long as the call, and their number is theirs.
    let ready = unsafe { libc::poll(entries.as_mut_ptr(), entries.len() as libc::nfds_t, millis) };
    // An interruption is no silence.
    ready != 0
}
