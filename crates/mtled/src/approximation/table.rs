//! The approximation of one cloud in space: how many points a cell is integrated with, where they are, and the shape functions there.

mod consistent;

use std::cell::RefCell;
use std::collections::BTreeMap;

use rayon::prelude::*;

use super::error::ApproximationError;
use super::field::Field;
use super::join::{self, Share};
use super::mirrored::MirroredSupports;
use super::mls::{Basis, Fit, Neighbour};
use super::pruned;
use super::regions::{Regions, least_barycentric};
use super::repair::{self, Supported};
use super::shape_table::{Form, Row, ShapeTable};
use super::support::{radii, within_reach};
use crate::mirror::Mirror;
use crate::vector::{Point, cross, dot, sub};

/// Shape functions: basis, support and integration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Basis; `None`: linear finite elements on the cells.
    pub basis: Option<Basis>,
    /// alpha of the support radii.
    pub support_factor: f64,
    /// Gauss points per cell: 1, 4 or 5.
    pub points_per_cell: u32,
    /// Cells that share a point: 1, or 2 with one point per cell in space.
    pub cells_per_point: u32,
}

/// The approximation of one cloud: makes shape tables and field rows.
#[derive(Clone, Debug)]
pub struct Approximation {
    points: Vec<[f64; 3]>,
    cells: Vec<[u32; 4]>,
    settings: Settings,
    supports: MirroredSupports,
    /// Mean length of the edges at each node, m.
    spacing: Vec<f64>,
    /// Radii before any repair, m.
    first: Vec<f64>,
    /// What each cell is integrated with.
    share: Vec<Share>,
    /// Places (m) and volumes (m^3) of the points that the caller brings, by the cell that they belong to.
    given: BTreeMap<usize, Vec<(Point, f64)>>,
    regions: Regions,
    /// Whether the cells of a region have four points each at least; beyond the end: no.
    four: Vec<bool>,
}

thread_local! {
    static SCRATCH: RefCell<(Vec<Neighbour>, Fit)> = RefCell::new((Vec::new(), Fit::default()));
}

impl Approximation {
    /// Indexes a cloud; `interpolating` marks nodes whose nodal value must be the field's value.
    #[must_use]
    pub fn new(points: &[[f64; 3]], cells: &[[u32; 4]], interpolating: Vec<bool>, settings: Settings) -> Self {
        let spacing = radii(points, cells, 1.0);
        let first = radii(points, cells, settings.support_factor);
        let supports = MirroredSupports::whole(points, &first, &interpolating);
        let share = shares(points, cells, &[], &settings);
        Self {
            points: points.to_vec(),
            cells: cells.to_vec(),
            settings,
            supports,
            spacing,
            first,
            share,
            given: BTreeMap::new(),
            regions: Regions::default(),
            four: Vec::new(),
        }
    }

    /// Takes the cloud for the half of a body with n.x >= 0; `on_plane` are the nodes on the plane.
    #[must_use]
    pub fn with_mirror(mut self, mirror: Mirror, on_plane: &[bool]) -> Self {
        let interpolating = self.supports.interpolating();
        self.supports =
            MirroredSupports::new(&self.points, &self.first, interpolating, Some(mirror), on_plane.to_vec());
        self
    }

    /// Ends supports at the interfaces between regions, `region` being that of each cell (see `super::regions`).
    #[must_use]
    pub fn with_regions(mut self, region: &[u8]) -> Self {
        self.regions = Regions::new(&self.points, &self.cells, region);
        self.regions.scale(&self.cells, &mut self.first);
        self.supports = self.supports.with_radii(&self.first);
        self.share = shares(&self.points, &self.cells, region, &self.settings);
        self
    }

    /// Number of nodes whose support was enlarged.
    #[must_use]
    pub fn repaired_supports(&self) -> usize {
        self.supports.radii().iter().zip(&self.first).filter(|(now, first)| now > first).count()
    }

    /// Runs `f` with phi (and gradients) at x, a place of this region; of the nodes `among` these entries alone, where they are given.
    fn with_fit<R>(
        &self,
        x: [f64; 3],
        region: u8,
        among: Option<&[u32]>,
        basis: Basis,
        gradient: bool,
        f: impl FnOnce(&[Neighbour], &Fit) -> R,
    ) -> Result<R, ApproximationError> {
        SCRATCH.with_borrow_mut(|(neighbours, fit)| {
            self.supports.at(x, neighbours);
            within_reach(neighbours);
            self.regions.keep(region, neighbours, |n| self.supports.node(n).0);
            pruned::keep(among, neighbours, |n| self.supports.entry(n));
            fit.evaluate(neighbours, basis, gradient).map_err(|_| repair::refusal(x, neighbours, 3))?;
            Ok(f(neighbours, fit))
        })
    }

