//! A body whose shape a mesh of tetrahedra gives: what lies inside, how deep, and where its surface and the interfaces between its groups
//! are. The mesh's own nodes do not matter beyond that.

use crate::Cloud;
use crate::error::CloudError;
use crate::faces::{INTERFACE, SIDE};
use crate::path::Axis;
use crate::quality::six_volumes;
use crate::tree::Tree;
use crate::vector::{Point, add, bounds, cross, dot, norm, scale, sub};
use std::cell::Cell;
use std::collections::BTreeMap;

/// Cosine of the angle between the normals of two triangles from which their edge is a crease: 40 degrees.
const CREASE: f64 = 0.766;
/// Barycentric coordinates from which a point counts as inside a tetrahedron.
const INSIDE: f64 = -1e-9;

/// A triangle of the surface, or of an interface.
#[derive(Clone, Debug, PartialEq)]
struct Wall {
    corners: [Point; 3],
    /// The one face that it is part of.
    face: u8,
}

/// A line of the surface where faces meet at an angle, or two faces or a face and an interface meet.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Crease {
    pub(crate) ends: [Point; 2],
    /// Bits of the faces on both sides.
    pub(crate) faces: u8,
}

/// Shape of a body, from a mesh of it. Lengths in metres; the body stands on z = 0.
#[derive(Clone, Debug, PartialEq)]
pub struct Outline {
    points: Vec<Point>,
    cells: Vec<[u32; 4]>,
    group: Vec<u32>,
    walls: Vec<Wall>,
    pub(crate) creases: Vec<Crease>,
    pub(crate) bounds: (Point, Point),
    /// z where the instrument meets the body, m.
    pub(crate) top: f64,
    pub(crate) volume: f64,
    volumes: Tree,
    /// Of a surface alone: its walls by the columns over their shadows on z = 0.
    columns: Tree,
    /// Walls of each face, [`INTERFACE`] last.
    trees: Vec<(u8, Tree)>,
    /// What each group asks for at its boundary within the body.
    inclusions: Vec<Inclusion>,
}

/// A group of cells that is enclosed by others, in part at least.
#[derive(Clone, Debug, PartialEq)]
struct Inclusion {
    walls: Tree,
    /// Largest spacing of nodes there, m.
    spacing: f64,
}

impl Outline {
    /// Of a mesh with the group of each cell (any numbers), and z where an instrument meets it. What lies lowest must lie on z = 0.
    /// Of a mesh without cells its surface, which has to be closed, bounds the body; it is one cell then.
    #[must_use]
    pub fn new(mesh: &Cloud, group: Vec<u32>, top: f64) -> Self {
        let group = if mesh.cells.is_empty() { vec![0] } else { group };
        let at = |n: u32| mesh.points[n as usize];
        let surface = mesh.surface.iter().zip(&mesh.surface_faces);
        let mut walls: Vec<Wall> = surface.map(|(t, &face)| Wall { corners: t.map(at), face }).collect();
        let outer = walls.len();
        let (between, sides) = interfaces(&mesh.cells, &group);
        walls.extend(between.iter().map(|t| Wall { corners: t.map(at), face: INTERFACE }));
        let of_cells: Vec<[Point; 2]> = mesh.cells.iter().map(|c| bounds(&c.map(at))).collect();
        let [low, high] = bounds(&mesh.points);
        Self {
            creases: creases(mesh, &between),
            volume: if mesh.cells.is_empty() { enclosed(&walls) } else { mesh.volumes().iter().sum() },
            columns: if mesh.cells.is_empty() { columns(&walls, [low, high]) } else { Tree::default() },
            trees: trees(&walls),
            inclusions: inclusions(&walls, &sides, outer, &mesh.volumes(), &group),
            volumes: Tree::new(&of_cells),
            points: mesh.points.clone(),
            cells: mesh.cells.clone(),
            bounds: (low, high),
            group,
            walls,
            top,
        }
    }

    /// The mesh's cell that holds a point.
    #[must_use]
    pub fn cell_at(&self, p: Point) -> Option<u32> {
        if self.cells.is_empty() {
            return self.encloses(p).then_some(0);
        }
        let holds = |cell: u32| {
            let c = self.cells[cell as usize].map(|n| self.points[n as usize]);
            let whole = six_volumes(&c);
            (0..4).all(|k| {
                let mut part = c;
                part[k] = p;
                six_volumes(&part) >= INSIDE * whole
            })
        };
        self.volumes.find(p, 1e-9 * self.top, holds)
    }

