//! Shape functions of an axisymmetric field u = (u_r, 0, u_z)(r, z), and the table that the kernel reads for them.
//!
//! At azimuth zero, with phi_j fitted in the half plane, the displacement gradient of such a field is
//!
//! ```text
//!        | u_r,r    0     u_r,z |
//! H  =   |   0    u_r/r     0   |      row of the table: node j, (phi_j,r, phi_j / r, phi_j,z)
//!        | u_z,r    0     u_z,z |
//! ```
//!
//! (Bathe, Finite Element Procedures, section 5.3.1; the hoop strain u_r/r stands in the table's y.) A point stands for
//! its share of the ring, V = 2 pi r A, so forces are those of the whole body.
//!
//! *Symmetry.* The field goes on beyond the axis: u_r is odd in r and u_z even. So the support of a point near the axis
//! holds images of nodes at -r as well, with parameters (-u_r, 0, u_z): no support is one-sided there, and u_r/r stays
//! finite. A node on the axis is its own image; half of it stands for each, and its u_r drops out of field and force by
//! itself. In the table, image of node j is entry `nodes + j`.

use std::cell::RefCell;
use std::f64::consts::PI;

use rayon::prelude::*;

use super::error::ApproximationError;
use super::mirrored::MirroredSupports;
use super::mls::{Fit, Neighbour};
use super::regions::Regions;
use super::repair::{self, Supported};
use super::support::{radii, within_reach};
use super::table::{Form, Row, Settings, ShapeTable};
use crate::mirror::Mirror;

/// The nodes (r, 0, z) of a half plane with their images at -r.
#[must_use]
pub fn in_half_plane(points: &[[f64; 3]], radii: &[f64], interpolating: &[bool]) -> MirroredSupports {
    let on_axis = points.iter().map(|p| p[0] == 0.0).collect();
    MirroredSupports::new(points, radii, interpolating, Some(Mirror::along([0.0, -1.0])), on_axis)
}

/// Rows of the field at points of the half plane: phi_j for u_r and for u_z.
#[derive(Clone, Debug, Default)]
pub struct MeridianField {
    /// Offsets, one more than rows.
    pub start: Vec<u32>,
    /// Support nodes.
    pub nodes: Vec<u32>,
    /// Odd and even shape function.
    pub value: Vec<[f64; 2]>,
}

impl MeridianField {
    /// (u_r, 0, u_z) of row `i` for nodal parameters `u`.
    #[must_use]
    pub fn at(&self, i: usize, u: &[[f64; 3]]) -> [f64; 3] {
        let mut v = [0.0; 3];
        for e in self.start[i] as usize..self.start[i + 1] as usize {
            let u = &u[self.nodes[e] as usize];
            v[0] += self.value[e][0] * u[0];
            v[2] += self.value[e][1] * u[2];
        }
        v
    }
}

/// The approximation on one half plane.
#[derive(Clone, Debug)]
pub struct AxisymmetricApproximation {
    points: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
    settings: Settings,
    supports: MirroredSupports,
    /// Radii before any repair, m.
    first: Vec<f64>,
    /// Triangles that get a single point.
    plain: Vec<bool>,
    /// [`ShapeTable::filled`].
    filled: Vec<bool>,
    regions: Regions,
}

thread_local! {
    static SCRATCH: RefCell<(Vec<Neighbour>, Fit)> = RefCell::new((Vec::new(), Fit::default()));
}

impl AxisymmetricApproximation {
    /// Indexes the nodes (r, 0, z) and triangles of a half plane; `interpolating` marks nodes whose nodal value must be
    /// the field's value.
    #[must_use]
    pub fn new(points: &[[f64; 3]], triangles: &[[u32; 3]], interpolating: &[bool], settings: Settings) -> Self {
        let first = radii(points, triangles, settings.support_factor);
        let supports = in_half_plane(points, &first, interpolating);
        let plain = vec![false; triangles.len()];
        let regions = Regions::default();
        Self {
            points: points.to_vec(),
            triangles: triangles.to_vec(),
            settings,
            supports,
            first,
            plain,
            filled: Vec::new(),
            regions,
        }
    }

    /// Ends supports at the interfaces between regions, `region` being that of each triangle (see [`super::regions`]).
    #[must_use]
    pub fn with_regions(mut self, region: &[u8]) -> Self {
        self.regions = Regions::new(&self.points, &self.triangles, region);
        self.regions.scale(&self.triangles, &mut self.first);
        self.supports = self.supports.with_radii(&self.first);
        self
    }

    /// Gives the triangles between these nodes one point each: enough for tissue whose place a needle takes.
    #[must_use]
    pub fn with_plain(mut self, nodes: &[u32]) -> Self {
        self.plain = self.between(nodes);
        self
    }

