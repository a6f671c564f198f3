//! The result of one case, and the table of all results.

use super::Case;

/// Share of the path before which the force is too small for a comparison.
pub(crate) const COMPARED_FROM: f64 = 0.2;

/// The result of one case.
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
    /// Number of answered poses.
    pub poses: u64,
    /// Number of explicit steps.
    pub steps: u64,
    /// Processor time of stepping on one thread, s.
    pub cost_s: f64,
    /// (depth in m, predicted over reference force - 1).
    pub force_error: Vec<(f64, f64)>,
    /// Largest distance between predicted and reference position of a point in the tissue at the last depth, over
    /// that depth.
    pub displacement_error: Option<f64>,
    /// The same during the motion, over the point's largest displacement, if the reference solution contains it
    /// (`reference_solution::ReferenceSolution::way_error`).
    pub way_error: Option<f64>,
    /// Smallest volume ratio during the run.
    pub min_jacobian: f64,
    /// Number of times that the twin returned to the last good state.
    pub recoveries: u64,
    /// Reason, if the run ended before its depth.
    pub ended: Option<String>,
}

/// Errors (depth, error) from a fifth of the path on: before that the force is too small for a comparison.
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
    /// Whether this is the row of a scene and a case.
    #[must_use]
    pub fn is_of(&self, scene: &str, case: &Case) -> bool {
        self.scene == scene && &self.case == case
    }

    /// Largest |relative error of the force| over the path; `None` for a run that ended early.
    #[must_use]
    pub fn max_force_error(&self) -> Option<f64> {
        largest_error(&self.force_error).filter(|_| self.ended.is_none())
    }

    /// Root mean square relative error of the force over the path.
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

    /// A line of the printed table.
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
            match c.has_hexahedra() {
                true => format!("{}h", c.points_per_hexahedron),
                false => c.points_per_cell.to_string() + if c.joined() == 2 { "/2" } else { "" },
            },
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

#[cfg(test)]
#[allow(clippy::unwrap_used)]
pub(super) mod tests {
    use super::*;
    use needle_core::scene::Scene;

    /// A row of the compression with an error at its last depth.
    pub(crate) fn row(nodes: usize, error: f64) -> Row {
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
            way_error: None,
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
        assert_eq!(heading().len(), ended.line().len() - "  ended at 1 mm".len());
    }
}
