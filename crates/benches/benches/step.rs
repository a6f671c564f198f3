//! Curves of what a pose of one step costs: the presets as they ship and in three dimensions, on one thread, and the time
//! from a scene to its first step. `needle_twin study speed` prints the same as a table, with more models.
#![allow(missing_docs, clippy::unwrap_used)]

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use needle_core::twin::StampedPose;
use needle_twin_benches::{scene, twin_on_one_thread};

const PRESETS: [&str; 3] = ["compression", "indentation", "needle_insertion"];
const DIMENSIONS: [&str; 2] = ["auto", "full"];

fn step(c: &mut Criterion) {
    let mut group = c.benchmark_group("step");
    group.sample_size(20);
    for preset in PRESETS {
        for dimension in DIMENSIONS {
            let mut twin = twin_on_one_thread(&scene(preset, dimension));
            group.throughput(Throughput::Elements(twin.integration_points() as u64));
            let mut i = 0_u32;
            group.bench_function(BenchmarkId::new(preset, dimension), |b| {
                b.iter(|| {
                    // to and fro, so that any number of iterations stays near the surface
                    i += 1;
                    let depth = 1e-6 * f64::from(i % 400).min(f64::from(400 - i % 400));
                    let pose = StampedPose { time_s: 1e-3 * f64::from(i), pose: twin.pose_at_depth(depth) };
                    black_box(twin.step(pose).unwrap())
                });
            });
        }
    }
}

fn build(c: &mut Criterion) {
    let mut group = c.benchmark_group("build");
    group.sample_size(10);
    for dimension in DIMENSIONS {
        let scene = scene("needle_insertion", dimension);
        group.bench_function(BenchmarkId::new("needle_insertion", dimension), |b| {
            b.iter(|| black_box(twin_on_one_thread(&scene)));
        });
    }
}

criterion_group!(benches, step, build);
criterion_main!(benches);
