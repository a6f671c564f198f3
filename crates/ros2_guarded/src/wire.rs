//! Protocol between a node and its middleware process: frames over a Unix socket, and the plan that comes first.
//!
//! ```text
//! frame    length u32 │ kind u8 │ flag u8 │ endpoint u16 │ stamp or caller, 32 bytes │ body
//! ```
//! Both sides are the same program on the same machine, so numbers are sent in native byte order.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use ros2_client::QosProfile;
use ros2_client::qos::{Durability, History, Liveliness, Reliability, WhenFull};
use serde::{Deserialize, Serialize};

use crate::session::ZenohSession;

/// Longest body of a frame: more than any tissue that can be answered in time.
pub(crate) const LONGEST: usize = 16 << 20;
/// Length of the part before the body.
pub(super) const HEAD: usize = 8 + size_of::<Stamp>();
/// What a frame is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Kind {
    /// Node to process: the [`Plan`].
    Plan = 1,
    /// Both ways: a message of a topic; the stamp is when it was received and sent (from the node: when it was said).
    Message,
    /// Both ways: a call; the stamp is its caller.
    Request,
    /// Both ways: an answer; the stamp is its caller. The node's flag is whether the body has the caller's identity.
    Response,
    /// Process to node: every endpoint is made; the stamp has the participant's GUID.
    Ready,
    /// Process to node: something could not be made; the body says what and why, in two lines.
    Refused,
    /// Process to node: alive; the flag is whether it has heard itself.
    Pulse,
    /// Process to node: so many peers are matched with the endpoint.
    Matched,
    /// Process to node: the middleware did not take a message of the endpoint.
    Failed,
    /// Process to node: a line for the node's log; the flag is its level, the body target and text in two lines.
    Log,
    /// Process to node: why it ends.
    Farewell,
}

impl Kind {
    pub(super) fn of(byte: u8) -> Option<Self> {
        use Kind as K;
        [
            K::Plan,
            K::Message,
            K::Request,
            K::Response,
            K::Ready,
            K::Refused,
            K::Pulse,
            K::Matched,
            K::Failed,
            K::Log,
            K::Farewell,
        ]
        .into_iter()
        .find(|kind| *kind as u8 == byte)
    }
}

/// Times of a message (ns since 1970: received, sent) and the GUID of its publisher, or who asked (GUID and number of the request).
pub type Stamp = [u8; 32];

/// A stamp that says nothing.
pub(crate) const UNSTAMPED: Stamp = [0; 32];

/// Who publishes: the GUID of a writer, which `ros2 topic info --verbose` lists. Zeros where the middleware does not say.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Guid(pub [u8; 16]);

impl std::fmt::Display for Guid {
    /// As `ros2 topic info --verbose` has it: `01.10.8a...`.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for (at, byte) in self.0.iter().enumerate() {
            let dot = if at == 0 { "" } else { "." };
            write!(f, "{dot}{byte:02x}")?;
        }
        Ok(())
    }
}

/// Wall time, ns since 1970.
#[must_use]
pub fn wall_nanos() -> i64 {
    SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .map_or(0, |elapsed| i64::try_from(elapsed.as_nanos()).unwrap_or(i64::MAX))
}

/// Two times and a publisher as a stamp.
pub(crate) fn times([received, sent]: [i64; 2], publisher: Guid) -> Stamp {
    let mut stamp = UNSTAMPED;
    stamp[16..].copy_from_slice(&publisher.0);
    stamp[..8].copy_from_slice(&received.to_ne_bytes());
    stamp[8..16].copy_from_slice(&sent.to_ne_bytes());
    stamp
}

/// Whether a message that was said at a time has outlived its lifespan; wall times, ns.
pub(super) fn is_over(said_nanos: i64, lifespan: Option<Duration>, now_nanos: i64) -> bool {
    let age = i128::from(now_nanos) - i128::from(said_nanos);
    lifespan.is_some_and(|lifespan| age > i128::try_from(lifespan.as_nanos()).unwrap_or(i128::MAX))
}

/// The times of a stamp.
pub fn times_of(stamp: &Stamp) -> [i64; 2] {
    let [mut received, mut sent] = [[0; 8]; 2];
    received.copy_from_slice(&stamp[..8]);
    sent.copy_from_slice(&stamp[8..16]);
    [i64::from_ne_bytes(received), i64::from_ne_bytes(sent)]
}

/// The publisher of a stamp.
#[must_use]
pub fn publisher_of(stamp: &Stamp) -> Guid {
    let mut publisher = Guid::default();
    publisher.0.copy_from_slice(&stamp[16..]);
    publisher
}

