//! The members' thread: every member answers the newest answered pose. It publishes the band of the force, the spread
//! of the targets and the look-ahead.
//!
//! ```text
//! force thread ──newest answered pose, comparisons──► this thread: each member steps, learns from the load cell, and looks ahead
//!                                                      ──► prediction_band, targets_with_covariance, outlook
//! ```
//! Poses that come while the members compute are skipped. So the band may be late but never falls behind, and its
//! stamp states which pose it answers. Members step even without subscribers, since each has to follow the instrument
//! to have a state. A reading of the load cell is used if the members have answered the pose with which it was
//! compared. Tracked points lie between two poses ([`super::tracked`]).

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::answer::Answer;
use super::shared::{Banded, Shared};
use super::tracked::{Seen, Tracks};
use named_threads::lower_priority;
use needle_core::twin::{Motion, StampedPose};
use needle_estimate::compare::ensemble::{Ahead, Assimilation, Band, Live, Member, Spread, Told};
use ros2_messages::builtin_interfaces::Time;
use ros2_messages::geometry_msgs::{Pose, PoseWithCovariance, PoseWithCovarianceStamped, Quaternion};
use ros2_messages::needle_twin::{ForceBand, ForceComparison, Outlook};
use ros2_messages::std_msgs::Header;
use ros2_node::logging::Throttle;
use ros2_node::participant::{Output, Participant, ParticipantError};
use ros2_node::qos;

/// Queue length for messages of targets: one for each target at one time.
const TARGETS: usize = 100;
/// Number of queued comparisons, and of stored answers for comparisons to come: seconds at any sensible rate.
const KEPT: usize = 1024;
/// Speed of a look-ahead, m/s. It matters only for a material that relaxes.
const SPEED_M_PER_S: f64 = 1e-3;

/// The publishers.
pub(super) struct MemberOutputs {
    band: Output<ForceBand>,
    targets: Output<PoseWithCovarianceStamped>,
    outlook: Output<Outlook>,
}

impl MemberOutputs {
    pub(crate) fn new(participant: &mut Participant) -> Result<Self, ParticipantError> {
        Ok(Self {
            band: participant.publisher("prediction_band", qos::reliable(10))?,
            targets: participant.publisher("targets_with_covariance", qos::reliable(TARGETS))?,
            outlook: participant.publisher("outlook", qos::reliable(1))?,
        })
    }
}

/// A pose that the twin has answered.
#[derive(Clone, Copy, Debug)]
pub(super) struct Answered {
    pub stamp: Time,
    pub pose: StampedPose,
    pub depth_m: f64,
}

impl Answered {
    pub(crate) const fn of(answer: &Answer) -> Self {
        Self { stamp: answer.stamp, pose: answer.pose, depth_m: answer.prediction.depth_m }
    }
}

/// The load cell's reading at the stamp of a pose.
#[derive(Clone, Copy, Debug)]
pub(super) struct Measured {
    pub stamp_nanos: i64,
    pub depth_m: f64,
    pub measured_n: f64,
}

impl Measured {
    pub(crate) fn of(message: &ForceComparison) -> Self {
        let ForceComparison { depth_m, measured_n, .. } = *message;
        Self { stamp_nanos: message.header.stamp.nanos(), depth_m, measured_n }
    }
}

#[derive(Debug, Default)]
struct State {
    pose: Option<Answered>,
    measured: VecDeque<Measured>,
    tracked: VecDeque<Seen>,
    reset: bool,
    stop: bool,
}

/// The newest pose that the members have not answered.
#[derive(Debug, Default)]
pub(super) struct Newest {
    state: Mutex<State>,
    wake: Condvar,
}

/// The members' next work.
enum Task {
    Step(Answered, VecDeque<Measured>, VecDeque<Seen>),
    Reset,
    Stop,
}

impl Newest {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn put(&self, pose: Answered) {
        self.lock().pose = Some(pose);
        self.wake.notify_one();
    }

    /// Takes a reading; it is used with the next pose.
    pub(crate) fn measured(&self, reading: Measured) {
        let mut state = self.lock();
        if state.measured.len() == KEPT {
            state.measured.pop_front();
        }
        state.measured.push_back(reading);
    }

    /// Takes tracked points; they are used with the next pose.
    pub(crate) fn tracked(&self, seen: Seen) {
        let mut state = self.lock();
        if state.tracked.len() == KEPT {
            state.tracked.pop_front();
        }
        state.tracked.push_back(seen);
    }

