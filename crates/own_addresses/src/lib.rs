//! The network addresses of this machine as RustDDS asks for them, each with the MTU of the way to it.
//!
//! RustDDS 0.15.1 asks the crate `netdev` for the interfaces of the machine, and sizes its datagrams to a peer by the MTU of the
//! interface in whose subnet the peer is. A peer on this machine announces the address of a network card, whose MTU is 1500 bytes,
//! but the kernel sends what is meant for an own address over the loopback device, whose MTU is 65,536, whatever card has the
//! address (`ip route show table local`). In datagrams of 1.4 kB, answers of services are lost, and messages of 160 kB
//! overflow the receive buffer of Fast DDS: `docs/lab/decisions/datagrams.md`.
//!
//! So this crate gives each IPv4 address alone, as a subnet of
//! one address, with the MTU of the loopback. All other addresses are in a last subnet with an MTU of 16 kB: the kernel cuts a datagram
//! into what the network carries, and the answer of a service in one piece reaches Fast DDS. It has what RustDDS calls and nothing else, is
//! written anew, and can go when RustDDS asks for the route itself (`docs/lab/upstream/rustdds.md`, 8).
//!
//! RustDDS asks it once it stands in netdev's place. The workspace does that by a crate of that name, which is this one, and by a patch.
//! A patch is not inherited: the program that is built must have it in its own `Cargo.toml`. A build from the registry alone has none.
#![forbid(unsafe_code)]

use std::cell::Cell;
use std::net::{Ipv4Addr, Ipv6Addr};
use std::sync::OnceLock;

use nix::ifaddrs::getifaddrs;
use nix::net::if_::{InterfaceFlags, if_nametoindex};

/// An address of this machine.
#[derive(Debug, Clone)]
pub struct Interface {
    /// The system's number of the interface that has the address, 0 if it has gone meanwhile.
    pub index: u32,
    /// The address, if it is one of IPv4.
    pub ipv4: Option<Own<Ipv4Addr>>,
    /// The address, if it is one of IPv6.
    pub ipv6: Option<Own<Ipv6Addr>>,
    /// Largest packet in bytes that goes to the address from this machine, if the system says so.
    pub mtu: Option<u32>,
    flags: InterfaceFlags,
}

/// An own address.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Own<A> {
    address: A,
    /// Whether every other address counts to its subnet.
    of_all: bool,
}

impl<A: Copy> Own<A> {
    fn alone(address: A) -> Self {
        Self { address, of_all: false }
    }

    /// The address.
    #[must_use]
    pub fn addr(&self) -> A {
        self.address
    }
}

impl Own<Ipv4Addr> {
    /// The mask of a subnet that has this address alone, or every address.
    #[must_use]
    pub fn netmask(&self) -> Ipv4Addr {
        if self.of_all { Ipv4Addr::UNSPECIFIED } else { Ipv4Addr::BROADCAST }
    }
}

impl Interface {
    /// Whether the interface is the loopback.
    #[must_use]
    pub fn is_loopback(&self) -> bool {
        self.flags.contains(InterfaceFlags::IFF_LOOPBACK)
    }

    /// Whether the interface takes part in multicast.
    #[must_use]
    pub fn is_multicast(&self) -> bool {
        self.flags.contains(InterfaceFlags::IFF_MULTICAST)
    }
}

/// Largest packet to another machine. An answer of `ros2 param dump` goes into one. The kernel keeps a datagram of which a fragment was lost
/// for 30 s, and takes no more once these fill 4 MB: with 64 kB that is so where one fragment in a thousand is lost.
pub const OTHERS_MTU: u32 = 16_384;

/// What [`at_every_look`] was given.
static AT_EVERY_LOOK: OnceLock<fn()> = OnceLock::new();

/// Has `hook` called at every [`get_interfaces`] from now on; the first hook stays.
///
/// RustDDS does not give its sockets away, and looks at the addresses after it has opened them and before it sends anything: the
/// moment to set options of theirs.
pub fn at_every_look(hook: fn()) {
    AT_EVERY_LOOK.get_or_init(|| hook);
}

thread_local! {
    static LOOKS: Cell<u64> = const { Cell::new(0) };
}

/// How often this thread has called [`get_interfaces`], under whatever name: by it a program sees whether what it calls `netdev` is this
/// crate.
#[must_use]
pub fn looks() -> u64 {
    LOOKS.get()
}

/// Every address of this machine, in the system's order; none if the system does not tell.
#[must_use]
pub fn get_interfaces() -> Vec<Interface> {
    LOOKS.set(LOOKS.get() + 1);
    AT_EVERY_LOOK.get().inspect(|hook| hook());
    let mtu = loopback_mtu();
    let Ok(addresses) = getifaddrs() else { return Vec::new() };
    let interface = |of: nix::ifaddrs::InterfaceAddress| {
        let address = of.address?;
        let ipv4 = address.as_sockaddr_in().map(|a| Own::alone(a.ip()));
        let ipv6 = address.as_sockaddr_in6().map(|a| Own::alone(a.ip()));
        let index = if_nametoindex(of.interface_name.as_str()).unwrap_or(0);
        (ipv4.is_some() || ipv6.is_some()).then_some(Interface { index, ipv4, ipv6, mtu, flags: of.flags })
    };
    addresses.filter_map(interface).chain([others()]).collect()
}

/// What stands for all other machines: the loopback's address once more, behind the own ones, in the subnet of all.
fn others() -> Interface {
    let ipv4 = Some(Own { address: Ipv4Addr::LOCALHOST, of_all: true });
    Interface { index: 0, ipv4, ipv6: None, mtu: Some(OTHERS_MTU), flags: InterfaceFlags::IFF_LOOPBACK }
}

/// MTU of the loopback device; none where the system does not say it here, which RustDDS takes for 1500 bytes.
fn loopback_mtu() -> Option<u32> {
    std::fs::read_to_string("/sys/class/net/lo/mtu").ok()?.trim().parse().ok()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use std::net::UdpSocket;

    use super::*;

    /// As large as RustDDS makes a datagram: the MTU less the headers of IP, UDP and RTPS.
    #[test]
    fn a_datagram_of_the_mtu_goes_to_every_own_address_in_one_piece() {
        let before = looks();
        let all = get_interfaces();
        assert_eq!(looks(), before + 1);
        let of_loopback = Some(Own::alone(Ipv4Addr::LOCALHOST));
        assert!(all.iter().any(|i| i.is_loopback() && i.ipv4 == of_loopback && i.index != 0));
        let (last, own) = all.split_last().unwrap();
        assert_eq!((last.ipv4.unwrap().netmask(), last.mtu), (Ipv4Addr::UNSPECIFIED, Some(OTHERS_MTU)));
        for own in own.iter().filter_map(|i| i.ipv4) {
            let size = loopback_mtu().unwrap() as usize - 48;
            let ear = UdpSocket::bind((own.addr(), 0)).unwrap();
            ear.set_read_timeout(Some(std::time::Duration::from_secs(5))).unwrap();
            let mouth = UdpSocket::bind((own.addr(), 0)).unwrap();
            assert_eq!(mouth.send_to(&vec![7; size], ear.local_addr().unwrap()).unwrap(), size);
            assert_eq!(ear.recv(&mut vec![0; 1 << 16]).unwrap(), size);
            // no other address is in its subnet
            assert_eq!(own.netmask(), Ipv4Addr::BROADCAST);
        }
    }
}
