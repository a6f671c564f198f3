//! Error of the discretisation by recovered gradients.
//!
//! ```text
//! F*_a  = sum_p V_p F_p / sum_p V_p                over the points p of the cells of node a and the region of p
//! F*_p  = mean of F*_a over the corners a of p's cell
//! eta^2 = sum_p W_p |F_p - F*_p|^2 / |F_p - I|^2 / sum_p W_p
//! ```
//!
//! W_p: strain energy that stands in a point, J; |A|^2 = A : A. Averages of the gradient over the cells round a node are closer to the true
//! one than the gradient in a cell (Zienkiewicz and Zhu, Int. J. Numer. Meth. Engng 24:337, 1987), so eta^2 is the share of the energy
//! that stands in what the cloud can't follow. An instrument whose place is prescribed makes of that a share of its force: the energy is
//! half of force times displacement.
//!
//! A mean that is taken twice smooths: for the smooth field of a captured path it finds more than there is, at a singular edge less. So the
//! force's error is eta^2 times an effectivity ([`CAPTURED`], [`SLIPPING`], [`PRESSED`]) that was measured against fine clouds.
//!
//! It costs two passes over the points, so it is looked at from time to time ([`is_due`]).

use crate::scene::{Instrument, InstrumentKind, Interaction, Method, Scene};
use mtled::solver::Solver;

use super::regions;
use super::tissue::Tissue;

/// Explicit steps between two looks in the long run: less than 1 % of the time of those steps (0.3 ms at 2800 points of the half plane).
const LOOK: u64 = 2048;
/// |F - I|^2 below which a point is at rest.
const REST: f64 = 1e-12;

/// Whether the error is to be looked at after a pose that led from one number of steps to another: at first at each doubling, since a twin
/// that enters changes most then.
pub(super) fn is_due(before: u64, steps: u64) -> bool {
    let doubled = steps < LOOK && (before == 0 || steps.ilog2() > before.ilog2());
    steps > before && (doubled || steps / LOOK > before / LOOK)
}

/// Sums at the nodes: memory that is there before the first step.
#[derive(Clone, Debug)]
pub(super) struct Recovered {
    /// V F and V of each node.
    sums: Vec<([f64; 9], f64)>,
    /// Region of each point.
    region: Vec<u8>,
    regions: u8,
}

impl Recovered {
    pub(crate) fn new(scene: &Scene, tissue: &Tissue, top: f64) -> Self {
        let region: Vec<u8> =
            (0..tissue.model.volume.len()).map(|p| regions::at(scene, top, tissue.place(p))).collect();
        let regions = region.iter().copied().max().unwrap_or(0);
        Self { sums: vec![([0.0; 9], 0.0); tissue.model.nodes], region, regions }
    }

    /// eta^2.
    pub(super) fn share(&mut self, tissue: &Tissue, solver: &Solver) -> f64 {
        let model = &tissue.model;
        let (mut error, mut energy) = (0.0, 0.0);
        for region in 0..=self.regions {
            let points = || (0..model.volume.len()).filter(|&p| self.region[p] == region);
            self.sums.fill(([0.0; 9], 0.0));
            for p in points() {
                let (f, volume) = (solver.deformation(p), model.volume[p]);
                for &n in tissue.corners(p) {
                    let (sum, weight) = &mut self.sums[n as usize];
                    (0..9).for_each(|k| sum[k] += volume * f[k]);
                    *weight += volume;
                }
            }
            for p in points() {
                let f = solver.deformation(p);
                let corners = tissue.corners(p);
                let mut left = f;
                for &n in corners {
                    let (sum, weight) = &self.sums[n as usize];
                    (0..9).for_each(|k| left[k] -= sum[k] / (weight * corners.len() as f64));
                }
                let square = |a: &[f64; 9]| a.iter().map(|x| x * x).sum::<f64>();
                let strain = square(&std::array::from_fn(|k| f[k] - f64::from(u8::from(k % 4 == 0))));
                let w = solver.energy_of(p);
                if strain > REST && w > 0.0 {
                    energy += w;
                    error += w * (square(&left) / strain).min(1.0);
                }
            }
        }
        if energy > 0.0 { error / energy } else { 0.0 }
    }
}

/// Error of the force over eta^2 of what a needle captures: smooth, but for its tip.
const CAPTURED: f64 = 0.3;
/// The same of a needle whose tissue sticks and slips.
const SLIPPING: f64 = 0.75;
/// The same under a plate or an indenter, whose edge is singular.
const PRESSED: f64 = 2.0;
/// The same of linear tetrahedra, whose gradients are constant in a cell, over that of moving least squares.
const LINEAR: f64 = 2.0;

/// Error of the force over eta^2, such that 95 of 100 poses are covered: measured, see `docs/lab/model_error.md`.
pub(super) fn effectivity(scene: &Scene) -> f64 {
    let method = if scene.discretisation.method == Method::Tet4 { LINEAR } else { 1.0 };
    method
        * match &scene.instrument {
            Some(Instrument { kind: InstrumentKind::Needle(_), interaction: Interaction::Kinematic, .. }) => CAPTURED,
            Some(Instrument { kind: InstrumentKind::Needle(_), .. }) => SLIPPING,
            _ => PRESSED,
        }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::scene::Override;
    use crate::twin::{StampedPose, Twin};

    /// eta^2 after a plate has gone down by a tenth of the height, in poses of half a per cent of it.
    fn of(keys: &[(&str, &str)]) -> f64 {
        let keys: Vec<_> = keys.iter().map(|(path, value)| Override::text(path, value, "test")).collect();
        let mut twin = Twin::new(&Scene::preset("compression").unwrap().with(&keys).unwrap()).unwrap();
        for k in 1..=20 {
            let pose = twin.pose_at_depth(8.5e-5 * f64::from(k));
            for _ in 0..40 {
                twin.step(StampedPose { time_s: 0.0, pose }).unwrap();
            }
        }
        twin.recovered.share(&twin.fixed.tissue, &twin.solver)
    }

    #[test]
    fn a_homogeneous_field_is_resolved_and_a_bonded_one_the_better_the_finer_the_cloud() {
        let smooth = of(&[("instrument.contact", "frictionless"), ("sample.base", "frictionless")]);
        let [coarse, fine] = ["0.002", "0.0007"].map(|spacing| of(&[("discretisation.spacing_m", spacing)]));
        println!("homogeneous {smooth:.2e}, bonded {coarse:.2e} and {fine:.2e}");
        assert!(smooth < 0.2 * fine && coarse > 1e-3 && fine < 0.6 * coarse, "{smooth} {coarse} {fine}");
    }

    #[test]
    fn looks_become_rare() {
        let poses = |steps: u64| (0..40_000 / steps).filter(|k| is_due(k * steps, (k + 1) * steps)).count();
        assert_eq!((poses(1), poses(8), poses(5000)), (11 + 19, 8 + 19, 8));
        assert!(is_due(0, 1) && !is_due(7, 7) && !is_due(5, 7) && is_due(7, 8));
    }
}
