//! Structured clouds: a cylinder or box of hexahedra in layers.
//!
//! The section of a cylinder is a square grid in the middle and rings round it, that of a box a grid. Lines and layers are as far apart as
//! the spacing asks for where it is finest along them, so that a grid is graded in r and z, or x, y and z, each for itself, within limits.

use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_4, PI};

use mtled::cloud::hexahedron::{Hexahedron, cut};
use mtled::cloud::{
    BASE, Cloud, CloudError, Domain, Feature, SIDE, Spacing, Summary, TOP, check, hilbert_order, sort_cells,
};

/// Nodes round an indenter's edge over four, at least: the polygon has 0.6 % less area than the circle.
const QUARTER_OF_RING: f64 = 8.0;
/// Least distance of lines over the spacing far from every feature, and largest over the least: supports are round, and where cells are five
/// times as long as wide the force was 4 to 20 % too low (`docs/lab/performance.md`).
const FINEST: f64 = 0.25;
const MOST: f64 = 3.0;
/// Share of a circle in the outline of the square in the middle, of a square the rest; its half side over the radius that it takes.
const ROUND: f64 = 0.5;
const SQUARE: f64 = 0.9;
/// Radius of the square in the middle over that of the innermost circle.
const MIDDLE: f64 = 0.5;
/// Samples of the spacing along a line, and across it.
const SAMPLES: usize = 400;
const ACROSS: usize = 16;

/// Nodes and quadrangles of a horizontal section.
struct Section {
    points: Vec<[f64; 2]>,
    /// Bits of the sides that each node lies on.
    sides: Vec<u8>,
    /// Counter-clockwise seen from above.
    cells: Vec<[u32; 4]>,
}

/// The cloud of a whole cylinder or box. Features lie about the axis; regions have no part in it.
///
/// # Errors
/// [`CloudError`], as [`mtled::cloud::generate`].
pub fn structured(domain: &Domain, spacing: &Spacing) -> Result<Cloud, CloudError> {
    domain.validate()?;
    spacing.validate_features(domain)?;
    let (low, high) = domain.bounds();
    let line = |k: usize| (0..=ACROSS).map(move |i| low[k] + (high[k] - low[k]) * i as f64 / ACROSS as f64);
    let least = spacing.finest().max(FINEST * spacing.far);
    let finest = |places: &mut dyn Iterator<Item = [f64; 3]>| {
        let wanted = places.map(|p| spacing.at(domain, p)).fold(f64::INFINITY, f64::min);
        wanted.clamp(least, MOST * least)
    };
    let radii = circles(domain, spacing);
    let (section, spots): (Section, Vec<[f64; 2]>) = match *domain {
        Domain::Cylinder { .. } => {
            let section = disc(&radii, spacing.far, &|r| finest(&mut line(2).map(|z| [r, 0.0, z])));
            // features lie about the axis
            (section, line(0).chain(radii.iter().copied()).map(|x| [x, 0.0]).collect())
        }
        Domain::Box { .. } => {
            let spots: Vec<[f64; 2]> = line(0).flat_map(|x| line(1).map(move |y| [x, y])).collect();
            let in_plane = |k: usize| line(k).flat_map(|a| line(2).map(move |z| [a, z]));
            let x = graded(low[0], high[0], &|x| finest(&mut in_plane(1).map(|[y, z]| [x, y, z])));
            let y = graded(low[1], high[1], &|y| finest(&mut in_plane(0).map(|[x, z]| [x, y, z])));
            (rectangle([x, y]), spots)
        }
        _ => {
            let reason = "only a whole cylinder or box is filled with hexahedra".to_owned();
            return Err(CloudError::NotMeshable { reason });
        }
    };
    let heights = graded(low[2], high[2], &|z| finest(&mut spots.iter().map(|&[x, y]| [x, y, z])));
    spacing.room_for((section.points.len() * heights.len()) as f64)?;
    extruded(&section, &heights)
}

/// Radii that are circles of nodes, ascending; the last is the body's own.
fn circles(domain: &Domain, spacing: &Spacing) -> Vec<f64> {
    let Domain::Cylinder { radius: whole, .. } = *domain else { return Vec::new() };
    let within = spacing.features.iter().filter_map(|f| match *f {
        Feature::ContactRing { radius, .. } | Feature::Patch { radius, .. } if radius < whole => Some(radius),
        _ => None,
    });
    let mut radii: Vec<f64> = within.chain([whole]).collect();
    radii.sort_by(f64::total_cmp);
    radii.dedup();
    radii
}