    /// Tells the triangles between these nodes as those that a needle comes to fill.
    #[must_use]
    pub fn with_filled(mut self, nodes: &[u32]) -> Self {
        self.filled = self.between(nodes);
        self
    }

    /// Whether all corners of each triangle are among these nodes.
    fn between(&self, nodes: &[u32]) -> Vec<bool> {
        let mut among = vec![false; self.points.len()];
        nodes.iter().for_each(|&n| among[n as usize] = true);
        self.triangles.iter().map(|t| t.iter().all(|&n| among[n as usize])).collect()
    }

    /// The shape table of the triangles, with the supports as they are.
    ///
    /// # Errors
    /// [`ApproximationError`] where the support does not determine the fit.
    pub fn table(&self) -> Result<ShapeTable, ApproximationError> {
        repair::table(self)
    }

    /// The shape table after bad supports were enlarged, so that there is a field at `also` as well.
    ///
    /// # Errors
    /// [`ApproximationError`] where no support determines the fit.
    pub fn repaired_table(&mut self, also: &[[f64; 3]]) -> Result<ShapeTable, ApproximationError> {
        repair::repaired(self, also)
    }

    /// Number of nodes whose support was enlarged.
    #[must_use]
    pub fn repaired_supports(&self) -> usize {
        self.supports.radii().iter().zip(&self.first).filter(|(now, first)| now > first).count()
    }

    /// The field at points (r, 0, z) of the half plane; with linear triangles the one that holds the point decides.
    ///
    /// # Errors
    /// [`ApproximationError`] as above.
    pub fn field(&self, at: &[[f64; 3]]) -> Result<MeridianField, ApproximationError> {
        let rows: Vec<Vec<Entry>> = at.par_iter().map(|&x| self.entries_at(x)).collect::<Result<_, _>>()?;
        let mut field = MeridianField { start: vec![0], ..MeridianField::default() };
        for row in rows {
            for e in row {
                field.nodes.push(e.node);
                field.value.push([if e.image { -e.value } else { e.value }, e.value]);
            }
            field.start.push(field.nodes.len() as u32);
        }
        Ok(field)
    }

    fn corners(&self, t: &[u32; 3]) -> [[f64; 3]; 3] {
        t.map(|n| self.points[n as usize])
    }

    fn triangle(&self, cell: usize, rule: &[Gauss]) -> Result<Vec<Row>, ApproximationError> {
        let t = &self.triangles[cell];
        let x = self.corners(t);
        let (area, _) = triangle(&x);
        rule.iter()
            .map(|(bary, weight)| {
                let at: [f64; 3] = std::array::from_fn(|k| (0..3).map(|a| bary[a] * x[a][k]).sum());
                let entries = self.entries(at, self.regions.of_cell(cell), Some(t))?;
                let slot = |e: &Entry| if e.image { e.node + self.points.len() as u32 } else { e.node };
                let squares = if self.settings.basis.is_some() { self.squares(&entries) } else { 0.0 };
                Ok(Row {
                    at,
                    squares,
                    volume: 2.0 * PI * at[0] * weight * area,
                    nodes: entries.iter().map(slot).collect(),
                    gradient: entries.iter().map(|e| [e.slope[0], e.value / at[0], e.slope[2]]).collect(),
                })
            })
            .collect()
    }

    /// phi at a node or in the triangle that holds x: on an interface the mean of what its regions have there.
    fn entries_at(&self, x: [f64; 3]) -> Result<Vec<Entry>, ApproximationError> {
        let regions = self.regions.at(x, |cell| {
            let corners = self.corners(&self.triangles[cell]);
            let (_, slope) = triangle(&corners);
            let value = |a: usize| {
                let from = corners[(a + 1) % 3];
                (0..3).map(|k| slope[a][k] * (x[k] - from[k])).sum::<f64>()
            };
            (0..3).map(value).fold(f64::INFINITY, f64::min)
        });
        let share = 1.0 / regions.len() as f64;
        let mut all = Vec::new();
        for region in regions {
            let scaled = |e: Entry| Entry { value: share * e.value, slope: e.slope.map(|s| share * s), ..e };
            all.extend(self.entries(x, region, None)?.into_iter().map(scaled));
        }
        Ok(all)
    }

    /// phi of every node and image at x in a region, and its slope; linear triangles take `within`, or the one that holds x.
    fn entries(&self, x: [f64; 3], region: u8, within: Option<&[u32; 3]>) -> Result<Vec<Entry>, ApproximationError> {
        let Some(basis) = self.settings.basis else { return Ok(self.linear(x, within)) };
        SCRATCH.with_borrow_mut(|(neighbours, fit)| {
            self.supports.at(x, neighbours);
            within_reach(neighbours);
            self.regions.keep(region, neighbours, |n| self.supports.node(n).0);
            fit.evaluate_in_plane(neighbours, basis, true).map_err(|_| repair::refusal(x, neighbours, 2))?;
            let mut entries = Vec::with_capacity(neighbours.len());
            for (i, n) in neighbours.iter().enumerate() {
                let (node, image) = self.supports.node(n.node);
                self.push(Entry { node, image, value: fit.value[i], slope: fit.gradient[i] }, &mut entries);
            }
            Ok(entries)
        })
    }

