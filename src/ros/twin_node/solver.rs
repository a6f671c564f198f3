//! The solver thread: it owns the twin, answers poses, and uses no socket.

use needle_core::scene::Word as _;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{SyncSender, TrySendError};
use std::time::Instant;

use crossbeam_channel::Sender;

use super::answer::{Answer, Model, Progress, Sighting, Snapshot};
use super::comparison::Reading;
use super::inbox::{Departure, Double, Inbox, PoseInput, Where, Work};
use super::page;
use super::tracked::Seen;
use super::under_way::{Goal, UnderWay};
use needle_core::scene::Scene;
use needle_core::twin::{Halt, Part, Prediction, StampedPose, Twin};
use ros2_messages::builtin_interfaces::Time;

/// Messages to the force thread, from the solver and from the input thread.
#[expect(clippy::large_enum_variant, reason = "most events are answers, and a box would allocate for each pose")]
pub(super) enum Event {
    /// A pose was answered.
    Answer(Answer),
    /// An event in the tissue at the pose that was answered.
    Happened(Sighting),
    /// The instrument is far from its position in the twin. The twin moves there in parts, and nothing is answered
    /// until it arrives. `None`: the motion was abandoned.
    UnderWay(Option<Progress>),
    /// A pose was refused by the twin.
    Refused { depth_m: f64, reason: String },
    /// The solution diverged. It stays so until the twin recovers or is reset.
    Halted(String),
    /// The twin has recovered: the next answered pose is in its reach.
    Recovered,
    /// The twin was reset to the undeformed state.
    Reset(&'static str),
    /// A reading of the load cell.
    Measured(Reading),
    /// Tracked points.
    Tracked(Seen),
    /// Take the present reading as zero; `forced`: despite any objections. The reply is the zero, or the reason of a
    /// rejection.
    Tare { forced: bool, reply: Sender<Result<[f64; 3], String>> },
    /// No further messages.
    Stop,
}

/// Number of answers that the force thread could not take because it was thousands behind.
pub(super) static LOST_ANSWERS: AtomicU64 = AtomicU64::new(0);

/// The model is ready, or can't be built.
pub(super) type Built = Result<Box<Model>, String>;

/// Recipients of the thread's results.
pub(super) struct Outlets {
    pub built: Sender<Built>,
    pub events: SyncSender<Event>,
    pub snapshots: Sender<Box<Snapshot>>,
    pub departures: Sender<Departure>,
}

/// Builds the twin on request, with a scratch copy if `look_ahead`, and answers until it is stopped.
pub(super) fn run(scene: &Scene, look_ahead: bool, inbox: &Inbox, outlets: &Outlets) {
    let Outlets { built, events, snapshots, departures } = outlets;
    let mut solver: Option<Solver> = None;
    let mut generation = 0;
    loop {
        let room = solver.as_ref().map_or(1, Solver::room);
        let under_way = solver.as_mut().filter(|solver| solver.under_way.is_some());
        let work = match under_way.map(|solver| (inbox.meanwhile(room), solver)) {
            Some((Some(work), _)) => work,
            Some((None, solver)) => {
                solver.go_on(events);
                continue;
            }
            None => inbox.next(room),
        };
        match (work, &mut solver) {
            (Work::Build, _) => {
                generation += 1;
                let outcome = Solver::build(scene, look_ahead.then_some(generation)).map(|(ready, model)| {
                    solver = Some(ready);
                    Box::new(model)
                });
                if built.send(outcome).is_err() {
                    return;
                }
            }
            (Work::Discard, _) => solver = None,
            (Work::Stop, _) => {
                send(events, Event::Stop);
                return;
            }
            // The scratch copy of a discarded model is discarded too.
            (Work::Back(double), Some(solver)) if double.generation == generation => solver.double = Some(double),
            (Work::Back(double), _) => drop(double),
            (Work::LookAhead, Some(solver)) => {
                // Fails only if the look-ahead thread has ended.
                let _ = departures.send(solver.depart());
            }
            (Work::LookAhead, None) => {
                let _ = departures.send(Err("there is no model yet: wait until the node is active"));
            }
            (work, Some(solver)) => solver.take(work, events, snapshots),
            // Without a twin nobody requests snapshots, and poses are rejected.
            (Work::Snapshot(snapshot), None) => drop(snapshots.send(snapshot)),
            (_, None) => {}
        }
    }
}

struct Solver {
    twin: Twin,
    /// Stamp of the first pose since the last reset: time 0 of the twin.
    origin_nanos: Option<i64>,
    stamp: Time,
    depth_m: f64,
    halted: bool,
    /// Recent wall time of one explicit step, s.
    step_s: f64,
    /// Recent wall time of one answer, s.
    answer_s: f64,
    /// Recent wall time of one stride of a long motion, s.
    stride_s: f64,
    /// The last pose that was answered.
    pose: Option<StampedPose>,
    /// The motion to a distant pose.
    under_way: Option<UnderWay>,
    /// The scratch copy, unless the look-ahead thread uses it.
    double: Option<Box<Double>>,
}

/// Wall time limit of one pose, s: a driver can't use an older answer. A twin that can't keep up takes fewer steps
/// and skips to the newest pose.
const ANSWER_BUDGET_S: f64 = 0.010;
/// Initial estimate of the wall time of one explicit step per integration point, s: twice that of a slow machine. A
/// first pose deep inside is reached in dozens of strides, which must not take longer than a node may be silent.
const POINT_S: f64 = 2e-7;
/// Wall time limit for the answers to a burst of poses, s: two poses at a kilohertz.
const BURST_S: f64 = 0.002;
/// Largest number of poses in a burst.
const BURST: f64 = 32.0;

impl Solver {
    #[allow(clippy::cast_precision_loss)] // a number of points
    fn build(scene: &Scene, double: Option<u64>) -> Result<(Self, Model), String> {
        let begun = Instant::now();
        let mut twin = Twin::new(scene).map_err(|error| error.to_string())?;
        let step_s = POINT_S * twin.integration_points() as f64;
        twin.limit_steps(affordable(step_s));
        twin.warnings().iter().for_each(|warning| tracing::warn!("{warning}"));
        tracing::info!("the model is {}: {}", twin.dimension().as_str(), twin.dimension_because());
        let model = Model::of(&twin, begun.elapsed(), page::instrument(scene, twin.reference_points()));
        let stamp = Time::default();
        let double = double.map(|generation| {
            Box::new(Double { twin: twin.double(), from: None, stamp, depth_m: 0.0, step_s: 0.0, generation })
        });
        let solver = Self {
            twin,
            origin_nanos: None,
            stamp,
            depth_m: 0.0,
            halted: false,
            step_s,
            answer_s: BURST_S,
            stride_s: 0.5 * ANSWER_BUDGET_S,
            pose: None,
            under_way: None,
            double,
        };
        Ok((solver, model))
    }

