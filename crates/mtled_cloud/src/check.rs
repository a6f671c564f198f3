//! Is this a usable cloud? For generated and imported ones alike: node and cell by number, with the reason.

use crate::quality::six_volumes;
use crate::vector::Point;

/// What is wrong with a cloud, and where. Numbers count from 0.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Fault {
    /// No cells.
    #[error("it has no cells")]
    Empty,
    /// A coordinate is NaN or infinite.
    #[error("node {node} has a coordinate that is not a finite number: {position:?}")]
    NotFinite {
        /// Node number.
        node: usize,
        /// Its coordinates in metres.
        position: [f64; 3],
    },
    /// A cell names a node that does not exist.
    #[error("cell {cell} names node {node}, but there are only {nodes} nodes")]
    UnknownNode {
        /// Cell number.
        cell: usize,
        /// Node that it names.
        node: usize,
        /// Number of nodes.
        nodes: usize,
    },
    /// Two nodes at the same place.
    #[error("nodes {first} and {second} are both at {position:?} m: merge them")]
    Duplicate {
        /// Lower node number.
        first: usize,
        /// Higher node number.
        second: usize,
        /// Their coordinates in metres.
        position: [f64; 3],
    },
    /// A node that belongs to no cell.
    #[error("node {node} at {position:?} m belongs to no cell: remove it or join it to its neighbours")]
    Isolated {
        /// Node number.
        node: usize,
        /// Its coordinates in metres.
        position: [f64; 3],
    },
    /// A cell with negative volume.
    #[error("cell {cell} is inverted (volume {volume} m^3): swap two of its nodes {nodes:?}")]
    Inverted {
        /// Cell number.
        cell: usize,
        /// Its nodes.
        nodes: [u32; 4],
        /// Its volume in cubic metres.
        volume: f64,
    },
    /// A cell whose volume is zero to rounding.
    #[error("cell {cell} is flat (volume {volume} m^3): its nodes {nodes:?} lie in one plane")]
    Flat {
        /// Cell number.
        cell: usize,
        /// Its nodes.
        nodes: [u32; 4],
        /// Its volume in cubic metres.
        volume: f64,
    },
    /// A face shared by more than two cells, or by two on the same side.
    #[error("the triangle of nodes {nodes:?} (cell {cell}) is shared by cells that overlap")]
    Overlap {
        /// One of the cells.
        cell: usize,
        /// The triangle.
        nodes: [u32; 3],
    },
    /// An edge of the surface that does not join exactly two triangles.
    #[error(
        "the surface is not closed and simple: its edge between nodes {a} and {b} joins {triangles} triangles, not 2"
    )]
    NonManifold {
        /// One end.
        a: u32,
        /// The other end.
        b: u32,
        /// Number of surface triangles there.
        triangles: usize,
    },
    /// Surface triangles that meet at a node without sharing an edge.
    #[error("parts of the surface touch only at node {node}")]
    Pinched {
        /// Node number.
        node: u32,
    },
    /// Cells that hang together in several bodies.
    #[error(
        "it consists of {bodies} bodies that are not joined; node {node} is in another one than node 0: keep one, or \
         merge the nodes where they meet"
    )]
    Separate {
        /// Number of bodies.
        bodies: usize,
        /// A node of the second one.
        node: usize,
    },
}

impl Fault {
    /// Nodes that it names and that exist.
    pub fn nodes(&self) -> Vec<usize> {
        let all = |nodes: &[u32]| nodes.iter().map(|n| *n as usize).collect();
        match self {
            Self::Empty | Self::UnknownNode { .. } => Vec::new(),
            Self::NotFinite { node, .. } | Self::Isolated { node, .. } | Self::Separate { node, .. } => vec![*node],
            Self::Duplicate { first, second, .. } => vec![*first, *second],
            Self::Inverted { nodes, .. } | Self::Flat { nodes, .. } => all(nodes),
            Self::Overlap { nodes, .. } => all(nodes),
            Self::NonManifold { a, b, .. } => all(&[*a, *b]),
            Self::Pinched { node } => all(&[*node]),
        }
    }
}

