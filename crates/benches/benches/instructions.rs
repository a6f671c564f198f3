//! Instructions of one explicit step on one thread, as Callgrind counts them: the same on a busy machine, so a change of the
//! kernel shows to a tenth of a per cent. Needs Valgrind and the runner:
//!
//! ```text
//! cargo install --version 0.19.4 gungraun-runner
//! cargo bench -p needle_twin_benches --bench instructions
//! ```
#![allow(missing_docs, clippy::unwrap_used, unused_qualifications)]

use std::hint::black_box;

use gungraun::prelude::*;
use needle_core::twin::{Prediction, StampedPose, Twin};
use needle_twin_benches::{scene, twin_on_one_thread};

/// A twin at rest on one thread, that takes one step for a pose.
fn twin(preset: &str, dimension: &str) -> Twin {
    let mut twin = twin_on_one_thread(&scene(preset, dimension));
    // the first pose also prepares what all others use
    twin.step(StampedPose { time_s: 0.0, pose: twin.pose_at_depth(1e-6) }).unwrap();
    twin
}

#[library_benchmark(setup = twin)]
#[bench::compression("compression", "auto")]
#[bench::indentation("indentation", "auto")]
#[bench::needle_insertion("needle_insertion", "auto")]
#[bench::needle_insertion_full("needle_insertion", "full")]
fn step(mut twin: Twin) -> (Twin, Prediction) {
    let pose = StampedPose { time_s: 1e-3, pose: twin.pose_at_depth(2e-6) };
    let answer = black_box(twin.step(black_box(pose)).unwrap());
    (twin, answer)
}

library_benchmark_group!(name = steps, benchmarks = step);
main!(library_benchmark_groups = steps);