    fn take(&mut self, work: Work, events: &SyncSender<Event>, snapshots: &Sender<Box<Snapshot>>) {
        match work {
            Work::Pose(pose) if self.under_way.is_some() => {
                self.head_for(&pose, events);
                self.go_on(events);
            }
            Work::Pose(pose) => self.take_pose(&pose, events),
            Work::Snapshot(mut snapshot) => {
                snapshot.take(&self.twin, self.stamp, self.depth_m);
                snapshot.under_way = self.under_way.is_some();
                let pose = self.pose.map_or_else(|| self.twin.pose_at_depth(0.0), |stamped| stamped.pose);
                let pose = self.twin.bent_tip().unwrap_or(pose);
                (snapshot.tip, snapshot.axis) = (pose.tip, pose.axis);
                // Fails only if the tissue thread has ended.
                let _ = snapshots.send(snapshot);
            }
            Work::Reset(reason) => {
                self.twin.reset();
                self.origin_nanos = None;
                self.halted = false;
                self.depth_m = 0.0;
                self.pose = None;
                self.under_way = None;
                send(events, Event::Reset(reason));
            }
            // Handled by the thread, not by the twin.
            Work::Build | Work::Discard | Work::Stop | Work::LookAhead | Work::Back(_) => {}
        }
    }

