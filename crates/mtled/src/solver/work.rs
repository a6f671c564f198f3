//! How much a step has to move and to compute.

use super::kernel::Kernel;
use super::model::{Model, with_kernel};
use crate::number::{LANES, Real};

/// Operations of the law at one point: cofactor and determinant in both passes (64), inverse cube root (20), invariant
/// (18), energies and pressures (30), stress (36).
const LAW_FLOPS: f64 = 168.0;

/// Work per integration point and evaluation of the internal force.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepWork {
    /// Mean number of support nodes.
    pub support_nodes: f64,
    /// Bytes that stream in and out: gradients and indices in both passes, the deformation gradient out and in.
    pub bytes: f64,
    /// Operations, a fused product counting two; lanes that have nothing to do in a visit are counted.
    pub flops: f64,
}

impl<T: Real> Kernel<T> {
    fn work(&self) -> StepWork {
        let points: usize = self.tables.blocks.iter().map(|b| b.occupied().count()).sum();
        let visits: usize = self.tables.blocks.iter().map(|b| b.local.len()).sum();
        let here = |g: &[[T::Stored; LANES]; 3], lane: usize| g.iter().any(|g| g[lane] != T::Stored::default());
        let used = |g: &[[T::Stored; LANES]; 3]| (0..LANES).filter(|&lane| here(g, lane)).count();
        let entries: usize = self.tables.blocks.iter().flat_map(|b| &b.gradient).map(used).sum();
        let (points, visits) = (points as f64, visits as f64);
        let visit = (3 * LANES * size_of::<T::Stored>() + size_of::<u16>()) as f64;
        StepWork {
            support_nodes: entries as f64 / points,
            bytes: 2.0 * visits * visit / points + (2 * 9 * size_of::<T>()) as f64,
            flops: 2.0 * visits * (2 * 9 * LANES) as f64 / points + LAW_FLOPS,
        }
    }
}

impl Model {
    /// What a step has to do.
    #[must_use]
    pub fn work(&self) -> StepWork {
        with_kernel!((&self.kernel) => (k) { k.work() })
    }
}
