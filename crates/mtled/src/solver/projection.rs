//! The projection of the dilation: sums of V_a (J_a - 1) to coarse nodes, their pressure, and that back at the nodes (see
//! [`super::dilatation`]).

use crate::approximation::ShapeTable;
use crate::material::Volumetric;
use crate::number::Real;
use crate::number::lanes::{Loop, run};

use super::block::Shares;
use super::dilatation::Dilatation;
use super::disjoint::{Chunks, Each, Offsets, Runs};
use super::kernel::NODES_PER_CHUNK;
use super::points::Constants;
use super::pool::Pool;
use super::strip::{Strip, StripScratch};

/// Coarse nodes per part of a phase over them; under Miri so few that a tiny model has several parts.
const COARSE_PER_CHUNK: usize = if cfg!(miri) { 4 } else { 64 };

/// The projection of the dilation.
#[derive(Debug)]
pub(super) struct Projection<T> {
    /// N_aP, [`NODES_PER_CHUNK`] nodes each; none with the pointwise volume ratio.
    strips: Vec<Strip<T>>,
    /// Where the sums of each strip begin.
    runs: Offsets,
    shares: Shares,
    /// V_P, m^3.
    volume: Vec<f64>,
    /// Region of each coarse node.
    region: Vec<u8>,
}

/// Scratch memory of a projection.
#[derive(Debug)]
pub(super) struct ProjectionScratch<T> {
    strips: Vec<StripScratch<T>>,
    /// Sums of the strips to each of their coarse nodes, strip after strip, m^3.
    sums: Vec<T>,
    /// (kappa - kappa_s) u'(J_P), Pa.
    coarse: Vec<T>,
    /// The same at the nodes, Pa; whole groups of lanes.
    nodal: Vec<T>,
}

impl<T: Real> Projection<T> {
    pub fn new(dilatation: &Dilatation, table: &ShapeTable, cells: &[[u32; 4]], nodes: usize) -> Self {
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
            runs: Offsets::of(strips.iter().map(|s| s.coarse().len())),
            shares: Shares::of(strips.iter().map(Strip::coarse), dilatation.count),
            volume,
            region: dilatation.region.clone(),
            strips,
        }
    }

    /// Scratch memory.
    pub fn scratch(&self) -> ProjectionScratch<T> {
        ProjectionScratch {
            strips: self.strips.iter().map(StripScratch::new).collect(),
            sums: vec![T::default(); self.runs.total()],
            coarse: vec![T::default(); self.volume.len()],
            nodal: vec![T::default(); self.strips.len() * NODES_PER_CHUNK],
        }
    }

    /// Energy of the projected dilations at the last evaluation, J.
    pub fn energy(&self, scratch: &ProjectionScratch<T>, constants: &[Constants]) -> f64 {
        let density = |p: f64, region: u8| match &constants[usize::from(region)] {
            Constants { projected: kappa, law, .. } if *kappa > 0.0 => {
                kappa * law.volumetric.energy(law.volumetric.dilation(p / kappa))
            }
            _ => 0.0,
        };
        let coarse = scratch.coarse.iter().zip(&self.region).zip(&self.volume);
        coarse.map(|((p, region), v)| v * density(p.get(), *region)).sum()
    }

    /// Pressure at the nodes, Pa, from V_a (J_a - 1) of each, m^3.
    pub fn project<'s>(
        &self,
        scratch: &'s mut ProjectionScratch<T>,
        pool: &mut Pool,
        constants: &[Constants],
        dilation: impl Fn(usize) -> T + Sync,
    ) -> &'s [T] {
        let sums = (Each::new(&mut scratch.strips), Runs::new(&mut scratch.sums, &self.runs));
        pool.each(sums, |s, (scratch, out)| run(ToCoarse(&self.strips[s], scratch, &dilation, out)));
        let sums = &scratch.sums;
        pool.each(Chunks::new(&mut scratch.coarse, COARSE_PER_CHUNK), |i, out| {
            for (out, coarse) in out.iter_mut().zip(i * COARSE_PER_CHUNK..) {
                let sum: f64 = self.shares.of_index(coarse).iter().map(|&at| sums[at as usize].get()).sum();
                let constants = &constants[usize::from(self.region[coarse])];
                *out = pressure(constants, sum, self.volume[coarse]);
            }
        });
        let coarse = &scratch.coarse;
        let nodal = (Each::new(&mut scratch.strips), Chunks::new(&mut scratch.nodal, NODES_PER_CHUNK));
        pool.each(nodal, |s, (scratch, out)| run(ToNodes(&self.strips[s], scratch, coarse, out)));
        &scratch.nodal
    }
}

/// (kappa - kappa_s) u'(J_P), Pa, from the sum of V_a N_aP (J_a - 1) and V_P, m^3.
fn pressure<T: Real>(constants: &Constants, sum: f64, volume: f64) -> T {
    let (kappa, dilation) = (constants.projected, sum / volume);
    T::of(match constants.law.volumetric {
        _ if volume <= 0.0 => 0.0,
        Volumetric::Quadratic => kappa * dilation,
        other => kappa * other.slope(dilation),
    })
}

/// The dilations of one strip's nodes, to its coarse nodes.
struct ToCoarse<'a, T: Real, D>(&'a Strip<T>, &'a mut StripScratch<T>, &'a D, &'a mut [T]);

impl<T: Real, D: Fn(usize) -> T> Loop for ToCoarse<'_, T, D> {
    #[inline(always)]
    fn go(self) {
        self.0.sum_to_coarse(self.1, self.2, self.3);
    }
}

/// The coarse pressures to one strip's nodes.
struct ToNodes<'a, T: Real>(&'a Strip<T>, &'a mut StripScratch<T>, &'a [T], &'a mut [T]);

impl<T: Real> Loop for ToNodes<'_, T> {
    #[inline(always)]
    fn go(self) {
        self.0.hand_to_nodes(self.1, self.2, self.3);
    }
}
