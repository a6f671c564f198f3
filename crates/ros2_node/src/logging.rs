//! The node's log: console lines in ROS 2's format, and `/rosout`.
//!
//! Library code logs with `tracing`. The layer here formats the lines and filters them by `--log-level`. It passes
//! the node's own lines to the thread that publishes `/rosout`, over a bounded channel, so that logging never delays
//! a step.

use std::fmt::Write as _;
use std::fs::File;
use std::io::{IsTerminal, Write as _};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, OnceLock, PoisonError, RwLock};
use std::time::{SystemTime, UNIX_EPOCH};

use crossbeam_channel::{Receiver, Sender};
use tracing::field::{Field, Visit};
use tracing::{Event, Level, Metadata, Subscriber};
use tracing_subscriber::layer::{Context, Layer, SubscriberExt};
use tracing_subscriber::util::SubscriberInitExt;

pub use ros2_guarded::Throttle;

/// Severity with ROS 2's numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// 10.
    Debug = 10,
    /// 20.
    Info = 20,
    /// 30.
    Warn = 30,
    /// 40.
    Error = 40,
    /// 50.
    Fatal = 50,
}

impl Severity {
    /// Parses `debug`, `INFO`, ...
    #[must_use]
    pub(crate) fn parse(text: &str) -> Option<Self> {
        Some(match text.to_ascii_lowercase().as_str() {
            "debug" => Self::Debug,
            "info" => Self::Info,
            "warn" => Self::Warn,
            "error" => Self::Error,
            "fatal" => Self::Fatal,
            _ => return None,
        })
    }

    const fn word(self) -> &'static str {
        match self {
            Self::Debug => "DEBUG",
            Self::Info => "INFO",
            Self::Warn => "WARN",
            Self::Error => "ERROR",
            Self::Fatal => "FATAL",
        }
    }

    fn of(level: Level) -> Self {
        match level {
            Level::ERROR => Self::Error,
            Level::WARN => Self::Warn,
            Level::INFO => Self::Info,
            _ => Self::Debug,
        }
    }
}

/// Log arguments.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LogArguments {
    /// `--log-level LEVEL`, the last one.
    pub level: Option<Severity>,
    /// `--log-level LOGGER:=LEVEL`.
    pub loggers: Vec<(String, Severity)>,
    /// `--enable-rosout-logs` or `--disable-rosout-logs`.
    pub rosout: Option<bool>,
    /// `--enable-stdout-logs` or `--disable-stdout-logs`.
    pub stdout: Option<bool>,
}

impl LogArguments {
    /// Level up to which lines of the middleware are shown, from 1 (error) to 5 (trace).
    pub(crate) fn verbosity(&self) -> u8 {
        match self.loggers.iter().map(|(_, level)| *level).min() {
            Some(Severity::Debug) => 4,
            Some(Severity::Info) => 3,
            Some(Severity::Warn) => 2,
            _ => 1,
        }
    }
}

/// One line for `/rosout`.
#[derive(Clone, Debug)]
pub(crate) struct Record {
    /// Wall time, ns since 1970.
    pub wall_nanos: i64,
    /// Severity.
    pub severity: Severity,
    /// The text.
    pub message: String,
    /// Source file.
    pub file: &'static str,
    /// Source line.
    pub line: u32,
}

/// Number of lines that `/rosout` lost because the publishing thread was behind.
pub(crate) static ROSOUT_DROPPED: AtomicU64 = AtomicU64::new(0);

struct RosLayer {
    name: String,
    /// Crate of the program.
    program: &'static str,
    level: Severity,
    loggers: Vec<(String, Severity)>,
    console: Option<Console>,
    file: Option<Mutex<File>>,
    rosout: Option<Sender<Record>>,
}

/// Levels that were set at run time; they take precedence over those of the command line.
static LEVELS: RwLock<Vec<(String, Severity)>> = RwLock::new(Vec::new());

/// Sets the level of a logger.
pub(crate) fn set_level(logger: &str, level: Severity) {
    let mut levels = LEVELS.write().unwrap_or_else(PoisonError::into_inner);
    levels.retain(|(name, _)| name != logger);
    levels.push((logger.to_owned(), level));
    drop(levels);
    tracing::callsite::rebuild_interest_cache();
}

/// The level that was set for a logger.
#[must_use]
pub(crate) fn level(logger: &str) -> Option<Severity> {
    let levels = LEVELS.read().unwrap_or_else(PoisonError::into_inner);
    levels.iter().find(|(name, _)| name == logger).map(|(_, level)| *level)
}

/// `NAME_PROCESS_MILLISECONDS.log`, as for other ROS 2 programs.
fn open(folder: &Path, name: &str) -> std::io::Result<File> {
    std::fs::create_dir_all(folder)?;
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_millis();
    File::create(folder.join(format!("{name}_{}_{since}.log", std::process::id())))
}

struct Console {
    format: String,
    colour: bool,
    stdout: bool,
}

