//! What the integration points of a relaxing material remember (see [`crate::material::prony`]).
//!
//! Pseudo time of the explicit steps is numerical, so the memory moves in the poses' own time: [`Memory::begin`] fixes
//! H and gamma for the increment that ends at a pose, any number of steps finds the balance, [`Memory::commit`] takes
//! the deformation that was found into the history.

use crate::material::neo_hookean::{cofactor, determinant};
use crate::material::ogden::Symmetric;
use crate::material::prony::{MOST_TERMS, contract, reference_stress, unimodular};
use crate::material::{Law, Prony};

use super::block::{Block, BlockScratch};
use super::cloned::cloned_field_by_field;
use crate::number::{LANES, Lanes, Real};

const ZERO: Symmetric = [0.0; 6];

cloned_field_by_field! {
    /// Memory of one block; empty for a material that does not relax.
    #[derive(Debug, Default)]
    pub struct Memory {
        /// H of each slot, Pa.
        pub held: Vec<Symmetric>,
        /// gamma.
        pub elastic: f64,
        /// What makes the block's energy go on without a jump where H and gamma change, J: with it, the energy is the
        /// work done on the points, stored or lost.
        pub offset: f64,
        /// Pi, then h_i, of each point at the last commit, Pa.
        stress: Vec<Symmetric>,
        sums: Sums,
    }
}

/// Integrals over the block at the last commit.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sums {
    /// V W, and V J^-2/3 h_i : C / 2, J.
    elastic: f64,
    held: [f64; MOST_TERMS],
    /// Work done on the points so far, less the volumetric part, J.
    work: f64,
    /// V |g_inf Pi + sum h_i|^2 and V |h_i|^2, Pa^2 m^3.
    pub total: f64,
    pub terms: [f64; MOST_TERMS],
}

impl Memory {
    /// One point within an increment.
    #[cfg(test)]
    pub fn holding(held: Symmetric, elastic: f64) -> Self {
        Self { held: vec![held], elastic, ..Self::default() }
    }

    /// Memory of so many slots; none for an elastic material.
    #[must_use]
    pub fn new(prony: &Prony, slots: usize) -> Self {
        if prony.is_empty() {
            return Self::default();
        }
        let stress = vec![ZERO; (1 + prony.len()) * slots];
        Self { held: vec![ZERO; slots], elastic: 1.0, offset: 0.0, stress, sums: Sums::default() }
    }

    /// Integrals at the last commit.
    #[must_use]
    pub fn sums(&self) -> &Sums {
        &self.sums
    }
}

impl Memory {
    /// Fixes H and gamma for an increment of `dt` seconds from the last commit.
    pub(super) fn begin(&mut self, series: &Prony, dt: f64) {
        let increment = series.increment(dt);
        for (held, history) in self.held.iter_mut().zip(self.stress.chunks_exact(1 + series.len())) {
            *held = ZERO;
            for i in 0..series.len() {
                for k in 0..6 {
                    held[k] += increment.decay[i] * history[1 + i][k] - increment.ramp[i] * history[0][k];
                }
            }
        }
        self.elastic = increment.elastic;
        // Pi : C = 0 at the deformation of the commit, so the old Pi adds nothing here
        let held: f64 = (0..series.len()).map(|i| increment.decay[i] * self.sums.held[i]).sum();
        self.offset = self.sums.work - increment.elastic * self.sums.elastic - held;
    }

    /// Takes the deformation of the block's last evaluation into the history, `dt` seconds after the commit before.
    pub(super) fn commit<T: Real>(
        &mut self,
        block: &Block<T>,
        active: &[Lanes<T>],
        scratch: &BlockScratch<T>,
        law: &Law,
        dt: f64,
    ) {
        let series = &law.prony;
        let increment = series.increment(dt);
        let long_term = series.long_term_share();
        let mut sums = Sums { work: self.offset, ..Sums::default() };
        for (slot, history) in self.stress.chunks_exact_mut(1 + series.len()).enumerate() {
            let volume = active[slot / LANES].0[slot % LANES].get() * block.volume_in(slot);
            let f = scratch.deformation_in(slot);
            let cof = cofactor(&f);
            let j = determinant(&f, &cof);
            let c = unimodular(&f, j);
            let (w, stress) = law.distortion(&f, &cof, j);
            let new = reference_stress(&cof, j, &stress);
            let mut total = new.map(|x| long_term * x);
            for i in 0..series.len() {
                let old = history[0];
                let h = &mut history[1 + i];
                for k in 0..6 {
                    h[k] = increment.decay[i] * h[k] + increment.ramp[i] * (new[k] - old[k]);
                    total[k] += h[k];
                }
                sums.held[i] += 0.5 * volume * contract(h, &c);
                sums.terms[i] += volume * contract(h, h);
            }
            history[0] = new;
            sums.elastic += volume * w;
            sums.total += volume * contract(&total, &total);
            sums.work += volume * (self.elastic * w + 0.5 * contract(&self.held[slot], &c));
        }
        self.sums = sums;
    }
}
