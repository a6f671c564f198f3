//! What rmw_zenoh_cpp of Jazzy and later writes: key expressions, tokens of the graph, attachments.
//!
//! ```text
//! data     <domain>/<name without its first slash>/<DDS type>/<type hash>
//! token    @ros2_lv/<domain>/<session>/<node>/<entity>/<kind>/<enclave>/<namespace>/<node's name>
//!          and for all but nodes /<name>/<DDS type>/<type hash>/<QoS>; `/` inside a part is `%`
//! extra    sequence number i64, time sent i64 (ns since 1970), length of the GID u8 = 16, GID; little-endian
//! ```
//! The GID is the 128-bit XXH3 of the entity's token.

use ros2_client::QosProfile;
use ros2_client::qos::{Durability, History, Reliability};
use xxhash_rust::xxh3::xxh3_128;

use crate::wire::{Endpoint, Plan, Role};

/// Where the tokens of the graph are.
const SPACE: &str = "@ros2_lv";
/// What is written where a type's hash is not known, as rmw_zenoh_cpp does before Iron.
const NO_HASH: &str = "TypeHashNotSupported";
/// In front of a message: plain CDR, little-endian.
const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];
/// Length of what goes with a message.
const EXTRA: usize = 33;

/// Everything that a name in the graph tells.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Seen {
    pub session: String,
    /// `MP`, `MS`, `SS`, `SC`.
    pub kind: String,
    /// With its first slash.
    pub name: String,
    pub dds_type: String,
    pub hash: String,
}

/// The names of one node's endpoints.
pub(super) struct Keys<'a> {
    plan: &'a Plan,
    session: String,
}

impl<'a> Keys<'a> {
    pub(crate) fn new(plan: &'a Plan, session: String) -> Self {
        Self { plan, session }
    }

    /// Token of the node itself.
    pub(crate) fn node(&self) -> String {
        self.token(0, "NN")
    }

    /// Token of an endpoint; entity 0 is the node.
    pub(crate) fn endpoint(&self, number: u16, endpoint: &Endpoint) -> String {
        let profile = QosProfile::from(endpoint.quality);
        let (name, qos) = (mangled(&endpoint.name), quality(&profile));
        let own = self.token(u32::from(number) + 1, kind(endpoint.role));
        format!("{own}/{name}/{}/{}/{qos}", dds_type(endpoint), hash(endpoint))
    }

    /// What is published, subscribed to or called.
    pub(crate) fn data(&self, endpoint: &Endpoint) -> String {
        let name = endpoint.name.trim_matches('/');
        format!("{}/{name}/{}/{}", self.plan.domain, dds_type(endpoint), hash(endpoint))
    }

    /// All tokens of the domain.
    pub(crate) fn graph(&self) -> String {
        format!("{SPACE}/{}/**", self.plan.domain)
    }

    fn token(&self, entity: u32, kind: &str) -> String {
        let Plan { domain, namespace, node, .. } = self.plan;
        format!("{SPACE}/{domain}/{}/0/{entity}/{kind}/%/{}/{node}", self.session, mangled(namespace))
    }
}

/// Reads the token of an endpoint.
pub(super) fn seen(token: &str) -> Option<Seen> {
    let mut parts = token.split('/');
    let (session, kind) = (parts.nth(2)?, parts.nth(2)?);
    let (name, dds_type, hash) = (parts.nth(3)?, parts.next()?, parts.next()?);
    let own = |text: &str| text.to_owned();
    Some(Seen {
        session: own(session),
        kind: own(kind),
        name: name.replace('%', "/"),
        dds_type: own(dds_type),
        hash: own(hash),
    })
}

/// `std_msgs::msg::dds_::String_`.
pub(super) fn dds_type(endpoint: &Endpoint) -> String {
    let part = match endpoint.role {
        Role::Publisher | Role::Subscription => "msg",
        Role::Server | Role::Client { .. } => "srv",
    };
    format!("{}::{part}::dds_::{}_", endpoint.package, endpoint.type_name)
}

/// Hash of the endpoint's type.
pub(super) fn hash(endpoint: &Endpoint) -> &str {
    endpoint.type_hash.as_deref().unwrap_or(NO_HASH)
}

pub(super) const fn kind(role: Role) -> &'static str {
    match role {
        Role::Publisher => "MP",
        Role::Subscription => "MS",
        Role::Server => "SS",
        Role::Client { .. } => "SC",
    }
}

fn mangled(name: &str) -> String {
    if name.is_empty() { "%".to_owned() } else { name.replace('/', "%") }
}