/// Installs the process's log for a node and returns the lines for `/rosout`. Only the first call in a process
/// affects the console. With a folder, every line is also written to a file there.
#[must_use]
pub(crate) fn install(
    node: &str,
    program: &'static str,
    arguments: &LogArguments,
    folder: Option<&Path>,
) -> Receiver<Record> {
    static INSTALLED: OnceLock<()> = OnceLock::new();
    let (sender, receiver) = crossbeam_channel::bounded(256);
    if INSTALLED.set(()).is_ok() {
        let name = logger_name(node);
        let file =
            folder.map(|folder| open(folder, &name).map_err(|e| format!("{}: {e}", folder.display()))).transpose();
        let unwritten = file.as_ref().err().cloned();
        let layer = RosLayer {
            name,
            program,
            file: file.ok().flatten().map(Mutex::new),
            level: arguments.level.unwrap_or(Severity::Info),
            loggers: arguments.loggers.clone(),
            console: arguments.stdout.unwrap_or(true).then(Console::from_environment),
            rosout: arguments.rosout.unwrap_or(true).then_some(sender),
        };
        // Fails only if the application has installed a subscriber before; then that one stays.
        let _ = tracing_subscriber::registry().with(layer).try_init();
        if let Some(reason) = unwritten {
            tracing::warn!("no log file can be written in ROS_LOG_DIR, {reason}");
        }
    }
    receiver
}

/// The logger name of a node: `or1.twin` for `/or1/twin`.
#[must_use]
pub(crate) fn logger_name(node: &str) -> String {
    node.trim_start_matches('/').replace('/', ".")
}

impl Console {
    fn from_environment() -> Self {
        let variable = |name| std::env::var(name).ok().filter(|v: &String| !v.is_empty());
        let stdout = variable("RCUTILS_LOGGING_USE_STDOUT").is_some_and(|v| v == "1");
        let terminal = if stdout { std::io::stdout().is_terminal() } else { std::io::stderr().is_terminal() };
        Self {
            format: variable("RCUTILS_CONSOLE_OUTPUT_FORMAT")
                .unwrap_or_else(|| "[{severity}] [{time}] [{name}]: {message}".to_owned()),
            colour: match variable("RCUTILS_COLORIZED_OUTPUT").as_deref() {
                Some("1") => true,
                Some("0") => false,
                _ => terminal,
            },
            stdout,
        }
    }

    fn print(&self, name: &str, record: &Record) {
        let line = self.line(name, record);
        // A closed pipe must not end the node.
        if self.stdout {
            let _ = writeln!(std::io::stdout().lock(), "{line}");
        } else {
            let _ = writeln!(std::io::stderr().lock(), "{line}");
        }
    }

    fn line(&self, name: &str, record: &Record) -> String {
        let base = record.file.rsplit('/').next().unwrap_or_default();
        let text = self
            .format
            .replace("\\n", "\n")
            .replace("\\t", "\t")
            .replace("{severity}", record.severity.word())
            .replace(
                "{time}",
                &format!("{}.{:09}", record.wall_nanos / 1_000_000_000, record.wall_nanos % 1_000_000_000),
            )
            .replace("{time_as_nanoseconds}", &record.wall_nanos.to_string())
            .replace("{date_time_with_ms}", &local_time(record.wall_nanos))
            .replace("{name}", name)
            .replace("{short_file_name}", base)
            .replace("{file_name}", record.file)
            .replace("{line_number}", &record.line.to_string())
            .replace("{function_name}", "")
            .replace("{message}", &record.message);
        let colour = match record.severity {
            Severity::Debug => "\x1b[32m",
            Severity::Info => "\x1b[0m",
            Severity::Warn => "\x1b[33m",
            Severity::Error | Severity::Fatal => "\x1b[31m",
        };
        if self.colour { format!("{colour}{text}\x1b[0m") } else { text }
    }
}

/// `2026-01-31 13:05:09.042` in local time.
fn local_time(wall_nanos: i64) -> String {
    chrono::DateTime::from_timestamp_nanos(wall_nanos)
        .with_timezone(&chrono::Local)
        .format("%Y-%m-%d %H:%M:%S%.3f")
        .to_string()
}

impl RosLayer {
    /// Whether a line is the node's own, and not that of a library.
    fn is_own(&self, target: &str) -> bool {
        const OWN: [&str; 4] = [env!("CARGO_CRATE_NAME"), "ros2_guarded", "rosbag2_mcap", "named_threads"];
        let of = target.split("::").next().unwrap_or_default();
        of == self.program || OWN.contains(&of)
    }

    /// Lowest severity that is logged for a target.
    fn threshold(&self, target: &str) -> Severity {
        // A logger's level applies to its descendants: `or1` to `or1.twin`.
        let set = LEVELS.read().unwrap_or_else(PoisonError::into_inner);
        let own = |l: &str| self.name.strip_prefix(l).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'));
        let is_own = self.is_own(target);
        let fits = |l: &str| target.starts_with(l) || (is_own && own(l));
        if let Some((_, level)) = set.iter().rev().chain(self.loggers.iter().rev()).find(|(l, _)| fits(l)) {
            return *level;
        }
        if is_own {
            return self.level;
        }
        // RustDDS logs a lot. A loopback without multicast alone gives 30 errors per second ("No locators for
        // RtpsReaderProxy"). Every malformed packet gives one. Shutdown gives two, and under high load one more per
        // endpoint ("Cannot remove Reader"). The user can act on none of them. Failures to create an endpoint are
        // returned as errors, and a flood of malformed packets is reported in one line.
        const NOISE: [&str; 4] = ["rustdds::rtps", "rustdds::network", "rustdds::discovery", "rustdds::dds::pubsub"];
        if NOISE.iter().any(|n| target.starts_with(n)) { Severity::Fatal } else { Severity::Error }
    }
}

