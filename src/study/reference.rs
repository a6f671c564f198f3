//! Independent finite-element solutions of the presets (`bags/reference/`, whose README says how they were made and
//! how far they can be trusted). The solver shares no code with them.

use crate::scene::Target;

/// Displacement of one material point of the indentation at [`DISPLACEMENT_DEPTH_M`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointDisplacement {
    /// Distance from the axis in the undeformed state, m.
    pub radius_m: f64,
    /// Depth below the top in the undeformed state, m.
    pub below_top_m: f64,
    /// Displacement away from the axis, m.
    pub radial_m: f64,
    /// Displacement upwards, m.
    pub vertical_m: f64,
}

/// Depth of the indentation at which displacements are known, m.
pub const DISPLACEMENT_DEPTH_M: f64 = 0.004;
/// Radius on the top surface within which the reference itself is uncertain (the edge of the disc is singular), m.
const NEAR_EDGE_M: f64 = 0.006;
/// Directions from the axis in which each reference displacement is compared, rad.
const AZIMUTHS: [f64; 4] = [0.3, 1.9, 3.4, 5.0];
/// The outermost points of the reference lie outside a cylinder of chords, m.
const OUTERMOST_M: f64 = 0.0145;

/// (depth in m, force in N) of a preset, by rising depth; `None` for a scene without a reference.
#[must_use]
pub fn force(preset: &str) -> Option<Vec<(f64, f64)>> {
    Some(rows::<2>(force_table(preset)?).map(|[depth, force]| (depth, force)).collect())
}

fn force_table(preset: &str) -> Option<&'static str> {
    match preset {
        "compression" => Some(include_str!("../../bags/reference/compression_force.csv")),
        "indentation" => Some(include_str!("../../bags/reference/indentation_force.csv")),
        "needle_insertion" => Some(include_str!("../../bags/reference/needle_force_capture_radius_0.50mm.csv")),
        _ => None,
    }
}

/// Largest relative uncertainty that the reference itself states for its forces, from a fifth of a depth (m) to it.
#[must_use]
pub fn uncertainty(preset: &str, depth_m: f64) -> Option<f64> {
    let compared = (0.2 * depth_m * (1.0 - 1e-9))..=depth_m * (1.0 + 1e-9);
    let deep = rows::<3>(force_table(preset)?).filter(|[depth, ..]| compared.contains(depth));
    deep.map(|[_, force, uncertainty]| uncertainty / force).reduce(f64::max)
}

/// Displacements of the indentation: on the axis, and of the top surface beyond 6 mm radius.
#[must_use]
pub fn indentation_displacements() -> Vec<PointDisplacement> {
    let axis = rows::<2>(include_str!("../../bags/reference/indentation_axis_at_4mm.csv"));
    let top = rows::<3>(include_str!("../../bags/reference/indentation_top_surface_at_4mm.csv"));
    let on_axis = axis.map(|[below_top_m, vertical_m]| PointDisplacement {
        radius_m: 0.0,
        below_top_m,
        radial_m: 0.0,
        vertical_m,
    });
    let on_top = top.map(|[radius_m, radial_m, vertical_m]| PointDisplacement {
        radius_m,
        below_top_m: 0.0,
        radial_m,
        vertical_m,
    });
    on_axis.chain(on_top.filter(|p| p.radius_m >= NEAR_EDGE_M)).collect()
}

/// Where a finite element of a size ended in the indentation.
#[derive(Clone, Debug, PartialEq)]
pub struct ElementStability {
    /// Element.
    pub element: String,
    /// Edge length, mm.
    pub size_mm: f64,
    /// Relative error of the force at 4 mm, if it came there.
    pub force_error: Option<f64>,
    /// Last depth that converged, m.
    pub depth_m: f64,
    /// Whether it came to the depth that was asked for.
    pub reached: bool,
}

/// Ordinary finite elements, axisymmetric, driven to 10 mm with Newton's method; those in three dimensions are left out,
/// since they were stopped on the way.
#[must_use]
pub fn element_stability() -> Vec<ElementStability> {
    let row = |line: &str| {
        let f: Vec<&str> = line.split(',').collect();
        let [element, size, _, _, _, error, depth, _, reason] = f[..] else { return None };
        Some(ElementStability {
            element: element.to_owned(),
            size_mm: size.parse().ok()?,
            force_error: error.parse().ok(),
            depth_m: 1e-3 * depth.parse::<f64>().ok()?,
            reached: reason.starts_with("reached"),
        })
    };
    let table = include_str!("../../bags/reference/finite_element_stability.csv");
    table.lines().skip(1).filter_map(row).filter(|e| !e.element.starts_with("3D")).collect()
}

fn compared() -> impl Iterator<Item = (PointDisplacement, f64)> {
    let points = indentation_displacements().into_iter().filter(|p| p.radius_m <= OUTERMOST_M);
    points.flat_map(|p| AZIMUTHS.into_iter().map(move |a| (p, a)))
}

/// Targets at the points of [`indentation_displacements`], each in four directions, for a sample of a height in m.
#[must_use]
pub fn targets(height: f64) -> Vec<Target> {
    let target = |(i, (p, a)): (usize, (PointDisplacement, f64))| Target {
        name: format!("p{i}"),
        position: [p.radius_m * a.cos(), p.radius_m * a.sin(), height - p.below_top_m],
    };
    compared().enumerate().map(target).collect()
}

/// Where [`targets`] are at [`DISPLACEMENT_DEPTH_M`], m.
#[must_use]
pub fn displaced(height: f64) -> Vec<[f64; 3]> {
    let place = |(p, a): (PointDisplacement, f64)| {
        let r = p.radius_m + p.radial_m;
        [r * a.cos(), r * a.sin(), height - p.below_top_m + p.vertical_m]
    };
    compared().map(place).collect()
}

/// Largest distance between the present positions of [`targets`], m, and the reference at [`DISPLACEMENT_DEPTH_M`], over
/// that depth.
#[must_use]
pub fn displacement_error(positions: &[[f64; 3]], height: f64) -> f64 {
    let distance = |(now, then): (&[f64; 3], [f64; 3])| (0..3).map(|k| (now[k] - then[k]).powi(2)).sum::<f64>().sqrt();
    positions.iter().zip(displaced(height)).map(distance).fold(0.0, f64::max) / DISPLACEMENT_DEPTH_M
}

/// The first N columns of the lines of a table that holds numbers there.
fn rows<const N: usize>(table: &str) -> impl Iterator<Item = [f64; N]> {
    table.lines().filter_map(|line| {
        let mut columns = line.split(',').map(|c| c.trim().parse::<f64>());
        let mut row = [0.0; N];
        for value in &mut row {
            *value = columns.next()?.ok()?;
        }
        Some(row)
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn the_tables_are_whole() {
        assert_eq!(force("compression").unwrap().len(), 10);
        assert_eq!(force("indentation").unwrap()[7], (0.004, 0.340319));
        assert_eq!(force("needle_insertion").unwrap().last().copied(), Some((0.01, 0.0674753)));
        assert_eq!(force("other"), None);
        assert_eq!(element_stability().len(), 23);
        let points = indentation_displacements();
        assert!(points.iter().any(|p| p.radius_m == 0.0) && points.iter().any(|p| p.radius_m > 0.014));
        assert!(points.iter().all(|p| p.below_top_m == 0.0 || p.radius_m == 0.0));
    }
}
