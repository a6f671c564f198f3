//! The middleware process over Zenoh: the same plan and the same frames, on the wire of rmw_zenoh_cpp.
//!
//! What of the guard over RustDDS is needless here: a process that is killed is gone from the graph with its connection, and no packet of a
//! stranger reaches a session that has not taken its connection. Pulse, death and the limit of memory are as ever.

mod config;
mod graph;
mod keys;
mod services;
mod topics;

use std::any::Any;
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::time::Duration;

use crossbeam_channel::{Receiver, RecvTimeoutError};
use ros2_client::QosProfile;
use zenoh::liveliness::LivelinessToken;
use zenoh::sample::SampleKind;
use zenoh::{Session, Wait};

use self::config::said;
use self::graph::Graph;
use self::keys::Keys;
use self::services::{Caller, Served};
use self::topics::{Writer, subscribe};
use crate::frames::Frames;
use crate::session::ZenohSession;
use crate::uplink::Uplink;
use crate::wire::{Endpoint, Head, Kind, Plan, Role, UNSTAMPED, is_over, times_of, wall_nanos};
use named_threads::{join, spawn};

/// Time between two signs of life.
const PULSE: Duration = Duration::from_millis(200);
/// Pulses between two looks for a router: a second, as rmw_zenoh_cpp has it.
const LOOK: i64 = 5;

/// Makes the endpoints of the plan and carries messages until the node closes the socket.
pub(super) fn run(
    plan: &Plan,
    settings: &ZenohSession,
    frames: Frames,
    socket: &UnixStream,
    uplink: &Arc<Uplink>,
    lines: &Receiver<(u8, String)>,
) -> Result<(), String> {
    let domain = match Domain::join(plan, settings, uplink) {
        Ok(domain) => domain,
        Err(reason) => {
            uplink.text(Kind::Refused, &reason);
            return Ok(());
        }
    };
    uplink.send(Head::new(Kind::Ready), &[]);
    let (stop, stopped) = crossbeam_channel::bounded::<()>(0);
    let (up, session, lines, checks) =
        (Arc::clone(uplink), domain.session.clone(), lines.clone(), settings.router_checks);
    let pulse = spawn("pulse", move || live(&up, &session, &stopped, &lines, checks)).map_err(|e| e.to_string())?;
    domain.carry(frames, socket, uplink);
    drop(stop);
    join(pulse);
    domain.leave()
}

/// Everything on the network.
struct Domain {
    session: Session,
    writers: Vec<Writer>,
    servers: Vec<Served>,
    callers: Vec<Caller>,
    /// Tokens and subscriptions: what is there as long as it is kept.
    tokens: Vec<LivelinessToken>,
    kept: Vec<Box<dyn Any>>,
}

impl Domain {
    fn join(plan: &Plan, settings: &ZenohSession, uplink: &Arc<Uplink>) -> Result<Self, String> {
        let config = config::config(settings)?;
        let say = |e: zenoh::Error| format!("opening a Zenoh session: {}", said(&e));
        let session = zenoh::open(config).wait().map_err(say)?;
        let keys = Keys::new(plan, session.zid().to_string());
        let token = session.liveliness().declare_token(keys.node()).wait().map_err(say)?;
        let (writers, servers, callers) = (Vec::new(), Vec::new(), Vec::new());
        let mut domain = Self { session, writers, servers, callers, tokens: vec![token], kept: Vec::new() };
        for (number, endpoint) in (0..).zip(&plan.endpoints) {
            domain.make(number, endpoint, &keys, uplink).map_err(|e| format!("{}: {}", endpoint.name, said(&e)))?;
        }
        domain.watch(plan, &keys, uplink).map_err(say)?;
        Ok(domain)
    }

