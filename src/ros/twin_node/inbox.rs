//! The newest poses, handed from the input thread to the solver thread.
//!
//! There is room for one pose, or for a burst of as many as the solver answers within two milliseconds: a newer one replaces the
//! oldest that has not been begun, so the twin can never fall further behind than that. What was replaced is counted, never lost
//! silently.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use super::look_ahead::Double;
use super::tissue::Snapshot;
use needle_core::twin::Pose;
use ros2_messages::builtin_interfaces::Time;

/// Where the instrument is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Where {
    /// Depth along the scene's own axis, m.
    Depth(f64),
    /// Pose in frame `sample`.
    Pose(Pose),
}

/// A pose as it came in.
#[derive(Clone, Copy, Debug)]
pub(super) struct PoseInput {
    /// Stamp of the message.
    pub stamp: Time,
    /// When it arrived.
    pub received: Instant,
    /// The pose.
    pub place: Where,
}

/// What the solver has to do next.
pub(super) enum Work {
    Pose(PoseInput),
    Snapshot(Box<Snapshot>),
    /// Send the double out with the present state.
    LookAhead,
    /// It is back.
    Back(Box<Double>),
    Reset(&'static str),
    /// Build the twin.
    Build,
    /// Forget the twin.
    Discard,
    Stop,
}

/// What became of earlier poses when a new one came.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Handoff {
    /// A pose that had not been begun was replaced.
    pub coalesced: bool,
    /// The pose being answered is late: its successor is here.
    pub missed: bool,
}

#[derive(Default)]
struct State {
    /// The oldest first.
    poses: VecDeque<PoseInput>,
    /// Poses that there is room for; one at least.
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
    /// What the solver has been given so far, and whether it is at it.
    given: u64,
    at_work: bool,
    building: bool,
    /// A pose was answered since the last wish was fulfilled.
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

    pub fn put_pose(&self, pose: PoseInput) -> Handoff {
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

    /// Asks for the tissue's present state; false while an earlier wish is still open.
    pub fn put_snapshot(&self, snapshot: Box<Snapshot>) {
        self.lock().snapshot = Some(snapshot);
        self.wake.notify_one();
    }

    /// Asks for the double with the tissue's present state.
    pub fn look_ahead(&self) {
        self.lock().look_ahead = true;
        self.wake.notify_one();
    }

    /// Gives the double back.
    pub fn give_back(&self, double: Box<Double>) {
        self.lock().back = Some(double);
        self.wake.notify_one();
    }

    /// Asks for the undeformed state; a pose from before is forgotten.
    pub fn reset(&self, reason: &'static str) {
        let mut state = self.lock();
        state.reset = Some(reason);
        state.poses.clear();
        drop(state);
        self.wake.notify_one();
    }

    /// Asks for a twin.
    pub fn build(&self) {
        self.lock().build = true;
        self.wake.notify_one();
    }

    /// Asks to forget the twin, and what was meant for it.
    pub fn discard(&self) {
        let mut state = self.lock();
        state.discard = true;
        state.poses.clear();
        drop(state);
        self.wake.notify_one();
    }

    pub fn stop(&self) {
        self.lock().stop = true;
        self.wake.notify_one();
    }

    /// A number that identifies the solver's present or next work, and changes with it; `None` while
    /// there is nothing to do, and while a model is built, which may take as long as it takes.
    pub fn at_work(&self) -> Option<u64> {
        let state = self.lock();
        (state.at_work || (!state.poses.is_empty() && !state.building)).then_some(state.given)
    }

    /// What there is to do beside the work that the solver is at; `None`: nothing, and it goes on. Either is a sign of life.
    pub fn meanwhile(&self, room: usize) -> Option<Work> {
        let mut state = self.lock();
        state.room = room;
        (state.answering, state.missed) = (false, false);
        state.given += 1;
        state.at_work = true;
        let work = take(&mut state);
        state.building = matches!(work, Some(Work::Build));
        work
    }

    /// Waits for work. A wish for a snapshot or a look ahead waits for two poses at most. `room`: for so many poses from now on.
    pub fn next(&self, room: usize) -> Work {
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
#[allow(clippy::panic)] // a test may fail loudly
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
