//! Makes RustDDS ask a caller on Fast DDS at once for the call that came before the caller was known.
//!
//! Such a call is dropped. When RustDDS has matched the caller's writer it asks for nothing in particular (an ACKNACK with base 1 and an
//! empty set), upon which Fast DDS starts its heartbeat's time of 3 s anew. A HEARTBEAT that says that the writer has its message 1
//! makes RustDDS ask for that message, and Fast DDS sends it. This process says so to its own port, in the writer's name; the writer's
//! own count goes on from there (`docs/lab/upstream/rustdds.md`, 10).

use std::io;
use std::net::{Ipv4Addr, UdpSocket};

use ros2_client::dds::rustdds::GUID;

/// Speaks to RustDDS's own port.
pub(super) struct Prompt {
    socket: UdpSocket,
}

impl Prompt {
    /// `port`: where RustDDS hears what is for the participant.
    ///
    /// # Errors
    /// If there is no socket.
    pub(crate) fn new(port: u16) -> io::Result<Self> {
        let from = |own: Ipv4Addr| -> io::Result<Self> {
            let socket = UdpSocket::bind((own, 0))?;
            // not with the address of a card that is down
            socket.connect((own, port))?;
            Ok(Self { socket })
        };
        // RustDDS takes a peer that speaks from the loopback's address for one on this machine.
        let cards = own_addresses::get_interfaces().into_iter().filter(|card| !card.is_loopback());
        let own = cards.filter_map(|card| card.ipv4).find_map(|own| from(own.addr()).ok());
        own.map_or_else(|| from(Ipv4Addr::LOCALHOST), Ok)
    }

    /// Has `reader` ask `writer` for its first message.
    pub(crate) fn ask(&self, reader: GUID, writer: GUID) {
        // fails only where sockets do
        let _ = self.socket.send(&heartbeat(reader.to_bytes(), writer.to_bytes()));
    }
}

/// A message from `writer`'s participant: INFO_DST and HEARTBEAT (RTPS 2.5, 9.4.5.8 and 9.4.5.7), messages 1 to 1, count 1, an answer
/// is wanted.
fn heartbeat(reader: [u8; 16], writer: [u8; 16]) -> Vec<u8> {
    const INFO_DST: u8 = 0x0e;
    const HEARTBEAT: u8 = 0x07;
    const LITTLE_ENDIAN: u8 = 0x01;
    const ONE: [u8; 8] = [0, 0, 0, 0, 1, 0, 0, 0];
    [
        // version 2.3 of Fast DDS, whose vendor's number begins its GUIDs
        &b"RTPS\x02\x03"[..],
        &writer[..2],
        &writer[..12],
        &[INFO_DST, LITTLE_ENDIAN, 12, 0],
        &reader[..12],
        &[HEARTBEAT, LITTLE_ENDIAN, 28, 0],
        &reader[12..],
        &writer[12..],
        &ONE,
        &ONE,
        &1_u32.to_le_bytes(),
    ]
    .concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lengths_in_the_packet_are_its_own() {
        let packet = heartbeat([1; 16], [2; 16]);
        let (header, to, beat) = (&packet[..20], &packet[20..36], &packet[36..]);
        assert_eq!((header.len(), to.len() - 4, beat.len() - 4), (20, usize::from(to[2]), usize::from(beat[2])));
    }
}
