//! Service servers that answer callers with different middlewares at the same time.
//!
//! The DDS-based middlewares of ROS 2 use the same topics for a service but identify requests differently.
//! rmw_fastrtps sends the caller's identity as metadata of the message (inline QoS). rmw_cyclonedds puts it in front
//! of the message, in 16 bytes. A server here reads the bytes of a request and answers in the caller's format. The
//! first two bytes of the caller's GUID determine the format: they name its DDS implementation.

use std::marker::PhantomData;
use std::sync::Arc;

use byteorder::LittleEndian;
use ros2_client::ServiceMapping;
use serde::{Serialize, de::DeserializeOwned};

use super::environment::Environment;
use super::logging::Throttle;
use ros2_guarded::{Delivery, Head, Kind, Link, Mailbox, Stamp, cdr, is_own_machine_wide, whole_to_others};

/// RTPS vendor id of Eclipse Cyclone DDS.
const VENDOR_CYCLONE: [u8; 2] = [0x01, 0x10];
/// RTPS vendor id of RustDDS, whose programs choose their mapping.
const VENDOR_RUSTDDS: [u8; 2] = [0x01, 0x12];
/// Size of the identity and number of a request in front of the message, as in rmw_cyclonedds.
const CYCLONE_HEADER: usize = 16;
/// Shortest interval between two reports of calls that can't be read.
const COMPLAINTS: std::time::Duration = std::time::Duration::from_secs(10);

/// Mapping of a server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mapping {
    /// That of each caller. The given one is used for callers that can't be identified by their DDS implementation.
    OfCaller(ServiceMapping),
    /// One mapping for all callers.
    Fixed(ServiceMapping),
    /// Zenoh's: the identity is metadata of the message, and messages of any length stay in one piece.
    Zenoh,
}

impl Mapping {
    /// The mapping that the environment requests.
    #[must_use]
    pub const fn of_environment(environment: &Environment) -> Self {
        if environment.zenoh.is_some() { Self::Zenoh } else { Self::OfCaller(environment.mapping) }
    }

    /// The mapping of the node's own calls.
    #[must_use]
    pub(crate) const fn own(self) -> ServiceMapping {
        match self {
            Self::OfCaller(mapping) | Self::Fixed(mapping) => mapping,
            Self::Zenoh => ServiceMapping::Enhanced,
        }
    }

    /// `caller` begins with the caller's GUID.
    fn of(self, caller: &Stamp) -> ServiceMapping {
        match (self, &caller[..2]) {
            (Self::Fixed(mapping), _) => mapping,
            (Self::Zenoh, _) => ServiceMapping::Enhanced,
            (_, vendor) if vendor == VENDOR_CYCLONE => ServiceMapping::Cyclone,
            (Self::OfCaller(otherwise), vendor) if vendor == VENDOR_RUSTDDS => otherwise,
            _ => ServiceMapping::Enhanced,
        }
    }

    /// Description for the line that a node prints at its start.
    #[must_use]
    pub(crate) const fn describe(self) -> &'static str {
        match self {
            Self::OfCaller(_) => "rmw_fastrtps_cpp and rmw_cyclonedds_cpp have them",
            Self::Fixed(ServiceMapping::Cyclone) => "rmw_cyclonedds_cpp has them",
            Self::Fixed(_) => "rmw_fastrtps_cpp has them",
            Self::Zenoh => "rmw_zenoh_cpp has them",
        }
    }
}

/// The caller of a request; the answer is sent to it.
#[derive(Clone, Debug)]
pub struct Caller {
    id: Stamp,
    /// Bytes in front of the request, which must also precede the answer.
    header: Vec<u8>,
}

/// Largest call, bytes.
const LONGEST_CALL: usize = 60_000;
/// Largest answer to a caller whose identity is in front of it, bytes.
const LONGEST_ANSWER: usize = 1_000_000;
/// Largest answer to other callers on this machine, bytes: it must fit one UDP packet. RustDDS writes a byte too many
/// in front of the identity in the metadata of fragmented messages. So other implementations of DDS reject these as
/// malformed.
const LONGEST_WHOLE: usize = 60_000;

/// A service server.
pub struct Service<Q, R> {
    mailbox: Mailbox,
    link: Arc<Link>,
    endpoint: u16,
    mapping: Mapping,
    name: String,
    /// Whether callers may be on other machines.
    open: bool,
    complaints: std::cell::RefCell<Throttle>,
    types: PhantomData<fn(Q) -> R>,
}

impl<Q: DeserializeOwned, R: Serialize> Service<Q, R> {
    pub(super) fn new(
        mailbox: Mailbox,
        link: Arc<Link>,
        endpoint: u16,
        mapping: Mapping,
        name: String,
        open: bool,
    ) -> Self {
        let complaints = std::cell::RefCell::new(Throttle::new(COMPLAINTS));
        Self { mailbox, link, endpoint, mapping, name, open, complaints, types: PhantomData }
    }

    /// The next request that has arrived. A request that can't be read is reported and skipped.
    pub(crate) fn take(&self) -> Option<(Caller, Q)> {
        std::iter::from_fn(|| self.mailbox.take()).find_map(|delivery| self.read(&delivery))
    }

    /// Waits for the next request. A request that can't be read is reported and skipped.
    pub async fn next(&self) -> (Caller, Q) {
        loop {
            let delivery = self.mailbox.next().await;
            if let Some(request) = self.read(&delivery) {
                return request;
            }
        }
    }

