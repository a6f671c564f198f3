//! Projected dilatation: the cure for volumetric locking.
//!
//! One pressure per integration point, or per node, ties down more modes of the displacement than the field has to
//! spare, and the tissue locks as nu tends to 0.5. Here the pressure lives on a coarser cloud, every second node or
//! so, as in a Taylor-Hood element; between coarse nodes it is approximated by moving least squares N_aP:
//!
//! ```text
//! J_a = sum_g V_g J_g / (4 V_a)        over the integration points of the cells of node a (3 V_a for triangles)
//! J_P = sum_a V_a N_aP J_a / V_P       V_P = sum_a V_a N_aP
//! W_vol = sum_P V_P (kappa - kappa_s) u(J_P) + sum_g V_g kappa_s w(J_g),     w(J) = (J - 1)^2 / 2 (1 + (J_0/J)^4)
//! p_g = mean over the cell's corners a of sum_P N_aP (kappa - kappa_s) u'(J_P)  +  kappa_s w'(J_g)
//! ```
//!
//! with kappa u the volumetric energy, (J - 1)^2 / 2 or another (see [`crate::material::volumetric`]).
//!
//! kappa_s, a few shear moduli, keeps the volume ratio of single points in check: modes that the coarse pressure does
//! not see would otherwise resist by shear alone. It does not grow with kappa, so it does not lock either. The term
//! with J_0 = 0.4 keeps single points from collapsing at a singular edge, where the coarse pressure does not see them:
//! it costs 0.3% of the force of an indentation of 4 mm, and without it that scene's motion ends at 7.1 of its 10 mm.

use std::collections::{BTreeMap, BTreeSet};

use rayon::prelude::*;

use crate::approximation::Form;
use crate::approximation::axisymmetric::in_half_plane;
use crate::approximation::mirrored::MirroredSupports;
use crate::approximation::mls::{Basis, Fit, Neighbour};
use crate::approximation::support::{distance, radii};
use crate::cloud::quality::six_volumes;
use crate::grid::Grid;
use crate::mirror::Mirror;
use crate::vector::bounds;

/// Distance between coarse nodes over the spacing of the cloud there.
pub(super) const COARSENING: f64 = 1.5;
/// Support radius of a coarse node over the distance to the next.
const REACH: f64 = 2.0;
/// Reach in spacings beyond which a linear fit is given up.
const WIDEST: f64 = 20.0;
/// The same where there are several regions: a thin layer has its coarse nodes in one plane, and its pressure hardly changes
/// across it.
const WIDEST_OF_SEVERAL: f64 = 6.0;
/// Least share of what the fits say of a coarse node's volume without their signs that is left with them. Where a thin layer has its coarse
/// nodes in two planes, fits that reach beyond both make it next to nothing or negative, and the pressure there boundless.
const AGREED: f64 = 0.25;
/// kappa_s / mu, with the initial, instantaneous mu.
pub(super) const POINTWISE_BULK: f64 = 3.0;

/// N_aP by node: coarse indices and values.
#[derive(Clone, Debug, Default)]
pub(super) struct Dilatation {
    /// Offsets, one more than nodes.
    pub start: Vec<u32>,
    /// Coarse index.
    pub coarse: Vec<u32>,
    /// N_aP.
    pub value: Vec<f64>,
    /// Number of coarse nodes.
    pub count: usize,
    /// Region of each coarse node.
    pub region: Vec<u8>,
}

impl Dilatation {
    /// Chooses coarse nodes greedily (deterministic) and fits N_aP: those that several regions share first, so that what is
    /// chosen in a region depends neither on the others nor on their order, then in node order. `region` of each point: no fit reaches
    /// from one to another.
    pub(super) fn projected(points: &[[f64; 3]], cells: &[[u32; 4]], region: &[u8], form: Form) -> Self {
        let spacing = match form {
            Form::Full | Form::Mirrored(_) => radii(points, cells, 1.0),
            Form::Axisymmetric => {
                let triangles: Vec<[u32; 3]> = cells.iter().map(|&[a, b, c, _]| [a, b, c]).collect();
                radii(points, &triangles, 1.0)
            }
        };
        let mut coarse = coarse_nodes(points, &spacing, region, form.mirror(), &interfaces_first(points, region));
        // In a half plane no volume is negative; without the worst nodes the force on a thin skin would be 2.9 % larger there.
        let thin = form != Form::Axisymmetric && region.iter().any(|r| *r != region[0]);
        let volume = if thin { corner_volumes(points, cells) } else { Vec::new() };
        loop {
            let fitted = Self::fitted(points, &spacing, region, form, &coarse);
            let sound = fitted.sound(&volume);
            let kept: Vec<u32> = coarse.iter().zip(sound).filter(|(_, sound)| *sound).map(|(c, _)| *c).collect();
            let regions = |coarse: &[u32]| coarse.iter().map(|&c| region[c as usize]).collect::<BTreeSet<u8>>();
            if !thin || kept.len() == coarse.len() || regions(&kept) != regions(&coarse) {
                return fitted;
            }
            coarse = kept;
        }
    }

