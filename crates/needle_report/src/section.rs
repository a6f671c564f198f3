//! Geometry of the 3D view: the sample's surface, and half of it with the section along the instrument's axis.
//!
//! The section is made once, in the undeformed sample, by a vertical plane: y = entry.y, or the plane in which an
//! oblique needle moves. Its vertices lie on edges of cells and follow the interpolated displacement of the two
//! nodes. So the section shows the same material points at all times.

use std::collections::BTreeMap;

use needle_core::scene::Instrument;

/// A vertex on the edge between two nodes: (1 - t) a + t b.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct OnEdge {
    pub a: u32,
    pub b: u32,
    pub t: f64,
}

/// Triangles over vertices: first the drawn nodes of the mesh, then the vertices on edges.
#[derive(Debug, Default)]
pub(super) struct Section {
    /// Mesh index of each drawn node.
    pub nodes: Vec<u32>,
    /// Vertices on edges, between drawn nodes (indices into `nodes`).
    pub on_edges: Vec<OnEdge>,
    /// The whole surface.
    pub surface: Vec<[u32; 3]>,
    /// Surface of the half behind the plane.
    pub half: Vec<[u32; 3]>,
    /// The section that closes the half, seen from the front of the plane.
    pub cut: Vec<[u32; 3]>,
    /// Cell of each triangle of `surface`, `half` and `cut`.
    pub cell: [Vec<u32>; 3],
}

/// A vertical plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Plane {
    /// x and y of a point in it.
    entry: [f64; 2],
    /// Its direction from the x axis about z, rad, in (-pi/2, pi/2].
    pub azimuth: f64,
}

impl Plane {
    /// The plane in which the instrument moves; y = constant if it moves vertically, or without an instrument.
    pub(crate) fn of(instrument: Option<&Instrument>) -> Self {
        let Some(instrument) = instrument else { return Self { entry: [0.0; 2], azimuth: 0.0 } };
        let [x, y] = instrument.slope();
        // opposite directions give the same plane
        let azimuth = if x == 0.0 && y == 0.0 {
            0.0
        } else if x < 0.0 {
            (-y).atan2(-x)
        } else {
            y.atan2(x)
        };
        Self { entry: instrument.entry.map(|m| m.get()), azimuth }
    }

    /// Signed distance of a point behind it.
    fn behind(&self, p: &[f64; 3]) -> f64 {
        let (sin, cos) = self.azimuth.sin_cos();
        cos * (p[1] - self.entry[1]) - sin * (p[0] - self.entry[0])
    }

    /// Coordinate of a point along it: x for a plane y = constant.
    pub(crate) fn along(&self, p: &[f64; 3]) -> f64 {
        let (sin, cos) = self.azimuth.sin_cos();
        cos * p[0] + sin * p[1]
    }
}

impl Section {
    /// Cuts a mesh by a plane.
    pub(crate) fn new(points: &[[f64; 3]], cells: &[[u32; 4]], surface: &[[u32; 3]], plane: &Plane) -> Self {
        let span = points.iter().map(|p| plane.behind(p).abs()).fold(0.0, f64::max);
        // Nodes within rounding of the plane count as on it; otherwise the section would have slivers.
        let height = |i: u32| Some(plane.behind(&points[i as usize])).filter(|h| h.abs() >= 1e-9 * span).unwrap_or(0.0);
        let mut cutter = Cutter { height, section: Self::default(), drawn: BTreeMap::new(), corners: BTreeMap::new() };
        let of_face = faces(cells, surface);
        for triangle in surface {
            let whole = triangle.map(|i| cutter.node(i));
            cutter.section.surface.push(whole);
            cutter.clip(*triangle);
            let cell = of_face.get(&sorted(*triangle)).copied().flatten().unwrap_or(0);
            let Section { surface, half, cell: [of_surface, of_half, _], .. } = &mut cutter.section;
            of_surface.resize(surface.len(), cell);
            of_half.resize(half.len(), cell);
        }
        for (i, cell) in (0..).zip(cells) {
            cutter.slice(*cell);
            let Section { cut, cell: [.., of_cut], .. } = &mut cutter.section;
            of_cut.resize(cut.len(), i);
        }
        cutter.finish()
    }
}

fn sorted(mut triangle: [u32; 3]) -> [u32; 3] {
    triangle.sort_unstable();
    triangle
}

