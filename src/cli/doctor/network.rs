//! The machine's network as the nodes use it: interfaces, multicast, receive buffers, ports.

use std::fs;
use std::net::{Ipv4Addr, TcpListener, UdpSocket};
use std::time::Duration;

use super::row::Row;
use crate::ros::twin_node;

/// Group of the discovery of DDS (RTPS 9.6.2.4.1).
const GROUP: Ipv4Addr = Ipv4Addr::new(239, 255, 0, 1);
/// Buffer that holds the largest messages of a fine model with those that come meanwhile (`docs/ros2.md`), bytes.
const BUFFER_BYTES: u64 = 8 << 20;
/// Ports of RTPS 9.6.2.3: of the first participant's discovery, step from domain to domain and from participant to participant.
const DDS_PORTS: [u32; 3] = [7410, 250, 2];
/// As many participants as RustDDS has numbers for.
const PARTICIPANTS: u32 = 120;

pub(super) fn rows(subnet: bool) -> Vec<Row> {
    vec![interfaces(subnet), multicast(subnet), buffers(subnet), overflows()]
}

/// An interface that is up.
struct Interface {
    name: String,
    loopback: bool,
    multicast: bool,
}

/// What /sys tells of the interfaces: flags of `man netdevice`.
fn up() -> Vec<Interface> {
    let folders = fs::read_dir("/sys/class/net").into_iter().flatten().flatten();
    let mut all: Vec<_> = folders
        .filter_map(|folder| {
            let text = fs::read_to_string(folder.path().join("flags")).ok()?;
            let flags = u32::from_str_radix(text.trim().trim_start_matches("0x"), 16).ok()?;
            let name = folder.file_name().to_string_lossy().into_owned();
            (flags & 1 != 0).then_some(Interface { name, loopback: flags & 8 != 0, multicast: flags & 0x1000 != 0 })
        })
        .collect();
    all.sort_by(|a, b| a.name.cmp(&b.name));
    all
}

fn interfaces(subnet: bool) -> Row {
    const NAME: &str = "interfaces";
    let all = up();
    let value = match &all[..] {
        [] => "none is up".to_owned(),
        all => {
            let word = |i: &Interface| format!("{}{}", i.name, if i.multicast { " with multicast" } else { "" });
            all.iter().map(word).collect::<Vec<_>>().join(", ")
        }
    };
    if !all.iter().any(|i| i.loopback) {
        Row::problem(
            NAME,
            value,
            "Bring the loopback up with `ip link set lo up`: programs of this machine talk through it.",
        )
    } else if subnet && !all.iter().any(|i| i.multicast && !i.loopback) {
        Row::problem(
            NAME,
            value,
            "Bring a network card with multicast up, or unset ROS_AUTOMATIC_DISCOVERY_RANGE: nodes of other machines are found by multicast.",
        )
    } else {
        Row::ok(NAME, value)
    }
}

/// Sends a datagram to the group of the discovery, with time to live 0, so that it stays on this machine.
fn multicast(subnet: bool) -> Row {
    const NAME: &str = "multicast";
    let returned = || -> std::io::Result<bool> {
        let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?;
        socket.join_multicast_v4(&GROUP, &Ipv4Addr::UNSPECIFIED)?;
        socket.set_multicast_ttl_v4(0)?;
        socket.set_read_timeout(Some(Duration::from_millis(300)))?;
        socket.send_to(b"needle_twin", (GROUP, socket.local_addr()?.port()))?;
        Ok(socket.recv(&mut [0; 16]).is_ok())
    };
    let value = match returned() {
        Ok(true) => return Row::ok(NAME, "returned to this machine"),
        Ok(false) => "not returned to this machine".to_owned(),
        Err(error) => format!("can't be sent ({error})"),
    };
    let advice = "Add a route with `ip route add 239.0.0.0/8 dev lo`, or one over the network card, and let a firewall pass UDP to 239.255.0.1.";
    if subnet { Row::problem(NAME, value, advice) } else { Row::note(NAME, value, advice) }
}

