//! The node's end of the socket to its middleware process: what is said goes out at once and never waits, what comes
//! lies in bounded queues.

use std::collections::{BTreeMap, VecDeque};
use std::io::{self, Write};
use std::os::unix::net::UnixStream;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use smol::channel::{Receiver, Sender};

use super::wire::{Guid, Head, Kind, Stamp, times, wall_nanos};
use crate::bell::Bell;

/// Bytes that may wait while the process is busy: a burst, not a stream.
const WAITING: usize = 8 << 20;
/// Bytes that may lie in the queues of all endpoints together.
const QUEUED: usize = 256 << 20;
/// Messages that a queue of any depth may hold.
const DEEPEST: usize = 65_536;

/// Why something was not sent.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unsent {
    /// There is no process at present.
    #[error("the middleware process is being replaced")]
    Apart,
    /// It is too far behind.
    #[error("the middleware process is behind")]
    Behind,
    /// The message can't be written.
    #[error("{0}")]
    Unwritable(String),
}

/// What a queue holds: the frame without its length.
pub struct Delivery {
    /// Times of a message, or who asked.
    pub stamp: Stamp,
    /// Byte order of the body.
    pub big_endian: bool,
    /// CDR without its encapsulation header.
    pub body: Vec<u8>,
}

/// The process's side of one endpoint.
pub(super) struct Inlet {
    queue: Option<Sender<Delivery>>,
    pub matched: Arc<AtomicUsize>,
    pub failed: Arc<AtomicU64>,
}

/// The node's side of one endpoint. A clone takes from the same queue.
#[derive(Clone)]
pub struct Mailbox {
    queue: Receiver<Delivery>,
    bytes: Arc<AtomicUsize>,
}

impl Mailbox {
    /// The next message that has come.
    pub fn take(&self) -> Option<Delivery> {
        self.queue.try_recv().ok().map(|delivery| self.off(delivery))
    }

    /// Waits for the next message; for ever once the node has left.
    pub async fn next(&self) -> Delivery {
        match self.queue.recv().await {
            Ok(delivery) => self.off(delivery),
            Err(_) => std::future::pending().await,
        }
    }

    fn off(&self, delivery: Delivery) -> Delivery {
        self.bytes.fetch_sub(delivery.body.len(), Ordering::Relaxed);
        delivery
    }
}

/// The queues of a node's endpoints.
#[derive(Default)]
pub struct Inlets {
    all: Vec<Inlet>,
    bytes: Arc<AtomicUsize>,
    /// Messages that a full queue has lost.
    pub overrun: Arc<AtomicU64>,
}

impl Inlets {
    /// One that nothing comes to.
    pub fn mute(&mut self, matched: &Arc<AtomicUsize>, failed: &Arc<AtomicU64>) {
        self.all.push(Inlet { queue: None, matched: Arc::clone(matched), failed: Arc::clone(failed) });
    }

    /// One that holds so many messages, the newest.
    pub fn mailbox(&mut self, depth: usize, matched: &Arc<AtomicUsize>) -> Mailbox {
        let (sender, queue) = smol::channel::bounded(depth.clamp(1, DEEPEST));
        self.all.push(Inlet { queue: Some(sender), matched: Arc::clone(matched), failed: Arc::default() });
        Mailbox { queue, bytes: Arc::clone(&self.bytes) }
    }

    pub(super) fn get(&self, endpoint: u16) -> Option<&Inlet> {
        self.all.get(usize::from(endpoint))
    }

    /// Nobody is matched any more.
    pub(super) fn forget_peers(&self) {
        self.all.iter().for_each(|inlet| inlet.matched.store(0, Ordering::Relaxed));
    }