/// `reliability:durability:history,depth:deadline:lifespan:liveliness,lease`, numbers as in rmw/types.h; what is as by default (reliable,
/// volatile, the last ones, no times) is left out.
fn quality(profile: &QosProfile) -> String {
    let reliability = if profile.reliability == Reliability::BestEffort { "2" } else { "" };
    let durability = if profile.durability == Durability::TransientLocal { "1" } else { "" };
    let history = match profile.history {
        History::KeepLast { depth } => format!(",{depth}"),
        History::KeepAll => "2,0".to_owned(),
    };
    let time = |time: Option<std::time::Duration>| {
        time.map_or(",".to_owned(), |time| format!("{},{}", time.as_secs(), time.subsec_nanos()))
    };
    let (deadline, lifespan, lease) = (time(profile.deadline), time(profile.lifespan), time(profile.liveliness_lease));
    format!("{reliability}:{durability}:{history}:{deadline}:{lifespan}:,{lease}")
}

/// GID of the entity with this token.
pub(super) fn gid(token: &str) -> [u8; 16] {
    xxh3_128(token.as_bytes()).to_le_bytes()
}

/// What goes with a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Extra {
    pub number: i64,
    pub sent: i64,
    pub gid: [u8; 16],
}

impl Extra {
    pub(crate) fn bytes(&self) -> [u8; EXTRA] {
        let mut bytes = [0; EXTRA];
        bytes[..8].copy_from_slice(&self.number.to_le_bytes());
        bytes[8..16].copy_from_slice(&self.sent.to_le_bytes());
        bytes[16] = 16;
        bytes[17..].copy_from_slice(&self.gid);
        bytes
    }

    pub(crate) fn read(bytes: &[u8]) -> Option<Self> {
        let bytes: &[u8; EXTRA] = bytes.try_into().ok()?;
        let eight = |from: usize| bytes.get(from..from + 8).and_then(|b| b.try_into().ok()).map(i64::from_le_bytes);
        let gid = (bytes[16] == 16).then(|| bytes.last_chunk().copied()).flatten()?;
        Some(Self { number: eight(0)?, sent: eight(8)?, gid })
    }
}

/// A message as it is sent.
pub(super) fn encapsulated(body: &[u8]) -> Vec<u8> {
    [&ENCAPSULATION, body].concat()
}

/// A message as it came: whether its numbers are big-endian, and its CDR; `None` for what is not plain CDR.
pub(super) fn plain(payload: &[u8]) -> Option<(bool, &[u8])> {
    let (head, body) = payload.split_at_checked(ENCAPSULATION.len())?;
    (head[0] == 0 && head[1] <= 1).then_some((head[1] == 0, body))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::qos;
    use crate::wire::Quality;

    fn endpoint(role: Role, profile: &QosProfile) -> Endpoint {
        Endpoint {
            role,
            name: "/or1/chatter".to_owned(),
            package: "std_msgs".to_owned(),
            type_name: "String".to_owned(),
            type_hash: Some("RIHS01_df66".to_owned()),
            quality: Quality::from(profile),
        }
    }

    #[test]
    fn names_are_those_of_rmw_zenoh() {
        let plan = Plan {
            domain: 2,
            localhost: true,
            namespace: "/or1".to_owned(),
            node: "twin".to_owned(),
            memory_bytes: 0,
            verbosity: 1,
            hears: false,
            predecessor: None,
            zenoh: None,
            endpoints: Vec::new(),
        };
        let keys = Keys::new(&plan, "aac3".to_owned());
        let publisher = endpoint(Role::Publisher, &qos::latched());
        assert_eq!(keys.data(&publisher), "2/or1/chatter/std_msgs::msg::dds_::String_/RIHS01_df66");
        assert_eq!(keys.node(), "@ros2_lv/2/aac3/0/0/NN/%/%or1/twin");
        let token = keys.endpoint(9, &publisher);
        assert_eq!(
            token,
            "@ros2_lv/2/aac3/0/10/MP/%/%or1/twin/%or1%chatter/std_msgs::msg::dds_::String_/RIHS01_df66/:1:,1:,:,:,,"
        );
        let seen = seen(&token).unwrap();
        assert_eq!(
            (&*seen.session, &*seen.kind, &*seen.name, &*seen.hash),
            ("aac3", "MP", "/or1/chatter", "RIHS01_df66")
        );
        assert_eq!(super::seen(&keys.node()), None);
        let root = Keys::new(&plan, "aac3".to_owned()).endpoint(0, &endpoint(Role::Server, &qos::sensor(7)));
        assert!(root.contains("/1/SS/") && root.contains("::srv::") && root.ends_with("/2::,7:,:,:,,"), "{root}");
    }

    #[test]
    fn what_goes_with_a_message_survives_the_way() {
        let extra = Extra { number: 3, sent: -7, gid: gid("@ros2_lv/0") };
        assert_eq!(Extra::read(&extra.bytes()), Some(extra));
        assert_eq!(Extra::read(&extra.bytes()[1..]), None);
        assert_eq!(plain(&encapsulated(&[9, 8])), Some((false, &[9, 8][..])));
        assert_eq!(plain(&[0, 0, 0, 0, 5]), Some((true, &[5][..])));
        assert_eq!((plain(&[0, 7, 0, 0]), plain(&[0, 1])), (None, None), "XCDR2, and nothing");
    }
}
