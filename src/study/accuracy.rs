//! Accuracy against cost: a preset's cloud is coarsened and refined, and the force and the displacement *at rest* are
//! compared with independent finite elements, for several methods and cures of volumetric locking.
//!
//! At rest means that the instrument stays at each depth of the reference until the twin takes no more steps, so what
//! is left is the error of the discretisation, without inertia. The observed order q comes from a least-squares line
//! through log(error) over log(h), with h the mean distance of nodes, (V / nodes)^(1/3).

use std::fmt::Write as _;
use std::time::Instant;

use super::reference::{self, DISPLACEMENT_DEPTH_M};
use crate::scene::{InstrumentKind, Override, Scene, SceneError};
use crate::twin::{BuildError, Halt, PATH_SPACING, StampedPose, Twin};

/// Poses between two depths of the reference: near enough for the motion to be quasi-static without the rests.
const POSES_PER_DEPTH: usize = 25;
/// Poses that the instrument may rest at one depth.
const LONGEST_REST: usize = 400;
/// Time between two poses, s.
const POSE_PERIOD_S: f64 = 0.01;
/// Inertial error that is tolerated: small against the errors under study.
const TOLERANCE: &str = "0.003";

/// A way to discretise: its name in the table, and the keys that make it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Variant {
    /// Name in the table.
    pub name: &'static str,
    /// Keys of the scene.
    pub keys: &'static [(&'static str, &'static str)],
}

/// Methods of the quick form.
pub const QUICK: usize = 3;

/// The methods and the cures of locking that are compared; the first is the default.
pub const VARIANTS: [Variant; 6] = [
    Variant { name: "mmls", keys: &[] },
    Variant { name: "mls", keys: &[("discretisation.method", "mls")] },
    Variant { name: "tet4", keys: &[("discretisation.method", "tet4")] },
    Variant { name: "mmls, averaged", keys: &[("discretisation.volume_ratio", "averaged")] },
    Variant { name: "mmls, pointwise", keys: &[("discretisation.volume_ratio", "pointwise")] },
    Variant { name: "mmls, 4 points", keys: &[("discretisation.points_per_cell", "4")] },
];

/// Factors on the spacing of a preset's nodes, coarse first.
///
/// Of the needle's cloud only the path is refined, and never coarsened: half a capture radius, the preset's spacing
/// there, is the coarsest that a needle takes, and the force depends on little else.
fn spacings(preset: &str) -> [f64; 3] {
    match preset {
        NEEDLE => [1.0, 0.7, 0.5],
        _ => [1.6, 1.25, 1.0],
    }
}

const NEEDLE: &str = "needle_insertion";
/// Depth of the needle in this study, m: the finest path to the preset's whole depth would take an hour per run.
const NEEDLE_DEPTH_M: f64 = 0.005;

/// One run of the study.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// Preset.
    pub preset: &'static str,
    /// Method.
    pub variant: Variant,
    /// Factor on the preset's spacing; of the needle's cloud, on that of the path.
    pub spacing: f64,
    /// Depth to go to, m.
    pub depth_m: f64,
}

/// What one run gave.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// The run.
    pub case: Case,
    /// Nodes.
    pub nodes: usize,
    /// Integration points.
    pub integration_points: usize,
    /// (depth in m, predicted over reference force - 1).
    pub force_error: Vec<(f64, f64)>,
    /// Largest distance between predicted and reference displacement over the depth, indentation at 4 mm only.
    pub displacement_error: Option<f64>,
    /// Explicit steps.
    pub steps: u64,
    /// Wall time per step and integration point, ns.
    pub ns_per_point: f64,
    /// Why the run ended before its depth, if it did.
    pub ended: Option<String>,
}

/// Why a case can't be run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StudyError {
    /// There is no reference for the scene.
    #[error(
        "there is no reference solution of {0}; the presets compression, indentation and needle_insertion have one"
    )]
    NoReference(String),
    /// The scene is wrong.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// It can't be discretised.
    #[error("{0}")]
    Build(#[from] BuildError),
}

