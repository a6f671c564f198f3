//! Frames out of what comes over the socket.

use std::io::{self, Read};
use std::os::unix::net::UnixStream;

use super::wire::{HEAD, Head, Kind, LONGEST};

/// Room for some hundred small messages.
pub(super) const BUFFER: usize = 64 << 10;

/// Cuts what is read from a socket into frames.
pub(crate) struct Frames {
    bytes: Vec<u8>,
    from: usize,
    to: usize,
}

impl Frames {
    pub(crate) fn new() -> Self {
        Self { bytes: vec![0; BUFFER], from: 0, to: 0 }
    }

    /// Reads once; 0 is the end.
    pub(crate) fn read(&mut self, mut socket: impl Read) -> io::Result<usize> {
        if self.from > 0 {
            self.bytes.copy_within(self.from..self.to, 0);
            self.to -= self.from;
            self.from = 0;
        }
        if self.to == self.bytes.len() {
            self.bytes.resize(2 * self.to, 0);
        }
        let read = socket.read(&mut self.bytes[self.to..])?;
        self.to += read;
        Ok(read)
    }

    /// The next whole frame.
    ///
    /// # Errors
    /// If what was read is no frame: the other side does not follow the protocol.
    pub(crate) fn next(&mut self) -> io::Result<Option<(Head, &[u8])>> {
        let nonsense = || io::Error::new(io::ErrorKind::InvalidData, "what came is not a frame");
        let bytes = &self.bytes[self.from..self.to];
        let Some(&[a, b, c, d, kind, flag, e, f, ref stamp @ ..]) = bytes.first_chunk::<HEAD>() else {
            return Ok(None);
        };
        let length = u32::from_ne_bytes([a, b, c, d]) as usize;
        if length > LONGEST {
            return Err(nonsense());
        }
        let Some(body) = bytes.get(HEAD..HEAD + length) else { return Ok(None) };
        self.from += HEAD + length;
        let kind = Kind::of(kind).ok_or_else(nonsense)?;
        Ok(Some((Head { kind, flag, endpoint: u16::from_ne_bytes([e, f]), stamp: *stamp }, body)))
    }

    /// Takes every frame, until the other side closes the socket or does not follow the protocol.
    pub(crate) fn take_all(mut self, socket: &UnixStream, mut take: impl FnMut(Head, &[u8])) {
        loop {
            loop {
                match self.next() {
                    Ok(Some((head, body))) => take(head, body),
                    Ok(None) => break,
                    Err(_) => return,
                }
            }
            match self.read(socket) {
                Ok(0) => return,
                Err(e) if e.kind() != io::ErrorKind::Interrupted => return,
                _ => {}
            }
        }
    }
}
