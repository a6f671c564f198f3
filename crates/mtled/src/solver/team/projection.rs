//! The [projection](super::super::projection) of the dilation for eight members at once, who stand in the lanes.

use super::super::mixed;
use super::super::points::Constants;
use super::super::projection::Projection;
use super::super::strip::FIELDS;
use crate::number::{LANES, Lanes, Loop, Number, Real, run};

/// Constants of the members in one region.
#[derive(Clone, Copy, Debug)]
struct Region {
    /// kappa - kappa_s, Pa.
    projected: Lanes<f64>,
    /// mu, Pa.
    shear_modulus: Lanes<f64>,
}

#[derive(Debug)]
pub(super) struct Projected<T> {
    regions: Vec<Region>,
    /// Sums of the strips, and what the coarse nodes hand on, as [`super::super::projection::ProjectionScratch`] has them; the second field is
    /// empty where the law is not [mixed](super::super::mixed).
    sums: [Vec<Lanes<T>>; FIELDS],
    coarse: [Vec<Lanes<T>>; FIELDS],
    /// Of one strip at a time: sums by lane of the groups, zero between products.
    lanes: Vec<[Lanes<T>; LANES]>,
    /// Of the last projection, J.
    pub energy: Lanes<f64>,
}

impl<T: Real> Projected<T> {
    /// For members with their constants by region; a place beyond the last has the last one's.
    pub(super) fn new(of: &Projection<T>, constants: &[Vec<Constants>], mixed: bool) -> Self {
        let last = constants.len() - 1;
        let region = |r: usize| {
            let of = |f: fn(&Constants) -> f64| Lanes(std::array::from_fn(|k| f(&constants[k.min(last)][r])));
            Region { projected: of(|c| c.projected), shear_modulus: of(|c| c.law.shear_modulus()) }
        };
        let fields = |of: usize| [true, mixed].map(|there| vec![Lanes::default(); if there { of } else { 0 }]);
        Self {
            regions: (0..constants[0].len()).map(region).collect(),
            sums: fields(of.runs.total()),
            coarse: fields(of.volume.len()),
            lanes: vec![[Lanes::default(); LANES]; of.strips.iter().map(|s| s.coarse.len()).max().unwrap_or(0)],
            energy: Lanes::default(),
        }
    }

    /// What the coarse nodes hand on, at the vertices (`out`), from what is there.
    pub(super) fn project(
        &mut self,
        of: &Projection<T>,
        at_vertices: &[Vec<Lanes<T>>; FIELDS],
        out: &mut [Vec<Lanes<T>>; FIELDS],
    ) {
        run(ToCoarse { of, at_vertices, lanes: &mut self.lanes, sums: &mut self.sums });
        run(AtCoarse { of, projected: self });
        run(ToVertices { of, coarse: &self.coarse, out });
    }
}

struct ToCoarse<'a, T: Real> {
    of: &'a Projection<T>,
    at_vertices: &'a [Vec<Lanes<T>>; FIELDS],
    lanes: &'a mut [[Lanes<T>; LANES]],
    sums: &'a mut [Vec<Lanes<T>>; FIELDS],
}

impl<T: Real> Loop for ToCoarse<'_, T> {
    #[inline(always)]
    fn go(self) {
        for (sums, x) in self.sums.iter_mut().zip(self.at_vertices).filter(|(sums, _)| !sums.is_empty()) {
            for (s, strip) in self.of.strips.iter().enumerate() {
                strip.sum_members(x, &mut self.lanes[..strip.coarse.len()], &mut sums[self.of.runs.run(s)]);
            }
        }
    }
}

struct AtCoarse<'a, T: Real> {
    of: &'a Projection<T>,
    projected: &'a mut Projected<T>,
}

impl<T: Real> Loop for AtCoarse<'_, T> {
    #[inline(always)]
    fn go(self) {
        let Self { of, projected: Projected { regions, sums: [dilation, square], coarse: [p, r], energy, .. } } = self;
        let half = Lanes::of(0.5);
        *energy = Lanes::default();
        for (coarse, (volume, region)) in of.volume.iter().zip(&of.region).enumerate() {
            if *volume <= 0.0 {
                continue;
            }
            let Region { projected, shear_modulus } = regions[usize::from(*region)];
            let sum = |sums: &[Lanes<T>]| {
                let mut all = Lanes::default();
                of.sums_of(coarse).iter().for_each(|at| all += sums[*at as usize].wide());
                all / Lanes::splat(*volume)
            };
            let mean = sum(dilation);
            let pressure = projected * mean;
            p[coarse] = Lanes::narrow(pressure);
            // each as a twin alone has it
            let density = if r.is_empty() {
                let kept = p[coarse].wide() / projected;
                (projected * (half * kept * kept)).where_positive(projected, Lanes::default())
            } else {
                let found = mixed::coarse(shear_modulus, pressure, mean, sum(square));
                (p[coarse], r[coarse]) = (Lanes::narrow(found.pressure), Lanes::narrow(found.shrinkage));
                found.energy + projected * (half * mean * mean)
            };
            *energy += Lanes::splat(*volume) * density;
        }
    }
}

struct ToVertices<'a, T: Real> {
    of: &'a Projection<T>,
    coarse: &'a [Vec<Lanes<T>>; FIELDS],
    out: &'a mut [Vec<Lanes<T>>; FIELDS],
}

impl<T: Real> Loop for ToVertices<'_, T> {
    #[inline(always)]
    fn go(self) {
        for (coarse, out) in self.coarse.iter().zip(self.out).filter(|(coarse, _)| !coarse.is_empty()) {
            self.of.strips.iter().for_each(|strip| strip.hand_to_members(coarse, out));
        }
    }
}