/// Places from a to b whose distances are in proportion to h there, and not above it.
fn graded(a: f64, b: f64, h: &dyn Fn(f64) -> f64) -> Vec<f64> {
    let step = (b - a) / SAMPLES as f64;
    let mut count = vec![0.0];
    for k in 0..SAMPLES {
        count.push(count[k] + step / h(a + (k as f64 + 0.5) * step));
    }
    let cells = (count[SAMPLES] - 1e-9).ceil().max(1.0);
    let place = |i: usize| {
        let wanted = count[SAMPLES] * i as f64 / cells;
        let k = count.partition_point(|c| *c <= wanted).clamp(1, SAMPLES);
        a + step * (k as f64 - 1.0 + (wanted - count[k - 1]) / (count[k] - count[k - 1]))
    };
    // an end keeps its own digits
    std::iter::once(a).chain((1..cells as usize).map(place)).chain([b]).collect()
}

fn rectangle([x, y]: [Vec<f64>; 2]) -> Section {
    let (columns, rows) = (x.len(), y.len());
    let bits = |i: usize, last: usize, [first, second]: [u8; 2]| match i {
        0 => first,
        i if i == last => second,
        _ => 0,
    };
    let all = || (0..rows).flat_map(|j| (0..columns).map(move |i| (i, j)));
    let node = |i: usize, j: usize| (j * columns + i) as u32;
    Section {
        points: all().map(|(i, j)| [x[i], y[j]]).collect(),
        sides: all().map(|(i, j)| bits(i, columns - 1, [4, 8]) | bits(j, rows - 1, [16, 32])).collect(),
        cells: all()
            .filter(|(i, j)| i + 1 < columns && j + 1 < rows)
            .map(|(i, j)| [node(i, j), node(i + 1, j), node(i + 1, j + 1), node(i, j + 1)])
            .collect(),
    }
}

/// A square grid in the middle whose outline is half a circle already, and rings from there over the circles.
fn disc(radii: &[f64], far: f64, h: &dyn Fn(f64) -> f64) -> Section {
    let (first, whole) = (radii[0], radii[radii.len() - 1]);
    let quarter = (PI * whole / (2.0 * far)).ceil().max(if radii.len() > 1 { QUARTER_OF_RING } else { 2.0 });
    let across = quarter as usize;
    let middle = MIDDLE * first;
    let bounds = [&[middle], radii].concat();
    let mut rings = vec![middle];
    bounds.windows(2).for_each(|w| rings.extend(&graded(w[0], w[1], h)[1..]));
    // so that the polygon of the outline has the circle's area; circles within keep their radius
    let sector = 0.5 * PI / quarter;
    let swell = (sector / sector.sin()).sqrt() - 1.0;
    let swollen =
        |r: f64| r * (1.0 + swell * if radii.len() > 1 { ((r - first) / (whole - first)).max(0.0) } else { 1.0 });
    let mixed = |[u, v]: [f64; 2], round: f64| {
        let circle = on_circle(u, v);
        [round * circle[0] + (1.0 - round) * SQUARE * u, round * circle[1] + (1.0 - round) * SQUARE * v]
    };
    let along = |i: usize| 2.0 * i as f64 / quarter - 1.0;
    let grid = || (0..=across).flat_map(|j| (0..=across).map(move |i| (i, j)));
    let mut section = rectangle([0, 1].map(|_| (0..=across).map(along).collect()));
    section.sides.fill(0);
    section.points = grid()
        .map(|(i, j)| {
            let (u, v) = (along(i), along(j));
            mixed([u, v], ROUND * u.abs().max(v.abs())).map(|x| swollen(middle) * x)
        })
        .collect();
    let outline: Vec<(usize, usize)> = (0..across)
        .map(|i| (i, 0))
        .chain((0..across).map(|j| (across, j)))
        .chain((0..across).map(|i| (across - i, across)))
        .chain((0..across).map(|j| (0, across - j)))
        .collect();
    let mut inner: Vec<u32> = outline.iter().map(|(i, j)| (j * (across + 1) + i) as u32).collect();
    for &r in &rings[1..] {
        let round = ROUND + (1.0 - ROUND) * ((r - middle) / (first - middle)).min(1.0);
        let start = section.points.len() as u32;
        let outer: Vec<u32> = (start..).take(outline.len()).collect();
        section.points.extend(outline.iter().map(|&(i, j)| mixed([along(i), along(j)], round).map(|x| swollen(r) * x)));
        section.sides.extend(outline.iter().map(|_| if r == whole { SIDE & SIDE.wrapping_neg() } else { 0 }));
        let next = |k: usize| (k + 1) % outline.len();
        section.cells.extend((0..outline.len()).map(|k| [inner[k], outer[k], outer[next(k)], inner[next(k)]]));
        inner = outer;
    }
    section
}

