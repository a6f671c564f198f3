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

mod points;

use std::cell::RefCell;
use std::f64::consts::PI;

use rayon::prelude::*;

use points::{CENTRE, Gauss, conical, gauss_points};

use super::error::ApproximationError;
use super::mirrored::MirroredSupports;
use super::mls::{Fit, Neighbour};
use super::pruned;
use super::regions::{Regions, least_barycentric};
use super::repair::{self, Supported};
use super::shape_table::{Form, Row, ShapeTable};
use super::support::{radii, within_reach};
use super::table::Settings;
use crate::mirror::Mirror;

/// The nodes (r, 0, z) of a half plane with their images at -r.
pub(crate) fn in_half_plane(points: &[[f64; 3]], radii: &[f64], interpolating: &[bool]) -> MirroredSupports {
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
    /// Mean length of the edges at each node, m.
    spacing: Vec<f64>,
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
        let spacing = radii(points, triangles, 1.0);
        let first = radii(points, triangles, settings.support_factor);
        let supports = in_half_plane(points, &first, interpolating);
        let plain = vec![false; triangles.len()];
        let regions = Regions::default();
        Self {
            points: points.to_vec(),
            triangles: triangles.to_vec(),
            settings,
            supports,
            spacing,
            first,
            plain,
            filled: Vec::new(),
            regions,
        }
    }

    /// Ends supports at the interfaces between regions, `region` being that of each triangle (see `super::regions`).
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

    /// The table without the support nodes that fewer than so many of eight points beside each other have (see `super::pruned`).
    #[must_use]
    pub fn pruned(&self, table: ShapeTable, least: u32) -> ShapeTable {
        let cells: Vec<[u32; 4]> = self.triangles.iter().map(|&[a, b, c]| [a, b, c, c]).collect();
        match self.settings.basis {
            Some(_) => pruned::pruned(self, (&cells, &self.points), table, least),
            None => table,
        }
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

    fn triangle(&self, cell: usize, rule: &[Gauss]) -> Vec<([f64; 3], f64)> {
        let x = self.corners(&self.triangles[cell]);
        let (area, _) = triangle(&x);
        let point = |(bary, weight): &Gauss| {
            let at: [f64; 3] = std::array::from_fn(|k| (0..3).map(|a| bary[a] * x[a][k]).sum());
            (at, 2.0 * PI * at[0] * weight * area)
        };
        rule.iter().map(point).collect()
    }

    /// phi at a node or in the triangle that holds x: on an interface the mean of what its regions have there.
    fn entries_at(&self, x: [f64; 3]) -> Result<Vec<Entry>, ApproximationError> {
        let regions = self.regions.at(x, |cell| {
            let corners = self.corners(&self.triangles[cell]);
            least_barycentric(&corners, &triangle(&corners).1, x)
        });
        let share = 1.0 / regions.len() as f64;
        let mut all = Vec::new();
        for region in regions {
            let scaled = |e: Entry| Entry { value: share * e.value, slope: e.slope.map(|s| share * s), ..e };
            all.extend(self.entries(x, region, None, None)?.into_iter().map(scaled));
        }
        Ok(all)
    }

    /// phi of every node and image at x in a region, and its slope; linear triangles take `within`, or the one that holds x.
    fn entries(
        &self,
        x: [f64; 3],
        region: u8,
        within: Option<&[u32; 3]>,
        among: Option<&[u32]>,
    ) -> Result<Vec<Entry>, ApproximationError> {
        let Some(basis) = self.settings.basis else { return Ok(self.linear(x, within)) };
        SCRATCH.with_borrow_mut(|(neighbours, fit)| {
            self.supports.at(x, neighbours);
            within_reach(neighbours);
            self.regions.keep(region, neighbours, |n| self.supports.node(n).0);
            pruned::keep(among, neighbours, |n| self.supports.entry(n));
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

    fn points(&self, cell: usize) -> Vec<([f64; 3], f64)> {
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

    fn row(
        &self,
        cell: usize,
        (at, volume): ([f64; 3], f64),
        among: Option<&[u32]>,
    ) -> Result<Row, ApproximationError> {
        let entries = self.entries(at, self.regions.of_cell(cell), Some(&self.triangles[cell]), among)?;
        let slot = |e: &Entry| if e.image { e.node + self.points.len() as u32 } else { e.node };
        let squares = if self.settings.basis.is_some() { self.squares(&entries) } else { 0.0 };
        Ok(Row {
            at,
            squares,
            volume,
            nodes: entries.iter().map(slot).collect(),
            gradient: entries.iter().map(|e| [e.slope[0], e.value / at[0], e.slope[2]]).collect(),
        })
    }

    fn region(&self) -> &[u8] {
        &self.regions.of_cell
    }

    fn filled(&self) -> &[bool] {
        &self.filled
    }

    fn edge(&self, cell: usize) -> f64 {
        repair::mean(&self.spacing, &self.triangles[cell])
    }

    fn determined(&self, x: [f64; 3]) -> Result<(), ApproximationError> {
        self.settings.basis.map_or(Ok(()), |_| self.entries_at(x).map(|_| ()))
    }

    fn enlarge(&mut self, factor: f64, at: &[[f64; 3]]) {
        self.supports = self.supports.enlarged(&self.first, factor, at);
    }
}

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