/// The cell behind each triangle of a surface.
fn faces(cells: &[[u32; 4]], surface: &[[u32; 3]]) -> BTreeMap<[u32; 3], Option<u32>> {
    let mut of: BTreeMap<[u32; 3], Option<u32>> = surface.iter().map(|t| (sorted(*t), None)).collect();
    for (i, &[a, b, c, d]) in (0..).zip(cells) {
        for face in [[a, b, c], [a, b, d], [a, c, d], [b, c, d]] {
            if let Some(cell) = of.get_mut(&sorted(face)) {
                *cell = Some(i);
            }
        }
    }
    of
}

/// Marks the index of a vertex on an edge until all drawn nodes are counted.
const ON_EDGE: u32 = 1 << 31;

struct Cutter<H> {
    height: H,
    section: Section,
    drawn: BTreeMap<u32, u32>,
    corners: BTreeMap<(u32, u32), u32>,
}

impl<H: Fn(u32) -> f64> Cutter<H> {
    /// Index of a mesh node among the drawn nodes.
    fn node(&mut self, i: u32) -> u32 {
        let nodes = &mut self.section.nodes;
        *self.drawn.entry(i).or_insert_with(|| {
            nodes.push(i);
            nodes.len() as u32 - 1
        })
    }

    /// Intersection of the plane with the edge between two mesh nodes on opposite sides.
    fn crossing(&mut self, i: u32, j: u32) -> u32 {
        let (i, j) = (i.min(j), i.max(j));
        let (hi, hj) = ((self.height)(i), (self.height)(j));
        if hi == 0.0 || hj == 0.0 {
            return self.node(if hi == 0.0 { i } else { j });
        }
        let (a, b) = (self.node(i), self.node(j));
        let on_edges = &mut self.section.on_edges;
        *self.corners.entry((i, j)).or_insert_with(|| {
            on_edges.push(OnEdge { a, b, t: hi / (hi - hj) });
            (on_edges.len() as u32 - 1) | ON_EDGE
        })
    }

    /// The part of a surface triangle behind the plane.
    fn clip(&mut self, triangle: [u32; 3]) {
        let mut polygon = Vec::with_capacity(4);
        for k in 0..3 {
            let (i, j) = (triangle[k], triangle[(k + 1) % 3]);
            let (hi, hj) = ((self.height)(i), (self.height)(j));
            if hi >= 0.0 {
                polygon.push(self.node(i));
            }
            if (hi < 0.0 && hj > 0.0) || (hi > 0.0 && hj < 0.0) {
                polygon.push(self.crossing(i, j));
            }
        }
        let half = fan(&polygon);
        self.section.half.extend(half);
    }

    /// The polygon in which the plane intersects a cell. A face in the plane belongs to the cell below it.
    fn slice(&mut self, cell: [u32; 4]) {
        let (below, above): (Vec<u32>, Vec<u32>) = cell.iter().partition(|&&i| (self.height)(i) < 0.0);
        let mut polygon: Vec<u32> = Vec::with_capacity(4);
        for (n, &i) in below.iter().enumerate() {
            // Every second row is reversed, so that the corners of a quadrilateral are in the order of its outline.
            let row: Vec<u32> = above.iter().map(|&j| self.crossing(i, j)).collect();
            if n % 2 == 0 { polygon.extend(row) } else { polygon.extend(row.into_iter().rev()) }
        }
        let cut = fan(&polygon);
        self.section.cut.extend(cut);
    }

    /// Numbers the vertices on edges after the drawn nodes.
    fn finish(self) -> Section {
        let Self { mut section, .. } = self;
        let base = section.nodes.len() as u32;
        for index in section.half.iter_mut().chain(&mut section.cut).flatten() {
            if *index & ON_EDGE != 0 {
                *index = base + (*index & !ON_EDGE);
            }
        }
        section
    }
}