    fn take_pose(&mut self, input: &PoseInput, events: &SyncSender<Event>) {
        let stamped = self.stamped(input);
        match UnderWay::to(&self.twin, Goal { input: *input, stamped }, self.depth_m, self.stride_s) {
            Some(mut under_way) => {
                send(events, Event::UnderWay(Some(under_way.progress(&self.twin))));
                self.under_way = Some(under_way);
                self.go_on(events);
            }
            None => {
                let (begun, steps) = (Instant::now(), self.twin.steps());
                let outcome = self.twin.follow(stamped);
                self.answer_s += 0.2 * (begun.elapsed().as_secs_f64() - self.answer_s);
                self.learn_step(begun, steps);
                self.answer(&Goal { input: *input, stamped }, begun, outcome, events);
            }
        }
    }

    /// Makes one part of the motion.
    fn go_on(&mut self, events: &SyncSender<Event>) {
        let Some(mut under_way) = self.under_way.take() else { return };
        let goal = under_way.goal();
        let (begun, steps) = (Instant::now(), self.twin.steps());
        let outcome = under_way.go_on(&mut self.twin);
        self.stride_s = under_way.stride_s();
        self.learn_step(begun, steps);
        match outcome {
            Ok(Part::Left(_)) => {
                send(events, Event::UnderWay(Some(under_way.progress(&self.twin))));
                self.under_way = Some(under_way);
                self.say_what_happened(&goal, events);
            }
            // the instrument has come back from there meanwhile
            Ok(Part::There(there)) if under_way.newest().stamped != goal.stamped => {
                self.depth_m = there.depth_m;
                self.say_what_happened(&goal, events);
                send(events, Event::UnderWay(Some(under_way.progress(&self.twin))));
                self.take_pose(&under_way.newest().input, events);
            }
            Ok(Part::There(prediction)) => self.answer(&goal, begun, Ok(prediction), events),
            Err(halt) => {
                self.answer(&goal, begun, Err(halt), events);
                send(events, Event::UnderWay(None));
            }
        }
    }

    /// Takes a pose that came during a motion in parts.
    fn head_for(&mut self, input: &PoseInput, events: &SyncSender<Event>) {
        let stamped = self.stamped(input);
        let Some(under_way) = &mut self.under_way else { return };
        if let Err(reason) = under_way.head_for(&self.twin, Goal { input: *input, stamped }) {
            send(events, Event::Refused { depth_m: self.depth(input), reason });
        }
    }

    /// Sends the result of a pose.
    fn answer(&mut self, goal: &Goal, begun: Instant, outcome: Result<Prediction, Halt>, events: &SyncSender<Event>) {
        let event = self.event(goal, begun, outcome);
        if self.halted && matches!(event, Event::Answer(_)) {
            self.halted = false;
            send(events, Event::Recovered);
        }
        let answered = matches!(event, Event::Answer(_));
        send(events, event);
        if answered {
            self.say_what_happened(goal, events);
            self.pose = Some(goal.stamped);
        }
    }

    /// Events are rare, and must not be lost: the solver waits for the force thread if necessary.
    fn say_what_happened(&self, goal: &Goal, events: &SyncSender<Event>) {
        let interval_s = self.pose.map_or(0.0, |before| goal.stamped.time_s - before.time_s);
        for happening in self.twin.happened() {
            let axis = goal.stamped.pose.axis;
            let sighting = Sighting { stamp: goal.input.stamp, interval_s, axis, happening: *happening };
            send(events, Event::Happened(sighting));
        }
    }