    /// Whether a surface alone has the point inside: it is above a point an odd number of times.
    fn encloses(&self, [x, y, z]: Point) -> bool {
        // a little aside, so that no edge stands above the point
        let off = 1e-7 * (self.bounds.1[2] - self.bounds.0[2]);
        let p = [x + off, y + 0.618 * off, z];
        let above = Cell::new(false);
        self.columns.find(p, 0.0, |i| {
            if self.walls[i as usize].height([p[0], p[1]]).is_some_and(|height| height > z) {
                above.set(!above.get());
            }
            false
        });
        above.get()
    }

    /// Group at a point; `None` outside.
    pub(crate) fn group_at(&self, p: Point) -> Option<u32> {
        self.cell_at(p).map(|cell| self.group[cell as usize])
    }

    /// Distance to the surface, negative outside.
    pub(crate) fn depth(&self, p: Point) -> f64 {
        self.signed(p, self.to_skin(p))
    }

    /// Distance to surface or interface, whichever is nearer, or `reach` if both are further; negative outside.
    pub(crate) fn room(&self, p: Point, reach: f64) -> f64 {
        let nearer = |least: f64, (_, tree): &(u8, Tree)| self.within(tree, p, least).map_or(least, |(_, d)| d);
        self.signed(p, self.trees.iter().fold(reach, nearer))
    }

    fn signed(&self, p: Point, d: f64) -> f64 {
        if self.cell_at(p).is_some() { d } else { -d }
    }

    fn to_skin(&self, p: Point) -> f64 {
        let skin = self.trees.iter().filter(|(face, _)| *face != INTERFACE);
        skin.filter_map(|(_, tree)| self.nearest(tree, p)).map(|(_, d)| d).fold(f64::INFINITY, f64::min)
    }

    /// Largest spacing up to `most` that the groups' boundaries allow at a point, with this growth of it per metre.
    pub(crate) fn spacing(&self, p: Point, growth: f64, most: f64) -> f64 {
        self.inclusions.iter().fold(most, |least, inclusion| {
            let reach = (least - inclusion.spacing) / growth;
            let near = if reach > 0.0 { self.within(&inclusion.walls, p, reach) } else { None };
            near.map_or(least, |(_, d)| least.min(inclusion.spacing + growth * d))
        })
    }

    /// Distance to the nearest interface; infinite without any.
    pub(crate) fn interface_distance(&self, p: Point) -> f64 {
        self.tree(INTERFACE).and_then(|tree| self.nearest(tree, p)).map_or(f64::INFINITY, |(_, d)| d)
    }

    /// Whether groups meet in it.
    pub(crate) fn has_interfaces(&self) -> bool {
        self.tree(INTERFACE).is_some()
    }

    fn tree(&self, face: u8) -> Option<&Tree> {
        self.trees.iter().find(|(f, _)| *f == face).map(|(_, tree)| tree)
    }

    fn nearest(&self, tree: &Tree, p: Point) -> Option<(u32, f64)> {
        self.within(tree, p, f64::INFINITY)
    }

    /// The nearest wall of a tree that is no further than this, and how far.
    fn within(&self, tree: &Tree, p: Point, reach: f64) -> Option<(u32, f64)> {
        tree.nearest(p, reach, |i| squared(p, self.walls[i as usize].closest(p))).map(|(i, d)| (i, d.sqrt()))
    }

    /// The nearest point of a face, and the unit normal there.
    pub(crate) fn on(&self, face: u8, p: Point) -> Option<(Point, Point)> {
        let (i, _) = self.nearest(self.tree(face)?, p)?;
        let wall = &self.walls[i as usize];
        Some((wall.closest(p), wall.normal()))
    }

    /// Face of the surface that is nearest to a point.
    pub(crate) fn face_at(&self, p: Point) -> u8 {
        let skin = self.trees.iter().filter(|(face, _)| *face != INTERFACE);
        let near = skin.filter_map(|(face, tree)| self.nearest(tree, p).map(|(_, d)| (*face, d)));
        near.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(SIDE, |(face, _)| face)
    }

    /// Faces that there are, interfaces last.
    pub(crate) fn faces(&self) -> Vec<u8> {
        self.trees.iter().map(|(face, _)| *face).collect()
    }

    /// Corners of a face's triangles.
    pub(crate) fn corners(&self, face: u8) -> impl Iterator<Item = Point> {
        self.walls.iter().filter(move |w| w.face == face).flat_map(|w| w.corners)
    }

