//! What one case gave, and the table of all of them.

use std::fmt::Write as _;

use super::{Case, Steps};

/// Share of the path before which the force is too small to be compared.
const COMPARED_FROM: f64 = 0.2;

/// What one case gave.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Name of the scene.
    pub scene: String,
    /// The case.
    pub case: Case,
    /// Nodes of the model; 0 if it could not be built.
    pub nodes: usize,
    /// Integration points.
    pub integration_points: usize,
    /// Simulated time, s.
    pub simulated_s: f64,
    /// Answered poses.
    pub poses: u64,
    /// Explicit steps.
    pub steps: u64,
    /// Processor time of stepping on one thread, s.
    pub cost_s: f64,
    /// (depth in m, predicted over reference force - 1).
    pub force_error: Vec<(f64, f64)>,
    /// Largest distance between predicted and reference place of a point in the tissue at the last depth, over it.
    pub displacement_error: Option<f64>,
    /// Smallest volume ratio on the way.
    pub min_jacobian: f64,
    /// Times that the twin went back to the last good state.
    pub recoveries: u64,
    /// Why the run ended before its depth, if it did.
    pub ended: Option<String>,
}

/// Errors (depth, error) from a fifth of the path on: before that the force is too small to be compared.
fn compared(errors: &[(f64, f64)]) -> impl Iterator<Item = f64> {
    let from = COMPARED_FROM * errors.last().map_or(0.0, |p| p.0) * (1.0 - 1e-9);
    errors.iter().filter(move |(depth, _)| *depth >= from).map(|p| p.1)
}

/// Largest |error| of a list of (depth, error), from a fifth of the path on.
#[must_use]
pub fn largest_error(errors: &[(f64, f64)]) -> Option<f64> {
    compared(errors).map(f64::abs).reduce(f64::max).filter(|e| e.is_finite())
}

impl Row {
    /// Whether this is the row of a case of a scene.
    #[must_use]
    pub fn is_of(&self, scene: &str, case: &Case) -> bool {
        self.scene == scene && &self.case == case
    }

    /// Largest |relative error of the force| over the path; `None` for a run that ended early.
    #[must_use]
    pub fn max_force_error(&self) -> Option<f64> {
        largest_error(&self.force_error).filter(|_| self.ended.is_none())
    }

    /// Root mean square of the same.
    #[must_use]
    pub fn rms_force_error(&self) -> Option<f64> {
        let compared = || compared(&self.force_error);
        let count = compared().count();
        let whole = self.ended.is_none() && count > 0;
        whole.then(|| (compared().map(|e| e * e).sum::<f64>() / count as f64).sqrt()).filter(|e| e.is_finite())
    }

    /// Processor time per pose, s.
    #[must_use]
    pub fn cost_per_pose_s(&self) -> f64 {
        self.cost_s / self.poses.max(1) as f64
    }

    /// Processor time per simulated second.
    #[must_use]
    pub fn cost_per_simulated_s(&self) -> f64 {
        if self.simulated_s > 0.0 { self.cost_s / self.simulated_s } else { f64::NAN }
    }

    /// Simulated time over processor time: above 1 one thread is faster than real time.
    #[must_use]
    pub fn real_time_factor(&self) -> f64 {
        1.0 / self.cost_per_simulated_s()
    }

    /// A line of the table for people.
    #[must_use]
    pub fn line(&self) -> String {
        let c = &self.case;
        let percent = |e: Option<f64>| e.map_or_else(|| "-".to_owned(), |e| format!("{:.2} %", 100.0 * e));
        format!(
            "{:<17} {:<14} {:<12} {:>6} {:>5.2} {:>3} {:>4} {:>5} {:>5} {:>9} {:>9} {:>9} {:>9.3} {:>7.2}{}\n",
            self.scene,
            c.method_name(),
            c.dimension,
            self.nodes,
            c.support_factor,
            c.points_per_cell.to_string() + if c.joined() == 2 { "/2" } else { "" },
            c.precision,
            c.pose_hz,
            c.steps.to_string(),
            percent(self.max_force_error()),
            percent(self.rms_force_error()),
            percent(self.displacement_error),
            1e3 * self.cost_per_pose_s(),
            self.real_time_factor(),
            self.ended.as_ref().map_or_else(String::new, |why| format!("  ended {why}")),
        )
    }
}

