//! Where methods fail, and why. The indentation is continued until it ends, for several methods, with one property
//! changed at a time.
//!
//! A run ends for one of three reasons. It has reached [`DEEPEST_M`]. The twin halted ([`Trouble`], after returns to
//! the last good state with smaller steps). Or the scene can't be discretised.

use serde::{Deserialize, Serialize};

use super::accuracy::StudyError;
use super::{csv, reference};
use needle_core::scene::{Override, Preset, Scene};
use needle_core::twin::{BuildError, Halt, StampedPose, Trouble, Twin};
use needle_estimate::compare::Watch;

/// Depth at which a run counts as complete, m; the sample is 17 mm high.
pub const DEEPEST_M: f64 = 0.013;
/// Depth at which the force is compared, m.
const COMPARED_AT_M: f64 = 0.004;
/// Rate of poses, 1/s.
const POSE_HZ: f64 = 1000.0;
const PRESET: &str = "indentation";

/// A discretisation: its name in the map, and its keys.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Method {
    /// Name in the map.
    pub name: &'static str,
    keys: [(&'static str, &'static str); 2],
}

const fn method(name: &'static str, word: &'static str, ratio: &'static str) -> Method {
    Method { name, keys: [("discretisation.method", word), ("discretisation.volume_ratio", ratio)] }
}

/// Rows of the map: three methods, each with and without the treatment of volumetric locking.
pub const METHODS: [Method; 6] = [
    method("mmls", "mmls", "projected"),
    method("mls", "mls", "projected"),
    method("tet4", "tet4", "projected"),
    method("mmls, no cure", "mmls", "pointwise"),
    method("mls, no cure", "mls", "pointwise"),
    method("tet4, no cure", "tet4", "pointwise"),
];

/// A property and its changed value; everything else is as in `BASE`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Change {
    /// Group of columns in the map.
    pub group: &'static str,
    /// Column.
    pub label: &'static str,
    key: &'static str,
    value: &'static str,
}

const fn change(group: &'static str, label: &'static str, key: &'static str, value: &'static str) -> Change {
    Change { group, label, key, value }
}

/// Changes to the preset in every run. Poisson's ratio 0.49, the support factor 1.8 and the step factor 0.9 are the
/// preset's.
const BASE: [(&str, &str); 4] = [SPACE, PLAIN, (SPACING, "0.00304"), (SPEED, "0.004")];
/// The same for the quick study.
const QUICK_BASE: [(&str, &str); 4] = [SPACE, PLAIN, (SPACING, "0.0055"), (SPEED, "0.008")];
/// The study is of methods in three dimensions.
const SPACE: (&str, &str) = ("discretisation.dimension", "full");
/// Integration that all methods have, including linear tetrahedra.
const PLAIN: (&str, &str) = ("discretisation.integration", "plain");
const NU: &str = "material.poisson_ratio";
const SPACING: &str = "discretisation.spacing_m";
const SUPPORT: &str = "discretisation.support_factor";
const STEP: &str = "stepping.step_factor";
const SPEED: &str = "motion.speed_m_per_s";

/// Shear modulus of a top layer of 2 mm, which exists only in these columns, Pa: multiples of the preset's 1678.
const LAYER: &str = "materials.layer.shear_modulus_pa";
const LAYERED: &str = "top layer's modulus, times";
const TOP_LAYER: &str = r#"
[materials.layer]
model = "neo_hookean"
shear_modulus_pa = 1678.0
[[regions]]
name = "top"
material = "layer"
shape = "layer"
from_depth_m = 0.0
to_depth_m = 0.002
"#;

/// Columns of the map.
pub const CHANGES: [Change; 18] = [
    change("", "base", NU, "0.49"),
    change("Poisson's ratio", "0.3", NU, "0.3"),
    change("Poisson's ratio", "0.45", NU, "0.45"),
    change("Poisson's ratio", "0.499", NU, "0.499"),
    change("spacing, mm", "4.2", SPACING, "0.0042"),
    change("spacing, mm", "2.4", SPACING, "0.0024"),
    change("spacing, mm", "1.9", SPACING, "0.0019"),
    change("support factor", "1.4", SUPPORT, "1.4"),
    change("support factor", "2.2", SUPPORT, "2.2"),
    change("step factor", "1.0", STEP, "1.0"),
    change("step factor", "1.1", STEP, "1.1"),
    change("step factor", "1.5", STEP, "1.5"),
    change("speed, mm/s", "1", SPEED, "0.001"),
    change("speed, mm/s", "20", SPEED, "0.02"),
    change(LAYERED, "0.01", LAYER, "16.78"),
    change(LAYERED, "0.1", LAYER, "167.8"),
    change(LAYERED, "10", LAYER, "16780.0"),
    change(LAYERED, "100", LAYER, "167800.0"),
];

