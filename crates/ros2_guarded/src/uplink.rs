//! The middleware process's end of the socket to its node.

use std::io::Write as _;
use std::net::Shutdown;
use std::os::unix::net::UnixStream;
use std::sync::{Mutex, PoisonError};

use super::wire::{Head, Kind};

/// See the module. A node that does not read holds it up, and then the DDS keeps the newest.
pub(super) struct Uplink {
    socket: UnixStream,
    frame: Mutex<Vec<u8>>,
}

impl Uplink {
    pub(crate) fn new(socket: UnixStream) -> Self {
        Self { socket, frame: Mutex::default() }
    }

    /// Waits until the node takes it.
    pub(crate) fn send(&self, head: Head, body: &[u8]) {
        let mut frame = self.frame.lock().unwrap_or_else(PoisonError::into_inner);
        frame.clear();
        let framed = head.frame(&mut frame, |b| {
            b.extend(body);
            Ok(())
        });
        match framed {
            // Fails only when the node is gone, which the end of the socket tells.
            Ok(()) => drop((&self.socket).write_all(&frame)),
            Err(reason) => {
                drop(frame);
                self.log(log::Level::Warn, &format!("a message is not taken: {reason}"));
            }
        }
    }

    /// Ends who reads from the socket.
    pub(crate) fn deafen(&self) {
        // Fails only when the node is gone.
        let _ = self.socket.shutdown(Shutdown::Read);
    }

    /// Something in words.
    pub(crate) fn text(&self, kind: Kind, text: &str) {
        self.send(Head::new(kind), text.as_bytes());
    }

    /// A line of the node's own log.
    pub(crate) fn log(&self, level: log::Level, text: &str) {
        self.send(Head { flag: level as u8, ..Head::new(Kind::Log) }, format!("\n{text}").as_bytes());
    }

    /// A line of the middleware: its level, and its target and text in two lines.
    pub(crate) fn relay(&self, (level, line): (u8, String)) {
        self.send(Head { flag: level, ..Head::new(Kind::Log) }, line.as_bytes());
    }
}
