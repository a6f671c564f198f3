//! The cable between driver, load cell, twin and guard: carries every message, spoils what it is told to, and notes who said what when.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use named_threads::{join, spawn};

use ros2_client::parameters::{ParameterValue, raw};
use ros2_client::rcl_interfaces::{SetParametersRequest, SetParametersResponse};

use super::fault::{Fault, Spoilt};
use ros2_messages::RosMessage;
use ros2_messages::builtin_interfaces::Time;
use ros2_messages::geometry_msgs::WrenchStamped;
use ros2_messages::needle_twin::Safety;
use ros2_messages::rosgraph_msgs::Clock;
use ros2_messages::sensor_msgs::JointState;
use ros2_messages::std_srvs::{TriggerRequest, TriggerResponse};
use ros2_node::arguments::RosArguments;
use ros2_node::clock::wall_nanos;
use ros2_node::environment::Environment;
use ros2_node::names::Names;
use ros2_node::participant::{Input, Output, Participant};
use ros2_node::qos;
use ros2_node::service::{Client, Mapping};
use ros2_node::start::NodeError;

/// Time between two looks.
const LOOK: Duration = Duration::from_micros(300);

/// A stream between two nodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stream {
    /// `measured_js` to twin and guard.
    Pose,
    /// `measured_js` to the twin alone.
    PoseOfTwin,
    /// `measured_cf` to the twin.
    Force,
    /// `predicted_cf` to the guard.
    Prediction,
    /// `safety` to the guard.
    Safety,
    /// `servo_jp` to the driver.
    Command,
    /// `/clock` to the twin.
    Clock,
}

/// A parameter of a node, and what somebody sets it to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Setting {
    pub of_guard: bool,
    pub name: &'static str,
    pub value: f64,
    pub fault: &'static str,
}

/// What has been heard, wall times in ns.
#[derive(Debug, Default)]
pub(super) struct Heard {
    /// Stamp, position and true velocity of the driver's own `measured_js`.
    pub motion: Vec<(i64, f64, f64)>,
    /// Of each `safety` its stamp and when it came, what it says, and its first reason.
    pub safety: Vec<([i64; 2], bool, String)>,
    /// When the fault came first.
    pub begun: Option<i64>,
    /// Whether the service that was asked did as it was asked.
    pub taken: Option<bool>,
}

#[derive(Debug, Default)]
struct Shared {
    heard: Mutex<Heard>,
    fault: Mutex<Option<(Stream, Fault)>>,
    tare: AtomicBool,
    resume: AtomicBool,
    set: Mutex<Option<Setting>>,
    stop: AtomicBool,
}

/// See the module.
pub(super) struct Cable {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Cable {
    /// Joins the domain. `simulated`: makes the time as well.
    pub(crate) fn start(domain: u16, simulated: bool) -> Result<Self, NodeError> {
        let of_loopback = |name: &str| match name {
            "ROS_DOMAIN_ID" => Some(domain.to_string()),
            "ROS_LOCALHOST_ONLY" => Some("1".to_owned()),
            _ => None,
        };
        let environment = Environment::from_lookup(of_loopback)?;
        let names = Names::new("cable", &[])?;
        let mut node = Participant::new(names, &environment, &RosArguments::default())?;
        node.set_mapping(Mapping::of_environment(&environment));
        let mut lines = Lines::new(&mut node, simulated)?;
        node.start(None)?;
        let shared = Arc::new(Shared::default());
        let thread = {
            let shared = Arc::clone(&shared);
            spawn("cable", move || {
                while !shared.stop.load(Ordering::Relaxed) {
                    lines.carry(&shared);
                    std::thread::sleep(LOOK);
                }
                drop(node);
            })?
        };
        Ok(Self { shared, thread: Some(thread) })
    }

    pub(crate) fn heard(&self) -> MutexGuard<'_, Heard> {
        locked(&self.shared.heard)
    }

    /// Spoils a stream from now on; `None`: all is well again.
    pub(crate) fn spoil(&self, fault: Option<(Stream, Fault)>) {
        *locked(&self.shared.fault) = fault;
    }

