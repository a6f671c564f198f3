//! Asks a caller on Fast DDS for what it said before it was known here.
//!
//! A caller sends its call as soon as it knows the server; the server may not know the caller yet, and drops the call. When it does, RustDDS
//! 0.15.1 asks for what it has missed with an ACKNACK whose base is 1, upon which Fast DDS (2.14: `StatefulWriter::process_acknack`)
//! begins to wait for its heartbeat period of 3 s. It answers at once one whose base is 0, as its own readers send it: this sends one.

use std::io;
use std::net::{Ipv4Addr, UdpSocket};

use ros2_client::dds::rustdds::GUID;

use super::obituary::NUMBERS;

/// The number behind that of RustDDS's own first ACKNACK, which is 0. Of two with one number the second is not read: RustDDS's second one,
/// the answer to the heartbeat that this one brings.
const COUNT: u32 = 1;

/// Sends it to every participant of this machine; only that of `caller` reads it.
///
/// # Errors
/// If there is no socket; a peer that can't be reached is none.
pub(super) fn ask(reader: GUID, caller: GUID, domain: u16) -> io::Result<()> {
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?;
    let packet = packet(reader.to_bytes(), caller.to_bytes());
    // RTPS 9.6.2.3: port of a participant's own endpoints
    let first = 7411_u16.wrapping_add(domain.wrapping_mul(250));
    (0..NUMBERS).for_each(|n| drop(socket.send_to(&packet, (Ipv4Addr::LOCALHOST, first.wrapping_add(2 * n)))));
    Ok(())
}

/// The message: header, INFO_DST, ACKNACK (RTPS 9.4.5.9, 9.4.5.3), little-endian, not final: it wants an answer.
fn packet(reader: [u8; 16], caller: [u8; 16]) -> Vec<u8> {
    const INFO_DST: [u8; 4] = [0x0e, 1, 12, 0];
    const ACKNACK: [u8; 4] = [0x06, 1, 24, 0];
    let ((from, reader), (to, writer)) = (reader.split_at(12), caller.split_at(12));
    // as RustDDS's own messages begin; a base of 0 and a set of no numbers
    [&b"RTPS\x02\x04\x01\x12"[..], from, &INFO_DST, to, &ACKNACK, reader, writer, &[0; 12], &COUNT.to_le_bytes()]
        .concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_packet_has_its_declared_lengths() {
        let packet = packet([7; 16], [9; 16]);
        assert_eq!(packet.len(), 20 + (4 + 12) + (4 + 24));
        assert_eq!((packet[22], packet[38]), (12, 24));
        assert_eq!(packet[40..48], [7, 7, 7, 7, 9, 9, 9, 9]);
    }
}
