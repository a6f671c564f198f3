//! The projection of the dilation: sums of V_a (J_a - 1) to coarse nodes, their pressure, and that back at the nodes (see
//! [`super::dilatation`]).

use crate::approximation::ShapeTable;
use crate::material::Volumetric;
use crate::number::{Loop, Real, run};
use crate::shares::Shares;

use super::dilatation::Dilatation;
use super::disjoint::{Chunks, Each, NODES_PER_CHUNK, Offsets, Runs};
use super::mixed::{self, Coarse};
use super::points::Constants;
use super::pool::Pool;
use super::strip::{FIELDS, Strip, StripScratch};

/// Coarse nodes per part of a phase over them; under Miri so few that a tiny model has several parts.
const COARSE_PER_CHUNK: usize = if cfg!(miri) { 4 } else { 64 };

#[derive(Debug)]
pub(super) struct Projection<T> {
    /// N_aP, [`NODES_PER_CHUNK`] nodes each; none with the pointwise volume ratio.
    pub strips: Vec<Strip<T>>,
    /// Where the sums of each strip begin.
    pub runs: Offsets,
    shares: Shares,
    /// V_P, m^3.
    pub volume: Vec<f64>,
    /// Region of each coarse node.
    pub region: Vec<u8>,
}

/// Scratch memory of a projection; the second field is there where the law is [mixed](super::mixed).
#[derive(Debug)]
pub(super) struct ProjectionScratch<T> {
    strips: Vec<StripScratch<T>>,
    /// Sums of the strips to each of their coarse nodes, strip after strip, of V_a (J_a - 1) and V_a (I1 - 3)_a, m^3.
    sums: [Vec<T>; FIELDS],
    /// Pressure of volume (kappa - kappa_s) u'(J_P), or q + mu, Pa; and r - 1.
    coarse: [Vec<T>; FIELDS],
    /// The same at the nodes; whole groups of lanes.
    nodal: [Vec<T>; FIELDS],
    /// Energy density of the coarse nodes whose law is mixed, J/m^3.
    energy: Vec<f64>,
}

impl<T: Real> Projection<T> {
    pub(super) fn new(dilatation: &Dilatation, table: &ShapeTable, cells: &[[u32; 4]], nodes: usize) -> Self {
        let entries = |a: usize| {
            let (coarse, value) = dilatation.of_node(a);
            coarse.iter().copied().zip(value.iter().copied())
        };
        let mut volume = vec![0.0; dilatation.count];
        let corners = table.form.corners();
        let share = 1.0 / corners as f64;
        for (p, v) in table.volume.iter().enumerate() {
            for n in &cells[table.cell[p] as usize][..corners] {
                entries(*n as usize).for_each(|(coarse, value)| volume[coarse as usize] += share * v * value);
            }
        }
        let strips: Vec<Strip<T>> = if dilatation.count > 0 {
            let range = |first: usize| first..(first + NODES_PER_CHUNK).min(nodes);
            (0..nodes).step_by(NODES_PER_CHUNK).map(|first| Strip::new(range(first), entries)).collect()
        } else {
            Vec::new()
        };
        Self {
            runs: Offsets::of(strips.iter().map(|s| s.coarse.len())),
            shares: Shares::of(strips.iter().map(|s| s.coarse.as_slice()), dilatation.count),
            volume,
            region: dilatation.region.clone(),
            strips,
        }
    }

    pub(super) fn scratch(&self, mixed: bool) -> ProjectionScratch<T> {
        let coarse = self.volume.len();
        let fields = |of: usize| [true, mixed].map(|there| vec![T::default(); if there { of } else { 0 }]);
        ProjectionScratch {
            strips: self.strips.iter().map(StripScratch::new).collect(),
            sums: fields(self.runs.total()),
            coarse: fields(coarse),
            nodal: fields(self.strips.len() * NODES_PER_CHUNK),
            energy: vec![0.0; if mixed { coarse } else { 0 }],
        }
    }

    /// Energy of the projected dilations at the last evaluation, and of the distortions that see them, J.
    pub(super) fn energy(&self, scratch: &ProjectionScratch<T>, constants: &[Constants]) -> f64 {
        let density = |i: usize| match &constants[usize::from(self.region[i])] {
            Constants { mixed: true, .. } => scratch.energy[i],
            Constants { projected: kappa, law, .. } if *kappa > 0.0 => {
                kappa * law.volumetric.energy(law.volumetric.dilation(scratch.coarse[0][i].get() / kappa))
            }
            _ => 0.0,
        };
        self.volume.iter().enumerate().map(|(i, v)| v * density(i)).sum()
    }