    /// Calls `/twin/tare`.
    pub(crate) fn tare(&self) {
        self.shared.tare.store(true, Ordering::Relaxed);
    }

    /// Calls `set_parameters` of a node.
    pub(crate) fn set(&self, setting: Setting) {
        *locked(&self.shared.set) = Some(setting);
    }

    /// Calls `/guard/resume`.
    pub(crate) fn resume(&self) {
        self.shared.resume.store(true, Ordering::Relaxed);
    }

    /// Depth and velocity of the needle, m and m/s.
    pub(crate) fn needle(&self) -> (f64, f64) {
        self.heard().motion.last().map_or((0.0, 0.0), |m| (m.1, m.2))
    }
}

impl Drop for Cable {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            join(thread);
        }
    }
}

/// One stream: what comes, what goes, and who else speaks where it goes.
struct Line<M: serde::Serialize> {
    output: Output<M>,
    second: Output<M>,
    good: Option<M>,
    held: VecDeque<(i64, M)>,
}

impl<M: RosMessage + serde::Serialize + Spoilt + 'static> Line<M> {
    fn new(node: &mut Participant, name: &str) -> Result<Self, NodeError> {
        Ok(Self {
            output: node.publisher(name, qos::reliable(10))?,
            second: node.publisher(name, qos::reliable(10))?,
            good: None,
            held: VecDeque::new(),
        })
    }

    /// Passes a message on; true if it was spoilt.
    fn pass(&mut self, message: M, fault: Option<Fault>) -> bool {
        let Some(fault) = fault else {
            self.good = Some(message.clone());
            self.held.clear();
            self.output.send(message);
            return false;
        };
        if fault == Fault::TwoSources {
            self.second.send(message.zero());
        }
        let good = self.good.get_or_insert_with(|| message.clone());
        if let Some(spoilt) = message.spoilt(fault, good) {
            self.held.push_back((wall_nanos() + fault.delay_nanos(), spoilt));
        }
        self.release();
        true
    }

    fn release(&mut self) {
        while self.held.front().is_some_and(|(due, _)| *due <= wall_nanos()) {
            if let Some((_, message)) = self.held.pop_front() {
                self.output.send(message);
            }
        }
    }
}

impl Spoilt for Safety {
    fn spoilt(mut self, fault: Fault, first: &Self) -> Option<Self> {
        match fault {
            Fault::Silent => return None,
            Fault::Repeated => return Some(first.clone()),
            Fault::Behind => self.header.stamp = Time::from_nanos(self.header.stamp.nanos() - 500_000_000),
            Fault::Ahead => self.header.stamp = Time::from_nanos(self.header.stamp.nanos() + 500_000_000),
            _ => {}
        }
        Some(self)
    }

    fn zero(&self) -> Self {
        self.clone()
    }
}

/// All of them.
struct Lines {
    measured: Input<JointState>,
    force: Input<WrenchStamped>,
    predicted: Input<WrenchStamped>,
    safety: Input<Safety>,
    servo: Input<JointState>,
    to_twin: Line<JointState>,
    to_guard: Line<JointState>,
    cell: Line<WrenchStamped>,
    prediction: Line<WrenchStamped>,
    word: Line<Safety>,
    command: Line<JointState>,
    clock: Option<[Output<Clock>; 2]>,
    clock_stood: Option<i64>,
    tare: Client<TriggerRequest, TriggerResponse>,
    resume: Client<TriggerRequest, TriggerResponse>,
    /// Of twin and guard.
    set: [Client<SetParametersRequest, SetParametersResponse>; 2],
}

