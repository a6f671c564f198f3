//! Integration-consistent gradients: moving least squares that pass the patch test.
//!
//! Under a uniform stress P the force on node j is P b_j, with b_j the integral of grad phi_j. A sum over few points misses it, so a
//! node inside, where b_j = 0, is pushed about, and a body under uniform stress is not in balance. The gradients are corrected by as little as makes
//! the sum exact (the condition is that of variationally consistent integration: Chen, Hillman, Rueter 2013; here one set of gradients
//! serves strain and force, so that the force stays the derivative of the energy):
//!
//! ```text
//! minimise  1/2 sum_g V_g sum_j |d_gj|^2     so that   sum_g V_g (grad phi_gj + d_gj) = b_j       for every node
//!                                                      sum_j d_gj = 0,  sum_j d_gj (x) X_j = 0     for every point
//! d_gj = beta_j - (linear fit of beta over the nodes of g, at X_j)
//! A beta = b - sum_g V_g grad phi_g,         (A beta)_j = sum_g V_g d_gj
//! ```
//!
//! The second line keeps linear fields exact. A is symmetric and positive, its null space the linear fields, for which the right
//! side has no part; conjugate gradients solve for the three components at once.
//!
//! Of a body that is modelled by its half, all sums are those of the whole: a node's with the mirrored one of its image, and on the plane of
//! symmetry, which is no surface, the part within it.
//!
//! b_j is the integral of phi_j n over the surface, region by region. Where all three nodes of a face are tied (held, or in contact), the
//! force on the face acts at its nodes: each has a third of it.

use rayon::prelude::*;

use super::{Approximation, ShapeTable};
use crate::approximation::error::ApproximationError;
use crate::approximation::mls::{Basis, cholesky, solve};
use crate::mirror::Mirror;
use crate::vector::{self, cross, sub};

/// A vector in space, or three right sides.
type V = [f64; 3];

/// Residual of the sums over what it was at first, at which the solution is good enough: a hundredth of the force's rounding in single
/// precision.
const ENOUGH: f64 = 1e-5;
/// Iterations at most; clouds of this crate take 40 to 100.
const MOST: usize = 400;
/// Points that are worked on at a time.
const BLOCK: usize = 128;

impl Approximation {
    /// A table whose sums over the points are those of the integrals; `tied`: nodes at which forces act from outside.
    ///
    /// # Errors
    /// [`ApproximationError`] where there is no fit on the surface.
    pub fn consistent(&self, mut table: ShapeTable, tied: &[bool]) -> Result<ShapeTable, ApproximationError> {
        let Some(basis) = self.settings.basis else { return Ok(table) };
        let symmetry = Symmetry {
            mirror: self.supports.mirror,
            on_plane: (0..self.points.len() as u32).map(|n| self.supports.is_on_plane(n)).collect(),
        };
        let mut missing = self.surface_integrals(tied, basis)?;
        for g in 0..table.volume.len() {
            for e in table.entries(g) {
                let left = &mut missing[table.nodes[e] as usize];
                (0..3).for_each(|k| left[k] -= table.volume[g] * table.gradient[e][k]);
            }
        }
        let places = match symmetry.mirror {
            Some(mirror) => [self.points.clone(), self.points.iter().map(|p| mirror.image(p)).collect()].concat(),
            None => self.points.clone(),
        };
        let fits = Fits::new(&table, &places, &symmetry);
        let beta =
            fits.solved(symmetry.folded(missing)).map_err(|n| ApproximationError::Unbalanced { at: places[n] })?;
        let correction: Vec<V> = fits.blocks(&symmetry.unfolded(&beta)).concat();
        table.gradient.iter_mut().zip(correction).for_each(|(g, d)| (0..3).for_each(|k| g[k] += d[k]));
        Ok(table)
    }

    /// The points that [`Self::consistent`] needs a fit at besides those of the table, m: those of the surface's integrals.
    #[must_use]
    pub fn surface_points(&self) -> Vec<V> {
        let of_face = |face: [u32; 3]| face_points().map(move |(share, _)| self.on_face(&face, share));
        self.surface().into_iter().flat_map(|(face, ..)| of_face(face)).collect()
    }

    fn on_face(&self, face: &[u32; 3], share: V) -> V {
        let x = face.map(|n| self.points[n as usize]);
        std::array::from_fn(|k| (0..3).map(|c| share[c] * x[c][k]).sum())
    }