/// The point of the unit circle that a point of the square of half side 1 goes to, seen from the middle; with |(u, v)| in the greatest norm
/// for its radius.
fn on_circle(u: f64, v: f64) -> [f64; 2] {
    if u == 0.0 && v == 0.0 {
        return [0.0; 2];
    }
    if u.abs() >= v.abs() {
        let (sin, cos) = (FRAC_PI_4 * v / u).sin_cos();
        [u * cos, u * sin]
    } else {
        let (sin, cos) = (FRAC_PI_4 * u / v).sin_cos();
        [v * sin, v * cos]
    }
}

/// The section from height to height.
fn extruded(section: &Section, heights: &[f64]) -> Result<Cloud, CloudError> {
    let per_layer = section.points.len();
    let top = heights.len() - 1;
    let level = |k: usize| {
        if k == 0 {
            BASE
        } else if k == top {
            TOP
        } else {
            0
        }
    };
    let all = || (0..heights.len()).flat_map(|k| (0..per_layer).map(move |i| (k, i)));
    let places: Vec<[f64; 3]> = all().map(|(k, i)| [section.points[i][0], section.points[i][1], heights[k]]).collect();
    let marks: Vec<u8> = all().map(|(k, i)| level(k) | section.sides[i]).collect();
    let order = hilbert_order(&places);
    let mut number = vec![0u32; order.len()];
    order.iter().zip(0..).for_each(|(&old, new)| number[old as usize] = new);
    let points: Vec<[f64; 3]> = order.iter().map(|&n| places[n as usize]).collect();
    let faces: Vec<u8> = order.iter().map(|&n| marks[n as usize]).collect();
    let corners = (0..top).flat_map(|k| {
        let node = move |i: u32, k: usize| k * per_layer + i as usize;
        section.cells.iter().map(move |&[a, b, c, d]| {
            [
                node(a, k),
                node(b, k),
                node(c, k),
                node(d, k),
                node(a, k + 1),
                node(b, k + 1),
                node(c, k + 1),
                node(d, k + 1),
            ]
        })
    });
    let corners: Vec<[u32; 8]> = corners.map(|c| c.map(|n| number[n])).collect();
    let (cells, hexahedra) = joined(&corners);
    let surface = check::check(&points, &cells)?;
    let shared = |t: &[u32; 3]| t.iter().fold(u8::MAX, |bits, &v| bits & faces[v as usize]);
    let surface_faces = surface.iter().map(shared).collect();
    let quality = Summary::of(&points, &cells);
    Ok(Cloud { points, cells, faces, surface, surface_faces, quality, hexahedra })
}

/// The tetrahedra of hexahedra, in order, and the hexahedra with them.
fn joined(corners: &[[u32; 8]]) -> (Vec<[u32; 4]>, Vec<Hexahedron>) {
    let mut cells: Vec<[u32; 4]> = corners.iter().flat_map(|c| cut(c)).collect();
    let key = |c: &[u32; 4]| {
        let mut key = *c;
        key.sort_unstable();
        key
    };
    let cut_cells: Vec<[u32; 4]> = cells.iter().map(key).collect();
    sort_cells(&mut cells);
    let place: BTreeMap<[u32; 4], u32> = cells.iter().map(key).zip(0..).collect();
    let found = |c: &[u32; 4]| place.get(c).copied().unwrap_or_default();
    let (sixes, _) = cut_cells.as_chunks::<6>();
    let hexahedra =
        corners.iter().zip(sixes).map(|(&corners, six)| Hexahedron { corners, cells: six.iter().map(found).collect() });
    (cells, hexahedra.collect())
}
