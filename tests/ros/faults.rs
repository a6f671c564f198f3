//! Faults provoked for real on a running twin: nothing is lost without a word, nothing false is said. The promises stand
//! in `docs/faults.md`.

mod disk;
mod divergence;
mod forged;
mod input;
mod load_cell;
mod overload;
mod readers;
mod restart;
mod rivals;
mod signals;
mod solver;
