//! Independent finite-element solutions of the presets (`bags/reference/`, whose README describes how they were made
//! and how accurate they are). The solver shares no code with them.

use serde::Deserialize;

use super::composites::Composite;
use super::csv;
use needle_core::scene::Target;

/// Displacement of one material point of the indentation at [`DISPLACEMENT_DEPTH_M`].
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
pub(crate) struct PointDisplacement {
    /// Distance from the axis in the undeformed state, m.
    #[serde(default, alias = "reference_radius_m")]
    pub radius_m: f64,
    /// Depth below the top in the undeformed state, m.
    #[serde(default, alias = "depth_below_top_m")]
    pub below_top_m: f64,
    /// Displacement away from the axis, m.
    #[serde(default, alias = "radial_displacement_m")]
    pub radial_m: f64,
    /// Displacement upwards, m.
    #[serde(alias = "vertical_displacement_m")]
    pub vertical_m: f64,
}

/// Depth of the indentation for which displacements are known, m.
pub(crate) const DISPLACEMENT_DEPTH_M: f64 = 0.004;
/// Radius on the top surface within which the reference itself is uncertain (singularity at the edge of the disc), m.
const NEAR_EDGE_M: f64 = 0.006;
/// Directions from the axis in which each reference displacement is compared, rad.
const AZIMUTHS: [f64; 4] = [0.3, 1.9, 3.4, 5.0];
/// Limit of the reference points, m: the outermost ones lie outside a cylinder of chords.
const OUTERMOST_M: f64 = 0.0145;

/// (depth in m, force in N) of a preset, by rising depth; `None` for a scene without a reference.
#[must_use]
pub fn force(preset: &str) -> Option<Vec<(f64, f64)>> {
    Some(
        csv::read(force_table(preset)?)
            .filter_map(Result::ok)
            .map(|p: ForcePoint| (p.depth_m, p.walled_n.unwrap_or(p.force_n)))
            .collect(),
    )
}

/// A line of a force table.
#[derive(Deserialize)]
struct ForcePoint {
    #[serde(alias = "displacement_m")]
    depth_m: f64,
    #[serde(rename = "force_N")]
    force_n: f64,
    /// Force with the tissue kept outside the wall of the indenter, as in the preset.
    #[serde(rename = "force_with_indenter_side_contact_N")]
    walled_n: Option<f64>,
    #[serde(rename = "uncertainty_N")]
    uncertainty_n: f64,
}

fn force_table(preset: &str) -> Option<&'static str> {
    match preset {
        "compression" => Some(include_str!("../bags/reference/compression_force.csv")),
        "indentation" => Some(include_str!("../bags/reference/indentation_force.csv")),
        "needle_insertion" => Some(include_str!("../bags/reference/needle_force_capture_radius_0.50mm.csv")),
        other => Composite::find(other).map(|composite| composite.table),
    }
}

/// Largest relative uncertainty that the reference states for its forces, from a fifth of a depth (m) to the depth.
#[must_use]
pub fn uncertainty(preset: &str, depth_m: f64) -> Option<f64> {
    let compared = (0.2 * depth_m * (1.0 - 1e-9))..=depth_m * (1.0 + 1e-9);
    let points = csv::read(force_table(preset)?).filter_map(Result::ok);
    let deep = points.filter(|p: &ForcePoint| compared.contains(&p.depth_m));
    deep.map(|p| p.uncertainty_n / p.force_n).reduce(f64::max)
}

/// Displacements of the indentation: on the axis, and of the top surface beyond 6 mm radius.
#[must_use]
pub(crate) fn indentation_displacements() -> Vec<PointDisplacement> {
    let axis = csv::read(include_str!("../bags/reference/indentation_axis_at_4mm.csv"));
    let top = csv::read(include_str!("../bags/reference/indentation_top_surface_at_4mm.csv"));
    let on_axis = axis.filter_map(Result::ok);
    let on_top = top.filter_map(Result::ok);
    on_axis.chain(on_top.filter(|p: &PointDisplacement| p.radius_m >= NEAR_EDGE_M)).collect()
}