/// One run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Case {
    /// Row.
    pub method: Method,
    /// Column.
    pub change: Change,
    /// Depth at which it ends unless it fails, m.
    pub deepest_m: f64,
    base: [(&'static str, &'static str); 4],
}

/// Why a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Ended {
    /// It reached the requested depth.
    Reached,
    /// A cell was crushed to zero volume or inverted.
    Inversion,
    /// The kinetic energy grew without bound, or values were not finite: the step was too large.
    Step,
    /// The support of a point does not determine its fit.
    SingularMoments,
    /// The scene can't be discretised for another reason.
    Refused,
    /// The user interrupted it.
    Interrupted,
}

impl Ended {
    /// Name in the table.
    #[must_use]
    pub(crate) fn word(self) -> &'static str {
        match self {
            Self::Reached => "reached",
            Self::Inversion => "inversion",
            Self::Step => "step",
            Self::SingularMoments => "singular moment matrix",
            Self::Refused => "refused",
            Self::Interrupted => "interrupted",
        }
    }
}

/// Result of one run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// [`Method::name`].
    pub method: String,
    /// [`Change::group`].
    pub group: String,
    /// [`Change::label`].
    pub label: String,
    /// Nodes.
    pub nodes: usize,
    /// Furthest depth, m.
    pub depth_m: f64,
    /// `Ended::word`.
    pub ended: String,
    /// Predicted over reference force - 1 at 4 mm, or at the reference's last depth before that. Only if Poisson's
    /// ratio is the reference's and there is no layer.
    #[serde(rename = "force_error_at_4mm")]
    pub force_error: Option<f64>,
    /// Smallest volume ratio during the run.
    pub min_jacobian: f64,
    /// Number of times that the twin returned to the last good state.
    pub recoveries: u64,
    /// Number of explicit steps.
    pub steps: u64,
}

/// The runs of the map. `quick`: three methods, five columns, a coarse cloud.
#[must_use]
pub fn cases(quick: bool) -> Vec<Case> {
    let mut cases = Vec::new();
    for method in METHODS {
        for change in CHANGES {
            // a finite element has no support; and a layer is a different problem from locking
            let meaningless = change.key == SUPPORT && method.name.starts_with("tet4")
                || change.key == LAYER && method.name.ends_with("no cure");
            let short = ["mmls", "mmls, no cure", "tet4, no cure"].contains(&method.name)
                && ["base", "0.3", "0.499", "1.5", "20"].contains(&change.label);
            if !meaningless && (short || !quick) {
                let base = if quick { QUICK_BASE } else { BASE };
                cases.push(Case { method, change, deepest_m: DEEPEST_M, base });
            }
        }
    }
    cases
}

impl Case {
    /// The scene of this case.
    ///
    /// # Errors
    /// [`StudyError::Scene`] if the preset does not accept the keys.
    pub(crate) fn scene(&self) -> Result<Scene, StudyError> {
        let depth = self.deepest_m.to_string();
        let mut keys = vec![("motion.depth_m", depth.as_str())];
        keys.extend(self.base);
        keys.extend(self.method.keys);
        keys.push((self.change.key, self.change.value));
        let keys: Vec<_> = keys.iter().map(|(path, value)| Override::text(path, value, "study")).collect();
        let text = Preset::find(PRESET)?.text.to_owned() + if self.change.key == LAYER { TOP_LAYER } else { "" };
        Ok(Scene::from_toml(&text, PRESET)?.with(&keys)?)
    }

    /// Runs the case on the present rayon pool.
    ///
    /// # Errors
    /// [`StudyError`] if there is no such scene. A run that fails is a result, not an error.
    pub fn run(&self, watch: &dyn Watch) -> Result<Row, StudyError> {
        let scene = self.scene()?;
        let speed = scene.motion.map_or(1e-3, |m| m.speed.get());
        let comparable = (scene.material.poisson_ratio.get() - 0.49).abs() < 1e-9 && scene.regions.is_empty();
        let mut row = Row {
            method: self.method.name.to_owned(),
            group: self.change.group.to_owned(),
            label: self.change.label.to_owned(),
            nodes: 0,
            depth_m: 0.0,
            ended: Ended::Reached.word().to_owned(),
            force_error: None,
            min_jacobian: 1.0,
            recoveries: 0,
            steps: 0,
        };
        let ended = match Twin::new(&scene) {
            Ok(mut twin) => self.drive(&mut twin, speed / POSE_HZ, comparable, &mut row, watch),
            Err(BuildError::Approximation(_)) => Ended::SingularMoments,
            Err(_) => Ended::Refused,
        };
        ended.word().clone_into(&mut row.ended);
        Ok(row)
    }