/// The cases of a study with these methods, cheapest first. `quick` leaves out the finest clouds and stops at half of the
/// depth.
#[must_use]
pub fn cases(presets: &[&'static str], variants: &[Variant], quick: bool) -> Vec<Case> {
    let mut cases = Vec::new();
    for &preset in presets {
        // the reference of the indentation is good to 0.45% up to 4 mm, and to 2% beyond
        let deepest = match preset {
            "indentation" => DISPLACEMENT_DEPTH_M,
            NEEDLE => NEEDLE_DEPTH_M,
            _ => reference::force(preset).and_then(|f| f.last().map(|p| p.0)).unwrap_or(0.0),
        };
        let depth_m = if quick { 0.5 * deepest } else { deepest };
        for &spacing in &spacings(preset)[..if quick { 2 } else { 3 }] {
            for variant in variants {
                cases.push(Case { preset, variant: *variant, spacing, depth_m });
            }
        }
    }
    cases
}

impl Case {
    /// The scene of this case.
    ///
    /// # Errors
    /// [`StudyError::Scene`] if the preset does not take the keys.
    pub fn scene(&self) -> Result<Scene, StudyError> {
        let preset = Scene::preset(self.preset)?;
        let (far, near) =
            preset.discretisation.grading.map_or((f64::NAN, f64::NAN), |g| (g.spacing.get(), g.edge_refinement));
        let (key, value) = match preset.instrument.map(|i| i.kind) {
            Some(InstrumentKind::Needle(needle)) => {
                let path = (far * near).min(PATH_SPACING * needle.capture_radius.get());
                ("discretisation.edge_refinement", self.spacing * path / far)
            }
            _ => ("discretisation.spacing_m", self.spacing * far),
        };
        // the study is of clouds in space, where a scene of its own accord takes the least model
        let mut keys = vec![
            Override::text("discretisation.dimension", "full", "study"),
            Override::text(key, &value.to_string(), "study"),
            Override::text("motion.depth_m", &format!("{}", self.depth_m), "study"),
            Override::text("stepping.tolerance", TOLERANCE, "study"),
        ];
        keys.extend(self.variant.keys.iter().map(|(path, value)| Override::text(path, value, "study")));
        let mut scene = preset.with(&keys)?;
        if self.compares_displacements() {
            scene.targets =
                scene.sample.shape.height().map_or_else(Vec::new, |height| reference::targets(height.get()));
        }
        Ok(scene)
    }

    fn compares_displacements(&self) -> bool {
        self.preset == "indentation" && self.depth_m >= DISPLACEMENT_DEPTH_M
    }

    /// Runs the case on the present rayon pool.
    ///
    /// # Errors
    /// [`StudyError`] if there is no reference or no cloud. A solution that diverges is a result, not an error.
    pub fn run(&self) -> Result<Row, StudyError> {
        let mut table = reference::force(self.preset).ok_or_else(|| StudyError::NoReference(self.preset.to_owned()))?;
        table.retain(|(depth, _)| *depth <= self.depth_m * (1.0 + 1e-9));
        let mut twin = Twin::new(&self.scene()?)?;
        let mut row = Row {
            case: self.clone(),
            nodes: twin.nodes(),
            integration_points: twin.integration_points(),
            force_error: Vec::new(),
            displacement_error: None,
            steps: 0,
            ns_per_point: 0.0,
            ended: None,
        };
        let start = Instant::now();
        let mut walk = Walk { twin: &mut twin, poses: 0, depth_m: 0.0 };
        for (depth, force) in table {
            match walk.rest_at(depth) {
                Ok(predicted) => row.force_error.push((depth, predicted / force - 1.0)),
                Err(halt) => {
                    row.ended = Some(format!("at {:.2} mm: {halt}", 1e3 * depth));
                    break;
                }
            }
        }
        row.steps = twin.steps();
        let work = row.steps.max(1) as f64 * row.integration_points as f64;
        row.ns_per_point = 1e9 * start.elapsed().as_secs_f64() / work;
        if self.compares_displacements() && row.ended.is_none() {
            let mut positions = Vec::new();
            twin.target_positions(&mut positions);
            row.displacement_error = Some(reference::displacement_error(&positions, twin.pose_at_depth(0.0).tip[2]));
        }
        Ok(row)
    }
}

struct Walk<'a> {
    twin: &'a mut Twin,
    poses: usize,
    depth_m: f64,
}

