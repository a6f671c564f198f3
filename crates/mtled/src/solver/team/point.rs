//! One point's deformation gradient, straight from the displacements: what a solver that a team steps is asked for between two steps.

use super::super::block::Block;
use super::super::kernel::{Kernel, Points};
use super::super::memory::Memory;
use super::super::memory::Relaxing;
use super::super::points::Projected;
use crate::approximation::Form;
use crate::material::neo_hookean::Gradient;
use crate::number::{LANES, Real};

/// Of a point that has not been deformed.
const UNDEFORMED: Gradient<f64> = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];

impl<T: Real> Kernel<T> {
    /// Deformation gradient (row-major) of an integration point at nodal parameters `u`, m.
    pub(in super::super) fn deformation_at(&self, points: &Points<T>, u: &[[f64; 3]], point: usize) -> Gradient<f64> {
        let (b, slot) = self.tables.slot[point];
        let (block, slot) = (&self.tables.blocks[b as usize], slot as usize);
        let active = points.active[b as usize][slot / LANES].0[slot % LANES];
        // a point of a half plane that the needle fills is taken for undeformed
        if block.form == Form::Axisymmetric && active <= T::default() {
            UNDEFORMED
        } else {
            block.deformation_at(u, slot)
        }
    }

    /// Strain energy that stands in one integration point there, without the projected volumetric part, J.
    pub(in super::super) fn energy_at(
        &self,
        points: &Points<T>,
        u: &[[f64; 3]],
        memory: &[Memory],
        point: usize,
    ) -> f64 {
        let (b, slot) = self.tables.slot[point];
        let (block, slot) = (&self.tables.blocks[b as usize], slot as usize);
        let law = Relaxing { constants: self.of(block), memory: &memory[b as usize] };
        law.evaluate(slot, &self.deformation_at(points, u, point), Projected::default()).0 * block.volume_in(slot)
    }
}

impl<T: Real> Block<T> {
    /// I + sum_j u_j (x) grad phi_j of the point in one slot.
    fn deformation_at(&self, u: &[[f64; 3]], slot: usize) -> Gradient<f64> {
        let (group, lane) = (slot / LANES, slot % LANES);
        let scale = self.scale[group].0[lane].get();
        let mut f = UNDEFORMED;
        for visit in self.start[group] as usize..self.start[group + 1] as usize {
            let g = self.gradient[visit].map(|g| scale * T::load(g[lane]).get());
            let local = usize::from(self.local[visit]);
            let (u, image) = (&u[self.nodes[local] as usize], local >= self.originals);
            match self.form {
                Form::Axisymmetric => {
                    let radial = if image { -u[0] } else { u[0] };
                    f[4] += radial * g[1];
                    for k in [0, 2] {
                        f[k] += radial * g[k];
                        f[6 + k] += u[2] * g[k];
                    }
                }
                Form::Full => add(&mut f, u, &g),
                Form::Mirrored(mirror) => add(&mut f, &if image { mirror.image(u) } else { *u }, &g),
            }
        }
        f
    }
}

/// F += u (x) g.
fn add(f: &mut Gradient<f64>, u: &[f64; 3], g: &[f64; 3]) {
    for i in 0..3 {
        for k in 0..3 {
            f[3 * i + k] += u[i] * g[k];
        }
    }
}
