//! The tissue as it is shown: points in space and the field at them and at the targets, whatever the model behind.

use crate::scene::Target;
use mtled::approximation::Field;
use mtled::approximation::axisymmetric::MeridianField;
use mtled::material::neo_hookean::{cofactor, determinant};
use mtled::mirror::Mirror;
use mtled::solver::{Role, Solver};

/// Shown body and observed fields of one model.
#[derive(Debug)]
pub(super) struct Tissue {
    /// Reference places, m.
    pub points: Vec<[f64; 3]>,
    pub cells: Vec<[u32; 4]>,
    /// Region of each of these: 0, or one more than the place in the scene's list; empty if there are none.
    pub region: Vec<u8>,
    /// Outward triangles.
    pub surface: Vec<[u32; 3]>,
    /// The model's own cells, and the one that each integration point lies in.
    pub model: Cells,
    pub fields: Fields,
}

/// Cells of the model: those that are shown, or the triangles of a half plane.
#[derive(Debug)]
pub(super) struct Cells {
    pub nodes: usize,
    /// `None`: the first of those shown.
    pub triangles: Option<Vec<[u32; 3]>>,
    pub of_point: Vec<u32>,
    /// Volume of each integration point, m^3.
    pub volume: Vec<f64>,
}

/// The field at the model's nodes and at the targets.
#[derive(Debug)]
pub(super) enum Fields {
    /// Every node is a shown point.
    Full { nodes: Field, targets: Field },
    /// Every node is a shown point; after them come the images of some beyond a plane of symmetry.
    Mirrored {
        nodes: Field,
        targets: Field,
        mirror: Mirror,
        /// Node of each image.
        original: Vec<u32>,
        /// Targets beyond the plane, for whose images the field is.
        beyond: Vec<bool>,
    },
    /// Every node is a ring of shown points.
    Revolved {
        nodes: MeridianField,
        targets: MeridianField,
        /// First point of each ring, and the number of points at the end.
        first: Vec<u32>,
        /// Cosine and sine of the azimuths of a ring's points.
        azimuths: Vec<[f64; 2]>,
        /// The same of the targets.
        target_azimuths: Vec<[f64; 2]>,
    },
}

/// (u_r, 0, u_z) at an azimuth.
fn turned(u: [f64; 3], [cos, sin]: [f64; 2]) -> [f64; 3] {
    [u[0] * cos, u[0] * sin, u[2]]
}

impl Fields {
    /// Displacement of the model's node n, m: in the half plane (u_r, 0, u_z).
    pub fn node(&self, n: usize, u: &[[f64; 3]]) -> [f64; 3] {
        match self {
            Self::Full { nodes, .. } | Self::Mirrored { nodes, .. } => nodes.at(n, u),
            Self::Revolved { nodes, .. } => nodes.at(n, u),
        }
    }

    /// Displacement of target i, m.
    pub(crate) fn target(&self, i: usize, u: &[[f64; 3]]) -> [f64; 3] {
        match self {
            Self::Full { targets, .. } => targets.at(i, u),
            Self::Mirrored { targets, mirror, beyond, .. } if beyond[i] => mirror.image(&targets.at(i, u)),
            Self::Mirrored { targets, .. } => targets.at(i, u),
            Self::Revolved { targets, target_azimuths, .. } => turned(targets.at(i, u), target_azimuths[i]),
        }
    }
}

impl Tissue {
    /// Displacement of every shown point, m. Overwrites `out`.
    pub(crate) fn displacements(&self, u: &[[f64; 3]], out: &mut Vec<[f64; 3]>) {
        out.clear();
        let nodes = (0..self.model.nodes).map(|n| self.fields.node(n, u));
        match &self.fields {
            Fields::Full { .. } => out.extend(nodes),
            Fields::Mirrored { mirror, original, .. } => {
                out.extend(nodes);
                for &n in original {
                    out.push(mirror.image(&out[n as usize]));
                }
            }
            Fields::Revolved { first, azimuths, .. } => {
                for (n, u) in nodes.enumerate() {
                    let copies = (first[n + 1] - first[n]) as usize;
                    out.extend(azimuths[..copies].iter().map(|&a| turned(u, a)));
                }
            }
        }
    }

    /// Present places of the targets, m. Overwrites `out`.
    pub(crate) fn target_positions(&self, targets: &[Target], u: &[[f64; 3]], out: &mut Vec<[f64; 3]>) {
        out.clear();
        out.extend(targets.iter().enumerate().map(|(i, t)| {
            let d = self.fields.target(i, u);
            std::array::from_fn(|k| t.position[k] + d[k])
        }));
    }