    /// The fits of the nodes through given coarse ones.
    fn fitted(points: &[[f64; 3]], spacing: &[f64], region: &[u8], form: Form, coarse: &[u32]) -> Self {
        let at: Vec<[f64; 3]> = coarse.iter().map(|&c| points[c as usize]).collect();
        let region_of_coarse: Vec<u8> = coarse.iter().map(|&c| region[c as usize]).collect();
        let mut rows: Vec<Option<Row>> = vec![None; points.len()];
        let mut reach = REACH * COARSENING;
        let widest = if region.iter().any(|r| *r != region[0]) { WIDEST_OF_SEVERAL } else { WIDEST };
        while rows.iter().any(Option::is_none) {
            let reaches: Vec<f64> = coarse.iter().map(|&c| reach * spacing[c as usize]).collect();
            let supports = Nodes::new(&at, &reaches, form);
            // A sample smaller than a few coarse spacings determines no linear fit: the mean keeps the partition of unity.
            let last = reach > widest;
            rows.par_iter_mut()
                .zip(points.par_iter().zip(region))
                .filter(|(row, _)| row.is_none())
                .for_each(|(row, (&x, &own))| *row = fit(&supports, x, last, |c| region_of_coarse[c as usize] == own));
            reach *= 1.3;
        }
        let mut d = Self { start: vec![0], count: coarse.len(), region: region_of_coarse, ..Self::default() };
        for (n, v) in rows.into_iter().flatten() {
            d.coarse.extend(n);
            d.value.extend(v);
            d.start.push(d.coarse.len() as u32);
        }
        d
    }

    /// Whether each coarse node has a volume V_P that its fits agree on ([`AGREED`]). `volume`: V_a, up to a factor.
    fn sound(&self, volume: &[f64]) -> Vec<bool> {
        let mut sums = vec![[0.0; 2]; self.count];
        for (a, v) in volume.iter().enumerate() {
            let (coarse, value) = self.of_node(a);
            for (&c, n) in coarse.iter().zip(value) {
                let [own, all] = &mut sums[c as usize];
                *own += v * n;
                *all += v * n.abs();
            }
        }
        sums.iter().map(|[own, all]| *own >= AGREED * all).collect()
    }

    /// One pressure per node: the average nodal volume ratio of Bonet & Burton (1998).
    pub(super) fn nodal(region: &[u8]) -> Self {
        let nodes = region.len();
        Self {
            region: region.to_vec(),
            start: (0..=nodes as u32).collect(),
            coarse: (0..nodes as u32).collect(),
            value: vec![1.0; nodes],
            count: nodes,
        }
    }

    /// Entries of node a.
    pub(super) fn of_node(&self, a: usize) -> (&[u32], &[f64]) {
        let range = self.start[a] as usize..self.start[a + 1] as usize;
        (&self.coarse[range.clone()], &self.value[range])
    }
}

type Row = (Vec<u32>, Vec<f64>);

/// The coarse nodes, with their images beyond an axis or a plane of symmetry, since pressure is even there.
struct Nodes {
    supports: MirroredSupports,
    in_plane: bool,
}

impl Nodes {
    fn new(at: &[[f64; 3]], reaches: &[f64], form: Form) -> Self {
        let weights = vec![false; at.len()];
        let supports = match form {
            Form::Full => MirroredSupports::whole(at, reaches, &weights),
            Form::Mirrored(mirror) => {
                let on_plane = mirror.holds(at);
                MirroredSupports::new(at, reaches, &weights, Some(mirror), on_plane)
            }
            Form::Axisymmetric => in_half_plane(at, reaches, &weights),
        };
        Self { supports, in_plane: form == Form::Axisymmetric }
    }

