//! Measures the peak performance of one thread of this machine: the two bounds on the cost of a step.

use std::hint::black_box;
use std::time::Instant;

use mtled::number::Number as _;
use mtled::number::{LANES, Lanes, Loop, run};

/// Number of bytes read: more than the caches of one core hold, like the gradients of a model.
const STREAM: usize = 16 << 20;
/// Products per accumulator and run.
const PRODUCTS: usize = 200_000;
/// Number of independent accumulators: enough to hide the latency of a fused multiply-add on two units.
const ACCUMULATORS: usize = 10;
/// Number of runs; the best one is used.
const RUNS: usize = 12;

/// Measured on one thread; best of several runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Bytes read in order from beyond the second-level cache, per second.
    pub bytes_per_s: f64,
    /// Single-precision operations per second; a fused multiply-add counts as two.
    pub flops: f64,
}

impl Bounds {
    /// Measures both; this takes a tenth of a second.
    #[must_use]
    pub fn measure() -> Self {
        let stream = vec![Lanes::<f32>::of(1.0); STREAM / size_of::<Lanes<f32>>()];
        let read = best(|| run(Read(&stream)));
        let multiplied = best(|| run(Multiply(black_box(0.999))));
        Self { bytes_per_s: STREAM as f64 / read, flops: (2 * LANES * ACCUMULATORS * PRODUCTS) as f64 / multiplied }
    }
}

fn best(mut f: impl FnMut()) -> f64 {
    let once = |()| {
        let start = Instant::now();
        f();
        start.elapsed().as_secs_f64()
    };
    std::iter::repeat_n((), RUNS).map(once).fold(f64::INFINITY, f64::min)
}

struct Read<'a>(&'a [Lanes<f32>]);

impl Loop for Read<'_> {
    #[inline(always)]
    fn go(self) {
        let mut sums = [Lanes::default(); 4];
        for four in self.0.chunks_exact(4) {
            for (sum, x) in sums.iter_mut().zip(four) {
                *sum += *x;
            }
        }
        black_box(sums);
    }
}

struct Multiply(f32);

impl Loop for Multiply {
    #[inline(always)]
    fn go(self) {
        let factor = Lanes::splat(self.0);
        let mut x = [factor; ACCUMULATORS];
        for _ in 0..PRODUCTS {
            for x in &mut x {
                *x = x.fma(factor, factor);
            }
        }
        black_box(x);
    }
}
