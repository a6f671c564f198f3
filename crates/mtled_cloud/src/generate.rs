//! From a domain and a spacing to a cloud of tetrahedra.

use crate::faces::INTERFACE;
use crate::outline::Outline;
use crate::packing::{OwnNodes, Packing, Room};
use crate::vector::Point;
use crate::{
    Cloud, CloudError, Domain, SIDE, Spacing, Summary, carve, check, conform, delaunay, edges, hilbert_order, improve,
    quality, smooth, sort_cells,
};

/// Lowest volume-length ratio of a generated cell (1: regular tetrahedron, 0: flat). The presets reach 0.43.
pub const LEAST_QUALITY: f64 = 0.25;
/// The same of a cloud that conforms to regions: a few cells between nodes that can't move, as at the edges of a box, stay flat.
/// They have next to no volume, and a meshless fit takes no notice of a cell's shape.
pub(crate) const LEAST_QUALITY_OF_REGIONS: f64 = 0.01;
/// Sweeps of smoothing over the first triangulation.
const SWEEPS: usize = 2;
/// Distance that moved nodes keep from interfaces, as a fraction of the spacing.
const INTERFACE_CLEARANCE: f64 = 0.3;
/// Passes of the improvement of cells.
const PASSES: usize = 12;

/// Generates the cloud of a body, or of the half of one, for a spacing. The features of a half are those of the whole body, symmetric about
/// y = 0; no box among the regions.
///
/// # Errors
/// A number out of its range, too many nodes ([`CloudError::TooManyNodes`], before anything is allocated), or features
/// too close to each other for the spacing.
pub fn generate(domain: &Domain, spacing: &Spacing) -> Result<Cloud, CloudError> {
    filled(domain, spacing, None)
}

/// The same with nodes of the caller's own inside, which stay where they are: `own` is asked once, when faces and interfaces have theirs.
///
/// # Errors
/// As [`generate`].
pub fn generate_with(
    domain: &Domain,
    spacing: &Spacing,
    own: &mut dyn FnMut(&Room<'_>) -> OwnNodes,
) -> Result<Cloud, CloudError> {
    filled(domain, spacing, Some(own))
}

fn filled(
    domain: &Domain,
    spacing: &Spacing,
    own: Option<&mut dyn FnMut(&Room<'_>) -> OwnNodes>,
) -> Result<Cloud, CloudError> {
    domain.validate()?;
    let expected = spacing.validate(domain)?;
    let mut nodes = edges::place(domain, spacing)?;
    let mut packing = Packing::new(domain, spacing);
    packing.fill(&mut nodes, expected, own);
    let order = hilbert_order(&nodes.points);
    let mut points: Vec<Point> = order.iter().map(|&i| nodes.points[i as usize]).collect();
    let faces: Vec<u8> = order.iter().map(|&i| nodes.faces[i as usize]).collect();
    let fixed: Vec<bool> = order.iter().map(|&i| nodes.fixed[i as usize]).collect();
    let mut cells = delaunay::triangulate(&points)?;
    for _ in 0..SWEEPS {
        smooth::smooth(&packing, &mut points, &faces, &fixed, &cells);
    }
    cells = delaunay::triangulate(&points)?;
    let (mut points, mut faces, mut fixed) = (points, faces, fixed);
    if let Some(outline) = domain.outline() {
        cells = carve::carve(outline, &points, &faces, cells)?;
        let kept = carve::used(points.len(), &mut cells);
        points = kept.iter().map(|&n| points[n as usize]).collect();
        faces = kept.iter().map(|&n| faces[n as usize]).collect();
        fixed = kept.iter().map(|&n| fixed[n as usize]).collect();
    }
    let place = |face: u8, p: Point| {
        if face == INTERFACE {
            let slid = |q: &Point| domain.depth(*q) > INTERFACE_CLEARANCE * packing.h(*q) && !packing.reserved(*q);
            return spacing.onto_interface(domain, p).filter(slid);
        }
        let q = if face == 0 { p } else { domain.project(face, p) };
        let gap = spacing.interface_distance(domain.height(), q);
        let clear = || gap == f64::INFINITY || gap > INTERFACE_CLEARANCE * packing.h(q);
        (clear() && domain.holds(q) && !packing.reserved(q)).then_some(q)
    };
    let regions: Vec<u64> =
        if spacing.solids().next().is_some() || domain.outline().is_some_and(Outline::has_interfaces) {
            points.iter().map(|&p| spacing.touching(domain, p)).collect()
        } else {
            Vec::new()
        };
    let curved = if domain.is_plane(SIDE) { 0 } else { SIDE };
    let rules = improve::Rules { faces: &faces, fixed: &fixed, curved, regions: &regions, place: &place };
    let mut mesh = improve::Mesh::new(points, cells, rules);
    mesh.peel();
    mesh.improve(PASSES);
    let (points, mut cells) = mesh.finish();
    let faces: Vec<u8> = faces.iter().map(|f| f & !INTERFACE).collect();
    sort_cells(&mut cells);
    let surface = match (domain.outline(), check::check(&points, &cells)) {
        (_, Ok(surface)) => surface,
        (Some(_), Err(fault)) => {
            return Err(fault.nodes().first().map_or(CloudError::Invalid(fault), |&n| carve::thin(points[n])));
        }
        (None, Err(fault)) => return Err(fault.into()),
    };
    if let Some(outline) = domain.outline() {
        carve::covers(outline, spacing, &points)?;
    }
    conform::conforms(domain, spacing, &points, &faces, &surface)?;
    let shared = |t: &[u32; 3]| match domain.outline() {
        None => t.iter().fold(u8::MAX, |bits, &v| bits & faces[v as usize]),
        Some(outline) => {
            outline.face_at([0, 1, 2].map(|k| t.iter().map(|&v| points[v as usize][k]).sum::<f64>() / 3.0))
        }
    };
    let surface_faces = surface.iter().map(shared).collect();
    let quality = Summary::of(&points, &cells);
    let least = if regions.is_empty() { LEAST_QUALITY } else { LEAST_QUALITY_OF_REGIONS };
    if quality.lowest < least {
        let corners = |c: &[u32; 4]| c.map(|v| points[v as usize]);
        let worst = cells
            .iter()
            .min_by(|a, b| quality::volume_length(&corners(a)).total_cmp(&quality::volume_length(&corners(b))));
        let at = worst.map_or([0.0; 3], |c| corners(c)[0]);
        let reason = format!("a cell of quality {:.3} is left at {at:?} m (least allowed: {least})", quality.lowest);
        return Err(CloudError::NotMeshable { reason });
    }
    Ok(Cloud { points, cells, faces, surface, surface_faces, quality, hexahedra: Vec::new() })
}