/// A caller as a stamp.
pub(crate) fn caller(guid: [u8; 16], number: i64) -> Stamp {
    let mut stamp = UNSTAMPED;
    stamp[..16].copy_from_slice(&guid);
    stamp[16..24].copy_from_slice(&number.to_ne_bytes());
    stamp
}

/// The caller of a stamp.
pub(crate) fn caller_of(stamp: &Stamp) -> ([u8; 16], i64) {
    let (mut guid, mut number) = ([0; 16], [0; 8]);
    guid.copy_from_slice(&stamp[..16]);
    number.copy_from_slice(&stamp[16..24]);
    (guid, i64::from_ne_bytes(number))
}

/// The first part of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Head {
    /// What the frame is.
    pub kind: Kind,
    /// See [`Kind`].
    pub flag: u8,
    /// Number of the endpoint in the plan.
    pub endpoint: u16,
    /// Times, or who asked.
    pub stamp: Stamp,
}

impl Head {
    /// Of no endpoint.
    #[must_use]
    pub const fn new(kind: Kind) -> Self {
        Self { kind, flag: 0, endpoint: 0, stamp: UNSTAMPED }
    }

    /// Of an endpoint.
    #[must_use]
    pub const fn of(kind: Kind, endpoint: u16, stamp: Stamp) -> Self {
        Self { kind, flag: 0, endpoint, stamp }
    }

    /// Appends a frame whose body `fill` appends.
    ///
    /// # Errors
    /// What `fill` says, or that the body is too long; then nothing is appended.
    pub(crate) fn frame(
        self,
        bytes: &mut Vec<u8>,
        fill: impl FnOnce(&mut Vec<u8>) -> Result<(), String>,
    ) -> Result<(), String> {
        let start = bytes.len();
        bytes.extend([0; 4]);
        bytes.extend([self.kind as u8, self.flag]);
        bytes.extend(self.endpoint.to_ne_bytes());
        bytes.extend(self.stamp);
        let outcome = fill(bytes).and_then(|()| {
            let length = bytes.len() - start - HEAD;
            u32::try_from(length)
                .ok()
                .filter(|_| length <= LONGEST)
                .ok_or_else(|| format!("it has {length} bytes, the middleware takes {LONGEST}"))
        });
        match outcome {
            Ok(length) => bytes[start..start + 4].copy_from_slice(&length.to_ne_bytes()),
            Err(_) => bytes.truncate(start),
        }
        outcome.map(|_| ())
    }
}

/// Everything that the process is to make.
#[derive(Clone, Debug, Serialize, Deserialize, PartialEq)]
pub struct Plan {
    /// DDS domain, `ROS_DOMAIN_ID`.
    pub domain: u16,
    /// For programs on this machine only.
    pub localhost: bool,
    /// `/or1`, or `/`.
    pub namespace: String,
    /// Name without the namespace.
    pub node: String,
    /// The process ends when it needs more.
    pub memory_bytes: u64,
    /// Most verbose level of the middleware's own lines that somebody wants to see.
    pub verbosity: u8,
    /// One process has heard itself, so the next one must.
    pub hears: bool,
    /// First bytes of the GUID of the process before, which may have been killed.
    pub predecessor: Option<[u8; 12]>,
    /// Over Zenoh, and how, instead of DDS.
    pub zenoh: Option<ZenohSession>,
    /// What it makes.
    pub endpoints: Vec<Endpoint>,
}

/// One endpoint of the plan; its number is its place.
#[derive(Clone, Debug, Serialize, Deserialize, PartialEq)]
pub struct Endpoint {
    /// What it does.
    pub role: Role,
    /// Fully qualified, `/or1/predicted_cf`.
    pub name: String,
    /// `geometry_msgs`.
    pub package: String,
    /// `WrenchStamped`.
    pub type_name: String,
    /// RIHS01 hash of its type, which Zenoh's names have; none if it is not known.
    pub type_hash: Option<String>,
    /// Its QoS.
    pub quality: Quality,
}

/// What an endpoint does.
#[derive(Clone, Copy, Debug, Serialize, Deserialize, PartialEq, Eq)]
pub enum Role {
    /// Writes a topic.
    Publisher,
    /// Reads a topic.
    Subscription,
    /// Answers calls of a service.
    Server,
    /// Calls a service.
    Client {
        /// In the manner of rmw_cyclonedds, else of rmw_fastrtps.
        cyclone: bool,
    },
}

