//! Calls and answers of services: a server is a queryable, a call a query.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use zenoh::query::{ConsolidationMode, Query, QueryTarget, Queryable};
use zenoh::{Session, Wait};

use super::keys::{Extra, encapsulated, gid, plain};
use crate::services::ORDERS;
use crate::uplink::Uplink;
use crate::wire::{Head, Kind, Stamp, UNSTAMPED, caller, caller_of, wall_nanos};

/// Calls that wait for their answers, the oldest first.
type Waiting = Arc<Mutex<VecDeque<(Stamp, Query)>>>;

/// A server.
pub(super) struct Served {
    pub number: u16,
    waiting: Waiting,
    _queryable: Queryable<()>,
}

impl Served {
    /// Offers a service under `key`.
    ///
    /// # Errors
    /// What Zenoh says.
    pub(crate) fn new(number: u16, key: &str, session: &Session, uplink: &Arc<Uplink>) -> zenoh::Result<Self> {
        let waiting = Waiting::default();
        let (asked, uplink) = (Arc::clone(&waiting), Arc::clone(uplink));
        let take = move |query: Query| {
            let Some(extra) = query.attachment().and_then(|extra| Extra::read(&extra.to_bytes())) else { return };
            let Some(payload) = query.payload().map(|payload| payload.to_bytes().into_owned()) else { return };
            let Some((big_endian, body)) = plain(&payload) else { return };
            let id = caller(extra.gid, extra.number);
            let mut waiting = asked.lock().unwrap_or_else(PoisonError::into_inner);
            if waiting.len() == ORDERS {
                waiting.pop_front();
            }
            waiting.push_back((id, query));
            drop(waiting);
            uplink.send(Head { flag: u8::from(big_endian), ..Head::of(Kind::Request, number, id) }, body);
        };
        let queryable = session.declare_queryable(key.to_owned()).complete(true).callback(take).wait()?;
        Ok(Self { number, waiting, _queryable: queryable })
    }

    /// Sends an answer; false if nobody waits for it any more.
    pub(crate) fn answer(&self, id: &Stamp, body: &[u8]) -> bool {
        let mut waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner);
        let query = waiting.iter().position(|(asked, _)| asked == id).and_then(|at| waiting.remove(at));
        drop(waiting);
        let (gid, number) = caller_of(id);
        let extra = Extra { number, sent: wall_nanos(), gid };
        query.is_some_and(|(_, query)| {
            query.reply(query.key_expr(), encapsulated(body)).attachment(&extra.bytes()[..]).wait().is_ok()
        })
    }
}

/// A client.
pub(super) struct Caller {
    pub number: u16,
    key: String,
    gid: [u8; 16],
    calls: AtomicI64,
}

impl Caller {
    pub(crate) fn new(number: u16, key: String, token: &str) -> Self {
        Self { number, key, gid: gid(token), calls: AtomicI64::new(0) }
    }

    /// Calls; the answer goes to the node.
    pub(crate) fn call(&self, body: &[u8], session: &Session, uplink: &Arc<Uplink>) -> bool {
        let number = self.calls.fetch_add(1, Ordering::Relaxed) + 1;
        let extra = Extra { number, sent: wall_nanos(), gid: self.gid };
        let (own, uplink) = (self.number, Arc::clone(uplink));
        let take = move |reply: zenoh::query::Reply| {
            let Ok(sample) = reply.result() else { return };
            let payload = sample.payload().to_bytes();
            if let Some((big_endian, body)) = plain(&payload) {
                uplink.send(Head { flag: u8::from(big_endian), ..Head::of(Kind::Response, own, UNSTAMPED) }, body);
            }
        };
        let query = session.get(&self.key).payload(encapsulated(body)).attachment(&extra.bytes()[..]);
        let query = query.target(QueryTarget::AllComplete).consolidation(ConsolidationMode::None);
        query.callback(take).wait().is_ok()
    }
}
