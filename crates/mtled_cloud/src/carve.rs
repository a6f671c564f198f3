//! Which tetrahedra of a triangulation fill a body that a mesh outlines: the triangulation fills the hull of its nodes.

use crate::check;
use crate::domain::Domain;
use crate::error::CloudError;
use crate::faces::INTERFACE;
use crate::grid::Grid;
use crate::outline::Outline;
use crate::quality::volume_length;
use crate::spacing::Spacing;
use crate::vector::{Point, add, distance, scale};
use std::collections::{BTreeMap, BTreeSet};

/// Depth of the middle of a cell of surface nodes over its longest edge, below which it lies between the surface and the triangles under it.
const THIN: f64 = 0.06;
/// Quality below which a cell of surface nodes is left out where it can be.
const FLAT: f64 = 0.02;
/// Largest distance of the surface from the nearest node over the spacing.
const REACH: f64 = 1.5;
/// Rounds of the repair of the surface.
const REPAIRS: usize = 12;

/// Leaves the cells that are in the body; those that make its surface no surface go as well.
///
/// # Errors
/// [`CloudError::NotMeshable`]: what is left has no closed and simple surface.
pub(crate) fn carve(
    outline: &Outline,
    points: &[Point],
    faces: &[u8],
    mut cells: Vec<[u32; 4]>,
) -> Result<Vec<[u32; 4]>, CloudError> {
    let outer = |c: &[u32; 4]| c.iter().all(|&n| faces[n as usize] & !INTERFACE != 0);
    cells.retain(|c| {
        let p = c.map(|n| points[n as usize]);
        let middle = scale(add(add(p[0], p[1]), add(p[2], p[3])), 0.25);
        let longest =
            || (0..4).flat_map(|i| (0..i).map(move |j| (i, j))).map(|(i, j)| distance(p[i], p[j])).fold(0.0, f64::max);
        let thin = outer(c) && (volume_length(&p) < FLAT || outline.depth(middle) < THIN * longest());
        !thin && outline.cell_at(middle).is_some()
    });
    for _ in 0..REPAIRS {
        let bad = faulty(points.len(), &cells)?;
        if bad.is_empty() {
            break;
        }
        // of the cells at such an edge or node those of surface nodes alone carry nothing
        let at = |c: &[u32; 4]| bad.iter().any(|edge| edge.iter().all(|n| c.contains(n)));
        let before = cells.len();
        cells.retain(|c| !(at(c) && outer(c)));
        if cells.len() == before {
            cells.retain(|c| !(at(c) && c.iter().filter(|n| faces[**n as usize] & !INTERFACE != 0).count() == 3));
        }
    }
    Ok(cells)
}

/// Edges of the surface that don't join two triangles, and nodes, as edges of one end, at which parts of it touch.
fn faulty(points: usize, cells: &[[u32; 4]]) -> Result<Vec<Vec<u32>>, CloudError> {
    let surface = check::surface(points, cells)?;
    let mut joins: BTreeMap<[u32; 2], u32> = BTreeMap::new();
    let mut fans: BTreeMap<u32, BTreeMap<u32, u32>> = BTreeMap::new();
    for t in &surface {
        for k in 0..3 {
            let (a, b, c) = (t[k], t[(k + 1) % 3], t[(k + 2) % 3]);
            *joins.entry([a.min(b), a.max(b)]).or_default() += 1;
            fans.entry(a).or_default().insert(b, c);
        }
    }
    let mut bad: BTreeSet<Vec<u32>> = joins.iter().filter(|(_, n)| **n != 2).map(|(e, _)| e.to_vec()).collect();
    for (node, next) in &fans {
        let Some((&start, _)) = next.iter().next() else { continue };
        let (mut at, mut steps) = (start, 0);
        while let Some(&to) = next.get(&at) {
            (at, steps) = (to, steps + 1);
            if at == start || steps > next.len() {
                break;
            }
        }
        if steps != next.len() {
            bad.insert(vec![*node]);
        }
    }
    Ok(bad.into_iter().collect())
}

/// Whether what is left of a body reaches all of its surface.
///
/// # Errors
/// [`CloudError::NotMeshable`]: a corner of the mesh's surface is further from every node than cells are long.
pub(crate) fn covers(outline: &Outline, spacing: &Spacing, points: &[Point]) -> Result<(), CloudError> {
    let (low, high) = outline.bounds;
    let mut grid = Grid::new(low, high, points.len());
    grid.refill(points);
    let lost = |p: &Point| !grid.any(points, *p, REACH * spacing.at(&Domain::Outline(outline), *p), |_, _| true);
    match outline
        .faces()
        .into_iter()
        .filter(|face| *face != INTERFACE)
        .flat_map(|face| outline.corners(face))
        .find(lost)
    {
        Some(p) => Err(thin(p)),
        None => Ok(()),
    }
}

/// What to say of a place that the spacing doesn't resolve.
pub(crate) fn thin(p: Point) -> CloudError {
    let reason = format!(
        "at {p:?} m (z from the lowest point) the mesh is thinner, or its surface more curved, than the spacing"
    );
    CloudError::NotMeshable { reason }
}

/// Renumbers the nodes so that none is without a cell: which those are that stay.
pub(crate) fn used(points: usize, cells: &mut [[u32; 4]]) -> Vec<u32> {
    let mut number = vec![u32::MAX; points];
    cells.iter().flatten().for_each(|&n| number[n as usize] = 0);
    let kept: Vec<u32> = (0..points as u32).filter(|&n| number[n as usize] == 0).collect();
    for (new, &old) in kept.iter().enumerate() {
        number[old as usize] = new as u32;
    }
    cells.iter_mut().flatten().for_each(|n| *n = number[*n as usize]);
    kept
}
