//! The middleware process: makes the endpoints of the plan, carries messages between them and the node, and ends when
//! the node does.

use std::ffi::OsString;
use std::future::Future;
use std::io::{self, Write as _};
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;
use std::pin::Pin;
use std::process::ExitCode;
use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;

use crossbeam_channel::Receiver;
use ros2_client::dds::rustdds::{DomainParticipantBuilder, RTPSEntity as _};
use ros2_client::{
    Client, Context, MessageInfo, MessageTypeName, Name, Node, NodeName, NodeOptions, QosProfile, ServiceMapping,
    ServiceTypeName, Subscription,
};

use super::ARGUMENT;
use super::frames::Frames;
use super::graph::{EndpointRecord, Graph};
use super::loopback::{self, Unkept};
use super::obituary;
use super::outflow::{Writer, publish_all};
use super::prompt::Prompt;
use super::services::{ORDERS, ReplyReaders, Served, be_answered, be_asked, obey};
use super::survey;
use super::uplink::Uplink;
use super::watch::{Finding, Voice, Watch, threads, ticks};
use super::wire::{Endpoint, Guid, Head, Kind, Plan, Role, caller, times, wall_nanos};
use super::zenoh;
use crate::qos::Side;
use crate::raw::RawCdr;
use crate::signals::Signals;
use named_threads::{join, spawn};

/// Makes the process a middleware process if that is what its arguments ask for, and gives its exit code. Every program
/// whose nodes come from this library calls it first of all in `main`: a node starts its own program a second time.
#[must_use]
pub fn serve(arguments: impl IntoIterator<Item = OsString>) -> Option<ExitCode> {
    let mut arguments = arguments.into_iter().skip(1);
    let first = arguments.next()?;
    let done = if first == ARGUMENT {
        run()
    } else if first == survey::ARGUMENT {
        survey::run(arguments)
    } else {
        return None;
    };
    Some(match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(reason) => {
            let _ = writeln!(io::stderr(), "middleware process: {reason}"); // nowhere left to say that it can't be said
            ExitCode::FAILURE
        }
    })
}

fn run() -> Result<(), String> {
    // The node handles the terminal's signals, and RustDDS does not survive them.
    let _signals = Signals::block().map_err(|e| e.to_string())?;
    let socket = io::stdin().as_fd().try_clone_to_owned().map(UnixStream::from).map_err(|e| e.to_string())?;
    let mut frames = Frames::new();
    let plan = loop {
        if let Some((_, plan)) = frames.next().map_err(|e| e.to_string())? {
            break serde_json::from_slice::<Plan>(plan).map_err(|e| e.to_string())?;
        }
        if frames.read(&socket).map_err(|e| e.to_string())? == 0 {
            return Ok(());
        }
    };
    survey::limit(plan.memory_bytes).map_err(|e| e.to_string())?;
    spawn("node's end", outlive_the_node_briefly).map_err(|e| e.to_string())?;
    let (voice, lines) = Voice::listen(plan.verbosity);
    let uplink = Arc::new(Uplink::new(socket.try_clone().map_err(|e| e.to_string())?));
    if let Some(session) = &plan.zenoh {
        return zenoh::run(&plan, session, frames, &socket, &uplink, &lines);
    }
    // Without it peers list the dead one until its lease ends, which is not worth an error.
    let _ = plan.predecessor.map(|prefix| obituary::announce(prefix, plan.domain, plan.localhost));
    match Domain::join(&plan, &uplink) {
        Ok(domain) => domain.serve(frames, socket, &uplink, voice, &lines),
        Err(reason) => {
            uplink.text(Kind::Refused, &reason);
            Ok(())
        }
    }
}

/// Ends the process a second or two after the node, if it does not leave the network by itself when the socket ends: it may be stuck.
/// The kernel could kill it with the node at once (PR_SET_PDEATHSIG), but then peers would list it until its lease of 50 s ends.
fn outlive_the_node_briefly() {
    let node = rustix::process::getppid();
    while rustix::process::getppid() == node {
        std::thread::sleep(Duration::from_secs(1));
    }
    std::thread::sleep(Duration::from_secs(1));
    std::process::exit(1);
}

/// Everything on the network.
struct Domain {
    publishers: Vec<Writer>,
    subscriptions: Vec<(u16, Subscription<RawCdr>)>,
    servers: Vec<Served>,
    clients: Vec<(u16, Client<RawCdr, RawCdr>)>,
    readers: Rc<ReplyReaders>,
    ear: SocketAddr,
    hears: bool,
    graph: Graph,
    node: Node,
    context: Context,
}

