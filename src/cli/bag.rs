//! `needle_twin bag`: what is in a bag, whether every reader can read it, and synthetic recordings of the rig.

use std::fmt::Write as _;
use std::path::PathBuf;

use clap::builder::PossibleValuesParser;
use clap::{Args, Subcommand};
use serde_json::{Value, json};

use super::{CliError, Outcome, print, warn};
use needle_rig::make::{RigRecording, RigScene};
use needle_rig::sensors::{DisplacementModel, LoadCellModel};
use rosbag2_mcap::{BagReader, CheckReport, Severity, check};

/// Look into bags, check them, and make synthetic recordings of the rig
#[derive(Debug, Args)]
pub(super) struct Arguments {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// Say what is in a bag, as `ros2 bag info` does
    Info(Info),
    /// Read all of a bag and say what other readers would refuse or miss
    ///
    /// Exit code 0: sound (there may be warnings); 1: some reader will refuse it or believe something false;
    /// 3: data is lost, the rest can be used.
    Check(Info),
    /// Make a synthetic recording of the rig: depth and force of a stated motion, through sensor models
    ///
    /// The force is that of independent finite-element solutions (bags/reference). It is no measurement.
    Make(Make),
}

#[derive(Debug, Args)]
struct Info {
    /// rosbag2 folder, or a single .mcap
    bag: PathBuf,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Args)]
struct Make {
    /// Which test of the rig; each has its own defaults for what follows
    #[arg(long, value_parser = PossibleValuesParser::new(RigScene::ALL.map(RigScene::name)))]
    scene: String,
    /// Folder to make; it must not exist, or be empty
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Seed of the sensors' noise: the same seed gives the same bytes
    #[arg(long)]
    seed: Option<u64>,
    /// Depth to reach
    #[arg(long, value_name = "D", allow_negative_numbers = true)]
    depth_m: Option<f64>,
    /// Speed of approach and insertion
    #[arg(long, value_name = "V", allow_negative_numbers = true)]
    speed_m_per_s: Option<f64>,
    /// Speed of retraction
    #[arg(long, value_name = "V", allow_negative_numbers = true)]
    retraction_speed_m_per_s: Option<f64>,
    /// Height above the surface at which the recording starts and ends
    #[arg(long, value_name = "H", allow_negative_numbers = true)]
    approach_m: Option<f64>,
    /// Rest at depth
    #[arg(long, value_name = "T", allow_negative_numbers = true)]
    hold_s: Option<f64>,
    /// Readings per second of each sensor
    #[arg(long, value_name = "R", allow_negative_numbers = true)]
    rate_hz: Option<f64>,
    /// Ideal sensors: no noise, offset, drift, resolution steps or non-linearity
    #[arg(long)]
    ideal: bool,
}

pub(super) fn run(arguments: Arguments) -> Result<Outcome, CliError> {
    match arguments.verb {
        Verb::Info(arguments) => info(&arguments),
        Verb::Check(arguments) => check_bag(&arguments),
        Verb::Make(arguments) => arguments.run(),
    }
}

fn info(arguments: &Info) -> Result<Outcome, CliError> {
    let bag = BagReader::open(&arguments.bag)?;
    if arguments.json {
        print(&format!("{:#}\n", info_json(&bag)))?;
    } else {
        bag.warnings().iter().for_each(|w| warn(w));
        bag.losses().iter().for_each(|l| warn(&l.to_string()));
        print(&info_text(&bag))?;
    }
    Ok(if bag.losses().is_empty() { Outcome::Complete } else { Outcome::Lossy })
}

fn seconds(ns: u64) -> f64 {
    ns as f64 * 1e-9
}

fn info_json(bag: &BagReader) -> Value {
    let topics = bag.topics().iter().map(|t| {
        json!({ "name": t.name, "type": t.type_name, "messages": t.messages, "serialization_format": t.encoding, "type_hash": t.hash })
    });
    let span = bag.span_ns();
    json!({
        "bag": bag.name(),
        "files": bag.file_names().collect::<Vec<_>>(),
        "size_bytes": bag.size(),
        "storage": "mcap",
        "ros_distro": bag.metadata().and_then(|m| m.ros_distro.clone()),
        "start_ns": span.map(|s| s.0),
        "end_ns": span.map(|s| s.1),
        "duration_s": span.map(|(start, end)| seconds(end - start)),
        "messages": bag.message_count(),
        "topics": Value::from_iter(topics),
        "custom_data": bag.metadata().and_then(|m| m.custom_data.clone()),
        "losses": bag.losses().iter().map(ToString::to_string).collect::<Vec<_>>(),
        "warnings": bag.warnings(),
    })
}

fn info_text(bag: &BagReader) -> String {
    let mut out = String::new();
    let mut line = |key: &str, value: &str| {
        let _ = writeln!(out, "{:<19}{}", format!("{key}:"), terminal::line(value)); // a String takes anything
    };
    line("Files", &bag.file_names().collect::<Vec<_>>().join(", "));
    line("Bag size", &format!("{:.1} KiB", bag.size() as f64 / 1024.0));
    line("Storage id", "mcap");
    line("ROS Distro", bag.metadata().and_then(|m| m.ros_distro.as_deref()).unwrap_or("unknown"));
    if let Some((start, end)) = bag.span_ns() {
        line("Duration", &format!("{:.6} s", seconds(end - start)));
        line("Start", &date(start));
        line("End", &date(end));
    }
    line("Messages", &bag.message_count().to_string());
    if let Some(description) = bag.custom_data("description") {
        line("Described as", description);
    }
    for (number, t) in bag.topics().iter().enumerate() {
        let key = if number == 0 { "Topic information:" } else { "" };
        let [name, type_name, encoding] = [&t.name, &t.type_name, &t.encoding].map(|text| terminal::line(text));
        let _ = writeln!(
            out,
            "{key:<19}Topic: {name} | Type: {type_name} | Count: {} | Serialization Format: {encoding}",
            t.messages
        );
    }
    out
}