    fn drive(&self, twin: &mut Twin, travel: f64, comparable: bool, row: &mut Row, watch: &dyn Watch) -> Ended {
        row.nodes = twin.nodes();
        let table = reference::force(PRESET).unwrap_or_default();
        let mut ended = Ended::Reached;
        for i in 1.. {
            let depth = (f64::from(i) * travel).min(self.deepest_m);
            let pose = StampedPose { time_s: f64::from(i) / POSE_HZ, pose: twin.pose_at_depth(depth) };
            match twin.step(pose) {
                Ok(prediction) => {
                    row.min_jacobian = row.min_jacobian.min(prediction.health.min_jacobian);
                    let compare = |(d, f): &(f64, f64)| {
                        let here =
                            *d <= COMPARED_AT_M * (1.0 + 1e-9) && (row.depth_m..=depth * (1.0 + 1e-9)).contains(d);
                        here.then(|| prediction.force_n[2] / f - 1.0)
                    };
                    row.force_error = table.iter().rev().find_map(compare).filter(|_| comparable).or(row.force_error);
                    row.depth_m = depth;
                }
                Err(Halt::Diverged { trouble: Trouble::Inverted { .. }, .. }) => ended = Ended::Inversion,
                Err(Halt::Diverged { .. }) => ended = Ended::Step,
                Err(_) => ended = Ended::Refused,
            }
            if watch.cancel().is_cancelled() {
                ended = Ended::Interrupted;
            }
            if ended != Ended::Reached || depth >= self.deepest_m {
                break;
            }
        }
        (row.recoveries, row.steps) = (twin.recoveries(), twin.steps());
        ended
    }
}

/// Headings of [`Row::line`].
#[must_use]
pub fn heading() -> String {
    format!(
        "{:<14} {:<24} {:>6} {:>9} {:>9} {:>7} {:>10} {:>8}  {}\n",
        "method", "change", "nodes", "depth mm", "dF/F 4mm", "min J", "recoveries", "steps", "ended"
    )
}

impl Row {
    /// A line of the printed table.
    #[must_use]
    pub fn line(&self) -> String {
        let error = self.force_error.map_or_else(|| "-".to_owned(), |e| format!("{:+.1} %", 100.0 * e));
        let change = format!("{} {}", self.group, self.label);
        format!(
            "{:<14} {:<24} {:>6} {:>9.2} {error:>9} {:>7.3} {:>10} {:>8}  {}\n",
            self.method,
            change.trim(),
            self.nodes,
            1e3 * self.depth_m,
            self.min_jacobian,
            self.recoveries,
            self.steps,
            self.ended
        )
    }

    /// Whether this is the row of a case.
    #[must_use]
    pub fn is_of(&self, case: &Case) -> bool {
        self.method == case.method.name && self.group == case.change.group && self.label == case.change.label
    }
}

/// `stability.csv`: a line per run.
#[must_use]
pub fn csv(rows: &[Row]) -> String {
    csv::write(rows)
}

/// The rows of a `stability.csv`. Invalid lines are left out, such as the last one of an interrupted run.
#[must_use]
pub fn parse(table: &str) -> Vec<Row> {
    csv::read(table).filter_map(Result::ok).collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn every_case_is_a_scene() {
        let all = cases(false);
        assert!(all.iter().all(|case| case.scene().is_ok()));
        assert!(cases(true).len() < all.len() / 4);
    }

    #[test]
    fn the_table_can_be_read_back() {
        let case = cases(true)[0];
        let row = Row {
            method: case.method.name.to_owned(),
            group: case.change.group.to_owned(),
            label: case.change.label.to_owned(),
            nodes: 3974,
            depth_m: 0.0125,
            ended: Ended::Inversion.word().to_owned(),
            force_error: Some(-0.0125),
            min_jacobian: 0.125,
            recoveries: 6,
            steps: 12_345,
        };
        let rows = [row.clone(), Row { force_error: None, ..row }];
        assert!(rows[0].is_of(&case));
        assert_eq!(parse(&csv(&rows)), rows);
        assert_eq!(parse(&csv(&rows)[..csv(&rows).len() - 9]).len(), 1, "a cut line is left out");
        assert_eq!(heading().lines().count(), 1);
        assert!(rows[0].line().contains("inversion"));
    }
}
