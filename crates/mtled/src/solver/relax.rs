//! The memory of a relaxing material in step with the poses' time.

use super::disjoint::{Chunks, Each};
use super::kernel::{Kernel, NODES_PER_CHUNK};
use super::memory::Sums;
use super::pool::Pool;
use super::state::{Solver, with_kernel};
use crate::number::Real;

impl<T: Real> Kernel<T> {
    /// Whether the material relaxes.
    pub(super) fn relaxes(&self) -> bool {
        !self.constants.law.prony.is_empty()
    }

    /// What relaxation will change in the distortional stress in `dt` seconds from the last commit if nothing moves,
    /// relative to that stress: upper bound of the root mean square over the body.
    fn unrest(&self, dt: f64) -> f64 {
        let prony = &self.constants.law.prony;
        let decay = prony.increment(dt).decay;
        let sum = |value: &dyn Fn(&Sums) -> f64| -> f64 {
            self.blocks.iter().map(|b| value(b.memory.sums())).sum::<f64>().sqrt()
        };
        let total = sum(&|s| s.total);
        let change: f64 = (0..prony.len()).map(|i| (1.0 - decay[i]) * sum(&|s| s.terms[i])).sum();
        if total > 0.0 { change / total } else { 0.0 }
    }

    pub(super) fn save_memory(&mut self) {
        self.blocks.iter_mut().for_each(|b| b.memory.save());
    }

    pub(super) fn restore_memory(&mut self) {
        self.blocks.iter_mut().for_each(|b| b.memory.restore());
    }

    pub(super) fn clear_memory(&mut self) {
        self.blocks.iter_mut().for_each(|b| b.memory.clear());
    }
}

impl<T: Real> Kernel<T> {
    fn begin(&mut self, pool: &mut Pool, dt: f64) {
        let prony = &self.constants.law.prony;
        pool.each(Each::new(&mut self.blocks), |_, block| block.begin(prony, dt));
    }

    fn commit(&mut self, pool: &mut Pool, dt: f64) {
        let law = &self.constants.law;
        pool.each(Each::new(&mut self.blocks), |_, block| block.commit(law, dt));
    }
}

impl Solver {
    /// Seconds from the last commit to `time_s`; time that runs backwards stands still.
    fn since_commit(&self, time_s: f64) -> f64 {
        self.state.time.map_or(0.0, |then| (time_s - then).max(0.0))
    }

    fn relaxes(&self) -> bool {
        with_kernel!(&self.kernel, k => k.relaxes())
    }

    /// Relative change of the distortional stress by relaxation alone from the last commit to `time_s`; 0 for an
    /// elastic material.
    #[must_use]
    pub fn unrest(&self, time_s: f64) -> f64 {
        let dt = self.since_commit(time_s);
        with_kernel!(&self.kernel, k => if k.relaxes() { k.unrest(dt) } else { 0.0 })
    }

    /// Lets the material relax until `time_s`: the advances that follow find the balance of that moment.
    pub fn relax_until(&mut self, time_s: f64) {
        let dt = self.since_commit(time_s);
        if self.state.time.is_none() {
            (self.state.time, self.saved.time) = (Some(time_s), Some(time_s));
        }
        with_kernel!(&mut self.kernel, k => if k.relaxes() { k.begin(&mut self.pool, dt) });
    }

    /// The same after [`Solver::restore`], with the internal force of the moment, which a step estimate needs.
    pub fn relax_again(&mut self, time_s: f64) {
        if !self.relaxes() {
            return;
        }
        self.relax_until(time_s);
        let (pool, u) = (&mut self.pool, &self.state.u);
        let f = Chunks::new(&mut self.state.f, NODES_PER_CHUNK);
        with_kernel!(&mut self.kernel, k => {
            k.force(pool, u);
            pool.each(f, |i, f| {
                for (f, n) in f.iter_mut().zip(i * NODES_PER_CHUNK..) {
                    *f = k.node_force(n);
                }
            });
        });
    }

    /// Takes the present deformation as that of `time_s`: the material remembers it.
    pub fn commit(&mut self, time_s: f64) {
        let dt = self.since_commit(time_s);
        self.state.time = Some(time_s);
        with_kernel!(&mut self.kernel, k => if k.relaxes() { k.commit(&mut self.pool, dt) });
    }

    /// Takes no step until `time_s`: what relaxes is remembered, and the present state kept to come back to, since
    /// coming back to one from before a long rest would spread what follows over all of the rest.
    pub fn rest(&mut self, time_s: f64) {
        self.commit(time_s);
        if self.relaxes() {
            self.save();
        }
    }
}
