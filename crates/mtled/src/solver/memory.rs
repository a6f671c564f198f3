//! What the integration points of a relaxing material remember (see [`crate::material::prony`]).
//!
//! Pseudo time of the explicit steps is numerical, so the memory moves in the poses' own time: [`Block::begin`] fixes
//! H and gamma for the increment that ends at a pose, any number of steps finds the balance, [`Block::commit`] takes
//! the deformation that was found into the history.

use crate::material::neo_hookean::{cofactor, determinant};
use crate::material::ogden::Symmetric;
use crate::material::prony::{MOST_TERMS, contract, reference_stress, unimodular};
use crate::material::{Law, Prony};

use super::block::Block;
use crate::number::Real;

const ZERO: Symmetric = [0.0; 6];

/// Memory of one block; empty for a material that does not relax.
#[derive(Clone, Debug, Default)]
pub struct Memory {
    /// H of each slot, Pa.
    pub held: Vec<Symmetric>,
    /// gamma.
    pub elastic: f64,
    /// What makes the block's energy go on without a jump where H and gamma change, J: with it, the energy is the work
    /// done on the points, stored or lost.
    pub offset: f64,
    now: History,
    saved: History,
}

#[derive(Clone, Debug, Default)]
struct History {
    /// Pi, then h_i, of each point, Pa.
    stress: Vec<Symmetric>,
    sums: Sums,
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
        let history = History { stress: vec![ZERO; (1 + prony.len()) * slots], sums: Sums::default() };
        Self { held: vec![ZERO; slots], elastic: 1.0, offset: 0.0, saved: history.clone(), now: history }
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.held.fill(ZERO);
        (self.elastic, self.offset) = (1.0, 0.0);
        for history in [&mut self.now, &mut self.saved] {
            history.stress.fill(ZERO);
            history.sums = Sums::default();
        }
    }

    /// Takes over the memory of another block of the same points, but for what that one has kept to go back to.
    pub fn take_over(&mut self, other: &Self) {
        self.held.copy_from_slice(&other.held);
        (self.elastic, self.offset) = (other.elastic, other.offset);
        self.now.stress.copy_from_slice(&other.now.stress);
        self.now.sums = other.now.sums;
    }

    /// Keeps the history of the last commit.
    pub fn save(&mut self) {
        self.saved.stress.copy_from_slice(&self.now.stress);
        self.saved.sums = self.now.sums;
    }

    /// Back to the kept history.
    pub fn restore(&mut self) {
        self.now.stress.copy_from_slice(&self.saved.stress);
        self.now.sums = self.saved.sums;
    }

    /// Integrals at the last commit.
    #[must_use]
    pub fn sums(&self) -> &Sums {
        &self.now.sums
    }
}

impl<T: Real> Block<T> {
    /// Fixes H and gamma for an increment of `dt` seconds from the last commit.
    pub(super) fn begin(&mut self, series: &Prony, dt: f64) {
        let increment = series.increment(dt);
        let memory = &mut self.memory;
        for (held, history) in memory.held.iter_mut().zip(memory.now.stress.chunks_exact(1 + series.len())) {
            *held = ZERO;
            for i in 0..series.len() {
                for k in 0..6 {
                    held[k] += increment.decay[i] * history[1 + i][k] - increment.ramp[i] * history[0][k];
                }
            }
        }
        memory.elastic = increment.elastic;
        // Pi : C = 0 at the deformation of the commit, so the old Pi adds nothing here
        let sums = &memory.now.sums;
        let held: f64 = (0..series.len()).map(|i| increment.decay[i] * sums.held[i]).sum();
        memory.offset = sums.work - increment.elastic * sums.elastic - held;
    }

    /// Takes the deformation of the last evaluation into the history, `dt` seconds after the commit before.
    pub(super) fn commit(&mut self, law: &Law, dt: f64) {
        let series = &law.prony;
        let increment = series.increment(dt);
        let long_term = series.long_term_share();
        // taken out so that the block can be asked for its slots
        let mut memory = std::mem::take(&mut self.memory);
        let mut sums = Sums { work: memory.offset, ..Sums::default() };
        for (slot, history) in memory.now.stress.chunks_exact_mut(1 + series.len()).enumerate() {
            let volume = self.active_in(slot) * self.volume_in(slot);
            let f = self.deformation_in(slot);
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
            sums.work += volume * (memory.elastic * w + 0.5 * contract(&memory.held[slot], &c));
        }
        memory.now.sums = sums;
        self.memory = memory;
    }
}
