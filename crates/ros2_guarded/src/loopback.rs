//! Sockets that hear this machine only, and whose multicast does not leave it.
//!
//! Programs on this machine announce the addresses of its network cards, send their discovery to a multicast group through a card, and
//! do not hear who uses the loopback device alone. So the participant uses all cards, as they do. The kernel delivers what comes from
//! this machine itself over the loopback device, whatever card has the address, and marks multicast that it has returned. A socket
//! filter lets only these two pass. Neither can be forged from outside, and neither depends on addresses, which change. Multicast with
//! time to live 0 is returned to this machine and goes to no card, as long as a socket of the machine has joined the group there;
//! RustDDS joins before it sends.
//!
//! RustDDS has no setting for either, and binds each of its sockets to every address. The options are set while it looks at the
//! addresses. A program that was built without the patch of `netdev` does not learn when that is: it stays on the loopback device, and the
//! filter is set once RustDDS has begun.

use std::fs;
use std::io;
use std::net::{IpAddr, Ipv4Addr, UdpSocket};
use std::sync::OnceLock;

use ros2_client::dds::rustdds::dds::CreateResult;
use ros2_client::dds::rustdds::{DomainParticipant, DomainParticipantBuilder};
use rustix::process::{PidfdFlags, PidfdGetfdFlags, getpid, pidfd_getfd, pidfd_open};
use socket2::{Domain, SockFilter, SockRef};

/// Why the sockets can't be kept to this machine from the first datagram on, and what to do.
#[derive(Debug, thiserror::Error)]
pub(super) enum Unkept {
    /// Open files can't be listed, or the process is not let at its own sockets or their filter.
    #[error("{0}; a container needs the capability SYS_PTRACE for it")]
    Refused(#[from] io::Error),
    #[error(
        "this program was built without the patch of the crate netdev; build it from the project's repository, or with the two lines of \
         own_addresses' description in its Cargo.toml"
    )]
    Unpatched,
}

/// Whether RustDDS asks [`own_addresses`]. It resolves `netdev` as this crate does.
#[must_use]
pub(super) fn is_patched() -> bool {
    let before = own_addresses::looks();
    drop(netdev::get_interfaces());
    own_addresses::looks() != before
}

/// Headers of IP, UDP and RTPS in front of a message, and what RustDDS adds, bytes.
const HEADERS: usize = 132;

/// Largest message that reaches Fast DDS on another machine, bytes: RustDDS cuts longer ones into DATA_FRAGs that Fast DDS rejects
/// (`docs/lab/upstream/rustdds.md`, 7). Without the patch of `netdev` that is so on this machine as well.
#[must_use]
pub fn whole_to_others() -> usize {
    static OF: OnceLock<usize> = OnceLock::new();
    *OF.get_or_init(|| if is_patched() { own_addresses::OTHERS_MTU as usize } else { 1500 } - HEADERS)
}

/// Whether messages to Fast DDS on this machine have larger bounds than those to other machines.
#[must_use]
pub fn is_own_machine_wide() -> bool {
    whole_to_others() > 1500
}

/// Keeps the sockets that RustDDS opens from now on to this machine, before it reads or sends anything.
pub(super) fn prepare() -> Result<(), Unkept> {
    let _trial = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?;
    confine()?;
    if !is_patched() {
        return Err(Unkept::Unpatched);
    }
    own_addresses::at_every_look(|| drop(confine()));
    Ok(())
}

/// A participant on this machine alone, and why its sockets were not kept to it from the start, if they were not: then it
/// uses the loopback device alone.
///
/// # Errors
/// As of [`DomainParticipantBuilder::build`].
pub(super) fn build(mut builder: DomainParticipantBuilder) -> CreateResult<(DomainParticipant, Option<Unkept>)> {
    let unkept = prepare().err();
    if unkept.is_some() {
        builder = builder.with_only_networks([IpAddr::V4(Ipv4Addr::LOCALHOST)]);
    }
    let participant = builder.build()?;
    if matches!(unkept, Some(Unkept::Unpatched)) {
        // its sockets are open by now, and nothing of it has been read by this program
        drop(confine());
    }
    Ok((participant, unkept))
}