    /// Those of the nodes round x that are `wanted`, in `out`, and their linear fit if there is one.
    fn fit(&self, x: [f64; 3], out: &mut Vec<Neighbour>, wanted: impl Fn(u32) -> bool) -> Option<Vec<f64>> {
        let mut fit = Fit::default();
        self.supports.at(x, out);
        out.retain(|n| wanted(self.supports.node(n.node).0));
        let done = if self.in_plane {
            out.len() > 3 && fit.evaluate_in_plane(out, Basis::Linear, false).is_ok()
        } else {
            out.len() > 4 && fit.evaluate(out, Basis::Linear, false).is_ok()
        };
        out.iter_mut().for_each(|n| n.node = self.supports.node(n.node).0);
        done.then_some(fit.value)
    }
}

/// Linear fit of the wanted coarse nodes round x, or their weighted mean if that must do.
fn fit(supports: &Nodes, x: [f64; 3], mean: bool, wanted: impl Fn(u32) -> bool) -> Option<Row> {
    let mut neighbours = Vec::new();
    let fitted = supports.fit(x, &mut neighbours, wanted);
    let nodes = || neighbours.iter().map(|n| n.node).collect();
    if let Some(value) = fitted {
        return Some((nodes(), value));
    }
    let total: f64 = neighbours.iter().map(|n| n.weight.0).sum();
    (mean && total > 0.0).then(|| (nodes(), neighbours.iter().map(|n| n.weight.0 / total).collect()))
}

/// Volumes of the cells of each node, up to a factor for all.
fn corner_volumes(points: &[[f64; 3]], cells: &[[u32; 4]]) -> Vec<f64> {
    let mut volume = vec![0.0; points.len()];
    for cell in cells {
        let own = six_volumes(&cell.map(|n| points[n as usize]));
        cell.iter().for_each(|&n| volume[n as usize] += own.abs());
    }
    volume
}

/// All nodes, those at whose place there is one of another region first; in one region the nodes' own order.
fn interfaces_first(points: &[[f64; 3]], region: &[u8]) -> Vec<u32> {
    let mut order: Vec<u32> = (0..points.len() as u32).collect();
    if region.iter().any(|r| *r != region[0]) {
        let place = |i: u32| points[i as usize].map(f64::to_bits);
        let mut at: BTreeMap<[u64; 3], u32> = BTreeMap::new();
        order.iter().for_each(|&i| *at.entry(place(i)).or_default() += 1);
        order.sort_by_key(|&i| at.get(&place(i)) == Some(&1));
    }
    order
}

/// Greedy choice in this order: a node is coarse if no coarse node of its region lies within [`COARSENING`] spacings, nor its own
/// image. By index, as neighbours are near in memory.
fn coarse_nodes(
    points: &[[f64; 3]],
    spacing: &[f64],
    region: &[u8],
    mirror: Option<Mirror>,
    order: &[u32],
) -> Vec<u32> {
    let mut sorted = spacing.to_vec();
    sorted.sort_by(f64::total_cmp);
    let size = COARSENING * sorted.get(sorted.len() / 2).copied().unwrap_or(1.0);
    let [low, high] = bounds(points);
    let widest = (0..3).map(|k| high[k] - low[k]).fold(0.0, f64::max);
    let mut grid = Grid::of_cells(low, high, size.max(widest / 200.0).max(f64::MIN_POSITIVE));
    let (mut coarse, mut at): (Vec<u32>, Vec<[f64; 3]>) = (Vec::new(), Vec::new());
    let on_plane = mirror.map_or_else(Vec::new, |m| m.holds(points));
    for (i, x) in order.iter().map(|&i| (i as usize, points[i as usize])) {
        let reach = COARSENING * spacing[i];
        if mirror.is_some_and(|m| !on_plane[i] && 2.0 * m.across(&x) < reach) {
            continue;
        }
        let near = |j: u32, _| {
            let own = COARSENING * spacing[coarse[j as usize] as usize];
            region[coarse[j as usize] as usize] == region[i] && distance(x, at[j as usize]) < reach.min(own)
        };
        // a little farther, so that `near` decides to the last bit
        if !grid.any(&at, x, reach * (1.0 + 1e-9), near) {
            grid.push(x);
            coarse.push(i as u32);
            at.push(x);
        }
    }
    coarse.sort_unstable();
    coarse
}
