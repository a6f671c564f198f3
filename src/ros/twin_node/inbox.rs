//! Queue of the newest poses between the input thread and the solver thread.
//!
//! It has room for one pose, or for as many as the solver answers within two milliseconds. A newer pose replaces the
//! oldest one that the solver has not started, so the twin can't fall further behind. Replaced poses are counted.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use super::answer::Snapshot;
use needle_core::twin::{Pose, StampedPose, Twin};
use ros2_messages::builtin_interfaces::Time;

/// Position of the instrument.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Where {
    /// Depth along the scene's own axis, m.
    Depth(f64),
    /// Pose in frame `sample`.
    Pose(Pose),
}

/// A received pose.
#[derive(Clone, Copy, Debug)]
pub(super) struct PoseInput {
    /// Stamp of the message.
    pub stamp: Time,
    /// Time of its reception.
    pub received: Instant,
    /// The pose.
    pub place: Where,
}

/// A scratch copy of the twin with the state at one time.
#[derive(Debug)]
pub(super) struct Double {
    pub twin: Twin,
    /// Start of the motion: the last pose that was answered.
    pub from: Option<StampedPose>,
    /// Its stamp.
    pub stamp: Time,
    pub depth_m: f64,
    /// Recent wall time of one explicit step, s.
    pub step_s: f64,
    /// Generation of the solver's model that this is a copy of.
    pub generation: u64,
}

/// The scratch copy, or why there is none.
pub(super) type Departure = Result<Box<Double>, &'static str>;
/// The solver's next work.
pub(super) enum Work {
    Pose(PoseInput),
    Snapshot(Box<Snapshot>),
    /// Send the scratch copy out with the present state.
    LookAhead,
    /// The scratch copy was returned.
    Back(Box<Double>),
    Reset(&'static str),
    /// Build the twin.
    Build,
    /// Discard the twin.
    Discard,
    Stop,
}

/// Effect of a new pose on earlier ones.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Handoff {
    /// A pose that was not started was replaced.
    pub coalesced: bool,
    /// The pose being answered is late: its successor has arrived.
    pub missed: bool,
}

#[derive(Default)]
struct State {
    /// The oldest first.
    poses: VecDeque<PoseInput>,
    /// Capacity; at least one.
    room: usize,
    snapshot: Option<Box<Snapshot>>,
    look_ahead: bool,
    back: Option<Box<Double>>,
    reset: Option<&'static str>,
    build: bool,
    discard: bool,
    stop: bool,
    answering: bool,
    missed: bool,
    /// Number of works given to the solver, and whether it is active.
    given: u64,
    at_work: bool,
    building: bool,
    /// Whether a pose was answered since the last request was fulfilled.
    wish_turn: bool,
}

/// See the module.
#[derive(Default)]
pub(super) struct Inbox {
    state: Mutex<State>,
    wake: Condvar,
}

impl Inbox {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn put_pose(&self, pose: PoseInput) -> Handoff {
        let mut state = self.lock();
        let coalesced = state.poses.len() >= state.room.max(1);
        if coalesced {
            state.poses.pop_front();
        }
        state.poses.push_back(pose);
        let missed = state.answering && !state.missed;
        state.missed |= missed;
        drop(state);
        self.wake.notify_one();
        Handoff { coalesced, missed }
    }

    /// Requests the tissue's present state; false while an earlier request is pending.
    pub(crate) fn put_snapshot(&self, snapshot: Box<Snapshot>) {
        self.lock().snapshot = Some(snapshot);
        self.wake.notify_one();
    }

    /// Requests the scratch copy with the tissue's present state.
    pub(crate) fn look_ahead(&self) {
        self.lock().look_ahead = true;
        self.wake.notify_one();
    }

    /// Returns the scratch copy.
    pub(crate) fn give_back(&self, double: Box<Double>) {
        self.lock().back = Some(double);
        self.wake.notify_one();
    }

    /// Requests the undeformed state; earlier poses are discarded.
    pub(crate) fn reset(&self, reason: &'static str) {
        let mut state = self.lock();
        state.reset = Some(reason);
        state.poses.clear();
        drop(state);
        self.wake.notify_one();
    }

    /// Requests a twin.
    pub(crate) fn build(&self) {
        self.lock().build = true;
        self.wake.notify_one();
    }

    /// Requests that the twin, and the work queued for it, be discarded.
    pub(crate) fn discard(&self) {
        let mut state = self.lock();
        state.discard = true;
        state.poses.clear();
        drop(state);
        self.wake.notify_one();
    }

    pub(crate) fn stop(&self) {
        self.lock().stop = true;
        self.wake.notify_one();
    }

    /// A number that identifies the solver's present or next work, and changes with it. `None` while there is nothing
    /// to do, and while a model is built, which has no time limit.
    pub(crate) fn at_work(&self) -> Option<u64> {
        let state = self.lock();
        (state.at_work || (!state.poses.is_empty() && !state.building)).then_some(state.given)
    }