    /// b_j of every entry of a table, m².
    fn surface_integrals(&self, tied: &[bool], basis: Basis) -> Result<Vec<V>, ApproximationError> {
        let images = if self.supports.mirror.is_some() { self.points.len() } else { 0 };
        let mut b = vec![[0.0; 3]; self.points.len() + images];
        let mut add = |entry: u32, share: f64, area: V| (0..3).for_each(|k| b[entry as usize][k] += share * area[k]);
        let within_plane = |face: &[u32; 3]| images > 0 && face.iter().all(|&n| self.supports.is_on_plane(n));
        for (face, region, area) in self.surface().into_iter().filter(|(face, ..)| !within_plane(face)) {
            if face.iter().all(|&n| tied[n as usize]) {
                face.iter().for_each(|&n| add(n, 1.0 / 3.0, area));
                continue;
            }
            for (share, weight) in face_points() {
                self.with_fit(self.on_face(&face, share), region, None, basis, false, |near, fit| {
                    near.iter()
                        .zip(&fit.value)
                        .for_each(|(n, phi)| add(self.supports.entry(n.node), weight * phi, area));
                })?;
            }
        }
        Ok(b)
    }

    /// Faces of the cells with no cell of the same region behind: corners, region, area times outward normal (m²).
    fn surface(&self) -> Vec<([u32; 3], u8, V)> {
        let mut faces = Vec::with_capacity(4 * self.cells.len());
        for (cell, &[i, j, k, l]) in self.cells.iter().enumerate() {
            let region = self.regions.of_cell(cell);
            for (face, inner) in [([i, j, k], l), ([i, j, l], k), ([i, k, l], j), ([j, k, l], i)] {
                let mut key = face;
                key.sort_unstable();
                faces.push((key, region, face, inner));
            }
        }
        faces.sort_unstable();
        let same = |a: &([u32; 3], u8, [u32; 3], u32), b: &([u32; 3], u8, [u32; 3], u32)| (a.0, a.1) == (b.0, b.1);
        faces.chunk_by(same).filter(|chunk| chunk.len() == 1).map(|chunk| self.outward(&chunk[0])).collect()
    }

    fn outward(&self, (_, region, face, inner): &([u32; 3], u8, [u32; 3], u32)) -> ([u32; 3], u8, V) {
        let [a, b, c] = face.map(|n| self.points[n as usize]);
        let normal = cross(sub(b, a), sub(c, a));
        let inward = vector::dot(normal, sub(self.points[*inner as usize], a));
        (*face, *region, normal.map(|n| if inward > 0.0 { -0.5 * n } else { 0.5 * n }))
    }
}

/// Barycentric points and weights of degree 4 on a triangle (Dunavant 1985).
fn face_points() -> impl Iterator<Item = (V, f64)> {
    [(0.445_948_490_915_965, 0.223_381_589_678_011), (0.091_576_213_509_771, 0.109_951_743_655_322)]
        .into_iter()
        .flat_map(|(a, weight)| {
            (0..3).map(move |c| (std::array::from_fn(|k| if k == c { 1.0 - 2.0 * a } else { a }), weight))
        })
}

/// What a body's symmetry makes of vectors of all entries, and of those of nodes alone.
struct Symmetry {
    mirror: Option<Mirror>,
    on_plane: Vec<bool>,
}

impl Symmetry {
    /// Of the nodes: their own with the mirrored one of their image.
    fn folded(&self, mut entries: Vec<V>) -> Vec<V> {
        let Some(mirror) = self.mirror else { return entries };
        let images = entries.split_off(self.on_plane.len());
        for ((own, image), on_plane) in entries.iter_mut().zip(&images).zip(&self.on_plane) {
            if *on_plane {
                *own = mirror.within(own);
            } else {
                let image = mirror.image(image);
                (0..3).for_each(|k| own[k] += image[k]);
            }
        }
        entries
    }

    /// Of all entries, for those of the nodes.
    fn unfolded(&self, nodes: &[V]) -> Vec<V> {
        let images = self.mirror.iter().flat_map(|mirror| nodes.iter().map(|v| mirror.image(v)));
        nodes.iter().copied().chain(images).collect()
    }
}

/// Centre of a point's nodes (m), 1/size (1/m), factor of the moment matrix; none where they lie in a plane.
type Moment = (V, f64, Option<[[f64; 4]; 4]>);

/// Linear fits over the nodes of each point.
struct Fits<'a> {
    table: &'a ShapeTable,
    symmetry: &'a Symmetry,
    /// Where each entry is, m.
    places: &'a [V],
    /// Of each point.
    moments: Vec<Moment>,
}

impl<'a> Fits<'a> {
    fn new(table: &'a ShapeTable, places: &'a [V], symmetry: &'a Symmetry) -> Self {
        let of = |g: usize| {
            let nodes = &table.nodes[table.entries(g)];
            let count = nodes.len() as f64;
            let mean = |f: &dyn Fn(V) -> f64| nodes.iter().map(|&n| f(places[n as usize])).sum::<f64>() / count;
            let centre = [mean(&|x| x[0]), mean(&|x| x[1]), mean(&|x| x[2])];
            let size = mean(&|x| (0..3).map(|k| (x[k] - centre[k]).powi(2)).sum()).sqrt();
            let mut m = [[0.0; 4]; 4];
            for &n in nodes {
                let p = monomials(places[n as usize], centre, 1.0 / size);
                (0..4).for_each(|r| (0..4).for_each(|c| m[r][c] += p[r] * p[c]));
            }
            let factor = cholesky(&mut m).is_ok().then_some(m);
            (centre, 1.0 / size, factor)
        };
        let moments = (0..table.volume.len()).into_par_iter().map(of).collect();
        Self { table, symmetry, places, moments }
    }

