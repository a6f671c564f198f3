//! Who is there, by the tokens of the graph: how many are matched with each endpoint, and who never will be.

use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, PoisonError};

use super::keys::{Seen, dds_type, hash, seen};
use crate::graph::{SHARED, other_type, ros_type, second_publisher};
use crate::qos::Side;
use crate::uplink::Uplink;
use crate::wire::{Endpoint, Head, Kind, Plan, Role, UNSTAMPED};

/// One own publisher or subscription.
struct Record {
    number: u16,
    side: Side,
    name: String,
    dds_type: String,
    hash: String,
    /// Tokens of those who are matched.
    remotes: BTreeSet<String>,
}

/// See the module.
pub(super) struct Graph {
    session: String,
    records: Mutex<Vec<Record>>,
    warned: Mutex<BTreeSet<(u16, String)>>,
    uplink: Arc<Uplink>,
}

impl Graph {
    pub(crate) fn new(plan: &Plan, session: String, uplink: &Arc<Uplink>) -> Self {
        let records = (0..).zip(&plan.endpoints).filter_map(|(number, endpoint)| record(number, endpoint)).collect();
        Self { session, records: Mutex::new(records), warned: Mutex::default(), uplink: Arc::clone(uplink) }
    }

    /// Somebody has come.
    pub(crate) fn come(&self, token: &str) {
        let Some(remote) = seen(token).filter(|remote| remote.session != self.session) else { return };
        let side = match &*remote.kind {
            "MP" => Side::Publisher,
            "MS" => Side::Subscription,
            _ => return,
        };
        for record in self.records.lock().unwrap_or_else(PoisonError::into_inner).iter_mut() {
            if record.name != remote.name {
                continue;
            }
            if let Some(text) = misfit(record, &remote, side) {
                self.warn(record.number, token, &text);
            } else if record.side != side && record.remotes.insert(token.to_owned()) {
                self.count(record);
            }
        }
    }

    /// Somebody has gone.
    pub(crate) fn go(&self, token: &str) {
        for record in self.records.lock().unwrap_or_else(PoisonError::into_inner).iter_mut() {
            if record.remotes.remove(token) {
                self.count(record);
            }
        }
    }

    fn count(&self, record: &Record) {
        let count = u32::try_from(record.remotes.len()).unwrap_or(u32::MAX);
        self.uplink.send(Head::of(Kind::Matched, record.number, UNSTAMPED), &count.to_ne_bytes());
    }

    fn warn(&self, number: u16, token: &str, text: &str) {
        if self.warned.lock().unwrap_or_else(PoisonError::into_inner).insert((number, token.to_owned())) {
            self.uplink.log(log::Level::Warn, text);
        }
    }
}

fn record(number: u16, endpoint: &Endpoint) -> Option<Record> {
    let side = match endpoint.role {
        Role::Publisher => Side::Publisher,
        Role::Subscription => Side::Subscription,
        Role::Server | Role::Client { .. } => return None,
    };
    let (name, hash) = (endpoint.name.clone(), hash(endpoint).to_owned());
    Some(Record { number, side, name, dds_type: dds_type(endpoint), hash, remotes: BTreeSet::new() })
}

/// Why somebody on the same topic is not what it should be.
fn misfit(own: &Record, remote: &Seen, side: Side) -> Option<String> {
    let name = &own.name;
    if own.dds_type != remote.dds_type {
        return Some(other_type(name, side, &remote.dds_type, &own.dds_type));
    }
    if own.hash != remote.hash {
        return Some(format!(
            "`{name}`: a {} has another definition of {} (type hash {}, here {}): nothing passes between them. Build it with ROS 2 Jazzy or \
             later and this package's definitions",
            side.word(),
            ros_type(&own.dds_type),
            remote.hash,
            own.hash,
        ));
    }
    let rival = own.side == Side::Publisher && side == Side::Publisher && !SHARED.contains(&&**name);
    rival.then(|| second_publisher(name))
}