    /// Hands over what has come; the oldest gives way.
    pub(super) fn put(&self, head: &Head, body: &[u8]) {
        let Some(queue) = self.get(head.endpoint).and_then(|inlet| inlet.queue.as_ref()) else { return };
        if self.bytes.load(Ordering::Relaxed) + body.len() > QUEUED {
            self.overrun.fetch_add(1, Ordering::Relaxed);
            return;
        }
        self.bytes.fetch_add(body.len(), Ordering::Relaxed);
        let delivery = Delivery { stamp: head.stamp, big_endian: head.flag != 0, body: body.to_vec() };
        let displaced = match queue.force_send(delivery) {
            Ok(None) => return,
            Ok(Some(oldest)) => {
                self.overrun.fetch_add(1, Ordering::Relaxed);
                oldest
            }
            // The endpoint is gone: the node is leaving.
            Err(refused) => refused.0,
        };
        self.bytes.fetch_sub(displaced.body.len(), Ordering::Relaxed);
    }
}

/// See the module.
pub struct Link {
    outbox: Mutex<Outbox>,
    /// Wakes who watches the socket.
    wake: UnixStream,
    stopped: AtomicBool,
    /// Rung when a service is called, and when one that was called answers.
    pub bell: Bell,
}

#[derive(Default)]
struct Outbox {
    socket: Option<UnixStream>,
    frame: Vec<u8>,
    /// What the socket had no room for.
    waiting: VecDeque<u8>,
    /// The last message of each endpoint that must reach those who come later.
    latched: BTreeMap<u16, Vec<u8>>,
}

impl Link {
    /// The link, and the socket that tells of work for who watches.
    pub fn new() -> io::Result<(Self, UnixStream)> {
        let (wake, woken) = UnixStream::pair()?;
        wake.set_nonblocking(true)?;
        woken.set_nonblocking(true)?;
        Ok((Self { outbox: Mutex::default(), wake, stopped: AtomicBool::new(false), bell: Bell::default() }, woken))
    }

    fn outbox(&self) -> MutexGuard<'_, Outbox> {
        self.outbox.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn nudge(&self) {
        // Fails only if it is full of nudges already.
        let _ = (&self.wake).write(&[1]);
    }

    /// Says that it is time to leave.
    pub(crate) fn stop(&self) {
        self.stopped.store(true, Ordering::Relaxed);
        self.nudge();
    }

    pub(super) fn is_stopped(&self) -> bool {
        self.stopped.load(Ordering::Relaxed)
    }

    /// Sends a frame whose body `fill` appends; never waits. `latch` keeps it for the next process.
    ///
    /// # Errors
    /// [`Unsent`].
    pub fn send(
        &self,
        head: Head,
        latch: bool,
        fill: impl FnOnce(&mut Vec<u8>) -> Result<(), String>,
    ) -> Result<(), Unsent> {
        // Others send meanwhile: a large message takes longer to write than a small one may wait.
        let mut frame = std::mem::take(&mut self.outbox().frame);
        frame.clear();
        let framed = head.frame(&mut frame, fill);
        let mut outbox = self.outbox();
        let outcome = match framed {
            Err(reason) => Err(Unsent::Unwritable(reason)),
            Ok(()) => {
                if latch {
                    outbox.latched.insert(head.endpoint, frame.clone());
                }
                outbox.put(&frame)
            }
        };
        outbox.frame = frame;
        let late = !outbox.waiting.is_empty();
        drop(outbox);
        if late {
            self.nudge();
        }
        outcome
    }

    /// A process is ready: it gets what those who come later must get, and from now on everything.
    pub(super) fn connect(&self, socket: UnixStream) {
        let mut outbox = self.outbox();
        outbox.socket = Some(socket);
        let latched: Vec<Vec<u8>> = outbox.latched.values().cloned().collect();
        for frame in latched {
            // Fails only if it is gone again, which its end of file tells.
            let _ = outbox.put(&frame);
        }
    }

    /// The process is gone, and what waited with it.
    pub(super) fn disconnect(&self) {
        let mut outbox = self.outbox();
        outbox.socket = None;
        outbox.waiting = VecDeque::new();
    }