/// Triangles that belong to one cell only, outward, in order of their cells.
///
/// # Errors
/// A triangle shared by more than two cells, or by two on the same side of it.
pub fn surface(points: usize, cells: &[[u32; 4]]) -> Result<Vec<[u32; 3]>, Fault> {
    // Faces in buckets of their smallest node: counting sort, then a short sort within each bucket.
    let mut starts = vec![0u32; points + 1];
    let all = || cells.iter().enumerate().flat_map(|(i, c)| outward(*c).map(|f| (i as u32, f)));
    for (_, f) in all() {
        starts[f[0].min(f[1]).min(f[2]) as usize + 1] += 1;
    }
    for k in 0..points {
        starts[k + 1] += starts[k];
    }
    let mut at = starts.clone();
    let mut faces = vec![(0u32, 0u32, 0u32, [0u32; 3]); 4 * cells.len()];
    for (cell, f) in all() {
        let k = (0..3).fold(0, |best, i| if f[i] < f[best] { i } else { best });
        let (b, c) = (f[(k + 1) % 3], f[(k + 2) % 3]);
        faces[at[f[k] as usize] as usize] = (b.min(c), b.max(c), cell, [f[k], b, c]);
        at[f[k] as usize] += 1;
    }
    let mut outer = Vec::new();
    for node in 0..points {
        let bucket = &mut faces[starts[node] as usize..starts[node + 1] as usize];
        bucket.sort_unstable();
        let mut k = 0;
        while k < bucket.len() {
            let same = bucket[k..].iter().take_while(|f| f.0 == bucket[k].0 && f.1 == bucket[k].1).count();
            let opposed = same == 2 && bucket[k].3[1] != bucket[k + 1].3[1];
            match same {
                1 => outer.push((bucket[k].2, bucket[k].3)),
                2 if opposed => {}
                _ => return Err(Fault::Overlap { cell: bucket[k].2 as usize, nodes: bucket[k].3 }),
            }
            k += same;
        }
    }
    outer.sort_unstable();
    Ok(outer.into_iter().map(|(_, f)| f).collect())
}

/// The four faces of a positive cell, counter-clockwise seen from outside.
pub(crate) fn outward(c: [u32; 4]) -> [[u32; 3]; 4] {
    [[c[1], c[2], c[3]], [c[0], c[3], c[2]], [c[0], c[1], c[3]], [c[0], c[2], c[1]]]
}

/// Checks nodes (metres) and cells; returns the surface triangles, outward.
///
/// # Errors
/// The first [`Fault`] found, with the number of the node or cell.
pub fn check(points: &[Point], cells: &[[u32; 4]]) -> Result<Vec<[u32; 3]>, Fault> {
    if cells.is_empty() {
        return Err(Fault::Empty);
    }
    if let Some((node, &position)) = points.iter().enumerate().find(|(_, p)| !p.iter().all(|x| x.is_finite())) {
        return Err(Fault::NotFinite { node, position });
    }
    used_nodes(points, cells)?;
    duplicates(points)?;
    volumes(points, cells)?;
    let surface = surface(points.len(), cells)?;
    closed(&surface)?;
    joined(points.len(), cells)?;
    Ok(surface)
}

/// All cells hang together by their nodes.
fn joined(points: usize, cells: &[[u32; 4]]) -> Result<(), Fault> {
    let mut parent: Vec<u32> = (0..points as u32).collect();
    let mut root = |mut n: u32, to: Option<u32>| {
        while parent[n as usize] != n {
            let up = parent[parent[n as usize] as usize];
            parent[n as usize] = up;
            n = up;
        }
        if let Some(to) = to {
            parent[n as usize] = to;
        }
        n
    };
    for c in cells {
        for &n in &c[1..] {
            let to = root(c[0], None);
            root(n, Some(to));
        }
    }
    let first = root(0, None);
    let bodies = (0..points as u32).filter(|&n| root(n, None) == n).count();
    let apart = (0..points as u32).find(|&n| root(n, None) != first);
    apart.map_or(Ok(()), |node| Err(Fault::Separate { bodies, node: node as usize }))
}

