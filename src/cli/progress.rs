//! Progress of a run on stderr: curves and a bar where that is a terminal, now and then a line where it isn't.

use std::io::Write as _;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use super::curves::Curves;
use super::interrupt::Interrupt;
use crate::cli::summary::newtons;
use crate::compare::{Answer, Watch};

/// Answers between two looks at the bar: it must not cost time that the steps could have.
const STRIDE: usize = 16;
/// Time between two pictures.
const REDRAW: Duration = Duration::from_millis(100);
/// Time between two lines where there is no terminal; what ends before the first leaves stderr empty.
const LINE: Duration = Duration::from_secs(5);

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
}

impl Progress {
    /// Says what is being prepared, for as long as the number of poses isn't shown yet.
    pub(super) fn preparing(what: &str) -> Self {
        let bar = ProgressBar::new_spinner().with_message(what.to_owned());
        bar.enable_steady_tick(Duration::from_millis(100));
        let due = if bar.is_hidden() { LINE } else { Duration::ZERO };
        Self::of(bar, Some(due))
    }

    /// Shows nothing, and only listens for Ctrl-C.
    pub(super) fn silent() -> Self {
        Self::of(ProgressBar::hidden(), None)
    }

    fn of(bar: ProgressBar, due: Option<Duration>) -> Self {
        let interrupt = Interrupt::listen();
        Self { bar, interrupt, curves: Curves::default(), begun: Instant::now(), due, poses: 0 }
    }

    /// Says what is going on, in the place of the poses.
    pub(super) fn say(&self, what: &str) {
        self.bar.set_message(what.to_owned());
    }

    /// Goes over to counting poses.
    pub(super) fn count(&mut self, poses: usize) {
        (self.begun, self.poses) = (Instant::now(), poses);
        self.bar.disable_steady_tick();
        let style = ProgressStyle::with_template("{msg}\n{bar:40} {percent:>3}% {pos}/{len} poses, {eta} left");
        self.bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        self.bar.set_length(poses as u64);
        self.bar.set_message("");
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
        let (Some(due), Some(answer), true) = (self.due, answer, done.is_multiple_of(STRIDE)) else { return };
        let live = !self.bar.is_hidden();
        if live {
            self.curves.add(answer.depth_m, Some(answer.predicted_n), answer.measured_n);
        }
        let elapsed = self.begun.elapsed();
        if elapsed < due {
            return;
        }
        self.due = Some(elapsed + if live { REDRAW } else { LINE });
        let measured = answer.measured_n.map_or_else(String::new, |n| format!(", measured {}", newtons(n)));
        let now = format!(
            "{}: depth {:.2} mm, predicted {}{measured}, {:.1} times real time, {} steps per pose",
            answer.phase.as_str(),
            1e3 * answer.depth_m,
            newtons(answer.predicted_n),
            answer.time_s / elapsed.as_secs_f64(),
            answer.steps
        );
        if live {
            self.bar.set_position(done as u64);
            self.bar.set_message(format!("{}\n{now}", self.curves.picture()));
        } else {
            let of = if self.poses > 0 { format!(" of {}", self.poses) } else { String::new() };
            // a failure to write can't be reported either
            let _ = writeln!(std::io::stderr(), "{done}{of} poses, {now}");
        }
    }

    fn stop(&self) -> bool {
        self.interrupt.pressed()
    }
}
