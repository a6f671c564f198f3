//! Strain and von Mises stress at the points of a mesh from their displacement, for the page's 3D view at all times.
//!
//! In each tetrahedron F = I + du/dX is constant. The values at a point are means over its cells, weighted by their
//! volumes, of
//!
//! ```text
//! strain  sqrt(2/3 e:e),   e = dev E,   E = 1/2 (F^T F - I)
//! stress  sqrt(3/2 s:s),   s = mu J^(-5/3) dev(F F^T)         neo-Hooke's Cauchy stress
//! ```

use nalgebra::Matrix3;

/// Volume ratio below which a cell of the mesh contains no tissue: the needle fills it, or it is inverted. It has no
/// stress.
const NO_TISSUE: f64 = 0.1;

/// Corners of a cell with its volume and the inverse of its edge matrix in the undeformed body.
struct Cell {
    corners: [usize; 4],
    volume: f64,
    inverse: Matrix3<f64>,
    shear_modulus_pa: f64,
}

/// A mesh, prepared for many times.
pub(super) struct Strains {
    cells: Vec<Cell>,
    weights: Vec<f64>,
    has_stress: bool,
}

/// Matrix with the edges from the first corner as columns.
fn edges(x: [[f64; 3]; 4]) -> Matrix3<f64> {
    Matrix3::from_fn(|row, k| x[k + 1][row] - x[0][row])
}

/// Square root of m:m for the deviator of a symmetric matrix.
fn deviator(m: Matrix3<f64>) -> f64 {
    (m - Matrix3::identity() * (m.trace() / 3.0)).norm()
}

impl Strains {
    /// Flat cells are left out. `moduli_pa` are the regions' shear moduli, and `region` is the region of each cell
    /// (empty: 0). Without moduli there is no stress.
    pub(crate) fn new(points: &[[f64; 3]], cells: &[[u32; 4]], region: &[u8], moduli_pa: Option<&[f64]>) -> Self {
        let mut weights = vec![0.0; points.len()];
        let modulus = |i: usize| {
            let region = region.get(i).map_or(0, |r| usize::from(*r));
            moduli_pa.and_then(|moduli| moduli.get(region)).copied().unwrap_or(0.0)
        };
        let cell = |(i, c): (usize, &[u32; 4])| {
            let corners = c.map(|i| i as usize);
            let edges = edges(corners.map(|i| points[i]));
            let (volume, inverse) = (edges.determinant().abs(), edges.try_inverse()?);
            corners.iter().for_each(|&i| weights[i] += volume);
            Some(Cell { corners, volume, inverse, shear_modulus_pa: modulus(i) })
        };
        let cells = cells.iter().enumerate().filter_map(cell).collect();
        Self { cells, weights, has_stress: moduli_pa.is_some() }
    }

    /// Strain and stress (Pa; empty without a modulus) at every point.
    pub(crate) fn at(&self, displacement: &[[f64; 3]]) -> [Vec<f64>; 2] {
        let none = vec![0.0; self.weights.len()];
        let (mut strains, mut stresses, mut tissue) = (none.clone(), none.clone(), none);
        for cell in &self.cells {
            let f = Matrix3::identity() + edges(cell.corners.map(|i| displacement[i])) * cell.inverse;
            let strain = (2.0_f64 / 3.0).sqrt() * 0.5 * deviator(f.transpose() * f);
            cell.corners.iter().for_each(|&i| strains[i] += cell.volume * strain);
            let j = f.determinant();
            if j > NO_TISSUE {
                let stress = cell.shear_modulus_pa * 1.5_f64.sqrt() * j.powf(-5.0 / 3.0) * deviator(f * f.transpose());
                for i in cell.corners {
                    stresses[i] += cell.volume * stress;
                    tissue[i] += cell.volume;
                }
            }
        }
        let mean = |sums: &[f64], weights: &[f64]| -> Vec<f64> {
            sums.iter().zip(weights).map(|(s, w)| if *w > 0.0 { s / w } else { 0.0 }).collect()
        };
        let stress = if self.has_stress { mean(&stresses, &tissue) } else { Vec::new() };
        [mean(&strains, &self.weights), stress]
    }
}

/// Shear moduli in a scene file, Pa: of `[material]`, then of each region's material. `None` unless all of them are
/// neo-Hookean without relaxation. A rigid region has no stress: 0.
pub(super) fn moduli_pa(scene_toml: &str) -> Option<Vec<f64>> {
    let scene: toml::Table = scene_toml.parse().ok()?;
    let none = toml::Table::new();
    let materials = scene.get("materials").and_then(|m| m.as_table()).unwrap_or(&none);
    let regions = scene.get("regions").and_then(|r| r.as_array()).map_or(&[][..], Vec::as_slice);
    let of_regions = regions.iter().map(|r| modulus_pa(materials.get(r.get("material")?.as_str()?)?.as_table()?));
    std::iter::once(modulus_pa(scene.get("material")?.as_table()?)).chain(of_regions).collect()
}

fn modulus_pa(material: &toml::Table) -> Option<f64> {
    if material.get("rigid").and_then(toml::Value::as_bool) == Some(true) {
        return Some(0.0);
    }
    let plain = material.get("model").is_none_or(|m| m.as_str() == Some("neo_hookean"));
    let relaxes = material.get("prony_shares").and_then(|s| s.as_array()).is_some_and(|s| !s.is_empty());
    let modulus = material.get("shear_modulus_pa")?;
    modulus.as_float().filter(|_| plain && !relaxes)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn simple_shear_has_the_strain_and_stress_of_the_books() {
        let points = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let gamma = 0.01;
        let sheared = points.map(|p| [gamma * p[2], 0.0, 0.0]);
        let strains = Strains::new(&points, &[[0, 1, 2, 3]], &[1], Some(&[1.0, 1678.0]));
        let [strain, stress] = strains.at(&sheared);
        // small strains: gamma / sqrt(3), and sqrt(3) mu gamma
        assert!((strain[1] / (gamma / 3_f64.sqrt()) - 1.0).abs() < 1e-2, "{strain:?}");
        assert!((stress[2] / (3_f64.sqrt() * 1678.0 * gamma) - 1.0).abs() < 1e-2, "{stress:?}");
        let layered = "[material]\nshear_modulus_pa = 1678.0\n[materials.skin]\nshear_modulus_pa = 9000.0\n[[regions]]\n\
            material = \"skin\"\n";
        assert_eq!(moduli_pa(layered), Some(vec![1678.0, 9000.0]));
        assert_eq!(moduli_pa("[material]\nmodel = \"ogden\"\nshear_modulus_pa = 1.0\n"), None);
    }
}
