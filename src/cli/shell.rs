//! Completions for shells and manual pages, made from the same definition that reads the arguments.

use std::fs;
use std::path::PathBuf;

use clap::{Args, CommandFactory as _};
use clap_complete::Shell;

use super::{Arguments, CliError, Outcome, print};
use needle_report::ReportError;

/// Print the completions of a shell
///
/// For bash: `needle_twin completions bash > ~/.local/share/bash-completion/completions/needle_twin`.
#[derive(Debug, Args)]
pub(super) struct CompletionArguments {
    /// The shell
    shell: Shell,
}

/// Write the manual pages: needle_twin.1 and one for each sub-command
///
/// For a user: `needle_twin man --out ~/.local/share/man/man1`.
#[derive(Debug, Args)]
pub(super) struct ManArguments {
    /// Folder, made if need be
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

pub(super) fn completions(arguments: &CompletionArguments) -> Result<Outcome, CliError> {
    let mut text = Vec::new();
    clap_complete::generate(arguments.shell, &mut Arguments::command(), "needle_twin", &mut text);
    print(&String::from_utf8_lossy(&text))?;
    Ok(Outcome::Complete)
}

pub(super) fn man(arguments: &ManArguments) -> Result<Outcome, CliError> {
    let fault = |source| ReportError::Folder { path: arguments.out.clone(), source };
    fs::create_dir_all(&arguments.out).map_err(fault)?;
    clap_mangen::generate_to(Arguments::command(), &arguments.out).map_err(fault)?;
    Ok(Outcome::Complete)
}