impl Domain {
    fn join(plan: &Plan, uplink: &Arc<Uplink>) -> Result<Self, String> {
        let builder = DomainParticipantBuilder::new(plan.domain);
        let what = |e: &dyn std::fmt::Display| format!("joining domain {}: {e}", plan.domain);
        let participant = if plan.localhost {
            let (participant, unkept) = loopback::build(builder).map_err(|e| what(&e))?;
            if let Some(reason) = unkept {
                uplink.log(log::Level::Warn, &told_of(&reason));
            }
            participant
        } else {
            builder.build().map_err(|e| what(&e))?
        };
        let ear = ear(plan.domain, participant.participant_id());
        let context = Context::from_domain_participant(participant).map_err(|e| what(&e))?;
        let full = format!("{}/{}", plan.namespace.trim_end_matches('/'), plan.node);
        let of_node = |e: &dyn std::fmt::Display| format!("{full}: {e}");
        let name = NodeName::new(&plan.namespace, &plan.node).map_err(|e| of_node(&e))?;
        // Parameter services and /rosout are the node's own. The crate's spinner is not used either: it would
        // subscribe /clock under a wrong type, which makes `ros2 topic echo /clock` refuse.
        let options = NodeOptions::new().enable_rosout(false).start_parameter_services(false);
        let node = context.new_node(name, options).map_err(|e| of_node(&e))?;
        let readers = Rc::new(ReplyReaders::default());
        let mut domain = Self {
            publishers: Vec::new(),
            subscriptions: Vec::new(),
            servers: Vec::new(),
            clients: Vec::new(),
            graph: Graph::new(
                &context.domain_participant(),
                Arc::clone(uplink),
                Rc::clone(&readers),
                Prompt::new(ear.port()).ok(),
            ),
            readers,
            ear,
            hears: plan.hears,
            node,
            context,
        };
        // RustDDS has deadlocked when endpoints were made while another thread asked discovery: no thread of ours yet.
        for (number, endpoint) in (0..).zip(&plan.endpoints) {
            domain.make(number, endpoint, plan.localhost).map_err(|reason| format!("{}: {reason}", endpoint.name))?;
        }
        Ok(domain)
    }

    fn make(&mut self, number: u16, endpoint: &Endpoint, localhost: bool) -> Result<(), String> {
        let say = |e: &dyn std::fmt::Display| e.to_string();
        let node = &mut self.node;
        let name = Name::parse(&endpoint.name).map_err(|e| say(&e))?;
        let profile = QosProfile::from(endpoint.quality);
        match endpoint.role {
            Role::Publisher | Role::Subscription => {
                let type_name = MessageTypeName::new(&endpoint.package, &endpoint.type_name);
                let dds_type = type_name.dds_msg_type();
                let topic = node.create_topic(&name, type_name, &profile).map_err(|e| say(&e))?;
                if endpoint.role == Role::Publisher {
                    let publisher = node.create_publisher(&topic, None).map_err(|e| say(&e))?;
                    let (side, guid, name) = (Side::Publisher, publisher.guid(), endpoint.name.clone());
                    let record = EndpointRecord::new(number, side, guid, &name, &dds_type, profile);
                    // To readers on this machine messages go in datagrams of 64 kB, which lose nothing.
                    let fast_dds = if localhost { Arc::default() } else { record.fast_dds() };
                    self.publishers.push(Writer {
                        number,
                        name,
                        publisher,
                        lifespan: endpoint.quality.lifespan(),
                        fast_dds,
                    });
                    self.graph.add(record);
                } else {
                    let subscription = node.create_subscription(&topic, None).map_err(|e| say(&e))?;
                    let guid = subscription.guid();
                    self.subscriptions.push((number, subscription));
                    let side = Side::Subscription;
                    self.graph.add(EndpointRecord::new(number, side, guid, &endpoint.name, &dds_type, profile));
                }
            }
            Role::Server => {
                let names = [&endpoint.name, &endpoint.package, &endpoint.type_name].map(String::as_str);
                let served = Served::new(number, &self.context, node, names, &profile)?;
                self.graph.serve(served.reader());
                self.servers.push(served);
            }
            Role::Client { cyclone } => {
                let type_name = ServiceTypeName::new(&endpoint.package, &endpoint.type_name);
                let mapping = if cyclone { ServiceMapping::Cyclone } else { ServiceMapping::Enhanced };
                let client =
                    node.create_client(mapping, &name, &type_name, profile.clone(), profile).map_err(|e| say(&e))?;
                self.clients.push((number, client));
            }
        }
        Ok(())
    }

