//! Progress of a run on stderr: curves and a bar where that is a terminal, now and then a line where it isn't.

use std::cell::RefCell;
use std::io::Write as _;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use super::curves::Curves;
use super::interrupt::Interrupt;
use needle_estimate::compare::{Answer, Cancel, Watch};

/// Answers between two looks at the bar: it must not cost time that the steps could have.
const STRIDE: usize = 16;
/// Time between two pictures.
const REDRAW: Duration = Duration::from_millis(100);
/// Time between two lines where there is no terminal; what ends before the first leaves stderr empty.
pub(super) const LINE: Duration = Duration::from_secs(5);

/// A progress bar that ends with Ctrl-C.
pub(super) struct Progress {
    bar: ProgressBar,
    interrupt: Interrupt,
    curves: Curves,
    begun: Instant,
    /// When the next picture or line is due, after the beginning; `None` where nothing is shown.
    due: Option<Duration>,
    /// All of them; 0 if unknown.
    poses: usize,
    heartbeat: Arc<Heartbeat>,
}

/// What a thread of its own says while the run says nothing: a pose that diverges can take a minute.
#[derive(Debug)]
struct Heartbeat {
    begun: Instant,
    /// What is being prepared.
    what: Mutex<String>,
    /// When something was said last, after the beginning, ms.
    said_ms: AtomicU64,
    /// Poses that are done, and all of them; 0 of 0 while something is prepared.
    done: AtomicUsize,
    poses: AtomicUsize,
}

impl Heartbeat {
    /// Time between two looks.
    const LOOK: Duration = Duration::from_millis(500);

    /// Speaks until the run is over, where `aloud`.
    fn start(what: &str, aloud: bool) -> Arc<Self> {
        let (said_ms, done, poses) = (AtomicU64::new(0), AtomicUsize::new(0), AtomicUsize::new(0));
        let heartbeat =
            Arc::new(Self { begun: Instant::now(), what: Mutex::new(what.to_owned()), said_ms, done, poses });
        let weak = Arc::downgrade(&heartbeat);
        let speak = move || {
            while let Some(heartbeat) = weak.upgrade() {
                heartbeat.speak();
                drop(heartbeat);
                std::thread::sleep(Self::LOOK);
            }
        };
        if aloud {
            // without the thread the run is as good, and silent
            let _ = std::thread::Builder::new().name("progress".to_owned()).spawn(speak);
        }
        heartbeat
    }

    fn said(&self) {
        self.said_ms.store(u64::try_from(self.begun.elapsed().as_millis()).unwrap_or(u64::MAX), Relaxed);
    }

    fn speak(&self) {
        let silent = self.begun.elapsed().saturating_sub(Duration::from_millis(self.said_ms.load(Relaxed)));
        if silent < LINE + Self::LOOK {
            return;
        }
        self.said();
        let (done, poses, elapsed_s) =
            (self.done.load(Relaxed), self.poses.load(Relaxed), self.begun.elapsed().as_secs());
        // a failure to write can't be reported either
        let _ = if done + poses == 0 {
            let what = self.what.lock().unwrap_or_else(PoisonError::into_inner);
            writeln!(std::io::stderr(), "{what}, {elapsed_s} s so far")
        } else {
            writeln!(std::io::stderr(), "pose {} is being computed, {elapsed_s} s so far", done + 1)
        };
    }
}

impl Progress {
    /// Says what is being prepared, for as long as the number of poses isn't shown yet.
    pub(super) fn preparing(what: &str) -> Self {
        let bar = ProgressBar::new_spinner().with_message(what.to_owned());
        bar.enable_steady_tick(Duration::from_millis(100));
        let due = if bar.is_hidden() { LINE } else { Duration::ZERO };
        let heartbeat = Heartbeat::start(what, bar.is_hidden());
        Self::of(bar, Some(due), heartbeat)
    }

    /// Shows nothing, and only listens for Ctrl-C.
    pub(super) fn silent() -> Self {
        Self::of(ProgressBar::hidden(), None, Heartbeat::start("", false))
    }

    fn of(bar: ProgressBar, due: Option<Duration>, heartbeat: Arc<Heartbeat>) -> Self {
        let interrupt = Interrupt::listen();
        Self { bar, interrupt, curves: Curves::default(), begun: Instant::now(), due, poses: 0, heartbeat }
    }

