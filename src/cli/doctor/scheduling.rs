//! What the system allows the processes: priority, locked memory, data.

use rustix::process::{Resource, Rlimit, getrlimit};
use rustix::thread::{CapabilitySet, capabilities};

use super::row::Row;

/// Limit that a node sets for its middleware process, bytes (parameter `middleware_memory_mib`).
const MIDDLEWARE_BYTES: u64 = 512 << 20;

pub(super) fn rows() -> Vec<Row> {
    vec![real_time(), locked(), data()]
}

/// Whether SCHED_FIFO can be had. The nodes ask for no priority of their own; who starts them may (`chrt`).
fn real_time() -> Row {
    let may = capabilities(None).is_ok_and(|sets| sets.effective.contains(CapabilitySet::SYS_NICE));
    let value = match getrlimit(Resource::Rtprio).current {
        _ if may => "any, by capability".to_owned(),
        Some(0) => "not permitted (rtprio 0)".to_owned(),
        Some(priority) => format!("up to {priority}"),
        None => "any".to_owned(),
    };
    Row::ok("real-time priority", format!("{value}; the nodes do not ask for it, `chrt --fifo 5 twin_node` would"))
}

fn locked() -> Row {
    let limit = getrlimit(Resource::Memlock).current;
    let value = limit.map_or_else(|| "unlimited".to_owned(), |bytes| format!("{} KiB", bytes >> 10));
    Row::ok("locked memory", format!("{value}; the nodes lock none"))
}

fn data() -> Row {
    let Rlimit { maximum, .. } = getrlimit(Resource::Data);
    match maximum {
        Some(bytes) if bytes < MIDDLEWARE_BYTES => Row::problem(
            "data limit",
            format!("{} MiB", bytes >> 20),
            format!(
                "Raise `ulimit -H -d` to {} KiB: the middleware process of a node sets that limit for itself.",
                MIDDLEWARE_BYTES >> 10
            ),
        ),
        Some(bytes) => Row::ok("data limit", format!("{} MiB", bytes >> 20)),
        None => Row::ok("data limit", "none"),
    }
}
