//! Calls and answers of services on their way between the node and the network.

use std::cell::RefCell;
use std::collections::{BTreeMap, VecDeque};
use std::time::{Duration, Instant};

use ros2_client::dds::rustdds::no_key::DataWriterCdr;
use ros2_client::dds::rustdds::rpc::SampleIdentity;
use ros2_client::dds::rustdds::{GUID, QosPolicies, SequenceNumber, Timestamp, TopicKind, WriteOptionsBuilder};
use ros2_client::{Client, Context, MessageInfo, Node, QosProfile, RmwRequestId, Subscription};
use smol::channel::Receiver;

use super::uplink::Uplink;
use super::wire::{Head, Kind, UNSTAMPED, caller, caller_of};
use crate::raw::RawCdr;
use crate::throttle::Throttle;

/// Time between two looks for answers, which nobody waits for in a hurry.
const ANSWERS: Duration = Duration::from_millis(20);
/// Answers and calls that may wait.
pub(super) const ORDERS: usize = 1024;
/// Time between two looks for the readers of answers that wait.
const LOOK: Duration = Duration::from_millis(5);
/// Time from a match to the first answer that is written. RustDDS reports a match and then tells the reader the number of its
/// newest message. An answer that is written in between has that number. To Cyclone DDS it is history, which is discarded.
const SETTLING: Duration = Duration::from_millis(30);
/// An answer waits so long for its caller's reader to be discovered: on a busy machine, discovery takes seconds.
const PATIENCE: Duration = Duration::from_secs(10);
/// Time between two lines on answers that nobody reads.
const COMPLAINTS: Duration = Duration::from_secs(10);

/// An answer or a call on its way to the network.
pub(super) struct Order {
    pub head: Head,
    pub body: Vec<u8>,
}

/// A server: calls come by a subscription and answers go by a writer, as ros2-client's `Server` has them.
///
/// That one puts the caller's identity beside every answer (inline QoS), and RustDDS 0.15.1 writes one byte too many in front of it
/// where an answer is cut into fragments, which makes it malformed for others. rmw_cyclonedds has the identity in the payload and
/// needs none beside it; without it its fragments are sound.
pub(super) struct Served {
    pub number: u16,
    /// DDS topic of the answers.
    pub replies: String,
    calls: Subscription<RawCdr>,
    answers: DataWriterCdr<RawCdr>,
}

impl Served {
    /// Makes the server of `PACKAGE/srv/TYPE` called `service`.
    ///
    /// # Errors
    /// What could not be made.
    pub(crate) fn new(
        number: u16,
        context: &Context,
        node: &mut Node,
        [service, package, type_name]: [&str; 3],
        profile: &QosProfile,
    ) -> Result<Self, String> {
        let participant = context.domain_participant();
        let quality = QosPolicies::from(profile.clone());
        let topic = |name: String, part: &str| {
            let of_type = format!("{package}::srv::dds_::{type_name}_{part}_");
            participant.create_topic(name, of_type, &quality, TopicKind::NoKey).map_err(|e| e.to_string())
        };
        let (replies, calls) = (reply_topic(service), format!("rq{service}Request"));
        let calls = node.create_subscription(&topic(calls, "Request")?, None).map_err(|e| e.to_string())?;
        let publisher = participant.create_publisher(&quality).map_err(|e| e.to_string())?;
        let answers = topic(replies.clone(), "Response")?;
        let answers = publisher.create_datawriter_no_key_cdr(&answers, None).map_err(|e| e.to_string())?;
        Ok(Self { number, replies, calls, answers })
    }

    /// The reader of the calls.
    pub(crate) fn reader(&self) -> GUID {
        self.calls.guid()
    }

    /// Sends an answer; its caller's identity goes beside it unless the payload has it.
    fn answer(&self, id: RmwRequestId, in_payload: bool, answer: RawCdr) -> bool {
        let beside = (!in_payload).then(|| SampleIdentity::from(id));
        let options = WriteOptionsBuilder::new().source_timestamp(Timestamp::now()).related_sample_identity_opt(beside);
        self.answers.write_with_options(answer, options.build()).is_ok()
    }
}

/// Who calls: as the caller says beside its call (rmw_fastrtps), and else its writer and the number of its message.
fn who(info: &MessageInfo) -> RmwRequestId {
    let own = RmwRequestId { writer_gid: info.publisher_gid(), sequence_number: info.sequence_number() };
    let said = info.related_request_id().unwrap_or(own);
    // Fast DDS leaves the number out.
    let number_said = said.sequence_number != i64::from(SequenceNumber::UNKNOWN);
    if number_said { said } else { RmwRequestId { sequence_number: own.sequence_number, ..said } }
}

/// The DDS topic of a service's answers.
pub(super) fn reply_topic(service: &str) -> String {
    format!("rr{service}Reply")
}

/// Readers of answers that discovery has told of.
///
/// A caller has a writer and a reader, and discovery tells of one after the other: a call can be here before it is known
/// who reads its answer. What is written by then is lost, since answers are volatile, so it waits, as it does in the
/// middlewares of ROS.
#[derive(Default)]
pub(super) struct ReplyReaders {
    /// Each with its topic, "" until discovery has told it, and the time of its match with a writer of the node. Of the two the
    /// match may be told first.
    known: RefCell<BTreeMap<GUID, (String, Option<Instant>)>>,
}

impl ReplyReaders {
    /// Discovery tells of a reader. Its writer is matched a moment later, and what is written in between is lost.
    pub(crate) fn detected(&self, reader: GUID, topic: &str) {
        if topic.starts_with("rr/") {
            topic.clone_into(&mut self.known.borrow_mut().entry(reader).or_default().0);
        }
    }

