//! Instructions of one explicit step on one thread, as Callgrind counts them: the same on a busy machine, so a change of the
//! kernel shows to a tenth of a per cent. Needs Valgrind and the runner:
//!
//! ```text
//! cargo install --version 0.19.4 gungraun-runner
//! cargo bench --bench instructions
//! ```
#![allow(missing_docs, clippy::unwrap_used, unused_qualifications)]

use std::hint::black_box;

use gungraun::prelude::*;
use needle_twin::scene::{Override, Scene};
use needle_twin::twin::{Prediction, StampedPose, Twin};

/// A twin at rest on one thread, that takes one step for a pose.
fn twin(preset: &str, dimension: &str) -> Twin {
    let keys = [("discretisation.dimension", dimension), ("stepping.max_steps_per_pose", "1")];
    let scene = Scene::preset(preset).unwrap().with(&keys.map(|(k, v)| Override::text(k, v, "benchmark"))).unwrap();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let mut twin = pool.install(|| Twin::new(&scene)).unwrap();
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