    /// Sends the scratch copy out with the present state. It copies without allocation.
    fn depart(&mut self) -> Departure {
        if self.halted {
            return Err("the solution is lost: retract the instrument and call ~/reset");
        }
        if self.under_way.is_some() {
            return Err(
                "the twin is being taken to the instrument: ask again when it is there (`status` says how long that takes)",
            );
        }
        let Some(mut double) = self.double.take() else {
            return Err("looking ahead is off: start the node with -p look_ahead:=true");
        };
        double.twin.take_over(&self.twin);
        (double.from, double.stamp, double.depth_m) = (self.pose, self.stamp, self.depth_m);
        double.step_s = self.step_s;
        Ok(double)
    }

    /// Number of poses that can be answered within [`BURST_S`].
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // a small count
    fn room(&self) -> usize {
        (BURST_S / self.answer_s).clamp(1.0, BURST) as usize
    }

    fn depth(&self, input: &PoseInput) -> f64 {
        match input.place {
            Where::Depth(depth) => depth,
            Where::Pose(pose) => self.twin.depth_of(&pose),
        }
    }

    #[allow(clippy::cast_precision_loss)] // seconds of one run
    fn stamped(&mut self, input: &PoseInput) -> StampedPose {
        let nanos = input.stamp.nanos();
        let origin = *self.origin_nanos.get_or_insert(nanos);
        let pose = match input.place {
            Where::Depth(depth) => self.twin.pose_at_depth(depth),
            Where::Pose(pose) => pose,
        };
        StampedPose { time_s: (nanos - origin) as f64 * 1e-9, pose }
    }

    /// Updates the cost of an explicit step, from the steps since `steps`.
    #[allow(clippy::cast_precision_loss)] // a count of steps
    fn learn_step(&mut self, begun: Instant, steps: u64) {
        let taken = self.twin.steps().saturating_sub(steps);
        if taken > 0 {
            let step_s = begun.elapsed().as_secs_f64() / taken as f64;
            self.step_s += 0.2 * (step_s - self.step_s);
            self.twin.limit_steps(affordable(self.step_s));
        }
    }

    fn event(&mut self, goal: &Goal, begun: Instant, outcome: Result<Prediction, Halt>) -> Event {
        let (input, stamped, done) = (&goal.input, goal.stamped, Instant::now());
        match outcome {
            Ok(prediction) => {
                self.stamp = input.stamp;
                self.depth_m = prediction.depth_m;
                Event::Answer(Answer {
                    stamp: input.stamp,
                    received: input.received,
                    begun,
                    done,
                    pose: stamped,
                    prediction,
                    work: self.twin.work(),
                    boundaries_m: self.twin.boundaries_m(),
                    bent_tip: self.twin.bent_tip(),
                })
            }
            Err(Halt::Pose { reason }) => Event::Refused { depth_m: self.depth(input), reason },
            // The force thread counts it as refused; the status already gives the reason.
            Err(_) if self.halted => Event::Refused { depth_m: self.depth(input), reason: String::new() },
            Err(halt) => {
                self.halted = true;
                Event::Halted(halt.to_string())
            }
        }
    }
}

/// Number of steps that one pose may take.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // saturates
fn affordable(step_s: f64) -> u32 {
    (ANSWER_BUDGET_S / step_s) as u32
}

/// An answer never waits for the force thread; answers that it can't take are counted. The rare other events must not
/// be lost.
fn send(events: &SyncSender<Event>, event: Event) {
    if matches!(event, Event::Answer(_) | Event::Refused { .. }) {
        if let Err(TrySendError::Full(_)) = events.try_send(event) {
            LOST_ANSWERS.fetch_add(1, Ordering::Relaxed);
        }
    } else {
        // Fails only if the force thread has ended.
        let _ = events.send(event);
    }
}
