//! Faults provoked for real on a running twin: nothing is lost without a word, nothing false is said. The promises stand
//! in `docs/faults.md`.

#[path = "faults/disk.rs"]
mod disk;
#[path = "faults/input.rs"]
mod input;
#[path = "faults/load_cell.rs"]
mod load_cell;
#[path = "faults/overload.rs"]
mod overload;
#[path = "faults/readers.rs"]
mod readers;
#[path = "faults/restart.rs"]
mod restart;
#[path = "faults/rivals.rs"]
mod rivals;
#[path = "common/ros.rs"]
mod ros;
#[path = "faults/signals.rs"]
mod signals;
#[path = "faults/solver.rs"]
mod solver;