    /// Volume ratio J and von Mises (Cauchy) stress in Pa, averaged to the shown points. Overwrites both.
    pub(crate) fn jacobian_and_stress(&self, solver: &Solver, jacobian: &mut Vec<f64>, von_mises_pa: &mut Vec<f64>) {
        for v in [&mut *jacobian, &mut *von_mises_pa] {
            v.clear();
            v.resize(self.model.nodes, 0.0);
        }
        let mut weight = vec![0.0; self.model.nodes];
        solver.for_points(|point, f, stress, volume| {
            let j = determinant(&f, &cofactor(&f));
            let stress = von_mises(&f, &stress, j);
            for &n in self.model.corners(point, &self.cells) {
                let n = n as usize;
                weight[n] += volume;
                jacobian[n] += volume * j;
                von_mises_pa[n] += volume * stress;
            }
        });
        for (n, w) in weight.iter().enumerate().filter(|(_, w)| **w != 0.0) {
            jacobian[n] /= w;
            von_mises_pa[n] /= w;
        }
        [jacobian, von_mises_pa].into_iter().for_each(|v| self.spread(v));
    }

    /// Volume ratio J averaged to the shown points. Overwrites it.
    pub(crate) fn jacobian(&self, solver: &Solver, jacobian: &mut Vec<f64>) {
        jacobian.clear();
        jacobian.resize(self.model.nodes, 0.0);
        let mut weight = vec![0.0; self.model.nodes];
        for (point, &volume) in self.model.volume.iter().enumerate() {
            let f = solver.deformation(point);
            let j = determinant(&f, &cofactor(&f));
            for &n in self.model.corners(point, &self.cells) {
                weight[n as usize] += volume;
                jacobian[n as usize] += volume * j;
            }
        }
        for (j, w) in jacobian.iter_mut().zip(&weight).filter(|(_, w)| **w != 0.0) {
            *j /= w;
        }
        self.spread(jacobian);
    }

    /// Copies every node's value to the further points that it is shown by, in place.
    fn spread(&self, values: &mut Vec<f64>) {
        match &self.fields {
            Fields::Full { .. } => {}
            Fields::Mirrored { original, .. } => original.iter().for_each(|&n| values.push(values[n as usize])),
            Fields::Revolved { first, .. } => spread(values, first),
        }
    }

    /// Centre of the cell that an integration point lies in, in the undeformed body, m: of a ring at azimuth zero.
    pub(crate) fn place(&self, point: usize) -> [f64; 3] {
        let corners = self.corners(point);
        let sum = |k: usize| corners.iter().map(|&n| self.at_rest(n as usize)[k]).sum::<f64>();
        std::array::from_fn(|k| sum(k) / corners.len() as f64)
    }

    /// Corners of the cell that an integration point lies in, by the model's nodes.
    pub(crate) fn corners(&self, point: usize) -> &[u32] {
        self.model.corners(point, &self.cells)
    }

    /// Undeformed place of one of the model's nodes, m: of a ring at azimuth zero.
    pub(crate) fn at_rest(&self, n: usize) -> [f64; 3] {
        match &self.fields {
            Fields::Full { .. } | Fields::Mirrored { .. } => self.points[n],
            Fields::Revolved { first, .. } => self.points[first[n] as usize],
        }
    }

    /// Largest distance between the field and its prescribed value at a held node, m.
    pub(crate) fn constraint_error(&self, solver: &Solver) -> f64 {
        let u = solver.parameters();
        let held = solver.roles().iter().enumerate().filter(|(_, r)| **r != Role::Free);
        held.map(|(n, _)| {
            let field = self.fields.node(n, u);
            (0..3).map(|k| (field[k] - u[n][k]).powi(2)).sum::<f64>().sqrt()
        })
        .fold(0.0, f64::max)
    }
}

impl Cells {
    /// Corners of the cell that an integration point lies in.
    fn corners<'a>(&'a self, point: usize, shown: &'a [[u32; 4]]) -> &'a [u32] {
        let cell = self.of_point[point] as usize;
        match &self.triangles {
            Some(triangles) => &triangles[cell],
            None => &shown[cell],
        }
    }
}

/// Copies every node's value to all points of its ring, in place: rings only grow the list, so from the last.
fn spread(values: &mut Vec<f64>, first: &[u32]) {
    let nodes = values.len();
    values.resize(first[nodes] as usize, 0.0);
    for n in (0..nodes).rev() {
        let value = values[n];
        values[first[n] as usize..first[n + 1] as usize].fill(value);
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