fn buffers(subnet: bool) -> Row {
    const NAME: &str = "receive buffers";
    let read = |name: &str| {
        let text = fs::read_to_string(format!("/proc/sys/net/core/{name}")).ok()?;
        text.trim().parse::<u64>().ok()
    };
    let (Some(usual), Some(most)) = (read("rmem_default"), read("rmem_max")) else {
        return Row::ok(NAME, "not told by the system");
    };
    let value = format!("{} kB, {} kB at most", usual / 1000, most / 1000);
    if subnet && most < BUFFER_BYTES {
        Row::note(
            NAME,
            value,
            "Set `sysctl net.core.rmem_max=8388608 net.core.wmem_max=8388608`: large messages of the tissue are lost over a network otherwise.",
        )
    } else {
        Row::ok(NAME, value)
    }
}

/// Datagrams that the kernel dropped because a program did not read them in time.
fn overflows() -> Row {
    const NAME: &str = "full receive buffers";
    let text = fs::read_to_string("/proc/net/snmp").unwrap_or_default();
    match count(&text, "RcvbufErrors") {
        None => Row::ok(NAME, "not told by the system"),
        Some(0) => Row::ok(NAME, "no datagram lost since the machine started"),
        Some(lost) => Row::note(
            NAME,
            format!("{lost} datagrams lost since the machine started"),
            "If the number grows during a run, give the reading programs larger buffers and more processor time.",
        ),
    }
}

/// A counter of UDP: a line of names, then one of numbers.
fn count(snmp: &str, name: &str) -> Option<u64> {
    let mut lines = snmp.lines().filter_map(|line| line.strip_prefix("Udp:"));
    let (names, numbers) = (lines.next()?, lines.next()?);
    let at = names.split_whitespace().position(|word| word == name)?;
    numbers.split_whitespace().nth(at)?.parse().ok()
}

/// The ports that the twin serves on request.
pub(super) fn served_ports() -> Vec<Row> {
    let row = |port: twin_node::Port| {
        let name = format!("port of {}", port.serves);
        match TcpListener::bind((Ipv4Addr::LOCALHOST, port.usual)) {
            Ok(_) => Row::ok(name, format!("{} is free", port.usual)),
            Err(error) => Row::note(
                name,
                format!("{} is taken ({error})", port.usual),
                format!(
                    "End the program that has the port, or start the twin with `-p {}:=0`, which takes any that is free.",
                    port.parameter
                ),
            ),
        }
    };
    twin_node::ports().map(row).into()
}

/// The ports of a domain. Each program on it takes two of its own; `heard` is how many programs were heard.
pub(super) fn domain_ports(domain: u16, heard: Option<usize>) -> Row {
    let name = format!("ports of domain {domain}");
    let [first, per_domain, per_participant] = DDS_PORTS;
    let port = |n: u32| u16::try_from(first + per_domain * u32::from(domain) + per_participant * n).ok();
    let ports: Vec<u16> = (0..PARTICIPANTS).filter_map(port).collect();
    let taken = ports.iter().filter(|port| UdpSocket::bind((Ipv4Addr::UNSPECIFIED, **port)).is_err()).count();
    let value = format!("{taken} of {} taken", ports.len());
    if taken == ports.len() {
        Row::problem(name, value, "Choose another ROS_DOMAIN_ID: no participant can join this one.")
    } else if taken > 0 && heard == Some(0) {
        Row::note(
            name,
            value,
            "Look with `ss --udp --listening --processes` who has them: no program on this domain was heard, and discovery may miss some.",
        )
    } else {
        Row::ok(name, value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_counter_is_found_by_its_name() {
        let text =
            "Tcp: A\nTcp: 1\nUdp: InDatagrams NoPorts RcvbufErrors\nUdp: 5 6 7\nUdpLite: RcvbufErrors\nUdpLite: 9\n";
        assert_eq!(count(text, "RcvbufErrors"), Some(7));
        assert_eq!(count(text, "Nothing"), None);
    }
}