    /// z of the face's highest point above or below a place.
    pub(crate) fn height_of(&self, face: u8, [x, y]: [f64; 2]) -> Option<f64> {
        self.walls.iter().filter(|w| w.face == face).filter_map(|w| w.height([x, y])).reduce(f64::max)
    }

    /// Length of an axis within the body, m.
    #[must_use]
    pub fn length_along(&self, axis: &Axis) -> f64 {
        let step = 1e-3 * self.top;
        let inside = |k: &usize| self.cell_at(axis.section(self.top, *k as f64 * step, 0.0, 0.0)).is_some();
        (1..2000).find(|k| !inside(k)).unwrap_or(2000) as f64 * step * axis.secant()
    }

    /// # Errors
    /// The cylinder of this radius round an axis leaves the body within this length.
    pub(crate) fn holds_path(&self, axis: &Axis, radius: f64, length: f64) -> Result<(), CloudError> {
        const STEPS: usize = 64;
        let down = length / axis.secant();
        // where it enters the surface may be inclined by 45 degrees
        let first = radius.min(0.5 * down);
        for k in 0..=STEPS {
            let depth = first + (down - first) * k as f64 / STEPS as f64;
            for turn in 0..8 {
                let p = axis.section(self.top, depth, radius, f64::from(turn) / 8.0);
                if self.cell_at(p).is_none() {
                    let rule = format!(
                        "the path, with what the needle captures, leaves the mesh {depth:.6} m below the surface, at {p:?} m (z from the \
                         lowest point): move the entry, or end the motion before"
                    );
                    return Err(CloudError::OutOfRange { key: "path length", value: length, rule });
                }
            }
        }
        Ok(())
    }
}

impl Wall {
    /// The nearest point (Ericson, Real-Time Collision Detection, 5.1.5).
    fn closest(&self, p: Point) -> Point {
        let [a, b, c] = self.corners;
        let (ab, ac, ap) = (sub(b, a), sub(c, a), sub(p, a));
        let (d1, d2) = (dot(ab, ap), dot(ac, ap));
        if d1 <= 0.0 && d2 <= 0.0 {
            return a;
        }
        let bp = sub(p, b);
        let (d3, d4) = (dot(ab, bp), dot(ac, bp));
        if d3 >= 0.0 && d4 <= d3 {
            return b;
        }
        let vc = d1 * d4 - d3 * d2;
        if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
            return add(a, scale(ab, d1 / (d1 - d3)));
        }
        let cp = sub(p, c);
        let (d5, d6) = (dot(ab, cp), dot(ac, cp));
        if d6 >= 0.0 && d5 <= d6 {
            return c;
        }
        let vb = d5 * d2 - d1 * d6;
        if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
            return add(a, scale(ac, d2 / (d2 - d6)));
        }
        let va = d3 * d6 - d5 * d4;
        if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
            return add(b, scale(sub(c, b), (d4 - d3) / ((d4 - d3) + (d5 - d6))));
        }
        let whole = va + vb + vc;
        add(a, add(scale(ab, vb / whole), scale(ac, vc / whole)))
    }

    fn area(&self) -> f64 {
        let [a, b, c] = self.corners;
        0.5 * norm(cross(sub(b, a), sub(c, a)))
    }

    fn normal(&self) -> Point {
        let [a, b, c] = self.corners;
        let n = cross(sub(b, a), sub(c, a));
        let length = norm(n);
        if length > 0.0 { scale(n, 1.0 / length) } else { [0.0, 0.0, 1.0] }
    }

    /// z above or below a place.
    fn height(&self, [x, y]: [f64; 2]) -> Option<f64> {
        let [a, b, c] = self.corners;
        let area = |p: Point, q: Point| (p[0] - x) * (q[1] - y) - (p[1] - y) * (q[0] - x);
        let [u, v, w] = [area(b, c), area(c, a), area(a, b)];
        let whole = u + v + w;
        let inside = whole != 0.0 && [u, v, w].iter().all(|part| part / whole >= INSIDE);
        inside.then(|| (u * a[2] + v * b[2] + w * c[2]) / whole)
    }
}

/// Volume within a closed surface that looks outward.
fn enclosed(walls: &[Wall]) -> f64 {
    walls.iter().map(|Wall { corners: [a, b, c], .. }| dot(*a, cross(*b, *c))).sum::<f64>() / 6.0
}

