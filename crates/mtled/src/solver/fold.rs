//! Guard against folding at the edge of contact.
//!
//! The edge of a bonded instrument is singular, and cells there are crushed. Smooth shape functions hardly notice a cell
//! that turns over between its neighbours, so nothing turns it back. So cells near the edge resist that themselves, as the
//! linear tetrahedra that they are:
//!
//! ```text
//! W = sum_c V_c k_c/2 min(J_c - J_1, 0)^2,      f_a = V_c k_c min(J_c - J_1, 0) cof(F_c) grad N_a
//! k_c = 0.03 mu max(1, min((h_1 / h_c)^6, 1/0.03)),     h_1 = 0.0177 H
//! ```
//!
//! with h_c the mean edge of the cell and H the height of the body. A cell that keeps more than J_1 = 0.25 of its volume
//! feels nothing of it, and one that is inside out is pushed back by a finite force, so the stable step is not at risk.
//! The finer the cloud at the edge, the more of its cells are crushed and the more firmly they have to resist, and the less
//! of the body they are: docs/stability.md has what was measured.

use crate::approximation::mean_edge;
use crate::approximation::table::tetrahedron;
use crate::material::neo_hookean::{cofactor, determinant};

use super::block::Shares;

/// J_1: volume ratio below which a cell resists.
const LEAST: f64 = 0.25;
/// k over the shear modulus, of cells that are not fine.
const STIFFNESS: f64 = 0.03;
/// The same of the finest.
const LARGEST_STIFFNESS: f64 = 1.0;
/// h_1 over the height of the body: mean edge below which a cell is fine.
const FINE: f64 = 0.0177;
/// Power of h_1 / h_c.
const POWER: i32 = 6;
/// Cells per part of an evaluation.
pub const CELLS_PER_CHUNK: usize = 128;

/// A guarded cell.
#[derive(Clone, Debug)]
struct Cell {
    nodes: [u32; 4],
    /// grad N_a, 1/m.
    gradient: [[f64; 3]; 4],
    /// V_c, m^3.
    volume: f64,
    /// k_c, Pa.
    stiffness: f64,
}

/// What a cell resists with.
#[derive(Clone, Copy, Debug, Default)]
pub struct Resistance {
    /// Force on each of its nodes, N.
    pub force: [[f64; 3]; 4],
    /// W of the cell, J.
    pub energy: f64,
}

/// Fills in what the cells of one part of the list resist with.
pub fn fill(part: &mut [Resistance], index: usize, of: impl Fn(usize) -> Resistance) {
    for (out, cell) in part.iter_mut().zip(index * CELLS_PER_CHUNK..) {
        *out = of(cell);
    }
}

/// The guarded cells of a model.
#[derive(Clone, Debug, Default)]
pub struct Guard {
    cells: Vec<Cell>,
    /// Cells of each node, with its place in them.
    of_node: Shares,
}

impl Guard {
    /// Guards cells of a tissue with shear modulus `mu` in each cell, Pa.
    pub fn new(guarded: &[u32], cells: &[[u32; 4]], points: &[[f64; 3]], mu: impl Fn(u32) -> f64) -> Self {
        let (bottom, top) = points.iter().fold((f64::MAX, f64::MIN), |(a, b), p| (a.min(p[2]), b.max(p[2])));
        let fine = FINE * (top - bottom);
        let cell = |&c: &u32| {
            let nodes = cells[c as usize];
            let corners = nodes.map(|n| points[n as usize]);
            let (volume, gradient) = tetrahedron(&corners);
            let finer = (fine / mean_edge(&corners)).powi(POWER);
            let stiffness = mu(c) * (STIFFNESS * finer).clamp(STIFFNESS, LARGEST_STIFFNESS);
            Cell { nodes, gradient, volume, stiffness }
        };
        let of_node = if guarded.is_empty() {
            Shares::default()
        } else {
            Shares::of(guarded.iter().map(|&c| cells[c as usize].as_slice()), points.len())
        };
        Self { cells: guarded.iter().map(cell).collect(), of_node }
    }

