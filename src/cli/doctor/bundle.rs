//! What a report of a fault needs, in one zip: the findings, versions and variables, without personal data.

use std::io::{Cursor, Write as _};
use std::path::Path;

use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

use super::privacy::Mask;
use super::row::{Group, json, text};
use crate::cli::CliError;

/// Variables whose values are shown: none of them names people, machines or places.
const SHOWN: [&str; 14] = [
    "LANG",
    "LC_ALL",
    "RAYON_NUM_THREADS",
    "RCUTILS_COLORIZED_OUTPUT",
    "RCUTILS_LOGGING_USE_STDOUT",
    "RMW_IMPLEMENTATION",
    "ROS_AUTOMATIC_DISCOVERY_RANGE",
    "ROS_DISTRO",
    "ROS_DOMAIN_ID",
    "ROS_LOCALHOST_ONLY",
    "ROS_SECURITY_ENABLE",
    "ROS_VERSION",
    "RUST_BACKTRACE",
    "ZENOH_ROUTER_CHECK_ATTEMPTS",
];
/// Beginnings of the names of other variables that matter. Their values may name other machines: it is only said that they are set.
const NAMED_ONLY: [&str; 6] = ["ROS_", "RCUTILS_", "CYCLONEDDS_", "FASTRTPS_", "FASTDDS_", "ZENOH_"];

const README: &str = "\
What `needle_twin doctor --bundle` found, for a report of a fault.

doctor.txt, doctor.json   the findings, as text and for programs
version.txt               version of the program
environment.txt           variables of ROS 2 and of the program that are set

The name of the user, the home folder, other folders in use, the name of the machine, and network and hardware addresses
are replaced by <user>, ~, <folder>, <host> and <address>. Variables that may name other machines are listed without their
values. Names of nodes and topics on the ROS domain are in the findings as they were heard. Look at the files before you
publish them.
";

/// Writes it.
pub(super) fn write(path: &Path, groups: &[Group]) -> Result<(), CliError> {
    let fault = |source| CliError::Bundle { path: path.to_owned(), source };
    let bytes = pack(&masked(groups, &Mask::of_this_machine())).map_err(fault)?;
    std::fs::write(path, bytes).map_err(fault)
}

/// The findings without personal data.
fn masked(groups: &[Group], mask: &Mask) -> Vec<Group> {
    let mut groups = groups.to_vec();
    for row in groups.iter_mut().flat_map(|group| &mut group.rows) {
        row.value = mask.apply(&row.value);
        row.advice = row.advice.take().map(|advice| mask.apply(&advice));
    }
    groups
}

fn pack(groups: &[Group]) -> std::io::Result<Vec<u8>> {
    let files = [
        ("README.txt", README.to_owned()),
        ("doctor.txt", text(groups)),
        ("doctor.json", json(groups)),
        ("version.txt", concat!("needle_twin ", env!("CARGO_PKG_VERSION"), "\n").to_owned()),
        (
            "environment.txt",
            environment(std::env::vars_os().filter_map(|(k, v)| Some((k.into_string().ok()?, v.into_string().ok()?)))),
        ),
    ];
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Deflated);
    for (name, content) in files {
        zip.start_file(name, options)?;
        // what was heard on a network may hold what a terminal would obey
        zip.write_all(terminal::block(&content).as_bytes())?;
    }
    Ok(zip.finish()?.into_inner())
}

fn environment(variables: impl Iterator<Item = (String, String)>) -> String {
    let mut lines: Vec<String> = variables
        .filter_map(|(name, value)| {
            if SHOWN.contains(&&*name) {
                Some(format!("{name}={value}\n"))
            } else {
                NAMED_ONLY
                    .iter()
                    .any(|start| name.starts_with(start))
                    .then(|| format!("{name} (set, its value is not shown)\n"))
            }
        })
        .collect();
    lines.sort();
    lines.concat()
}