/// A QoS profile that can be sent.
#[derive(Clone, Copy, Debug, Serialize, Deserialize, PartialEq, Eq)]
pub struct Quality {
    reliable: bool,
    transient_local: bool,
    depth: Option<usize>,
    deadline: Option<Duration>,
    lifespan: Option<Duration>,
    liveliness_lease: Option<Duration>,
}

impl Quality {
    /// Time after which a message is of no use to anybody.
    pub(super) const fn lifespan(&self) -> Option<Duration> {
        self.lifespan
    }
}

impl From<&QosProfile> for Quality {
    fn from(profile: &QosProfile) -> Self {
        Self {
            reliable: matches!(profile.reliability, Reliability::Reliable { .. }),
            transient_local: profile.durability == Durability::TransientLocal,
            depth: match profile.history {
                History::KeepLast { depth } => Some(depth),
                History::KeepAll => None,
            },
            deadline: profile.deadline,
            lifespan: profile.lifespan,
            liveliness_lease: profile.liveliness_lease,
        }
    }
}

impl From<Quality> for QosProfile {
    fn from(quality: Quality) -> Self {
        Self {
            reliability: if quality.reliable {
                Reliability::Reliable { when_full: WhenFull::Fail }
            } else {
                Reliability::BestEffort
            },
            durability: if quality.transient_local { Durability::TransientLocal } else { Durability::Volatile },
            history: quality.depth.map_or(History::KeepAll, |depth| History::KeepLast { depth }),
            deadline: quality.deadline,
            lifespan: quality.lifespan,
            liveliness: Liveliness::Automatic,
            liveliness_lease: quality.liveliness_lease,
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::frames::{BUFFER, Frames};
    use crate::qos;

    #[test]
    fn frames_come_out_as_they_went_in_however_they_are_cut() {
        let mut bytes = Vec::new();
        let bodies: Vec<Vec<u8>> = [0, 1, 100, 3 * BUFFER].iter().map(|n| vec![7; *n]).collect();
        for (i, body) in bodies.iter().enumerate() {
            let stamp = caller([i as u8; 16], -5);
            let head = Head { flag: 3, ..Head::of(Kind::Request, i as u16, stamp) };
            head.frame(&mut bytes, |b| {
                b.extend(body);
                Ok(())
            })
            .unwrap();
        }
        for cut in [1, HEAD - 1, HEAD + 1, 4096, bytes.len()] {
            let (mut frames, mut found) = (Frames::new(), Vec::new());
            for mut piece in bytes.chunks(cut) {
                while !piece.is_empty() {
                    frames.read(&mut piece).unwrap();
                    while let Some((head, body)) = frames.next().unwrap() {
                        assert_eq!((head.kind, head.flag, usize::from(head.endpoint)), (Kind::Request, 3, found.len()));
                        assert_eq!(caller_of(&head.stamp), ([found.len() as u8; 16], -5));
                        found.push(body.to_vec());
                    }
                }
            }
            assert_eq!(found, bodies, "cut into pieces of {cut}");
        }
        let mut frames = Frames::new();
        frames.read(&[255_u8; 64][..]).unwrap();
        assert!(frames.next().is_err());
    }

    #[test]
    fn a_body_that_is_too_long_leaves_nothing_behind() {
        let mut bytes = vec![1];
        let outcome = Head::new(Kind::Message).frame(&mut bytes, |b| {
            b.resize(LONGEST + HEAD + 2, 0);
            Ok(())
        });
        assert!(outcome.is_err_and(|e| e.contains("bytes")));
        assert_eq!(bytes, [1]);
    }

    #[test]
    fn a_message_that_was_said_before_its_lifespan_is_over() {
        let lifespan = Some(Duration::from_millis(25));
        assert!(!is_over(0, lifespan, 25_000_000) && is_over(0, lifespan, 25_000_001) && !is_over(0, None, i64::MAX));
        assert!(!is_over(5, lifespan, 0), "a wall clock that was set back");
    }

    #[test]
    fn a_profile_survives_the_way() {
        for profile in [qos::sensor(5), qos::reliable(7), qos::latched(), qos::service()] {
            assert_eq!(QosProfile::from(Quality::from(&profile)), profile);
        }
        let publisher = Guid([7; 16]);
        let stamp = times([-1, i64::MAX], publisher);
        assert_eq!((times_of(&stamp), publisher_of(&stamp)), ([-1, i64::MAX], publisher));
        assert!(publisher.to_string().starts_with("07.07.") && publisher.to_string().len() == 47);
    }
}
