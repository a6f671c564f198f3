//! The body that a meridian half plane sweeps: what an axisymmetric model shows of itself.

use mtled::cloud::quality::six_volumes;
use mtled::cloud::{CloudError, Meridian, check};

use std::f64::consts::PI;

/// Fewest and most sectors.
const SECTORS: (f64, f64) = (12.0, 32.0);
/// Longest chord of a sector over the spacing far from every edge.
const CHORD: f64 = 1.5;

/// A revolved half plane. Each node off the axis has one copy per sector, one after the other in the order of azimuths.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Revolved {
    /// Places in space, m.
    pub points: Vec<[f64; 3]>,
    /// Tetrahedra, each with positive volume.
    pub cells: Vec<[u32; 4]>,
    /// Triangle of the half plane that each tetrahedron is swept from.
    pub triangle: Vec<u32>,
    /// Surface triangles, counter-clockwise seen from outside.
    pub surface: Vec<[u32; 3]>,
    /// First copy of each node of the half plane, and the number of points at the end.
    pub first: Vec<u32>,
    /// Cosine and sine of each sector's azimuth.
    pub azimuths: Vec<[f64; 2]>,
}

/// How many sectors a body of this radius is shown with, for a spacing `far` from every edge, m.
#[must_use]
pub(super) fn sectors(radius: f64, far: f64) -> usize {
    (2.0 * PI * radius / (CHORD * far)).ceil().clamp(SECTORS.0, SECTORS.1) as usize
}

impl Revolved {
    /// Sweeps a half plane.
    ///
    /// # Errors
    /// A node so near the axis that its copies coincide.
    pub(super) fn new(meridian: &Meridian, sectors: usize) -> Result<Self, CloudError> {
        let azimuth = |k: usize| {
            let (sin, cos) = (2.0 * PI * k as f64 / sectors as f64).sin_cos();
            [cos, sin]
        };
        let azimuths: Vec<[f64; 2]> = (0..sectors).map(azimuth).collect();
        let (mut points, mut first) = (Vec::new(), Vec::new());
        for p in &meridian.points {
            first.push(points.len() as u32);
            let copies = if p[0] == 0.0 { 1 } else { sectors };
            points.extend(azimuths[..copies].iter().map(|[cos, sin]| [p[0] * cos, p[0] * sin, p[2]]));
        }
        first.push(points.len() as u32);
        let copy = |v: u32, sector: usize| {
            let (from, to) = (first[v as usize], first[v as usize + 1]);
            from + (sector as u32 % sectors as u32) % (to - from)
        };
        let (mut cells, mut triangle) = (Vec::new(), Vec::new());
        for (i, t) in (0..).zip(&meridian.triangles) {
            (0..sectors).for_each(|s| wedge(*t, &|v, k| copy(v, s + k), &points, &mut cells));
            triangle.resize(cells.len(), i);
        }
        let surface = check::check(&points, &cells)?;
        Ok(Self { points, cells, triangle, surface, first, azimuths })
    }
}

/// The tetrahedra between a triangle and its copy in the next sector. The side of an edge is cut from its lower node to
/// the copy of its higher one, the same from both triangles that share the edge.
fn wedge(t: [u32; 3], copy: &dyn Fn(u32, usize) -> u32, points: &[[f64; 3]], cells: &mut Vec<[u32; 4]>) {
    let mut sorted = t;
    sorted.sort_unstable();
    let [a, b, c] = sorted;
    let (here, there) = ([a, b, c].map(|v| copy(v, 0)), [a, b, c].map(|v| copy(v, 1)));
    for mut cell in [
        [here[0], here[1], here[2], there[2]],
        [here[0], here[1], there[1], there[2]],
        [here[0], there[0], there[1], there[2]],
    ] {
        // on the axis a node is its own copy
        let flat = (0..4).any(|i| cell[i + 1..].contains(&cell[i]));
        if flat {
            continue;
        }
        if six_volumes(&cell.map(|v| points[v as usize])) < 0.0 {
            cell.swap(2, 3);
        }
        cells.push(cell);
    }
}