/// Triangulates a convex polygon; triangles without area are left out.
fn fan(polygon: &[u32]) -> Vec<[u32; 3]> {
    let triangle = |k: usize| [polygon[0], polygon[k], polygon[k + 1]];
    let mut triangles: Vec<[u32; 3]> = (1..polygon.len().saturating_sub(1)).map(triangle).collect();
    triangles.retain(|[a, b, c]| a != b && b != c && a != c);
    triangles
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    /// Six tetrahedra of the cube [-1, 1]^3 about its diagonal from (-1, -1, -1) to (1, 1, 1).
    fn cube() -> (Vec<[f64; 3]>, Vec<[u32; 4]>) {
        let sign = |bit: usize| if bit == 0 { -1.0 } else { 1.0 };
        let points = (0..8).map(|i| [sign(i & 1), sign(i & 2), sign(i & 4)]).collect();
        let orders = [[1, 2, 4], [2, 1, 4], [1, 4, 2], [4, 1, 2], [2, 4, 1], [4, 2, 1]];
        (points, orders.iter().map(|[a, b, _]| [0, *a, a + b, 7]).collect())
    }

    fn area(section: &Section, points: &[[f64; 3]], triangles: &[[u32; 3]]) -> f64 {
        let node = |i: u32| points[section.nodes[i as usize] as usize];
        let vertex = |i: u32| match section.on_edges.get((i as usize).wrapping_sub(section.nodes.len())) {
            Some(e) => [0, 1, 2].map(|k| (1.0 - e.t) * node(e.a)[k] + e.t * node(e.b)[k]),
            None => node(i),
        };
        let double = |[p, q, r]: [[f64; 3]; 3]| {
            let [u, v] = [q, r].map(|x| [x[0] - p[0], x[1] - p[1], x[2] - p[2]]);
            let n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
            n.iter().map(|c| c * c).sum::<f64>().sqrt()
        };
        triangles.iter().map(|t| 0.5 * double(t.map(vertex))).sum()
    }

    fn boundary(cells: &[[u32; 4]]) -> Vec<[u32; 3]> {
        let faces = || cells.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, b, d], [a, c, d], [b, c, d]]);
        let key = |f: [u32; 3]| f.iter().map(|i| 1u32 << i).sum::<u32>();
        faces().filter(|f| faces().filter(|g| key(*g) == key(*f)).count() == 1).collect()
    }

    #[test]
    fn a_cube_cut_anywhere_is_closed_by_a_square() {
        let (points, cells) = cube();
        let surface = boundary(&cells);
        for y in [-0.9, -0.25, 0.0, 0.7] {
            let section = Section::new(&points, &cells, &surface, &Plane { entry: [0.0, y], azimuth: 0.0 });
            assert!((area(&section, &points, &section.surface) - 24.0).abs() < 1e-12);
            assert!((area(&section, &points, &section.cut) - 4.0).abs() < 1e-12, "cut at {y}");
            let half = 4.0 + 4.0 * 2.0 * (1.0 - y);
            assert!((area(&section, &points, &section.half) - half).abs() < 1e-12, "half at {y}");
        }
    }

    #[test]
    fn faces_in_the_plane_are_taken_once() {
        let (mut points, mut cells) = cube();
        let (above, above_cells) = cube();
        points.extend(above.iter().map(|p| [p[0], p[1] + 2.0, p[2]]));
        cells.extend(above_cells.iter().map(|c| c.map(|i| i + 8)));
        let section = Section::new(&points, &cells, &[], &Plane { entry: [0.0, 1.0], azimuth: 0.0 });
        assert!(section.on_edges.is_empty(), "all corners are nodes");
        assert!((area(&section, &points, &section.cut) - 4.0).abs() < 1e-12);
    }

    #[test]
    fn an_oblique_needle_lies_in_its_plane() {
        let scene = needle_core::scene::Scene::preset("needle_insertion").unwrap();
        let tilted = |azimuth: &str| {
            let keys = [
                ("instrument.tilt_rad", "0.3"),
                ("instrument.azimuth_rad", azimuth),
                ("discretisation.dimension", "full"),
            ];
            let keys = keys.map(|(key, value)| needle_core::scene::Override::text(key, value, "test"));
            let instrument = scene.with(&keys).unwrap().instrument.unwrap();
            let [x, y] = instrument.slope();
            (Plane::of(Some(&instrument)), [0.01 * x, 0.01 * y, 0.0])
        };
        for azimuth in ["0.0", "0.7", "-1.2", "2.5", "3.0"] {
            let (plane, tip) = tilted(azimuth);
            assert!(plane.behind(&tip).abs() < 1e-12 && plane.along(&tip).abs() > 2e-3, "{azimuth}");
        }
        assert_eq!(Plane::of(scene.instrument.as_ref()).azimuth, 0.0);
    }
}