fn used_nodes(points: &[Point], cells: &[[u32; 4]]) -> Result<(), Fault> {
    let mut used = vec![false; points.len()];
    for (cell, c) in cells.iter().enumerate() {
        for &v in c {
            let Some(flag) = used.get_mut(v as usize) else {
                return Err(Fault::UnknownNode { cell, node: v as usize, nodes: points.len() });
            };
            *flag = true;
        }
    }
    used.iter().position(|u| !u).map_or(Ok(()), |node| Err(Fault::Isolated { node, position: points[node] }))
}

fn duplicates(points: &[Point]) -> Result<(), Fault> {
    let mut order: Vec<u32> = (0..points.len() as u32).collect();
    let key = |i: u32| points[i as usize].map(|x| x + 0.0);
    order.sort_unstable_by(|&a, &b| {
        let (p, q) = (key(a), key(b));
        p[0].total_cmp(&q[0]).then(p[1].total_cmp(&q[1])).then(p[2].total_cmp(&q[2])).then(a.cmp(&b))
    });
    let at_one_place = order.windows(2).find(|w| key(w[0]) == key(w[1])).map(|w| [w[0] as usize, w[1] as usize]);
    at_one_place.map_or(Ok(()), |[first, second]| Err(Fault::Duplicate { first, second, position: points[first] }))
}

fn volumes(points: &[Point], cells: &[[u32; 4]]) -> Result<(), Fault> {
    for (cell, &nodes) in cells.iter().enumerate() {
        let p = nodes.map(|v| points[v as usize]);
        let volume = six_volumes(&p) / 6.0;
        let size = (1..4).map(|k| crate::vector::distance(p[k], p[0])).fold(0.0, f64::max);
        if volume.abs() <= 1e-12 * size.powi(3) {
            return Err(Fault::Flat { cell, nodes, volume });
        }
        if volume < 0.0 {
            return Err(Fault::Inverted { cell, nodes, volume });
        }
    }
    Ok(())
}

/// Every edge joins two triangles, and the triangles round every node form one fan.
fn closed(surface: &[[u32; 3]]) -> Result<(), Fault> {
    let mut edges: Vec<(u32, u32)> = surface
        .iter()
        .flat_map(|t| [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])])
        .map(|(a, b)| (a.min(b), a.max(b)))
        .collect();
    edges.sort_unstable();
    let mut k = 0;
    while k < edges.len() {
        let n = edges[k..].iter().take_while(|e| **e == edges[k]).count();
        if n != 2 {
            return Err(Fault::NonManifold { a: edges[k].0, b: edges[k].1, triangles: n });
        }
        k += n;
    }
    // Each triangle at a node leads from one neighbour to the next; the fan must be a single cycle.
    let mut links: Vec<(u32, u32, u32)> =
        surface.iter().flat_map(|t| [(t[0], t[1], t[2]), (t[1], t[2], t[0]), (t[2], t[0], t[1])]).collect();
    links.sort_unstable();
    let mut k = 0;
    while k < links.len() {
        let node = links[k].0;
        let n = links[k..].iter().take_while(|l| l.0 == node).count();
        let fan = &links[k..k + n];
        let (mut at, mut steps) = (fan[0].1, 0);
        while let Ok(i) = fan.binary_search_by(|l| l.1.cmp(&at)) {
            at = fan[i].2;
            steps += 1;
            if at == fan[0].1 || steps > n {
                break;
            }
        }
        if steps != n {
            return Err(Fault::Pinched { node });
        }
        k += n;
    }
    Ok(())
}