    fn read(&self, delivery: &Delivery) -> Option<(Caller, Q)> {
        let read = if delivery.big_endian {
            Err("it is big-endian".to_owned())
        } else {
            self.split(delivery.stamp, &delivery.body)
        };
        read.map_err(|reason| self.complain(&reason)).ok()
    }

    fn split(&self, id: Stamp, bytes: &[u8]) -> Result<(Caller, Q), String> {
        if bytes.len() > LONGEST_CALL {
            return Err(format!("it has {} bytes, and {LONGEST_CALL} are taken", bytes.len()));
        }
        let split = if self.mapping.of(&id) == ServiceMapping::Cyclone { CYCLONE_HEADER } else { 0 };
        let (header, body) = bytes.split_at_checked(split).ok_or_else(|| format!("it has {} bytes", bytes.len()))?;
        let (request, _) = cdr_encoding::from_bytes::<Q, LittleEndian>(body).map_err(|e| e.to_string())?;
        Ok((Caller { id, header: header.to_vec() }, request))
    }

    fn complain(&self, reason: &str) {
        if self.complaints.borrow_mut().pass().is_some() {
            tracing::warn!(
                "a call of `{}` can't be read: {reason}. If the caller is neither on rmw_fastrtps_cpp nor on \
                 rmw_cyclonedds_cpp, try -p service_mapping:=enhanced or -p service_mapping:=cyclone",
                self.name
            );
        }
    }

    /// Answers a request.
    pub fn send(&self, caller: Caller, response: &R) {
        let (in_payload, mut bytes_sent) = (!caller.header.is_empty(), 0);
        let head = Head { flag: u8::from(in_payload), ..Head::of(Kind::Response, self.endpoint, caller.id) };
        let whole = in_payload || self.mapping == Mapping::Zenoh;
        let longest = if whole { LONGEST_ANSWER } else { LONGEST_WHOLE };
        let sent = self.link.send(head, false, |bytes| {
            bytes.extend(&caller.header);
            // The 16 bytes of the header keep the alignment of the data after it.
            let before = bytes.len();
            cdr(bytes, response)?;
            bytes_sent = bytes.len() - before;
            if bytes_sent <= longest {
                return Ok(());
            }
            Err(format!("it has {bytes_sent} bytes, and {longest} are sent: ask for less at once"))
        });
        if let Err(reason) = sent {
            tracing::warn!("an answer of `{}` could not be sent: {reason}", self.name);
        } else if (self.open || !is_own_machine_wide())
            && !whole
            && caller.id[..2] != VENDOR_RUSTDDS
            && bytes_sent > whole_to_others()
        {
            self.warn_of_fragments(bytes_sent);
        }
    }

    fn warn_of_fragments(&self, bytes: usize) {
        if self.complaints.borrow_mut().pass().is_some() {
            let (where_, others) = if is_own_machine_wide() {
                (" on another machine", "one on this machine does, and so does rmw_cyclonedds_cpp")
            } else {
                ("", "rmw_cyclonedds_cpp does (a build with the patch of netdev reaches both)")
            };
            tracing::warn!(
                "an answer of `{}` has {bytes} bytes: a caller on rmw_fastrtps_cpp{where_} does not get it; {others}",
                self.name
            );
        }
    }

    /// Answers all requests that have arrived.
    pub fn answer(&self, mut respond: impl FnMut(Q) -> R) {
        while let Some((caller, request)) = self.take() {
            self.send(caller, &respond(request));
        }
    }
}

/// A client of a service.
pub struct Client<Q, R> {
    mailbox: Mailbox,
    link: Arc<Link>,
    endpoint: u16,
    types: PhantomData<fn(Q) -> R>,
}

impl<Q: Serialize, R: DeserializeOwned> Client<Q, R> {
    pub(super) fn new(mailbox: Mailbox, link: Arc<Link>, endpoint: u16) -> Self {
        Self { mailbox, link, endpoint, types: PhantomData }
    }

    /// Sends a request; false if the middleware rejected it.
    pub fn ask(&self, request: &Q) -> bool {
        let head = Head { endpoint: self.endpoint, ..Head::new(Kind::Request) };
        self.link.send(head, false, |bytes| cdr(bytes, request)).is_ok()
    }

    /// An answer that has arrived.
    #[must_use]
    pub fn answer(&self) -> Option<R> {
        let delivery = self.mailbox.take()?;
        cdr_encoding::from_bytes::<R, LittleEndian>(&delivery.body).ok().map(|(response, _)| response)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn caller(vendor: [u8; 2]) -> Stamp {
        let mut guid = [7; 32];
        guid[..2].copy_from_slice(&vendor);
        guid
    }

    #[test]
    fn the_callers_dds_decides() {
        let auto = Mapping::OfCaller(ServiceMapping::Enhanced);
        assert_eq!(auto.of(&caller(VENDOR_CYCLONE)), ServiceMapping::Cyclone);
        assert_eq!(auto.of(&caller([0x01, 0x0f])), ServiceMapping::Enhanced, "Fast DDS");
        assert_eq!(auto.of(&caller(VENDOR_RUSTDDS)), ServiceMapping::Enhanced);
        let auto = Mapping::OfCaller(ServiceMapping::Cyclone);
        assert_eq!(auto.of(&caller(VENDOR_RUSTDDS)), ServiceMapping::Cyclone);
        assert_eq!(auto.of(&caller([0x01, 0x0f])), ServiceMapping::Enhanced);
        assert_eq!(Mapping::Fixed(ServiceMapping::Enhanced).of(&caller(VENDOR_CYCLONE)), ServiceMapping::Enhanced);
    }
}
