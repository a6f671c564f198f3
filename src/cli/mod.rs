//! The command line: arguments → one library call → exit code. One file per sub-command.
//!
//! Results go to stdout, progress and diagnostics to stderr. A failure is one message: what, where, what to do.

mod bag;
mod batch;
mod calibrate;
mod curves;
#[cfg(feature = "ros")]
mod demo;
mod doctor;
mod error;
mod forecast;
mod import;
mod interrupt;
mod layers;
mod members;
#[cfg(feature = "ros")]
mod nodes;
mod options;
mod output;
mod plan;
mod processor;
mod progress;
mod recorded;
mod replay;
mod scene;
mod shard;
mod shell;
mod solve;
mod study;
mod summary;
mod tune;
mod tune_progress;
mod urdf;

use std::ffi::OsString;
use std::io::{self, Write as _};
use std::process::ExitCode;

use clap::{Parser, Subcommand};

pub(crate) use error::CliError;

#[cfg(feature = "ros")]
use crate::ros::{guard_node, rig_node, twin_node};
use needle_core::scene::file as scene_file;

/// Exit codes, in the words of the help.
const EXIT_CODES: &str = "Exit codes: 0 success; 1 failure, with one message on stderr; 2 wrong usage; \
                          3 finished, but data was lost, the model diverged, its stability table does not hold, it \
                          does not explain the measurement, or `doctor` found a problem.";

/// Digital twin of a needle-insertion test rig: predicts the load cell's force and the tissue's deformation.
/// Without a sub-command it runs `demo`.
#[derive(Debug, Parser)]
#[command(name = "needle_twin", version, after_help = EXIT_CODES, max_term_width = 110)]
struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
}

#[derive(Debug, Subcommand)]
enum Command {
    #[cfg(feature = "ros")]
    Demo(demo::Arguments),
    Replay(replay::Arguments),
    Import(import::Arguments),
    Calibrate(calibrate::Arguments),
    Batch(batch::Arguments),
    Solve(solve::Arguments),
    Forecast(forecast::Arguments),
    Plan(plan::Arguments),
    Study(study::Arguments),
    Tune(tune::Arguments),
    Scene(scene::Arguments),
    Bag(bag::Arguments),
    Doctor(doctor::Arguments),
    Completions(shell::CompletionArguments),
    Man(shell::ManArguments),
    #[cfg(feature = "ros")]
    /// Supervise an insertion: move the needle, watch the twin's prediction, stop when something is lost or out of bounds (a
    /// ROS 2 node; `guard --help`)
    #[command(disable_help_flag = true)]
    Guard(NodeArguments),
    #[cfg(feature = "ros")]
    /// The program `twin_node`, for `demo`
    #[command(hide = true, disable_help_flag = true)]
    TwinNode(NodeArguments),
    #[cfg(feature = "ros")]
    /// The program `rig_node`, for `demo`
    #[command(hide = true, disable_help_flag = true)]
    RigNode(NodeArguments),
}

/// Everything behind the sub-command is the node's own.
#[cfg(feature = "ros")]
#[derive(Debug, clap::Args)]
struct NodeArguments {
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, hide = true)]
    arguments: Vec<OsString>,
}

/// How a command ended that did not fail.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Outcome {
    /// Everything was done.
    Complete,
    /// It ended, but data was lost, the model diverged, or it isn't to be trusted.
    Lossy,
}

/// Runs the program with its arguments (the first is the program's name) and gives the exit code of the process.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    match Arguments::try_parse_from(arguments) {
        #[cfg(feature = "ros")]
        Ok(Arguments { command: Some(Command::TwinNode(node)) }) => ExitCode::from(twin_node::run(node.arguments)),
        #[cfg(feature = "ros")]
        Ok(Arguments { command: Some(Command::RigNode(node)) }) => ExitCode::from(rig_node::run(node.arguments)),
        #[cfg(feature = "ros")]
        Ok(Arguments { command: Some(Command::Guard(node)) }) => ExitCode::from(guard_node::run(node.arguments)),
        Ok(arguments) => exit_code(dispatch(arguments)),
        // Help and version end here too, as "errors" of exit code 0 that go to stdout.
        Err(error) => {
            let _ = error.print(); // a failure to print can't be reported either
            ExitCode::from(u8::try_from(error.exit_code()).unwrap_or(2))
        }
    }
}

fn dispatch(arguments: Arguments) -> Result<Outcome, CliError> {
    match arguments.command {
        #[cfg(feature = "ros")]
        Some(Command::Demo(arguments)) => demo::run(&arguments),
        Some(Command::Replay(arguments)) => replay::run(&arguments),
        Some(Command::Import(arguments)) => import::run(&arguments),
        Some(Command::Batch(arguments)) => batch::run(&arguments),
        Some(Command::Calibrate(arguments)) => calibrate::run(&arguments),
        Some(Command::Solve(arguments)) => solve::run(&arguments),
        Some(Command::Forecast(arguments)) => forecast::run(&arguments),
        Some(Command::Plan(arguments)) => plan::run(&arguments),
        Some(Command::Study(arguments)) => study::run(&arguments),
        Some(Command::Tune(arguments)) => tune::run(&arguments),
        Some(Command::Scene(arguments)) => scene::run(arguments),
        Some(Command::Bag(arguments)) => bag::run(arguments),
        Some(Command::Doctor(arguments)) => doctor::run(&arguments),
        Some(Command::Completions(arguments)) => shell::completions(&arguments),
        Some(Command::Man(arguments)) => shell::man(&arguments),
        // without a sub-command the demo shows what the program does
        #[cfg(feature = "ros")]
        None => demo::run(&demo::Arguments::default()),
        #[cfg(not(feature = "ros"))]
        None => {
            print(&<Arguments as clap::CommandFactory>::command().render_help().to_string()).map(|()| Outcome::Complete)
        }
        // The nodes have exit codes of their own: `run` starts them.
        #[cfg(feature = "ros")]
        Some(Command::Guard(_) | Command::TwinNode(_) | Command::RigNode(_)) => Ok(Outcome::Complete),
    }
}

fn exit_code(result: Result<Outcome, CliError>) -> ExitCode {
    match result {
        Ok(Outcome::Complete) => ExitCode::SUCCESS,
        Ok(Outcome::Lossy) => ExitCode::from(3),
        // the reader of the output has closed the pipe (`| head`)
        Err(CliError::Stdout(error)) if error.kind() == io::ErrorKind::BrokenPipe => ExitCode::SUCCESS,
        Err(error) => {
            let text = error.to_string();
            // The end of a node's log has lines of its own, each of which has been through the same door.
            let text = if matches!(error, CliError::Demo(_)) { terminal::block(&text) } else { terminal::line(&text) };
            let _ = writeln!(io::stderr(), "error: {text}"); // a failure to write can't be reported either
            ExitCode::FAILURE
        }
    }
}

/// Writes a result to stdout.
fn print(text: &str) -> Result<(), CliError> {
    let mut stdout = io::stdout().lock();
    stdout.write_all(terminal::block(text).as_bytes()).and_then(|()| stdout.flush()).map_err(CliError::Stdout)
}

/// Writes a diagnostic to stderr.
fn warn(message: &str) {
    let _ = writeln!(io::stderr(), "warning: {}", terminal::line(message)); // a failure to write can't be reported either
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory as _;

    use super::*;

    #[test]
    fn the_definition_of_the_command_line_is_sound() {
        Arguments::command().debug_assert();
    }
}
