//! Folders that the programs write, and the room in them.

use std::fs;
use std::path::Path;

use super::row::Row;

/// Below this a recording or a report may not fit, MiB. An hour's recording at 1 kHz has some hundred.
const LITTLE_MIB: u64 = 1024;

pub(super) fn rows() -> Vec<Row> {
    let here = std::env::current_dir().unwrap_or_default();
    let mut rows = vec![writable("current folder", &here, "Change to a folder of your own, or give one with --out.")];
    if let Some(logs) = std::env::var_os("ROS_LOG_DIR").filter(|value| !value.is_empty()) {
        rows.push(writable(
            "ROS_LOG_DIR",
            Path::new(&logs),
            "Make the folder or unset ROS_LOG_DIR: the nodes write their log there.",
        ));
    }
    rows
}

fn writable(name: &str, folder: &Path, advice: &str) -> Row {
    let trial = folder.join(format!(".needle_twin_{}", std::process::id()));
    let written = fs::File::create_new(&trial).and_then(|_| fs::remove_file(&trial));
    let value = folder.display().to_string();
    if let Err(error) = written {
        return Row::problem(name, format!("{value}: can't be written ({error})"), advice);
    }
    let Ok(room) = rustix::fs::statvfs(folder) else { return Row::ok(name, value) };
    let free_mib = room.f_bavail.saturating_mul(room.f_frsize) >> 20;
    let value = format!("{value}, {free_mib} MiB free");
    if free_mib < LITTLE_MIB {
        Row::note(name, value, "Free some room: recordings and reports of long runs take more.")
    } else {
        Row::ok(name, value)
    }
}