    /// Pressure at the nodes, Pa, from V_a (J_a - 1) of each, m^3.
    pub(super) fn project<'s>(
        &self,
        scratch: &'s mut ProjectionScratch<T>,
        pool: &mut Pool,
        constants: &[Constants],
        dilation: impl Fn(usize) -> T + Sync,
    ) -> [&'s [T]; FIELDS] {
        let sums = (Each::new(&mut scratch.strips), Runs::new(&mut scratch.sums[0], &self.runs));
        pool.each(sums, |s, (scratch, out)| run(ToCoarse(&self.strips[s], scratch, |n| [dilation(n)], [out])));
        let sums = &scratch.sums[0];
        pool.each(Chunks::new(&mut scratch.coarse[0], COARSE_PER_CHUNK), |i, out| {
            for (out, coarse) in out.iter_mut().zip(i * COARSE_PER_CHUNK..) {
                let constants = &constants[usize::from(self.region[coarse])];
                *out = T::of(pressure(constants, self.sum(sums, coarse), self.volume[coarse]));
            }
        });
        let coarse = &scratch.coarse[0];
        let nodal = (Each::new(&mut scratch.strips), Chunks::new(&mut scratch.nodal[0], NODES_PER_CHUNK));
        pool.each(nodal, |s, (scratch, out)| run(ToNodes(&self.strips[s], scratch, [coarse], [out])));
        [&scratch.nodal[0], &[]]
    }

    /// Pressure and r - 1 at the nodes where the law is [mixed](super::mixed), from V_a (J_a - 1) and V_a (I1 - 3)_a of each, m^3.
    pub(super) fn project_mixed<'s>(
        &self,
        scratch: &'s mut ProjectionScratch<T>,
        pool: &mut Pool,
        constants: &[Constants],
        of_node: impl Fn(usize) -> [T; FIELDS] + Sync,
    ) -> [&'s [T]; FIELDS] {
        let [dilation, square] = &mut scratch.sums;
        let sums = (Runs::new(dilation, &self.runs), Runs::new(square, &self.runs));
        let sums = (Each::new(&mut scratch.strips), sums);
        pool.each(sums, |s, (scratch, (a, b))| run(ToCoarse(&self.strips[s], scratch, &of_node, [a, b])));
        let [dilation, square] = &scratch.sums;
        let [p, r] = scratch.coarse.each_mut().map(|out| Chunks::new(out, COARSE_PER_CHUNK));
        let out = (Chunks::new(&mut scratch.energy, COARSE_PER_CHUNK), (p, r));
        pool.each(out, |i, (energy, (p, r))| {
            for (k, coarse) in (0..energy.len()).zip(i * COARSE_PER_CHUNK..) {
                let constants = &constants[usize::from(self.region[coarse])];
                let sums = [self.sum(dilation, coarse), self.sum(square, coarse)];
                let found = mixed_state(constants, sums, self.volume[coarse]);
                (p[k], r[k], energy[k]) = (T::of(found.pressure), T::of(found.shrinkage), found.energy);
            }
        });
        let [p, r] = scratch.coarse.each_ref().map(Vec::as_slice);
        let [nodal_p, nodal_r] = scratch.nodal.each_mut().map(|out| Chunks::new(out, NODES_PER_CHUNK));
        let nodal = (Each::new(&mut scratch.strips), (nodal_p, nodal_r));
        pool.each(nodal, |s, (scratch, (a, b))| run(ToNodes(&self.strips[s], scratch, [p, r], [a, b])));
        scratch.nodal.each_ref().map(Vec::as_slice)
    }

    /// Positions of a coarse node's sums.
    pub(super) fn sums_of(&self, coarse: usize) -> &[u32] {
        self.shares.of_index(coarse)
    }

    /// Of the strips' sums to a coarse node.
    fn sum(&self, sums: &[T], coarse: usize) -> f64 {
        self.shares.of_index(coarse).iter().map(|&at| sums[at as usize].get()).sum()
    }
}

/// What a coarse node hands on, from its sums and V_P, m^3.
fn mixed_state(constants: &Constants, [dilation, square]: [f64; 2], volume: f64) -> Coarse<f64> {
    let p = pressure(constants, dilation, volume);
    if volume <= 0.0 || !constants.mixed {
        return Coarse { pressure: p, ..Coarse::default() };
    }
    let (kappa, dilation) = (constants.projected, dilation / volume);
    let found = mixed::coarse(constants.law.shear_modulus(), p, dilation, square / volume);
    Coarse { energy: found.energy + kappa * constants.law.volumetric.energy(dilation), ..found }
}

/// (kappa - kappa_s) u'(J_P), Pa, from the sum of V_a N_aP (J_a - 1) and V_P, m^3.
fn pressure(constants: &Constants, sum: f64, volume: f64) -> f64 {
    let (kappa, dilation) = (constants.projected, sum / volume);
    match constants.law.volumetric {
        _ if volume <= 0.0 => 0.0,
        Volumetric::Quadratic => kappa * dilation,
        other => kappa * other.slope(dilation),
    }
}

/// The fields of one strip's nodes, to its coarse nodes.
struct ToCoarse<'a, T: Real, X, const N: usize>(&'a Strip<T>, &'a mut StripScratch<T>, X, [&'a mut [T]; N]);

impl<T: Real, X: Fn(usize) -> [T; N], const N: usize> Loop for ToCoarse<'_, T, X, N> {
    #[inline(always)]
    fn go(self) {
        self.0.sum_to_coarse(self.1, self.2, self.3);
    }
}

/// What the coarse nodes hand on, to one strip's nodes.
struct ToNodes<'a, T: Real, const N: usize>(&'a Strip<T>, &'a mut StripScratch<T>, [&'a [T]; N], [&'a mut [T]; N]);

impl<T: Real, const N: usize> Loop for ToNodes<'_, T, N> {
    #[inline(always)]
    fn go(self) {
        self.0.hand_to_nodes(self.1, self.2, self.3);
    }
}
