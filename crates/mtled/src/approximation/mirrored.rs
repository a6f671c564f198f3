//! Supports that reach across a plane of symmetry.
//!
//! The field goes on beyond the plane as its mirror image: the part along the normal is odd, the rest even. So the support of a point
//! near the plane holds images of the nodes, whose parameters are the reflected ones: no support is one-sided there, and shape functions
//! are those of the whole body. A node on the plane is its own image. In a table, the image of node j is entry `nodes + j`.

use super::mls::Neighbour;
use super::support::Supports;
use crate::mirror::Mirror;

/// Nodes with their images, searchable by place.
#[derive(Clone, Debug)]
pub(crate) struct MirroredSupports {
    supports: Supports,
    nodes: usize,
    /// The node of each image.
    original: Vec<u32>,
    /// Without one no node has an image.
    pub(crate) mirror: Option<Mirror>,
    on_plane: Vec<bool>,
}

impl MirroredSupports {
    /// Indexes the nodes of a half, all with n.x >= 0; `on_plane` are those that are their own images, none without a plane.
    /// `interpolating` marks those with the almost singular weight.
    pub(crate) fn new(
        points: &[[f64; 3]],
        radii: &[f64],
        interpolating: &[bool],
        mirror: Option<Mirror>,
        on_plane: Vec<bool>,
    ) -> Self {
        let nodes = points.len();
        let near = |m: &Mirror, n: usize| !on_plane[n] && m.across(&points[n]) < radii[n];
        let original: Vec<u32> =
            mirror.iter().flat_map(|m| (0..nodes).filter(|&n| near(m, n)).map(|n| n as u32)).collect();
        let image = |m: Mirror| original.iter().map(move |&n| m.image(&points[n as usize]));
        let all_points: Vec<_> = points.iter().copied().chain(mirror.into_iter().flat_map(image)).collect();
        let all_radii = radii.iter().copied().chain(original.iter().map(|&n| radii[n as usize])).collect();
        let weights =
            interpolating.iter().copied().chain(original.iter().map(|&n| interpolating[n as usize])).collect();
        Self { supports: Supports::new(&all_points, all_radii, weights), nodes, original, mirror, on_plane }
    }

    /// Nodes of a body that has no plane of symmetry.
    pub(crate) fn whole(points: &[[f64; 3]], radii: &[f64], interpolating: &[bool]) -> Self {
        Self::new(points, radii, interpolating, None, Vec::new())
    }

    pub(crate) fn with_radii(&self, radii: &[f64]) -> Self {
        let points = &self.supports.points()[..self.nodes];
        Self::new(points, radii, self.interpolating(), self.mirror, self.on_plane.clone())
    }

    /// Nodes and images whose support holds x. Overwrites `out`; [`MirroredSupports::node`] tells them apart.
    pub(crate) fn at(&self, x: [f64; 3], out: &mut Vec<Neighbour>) {
        self.supports.at(x, out);
    }

    /// The same nodes, those with `factor` times the `first` radius that then reach a point of `at`.
    pub(super) fn enlarged(&self, first: &[f64], factor: f64, at: &[[f64; 3]]) -> Self {
        let wide: Vec<f64> = self.radii().iter().zip(first).map(|(now, r)| now.max(factor * r)).collect();
        let reaching = self.with_radii(&wide);
        let mut radii = self.radii().to_vec();
        let mut neighbours = Vec::new();
        for &x in at {
            reaching.at(x, &mut neighbours);
            for n in neighbours.iter().map(|n| reaching.node(n.node).0 as usize) {
                radii[n] = wide[n];
            }
        }
        self.with_radii(&radii)
    }

    /// The node that a neighbour is, and whether it is its image.
    pub(crate) fn node(&self, neighbour: u32) -> (u32, bool) {
        match (neighbour as usize).checked_sub(self.nodes) {
            None => (neighbour, false),
            Some(image) => (self.original[image], true),
        }
    }

    /// The entry of a neighbour in a table: that of the node, or `nodes` more for its image.
    pub(crate) fn entry(&self, neighbour: u32) -> u32 {
        match self.node(neighbour) {
            (node, false) => node,
            (node, true) => node + self.nodes as u32,
        }
    }

    /// Support radii of the nodes, m.
    pub(crate) fn radii(&self) -> &[f64] {
        &self.supports.radii()[..self.nodes]
    }

    /// Which nodes have the almost singular weight.
    pub(crate) fn interpolating(&self) -> &[bool] {
        &self.supports.interpolating()[..self.nodes]
    }

    /// Whether a node lies on the plane.
    pub(crate) fn is_on_plane(&self, node: u32) -> bool {
        self.on_plane.get(node as usize).copied().unwrap_or(false)
    }
}
