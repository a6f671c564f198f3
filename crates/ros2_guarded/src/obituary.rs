//! Tells peers that the participant of a process that was killed is gone.
//!
//! Who leaves cleanly says so by disposing of its entry in the discovery (RTPS 2.5, 8.5.3.2: SPDP, a DATA whose status is disposed and
//! unregistered). Who is killed does not, and peers list it until its lease of 50 s ends. The next process says it in its place.

use std::io;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};

/// First bytes of a participant's GUID.
pub(super) type Prefix = [u8; 12];

/// RTPS 9.6.2.3: port of the discovery's multicast, 7400 + 250 domain, and of a participant's own, 10 + 2 number above it.
const PORTS: [u16; 4] = [7400, 250, 10, 2];
/// RTPS 9.6.2.4.1.
const GROUP: Ipv4Addr = Ipv4Addr::new(239, 255, 0, 1);
/// Participants of one machine that are told: as many as rmw_cyclonedds looks for.
const NUMBERS: u16 = 33;
/// A number beyond those of the messages that the participant has sent, one every ten seconds.
const LATE: u32 = 1 << 30;

/// Sends it to every participant of this machine, and where not `localhost` to the network.
///
/// # Errors
/// If there is no socket; a peer that can't be reached is none.
pub(super) fn announce(prefix: Prefix, domain: u16, localhost: bool) -> io::Result<()> {
    let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?;
    let packet = packet(prefix);
    let [first, per_domain, own, step] = PORTS;
    let group = first.wrapping_add(per_domain.wrapping_mul(domain));
    let here = (0..NUMBERS).map(|n| SocketAddr::from((Ipv4Addr::LOCALHOST, group.wrapping_add(own + step * n))));
    let there = (!localhost).then(|| SocketAddr::from((GROUP, group)));
    here.chain(there).for_each(|to| drop(socket.send_to(&packet, to)));
    Ok(())
}

/// The message: header, and DATA of the discovery's writer with the participant as its key (RTPS 9.4.5.3, 9.6.3).
fn packet(prefix: Prefix) -> Vec<u8> {
    const DATA: u8 = 0x15;
    /// Little-endian, inline QoS, payload is the key.
    const FLAGS: u8 = 0x01 | 0x02 | 0x08;
    /// The discovery's writer and reader of participants, and a participant itself.
    const WRITER: [u8; 4] = [0, 1, 0, 0xc2];
    const READER: [u8; 4] = [0, 1, 0, 0xc7];
    const PARTICIPANT: [u8; 4] = [0, 0, 1, 0xc1];
    const END: [u8; 4] = [1, 0, 0, 0];
    let guid = [&prefix[..], &PARTICIPANT].concat();
    let body = [
        // extra flags, octets to the inline QoS
        &[0, 0, 16, 0][..],
        &READER,
        &WRITER,
        &[0; 4],
        &LATE.to_le_bytes(),
        // PID_KEY_HASH; PID_STATUS_INFO: disposed, unregistered
        &[0x70, 0, 16, 0],
        &guid,
        &[0x71, 0, 4, 0, 0, 0, 0, 3],
        &END,
        // PL_CDR_LE; PID_PARTICIPANT_GUID
        &[0, 3, 0, 0, 0x50, 0, 16, 0],
        &guid,
        &END,
    ]
    .concat();
    // as RustDDS's own messages begin
    let header = [&b"RTPS\x02\x04\x01\x12"[..], &prefix].concat();
    let length = u16::try_from(body.len()).unwrap_or(0);
    [&header[..], &[DATA, FLAGS], &length.to_le_bytes(), &body].concat()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn the_packet_has_its_declared_length() {
        let packet = packet([7; 12]);
        assert_eq!(usize::from(u16::from_le_bytes([packet[22], packet[23]])), packet.len() - 24);
        assert_eq!(packet.len() % 4, 0);
        assert_eq!(packet.windows(12).filter(|w| *w == [7; 12]).count(), 3);
    }
}