/// Depth at which a finite element model with an element size ended in the indentation.
#[derive(Clone, Debug, PartialEq)]
pub struct ElementStability {
    /// Element type.
    pub element: String,
    /// Edge length, mm.
    pub size_mm: f64,
    /// Relative error of the force at 4 mm, if it reached that depth.
    pub force_error: Option<f64>,
    /// Last depth that converged, m.
    pub depth_m: f64,
    /// Whether it reached the requested depth.
    pub reached: bool,
}

/// Ordinary finite elements, axisymmetric, driven to 10 mm with Newton's method. Three-dimensional ones are left out,
/// because they were stopped early.
#[must_use]
pub fn element_stability() -> Vec<ElementStability> {
    let table = include_str!("../bags/reference/finite_element_stability.csv");
    let row = |line: Line| ElementStability {
        element: line.element,
        size_mm: line.size_mm,
        force_error: line.relative_error_at_4mm,
        depth_m: 1e-3 * line.last_converged_depth_mm,
        reached: line.stop_reason.starts_with("reached"),
    };
    csv::read(table).filter_map(Result::ok).map(row).filter(|e| !e.element.starts_with("3D")).collect()
}

/// A line of `finite_element_stability.csv`.
#[derive(Deserialize)]
struct Line {
    element: String,
    size_mm: f64,
    relative_error_at_4mm: Option<f64>,
    last_converged_depth_mm: f64,
    stop_reason: String,
}

fn compared() -> impl Iterator<Item = (PointDisplacement, f64)> {
    let points = indentation_displacements().into_iter().filter(|p| p.radius_m <= OUTERMOST_M);
    points.flat_map(|p| AZIMUTHS.into_iter().map(move |a| (p, a)))
}

/// Targets at the points of [`indentation_displacements`], each in four directions, for a sample of a height in m.
#[must_use]
pub(crate) fn targets(height: f64) -> Vec<Target> {
    let target = |(i, (p, a)): (usize, (PointDisplacement, f64))| Target {
        name: format!("p{i}"),
        position: [p.radius_m * a.cos(), p.radius_m * a.sin(), height - p.below_top_m],
    };
    compared().enumerate().map(target).collect()
}

/// Positions of [`targets`] at [`DISPLACEMENT_DEPTH_M`], m.
#[must_use]
pub(crate) fn displaced(height: f64) -> Vec<[f64; 3]> {
    let place = |(p, a): (PointDisplacement, f64)| {
        let r = p.radius_m + p.radial_m;
        [r * a.cos(), r * a.sin(), height - p.below_top_m + p.vertical_m]
    };
    compared().map(place).collect()
}

/// Largest distance between the present positions of [`targets`], m, and the reference at [`DISPLACEMENT_DEPTH_M`], over
/// that depth.
#[must_use]
pub(crate) fn displacement_error(positions: &[[f64; 3]], height: f64) -> f64 {
    let distance = |(now, then): (&[f64; 3], [f64; 3])| (0..3).map(|k| (now[k] - then[k]).powi(2)).sum::<f64>().sqrt();
    positions.iter().zip(displaced(height)).map(distance).fold(0.0, f64::max) / DISPLACEMENT_DEPTH_M
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn the_tables_are_whole() {
        assert_eq!(force("compression").unwrap().len(), 10);
        assert_eq!(force("indentation").unwrap()[7], (0.004, 0.342379));
        assert_eq!(force("needle_insertion").unwrap().last().copied(), Some((0.01, 0.0674753)));
        assert_eq!(force("other"), None);
        assert_eq!(element_stability().len(), 23);
        let points = indentation_displacements();
        assert!(points.iter().any(|p| p.radius_m == 0.0) && points.iter().any(|p| p.radius_m > 0.014));
        assert!(points.iter().all(|p| p.below_top_m == 0.0 || p.radius_m == 0.0));
    }
}