    /// Four times the cell plus the corner, for each cell that has node n.
    pub fn of_node(&self, n: usize) -> &[u32] {
        if self.cells.is_empty() { &[] } else { self.of_node.of_index(n) }
    }

    /// Force and energy of a cell for nodal parameters `u`.
    pub fn resistance(&self, cell: usize, u: &[[f64; 3]]) -> Resistance {
        let State { c, cof, lack, .. } = self.state(cell, u);
        if lack >= 0.0 {
            return Resistance::default();
        }
        let factor = c.volume * c.stiffness * lack;
        let force =
            c.gradient.map(|g| std::array::from_fn(|i| factor * (0..3).map(|k| cof[3 * i + k] * g[k]).sum::<f64>()));
        Resistance { force, energy: 0.5 * factor * lack }
    }

    /// The cell's share of its nodes' masses, over s (see `solver::mass`), in the first component of the forces.
    pub fn bound(&self, cell: usize, u: &[[f64; 3]]) -> Resistance {
        let State { c, f, cof, lack } = self.state(cell, u);
        if lack >= 0.0 {
            return Resistance::default();
        }
        // d(lack cof)/dF: |cof|^2, and lack d(cof)/dF, whose norm is at most |lack| |F|; a norm is at most Frobenius'
        let square = |m: &[f64; 9]| m.iter().map(|x| x * x).sum::<f64>();
        let largest = square(&cof) - lack * square(&f).sqrt();
        let squares: f64 = c.gradient.iter().flatten().map(|g| g * g).sum();
        let share = c.stiffness * largest * c.volume * squares;
        Resistance { force: [[share, 0.0, 0.0]; 4], energy: 0.0 }
    }

    fn state(&self, cell: usize, u: &[[f64; 3]]) -> State<'_> {
        let c = &self.cells[cell];
        let origin = u[c.nodes[0] as usize];
        let mut f = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        for a in 1..4 {
            let u = u[c.nodes[a] as usize];
            for i in 0..3 {
                for k in 0..3 {
                    f[3 * i + k] += (u[i] - origin[i]) * c.gradient[a][k];
                }
            }
        }
        let cof = cofactor(&f);
        State { c, f, cof, lack: determinant(&f, &cof) - LEAST }
    }
}

/// A cell as it is deformed.
struct State<'a> {
    c: &'a Cell,
    /// F_c and cof F_c.
    f: [f64; 9],
    cof: [f64; 9],
    /// J_c - J_1.
    lack: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn force_is_the_derivative_of_the_energy() {
        let points = [[0.0, 0.0, 0.0], [1.1, 0.1, 0.0], [0.2, 0.9, 0.1], [0.1, 0.3, 1.2]];
        let guard = Guard::new(&[0], &[[0, 1, 2, 3]], &points, |_| 100.0);
        // from untouched over crushed to inside out
        for push in [0.1, 0.9, 1.0, 1.6] {
            let u = [[0.0; 3], [0.02, -0.01, 0.03], [0.0, 0.05, 0.02], [0.04, -0.02, -push * 1.1]];
            let at = guard.resistance(0, &u);
            let total: [f64; 3] = std::array::from_fn(|k| at.force.iter().map(|f| f[k]).sum());
            assert!(total.iter().all(|x| x.abs() < 1e-12), "a cell pushes nothing but itself");
            assert_eq!(at.energy > 0.0, push > 0.5);
            for a in 0..4 {
                for k in 0..3 {
                    let energy = |h: f64| {
                        let mut u = u;
                        u[a][k] += h;
                        guard.resistance(0, &u).energy
                    };
                    let slope = (energy(1e-6) - energy(-1e-6)) / 2e-6;
                    assert!((slope - at.force[a][k]).abs() < 1e-7, "{push} {a} {k}: {slope} {}", at.force[a][k]);
                }
            }
        }
    }
}
