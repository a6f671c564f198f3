//! Stands for the rows of ROS where the program was built without it.

use super::row::{Group, Row};

pub(super) fn groups() -> Vec<Group> {
    let row = Row::note(
        "nodes",
        "this program was built without the feature ros",
        "Build with `--features ros` where nodes are to run.",
    );
    vec![Group { subject: "ROS 2", rows: vec![row] }]
}

/// Whether messages of other machines are read.
pub(super) fn reads_other_machines() -> bool {
    false
}
