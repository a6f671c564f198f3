//! What can be asked of the tissue between poses: the field at nodes and targets, volume ratio, stress.

use crate::instrument::Contact;
use crate::material::neo_hookean::{cofactor, determinant};
use crate::scene::InstrumentKind;
use crate::solver::Role;

use super::{Phase, Twin};

impl Twin {
    /// Displacement of the field at every reference point, m. Overwrites `out`.
    pub fn displacements(&self, out: &mut Vec<[f64; 3]>) {
        let u = self.solver.parameters();
        out.clear();
        out.extend((0..self.points.len()).map(|i| self.node_field.at(i, u)));
    }

    /// Volume ratio J and von Mises (Cauchy) stress in Pa, averaged to the reference points. Overwrites both.
    pub fn jacobian_and_stress(&self, jacobian: &mut Vec<f64>, von_mises_pa: &mut Vec<f64>) {
        for v in [&mut *jacobian, &mut *von_mises_pa] {
            v.clear();
            v.resize(self.points.len(), 0.0);
        }
        let mut weight = vec![0.0; self.points.len()];
        self.solver.for_points(|point, f, stress, volume| {
            let j = determinant(&f, &cofactor(&f));
            let stress = von_mises(&f, &stress, j);
            for n in self.cells[self.cell_of_point[point] as usize].map(|n| n as usize) {
                weight[n] += volume;
                jacobian[n] += volume * j;
                von_mises_pa[n] += volume * stress;
            }
        });
        for (n, w) in weight.iter().enumerate().filter(|(_, w)| **w != 0.0) {
            jacobian[n] /= w;
            von_mises_pa[n] /= w;
        }
    }

    /// Present positions of the scene's targets, m, in the scene's order. Overwrites `out`.
    pub fn target_positions(&self, out: &mut Vec<[f64; 3]>) {
        let u = self.solver.parameters();
        out.clear();
        out.extend(self.scene.targets.iter().enumerate().map(|(i, t)| {
            let d = self.target_field.at(i, u);
            std::array::from_fn(|k| t.position[k] + d[k])
        }));
    }

    /// Largest distance between the field and its prescribed value at a held node, m.
    #[must_use]
    pub fn constraint_error(&self) -> f64 {
        let u = self.solver.parameters();
        let held = self.solver.roles().iter().enumerate().filter(|(_, r)| **r != Role::Free);
        held.map(|(n, _)| {
            let field = self.node_field.at(n, u);
            (0..3).map(|k| (field[k] - u[n][k]).powi(2)).sum::<f64>().sqrt()
        })
        .fold(0.0, f64::max)
    }

    /// Radius that the cloud gives a needle, m ([`crate::instrument::NeedlePath::effective_radius`]); `None` without a
    /// needle.
    #[must_use]
    pub fn effective_radius(&self) -> Option<f64> {
        match &self.contact {
            Some(Contact::Needle(path)) => Some(path.effective_radius()),
            _ => None,
        }
    }

    /// Whether a needle is in the tissue.
    pub(super) fn inserted(&self) -> bool {
        matches!(self.phase, Phase::Penetration | Phase::Retraction)
    }

    /// How far beside its path the tip may be, m: a needle enters on its path, and may then be moved sideways by as much
    /// as it is deep.
    pub(super) fn side_reach(&self) -> f64 {
        match self.scene.instrument.as_ref().map(|i| &i.kind) {
            Some(InstrumentKind::Needle(n)) => {
                let entering = 0.5 * n.capture_radius.get();
                if self.inserted() { entering.max(-self.tip[2]) } else { entering }
            }
            // a shear of one half: further, and the tissue would be torn off what holds it
            _ => 0.5 * self.height,
        }
    }

    /// Depth at which the surface was punctured or deepest point of the insertion; `None` before.
    #[must_use]
    pub fn deepest(&self) -> Option<f64> {
        match &self.contact {
            Some(Contact::Needle(n)) if n.insertion().punctured => Some(n.insertion().deepest * self.path().secant()),
            _ => None,
        }
    }
}

/// Von Mises stress of sigma = P F^T / J, Pa; all tensors row-major.
fn von_mises(f: &[f64; 9], p: &[f64; 9], j: f64) -> f64 {
    let sigma = |r: usize, c: usize| (0..3).map(|k| p[3 * r + k] * f[3 * c + k]).sum::<f64>() / j;
    let [a, b, c] = [sigma(0, 0), sigma(1, 1), sigma(2, 2)];
    let [d, e, g] = [sigma(0, 1), sigma(1, 2), sigma(2, 0)];
    let normal = (a - b).powi(2) + (b - c).powi(2) + (c - a).powi(2);
    (0.5 * normal + 3.0 * (d * d + e * e + g * g)).sqrt()
}