    /// Carries messages until the node closes the socket or the watch gives up.
    fn serve(
        self,
        frames: Frames,
        socket: UnixStream,
        uplink: &Arc<Uplink>,
        voice: &'static Voice,
        lines: &Receiver<(u8, String)>,
    ) -> Result<(), String> {
        let Self { publishers, subscriptions, servers, clients, readers, graph, ear, hears, node, context } = self;
        let (sender, orders) = smol::channel::bounded(ORDERS);
        let (stop, stopped) = smol::channel::bounded::<()>(1);
        // No thread of ours yet: those that are here are the DDS's, and they are for ever.
        let watch = Watch::new(hears, threads());
        let own = caller(context.domain_participant().guid().to_bytes(), 0);
        uplink.send(Head::of(Kind::Ready, 0, own), &[]);
        let ticks = ticks().map_err(|e| e.to_string())?;
        let publishing = {
            let uplink = Arc::clone(uplink);
            spawn("to network", move || {
                publish_all(&publishers, frames, &socket, &uplink, &sender);
                drop(stop);
            })
            .map_err(|e| e.to_string())?
        };
        let knocker = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).map_err(|e| format!("a socket for itself: {e}"))?;
        let mut tasks: Vec<Pin<Box<dyn Future<Output = ()> + '_>>> = Vec::new();
        for (number, subscription) in &subscriptions {
            tasks.push(Box::pin(hear(*number, subscription, uplink)));
        }
        for served in &servers {
            tasks.push(Box::pin(be_asked(served, uplink)));
        }
        tasks.push(Box::pin(obey(&orders, &servers, &clients, &readers, uplink)));
        if !clients.is_empty() {
            tasks.push(Box::pin(be_answered(&clients, uplink)));
        }
        tasks.push(Box::pin(graph.watch()));
        let executor = smol::LocalExecutor::new();
        let tasks: Vec<_> = tasks.into_iter().map(|task| executor.spawn(task)).collect();
        let node_gone = async {
            // The channel is closed, never written to.
            let _ = stopped.recv().await;
        };
        // fails only where sockets do, which the watch detects as not receiving
        let knock = || drop(knocker.send_to(&voice.knock(), ear));
        let ebbed = look_after(watch, &ticks, knock, uplink, voice, lines);
        // Not smol's own, which looks after sockets and timers too, and wakes a hundred times a second for it.
        smol::future::block_on(executor.run(smol::future::or(node_gone, ebbed)));
        drop((tasks, ticks));
        drop(executor);
        uplink.deafen();
        join(publishing);
        // Endpoints before the node, the node before the participant: peers see the node leave at once.
        drop((subscriptions, servers, clients));
        drop((node, context));
        Ok(())
    }
}

/// Says that sockets can't be kept to this machine.
fn told_of(reason: &Unkept) -> String {
    let unseen = format!(
        "sockets can't be kept to this machine ({reason}): programs that use a network card do not find this node"
    );
    match reason {
        Unkept::Refused(_) => format!(
            "{unseen}, and packets that other machines send to this machine's RTPS ports are read; keep them out with a firewall"
        ),
        Unkept::Unpatched => unseen,
    }
}

/// Where RustDDS listens for the participant's messages (RTPS: 7400 + 250 domain + 11 + 2 participant).
fn ear(domain: u16, participant: u16) -> SocketAddr {
    SocketAddr::from((Ipv4Addr::LOCALHOST, 7411_u16.wrapping_add(250 * domain).wrapping_add(2 * participant)))
}

fn stamps(info: &MessageInfo) -> [i64; 2] {
    let received = info.received_timestamp().map_or_else(wall_nanos, |t| t.to_nanos());
    [received, info.source_timestamp().map_or(received, |t| t.to_nanos())]
}

async fn hear(number: u16, subscription: &Subscription<RawCdr>, uplink: &Uplink) {
    loop {
        match subscription.async_take().await {
            Ok((raw, info)) => {
                let head =
                    Head::of(Kind::Message, number, times(stamps(&info), Guid(info.publisher_gid().to_bytes16())));
                uplink.send(Head { flag: u8::from(raw.is_big_endian()), ..head }, raw.as_slice());
            }
            // a representation that is not plain CDR
            Err(_) => drop(smol::Timer::after(Duration::from_millis(1)).await),
        }
    }
}

/// Tells the node that the process lives; ends the process when the DDS does not, and returns when a flood is over.
async fn look_after(
    mut watch: Watch,
    ticks: &smol::channel::Receiver<()>,
    knock: impl Fn(),
    uplink: &Uplink,
    voice: &Voice,
    lines: &Receiver<(u8, String)>,
) {
    while ticks.recv().await.is_ok() {
        uplink.send(Head { flag: u8::from(voice.heard() > 0), ..Head::new(Kind::Pulse) }, &[]);
        lines.try_iter().for_each(|line| uplink.relay(line));
        if voice.misled() {
            let reason = "was told of messages that no publisher has sent, and may be deaf for true ones";
            return uplink.text(Kind::Farewell, reason);
        }
        match watch.look(voice.complaints(), voice.heard(), &knock) {
            Finding::Well => {}
            Finding::Flooded(count) => uplink.log(
                log::Level::Warn,
                &format!("malformed packets, {count} within a second: somebody on the network floods this node"),
            ),
            Finding::Untold => uplink.log(
                log::Level::Warn,
                "the middleware does not say what it hears: if it goes deaf, that will not be noticed",
            ),
            Finding::Ebbed => {
                return uplink
                    .text(Kind::Farewell, "has been flooded with malformed packets, and may be deaf for true ones");
            }
            Finding::Deaf(why) => {
                uplink.text(Kind::Farewell, &format!("is deaf: {why}"));
                // Its DDS would not even leave.
                std::process::exit(1);
            }
        }
    }
}
