//! Does the finished cloud conform to its features? Verified on every cloud, never assumed.

use crate::domain::Domain;
use crate::error::CloudError;
use crate::faces::TOP;
use crate::path::Axis;
use crate::spacing::{Feature, Spacing};
use crate::vector::{Point, length2};

/// Relative width of "on the circle".
const ON: f64 = 1e-9;

fn refused(reason: String) -> Result<(), CloudError> {
    Err(CloudError::NotMeshable { reason })
}

/// # Errors
/// A triangle of the top face that crosses a contact ring, or a foreign node within a path's capture radius.
pub(crate) fn conforms(
    domain: &Domain,
    spacing: &Spacing,
    points: &[Point],
    faces: &[u8],
    surface: &[[u32; 3]],
) -> Result<(), CloudError> {
    for f in &spacing.features {
        match *f {
            Feature::ContactRing { centre, radius, .. } => ring(centre, radius, points, faces, surface)?,
            Feature::Path { axis, capture_radius, length, .. } => {
                path(domain, &axis, capture_radius, length, spacing.path_nodes(domain, f), points)?;
            }
            Feature::Rim { .. } | Feature::Region { .. } | Feature::Patch { .. } | Feature::FinePath { .. } => {}
        }
    }
    Ok(())
}

fn ring(centre: [f64; 2], radius: f64, points: &[Point], faces: &[u8], surface: &[[u32; 3]]) -> Result<(), CloudError> {
    for t in surface.iter().filter(|t| t.iter().all(|&v| faces[v as usize] & TOP != 0)) {
        let offset = t.map(|v| {
            let p = points[v as usize];
            length2(p[0] - centre[0], p[1] - centre[1]) / radius - 1.0
        });
        if offset.iter().any(|&o| o < -ON) && offset.iter().any(|&o| o > ON) {
            return refused(format!(
                "a triangle at {:?} m crosses the contact ring of radius {radius} m",
                points[t[0] as usize]
            ));
        }
    }
    Ok(())
}

fn path(
    domain: &Domain,
    axis: &Axis,
    radius: f64,
    length: f64,
    wanted: usize,
    points: &[Point],
) -> Result<(), CloudError> {
    let top = domain.height();
    let tip = top - length / axis.secant() * (1.0 + ON);
    let captured = |p: &&Point| p[2] >= tip && axis.distance(top, **p) <= radius * (1.0 + ON);
    let found = points.iter().filter(captured).count();
    // under a surface that is no plane some have no place
    let all = if domain.outline().is_some() { found <= wanted } else { found == wanted };
    if !all {
        return refused(format!(
            "{found} nodes lie within the capture radius {radius} m, not the {wanted} of the path"
        ));
    }
    Ok(())
}
