//! What `tune` shows while it searches: a bar where stderr is a terminal, else a line every few seconds.

use std::io::Write as _;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use super::progress::{LINE, span, two_figures};
use needle_studies::progress::Now;
use needle_studies::tune::Tuned;

/// Parts of the bar.
const PARTS: f64 = 1000.0;

pub(super) struct Shown {
    bar: ProgressBar,
    tolerance: f64,
    begun: Instant,
    /// When the next line is due where there is no bar, after the beginning.
    due: Duration,
    /// Rows that were shown.
    rows: usize,
}

impl Shown {
    pub(super) fn new(tolerance: f64) -> Self {
        let bar = ProgressBar::new(PARTS as u64);
        let style = ProgressStyle::with_template("{msg}\n{bar:40} {percent:>3}% of this run, {elapsed} so far");
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        bar.enable_steady_tick(Duration::from_millis(500));
        Self { bar, tolerance, begun: Instant::now(), due: Duration::ZERO, rows: 0 }
    }

    /// Shows what is new, and how far it is.
    pub(super) fn show(&mut self, now: &Now) {
        for row in &now.rows[self.rows..] {
            self.say(&row.line());
        }
        self.rows = now.rows.len();
        let state = state(now, self.tolerance);
        self.bar.set_position((PARTS * now.share) as u64);
        self.bar.set_message(state.clone());
        let elapsed = self.begun.elapsed();
        if self.bar.is_hidden() && elapsed >= self.due {
            self.due = elapsed + LINE;
            self.say(&format!("{} s: {state}\n", elapsed.as_secs()));
        }
    }

    /// Says something beside the bar.
    pub(super) fn say(&self, text: &str) {
        // a failure to write can't be reported either
        self.bar.suspend(|| drop(write!(std::io::stderr(), "{text}")));
    }

    pub(super) fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

/// What is tried, the best so far, and the time left.
fn state(now: &Now, tolerance: f64) -> String {
    if now.what.is_empty() {
        return "the search begins".to_owned();
    }
    let part = if now.share == 0.0 {
        format!("its cloud is built ({:.0} s)", now.run_for().as_secs_f64())
    } else {
        format!("{:.0} % done", 100.0 * now.share)
    };
    let best = now.best.as_ref().map_or_else(|| format!("nothing is within {} % yet", percent(tolerance)), best_so_far);
    let left = match (now.left(), now.run_left()) {
        (Some(left), _) if now.runs_left > 0 => {
            format!("at most {} more runs, about {}", now.runs_left, left_in_words(left))
        }
        (_, Some(left)) => format!("about {} of this run left", left_in_words(left)),
        (_, None) => "the time left is not known yet".to_owned(),
    };
    format!("run {}: {}, {part}; {best}; {left}", now.runs + 1, now.what)
}

fn left_in_words(left: Duration) -> String {
    span(left.as_secs_f64().max(1.0))
}

fn percent(share: f64) -> f64 {
    (1e6 * share).round() / 1e4
}

/// The best so far in words.
pub(super) fn best_so_far(tuned: &Tuned) -> String {
    let row = &tuned.row;
    format!(
        "best so far: {} nodes, {} points, steps {}, largest error {:.2} %, {} times real time",
        row.nodes,
        row.integration_points,
        row.case.steps,
        100.0 * row.max_force_error().unwrap_or(f64::NAN),
        two_figures(row.real_time_factor())
    )
}
