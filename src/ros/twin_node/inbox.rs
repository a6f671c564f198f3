//! The newest pose, handed from the input thread to the solver thread.
//!
//! There is one place for a pose: a newer one replaces one that has not been begun, so the twin can never fall further
//! behind than one pose. What was replaced is counted, never lost silently.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use super::look_ahead::Double;
use super::tissue::Snapshot;
use crate::ros::messages::builtin_interfaces::Time;
use crate::twin::Pose;

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
    pose: Option<PoseInput>,
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
        let coalesced = state.pose.replace(pose).is_some();
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
        state.pose = None;
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
        state.pose = None;
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
        (state.at_work || (state.pose.is_some() && !state.building)).then_some(state.given)
    }

    /// Waits for work. A wish for a snapshot or a look ahead waits for two poses at most.
    pub fn next(&self) -> Work {
        let mut state = self.lock();
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
    if std::mem::take(&mut state.wish_turn) || state.pose.is_none() {
        if std::mem::take(&mut state.look_ahead) {
            return Some(Work::LookAhead);
        }
        if let Some(snapshot) = state.snapshot.take() {
            return Some(Work::Snapshot(snapshot));
        }
    }
    let pose = state.pose.take()?;
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
        let Work::Pose(first) = inbox.next() else { panic!("a pose was put") };
        assert_eq!(first.place, Where::Depth(2.0));
        assert_eq!(inbox.put_pose(pose(3.0)), Handoff { coalesced: false, missed: true });
        assert_eq!(inbox.put_pose(pose(4.0)), Handoff { coalesced: true, missed: false });
        let Work::Pose(second) = inbox.next() else { panic!("a pose was put") };
        assert_eq!(second.place, Where::Depth(4.0));
    }

    #[test]
    fn a_reset_forgets_the_pose_before_it() {
        let inbox = Inbox::default();
        inbox.put_pose(pose(1.0));
        inbox.reset("test");
        assert!(matches!(inbox.next(), Work::Reset("test")));
        inbox.stop();
        assert!(matches!(inbox.next(), Work::Stop));
    }

    #[test]
    fn a_snapshot_waits_for_one_pose_at_most() {
        let inbox = Inbox::default();
        inbox.put_snapshot(Box::default());
        inbox.put_pose(pose(1.0));
        assert!(matches!(inbox.next(), Work::Pose(_)));
        inbox.put_pose(pose(2.0));
        assert!(matches!(inbox.next(), Work::Snapshot(_)));
        assert!(matches!(inbox.next(), Work::Pose(_)));
    }
}