    /// d_gj of the points of a block, in the order of the table.
    fn block(&self, beta: &[V], block: usize) -> Vec<V> {
        let points = block * BLOCK..((block + 1) * BLOCK).min(self.table.volume.len());
        let mut d = Vec::new();
        for g in points {
            let nodes = &self.table.nodes[self.table.entries(g)];
            let (centre, scale, Some(factor)) = &self.moments[g] else {
                d.resize(d.len() + nodes.len(), [0.0; 3]);
                continue;
            };
            let mut fit = [[0.0; 4]; 3];
            for &n in nodes {
                let p = monomials(self.places[n as usize], *centre, *scale);
                (0..3).for_each(|k| (0..4).for_each(|r| fit[k][r] += p[r] * beta[n as usize][k]));
            }
            fit.iter_mut().for_each(|f| solve(factor, f));
            d.extend(nodes.iter().map(|&n| {
                let p = monomials(self.places[n as usize], *centre, *scale);
                std::array::from_fn(|k| beta[n as usize][k] - (0..4).map(|r| p[r] * fit[k][r]).sum::<f64>())
            }));
        }
        d
    }

    fn blocks(&self, beta: &[V]) -> Vec<Vec<V>> {
        (0..self.table.volume.len().div_ceil(BLOCK)).into_par_iter().map(|block| self.block(beta, block)).collect()
    }

    /// A beta of the nodes, summed in the order of the table.
    fn applied(&self, beta: &[V]) -> Vec<V> {
        let mut sum = vec![[0.0; 3]; self.places.len()];
        let d = self.blocks(&self.symmetry.unfolded(beta)).into_iter().flatten();
        let volumes =
            (0..self.table.volume.len()).flat_map(|g| self.table.entries(g).map(move |_| self.table.volume[g]));
        for ((n, d), volume) in self.table.nodes.iter().zip(d).zip(volumes) {
            (0..3).for_each(|k| sum[*n as usize][k] += volume * d[k]);
        }
        self.symmetry.folded(sum)
    }

    /// beta of the nodes for what is missing, by conjugate gradients with the volume round each node for a preconditioner; or the node where
    /// most is left.
    fn solved(&self, mut residual: Vec<V>) -> Result<Vec<V>, usize> {
        let mut weight = vec![0.0; residual.len()];
        for g in 0..self.table.volume.len() {
            for &n in &self.table.nodes[self.table.entries(g)] {
                let node = n as usize % residual.len();
                weight[node] += self.table.volume[g];
            }
        }
        let conditioned = |r: &[V]| -> Vec<V> {
            r.iter().zip(&weight).map(|(r, w)| if *w > 0.0 { r.map(|x| x / w) } else { [0.0; 3] }).collect()
        };
        let mut beta = vec![[0.0; 3]; residual.len()];
        let mut z = conditioned(&residual);
        let mut way = z.clone();
        let mut square = dot(&residual, &z);
        let enough = ENOUGH * ENOUGH * square;
        for _ in 0..MOST {
            let image = self.applied(&way);
            let curvature = dot(&way, &image);
            if square <= enough || curvature <= 0.0 {
                break;
            }
            let step = square / curvature;
            for j in 0..beta.len() {
                (0..3).for_each(|k| beta[j][k] += step * way[j][k]);
                (0..3).for_each(|k| residual[j][k] -= step * image[j][k]);
            }
            z = conditioned(&residual);
            let next = dot(&residual, &z);
            way.iter_mut().zip(&z).for_each(|(w, z)| (0..3).for_each(|k| w[k] = z[k] + next / square * w[k]));
            square = next;
        }
        let left = |n: &usize| residual[*n].iter().fold(0.0_f64, |most, r| most.max(r.abs()));
        let worst = (0..residual.len()).max_by(|a, b| left(a).total_cmp(&left(b)));
        // in the finest clouds rounding ends the search a little earlier
        worst.filter(|_| square > 1e4 * enough || square.is_nan()).map_or(Ok(beta), Err)
    }
}

/// 1 and the coordinates about a centre.
fn monomials(x: V, centre: V, scale: f64) -> [f64; 4] {
    [1.0, (x[0] - centre[0]) * scale, (x[1] - centre[1]) * scale, (x[2] - centre[2]) * scale]
}

fn dot(a: &[V], b: &[V]) -> f64 {
    a.iter().zip(b).map(|(a, b)| vector::dot(*a, *b)).sum()
}