    /// A writer of the node is matched with a reader.
    pub(crate) fn matched(&self, reader: GUID) {
        self.known.borrow_mut().entry(reader).or_default().1.get_or_insert_with(Instant::now);
    }

    pub(crate) fn forget(&self, gone: impl Fn(GUID) -> bool) {
        self.known.borrow_mut().retain(|reader, _| !gone(*reader));
    }

    /// Whether an answer on this topic reaches the caller at this time.
    fn has(&self, caller: GUID, topic: &str, now: Instant) -> bool {
        let ready = |matched: Instant| now.saturating_duration_since(matched) >= SETTLING;
        let of_caller = |reader: &GUID, of: &str| reader.prefix == caller.prefix && of == topic;
        let known = self.known.borrow();
        known.iter().any(|(reader, (of, matched))| matched.is_some_and(ready) && of_caller(reader, of))
    }
}

/// Takes the calls of a service to the node.
pub(super) async fn be_asked(served: &Served, uplink: &Uplink) {
    loop {
        match served.calls.async_take().await {
            Ok((raw, info)) => {
                let id = who(&info);
                let stamp = caller(id.writer_gid.to_bytes16(), id.sequence_number);
                let head = Head::of(Kind::Request, served.number, stamp);
                uplink.send(Head { flag: u8::from(raw.is_big_endian()), ..head }, raw.as_slice());
            }
            Err(_) => drop(smol::Timer::after(Duration::from_millis(1)).await),
        }
    }
}

/// Takes answers to the node's own calls to it.
pub(super) async fn be_answered(clients: &[(u16, Client<RawCdr, RawCdr>)], uplink: &Uplink) {
    loop {
        for (number, client) in clients {
            while let Ok(Some((_, raw))) = client.receive_response() {
                uplink.send(Head::of(Kind::Response, *number, UNSTAMPED), raw.as_slice());
            }
        }
        smol::Timer::after(ANSWERS).await;
    }
}

/// Sends the node's answers and calls.
pub(super) async fn obey(
    orders: &Receiver<Order>,
    servers: &[Served],
    clients: &[(u16, Client<RawCdr, RawCdr>)],
    readers: &ReplyReaders,
    uplink: &Uplink,
) {
    let may_go = |order: &Order| {
        let served = servers.iter().find(|s| s.number == order.head.endpoint);
        order.head.kind != Kind::Response
            || served.is_none_or(|s| {
                readers.has(GUID::from_bytes(caller_of(&order.head.stamp).0), &s.replies, Instant::now())
            })
    };
    let mut waiting: VecDeque<(Instant, Order)> = VecDeque::new();
    let mut unread = Throttle::new(COMPLAINTS);
    loop {
        let order = async { Some(orders.recv().await) };
        let look = async {
            if waiting.is_empty() {
                smol::future::pending::<()>().await;
            }
            smol::Timer::after(LOOK).await;
            None
        };
        match smol::future::or(order, look).await {
            Some(Ok(order)) => waiting.push_back((Instant::now(), order)),
            Some(Err(_)) => return,
            None => {}
        }
        let mut surplus = waiting.len().saturating_sub(ORDERS);
        waiting.retain_mut(|(since, order)| {
            let waits = surplus == 0 && since.elapsed() < PATIENCE && !may_go(order);
            surplus = surplus.saturating_sub(1);
            if since.elapsed() >= PATIENCE && !may_go(order) && unread.pass().is_some() {
                let topic = servers.iter().find(|s| s.number == order.head.endpoint).map_or("", |s| &s.replies);
                let text = format!(
                    "no reader of `{topic}` for an answer, which is lost: its caller has gone, or does not listen"
                );
                uplink.log(log::Level::Warn, &text);
            }
            if !waits && !send(order, servers, clients) {
                uplink.log(log::Level::Warn, "a call or an answer of a service could not be sent");
            }
            waits
        });
    }
}

fn send(order: &mut Order, servers: &[Served], clients: &[(u16, Client<RawCdr, RawCdr>)]) -> bool {
    let (head, raw) = (order.head, RawCdr::new(std::mem::take(&mut order.body)));
    if head.kind == Kind::Response {
        let (guid, sequence_number) = caller_of(&head.stamp);
        let id = RmwRequestId { writer_gid: GUID::from_bytes(guid).into(), sequence_number };
        servers.iter().find(|s| s.number == head.endpoint).is_some_and(|s| s.answer(id, head.flag != 0, raw))
    } else {
        clients.iter().find(|c| c.0 == head.endpoint).is_some_and(|c| c.1.send_request(raw).is_ok())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reader_that_is_matched_before_it_is_known_is_known() {
        let reader = |n: u8| GUID::from_bytes([n; 16]);
        for matched_first in [true, false] {
            let readers = ReplyReaders::default();
            let settled = || Instant::now() + SETTLING;
            let has = || readers.has(reader(1), "rr/twin/resetReply", settled());
            if matched_first {
                readers.matched(reader(1));
            }
            readers.detected(reader(1), "rr/twin/resetReply");
            assert_eq!(has(), matched_first);
            let before = Instant::now();
            readers.matched(reader(1));
            assert!(matched_first || !readers.has(reader(1), "rr/twin/resetReply", before), "not yet settled");
            let other = |n: u8, topic: &str| readers.has(reader(n), topic, settled());
            assert!(has() && !other(1, "rr/twin/tareReply") && !other(2, "rr/twin/resetReply"));
            readers.forget(|guid| guid == reader(1));
            assert!(!has());
        }
    }
}
