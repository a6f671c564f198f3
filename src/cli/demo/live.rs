//! Predicted against measured while it happens: curves in a terminal, line by line where there is none.

use std::io::Write as _;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use crate::cli::curves::Curves;
use crate::cli::progress::{newtons, two_figures};
use crate::ros::observer::Observations;
use ros2_messages::needle_twin::TwinStatus;

/// Width of a bar of the chart, characters.
const WIDTH: usize = 22;

/// Time between two pictures.
const REDRAW: Duration = Duration::from_millis(100);

/// The display on stderr: a picture that grows over a bar that moves, or a line per second.
pub(super) struct Live {
    bar: ProgressBar,
    curves: Curves,
    /// Predictions that are in the curves.
    drawn: usize,
    full_scale_n: f64,
    begun: Option<Instant>,
    next_line: Duration,
}

impl Live {
    /// `full_scale_n` is the force that fills a bar, `duration` how long the recording plays.
    pub(crate) fn new(full_scale_n: f64, duration: Duration) -> Self {
        let bar = ProgressBar::new(duration.as_millis() as u64);
        let style = ProgressStyle::with_template("{msg}\n{spinner} {bar:40} {percent:>3}%");
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        bar.enable_steady_tick(Duration::from_millis(100));
        Self { bar, curves: Curves::default(), drawn: 0, full_scale_n, begun: None, next_line: Duration::ZERO }
    }

    /// Says what is being done.
    pub(crate) fn say(&self, what: &str) {
        if self.bar.is_hidden() && !what.is_empty() {
            let _ = writeln!(std::io::stderr(), "{what}"); // nowhere left to say that it can't be said
        } else {
            self.bar.set_message(what.to_owned());
        }
    }

    /// Shows the present state.
    pub(crate) fn show(&mut self, heard: &Observations) {
        let begun = *self.begun.get_or_insert_with(Instant::now);
        self.bar.set_position(begun.elapsed().as_millis() as u64);
        let Some(depth) = heard.depths.last() else { return };
        if begun.elapsed() < self.next_line {
            return;
        }
        if !self.bar.is_hidden() {
            self.next_line = begun.elapsed() + REDRAW;
            self.draw(heard);
            return;
        }
        if self.next_line.is_zero() {
            self.line(&format!(
                "{:>6} {:>9}   {:<width$}  {:<width$}  phase",
                "time",
                "depth",
                "predicted force",
                "measured force",
                width = WIDTH + 10
            ));
        }
        self.next_line += Duration::from_secs(1);
        let force = |heard: Option<f64>| match heard {
            Some(n) => format!("{:>10} {}", newtons(n), self.column(n)),
            None => format!("{:>8}   {}", "-", " ".repeat(WIDTH)),
        };
        let status = heard.status.last().map(|s| &s.value);
        self.line(&format!(
            "{:>4.0} s {:>6.2} mm  {}  {}  {}",
            begun.elapsed().as_secs_f64(),
            1e3 * depth.value,
            force(heard.predicted.last().map(|f| f.value[2])),
            force(heard.measured.last().map(|f| f.value[2])),
            status.map_or("", phase),
        ));
    }

    /// Redraws the curves: each prediction at the depth that was heard last before it.
    fn draw(&mut self, heard: &Observations) {
        for predicted in &heard.predicted[self.drawn..] {
            let before = |stamps: usize| stamps.checked_sub(1);
            let depth = before(heard.depths.partition_point(|d| d.stamp_ns <= predicted.stamp_ns));
            let measured = before(heard.measured.partition_point(|f| f.stamp_ns <= predicted.stamp_ns));
            if let Some(depth) = depth {
                let measured = measured.map(|i| heard.measured[i].value[2]);
                self.curves.add(heard.depths[depth].value, Some(predicted.value[2]), measured);
            }
        }
        self.drawn = heard.predicted.len();
        let now = heard.status.last().map_or_else(String::new, |s| {
            let s = &s.value;
            format!(
                "{}: depth {:.2} mm, {} times real time, {:.1} steps per pose, health {}",
                phase(s),
                1e3 * heard.depths.last().map_or(0.0, |d| d.value),
                two_figures(s.real_time_factor),
                s.steps_per_pose,
                health(s)
            )
        });
        self.bar.set_message(format!("{}\n{now}", self.curves.picture()));
    }

    /// Takes the bar away.
    pub(crate) fn finish(&self) {
        self.bar.finish_and_clear();
    }

    fn line(&self, text: &str) {
        self.bar.suspend(|| {
            let _ = writeln!(std::io::stderr(), "{text}"); // nowhere left to say that it can't be said
        });
    }

    fn column(&self, force_n: f64) -> String {
        const EIGHTHS: [&str; 8] = ["", "▏", "▎", "▍", "▌", "▋", "▊", "▉"];
        let cells = (force_n / self.full_scale_n).clamp(0.0, 1.0) * WIDTH as f64;
        let (whole, part) = (cells as usize, ((cells.fract() * 8.0) as usize).min(7));
        let drawn = whole + usize::from(part > 0);
        format!("{}{}{}", "█".repeat(whole), EIGHTHS[part], " ".repeat(WIDTH.saturating_sub(drawn)))
    }
}

fn health(status: &TwinStatus) -> String {
    match status.health {
        TwinStatus::HEALTH_OK => "ok".to_owned(),
        _ => status.reasons.join("; "),
    }
}

fn phase(status: &TwinStatus) -> &'static str {
    match (status.health, status.phase) {
        (TwinStatus::HEALTH_ERROR, _) => "STOPPED",
        (_, TwinStatus::PHASE_APPROACH) => "approach",
        (_, TwinStatus::PHASE_INDENTATION) => "indentation",
        (_, TwinStatus::PHASE_PENETRATION) => "penetration",
        _ => "retraction",
    }
}