    /// The shape table of the cloud's cells, with the supports as they are.
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
        match self.settings.basis {
            Some(_) => pruned::pruned(self, (&self.cells, &self.points), table, least),
            None => table,
        }
    }

    /// phi at arbitrary points of the body; with linear tetrahedra the cell that holds the point decides.
    ///
    /// # Errors
    /// [`ApproximationError`] as above.
    pub fn field(&self, at: &[[f64; 3]]) -> Result<Field, ApproximationError> {
        let rows: Vec<Vec<(u32, f64)>> = match self.settings.basis {
            Some(basis) => at.par_iter().map(|&x| self.mean(x, basis)).collect::<Result<_, _>>()?,
            None => at.par_iter().map(|&x| self.barycentric(x)).collect(),
        };
        let mut field = Field { start: vec![0], mirror: self.supports.mirror, ..Field::default() };
        for row in rows {
            for (node, value) in row {
                field.nodes.push(node);
                field.value.push(value);
            }
            field.start.push(field.nodes.len() as u32);
        }
        Ok(field)
    }

    /// phi at x: on an interface the mean of what its regions have there.
    fn mean(&self, x: [f64; 3], basis: Basis) -> Result<Vec<(u32, f64)>, ApproximationError> {
        let regions = self.regions_at(x);
        let share = 1.0 / regions.len() as f64;
        let mut row = Vec::new();
        for region in regions {
            self.with_fit(x, region, None, basis, false, |n, fit| {
                row.extend(n.iter().zip(&fit.value).map(|(n, value)| (self.supports.entry(n.node), share * value)));
            })?;
        }
        Ok(row)
    }

    /// Regions of a node or of the cell that holds x.
    fn regions_at(&self, x: [f64; 3]) -> Vec<u8> {
        self.regions.at(x, |cell| {
            let corners = self.corners(&self.cells[cell]);
            least_barycentric(&corners, &tetrahedron(&corners).1, x)
        })
    }

    fn corners(&self, c: &[u32; 4]) -> [[f64; 3]; 4] {
        c.map(|n| self.points[n as usize])
    }

    fn linear(&self, c: &[u32; 4]) -> Row {
        let x = self.corners(c);
        let (volume, gradient) = tetrahedron(&x);
        let at = std::array::from_fn(|k| x.iter().map(|p| p[k]).sum::<f64>() / 4.0);
        Row { at, volume, nodes: c.to_vec(), gradient: gradient.to_vec(), squares: 0.0 }
    }

    fn barycentric(&self, x: [f64; 3]) -> Vec<(u32, f64)> {
        let mut best = (f64::NEG_INFINITY, Vec::new());
        for c in &self.cells {
            let corners = self.corners(c);
            let (_, lambda) = tetrahedron(&corners);
            let centre: [f64; 3] = std::array::from_fn(|k| (0..4).map(|a| corners[a][k]).sum::<f64>() / 4.0);
            let bary: [f64; 4] =
                std::array::from_fn(|a| 0.25 + (0..3).map(|k| lambda[a][k] * (x[k] - centre[k])).sum::<f64>());
            let least = bary.iter().copied().fold(f64::INFINITY, f64::min);
            if least > best.0 {
                best = (least, c.iter().copied().zip(bary).collect());
            }
        }
        best.1
    }

    /// Integrates the cells of some regions with four points each, `four` by region: one point a cell does not see how a soft layer folds
    /// that is crushed between stiff ones.
    #[must_use]
    pub fn with_four_points(mut self, four: &[bool]) -> Self {
        self.four = four.to_vec();
        for cell in 0..self.cells.len() {
            if self.has_four(self.regions.of_cell(cell)) {
                self.share[cell] = Share::Own;
            }
        }
        self
    }

    /// Integrates `cells` with points that the caller brings and no others: the cell that a point belongs to, its place (m) and its volume
    /// (m^3), by cell. The cells beside them are joined among themselves. To be called last.
    #[must_use]
    pub fn with_points(mut self, cells: &[u32], points: &[(u32, Point, f64)]) -> Self {
        if self.settings.basis.is_none() || cells.is_empty() {
            return self;
        }
        // no pair reaches from these cells to what lies beside them
        let mut part: Vec<u8> = (0..self.cells.len()).map(|cell| 2 * self.regions.of_cell(cell)).collect();
        cells.iter().for_each(|&cell| part[cell as usize] |= 1);
        self.share = shares(&self.points, &self.cells, &part, &self.settings);
        let four = std::mem::take(&mut self.four);
        self = self.with_four_points(&four);
        cells.iter().for_each(|&cell| self.share[cell as usize] = Share::Given);
        self.given.clear();
        points.iter().for_each(|&(cell, at, volume)| self.given.entry(cell as usize).or_default().push((at, volume)));
        self
    }

    fn has_four(&self, region: u8) -> bool {
        self.four.get(usize::from(region)) == Some(&true)
    }

    /// Points of a cell of this region, with their weights.
    pub(super) fn gauss_points(&self, region: u8) -> Vec<([f64; 4], f64)> {
        let own = self.settings.points_per_cell;
        gauss_points(if self.has_four(region) { own.max(4) } else { own })
    }

    /// Places and volumes of the points of a cell of its own.
    pub(super) fn gauss(&self, c: &[u32; 4], region: u8) -> Vec<([f64; 3], f64)> {
        let x = self.corners(c);
        let (volume, _) = tetrahedron(&x);
        let place = |bary: &[f64; 4]| std::array::from_fn(|k| (0..4).map(|a| bary[a] * x[a][k]).sum());
        self.gauss_points(region).iter().map(|(bary, weight)| (place(bary), weight * volume)).collect()
    }

    /// The point at the centroid of two cells.
    pub(super) fn pair(&self, cells: [&[u32; 4]; 2]) -> ([f64; 3], f64) {
        let corners = cells.map(|c| self.corners(c));
        let volumes = [tetrahedron(&corners[0]).0, tetrahedron(&corners[1]).0];
        let volume = volumes[0] + volumes[1];
        let share = [0.25 * volumes[0] / volume, 0.25 * volumes[1] / volume];
        let at = std::array::from_fn(|k| (0..2).map(|c| share[c] * corners[c].iter().map(|x| x[k]).sum::<f64>()).sum());
        (at, volume)
    }
}

