//! Sockets that hear the loopback only.
//!
//! RustDDS binds each of its sockets to every address of the machine and has no setting for it; `with_only_networks` only says
//! where it joins multicast groups and what it tells others. So whatever another machine sent to those ports would be read.
//! Bound to the device `lo` (SO_BINDTODEVICE, which needs no privilege on a socket that is bound to none), they never see it.

use std::fs;
use std::io;

use rustix::process::{PidfdFlags, PidfdGetfdFlags, getpid, pidfd_getfd, pidfd_open};

/// Device of the loopback.
const DEVICE: &[u8] = b"lo";

/// Binds every internet socket of this process to the loopback device, and says how many there are.
///
/// # Errors
/// If the system lists no open files, or does not let a process at its own sockets or their device.
pub(super) fn confine() -> io::Result<usize> {
    let own = pidfd_open(getpid(), PidfdFlags::empty())?;
    let mut confined = 0;
    for entry in fs::read_dir("/proc/self/fd")? {
        let entry = entry?;
        let is_socket = fs::read_link(entry.path()).is_ok_and(|to| to.to_string_lossy().starts_with("socket:"));
        let (true, Some(number)) = (is_socket, entry.file_name().to_str().and_then(|name| name.parse().ok())) else {
            continue;
        };
        // another number for the same socket, which safe code may have
        let socket = pidfd_getfd(&own, number, PidfdGetfdFlags::empty())?;
        let socket = socket2::SockRef::from(&socket);
        if matches!(socket.domain()?, socket2::Domain::IPV4 | socket2::Domain::IPV6) {
            socket.bind_device(Some(DEVICE))?;
            confined += 1;
        }
    }
    Ok(confined)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use std::net::UdpSocket;
    use std::time::Duration;

    use super::*;

    /// Every socket of this test's process, so it stands alone in it.
    #[test]
    fn a_socket_on_all_addresses_hears_the_loopback_only() {
        let ear = UdpSocket::bind("0.0.0.0:0").unwrap();
        ear.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
        assert!(confine().unwrap() >= 1);
        assert_eq!(socket2::SockRef::from(&ear).device().unwrap().as_deref(), Some(DEVICE));
        let port = ear.local_addr().unwrap().port();
        UdpSocket::bind("127.0.0.1:0").unwrap().send_to(b"here", ("127.0.0.1", port)).unwrap();
        let mut heard = [0; 8];
        assert_eq!(ear.recv(&mut heard).unwrap(), 4);
    }
}
