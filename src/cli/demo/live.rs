//! Predicted against measured, drawn line by line while it happens.

use std::io::Write as _;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use crate::ros::messages::needle_twin::TwinStatus;
use crate::ros::observer::Observations;

/// Width of a bar of the chart, characters.
const WIDTH: usize = 22;

/// The display on stderr: a line per second that stays, and on a terminal a bar that moves.
pub(super) struct Live {
    bar: ProgressBar,
    full_scale_n: f64,
    begun: Option<Instant>,
    next_line: Duration,
}

impl Live {
    /// `full_scale_n` is the force that fills a bar, `duration` how long the recording plays.
    pub fn new(full_scale_n: f64, duration: Duration) -> Self {
        let bar = ProgressBar::new(duration.as_millis() as u64);
        let style = ProgressStyle::with_template("{spinner} {bar:40} {percent:>3}%  {msg}");
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        bar.enable_steady_tick(Duration::from_millis(100));
        Self { bar, full_scale_n, begun: None, next_line: Duration::ZERO }
    }

    /// Says what is being done.
    pub fn say(&self, what: &str) {
        if self.bar.is_hidden() && !what.is_empty() {
            let _ = writeln!(std::io::stderr(), "{what}"); // nowhere left to say that it can't be said
        } else {
            self.bar.set_message(what.to_owned());
        }
    }

    /// Shows the present state.
    pub fn show(&mut self, heard: &Observations) {
        let begun = *self.begun.get_or_insert_with(Instant::now);
        self.bar.set_position(begun.elapsed().as_millis() as u64);
        let Some(depth) = heard.depths.last() else { return };
        if begun.elapsed() < self.next_line {
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
            Some(n) => format!("{n:>8.4} N {}", self.column(n)),
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

    /// Takes the bar away.
    pub fn finish(&self) {
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

fn phase(status: &TwinStatus) -> &'static str {
    match (status.health, status.phase) {
        (TwinStatus::HEALTH_ERROR, _) => "STOPPED",
        (_, TwinStatus::PHASE_APPROACH) => "approach",
        (_, TwinStatus::PHASE_INDENTATION) => "indentation",
        (_, TwinStatus::PHASE_PENETRATION) => "penetration",
        _ => "retraction",
    }
}
