//! How far a search of many runs is, for whoever waits for it.

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::accuracy::{Row, StudyError};
use needle_core::scene::Scene;
use needle_estimate::compare::{Answer, Cancel, Watch};

/// Number of finished runs whose mean time the next ones are expected to take.
const LAST_RUNS: usize = 5;
/// Least share of a run for its own time to tell how long the rest takes.
const TELLING: f64 = 0.02;

/// State of a search, and the request to end it. Clones share both, so another thread can look at any time.
#[derive(Clone, Debug, Default)]
pub struct Progress {
    cancel: Cancel,
    now: Arc<Mutex<Now>>,
    /// Share of the present run that is done, in thousandths.
    done: Arc<AtomicU32>,
}

/// What a search is doing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Now {
    /// The present run in words; empty before the first.
    pub what: String,
    /// Share of the present run that is done; 0 while its cloud is built.
    pub share: f64,
    /// Number of runs that are finished.
    pub runs: usize,
    /// Largest number of runs after the present one.
    pub runs_left: usize,
    /// What was measured so far.
    pub rows: Vec<Row>,
    /// The best so far that is within the tolerance.
    pub best: Option<Tuned>,
    begun: Option<Instant>,
    took: Vec<Duration>,
}

/// Result of the search.
#[derive(Clone, Debug, PartialEq)]
pub struct Tuned {
    /// The scene with the keys of the row.
    pub scene: Scene,
    /// The row that meets both requirements.
    pub row: Row,
}

impl Tuned {
    pub(super) fn of(scene: &Scene, row: Row) -> Result<Self, StudyError> {
        let tuned = Scene { name: format!("{}_tuned", scene.name), ..row.case.scene(scene)? };
        Ok(Self { scene: tuned, row })
    }
}

impl Progress {
    /// Of work that ends with this cancellation.
    #[must_use]
    pub fn of(cancel: &Cancel) -> Self {
        Self { cancel: cancel.clone(), ..Self::default() }
    }

    /// The cancellation of the work.
    #[must_use]
    pub const fn cancel(&self) -> &Cancel {
        &self.cancel
    }

    /// What is going on.
    #[must_use]
    pub fn now(&self) -> Now {
        Now { share: f64::from(self.done.load(Relaxed)) / 1e3, ..self.lock().clone() }
    }

    /// The next run begins, after which there are at most so many more.
    pub fn begin(&self, what: impl Into<String>, runs_left: usize) {
        self.share(0.0);
        let mut now = self.lock();
        let finished = now.begun.replace(Instant::now()).map(|begun| begun.elapsed());
        now.took.extend(finished);
        (now.runs, now.runs_left, now.what) = (now.took.len(), runs_left, what.into());
    }

    /// How much of the present run is done.
    pub(super) fn share(&self, share: f64) {
        self.done.store((1e3 * share.clamp(0.0, 1.0)) as u32, Relaxed);
    }

    pub(super) fn measured(&self, row: &Row) {
        self.lock().rows.push(row.clone());
    }

    /// What is the best so far.
    pub fn best(&self, best: Option<Tuned>) {
        self.lock().best = best;
    }

    /// Observes a session's run of so many poses.
    #[must_use]
    pub const fn poses(&self, poses: usize) -> Poses<'_> {
        Poses { progress: self, poses }
    }

    fn lock(&self) -> MutexGuard<'_, Now> {
        self.now.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Now {
    /// Time since the present run began.
    #[must_use]
    pub fn run_for(&self) -> Duration {
        self.begun.map_or(Duration::ZERO, |begun| begun.elapsed())
    }

    /// Time until the present run ends: from its own pace, or else from the last runs; `None` if nothing is known yet.
    #[must_use]
    pub fn run_left(&self) -> Option<Duration> {
        if self.share > TELLING {
            return Some(self.run_for().mul_f64((1.0 - self.share) / self.share));
        }
        Some(self.mean()?.saturating_sub(self.run_for()))
    }

    /// Time until the search ends if all runs that may follow do follow, and take as long as the last ones. `None` if
    /// no run has finished.
    #[must_use]
    pub fn left(&self) -> Option<Duration> {
        Some(self.run_left()? + self.mean()? * u32::try_from(self.runs_left).unwrap_or(u32::MAX))
    }

    fn mean(&self) -> Option<Duration> {
        let last = &self.took[self.took.len().saturating_sub(LAST_RUNS)..];
        (!last.is_empty()).then(|| last.iter().sum::<Duration>() / last.len() as u32)
    }
}

/// [`Progress::poses`].
pub struct Poses<'a> {
    progress: &'a Progress,
    poses: usize,
}

impl Watch for Poses<'_> {
    fn progress(&mut self, done: usize, _: Option<&Answer>) {
        self.progress.share(done as f64 / self.poses.max(1) as f64);
    }

    fn cancel(&self) -> &Cancel {
        &self.progress.cancel
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn the_time_left_follows_from_what_the_last_runs_took() {
        let progress = Progress::default();
        progress.begin("first", 9);
        assert_eq!((progress.now().left(), progress.now().run_left()), (None, None), "nothing is known yet");
        std::thread::sleep(Duration::from_millis(40));
        progress.share(0.5);
        let left_s = progress.now().run_left().unwrap().as_secs_f64();
        assert!((0.03..1.0).contains(&left_s), "{left_s}");
        progress.begin("second", 3);
        let now = progress.now();
        assert_eq!((now.what.as_str(), now.share, now.runs, now.runs_left), ("second", 0.0, 1, 3));
        let left_s = now.left().unwrap().as_secs_f64();
        assert!((0.1..4.0).contains(&left_s), "three more and this one: {left_s}");
    }
}