impl Lines {
    fn new(node: &mut Participant, simulated: bool) -> Result<Self, NodeError> {
        let clocks = |node: &mut Participant| -> Result<_, NodeError> {
            Ok([node.publisher("/clock", qos::sensor(1))?, node.publisher("/clock", qos::sensor(1))?])
        };
        Ok(Self {
            measured: node.subscription("measured_js", qos::sensor(1000))?,
            force: node.subscription("measured_cf", qos::sensor(1000))?,
            predicted: node.subscription("predicted_cf", qos::sensor(1000))?,
            safety: node.subscription("safety", qos::sensor(100))?,
            servo: node.subscription("servo_jp", qos::sensor(100))?,
            to_twin: Line::new(node, "twin_js")?,
            to_guard: Line::new(node, "guard_js")?,
            cell: Line::new(node, "twin_cf")?,
            prediction: Line::new(node, "guard_cf")?,
            word: Line::new(node, "guard_safety")?,
            command: Line::new(node, "rig_jp")?,
            clock: if simulated { Some(clocks(node)?) } else { None },
            clock_stood: None,
            tare: node.client("/twin/tare", "std_srvs", "Trigger")?,
            resume: node.client("/guard/resume", "std_srvs", "Trigger")?,
            set: [
                node.client("/twin/set_parameters", "rcl_interfaces", "SetParameters")?,
                node.client("/guard/set_parameters", "rcl_interfaces", "SetParameters")?,
            ],
        })
    }

    fn carry(&mut self, shared: &Shared) {
        let now = *locked(&shared.fault);
        let on = |stream: Stream| now.filter(|(spoilt, _)| *spoilt == stream).map(|(_, fault)| fault);
        let mut spoilt = false;
        if let Some(clock) = &self.clock {
            let fault = on(Stream::Clock);
            spoilt |= make_time(clock, &mut self.clock_stood, fault);
        }
        while let Some(message) = self.measured.take() {
            let [place, speed] = [&message.position, &message.velocity].map(|v| v.first().copied().unwrap_or_default());
            locked(&shared.heard).motion.push((message.header.stamp.nanos(), place, speed));
            let both = on(Stream::Pose);
            spoilt |= self.to_guard.pass(message.clone(), both);
            spoilt |= self.to_twin.pass(message, both.or(on(Stream::PoseOfTwin)));
        }
        while let Some(message) = self.force.take() {
            spoilt |= self.cell.pass(message, on(Stream::Force));
        }
        while let Some(message) = self.predicted.take() {
            spoilt |= self.prediction.pass(message, on(Stream::Prediction));
        }
        while let Some(message) = self.safety.take() {
            let reason = message.reasons.first().cloned().unwrap_or_default();
            locked(&shared.heard).safety.push(([message.header.stamp.nanos(), wall_nanos()], message.safe, reason));
            spoilt |= self.word.pass(message, on(Stream::Safety));
        }
        while let Some(message) = self.servo.take() {
            spoilt |= self.command.pass(message, on(Stream::Command));
        }
        if spoilt {
            locked(&shared.heard).begun.get_or_insert_with(wall_nanos);
        }
        for (asked, client) in [(&shared.tare, &self.tare), (&shared.resume, &self.resume)] {
            if asked.swap(false, Ordering::Relaxed) {
                client.ask(&TriggerRequest::default());
            }
        }
        if let Some(setting) = locked(&shared.set).take() {
            let value = ParameterValue::Double(setting.value).into();
            let parameter = vec![raw::Parameter { name: setting.name.to_owned(), value }];
            self.set[usize::from(setting.of_guard)].ask(&SetParametersRequest { parameter });
            locked(&shared.heard).begun.get_or_insert_with(wall_nanos);
        }
        let set = self.set.iter().find_map(Client::answer).map(|a| a.results.iter().all(|result| result.successful));
        if let Some(taken) = self.tare.answer().map(|answer| answer.success).or(set) {
            locked(&shared.heard).taken = Some(taken);
        }
    }
}

/// Says the time, which is the wall clock's while all is well.
fn make_time([first, second]: &[Output<Clock>; 2], stood: &mut Option<i64>, fault: Option<Fault>) -> bool {
    let now = wall_nanos();
    let said = match fault {
        None => {
            *stood = None;
            now
        }
        Some(Fault::Silent) => return true,
        Some(Fault::Frozen) => *stood.get_or_insert(now),
        Some(Fault::Ahead) => now + 10_000_000_000,
        Some(Fault::Behind) => now - 10_000_000_000,
        Some(_) => {
            second.send(Clock { clock: Time::from_nanos(now - 10_000_000_000) });
            now
        }
    };
    first.send(Clock { clock: Time::from_nanos(said) });
    fault.is_some()
}