#[derive(Default)]
struct Text(String);

impl Visit for Text {
    fn record_debug(&mut self, field: &Field, value: &dyn std::fmt::Debug) {
        // Events of the `log` crate have their location as fields.
        if field.name() == "message" {
            let _ = write!(self.0, "{value:?}");
        } else if !field.name().starts_with("log.") {
            let _ = write!(self.0, " {}={value:?}", field.name());
        }
    }
}

impl<S: Subscriber> Layer<S> for RosLayer {
    fn enabled(&self, metadata: &Metadata<'_>, _: Context<'_, S>) -> bool {
        Severity::of(*metadata.level()) >= self.threshold(metadata.target())
    }

    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let metadata = event.metadata();
        let mut text = Text::default();
        event.record(&mut text);
        let wall = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let record = Record {
            wall_nanos: i64::try_from(wall.as_nanos()).unwrap_or(i64::MAX),
            severity: Severity::of(*metadata.level()),
            message: terminal::line(&text.0).into_owned(),
            file: metadata.file().unwrap_or(""),
            line: metadata.line().unwrap_or(0),
        };
        if let Some(console) = &self.console {
            console.print(&self.name, &record);
        }
        if let Some(file) = &self.file {
            let Record { severity, wall_nanos: t, message, .. } = &record;
            let (word, s, ns) = (severity.word(), t / 1_000_000_000, t % 1_000_000_000);
            let mut file = file.lock().unwrap_or_else(PoisonError::into_inner);
            // A full disk must not end the node.
            let _ = writeln!(file, "[{word}] [{s}.{ns:09}] [{}]: {message}", self.name);
        }
        // Only the node's own lines: publishing makes the middleware log, which would publish again.
        if self.is_own(metadata.target()) && self.rosout.as_ref().is_some_and(|rosout| rosout.try_send(record).is_err())
        {
            ROSOUT_DROPPED.fetch_add(1, Ordering::Relaxed);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn format_of_ros_2() {
        let console =
            Console { format: "[{severity}] [{time}] [{name}]: {message}".to_owned(), colour: false, stdout: false };
        let record = Record {
            wall_nanos: 1_700_000_000_000_000_007,
            severity: Severity::Warn,
            message: "x".into(),
            file: "f",
            line: 1,
        };
        assert_eq!(console.line("or1.twin", &record), "[WARN] [1700000000.000000007] [or1.twin]: x");
        let format = "{short_file_name}:{line_number} {time_as_nanoseconds} {message}\\n{unknown}".to_owned();
        let console = Console { format, colour: true, stdout: false };
        let record = Record { file: "a/b.rs", message: "{name}".into(), ..record };
        let expected = "\x1b[33mb.rs:1 1700000000000000007 {name}\n{unknown}\x1b[0m";
        assert_eq!(console.line("twin", &record), expected);
        let time = local_time(record.wall_nanos);
        assert!(time.len() == 23 && time.ends_with(":20.000"), "{time}");
    }

    #[test]
    fn levels_per_logger() {
        let layer = |loggers: &[(&str, Severity)]| RosLayer {
            name: "or1.twin".to_owned(),
            program: "their_program",
            level: Severity::Info,
            loggers: loggers.iter().map(|(l, s)| ((*l).to_owned(), *s)).collect(),
            console: None,
            file: None,
            rosout: None,
        };
        let own = "their_program::their_node";
        assert_eq!(layer(&[]).threshold(own), Severity::Info);
        assert_eq!(layer(&[("or1", Severity::Debug)]).threshold(own), Severity::Debug);
        assert_eq!(layer(&[("or1.twin", Severity::Warn)]).threshold(own), Severity::Warn);
        assert_eq!(layer(&[("or1.twi", Severity::Warn)]).threshold(own), Severity::Info);
        assert_eq!(layer(&[("or1", Severity::Debug)]).threshold("rustdds::dds::participant"), Severity::Error);
        assert_eq!(layer(&[("rustdds", Severity::Debug)]).threshold("rustdds::rtps"), Severity::Debug);
        assert_eq!(layer(&[]).threshold("rustdds::rtps"), Severity::Fatal);
        // set at run time: it takes precedence
        set_level("or1.twin", Severity::Error);
        assert_eq!((level("or1.twin"), level("or1")), (Some(Severity::Error), None));
        assert_eq!(layer(&[("or1.twin", Severity::Warn)]).threshold(own), Severity::Error);
        set_level("or1.twin", Severity::Info);
        assert_eq!(layer(&[("or1.twin", Severity::Warn)]).threshold(own), Severity::Info);
    }
}