    /// Further work for a busy solver; `None`: it continues. Either call is a sign of life.
    pub(crate) fn meanwhile(&self, room: usize) -> Option<Work> {
        let mut state = self.lock();
        state.room = room;
        (state.answering, state.missed) = (false, false);
        state.given += 1;
        state.at_work = true;
        let work = take(&mut state);
        state.building = matches!(work, Some(Work::Build));
        work
    }

    /// Waits for work. A request for a snapshot or a look-ahead waits for at most two poses. `room`: the capacity
    /// from now on.
    pub(crate) fn next(&self, room: usize) -> Work {
        let mut state = self.lock();
        state.room = room;
        state.answering = false;
        state.missed = false;
        state.at_work = false;
        state.building = false;
        loop {
            if let Some(work) = take(&mut state) {
                state.given += 1;
                state.building = matches!(work, Work::Build);
                state.at_work = !state.building;
                return work;
            }
            state = self.wake.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

fn take(state: &mut State) -> Option<Work> {
    if state.stop {
        return Some(Work::Stop);
    }
    if std::mem::take(&mut state.discard) {
        return Some(Work::Discard);
    }
    if std::mem::take(&mut state.build) {
        return Some(Work::Build);
    }
    if let Some(reason) = state.reset.take() {
        return Some(Work::Reset(reason));
    }
    if let Some(double) = state.back.take() {
        return Some(Work::Back(double));
    }
    if std::mem::take(&mut state.wish_turn) || state.poses.is_empty() {
        if std::mem::take(&mut state.look_ahead) {
            return Some(Work::LookAhead);
        }
        if let Some(snapshot) = state.snapshot.take() {
            return Some(Work::Snapshot(snapshot));
        }
    }
    let pose = state.poses.pop_front()?;
    state.answering = true;
    state.wish_turn = true;
    Some(Work::Pose(pose))
}

#[cfg(test)]
#[allow(clippy::panic)] // a test may panic
mod tests {
    use super::*;

    fn pose(depth: f64) -> PoseInput {
        PoseInput { stamp: Time::default(), received: Instant::now(), place: Where::Depth(depth) }
    }

    #[test]
    fn the_newest_pose_wins_and_the_others_are_counted() {
        let inbox = Inbox::default();
        assert_eq!(inbox.put_pose(pose(1.0)), Handoff::default());
        assert_eq!(inbox.put_pose(pose(2.0)), Handoff { coalesced: true, missed: false });
        let Work::Pose(first) = inbox.next(1) else { panic!("a pose was put") };
        assert_eq!(first.place, Where::Depth(2.0));
        assert_eq!(inbox.put_pose(pose(3.0)), Handoff { coalesced: false, missed: true });
        assert_eq!(inbox.put_pose(pose(4.0)), Handoff { coalesced: true, missed: false });
        let Work::Pose(second) = inbox.next(1) else { panic!("a pose was put") };
        assert_eq!(second.place, Where::Depth(4.0));
    }

    #[test]
    fn a_look_between_two_parts_of_a_work_waits_for_nothing_and_shows_that_it_goes_on() {
        let inbox = Inbox::default();
        let seen = || inbox.at_work();
        assert!(inbox.meanwhile(1).is_none());
        let first = seen();
        assert!(first.is_some() && inbox.meanwhile(1).is_none() && seen() != first, "it goes on");
        inbox.put_pose(pose(1.0));
        inbox.reset("test");
        inbox.put_pose(pose(2.0));
        assert!(matches!(inbox.meanwhile(1), Some(Work::Reset("test"))));
        assert!(matches!(inbox.meanwhile(1), Some(Work::Pose(PoseInput { place: Where::Depth(2.0), .. }))));
    }

    #[test]
    fn a_burst_is_answered_pose_by_pose_as_far_as_there_is_room() {
        let inbox = Inbox::default();
        inbox.put_snapshot(Box::default());
        assert!(matches!(inbox.next(3), Work::Snapshot(_)));
        let coalesced: Vec<bool> = (1..=5).map(|i| inbox.put_pose(pose(f64::from(i))).coalesced).collect();
        assert_eq!(coalesced, [false, false, false, true, true]);
        for depth in [3.0, 4.0, 5.0] {
            let Work::Pose(next) = inbox.next(3) else { panic!("a pose was put") };
            assert_eq!(next.place, Where::Depth(depth));
        }
    }

    #[test]
    fn a_reset_forgets_the_pose_before_it() {
        let inbox = Inbox::default();
        inbox.put_pose(pose(1.0));
        inbox.reset("test");
        assert!(matches!(inbox.next(1), Work::Reset("test")));
        inbox.stop();
        assert!(matches!(inbox.next(1), Work::Stop));
    }

    #[test]
    fn a_snapshot_waits_for_one_pose_at_most() {
        let inbox = Inbox::default();
        inbox.put_snapshot(Box::default());
        inbox.put_pose(pose(1.0));
        assert!(matches!(inbox.next(1), Work::Pose(_)));
        inbox.put_pose(pose(2.0));
        assert!(matches!(inbox.next(1), Work::Snapshot(_)));
        assert!(matches!(inbox.next(1), Work::Pose(_)));
    }
}