/// Keeps every internet socket of this process to this machine, and says how many there are.
///
/// # Errors
/// If the system lists no open files, or does not let a process at its own sockets or their filter.
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
        let socket = SockRef::from(&socket);
        let domain = socket.domain()?;
        if matches!(domain, Domain::IPV4 | Domain::IPV6) {
            socket.attach_filter(&from_this_machine())?;
            confined += 1;
        }
        if domain == Domain::IPV4 {
            socket.set_multicast_ttl_v4(0)?;
        }
    }
    Ok(confined)
}

/// Instructions of a socket filter (linux/filter.h): a datagram passes if it comes over the loopback device or is multicast that
/// the kernel has returned.
fn from_this_machine() -> [SockFilter; 6] {
    const LOAD: u16 = 0x20;
    const JUMP_IF_EQUAL: u16 = 0x15;
    const RETURN: u16 = 0x06;
    /// Below it lie places that are of the datagram's way, not of its bytes: SKF_AD_OFF, -0x1000.
    const WAY: u32 = 0xffff_f000;
    /// SKF_AD_PKTTYPE, and PACKET_LOOPBACK of linux/if_packet.h.
    const KIND: (u32, u32) = (WAY + 4, 5);
    /// SKF_AD_HATYPE, and ARPHRD_LOOPBACK of linux/if_arp.h.
    const DEVICE: (u32, u32) = (WAY + 28, 772);
    [
        SockFilter::new(LOAD, 0, 0, DEVICE.0),
        SockFilter::new(JUMP_IF_EQUAL, 2, 0, DEVICE.1),
        SockFilter::new(LOAD, 0, 0, KIND.0),
        SockFilter::new(JUMP_IF_EQUAL, 0, 1, KIND.1),
        SockFilter::new(RETURN, 0, 0, u32::MAX),
        SockFilter::new(RETURN, 0, 0, 0),
    ]
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use std::time::Duration;

    use super::*;

    /// Every socket of this test's process, so it stands alone in it. That other machines are not heard is seen by the product's test
    /// with two hosts.
    #[test]
    fn a_socket_on_all_addresses_hears_every_address_of_this_machine_and_its_multicast() {
        const GROUP: Ipv4Addr = Ipv4Addr::new(239, 255, 0, 1);
        let cards: Vec<_> = own_addresses::get_interfaces().into_iter().filter(|i| i.ipv4.is_some()).collect();
        let ear = UdpSocket::bind("0.0.0.0:0").unwrap();
        ear.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
        let mouth = UdpSocket::bind("0.0.0.0:0").unwrap();
        assert!(confine().unwrap() >= 2);
        let port = ear.local_addr().unwrap().port();
        let mut heard = [0; 8];
        for card in &cards {
            let address = card.ipv4.unwrap().addr();
            mouth.send_to(b"here", (address, port)).unwrap();
            assert_eq!(ear.recv(&mut heard).unwrap(), 4, "{address}");
            if card.is_multicast() {
                ear.join_multicast_v4(&GROUP, &address).unwrap();
                SockRef::from(&mouth).set_multicast_if_v4(&address).unwrap();
                mouth.send_to(b"group", (IpAddr::V4(GROUP), port)).unwrap();
                assert_eq!(ear.recv(&mut heard).unwrap(), 5, "multicast through {address}");
            }
        }
        assert_eq!(mouth.multicast_ttl_v4().unwrap(), 0);
        // in the workspace RustDDS asks what this crate asks; built from the registry it does not, and that is said
        let patched = std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../netdev/Cargo.toml")).exists();
        assert_eq!(is_patched(), patched);
        assert_eq!((whole_to_others(), is_own_machine_wide()), if patched { (16_252, true) } else { (1_368, false) });
        assert!(Unkept::Unpatched.to_string().contains("own_addresses"));
    }
}