impl Supported for Approximation {
    fn form(&self) -> Form {
        self.supports.mirror.map_or(Form::Full, Form::Mirrored)
    }

    fn cells(&self) -> usize {
        self.cells.len()
    }

    fn points(&self, cell: usize) -> Vec<([f64; 3], f64)> {
        let c = &self.cells[cell];
        if self.settings.basis.is_none() {
            let Row { at, volume, .. } = self.linear(c);
            return vec![(at, volume)];
        }
        match self.share[cell] {
            Share::Own => self.gauss(c, self.regions.of_cell(cell)),
            Share::With(other) => vec![self.pair([c, &self.cells[other as usize]])],
            Share::Given => self.given.get(&cell).cloned().unwrap_or_default(),
            Share::Left => Vec::new(),
        }
    }

    fn row(
        &self,
        cell: usize,
        (at, volume): ([f64; 3], f64),
        among: Option<&[u32]>,
    ) -> Result<Row, ApproximationError> {
        let Some(basis) = self.settings.basis else { return Ok(self.linear(&self.cells[cell])) };
        self.with_fit(at, self.regions.of_cell(cell), among, basis, true, |neighbours, fit| Row {
            at,
            volume,
            nodes: neighbours.iter().map(|n| self.supports.entry(n.node)).collect(),
            gradient: fit.gradient.clone(),
            squares: fit.gradient.iter().flatten().map(|g| g * g).sum(),
        })
    }

    fn region(&self) -> &[u8] {
        &self.regions.of_cell
    }

    fn edge(&self, cell: usize) -> f64 {
        repair::mean(&self.spacing, &self.cells[cell])
    }

    fn determined(&self, x: [f64; 3]) -> Result<(), ApproximationError> {
        self.settings.basis.map_or(Ok(()), |basis| self.mean(x, basis).map(|_| ()))
    }

    fn enlarge(&mut self, factor: f64, at: &[[f64; 3]]) {
        self.supports = self.supports.enlarged(&self.first, factor, at);
    }
}

/// Volume and gradients of the four barycentric coordinates of a tetrahedron.
#[must_use]
pub fn tetrahedron(x: &[[f64; 3]; 4]) -> (f64, [[f64; 3]; 4]) {
    let e = [1, 2, 3].map(|a| sub(x[a], x[0]));
    let c = [cross(e[1], e[2]), cross(e[2], e[0]), cross(e[0], e[1])];
    let six_v = dot(e[0], c[0]);
    let g: [[f64; 3]; 3] = c.map(|c| c.map(|v| v / six_v));
    let g0 = std::array::from_fn(|k| -(g[0][k] + g[1][k] + g[2][k]));
    (six_v / 6.0, [g0, g[0], g[1], g[2]])
}

/// Barycentric points and weights of degree 1, 2 and 3 (the last with one negative weight: Keast).
fn gauss_points(n: u32) -> Vec<([f64; 4], f64)> {
    let vertex = |a: f64| (0..4).map(move |i| std::array::from_fn(|k| if k == i { a } else { (1.0 - a) / 3.0 }));
    match n {
        4 => vertex(0.585_410_196_624_968_5).map(|p| (p, 0.25)).collect(),
        5 => std::iter::once(([0.25; 4], -0.8)).chain(vertex(0.5).map(|p| (p, 0.45))).collect(),
        _ => vec![([0.25; 4], 1.0)],
    }
}

/// What each cell is integrated with: pairs lie in one region.
pub(super) fn shares(points: &[[f64; 3]], cells: &[[u32; 4]], region: &[u8], settings: &Settings) -> Vec<Share> {
    if settings.cells_per_point == 1 || settings.points_per_cell > 1 || settings.basis.is_none() {
        return vec![Share::Own; cells.len()];
    }
    let corners = |c: &[u32; 4]| c.map(|n| points[n as usize]);
    let volume: Vec<f64> = cells.iter().map(|c| tetrahedron(&corners(c)).0).collect();
    join::pairs(points, cells, &volume, region)
}