    /// Sends what waits, as far as there is room; true if there is more.
    pub(super) fn flush(&self) -> bool {
        self.outbox().flush()
    }
}

impl Outbox {
    fn put(&mut self, frame: &[u8]) -> Result<(), Unsent> {
        let Some(socket) = &mut self.socket else { return Err(Unsent::Apart) };
        let mut sent = 0;
        while self.waiting.is_empty() && sent < frame.len() {
            match socket.write(&frame[sent..]) {
                Ok(n) => sent += n,
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                Err(e) if e.kind() == io::ErrorKind::WouldBlock => break,
                Err(_) => return Err(Unsent::Apart),
            }
        }
        // The rest of a frame that has begun must follow.
        if sent == 0 && self.waiting.len() + frame.len() > WAITING {
            return Err(Unsent::Behind);
        }
        self.waiting.extend(&frame[sent..]);
        Ok(())
    }

    fn flush(&mut self) -> bool {
        let Some(socket) = &mut self.socket else { return false };
        while !self.waiting.is_empty() {
            match socket.write(self.waiting.as_slices().0) {
                Ok(n) => drop(self.waiting.drain(..n)),
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                Err(e) if e.kind() == io::ErrorKind::WouldBlock => return true,
                Err(_) => self.waiting.clear(),
            }
        }
        false
    }
}

/// Appends a message as CDR.
pub fn cdr<M: serde::Serialize>(bytes: &mut Vec<u8>, message: &M) -> Result<(), String> {
    cdr_encoding::to_writer::<M, byteorder::LittleEndian, &mut Vec<u8>>(bytes, message).map_err(|e| e.to_string())
}

/// Head of a message that is published now.
pub fn publication(endpoint: u16) -> Head {
    let now = wall_nanos();
    Head::of(Kind::Message, endpoint, times([now, now], Guid::default()))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::super::frames::Frames;
    use super::*;

    fn bytes(n: usize) -> impl FnOnce(&mut Vec<u8>) -> Result<(), String> {
        move |b| {
            b.resize(b.len() + n, 1);
            Ok(())
        }
    }

    #[test]
    fn a_full_pipe_delays_a_burst_and_refuses_a_stream_and_never_waits() {
        let (link, _woken) = Link::new().unwrap();
        assert_eq!(link.send(publication(0), true, bytes(5)), Err(Unsent::Apart));
        let (ours, theirs) = UnixStream::pair().unwrap();
        ours.set_nonblocking(true).unwrap();
        link.connect(ours);
        let mut sent = 1;
        while link.send(publication(1), false, bytes(1 << 20)).is_ok() {
            sent += 1;
        }
        assert!((8..=12).contains(&sent), "{sent}");
        assert_eq!(link.send(publication(1), false, bytes(1)), Ok(()), "a small one still fits");
        let (mut frames, mut got) = (Frames::new(), Vec::new());
        while got.len() < sent + 1 {
            link.flush();
            frames.read(&theirs).unwrap();
            while let Some((head, body)) = frames.next().unwrap() {
                got.push((head.endpoint, body.len()));
            }
        }
        assert_eq!((got[0], got[1], got[sent]), ((0, 5), (1, 1 << 20), (1, 1)), "what is latched comes first");
    }

    #[test]
    fn a_queue_keeps_the_newest() {
        let mut inlets = Inlets::default();
        let mailbox = inlets.mailbox(2, &Arc::default());
        for i in 0..5_u8 {
            inlets.put(&publication(0), &[i]);
        }
        let kept: Vec<u8> = std::iter::from_fn(|| mailbox.take()).map(|d| d.body[0]).collect();
        assert_eq!((kept, inlets.overrun.load(Ordering::Relaxed)), (vec![3, 4], 3));
        assert_eq!(inlets.bytes.load(Ordering::Relaxed), 0);
    }
}