impl Walk<'_> {
    /// Goes to a depth, waits until the tissue is at rest, and returns the force, N.
    fn rest_at(&mut self, depth_m: f64) -> Result<f64, Halt> {
        let from = self.depth_m;
        for i in 1..=POSES_PER_DEPTH {
            self.pose(from + (depth_m - from) * i as f64 / POSES_PER_DEPTH as f64)?;
        }
        self.depth_m = depth_m;
        let mut answer = self.pose(depth_m)?;
        for _ in 0..LONGEST_REST {
            if answer.1 == 0 {
                break;
            }
            answer = self.pose(depth_m)?;
        }
        Ok(answer.0)
    }

    fn pose(&mut self, depth_m: f64) -> Result<(f64, u32), Halt> {
        let pose = self.twin.pose_at_depth(depth_m);
        self.poses += 1;
        let answer = self.twin.step(StampedPose { time_s: POSE_PERIOD_S * self.poses as f64, pose })?;
        Ok((answer.force_n[2], answer.steps))
    }
}

impl Row {
    /// Largest |force error|, from a fifth of the depth on: before that the force is too small to be compared.
    #[must_use]
    pub fn largest_force_error(&self) -> f64 {
        let deep = self.force_error.iter().filter(|(depth, _)| *depth >= 0.2 * self.case.depth_m * (1.0 - 1e-9));
        deep.map(|(_, e)| e.abs()).fold(0.0, f64::max)
    }

    /// Force error at the last depth that was reached.
    #[must_use]
    pub fn last_force_error(&self) -> Option<f64> {
        self.force_error.last().map(|p| p.1)
    }
}

/// Observed order of an error in the mean distance of nodes, over the rows of one preset and method; `None` for fewer
/// than two rows, or where an error is missing or zero.
#[must_use]
pub fn observed_order<'a>(rows: impl Iterator<Item = &'a Row>, error: impl Fn(&Row) -> Option<f64>) -> Option<f64> {
    let mut points = Vec::new();
    for row in rows {
        let e = error(row).filter(|e| *e > 0.0)?;
        points.push((-(row.nodes as f64).ln() / 3.0, e.ln()));
    }
    if points.len() < 2 {
        return None;
    }
    let n = points.len() as f64;
    let mean = |f: fn(&(f64, f64)) -> f64| points.iter().map(f).sum::<f64>() / n;
    let (x, y) = (mean(|p| p.0), mean(|p| p.1));
    let square: f64 = points.iter().map(|p| (p.0 - x).powi(2)).sum();
    (square > 0.0).then(|| points.iter().map(|p| (p.0 - x) * (p.1 - y)).sum::<f64>() / square)
}

/// Headings of [`Row::line`].
#[must_use]
pub fn heading() -> String {
    format!(
        "{:<17} {:<16} {:>6} {:>7} {:>12} {:>12} {:>10} {:>7} {:>9}\n",
        "scene", "method", "nodes", "points", "largest dF/F", "last dF/F", "|du|/depth", "steps", "ns/point"
    )
}

