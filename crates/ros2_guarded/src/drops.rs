//! Datagrams that readers on this machine lose: the system counts them at each socket whose receive buffer was full.
//!
//! RustDDS tells nobody what a reader asks to have again, and a best-effort reader asks for nothing. The kernel's count
//! (`/proc/net/udp`, last column) knows of both, for every program in this network namespace.

use std::collections::BTreeMap;
use std::fs;
use std::time::{Duration, Instant};

/// How often the system's count is looked at while large messages go out.
const EVERY: Duration = Duration::from_secs(5);
/// How long nothing is said after something was.
const QUIET: Duration = Duration::from_secs(60);

/// Watches the sockets of this machine.
pub(super) struct Drops {
    before: BTreeMap<u16, u64>,
    looked: Instant,
    said: Option<Instant>,
    lost: u64,
}

impl Drops {
    pub(super) fn new() -> Self {
        Self { before: counted(), looked: Instant::now(), said: None, lost: 0 }
    }

    /// What to say about the time since the last look, if it is time for one and something was lost.
    pub(super) fn notice(&mut self) -> Option<String> {
        if self.looked.elapsed() < EVERY {
            return None;
        }
        self.looked = Instant::now();
        let (lost, port) = self.look();
        self.lost += lost;
        if lost == 0 || self.said.is_some_and(|said| said.elapsed() < QUIET) {
            return None;
        }
        self.said = Some(Instant::now());
        Some(format!(
            "{} datagrams were lost on this machine while large messages went out, since a receive buffer was full (UDP port {port}; `ss -ulnp` \
             says whose): that reader is too slow for what it subscribes to, or needs a larger buffer (Fast DDS: \
             FASTDDS_DEFAULT_PROFILES_FILE naming share/needle_twin/fast_dds.xml; Cyclone: Internal/SocketReceiveBufferSize)",
            std::mem::take(&mut self.lost)
        ))
    }

    /// Datagrams lost since the look before, and the port that lost most of them.
    fn look(&mut self) -> (u64, u16) {
        let now = counted();
        // a port that was not there before has its whole count from since then
        let lost = now.iter().map(|(port, n)| (n.saturating_sub(self.before.get(port).copied().unwrap_or(0)), *port));
        let (sum, worst) = lost.fold((0, (0, 0)), |(sum, worst), one| (sum + one.0, worst.max(one)));
        self.before = now;
        (sum, worst.1)
    }
}

/// Datagrams lost so far by the sockets of each port; nothing where the system doesn't say.
fn counted() -> BTreeMap<u16, u64> {
    let mut by_port = BTreeMap::new();
    for table in ["/proc/net/udp", "/proc/net/udp6"] {
        for line in fs::read_to_string(table).unwrap_or_default().lines() {
            if let Some((port, drops)) = socket(line) {
                *by_port.entry(port).or_insert(0) += drops;
            }
        }
    }
    by_port
}

/// Port and lost datagrams of a line of that table: `sl local_address rem_address ... drops`, the address in hexadecimal.
fn socket(line: &str) -> Option<(u16, u64)> {
    let port = line.split_whitespace().nth(1)?.rsplit(':').next()?;
    let drops = line.split_whitespace().last()?;
    Some((u16::from_str_radix(port, 16).ok()?, drops.parse().ok()?))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use std::net::UdpSocket;

    #[test]
    fn a_reader_that_takes_nothing_out_of_its_buffer_is_seen() {
        let reader = UdpSocket::bind("127.0.0.1:0").unwrap();
        let port = reader.local_addr().unwrap().port();
        let before = counted().get(&port).copied().unwrap();
        let mut drops = Drops::new();
        let writer = UdpSocket::bind("127.0.0.1:0").unwrap();
        for _ in 0..4000 {
            writer.send_to(&[0; 1400], reader.local_addr().unwrap()).unwrap();
        }
        let lost = counted().get(&port).copied().unwrap() - before;
        assert!(lost > 100, "{lost} of 4000 datagrams of 1400 bytes lost in a buffer that is 212,992 bytes by default");
        let (seen, _) = drops.look();
        assert!(seen >= lost, "{seen} seen of {lost}");
    }

    #[test]
    fn it_is_said_once_and_with_what_came_in_between() {
        let Some(long_ago) = Instant::now().checked_sub(Duration::from_secs(10)) else { return };
        let reader = UdpSocket::bind("127.0.0.1:0").unwrap();
        let mut drops = Drops::new();
        let writer = UdpSocket::bind("127.0.0.1:0").unwrap();
        let flood = || {
            for _ in 0..4000 {
                writer.send_to(&[0; 1400], reader.local_addr().unwrap()).unwrap();
            }
        };
        flood();
        drops.looked = long_ago;
        let said = drops.notice().unwrap();
        assert!(said.contains("datagrams were lost") && said.contains("fast_dds.xml"), "{said}");
        flood();
        drops.looked = long_ago;
        assert!(drops.notice().is_none(), "said again within a minute");
        assert!(drops.lost > 100, "{} kept for the next time", drops.lost);
    }
}
