//! Publishers and subscriptions.

use std::any::Any;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::Duration;

use ros2_client::QosProfile;
use ros2_client::qos::{Durability, History, Reliability};
use zenoh::pubsub::Publisher;
use zenoh::qos::CongestionControl;
use zenoh::sample::Sample;
use zenoh::{Session, Wait};
use zenoh_ext::{
    AdvancedPublisher, AdvancedPublisherBuilderExt as _, AdvancedSubscriberBuilderExt as _, CacheConfig, HistoryConfig,
};

use super::keys::{Extra, encapsulated, gid, plain};
use crate::uplink::Uplink;
use crate::wire::{Guid, Head, Kind, times, wall_nanos};

/// A publisher: one that keeps its last messages for those who come later, or not.
enum Way {
    Plain(Publisher<'static>),
    Kept(AdvancedPublisher<'static>),
}

/// See the module.
pub(super) struct Writer {
    pub number: u16,
    /// See [`QosProfile::lifespan`].
    pub lifespan: Option<Duration>,
    way: Way,
    gid: [u8; 16],
    said: AtomicI64,
}

impl Writer {
    /// Makes a publisher of `key`.
    ///
    /// # Errors
    /// What Zenoh says.
    pub(crate) fn new(
        number: u16,
        key: &str,
        token: &str,
        session: &Session,
        profile: &QosProfile,
    ) -> zenoh::Result<Self> {
        let all = profile.history == History::KeepAll && matches!(profile.reliability, Reliability::Reliable { .. });
        let congestion = if all { CongestionControl::Block } else { CongestionControl::Drop };
        // Not gathered with later ones: a force is of use at once.
        let builder = session.declare_publisher(key.to_owned()).congestion_control(congestion).express(true);
        let way = if profile.durability == Durability::TransientLocal {
            let cache = CacheConfig::default().max_samples(depth(profile));
            Way::Kept(builder.cache(cache).publisher_detection().wait()?)
        } else {
            Way::Plain(builder.wait()?)
        };
        Ok(Self { number, lifespan: profile.lifespan, way, gid: gid(token), said: AtomicI64::new(0) })
    }

    /// Publishes; false if Zenoh refuses.
    pub(crate) fn publish(&self, body: &[u8]) -> bool {
        let number = self.said.fetch_add(1, Ordering::Relaxed) + 1;
        let extra = Extra { number, sent: wall_nanos(), gid: self.gid }.bytes();
        let payload = encapsulated(body);
        match &self.way {
            Way::Plain(publisher) => publisher.put(payload).attachment(&extra[..]).wait().is_ok(),
            Way::Kept(publisher) => publisher.put(payload).attachment(&extra[..]).wait().is_ok(),
        }
    }
}

const fn depth(profile: &QosProfile) -> usize {
    match profile.history {
        History::KeepLast { depth } => depth,
        History::KeepAll => usize::MAX,
    }
}

/// Makes a subscription to `key`; what comes goes to the node as long as the result lives.
///
/// # Errors
/// What Zenoh says.
pub(super) fn subscribe(
    number: u16,
    key: &str,
    session: &Session,
    profile: &QosProfile,
    uplink: &Arc<Uplink>,
) -> zenoh::Result<Box<dyn Any>> {
    let uplink = Arc::clone(uplink);
    let take = move |sample: Sample| {
        let received = wall_nanos();
        let payload = sample.payload().to_bytes();
        let Some((big_endian, body)) = plain(&payload) else { return };
        let extra = sample.attachment().and_then(|extra| Extra::read(&extra.to_bytes()));
        let (sent, publisher) = extra.map_or((received, Guid::default()), |extra| (extra.sent, Guid(extra.gid)));
        let head = Head::of(Kind::Message, number, times([received, sent], publisher));
        uplink.send(Head { flag: u8::from(big_endian), ..head }, body);
    };
    let builder = session.declare_subscriber(key.to_owned()).callback(take);
    if profile.durability == Durability::Volatile {
        return Ok(Box::new(builder.wait()?));
    }
    let history = HistoryConfig::default().detect_late_publishers().max_samples(depth(profile));
    Ok(Box::new(builder.history(history).wait()?))
}