    /// Resets the members with the twin, before any later pose.
    pub(crate) fn reset(&self) {
        let mut state = self.lock();
        (state.pose, state.reset) = (None, true);
        state.measured.clear();
        state.tracked.clear();
        drop(state);
        self.wake.notify_one();
    }

    pub(crate) fn stop(&self) {
        self.lock().stop = true;
        self.wake.notify_one();
    }

    fn next(&self) -> Task {
        let mut state = self.lock();
        loop {
            if state.stop {
                return Task::Stop;
            }
            if std::mem::take(&mut state.reset) {
                return Task::Reset;
            }
            if let Some(pose) = state.pose.take() {
                let (measured, tracked) = (std::mem::take(&mut state.measured), std::mem::take(&mut state.tracked));
                return Task::Step(pose, measured, tracked);
            }
            state = self.wake.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

/// Runs until it is stopped.
pub(super) fn run(outputs: &MemberOutputs, frame_id: &str, members: &[Member], newest: &Newest, shared: &Shared) {
    lower_priority();
    let begun = Instant::now();
    let trouble = |k: usize, why: String| tracing::warn!("member {k} is left out, since it can't be built: {why}");
    let live = match Live::build(members, trouble) {
        Ok(live) => live,
        Err(error) => return tracing::error!("there is no prediction_band: {error}"),
    };
    tracing::info!("{} members are ready after {:.1} s", members.len(), begun.elapsed().as_secs_f64());
    let mut thread = MembersThread {
        outputs,
        frame_id,
        shared,
        live,
        members: members.len(),
        due: Instant::now(),
        most: 0,
        answered: VecDeque::new(),
        tracks: Tracks::default(),
        miscounted: Throttle::new(Duration::from_secs(60)),
        been_inside: false,
        touched: false,
        rejects: false,
    };
    loop {
        match newest.next() {
            Task::Stop => return,
            Task::Reset => thread.reset(),
            Task::Step(answered, measured, tracked) => thread.step(&answered, measured, tracked),
        }
    }
}

struct MembersThread<'a> {
    outputs: &'a MemberOutputs,
    frame_id: &'a str,
    shared: &'a Shared,
    live: Live,
    members: usize,
    /// Time at which the targets are next published.
    due: Instant,
    /// Largest number of members that had an answer.
    most: usize,
    /// Stamps of the latest answers, and the members' predictions.
    answered: VecDeque<(i64, Told)>,
    tracks: Tracks,
    miscounted: Throttle,
    /// Whether the instrument was in the sample at an answered pose, and at a reading of the load cell.
    been_inside: bool,
    touched: bool,
    /// Whether it was logged that the load cell is rejected.
    rejects: bool,
}

impl MembersThread<'_> {
    fn reset(&mut self) {
        self.live.reset();
        self.answered.clear();
        self.tracks.reset();
        (self.been_inside, self.touched, self.rejects) = (false, false, false);
    }

    fn step(&mut self, answered: &Answered, measured: VecDeque<Measured>, tracked: VecDeque<Seen>) {
        self.live.follow(&answered.pose);
        if self.answered.len() == KEPT {
            self.answered.pop_front();
        }
        self.answered.push_back((answered.stamp.nanos(), self.live.told(false)));
        measured.into_iter().for_each(|reading| self.learn(&reading));
        self.track(answered, tracked);
        self.say_rejected();
        let header = || Header { stamp: answered.stamp, frame_id: self.frame_id.to_owned() };
        let Some((band, count)) = self.live.band() else { return };
        if count < self.most {
            let (lost, members) = (self.members - count, self.members);
            tracing::warn!("{lost} of {members} members have no answer: the band is without them");
        }
        self.most = count;
        let Band { low_n, high_n, .. } = band;
        self.shared.lock().band = Some(Banded { stamp_nanos: answered.stamp.nanos(), low_n, high_n });
        if self.outputs.band.is_wanted() {
            self.outputs.band.send(force_band(header(), answered.depth_m, &band, count));
        }
        let settings = self.shared.settings();
        if settings.tissue_rate_hz > 0.0 && Instant::now() >= self.due && self.outputs.targets.is_wanted() {
            self.due = Instant::now() + Duration::from_secs_f64(1.0 / settings.tissue_rate_hz);
            for target in self.live.targets() {
                self.outputs.targets.send(target_pose(header(), &target));
            }
        }
        if self.outputs.outlook.is_wanted() {
            let motion = Motion::new(settings.outlook_m, SPEED_M_PER_S, Motion::STEPS);
            let ahead = self.live.ahead(&motion);
            if let Some(outlook) = ahead.and_then(|ahead| outlook(header(), answered.depth_m, &ahead, &self.live)) {
                self.outputs.outlook.send(outlook);
            }
        }
    }

    /// Assimilates a reading at a pose that the members have answered, unless the tissue oscillates after separating
    /// from the instrument.
    fn learn(&mut self, reading: &Measured) {
        self.touched |= reading.depth_m > 0.0;
        let Ok(place) = self.answered.binary_search_by_key(&reading.stamp_nanos, |(stamp, _)| *stamp) else { return };
        if reading.depth_m > 0.0 || !self.touched {
            self.live.measured(reading.measured_n, &self.answered[place].1);
        }
    }

    /// Assimilates tracked points up to the pose that the members have just answered.
    fn track(&mut self, answered: &Answered, tracked: VecDeque<Seen>) {
        let inside = answered.depth_m > 0.0;
        let counts = inside || !self.been_inside;
        self.been_inside |= inside;
        self.tracks.seen(tracked);
        self.tracks.answered(answered.stamp.nanos(), counts, &self.live);
        if let Some([seen, targets]) = self.tracks.learn(&mut self.live)
            && self.miscounted.pass().is_some()
        {
            tracing::warn!(
                "measured_targets has {seen} poses and the scene {targets} targets: it needs one for each, in their order"
            );
        }
    }

    fn say_rejected(&mut self) {
        let rejects = self.live.assimilation().is_some_and(Assimilation::rejects);
        if rejects != std::mem::replace(&mut self.rejects, rejects) {
            if rejects {
                tracing::warn!(
                    "the members do not take in the load cell: no member explains what it reads, nor do the errors seen so far"
                );
            } else {
                tracing::info!("the members take in the load cell again");
            }
        }
    }
}

/// `None` where a number is not finite.
fn outlook(header: Header, depth_m: f64, ahead: &Ahead, live: &Live) -> Option<Outlook> {
    let error_n = live.assimilation().map_or(0.0, Assimilation::error_n);
    let points = |of: &[Vec<[f64; 3]>]| of.iter().flatten().map(|p| (*p).into()).collect();
    let count = |n: Option<usize>| u32::try_from(n.unwrap_or(0)).unwrap_or(u32::MAX);
    let blocks =
        |of: fn(&Assimilation) -> usize| live.assimilation().map_or(0, |a| u64::try_from(of(a)).unwrap_or(u64::MAX));
    let forces_n: Vec<f64> = ahead.forces_n.iter().flatten().copied().collect();
    let places = ahead.targets_now.iter().chain(&ahead.targets_ahead).flatten().flatten();
    let finite = forces_n.iter().chain(places).chain([&error_n, &depth_m]).all(|x| x.is_finite());
    finite.then(|| Outlook {
        header,
        depth_m,
        depths_m: ahead.way_m.iter().map(|way| depth_m + way).collect(),
        members: count(Some(ahead.forces_n.len())),
        forces_n,
        error_n,
        targets: count(ahead.targets_now.first().map(Vec::len)),
        targets_now: points(&ahead.targets_now),
        targets_ahead: points(&ahead.targets_ahead),
        blocks: blocks(Assimilation::blocks),
        rejected_blocks: blocks(Assimilation::rejected),
    })
}

fn force_band(header: Header, depth_m: f64, band: &Band, members: usize) -> ForceBand {
    ForceBand {
        header,
        depth_m,
        mean_n: band.mean_n,
        standard_deviation_n: band.standard_deviation_n,
        low_n: band.low_n,
        high_n: band.high_n,
        members: u32::try_from(members).unwrap_or(u32::MAX),
    }
}

/// A point has no orientation: the identity, without a covariance.
fn target_pose(header: Header, target: &Spread) -> PoseWithCovarianceStamped {
    let mut covariance = [[0.0; 6]; 6];
    for (row, values) in covariance.iter_mut().zip(&target.covariance_m2) {
        row[..3].copy_from_slice(values);
    }
    let orientation = Quaternion { w: 1.0, ..Quaternion::default() };
    let pose = Pose { position: target.mean_m.into(), orientation };
    PoseWithCovarianceStamped { header, pose: PoseWithCovariance { pose, covariance } }
}