    /// Halves a node on the axis between itself and its image.
    fn push(&self, e: Entry, entries: &mut Vec<Entry>) {
        if self.supports.is_on_plane(e.node) {
            let half = Entry { value: 0.5 * e.value, slope: e.slope.map(|s| 0.5 * s), ..e };
            entries.extend([half, Entry { image: true, ..half }]);
        } else {
            entries.push(e);
        }
    }

    /// sum_j |grad phi_j|^2 in the half plane, 1/m^2; the two halves of a node on the axis have half the square of the whole.
    fn squares(&self, entries: &[Entry]) -> f64 {
        let of = |e: &Entry| {
            (e.slope[0].powi(2) + e.slope[2].powi(2)) * if self.supports.is_on_plane(e.node) { 2.0 } else { 1.0 }
        };
        entries.iter().map(of).sum()
    }

    fn linear(&self, x: [f64; 3], within: Option<&[u32; 3]>) -> Vec<Entry> {
        let mut best = (f64::NEG_INFINITY, Vec::new());
        for t in within.map_or(self.triangles.as_slice(), std::slice::from_ref) {
            let corners = self.corners(t);
            let (_, slope) = triangle(&corners);
            let value: [f64; 3] = std::array::from_fn(|a| {
                let b = corners[(a + 1) % 3];
                (0..3).map(|k| slope[a][k] * (x[k] - b[k])).sum()
            });
            let least = value.iter().copied().fold(f64::INFINITY, f64::min);
            if least > best.0 {
                best = (least, Vec::new());
                for a in 0..3 {
                    self.push(Entry { node: t[a], image: false, value: value[a], slope: slope[a] }, &mut best.1);
                }
            }
        }
        best.1
    }
}

impl Supported for AxisymmetricApproximation {
    fn form(&self) -> Form {
        Form::Axisymmetric
    }

    fn cells(&self) -> usize {
        self.triangles.len()
    }

    fn cell(&self, cell: usize) -> Result<Vec<Row>, ApproximationError> {
        let t = &self.triangles[cell];
        let on_axis = t.iter().any(|&n| self.points[n as usize][0] == 0.0);
        let points = self.settings.points_per_cell;
        match (self.plain[cell], on_axis) {
            (true, _) => self.triangle(cell, &CENTRE),
            (false, true) if self.filled.get(cell).copied().unwrap_or(false) => {
                let on = t.map(|n| self.points[n as usize][0] == 0.0);
                let one = on.iter().filter(|&&x| x).count() == 1;
                let apex = on.iter().position(|&x| x == one).unwrap_or(0);
                self.triangle(cell, &conical(apex, one))
            }
            (false, true) => self.triangle(cell, &gauss_points(points.max(4))),
            (false, false) => self.triangle(cell, &gauss_points(points)),
        }
    }

    fn region(&self) -> &[u8] {
        self.regions.of_cells()
    }

    fn filled(&self) -> &[bool] {
        &self.filled
    }

    fn edge(&self, cell: usize) -> f64 {
        repair::mean_edge(&self.corners(&self.triangles[cell]))
    }

    fn determined(&self, x: [f64; 3]) -> Result<(), ApproximationError> {
        self.settings.basis.map_or(Ok(()), |_| self.entries_at(x).map(|_| ()))
    }

    fn enlarge(&mut self, factor: f64, at: &[[f64; 3]]) {
        self.supports = self.supports.enlarged(&self.first, factor, at);
    }
}

/// Barycentric place and weight of an integration point.
type Gauss = ([f64; 3], f64);

/// A single point.
const CENTRE: [Gauss; 1] = [([1.0 / 3.0; 3], 1.0)];

/// phi of one node, or of its image, at a point.
#[derive(Clone, Copy)]
struct Entry {
    node: u32,
    image: bool,
    value: f64,
    slope: [f64; 3],
}

/// Area and gradients of the three barycentric coordinates of a triangle (r, 0, z), counter-clockwise with r to the
/// right.
#[must_use]
pub fn triangle(x: &[[f64; 3]; 3]) -> (f64, [[f64; 3]; 3]) {
    let side = |a: usize| {
        let (b, c) = (x[(a + 1) % 3], x[(a + 2) % 3]);
        [c[0] - b[0], c[2] - b[2]]
    };
    let [first, second] = [side(0), side(1)];
    let twice = first[0] * second[1] - first[1] * second[0];
    let slope = |a: usize| {
        let [dr, dz] = side(a);
        [-dz / twice, 0.0, dr / twice]
    };
    (0.5 * twice, [slope(0), slope(1), slope(2)])
}