/// Headings of [`Row::line`].
#[must_use]
pub fn heading() -> String {
    format!(
        "{:<17} {:<14} {:<12} {:>6} {:>5} {:>3} {:>4} {:>5} {:>5} {:>9} {:>9} {:>9} {:>9} {:>7}\n",
        "scene",
        "method",
        "dimension",
        "nodes",
        "alpha",
        "pts",
        "real",
        "Hz",
        "steps",
        "max dF/F",
        "RMS dF/F",
        "|du|/d",
        "ms/pose",
        "x real"
    )
}

/// First line of `accuracy.csv`. Columns of errors are relative; costs are processor time of one thread.
pub const COLUMNS: &str = "scene,method,volume_ratio,dimension,spacing_m,edge_spacing_m,support_factor,points_per_cell,\
    cells_per_point,precision,pose_hz,steps_per_pose,nodes,integration_points,simulated_s,poses,steps,cost_s,cost_s_per_simulated_s,\
    cost_s_per_pose,real_time_factor,max_force_error,rms_force_error,displacement_error,min_jacobian,recoveries,ended,\
    force_error_by_depth";

/// The row as a line of `accuracy.csv`, without its end.
#[must_use]
pub fn csv_line(row: &Row) -> String {
    let c = &row.case;
    let maybe = |x: Option<f64>| x.filter(|x| x.is_finite()).map_or_else(String::new, |x| x.to_string());
    let plain = |text: &str| text.replace([',', '\n', '\r', '"'], ";");
    let mut by_depth = String::new();
    for (depth, error) in row.force_error.iter().filter(|(_, error)| error.is_finite()) {
        let _ = write!(by_depth, "{}{depth}:{error}", if by_depth.is_empty() { "" } else { " " });
    }
    [
        plain(&row.scene),
        c.method.clone(),
        c.volume_ratio.clone(),
        c.dimension.clone(),
        c.spacing_m.to_string(),
        c.edge_spacing_m.to_string(),
        c.support_factor.to_string(),
        c.points_per_cell.to_string(),
        c.cells_per_point.to_string(),
        c.precision.clone(),
        c.pose_hz.to_string(),
        c.steps.to_string(),
        row.nodes.to_string(),
        row.integration_points.to_string(),
        row.simulated_s.to_string(),
        row.poses.to_string(),
        row.steps.to_string(),
        row.cost_s.to_string(),
        maybe(Some(row.cost_per_simulated_s())),
        row.cost_per_pose_s().to_string(),
        maybe(Some(row.real_time_factor())),
        maybe(row.max_force_error()),
        maybe(row.rms_force_error()),
        maybe(row.displacement_error),
        row.min_jacobian.to_string(),
        row.recoveries.to_string(),
        row.ended.as_deref().map_or_else(String::new, plain),
        by_depth,
    ]
    .join(",")
}

/// `accuracy.csv`: a line per row.
#[must_use]
pub fn csv(rows: &[Row]) -> String {
    let mut out = format!("{COLUMNS}\n");
    for row in rows {
        out.push_str(&csv_line(row));
        out.push('\n');
    }
    out
}

