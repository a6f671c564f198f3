//! The members' thread: the newest answered pose, answered by every member, for the band of the force and the spread of the targets.
//!
//! ```text
//! force thread ──newest answered pose──► this thread: each member steps ──► prediction_band, targets_with_covariance
//! ```
//! Poses that come while the members are busy are skipped, so the band may be late but never falls behind; its stamp says which pose it
//! answers. Members step whether somebody subscribes or not, since each has to follow the instrument to have a state.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::shared::{Banded, Shared};
use super::solver::Answer;
use crate::compare::ensemble::{Band, Live, Member, Spread};
use crate::ros::messages::builtin_interfaces::Time;
use crate::ros::messages::geometry_msgs::{Pose, PoseWithCovariance, PoseWithCovarianceStamped, Quaternion};
use crate::ros::messages::needle_twin::ForceBand;
use crate::ros::messages::std_msgs::Header;
use crate::ros::participant::{Output, Participant, ParticipantError};
use crate::ros::qos;
use crate::twin::StampedPose;
use ros2_guarded::threads::lower_priority;

/// Messages of targets that may wait for a reader: one for each target at one time.
const TARGETS: usize = 100;

/// The publishers.
pub(super) struct MemberOutputs {
    band: Output<ForceBand>,
    targets: Output<PoseWithCovarianceStamped>,
}

impl MemberOutputs {
    pub fn new(participant: &mut Participant) -> Result<Self, ParticipantError> {
        Ok(Self {
            band: participant.publisher("prediction_band", qos::reliable(10))?,
            targets: participant.publisher("targets_with_covariance", qos::reliable(TARGETS))?,
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
    pub const fn of(answer: &Answer) -> Self {
        Self { stamp: answer.stamp, pose: answer.pose, depth_m: answer.prediction.depth_m }
    }
}

#[derive(Debug, Default)]
struct State {
    pose: Option<Answered>,
    reset: bool,
    stop: bool,
}

/// The newest pose that the members have not answered.
#[derive(Debug, Default)]
pub(super) struct Newest {
    state: Mutex<State>,
    wake: Condvar,
}

/// What the members have to do.
enum Task {
    Step(Answered),
    Reset,
    Stop,
}

impl Newest {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub fn put(&self, pose: Answered) {
        self.lock().pose = Some(pose);
        self.wake.notify_one();
    }

    /// The twin is undeformed again: so shall be the members, before any later pose.
    pub fn reset(&self) {
        let mut state = self.lock();
        (state.pose, state.reset) = (None, true);
        drop(state);
        self.wake.notify_one();
    }

    pub fn stop(&self) {
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
                return Task::Step(pose);
            }
            state = self.wake.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

/// Runs until it is told to stop.
pub(super) fn run(outputs: &MemberOutputs, frame_id: &str, members: &[Member], newest: &Newest, shared: &Shared) {
    lower_priority();
    let begun = Instant::now();
    let trouble = |k: usize, why: String| tracing::warn!("member {k} is left out, since it can't be built: {why}");
    let mut live = match Live::build(members, trouble) {
        Ok(live) => live,
        Err(error) => return tracing::error!("there is no prediction_band: {error}"),
    };
    tracing::info!("{} members are ready after {:.1} s", members.len(), begun.elapsed().as_secs_f64());
    let (mut due, mut most) = (Instant::now(), 0);
    loop {
        let answered = match newest.next() {
            Task::Stop => return,
            Task::Reset => {
                live.reset();
                continue;
            }
            Task::Step(answered) => answered,
        };
        live.step(&answered.pose);
        let header = || Header { stamp: answered.stamp, frame_id: frame_id.to_owned() };
        let Some((band, count)) = live.band() else { continue };
        if count < most {
            tracing::warn!(
                "{} of {} members have no answer: the band is without them",
                members.len() - count,
                members.len()
            );
        }
        most = count;
        let Band { low_n, high_n, .. } = band;
        shared.lock().band = Some(Banded { stamp_nanos: answered.stamp.nanos(), low_n, high_n });
        if outputs.band.is_wanted() {
            outputs.band.send(force_band(header(), answered.depth_m, &band, count));
        }
        let rate_hz = shared.settings().tissue_rate_hz;
        if rate_hz > 0.0 && Instant::now() >= due && outputs.targets.is_wanted() {
            due = Instant::now() + Duration::from_secs_f64(1.0 / rate_hz);
            for target in live.targets() {
                outputs.targets.send(target_pose(header(), &target));
            }
        }
    }
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

/// A point has no orientation: that of the frame, without a covariance.
fn target_pose(header: Header, target: &Spread) -> PoseWithCovarianceStamped {
    let mut covariance = [[0.0; 6]; 6];
    for (row, values) in covariance.iter_mut().zip(&target.covariance_m2) {
        row[..3].copy_from_slice(values);
    }
    let orientation = Quaternion { w: 1.0, ..Quaternion::default() };
    let pose = Pose { position: target.mean_m.into(), orientation };
    PoseWithCovarianceStamped { header, pose: PoseWithCovariance { pose, covariance } }
}