/// Barycentric points and weights of a triangle: 3 of degree 2, 6 of degree 4 (Dunavant 1985) or 7 of degree 5 (Radon
/// 1948), where a tetrahedron has 1, 4 or 5. So there are as many points per node as in space, where a node has 5.5
/// cells and not 2: with a single point per triangle an indentation loses 12% of its force past 4 mm. Triangles at the axis
/// get six at least: their rings weigh next to nothing, so with three the nodes on the axis wobble by 1.3% of the depth.
fn gauss_points(n: u32) -> Vec<Gauss> {
    let vertex = |a: f64, weight: f64| {
        (0..3).map(move |i| (std::array::from_fn(|k| if k == i { a } else { 0.5 * (1.0 - a) }), weight))
    };
    let root = 15f64.sqrt();
    match n {
        4 => vertex(0.816_847_572_980_459, 0.109_951_743_655_322)
            .chain(vertex(0.108_103_018_168_070, 0.223_381_589_678_011))
            .collect(),
        5 => std::iter::once(([1.0 / 3.0; 3], 0.225))
            .chain(vertex((9.0 + 2.0 * root) / 21.0, (155.0 - root) / 1200.0))
            .chain(vertex((9.0 - 2.0 * root) / 21.0, (155.0 + root) / 1200.0))
            .collect(),
        _ => vertex(2.0 / 3.0, 1.0 / 3.0).collect(),
    }
}

/// Two by two points on lines from a corner `apex` of a triangle at the axis: of degree 3 with the radius as weight, which the points'
/// volumes have as a factor (Stroud, Approximate Calculation of Multiple Integrals, 1971, section 2.4). `one`: the apex is the only
/// corner on the axis; otherwise it is the only one off it. s, the share of the way from the apex, by the Gauss-Jacobi points for s^2 or
/// s (1 - s).
fn conical(apex: usize, one: bool) -> Vec<Gauss> {
    let along = if one {
        let half = 0.1f64.sqrt() / 1.5;
        [-half, half].map(|x| (2.0 / 3.0 + x, (1.0 / 6.0 + x / (72.0 * half * half)) / (2.0 / 3.0 + x)))
    } else {
        let half = 0.2f64.sqrt() / 2.0;
        [-half, half].map(|x| (0.5 + x, 1.0 / 12.0 / (0.5 - x)))
    };
    let across = [0.5 - 0.5 / 3f64.sqrt(), 0.5 + 0.5 / 3f64.sqrt()];
    let point = |(s, weight): (f64, f64), t: f64| {
        let mut at = [0.0; 3];
        (at[apex], at[(apex + 1) % 3], at[(apex + 2) % 3]) = (1.0 - s, s * (1.0 - t), s * t);
        (at, weight)
    };
    along.into_iter().flat_map(|a| across.map(|t| point(a, t))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Integral of L1^a L2^b over a triangle of unit area is 2 a! b! / (a + b + 2)!.
    #[test]
    fn points_integrate_polynomials_of_their_degree() {
        let factorial = |n: i32| (1..=n).map(f64::from).product::<f64>();
        for (rule, degree) in [(1, 2), (4, 4), (5, 5)] {
            for a in 0..=degree {
                for b in 0..=degree - a {
                    let sum: f64 = gauss_points(rule).iter().map(|(l, w)| w * l[0].powi(a) * l[1].powi(b)).sum();
                    let exact = 2.0 * factorial(a) * factorial(b) / factorial(a + b + 2);
                    assert!((sum - exact).abs() < 1e-12, "rule {rule}: {a} {b}: {sum} {exact}");
                }
            }
        }
        // times a radius that is zero at the apex and 1 at both other corners, or the other way round
        for (apex, a, b) in (0..3).flat_map(|apex| (0..4).flat_map(move |a| (0..4 - a).map(move |b| (apex, a, b)))) {
            let [i, j] = [(apex + 1) % 3, (apex + 2) % 3];
            let integral =
                |p: i32, q: i32, r: i32| 2.0 * factorial(p) * factorial(q) * factorial(r) / factorial(p + q + r + 2);
            for one in [true, false] {
                let radius = |l: &[f64; 3]| if one { l[i] + l[j] } else { l[apex] };
                let term = |(l, w): &Gauss| w * radius(l) * l[i].powi(a) * l[apex].powi(b);
                let sum: f64 = conical(apex, one).iter().map(term).sum();
                let exact = if one { integral(a + 1, b, 0) + integral(a, b, 1) } else { integral(a, b + 1, 0) };
                assert!((sum - exact).abs() < 1e-12, "from corner {apex}, {one}: {a} {b}: {sum} {exact}");
            }
        }
    }
}