/// A tree in which each wall is as high as the body.
fn columns(walls: &[Wall], [low, high]: [Point; 2]) -> Tree {
    let column = |wall: &Wall| {
        let [mut from, mut to] = bounds(&wall.corners);
        (from[2], to[2]) = (low[2] - high[2].abs(), 2.0 * high[2].abs());
        [from, to]
    };
    Tree::new(&walls.iter().map(column).collect::<Vec<_>>())
}

fn squared(p: Point, q: Point) -> f64 {
    let d = sub(p, q);
    dot(d, d)
}

fn trees(walls: &[Wall]) -> Vec<(u8, Tree)> {
    let mut faces: Vec<u8> = walls.iter().map(|w| w.face).collect();
    faces.sort_unstable();
    faces.dedup();
    let tree = |face: u8| tree_of(walls, (0..walls.len() as u32).filter(|&i| walls[i as usize].face == face));
    faces.into_iter().map(|face| (face, tree(face))).collect()
}

fn tree_of(walls: &[Wall], items: impl Iterator<Item = u32>) -> Tree {
    let items: Vec<u32> = items.collect();
    let boxes: Vec<[Point; 2]> = items.iter().map(|&i| bounds(&walls[i as usize].corners)).collect();
    Tree::new(&boxes).renamed(&items)
}

/// Spacing at the boundary of a group over 3 V/A, its volume over its area there: the radius of a ball, three quarters of the thickness of
/// a tube, three halves of a plate's.
const ACROSS: f64 = 1.0;

/// What each group but the largest asks for, by the triangles between groups, from `outer` on, and the groups on both sides of each.
fn inclusions(walls: &[Wall], sides: &[[u32; 2]], outer: usize, volumes: &[f64], group: &[u32]) -> Vec<Inclusion> {
    let mut volume: BTreeMap<u32, f64> = BTreeMap::new();
    volumes.iter().zip(group).for_each(|(v, g)| *volume.entry(*g).or_default() += v);
    let largest = volume.iter().max_by(|a, b| a.1.total_cmp(b.1)).map(|(g, _)| *g);
    let of = |(&g, v): (&u32, &f64)| {
        let own = || (outer..walls.len()).filter(|&i| sides[i - outer].contains(&g));
        let area: f64 = own().map(|i| walls[i].area()).sum();
        Inclusion { walls: tree_of(walls, own().map(|i| i as u32)), spacing: ACROSS * 3.0 * v / area }
    };
    volume.iter().filter(|(g, _)| Some(**g) != largest).map(of).collect()
}

/// Triangles between cells of different groups, and those groups.
fn interfaces(cells: &[[u32; 4]], group: &[u32]) -> (Vec<[u32; 3]>, Vec<[u32; 2]>) {
    let mut seen: BTreeMap<[u32; 3], u32> = BTreeMap::new();
    let (mut between, mut sides) = (Vec::new(), Vec::new());
    for (c, &group) in cells.iter().zip(group) {
        for k in 0..4 {
            let mut t = [c[(k + 1) % 4], c[(k + 2) % 4], c[(k + 3) % 4]];
            t.sort_unstable();
            match seen.remove(&t) {
                Some(other) if other != group => {
                    between.push(t);
                    sides.push([other, group]);
                }
                Some(_) => {}
                None => {
                    seen.insert(t, group);
                }
            }
        }
    }
    (between, sides)
}

/// Edges of the surface that are sharp, part two faces, or border an interface.
fn creases(mesh: &Cloud, between: &[[u32; 3]]) -> Vec<Crease> {
    let at = |n: u32| mesh.points[n as usize];
    let edges = |t: &[u32; 3]| [0, 1, 2].map(|k| [t[k].min(t[(k + 1) % 3]), t[k].max(t[(k + 1) % 3])]);
    // the first triangle at an edge, until the second comes
    let mut first: BTreeMap<[u32; 2], (Point, u8)> = BTreeMap::new();
    let bordering: std::collections::BTreeSet<[u32; 2]> = between.iter().flat_map(edges).collect();
    let mut creases = Vec::new();
    for (t, &face) in mesh.surface.iter().zip(&mesh.surface_faces) {
        let normal = Wall { corners: t.map(at), face }.normal();
        for edge in edges(t) {
            let Some((other, of_other)) = first.remove(&edge) else {
                first.insert(edge, (normal, face));
                continue;
            };
            let border = bordering.contains(&edge);
            if dot(normal, other) < CREASE || face != of_other || border {
                let faces = face | of_other | if border { INTERFACE } else { 0 };
                creases.push(Crease { ends: edge.map(at), faces });
            }
        }
    }
    creases
}