/// The row of a line of `accuracy.csv`; `None` if it is none. What can be computed from the rest is not read.
#[must_use]
pub fn parse_line(line: &str) -> Option<Row> {
    let f: Vec<&str> = line.split(',').collect();
    if f.len() != COLUMNS.split(',').count() {
        return None;
    }
    let number = |i: usize| f[i].parse::<f64>().ok();
    let pair = |text: &str| -> Option<(f64, f64)> {
        let (depth, error) = text.split_once(':')?;
        Some((depth.parse().ok()?, error.parse().ok()?))
    };
    let case = Case {
        method: f[1].to_owned(),
        volume_ratio: f[2].to_owned(),
        dimension: f[3].to_owned(),
        spacing_m: number(4)?,
        edge_spacing_m: number(5)?,
        support_factor: number(6)?,
        points_per_cell: f[7].parse().ok()?,
        cells_per_point: f[8].parse().ok()?,
        precision: f[9].to_owned(),
        pose_hz: number(10)?,
        steps: f[11].parse::<Steps>().ok()?,
    };
    Some(Row {
        scene: f[0].to_owned(),
        case,
        nodes: f[12].parse().ok()?,
        integration_points: f[13].parse().ok()?,
        simulated_s: number(14)?,
        poses: f[15].parse().ok()?,
        steps: f[16].parse().ok()?,
        cost_s: number(17)?,
        displacement_error: if f[23].is_empty() { None } else { Some(number(23)?) },
        min_jacobian: number(24)?,
        recoveries: f[25].parse().ok()?,
        ended: (!f[26].is_empty()).then(|| f[26].to_owned()),
        force_error: f[27].split_whitespace().map(pair).collect::<Option<_>>()?,
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
pub(super) mod tests {
    use super::*;
    use crate::scene::Scene;

    /// A row of the compression with an error at its last depth.
    pub fn row(nodes: usize, error: f64) -> Row {
        let scene = Scene::preset("compression").unwrap();
        Row {
            scene: scene.name.clone(),
            case: Case::of(&scene).unwrap(),
            nodes,
            integration_points: 5 * nodes,
            simulated_s: 2.0,
            poses: 2000,
            steps: 4000,
            cost_s: 0.5,
            force_error: vec![(0.0001, 9.0), (0.0005, -0.5 * error), (0.0025, error)],
            displacement_error: Some(0.0125),
            min_jacobian: 0.75,
            recoveries: 1,
            ended: None,
        }
    }

    #[test]
    fn the_first_fifth_of_the_path_is_not_compared() {
        let row = row(100, 0.02);
        assert_eq!(row.max_force_error(), Some(0.02));
        assert!((row.rms_force_error().unwrap() - (0.5 * (0.02_f64.powi(2) + 0.01_f64.powi(2))).sqrt()).abs() < 1e-15);
        assert_eq!((row.cost_per_pose_s(), row.cost_per_simulated_s(), row.real_time_factor()), (2.5e-4, 0.25, 4.0));
        let ended = Row { ended: Some("at 1 mm".to_owned()), ..row };
        assert_eq!((ended.max_force_error(), ended.rms_force_error()), (None, None), "a run that ended has no error");
    }

    #[test]
    fn a_row_is_read_back_as_it_was() {
        let mut rows = vec![row(117, 0.0123456789)];
        rows.push(Row { displacement_error: None, ended: Some("at 1 mm: a; b".to_owned()), ..rows[0].clone() });
        rows.push(Row { nodes: 0, poses: 0, simulated_s: 0.0, cost_s: 0.0, force_error: vec![], ..rows[1].clone() });
        rows[1].case.steps = Steps::Fixed(4);
        let text = csv(&rows);
        assert_eq!(text.lines().skip(1).map(|line| parse_line(line).unwrap()).collect::<Vec<_>>(), rows);
        assert_eq!(parse_line(COLUMNS), None, "the heading is no row");
        let line = text.lines().nth(1).unwrap();
        assert!((0..line.len()).filter(|n| line.is_char_boundary(*n)).all(|n| {
            // a line cut within its last field may still look whole: that is why lines without an end don't count
            parse_line(&line[..n]).is_none_or(|_| n > line.rfind(',').unwrap())
        }));
        assert_eq!(heading().len(), rows[0].line().len());
    }
}
