//! The field at any set of points.

use crate::mirror::Mirror;

/// Rows phi_j(x): the field at any set of points.
#[derive(Clone, Debug, Default)]
pub struct Field {
    /// Offsets, one more than rows.
    pub start: Vec<u32>,
    /// Support nodes, and images as in a [`super::ShapeTable`].
    pub nodes: Vec<u32>,
    /// phi_j(x).
    pub value: Vec<f64>,
    /// The plane that images lie beyond.
    pub mirror: Option<Mirror>,
}

impl Field {
    /// Value of row `i` for nodal parameters `u`.
    #[must_use]
    pub fn at(&self, i: usize, u: &[[f64; 3]]) -> [f64; 3] {
        let mut v = [0.0; 3];
        for e in self.start[i] as usize..self.start[i + 1] as usize {
            let n = self.nodes[e] as usize;
            let u = match (self.mirror, n.checked_sub(u.len())) {
                (Some(mirror), Some(image)) => mirror.image(&u[image]),
                _ => u[n],
            };
            for k in 0..3 {
                v[k] += self.value[e] * u[k];
            }
        }
        v
    }

    /// Number of rows.
    #[must_use]
    pub fn len(&self) -> usize {
        self.start.len().saturating_sub(1)
    }

    /// Whether there is no row.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}