    /// Says what is going on, in the place of the poses.
    pub(super) fn say(&self, what: &str) {
        self.bar.set_message(what.to_owned());
        what.clone_into(&mut self.heartbeat.what.lock().unwrap_or_else(PoisonError::into_inner));
    }

    /// Goes over to counting poses.
    pub(super) fn count(&mut self, poses: usize) {
        (self.begun, self.poses) = (Instant::now(), poses);
        self.heartbeat.poses.store(poses, Relaxed);
        // a pose that takes long is seen by the time that goes on
        self.bar.enable_steady_tick(Duration::from_secs(1));
        let style =
            ProgressStyle::with_template("{msg}\n{bar:40} {percent:>3}% {pos}/{len} poses, {elapsed}, {eta} left");
        self.bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        self.bar.set_length(poses as u64);
        self.bar.set_message("");
    }

    /// Another bar has spoken: nothing is to be said for a while.
    fn hush(&self) {
        self.heartbeat.said();
    }

    /// Says something beside the bar.
    pub(super) fn warn(&self, message: &str) {
        self.bar.suspend(|| super::warn(message));
    }

    /// Takes the bar away.
    pub(super) fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

impl Watch for Progress {
    fn progress(&mut self, done: usize, answer: Option<&Answer>) {
        let Some(due) = self.due else { return };
        self.heartbeat.done.store(done, Relaxed);
        let live = !self.bar.is_hidden();
        if live {
            if !done.is_multiple_of(STRIDE) {
                return;
            }
            if let Some(answer) = answer {
                self.curves.add(answer.depth_m, Some(answer.predicted_n), answer.measured_n);
            }
        }
        let elapsed = self.begun.elapsed();
        if elapsed < due {
            return;
        }
        self.due = Some(elapsed + if live { REDRAW } else { LINE });
        let now = answer.map_or_else(|| "the last one has no answer".to_owned(), |answer| line(answer, elapsed));
        if live {
            self.bar.set_position(done as u64);
            self.bar.set_message(format!("{}\n{now}", self.curves.picture()));
        } else {
            let (of, left) = match self.poses {
                0 => (String::new(), String::new()),
                poses => (format!(" of {poses}"), format!(", about {} left", left(elapsed, done, poses))),
            };
            self.heartbeat.said();
            // a failure to write can't be reported either
            let _ = writeln!(std::io::stderr(), "{done}{of} poses, {now}{left}");
        }
    }

