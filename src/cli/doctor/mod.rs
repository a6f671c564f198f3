//! `needle_twin doctor`: whether this machine and its environment will do, and what to change; for a report of a fault as a zip.

mod bundle;
mod clock;
mod folders;
#[cfg(feature = "ros")]
mod network;
mod outside;
mod privacy;
mod processor;
mod program;
#[cfg(feature = "ros")]
mod ros;
#[cfg(not(feature = "ros"))]
#[path = "without_ros.rs"]
mod ros;
mod row;
mod scheduling;

use std::path::PathBuf;

use clap::Args;

use self::row::{Group, Verdict, json, text, worst};
use super::{CliError, Outcome, print};

/// Say whether this machine will do, and what to change: versions, processor, ROS environment, other nodes, ports
///
/// Takes about four seconds. Runs a preset for one of them, and listens on the ROS domain for two. Changes nothing.
/// Exit code 0: no problem (there may be notes); 3: something does not work.
#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Write the findings into this zip as well, without personal data, for a report of a fault
    #[arg(long, value_name = "FILE")]
    bundle: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> Result<Outcome, CliError> {
    let groups = look();
    print(&if arguments.json { json(&groups) } else { text(&groups) })?;
    if let Some(path) = &arguments.bundle {
        bundle::write(path, &groups)?;
        if !arguments.json {
            print(&format!("{} is for a report of a fault; look at it before you publish it\n", path.display()))?;
        }
    }
    Ok(if worst(&groups) == Verdict::Problem { Outcome::Lossy } else { Outcome::Complete })
}

fn look() -> Vec<Group> {
    let mut groups = vec![
        Group { subject: "program", rows: program::rows() },
        Group { subject: "processor", rows: processor::rows() },
        Group { subject: "scheduling", rows: scheduling::rows() },
        Group { subject: "folders", rows: folders::rows() },
        Group { subject: "clock", rows: clock::rows(ros::reads_other_machines()) },
    ];
    groups.extend(ros::groups());
    groups
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::doctor::row::Row;

    #[test]
    fn what_a_network_says_cannot_forge_a_line() {
        let rows = vec![Row::ok("other nodes", "/a\n  ok  b"), Row::problem("x", "y", "Change z.")];
        let groups = [Group { subject: "domain", rows }];
        let text = text(&groups);
        assert_eq!(text.lines().count(), 5, "{text}");
        assert!(text.ends_with("1 problem, 0 notes\n"), "{text}");
        assert_eq!(worst(&groups), Verdict::Problem);
    }
}