/// A time as date and time in UTC, and as a number.
fn date(ns: u64) -> String {
    let (s, fraction) = (ns / 1_000_000_000, ns % 1_000_000_000);
    let (days, of_day) = (s / 86_400, s % 86_400);
    // Days since 1970 to the Gregorian calendar: years that start in March have their leap day last.
    let z = days + 719_468;
    let (era, of_era) = (z / 146_097, z % 146_097);
    let year_of_era = (of_era - of_era / 1460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let from_march = (5 * of_year + 2) / 153;
    let day = of_year - (153 * from_march + 2) / 5 + 1;
    let month = if from_march < 10 { from_march + 3 } else { from_march - 9 };
    let year = year_of_era + era * 400 + u64::from(month <= 2);
    let (h, m, sec) = (of_day / 3600, of_day / 60 % 60, of_day % 60);
    format!("{year:04}-{month:02}-{day:02} {h:02}:{m:02}:{sec:02}.{fraction:09} UTC ({s}.{fraction:09})")
}

fn check_bag(arguments: &Info) -> Result<Outcome, CliError> {
    let report = check(&arguments.bag)?;
    print(&if arguments.json { check_json(&report) } else { check_text(&report) })?;
    match report.worst() {
        Some(Severity::Error) => {
            let errors = report.findings.iter().filter(|f| f.severity == Severity::Error).count();
            Err(CliError::BagRefused { bag: arguments.bag.clone(), errors })
        }
        Some(Severity::Lost) => Ok(Outcome::Lossy),
        Some(Severity::Warning | Severity::Note) | None => Ok(Outcome::Complete),
    }
}

fn word(severity: Severity) -> &'static str {
    match severity {
        Severity::Error => "error",
        Severity::Lost => "lost",
        Severity::Warning => "warning",
        Severity::Note => "note",
    }
}

fn check_json(report: &CheckReport) -> String {
    let findings = report.findings.iter().map(|f| json!({ "severity": word(f.severity), "text": f.text }));
    let value = json!({
        "bag": report.bag, "messages": report.messages, "topics": report.topics, "findings": Value::from_iter(findings),
    });
    format!("{value:#}\n")
}

fn check_text(report: &CheckReport) -> String {
    let lines = report.findings.iter().map(|f| format!("{}: {}\n", word(f.severity), terminal::line(&f.text)));
    let what = if report.worst().is_none_or(|worst| worst == Severity::Note) { "sound" } else { "read" };
    let (messages, topics) = (report.messages, report.topics);
    format!("{}{}: {what}, {messages} messages on {topics} topics\n", lines.collect::<String>(), report.bag)
}

impl Make {
    fn recording(&self) -> Option<RigRecording> {
        let scene = RigScene::ALL.into_iter().find(|s| s.name() == self.scene)?;
        let mut recording = RigRecording::of(scene);
        let values = [
            (&mut recording.depth_m, self.depth_m),
            (&mut recording.speed_m_per_s, self.speed_m_per_s),
            (&mut recording.retraction_speed_m_per_s, self.retraction_speed_m_per_s),
            (&mut recording.approach_m, self.approach_m),
            (&mut recording.hold_s, self.hold_s),
            (&mut recording.rate_hz, self.rate_hz),
        ];
        for (value, given) in values {
            *value = given.unwrap_or(*value);
        }
        recording.seed = self.seed.unwrap_or(recording.seed);
        if self.ideal {
            (recording.displacement, recording.load_cell) = (DisplacementModel::IDEAL, LoadCellModel::IDEAL);
        }
        Some(recording)
    }

    fn run(&self) -> Result<Outcome, CliError> {
        // clap has let only names of scenes through.
        let Some(recording) = self.recording() else { return Ok(Outcome::Complete) };
        let written = recording.write(&self.out)?;
        let description = format!("{} messages, synthetic {}, seed {}", written.messages, self.scene, recording.seed);
        print(&format!("{}: {description}\n", written.folder.display()))?;
        Ok(Outcome::Complete)
    }
}

#[cfg(test)]
mod tests {
    use super::date;

    #[test]
    fn dates_are_those_of_the_calendar() {
        assert!(date(0).starts_with("1970-01-01 00:00:00.000000000 UTC"));
        assert!(
            date(1_767_225_600_000_300_000).starts_with("2026-01-01 00:00:00.000300000 UTC (1767225600.000300000)")
        );
        assert!(date(951_782_399_000_000_000).starts_with("2000-02-28 23:59:59"));
        assert!(date(951_782_400_000_000_000).starts_with("2000-02-29 00:00:00"));
        assert!(date(4_107_542_400_000_000_000).starts_with("2100-03-01 00:00:00"));
    }
}
