//! Who else is on a domain: nodes, topics and their types, as far as they are heard within a time.
//!
//! Like the middleware of a node it is a process of its own with a limit of memory, since anybody on the network can make RustDDS hang
//! or take gigabytes. It publishes and subscribes nothing of the user's, and is gone from the lists of others when it ends.

use std::collections::BTreeSet;
use std::ffi::OsString;
use std::io::{self, Read as _, Write as _};
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use ros2_client::dds::rustdds::dds::statusevents::{DomainParticipantStatusEvent as Status, StatusEvented as _};
use ros2_client::dds::rustdds::{DomainParticipantBuilder, RTPSEntity as _};
use ros2_client::entities_info::ParticipantEntitiesInfo;
use ros2_client::{Context, MessageTypeName, NodeName, NodeOptions};
use serde::{Deserialize, Serialize};

use crate::loopback;
use crate::qos;
use crate::signals::Signals;

/// First argument of the program when it is to listen and say who is there.
pub(super) const ARGUMENT: &str = "__survey";

/// Name of the node that listens; peers may list it while it does.
const NAME: &str = "needle_twin_survey";
/// Memory that the process may take.
const MEMORY_BYTES: u64 = 512 << 20;
/// Time to join and to leave, beyond the time of listening.
const ASIDE: Duration = Duration::from_secs(8);

/// A topic that somebody publishes or reads, with its type, both as ROS has them.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Heard {
    /// Such as `/measured_js`.
    pub topic: String,
    /// Such as `sensor_msgs/msg/JointState`.
    pub type_name: String,
}

/// What was heard.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Survey {
    /// Why the sockets can't be kept to this machine, and what to do, if they were to be.
    pub open: Option<String>,
    /// Programs on the domain.
    pub participants: usize,
    /// Full names of their nodes.
    pub nodes: BTreeSet<String>,
    /// What they publish.
    pub published: BTreeSet<Heard>,
    /// What they read.
    pub read: BTreeSet<Heard>,
}

/// Listens for so long on a domain, `localhost` for this machine alone, in a process of its own.
///
/// # Errors
/// What went wrong, in one sentence: the process can't be started, did not end, or could not join the domain.
pub fn survey(domain: u16, localhost: bool, time: Duration) -> Result<Survey, String> {
    let program = std::env::current_exe().map_err(|e| format!("the program does not find its own file: {e}"))?;
    let mut child = Command::new(program)
        .args([ARGUMENT, &domain.to_string(), &localhost.to_string(), &time.as_millis().to_string()])
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .map_err(|e| format!("the process that listens can't be started: {e}"))?;
    let mut answer = child.stdout.take();
    // Read beside the waiting: an answer that fills the pipe would keep the process from its end.
    let reader = std::thread::spawn(move || {
        let mut text = String::new();
        answer.as_mut().map_or(Ok(0), |answer| answer.read_to_string(&mut text)).map(|_| text)
    });
    let deadline = Instant::now() + time + ASIDE;
    while child.try_wait().map_err(|e| e.to_string())?.is_none() {
        if Instant::now() > deadline {
            let _ = child.kill(); // it may just have ended
            let _ = child.wait();
            return Err("the process that listens did not come to an end".to_owned());
        }
        sleep(Duration::from_millis(20));
    }
    let text = reader.join().map_err(|_| "the answer was not read".to_owned())?.map_err(|e| e.to_string())?;
    serde_json::from_str::<Result<Survey, String>>(&text)
        .map_err(|_| "the process that listens ended without an answer".to_owned())?
}

/// The process: listens, and says on its standard output what it has heard.
pub(super) fn run(mut arguments: impl Iterator<Item = OsString>) -> Result<(), String> {
    const WRONG: &str = "a domain, whether this machine alone, and a time in ms are needed";
    let mut next = || arguments.next().and_then(|word| word.into_string().ok()).ok_or(WRONG);
    let domain = next()?.parse().map_err(|_| WRONG)?;
    let localhost = next()?.parse().map_err(|_| WRONG)?;
    let time = Duration::from_millis(next()?.parse().map_err(|_| WRONG)?);
    // RustDDS does not survive signals; who started the process ends it where need be
    let _signals = Signals::block().map_err(|e| e.to_string())?;
    limit(MEMORY_BYTES).map_err(|e| e.to_string())?;
    let heard = serde_json::to_vec(&listen(domain, localhost, time)).map_err(|e| e.to_string())?;
    io::stdout().write_all(&heard).map_err(|e| e.to_string())
}

