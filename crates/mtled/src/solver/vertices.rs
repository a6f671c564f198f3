//! Corners of cells by region: what shares volume ratios and pressures.
//!
//! Pressure jumps where the modulus does, so no average may reach across an interface between materials. A node on an
//! interface is one vertex for each region that meets there; away from interfaces vertices and nodes are the same.

/// Vertices of a body: the nodes, and after them further copies of those on interfaces.
#[derive(Clone, Debug)]
pub(super) struct Vertices {
    /// Cells by their vertices.
    pub cells: Vec<[u32; 4]>,
    /// Node of each vertex.
    pub node: Vec<u32>,
    /// Region of each vertex.
    pub region: Vec<u8>,
}

impl Vertices {
    /// Vertices of cells among so many nodes. `region` of each cell; empty: one region.
    pub(super) fn new(cells: &[[u32; 4]], region: &[u8], nodes: usize) -> Self {
        let mut own: Vec<(u32, u8)> = cells.iter().zip(region).flat_map(|(c, &r)| c.map(|n| (n, r))).collect();
        own.sort_unstable();
        own.dedup();
        let (mut first, mut further) = (vec![None; nodes], Vec::new());
        for (n, r) in own {
            match &mut first[n as usize] {
                slot @ None => *slot = Some(r),
                Some(_) => further.push((n, r)),
            }
        }
        let vertex = |n: u32, r: u8| match first[n as usize] {
            Some(own) if own != r => nodes + further.partition_point(|&f| f < (n, r)),
            _ => n as usize,
        };
        let of_cell = |c: usize| {
            let r = region.get(c).copied().unwrap_or(0);
            cells[c].map(|n| vertex(n, r) as u32)
        };
        Self {
            cells: (0..cells.len()).map(of_cell).collect(),
            node: (0..nodes as u32).chain(further.iter().map(|f| f.0)).collect(),
            region: first.iter().map(|r| r.unwrap_or(0)).chain(further.iter().map(|f| f.1)).collect(),
        }
    }

    /// Places of the vertices, m.
    pub(super) fn places(&self, points: &[[f64; 3]]) -> Vec<[f64; 3]> {
        self.node.iter().map(|&n| points[n as usize]).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_node_between_regions_is_a_vertex_of_each() {
        let cells = [[0, 1, 2, 3], [1, 2, 3, 4], [2, 3, 4, 5]];
        let one = Vertices::new(&cells, &[], 6);
        assert_eq!((one.cells, one.node, one.region), (cells.to_vec(), (0..6).collect(), vec![0; 6]));
        let two = Vertices::new(&cells, &[0, 2, 2], 6);
        assert_eq!(two.node, [0, 1, 2, 3, 4, 5, 1, 2, 3]);
        assert_eq!(two.region, [0, 0, 0, 0, 2, 2, 2, 2, 2]);
        assert_eq!(two.cells, [[0, 1, 2, 3], [6, 7, 8, 4], [7, 8, 4, 5]]);
    }
}