    fn make(&mut self, number: u16, endpoint: &Endpoint, keys: &Keys, uplink: &Arc<Uplink>) -> zenoh::Result<()> {
        let (token, key) = (keys.endpoint(number, endpoint), keys.data(endpoint));
        let profile = QosProfile::from(endpoint.quality);
        match endpoint.role {
            Role::Publisher => self.writers.push(Writer::new(number, &key, &token, &self.session, &profile)?),
            Role::Subscription => self.kept.push(subscribe(number, &key, &self.session, &profile, uplink)?),
            Role::Server => self.servers.push(Served::new(number, &key, &self.session, uplink)?),
            Role::Client { .. } => self.callers.push(Caller::new(number, key, &token)),
        }
        self.tokens.push(self.session.liveliness().declare_token(token).wait()?);
        Ok(())
    }

    /// Tells the node who else is there.
    fn watch(&mut self, plan: &Plan, keys: &Keys, uplink: &Arc<Uplink>) -> zenoh::Result<()> {
        let graph = Graph::new(plan, self.session.zid().to_string(), uplink);
        let take = move |sample: zenoh::sample::Sample| match sample.kind() {
            SampleKind::Put => graph.come(sample.key_expr().as_str()),
            SampleKind::Delete => graph.go(sample.key_expr().as_str()),
        };
        let liveliness = self.session.liveliness();
        self.kept.push(Box::new(liveliness.declare_subscriber(keys.graph()).history(true).callback(take).wait()?));
        Ok(())
    }

    /// Sends what the node says, until it closes the socket.
    fn carry(&self, frames: Frames, socket: &UnixStream, uplink: &Arc<Uplink>) {
        frames.take_all(socket, |head, body| self.send(&head, body, uplink));
    }

    fn send(&self, head: &Head, body: &[u8], uplink: &Arc<Uplink>) {
        let number = head.endpoint;
        let warn_unless = |sent: bool, text: &str| {
            if !sent {
                uplink.log(log::Level::Warn, text);
            }
        };
        match head.kind {
            Kind::Message => {
                let Ok(at) = self.writers.binary_search_by_key(&number, |w| w.number) else { return };
                let over = is_over(times_of(&head.stamp)[0], self.writers[at].lifespan, wall_nanos());
                if !over && !self.writers[at].publish(body) {
                    uplink.send(Head::of(Kind::Failed, number, UNSTAMPED), &[]);
                }
            }
            Kind::Response => {
                let answered = self.servers.iter().any(|s| s.number == number && s.answer(&head.stamp, body));
                warn_unless(answered, "an answer of a service is lost: its caller has gone");
            }
            Kind::Request => {
                let called = self.callers.iter().any(|c| c.number == number && c.call(body, &self.session, uplink));
                warn_unless(called, "a call of a service could not be sent");
            }
            _ => {}
        }
    }

    /// Others see the node leave at once.
    fn leave(self) -> Result<(), String> {
        drop((self.tokens, self.kept, self.writers, self.servers));
        self.session.close().wait().map_err(|e| said(&e))
    }
}

/// Signs of life and lines of the log until the process is to end; says if no router is found.
fn live(uplink: &Uplink, session: &Session, stop: &Receiver<()>, lines: &Receiver<(u8, String)>, checks: i64) {
    let (mut beats, mut looks, mut missed) = (0, checks >= 0, false);
    while stop.recv_timeout(PULSE) == Err(RecvTimeoutError::Timeout) {
        uplink.send(Head::new(Kind::Pulse), &[]);
        lines.try_iter().for_each(|line| uplink.relay(line));
        beats += 1;
        if !looks || beats % LOOK != 0 {
            continue;
        }
        if session.info().routers_zid().wait().next().is_some() {
            looks = false;
            if missed {
                uplink.log(log::Level::Info, "the Zenoh router is there");
            }
        } else if !missed {
            missed = true;
            uplink.log(
                log::Level::Warn,
                "no Zenoh router: nodes find each other through one, so start it (ros2 run rmw_zenoh_cpp rmw_zenohd, or zenohd)",
            );
        }
        looks &= checks == 0 || beats / LOOK < checks;
    }
}