fn listen(domain: u16, localhost: bool, time: Duration) -> Result<Survey, String> {
    let say = |e: &dyn std::fmt::Display| format!("joining domain {domain}: {e}");
    let mut survey = Survey::default();
    let builder = DomainParticipantBuilder::new(domain);
    let participant = if localhost {
        let (participant, unkept) = loopback::build(builder).map_err(|e| say(&e))?;
        survey.open = unkept.map(|reason| reason.to_string());
        participant
    } else {
        builder.build().map_err(|e| say(&e))?
    };
    let own = participant.guid().prefix;
    let listener = participant.status_listener();
    let context = Context::from_domain_participant(participant.clone()).map_err(|e| say(&e))?;
    let name = NodeName::new("/", NAME).map_err(|e| say(&e))?;
    let options = NodeOptions::new().enable_rosout(false).start_parameter_services(false);
    let mut node = context.new_node(name, options).map_err(|e| say(&e))?;
    let type_name = MessageTypeName::new("rmw_dds_common", "ParticipantEntitiesInfo");
    // a message for each participant, and RustDDS counts the queue for all of them together
    let quality = qos::latest(1000);
    let topic = context.create_topic("ros_discovery_info".to_owned(), type_name, &quality).map_err(|e| say(&e))?;
    let names = node.create_subscription::<ParticipantEntitiesInfo>(&topic, None).map_err(|e| say(&e))?;
    let deadline = Instant::now() + time;
    let mut participants = BTreeSet::new();
    while Instant::now() < deadline {
        while let Some(event) = listener.try_recv_status() {
            match event {
                Status::ParticipantDiscovered { dpd } if dpd.guid.prefix != own => {
                    participants.insert(dpd.guid.prefix);
                }
                Status::WriterDetected { writer } if writer.guid.prefix != own => {
                    survey.published.extend(heard(&writer.topic_name, &writer.type_name));
                }
                Status::ReaderDetected { reader } if reader.guid.prefix != own => {
                    survey.read.extend(heard(&reader.topic_name, &reader.type_name));
                }
                _ => {}
            }
        }
        while let Ok(Some((info, _))) = names.take() {
            let others =
                info.nodes().iter().map(|node| format!("{}/{}", node.namespace().trim_end_matches('/'), node.name()));
            survey.nodes.extend(others.filter(|name| name.trim_start_matches('/') != NAME));
        }
        sleep(Duration::from_millis(10));
    }
    survey.participants = participants.len();
    drop((names, node, context, participant));
    Ok(survey)
}

/// A topic of ROS, whose name in DDS begins with `rt/`; none for services and for DDS's own.
fn heard(dds_topic: &str, dds_type: &str) -> Option<Heard> {
    let topic = dds_topic.strip_prefix("rt")?.starts_with('/').then(|| dds_topic[2..].to_owned())?;
    Some(Heard { topic, type_name: crate::graph::ros_type(dds_type) })
}

/// A limit on what the process may take, and no core of its memory on the disk.
#[cfg(target_os = "linux")]
pub(super) fn limit(bytes: u64) -> io::Result<()> {
    use rustix::process::{Resource, Rlimit, setrlimit};
    // What `ps` calls it, else `exe`: it is not worth an error.
    let _ = std::fs::write("/proc/self/comm", "middleware");
    let to = |limit| Rlimit { current: Some(limit), maximum: Some(limit) };
    setrlimit(Resource::Core, to(0))?;
    setrlimit(Resource::Data, to(bytes))?;
    Ok(())
}

#[cfg(not(target_os = "linux"))]
pub(super) fn limit(_bytes: u64) -> io::Result<()> {
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_topic_has_the_names_of_ros() {
        let of = |topic, name| heard(topic, name).map(|h| (h.topic, h.type_name));
        let joint = of("rt/arm/measured_js", "sensor_msgs::msg::dds_::JointState_");
        assert_eq!(joint, Some(("/arm/measured_js".to_owned(), "sensor_msgs/msg/JointState".to_owned())));
        assert_eq!(of("rq/twin/tareRequest", "std_srvs::srv::dds_::Trigger_Request_"), None);
        assert_eq!(of("rtx", "x"), None);
    }
}
