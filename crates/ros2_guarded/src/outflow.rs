//! What the node says on its way to the network: small messages at once, large ones one after the other with a pause behind each.

use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use crossbeam_channel::{Receiver, Sender, bounded};
use ros2_client::Publisher;

use super::drops::Drops;
use super::frames::Frames;
use super::services::Order;
use super::uplink::Uplink;
use super::wire::{Head, Kind, UNSTAMPED, is_over, times_of, wall_nanos};
use crate::raw::RawCdr;

/// Messages of so many bytes are several datagrams, of which a receive buffer of 208 kB, Linux' default, holds three or four.
const LARGE: usize = 60_000;
/// Large messages follow one another at this rate, bytes per second: 160 kB have 5 ms, in which the reader takes them out of its
/// buffer. Three topics of them at 20 Hz need 9.6 MB/s.
const PACE: f64 = 32.0e6;
/// Large messages that may wait.
const WAITING: usize = 16;

/// A publisher of the plan.
pub(super) struct Writer {
    pub number: u16,
    pub name: String,
    pub publisher: Publisher<RawCdr>,
    /// What was said longer ago is not sent any more: this process may have been frozen, or the node behind it.
    pub lifespan: Option<Duration>,
    /// Whether a reader on Fast DDS, perhaps on another machine, is matched that has not been spoken of.
    pub fast_dds: Arc<AtomicBool>,
}

impl Writer {
    fn publish(&self, said_nanos: i64, body: Vec<u8>, uplink: &Uplink) {
        if is_over(said_nanos, self.lifespan, wall_nanos()) {
            return;
        }
        if self.publisher.publish(RawCdr::new(body)).is_err() {
            uplink.send(Head::of(Kind::Failed, self.number, UNSTAMPED), &[]);
        }
    }
}

/// A large message that waits: its writer's place, when it was said, its body.
type Waiting = (usize, i64, Vec<u8>);

/// Publishes what the node says and hands on its answers and calls, until it closes the socket.
pub(super) fn publish_all(
    writers: &[Writer],
    frames: Frames,
    socket: &UnixStream,
    uplink: &Uplink,
    orders: &smol::channel::Sender<Order>,
) {
    let (large, waiting) = bounded(WAITING);
    thread::scope(|scope| {
        let paced = || publish_paced(writers, &waiting, uplink);
        if let Err(error) = thread::Builder::new().name("large to network".to_owned()).spawn_scoped(scope, paced) {
            uplink.log(log::Level::Error, &format!("large messages are not sent: {error}"));
        }
        sort(writers, frames, socket, uplink, orders, &large);
        drop(large);
    });
}

/// Takes what the node says apart. A topic that has had a large message keeps its order: all that follow go behind it.
fn sort(
    writers: &[Writer],
    frames: Frames,
    socket: &UnixStream,
    uplink: &Uplink,
    orders: &smol::channel::Sender<Order>,
    large: &Sender<Waiting>,
) {
    let mut is_large = vec![false; writers.len()];
    frames.take_all(socket, |head, body| {
        if head.kind != Kind::Message {
            if orders.try_send(Order { head, body: body.to_vec() }).is_err() {
                uplink.log(log::Level::Warn, "an answer of a service is lost: too many wait");
            }
            return;
        }
        let Ok(at) = writers.binary_search_by_key(&head.endpoint, |w| w.number) else { return };
        let (writer, is_large) = (&writers[at], &mut is_large[at]);
        if body.len() > LARGE && writer.fast_dds.swap(false, Ordering::Relaxed) {
            uplink.log(log::Level::Info, &advice(&writer.name, body.len()));
        }
        *is_large |= body.len() > LARGE;
        let [said_nanos, _] = times_of(&head.stamp);
        if !*is_large {
            writer.publish(said_nanos, body.to_vec(), uplink);
        } else if large.try_send((at, said_nanos, body.to_vec())).is_err() {
            uplink.send(Head::of(Kind::Failed, head.endpoint, UNSTAMPED), &[]);
        }
    });
}

/// Publishes large messages one after the other.
fn publish_paced(writers: &[Writer], waiting: &Receiver<Waiting>, uplink: &Uplink) {
    let mut drops = Drops::new();
    for (at, said_nanos, body) in waiting {
        if let Some(notice) = drops.notice() {
            uplink.log(log::Level::Warn, &notice);
        }
        let pause = pause_behind(body.len());
        if let Some(writer) = writers.get(at) {
            writer.publish(said_nanos, body, uplink);
        }
        thread::sleep(pause);
    }
}

/// Time in which a reader takes so many bytes out of its buffer.
fn pause_behind(bytes: usize) -> Duration {
    #[allow(clippy::cast_precision_loss)] // far below 2^53
    Duration::from_secs_f64(bytes as f64 / PACE)
}

fn advice(topic: &str, bytes: usize) -> String {
    format!(
        "`{topic}`: a reader on Fast DDS, whose default receive buffer may be too small for messages of {bytes} bytes from another machine; if it misses \
         some, start it there with FASTDDS_DEFAULT_PROFILES_FILE naming share/needle_twin/fast_dds.xml (launch-scripts/fast_dds.xml)"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_twin_shows_at_its_rates_finds_room() {
        let second = pause_behind(160_000) * 3 * 20;
        assert!(second < Duration::from_millis(500), "{second:?} of a second for three topics at 20 Hz");
    }
}