    fn cancel(&self) -> &Cancel {
        self.interrupt.cancel()
    }
}

/// An answer in words.
fn line(answer: &Answer, elapsed: Duration) -> String {
    let measured = answer.measured_n.map_or_else(String::new, |n| format!(", measured {}", newtons(n)));
    format!(
        "{}: depth {:.2} mm, predicted {}{measured}, {} times real time, {} steps per pose",
        answer.phase.as_str(),
        1e3 * answer.depth_m,
        newtons(answer.predicted_n),
        two_figures(answer.time_s / elapsed.as_secs_f64()),
        answer.steps
    )
}

/// A force as every line of the terminal shows it; one that rounds to zero has no sign.
pub(super) fn newtons(n: f64) -> String {
    format!("{:.4} N", if n.abs() < 5e-5 { 0.0 } else { n })
}

/// A positive number with two significant figures, never in powers of ten: a run that is slow says how slow.
pub(super) fn two_figures(x: f64) -> String {
    let decimals = (1.0 - x.max(1e-4).log10().floor()).clamp(1.0, 5.0) as usize;
    if x.is_finite() { format!("{x:.decimals$}") } else { "?".to_owned() }
}

/// A positive number to a hundredth, and with two significant figures where that leaves none.
pub(super) fn hundredths(x: f64) -> String {
    if x < 0.1 { two_figures(x) } else { format!("{x:.2}") }
}

/// Time that the poses which are left take if each takes as long as those so far.
fn left(elapsed: Duration, done: usize, poses: usize) -> String {
    span(elapsed.as_secs_f64() / done.max(1) as f64 * poses.saturating_sub(done) as f64)
}

/// A time in s, min or h.
pub(super) fn span(seconds: f64) -> String {
    match seconds {
        s if s < 120.0 => format!("{s:.0} s"),
        s if s < 7200.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

/// How much of some work is done and how long the rest takes: a bar where stderr is a terminal, else a line now and then.
pub(super) struct Bar {
    bar: ProgressBar,
    what: &'static str,
    begun: Instant,
    /// When the last line was written, after the beginning, s.
    said_s: AtomicU64,
}

impl Bar {
    /// A bar of so many.
    pub(super) fn new(of: u64, what: &'static str) -> Self {
        let bar = ProgressBar::new(of);
        let template = format!("{{bar:40}} {{pos}}/{{len}} {what}, {{elapsed}}, {{eta}} left  {{msg}}");
        bar.set_style(ProgressStyle::with_template(&template).unwrap_or_else(|_| ProgressStyle::default_bar()));
        bar.enable_steady_tick(Duration::from_millis(500));
        Self { bar, what, begun: Instant::now(), said_s: AtomicU64::new(0) }
    }

    /// So many more are done, the last of this name.
    pub(super) fn add(&self, done: u64, name: &str) {
        self.bar.set_message(name.to_owned());
        self.bar.inc(done);
        let elapsed_s = self.begun.elapsed().as_secs();
        let before_s = self.said_s.load(Relaxed);
        let due = self.bar.is_hidden() && elapsed_s >= before_s + LINE.as_secs();
        // of several threads one speaks
        if due && self.said_s.compare_exchange(before_s, elapsed_s, Relaxed, Relaxed).is_ok() {
            let (done, what) = (self.bar.position(), self.what);
            let of = self.bar.length().unwrap_or(done);
            let left_s = elapsed_s as f64 / done.max(1) as f64 * of.saturating_sub(done) as f64;
            let name = if name.is_empty() { String::new() } else { format!(" ({name})") };
            // a failure to write can't be reported either
            let _ = writeln!(std::io::stderr(), "{done} {what} of {of}, about {left_s:.0} s left{name}");
        }
    }

    pub(super) fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

/// Runs of the twin one after the other, nobody knows how many: what each is of, and a bar of its poses with the time that is left of it.
pub(super) struct Runs<'a> {
    progress: &'a Progress,
    /// What the next run is of.
    said: &'a RefCell<String>,
    poses: usize,
    bar: Option<Bar>,
}

impl<'a> Runs<'a> {
    /// Takes the place of what `progress` has shown, and ends with it.
    pub(super) fn new(progress: &'a Progress, said: &'a RefCell<String>, poses: usize) -> Self {
        progress.finish();
        Self { progress, said, poses, bar: None }
    }
}

impl Drop for Runs<'_> {
    fn drop(&mut self) {
        self.bar.iter().for_each(Bar::finish);
    }
}

impl Watch for Runs<'_> {
    fn progress(&mut self, done: usize, _answer: Option<&Answer>) {
        if done == 1 {
            self.bar.iter().for_each(Bar::finish);
            self.bar = Some(Bar::new(self.poses as u64, "poses"));
        }
        if let Some(bar) = self.bar.as_ref().filter(|_| done.is_multiple_of(STRIDE)) {
            self.progress.hush();
            bar.add(STRIDE as u64, &self.said.borrow());
        }
    }

    fn cancel(&self) -> &Cancel {
        self.progress.cancel()
    }
}

/// A bar of so much work, with the time left; `done` is the template of how much is done.
pub(super) fn bar(work: u64, done: &str) -> ProgressBar {
    let bar = ProgressBar::new(work);
    let style = ProgressStyle::with_template(&format!("{{bar:40}} {done}, {{elapsed}}, {{eta}} left  {{msg}}"));
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar.enable_steady_tick(Duration::from_millis(500));
    bar
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slow_run_says_how_slow_and_how_long() {
        assert_eq!([0.0031, 0.25, 7.26, 123.4].map(two_figures), ["0.0031", "0.25", "7.3", "123.4"]);
        assert_eq!([0.0024, 0.096, 0.25, 72.31].map(hundredths), ["0.0024", "0.096", "0.25", "72.31"]);
        assert_eq!(left(Duration::from_secs(10), 5, 20), "30 s");
        assert_eq!(left(Duration::from_secs(10), 1, 100_000), "277.8 h");
    }
}