impl Row {
    /// A line of the table for people.
    #[must_use]
    pub fn line(&self) -> String {
        let percent = |x: f64| format!("{:.2} %", 100.0 * x);
        let or_dash = |x: Option<String>| x.unwrap_or_else(|| "-".to_owned());
        format!(
            "{:<17} {:<16} {:>6} {:>7} {:>12} {:>12} {:>10} {:>7} {:>9.0}{}\n",
            self.case.preset,
            self.case.variant.name,
            self.nodes,
            self.integration_points,
            percent(self.largest_force_error()),
            or_dash(self.last_force_error().map(|e| format!("{:+.2} %", 100.0 * e))),
            or_dash(self.displacement_error.map(percent)),
            self.steps,
            self.ns_per_point,
            self.ended.as_ref().map_or_else(String::new, |why| format!("  ended {why}")),
        )
    }
}

/// Observed orders of the rows, a line per scene and method.
#[must_use]
pub fn orders(rows: &[Row]) -> String {
    let mut out = String::new();
    for (preset, name) in groups(rows) {
        let of = || rows.iter().filter(|r| r.case.preset == preset && r.case.variant.name == name);
        let order = |q: Option<f64>| q.map_or_else(|| "-".to_owned(), |q| format!("{q:.1}"));
        let _ = writeln!(
            out,
            "observed order, {preset}, {name}: force {}, displacement {}",
            order(observed_order(of(), |r| Some(r.largest_force_error()))),
            order(observed_order(of(), |r| r.displacement_error)),
        );
    }
    out
}

/// Presets and methods of the rows, each once, in their order.
fn groups(rows: &[Row]) -> Vec<(&'static str, &'static str)> {
    let mut groups = Vec::new();
    for row in rows {
        let group = (row.case.preset, row.case.variant.name);
        if !groups.contains(&group) {
            groups.push(group);
        }
    }
    groups
}

/// `accuracy.csv`: a line per depth of the reference.
#[must_use]
pub fn csv(rows: &[Row]) -> String {
    let mut out = String::from(
        "scene,method,spacing_factor,nodes,integration_points,depth_m,relative_force_error,\
         relative_displacement_error,steps,ns_per_point\n",
    );
    for row in rows {
        for (depth, error) in &row.force_error {
            let _ = writeln!(
                out,
                "{},\"{}\",{},{},{},{depth},{error:.6},{},{},{:.1}",
                row.case.preset,
                row.case.variant.name,
                row.case.spacing,
                row.nodes,
                row.integration_points,
                row.displacement_error.map_or_else(String::new, |e| format!("{e:.6}")),
                row.steps,
                row.ns_per_point,
            );
        }
    }
    out
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn row(nodes: usize, error: f64) -> Row {
        let case = Case { preset: "compression", variant: VARIANTS[0], spacing: 1.0, depth_m: 1.0 };
        Row {
            case,
            nodes,
            integration_points: 1,
            force_error: vec![(1.0, error)],
            displacement_error: None,
            steps: 1,
            ns_per_point: 1.0,
            ended: None,
        }
    }

    #[test]
    fn the_order_of_a_quadratic_error_is_two() {
        let rows = [row(1000, 0.04), row(8000, 0.01), row(64_000, 0.0025)];
        let order = observed_order(rows.iter(), |r| Some(r.largest_force_error())).unwrap();
        assert!((order - 2.0).abs() < 1e-12, "{order}");
        assert_eq!(observed_order(rows[..1].iter(), |r| Some(r.largest_force_error())), None);
        assert_eq!(observed_order(rows.iter(), |r| r.displacement_error), None);
        assert!(orders(&rows).contains("force 2.0, displacement -"));
        assert_eq!(heading().len(), rows[0].line().len());
        assert_eq!(csv(&rows).lines().count(), 4);
    }

    #[test]
    fn every_case_is_a_scene() {
        for case in cases(&["compression", "indentation", NEEDLE], &VARIANTS, false) {
            let scene = case.scene().unwrap();
            assert!(scene.motion.unwrap().depth.get() >= case.depth_m * 0.999, "{case:?}");
        }
    }
}
