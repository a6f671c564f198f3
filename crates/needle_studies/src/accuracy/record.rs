//! A row of `accuracy.csv`: flat, one field per column.

use std::fmt::Write as _;

use serde::{Deserialize, Serialize};

use super::{Case, Row};
use crate::csv;

/// The columns of `accuracy.csv`, in order. Errors are relative; costs are processor time of one thread. Derived
/// columns are written for plots and are not read back.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
struct Record {
    scene: String,
    method: String,
    volume_ratio: String,
    dimension: String,
    spacing_m: f64,
    edge_spacing_m: f64,
    #[serde(default)]
    growth: f64,
    #[serde(default)]
    path_rings: u32,
    support_factor: f64,
    points_per_cell: u32,
    cells_per_point: u32,
    #[serde(default = "all_nodes")]
    points_per_support_node: u32,
    #[serde(default)]
    points_per_hexahedron: u32,
    precision: String,
    pose_hz: f64,
    steps_per_pose: String,
    #[serde(default)]
    corrected: bool,
    nodes: usize,
    integration_points: usize,
    simulated_s: f64,
    poses: u64,
    steps: u64,
    cost_s: f64,
    #[serde(skip_deserializing)]
    cost_s_per_simulated_s: Option<f64>,
    #[serde(skip_deserializing)]
    cost_s_per_pose: Option<f64>,
    #[serde(skip_deserializing)]
    real_time_factor: Option<f64>,
    #[serde(skip_deserializing)]
    max_force_error: Option<f64>,
    #[serde(skip_deserializing)]
    rms_force_error: Option<f64>,
    displacement_error: Option<f64>,
    #[serde(default)]
    way_error: Option<f64>,
    min_jacobian: f64,
    recoveries: u64,
    ended: Option<String>,
    /// `DEPTH:ERROR` for each depth, m and relative.
    force_error_by_depth: String,
}

/// The default for a table without this column.
const fn all_nodes() -> u32 {
    1
}

impl From<&Row> for Record {
    fn from(row: &Row) -> Self {
        let c = row.case.clone();
        let finite = |x: f64| Some(x).filter(|x| x.is_finite());
        Self {
            scene: row.scene.clone(),
            method: c.method,
            volume_ratio: c.volume_ratio,
            dimension: c.dimension,
            spacing_m: c.spacing_m,
            edge_spacing_m: c.edge_spacing_m,
            growth: c.growth,
            path_rings: c.path_rings,
            support_factor: c.support_factor,
            points_per_cell: c.points_per_cell,
            cells_per_point: c.cells_per_point,
            points_per_support_node: c.points_per_support_node,
            points_per_hexahedron: c.points_per_hexahedron,
            precision: c.precision,
            pose_hz: c.pose_hz,
            steps_per_pose: c.steps.to_string(),
            corrected: c.corrected,
            nodes: row.nodes,
            integration_points: row.integration_points,
            simulated_s: row.simulated_s,
            poses: row.poses,
            steps: row.steps,
            cost_s: row.cost_s,
            cost_s_per_simulated_s: finite(row.cost_per_simulated_s()),
            cost_s_per_pose: finite(row.cost_per_pose_s()),
            real_time_factor: finite(row.real_time_factor()),
            max_force_error: row.max_force_error(),
            rms_force_error: row.rms_force_error(),
            displacement_error: row.displacement_error.and_then(finite),
            way_error: row.way_error,
            min_jacobian: row.min_jacobian,
            recoveries: row.recoveries,
            ended: row.ended.clone(),
            force_error_by_depth: by_depth(&row.force_error),
        }
    }
}

impl Record {
    /// The row; `None` if a text is not a valid value.
    fn row(self) -> Option<Row> {
        let pair = |text: &str| -> Option<(f64, f64)> {
            let (depth, error) = text.split_once(':')?;
            Some((depth.parse().ok()?, error.parse().ok()?))
        };
        Some(Row {
            scene: self.scene,
            case: Case {
                method: self.method,
                volume_ratio: self.volume_ratio,
                dimension: self.dimension,
                spacing_m: self.spacing_m,
                edge_spacing_m: self.edge_spacing_m,
                growth: self.growth,
                path_rings: self.path_rings,
                support_factor: self.support_factor,
                points_per_cell: self.points_per_cell,
                cells_per_point: self.cells_per_point,
                points_per_support_node: self.points_per_support_node,
                points_per_hexahedron: self.points_per_hexahedron,
                precision: self.precision,
                pose_hz: self.pose_hz,
                steps: self.steps_per_pose.parse().ok()?,
                corrected: self.corrected,
            },
            nodes: self.nodes,
            integration_points: self.integration_points,
            simulated_s: self.simulated_s,
            poses: self.poses,
            steps: self.steps,
            cost_s: self.cost_s,
            force_error: self.force_error_by_depth.split_whitespace().map(pair).collect::<Option<_>>()?,
            displacement_error: self.displacement_error,
            way_error: self.way_error,
            min_jacobian: self.min_jacobian,
            recoveries: self.recoveries,
            ended: self.ended,
        })
    }
}

fn by_depth(errors: &[(f64, f64)]) -> String {
    let mut text = String::new();
    for (depth, error) in errors.iter().filter(|(_, error)| error.is_finite()) {
        let _ = write!(text, "{}{depth}:{error}", if text.is_empty() { "" } else { " " }); // writing to a String can't fail
    }
    text
}

/// `accuracy.csv`: a heading, and a line per row.
#[must_use]
pub fn csv(rows: &[Row]) -> String {
    format!("{}{}", heading(), rows.iter().map(line).collect::<String>())
}

/// First line of `accuracy.csv`.
pub(super) fn heading() -> String {
    let text = csv::write([Record::default()]);
    text.split_inclusive('\n').next().unwrap_or_default().to_owned()
}

/// A row as a line of `accuracy.csv`, including the line end.
pub(super) fn line(row: &Row) -> String {
    csv::line(Record::from(row))
}

/// The rows of the lines after the heading; `None` for an invalid line.
pub(super) fn rows(table: &str) -> impl Iterator<Item = Option<Row>> + use<'_> {
    csv::read::<Record>(table).map(|record| record.ok()?.row())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::super::Steps;
    use super::super::row::tests::row;
    use super::*;

    #[test]
    fn a_row_is_read_back_as_it_was() {
        let mut all = vec![row(117, 0.0123456789)];
        let ended = Some("at 1 mm: \"a\", b\nand c".to_owned());
        all.push(Row { displacement_error: None, ended, ..all[0].clone() });
        all.push(Row { nodes: 0, poses: 0, simulated_s: 0.0, cost_s: 0.0, force_error: vec![], ..all[1].clone() });
        all[1].case.steps = Steps::Fixed(4);
        assert_eq!(rows(&csv(&all)).collect::<Option<Vec<_>>>().unwrap(), all);
    }

    #[test]
    fn a_line_that_was_cut_is_no_row_before_its_last_field() {
        let (heading, line) = (heading(), line(&row(117, 0.0123456789)));
        let cut = |n: usize| rows(&format!("{heading}{}", &line[..n])).next().flatten();
        // a line cut within its last field may still look complete: therefore lines without a line end don't count
        assert!((1..line.len()).all(|n| cut(n).is_none() || n > line.rfind(',').unwrap()));
    }

    #[test]
    fn columns_are_found_by_their_names() {
        let text = csv(&[row(117, 0.0123456789)]);
        let swapped = text.replacen("nodes,integration_points", "integration_points,nodes", 1);
        let read = rows(&swapped).next().flatten().unwrap();
        assert_eq!((read.nodes, read.integration_points), (585, 117));
    }
}
