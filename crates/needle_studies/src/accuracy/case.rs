//! A case of the study: one combination of discretisation and stepping for a scene.

use needle_core::scene::Word as _;
use std::fmt;
use std::str::FromStr;

use super::StudyError;
use needle_core::scene::{Dimension, Method, Override, Scene};
use needle_core::twin::coarsest_path;

/// Tolerance of the inertial error for runs to equilibrium; small relative to the errors under study.
const TOLERANCE_AT_REST: &str = "0.003";
/// Significant digits of a spacing.
const DIGITS: i32 = 4;

/// Largest number of steps per pose at a scene's own pace: the key's default.
pub(crate) const MOST_STEPS: u32 = 2000;

/// Explicit steps of one pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Steps {
    /// Chosen by the scene's `stepping` keys.
    Auto,
    /// The same number for every pose that moves.
    Fixed(u32),
    /// The instrument stays at each compared depth until the tissue is at rest, so that no inertia remains.
    Rest,
}

impl fmt::Display for Steps {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Fixed(steps) => write!(f, "{steps}"),
            Self::Rest => f.write_str("rest"),
        }
    }
}

impl FromStr for Steps {
    type Err = std::num::ParseIntError;

    fn from_str(word: &str) -> Result<Self, Self::Err> {
        Ok(match word {
            "auto" => Self::Auto,
            "rest" => Self::Rest,
            number => Self::Fixed(number.parse()?),
        })
    }
}

/// One combination of discretisation and stepping, with the names of the scene's keys.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// `discretisation.method`.
    pub method: String,
    /// `discretisation.volume_ratio`: the treatment of volumetric locking.
    pub volume_ratio: String,
    /// `discretisation.dimension`: `axisymmetric` or `full`.
    pub dimension: String,
    /// Spacing far from all edges, m.
    pub spacing_m: f64,
    /// Spacing at the edge of the instrument's contact or along its path, m.
    pub edge_spacing_m: f64,
    /// `discretisation.growth`; 0 if a table does not contain it.
    pub growth: f64,
    /// `discretisation.path_rings`.
    pub path_rings: u32,
    /// `discretisation.support_factor`. Linear tetrahedra have no support; they keep the scene's value.
    pub support_factor: f64,
    /// `discretisation.points_per_cell`.
    pub points_per_cell: u32,
    /// `discretisation.cells_per_point`, even if it does not apply to the case.
    pub cells_per_point: u32,
    /// `discretisation.points_per_support_node`, even if it does not apply to the case.
    pub points_per_support_node: u32,
    /// `discretisation.points_per_hexahedron`; 0: the cells are tetrahedra.
    pub points_per_hexahedron: u32,
    /// `discretisation.precision`.
    pub precision: String,
    /// Poses per second.
    pub pose_hz: f64,
    /// Steps of one pose.
    pub steps: Steps,
    /// Whether it is corrected by the equilibrium of a finer cloud along the path (`study::correction`).
    pub corrected: bool,
}

/// Coarse surroundings in three dimensions: growth of the spacing, support factor, rings around the path, and the
/// least number, of eight neighbouring points, that must share a support node. Coarse surroundings are too soft, and
/// narrow supports too stiff. The stiffness is reduced if nodes that few points share are left out
/// (`docs/lab/performance.md`).
const GROWTH: f64 = 0.45;
const SUPPORT: f64 = 1.5;
const RINGS: u32 = 2;
const SHARING: u32 = 2;

impl Case {
    /// The scene's own settings.
    ///
    /// # Errors
    /// [`StudyError::NoCloud`] for a scene whose cloud is read from a file, [`StudyError::NoMotion`] for one without
    /// motion.
    pub(crate) fn of(scene: &Scene) -> Result<Self, StudyError> {
        let d = &scene.discretisation;
        let grading = scene.grading().ok_or_else(|| StudyError::NoCloud(scene.name.clone()))?;
        let motion = scene.motion.ok_or_else(|| StudyError::NoMotion(scene.name.clone()))?;
        let spacing_m = grading.spacing.get();
        let dimension = scene.dimension().dimension;
        Ok(Self {
            method: d.method.as_str().to_owned(),
            volume_ratio: scene.volume_ratio_in(dimension).as_str().to_owned(),
            dimension: dimension.as_str().to_owned(),
            spacing_m,
            edge_spacing_m: rounded(spacing_m * grading.edge_refinement),
            growth: grading.growth,
            path_rings: grading.path_rings,
            support_factor: scene.support_factor(),
            points_per_cell: d.points_per_cell,
            cells_per_point: scene.cells_per_point(),
            points_per_support_node: scene.discretisation.points_per_support_node,
            points_per_hexahedron: d.cells.points_per_hexahedron(),
            precision: d.precision.as_str().to_owned(),
            pose_hz: motion.pose_rate.get(),
            steps: Steps::Auto,
            corrected: false,
        })
    }

    /// The same with coarse surroundings and narrow supports, in three dimensions.
    #[must_use]
    pub(crate) fn with_coarse_surroundings(&self) -> Self {
        let points_per_support_node = self.points_per_support_node.max(SHARING);
        Self { growth: GROWTH, support_factor: SUPPORT, path_rings: RINGS, points_per_support_node, ..self.clone() }
    }

    /// The same in another dimension, with the scene's supports and volume ratio for it.
    #[must_use]
    pub(crate) fn in_dimension(&self, scene: &Scene, dimension: Dimension) -> Self {
        let support_factor = scene.support_factor_in(dimension);
        let volume_ratio = scene.volume_ratio_in(dimension).as_str().to_owned();
        Self { dimension: dimension.as_str().to_owned(), support_factor, volume_ratio, ..self.clone() }
    }

    /// The same with all spacings multiplied by a factor. The spacing of a needle's path is limited to what the
    /// needle needs.
    #[must_use]
    pub(crate) fn spaced(&self, scene: &Scene, factor: f64) -> Self {
        let edge = (factor * self.edge_spacing_m).min(self.coarsest_edge(scene));
        Self { spacing_m: rounded(factor * self.spacing_m), edge_spacing_m: rounded(edge), ..self.clone() }
    }

    /// The same with only the spacing at the edge or along the path multiplied by a factor.
    #[must_use]
    pub(crate) fn spaced_at_edge(&self, scene: &Scene, factor: f64) -> Self {
        let edge = factor * self.edge_spacing_m.min(self.coarsest_edge(scene));
        Self { edge_spacing_m: rounded(edge), ..self.clone() }
    }

    /// Spacing along a needle's path above which the needle is not resolved, m.
    fn coarsest_edge(&self, scene: &Scene) -> f64 {
        let half_plane = self.dimension == Dimension::Axisymmetric.as_str();
        match (&scene.instrument, &scene.grading()) {
            (Some(instrument), Some(grading)) => coarsest_path(instrument, grading, half_plane),
            _ => f64::INFINITY,
        }
    }

    /// The scene keys that define the case.
    #[must_use]
    pub(crate) fn keys(&self) -> Vec<(&'static str, String)> {
        let refinement = (self.edge_spacing_m / self.spacing_m).clamp(0.01, 1.0);
        let mut keys = vec![
            ("discretisation.method", self.method.clone()),
            ("discretisation.volume_ratio", self.volume_ratio.clone()),
            ("discretisation.dimension", self.dimension.clone()),
            ("discretisation.spacing_m", self.spacing_m.to_string()),
            ("discretisation.edge_refinement", refinement.to_string()),
            ("discretisation.growth", self.growth.to_string()),
            ("discretisation.path_rings", self.path_rings.to_string()),
            ("discretisation.support_factor", self.support_factor.to_string()),
            ("discretisation.points_per_cell", self.points_per_cell.to_string()),
            ("discretisation.cells_per_point", self.cells_per_point.to_string()),
            ("discretisation.points_per_support_node", self.sharing().to_string()),
            ("discretisation.precision", self.precision.clone()),
            ("motion.pose_hz", self.pose_hz.to_string()),
        ];
        if self.has_hexahedra() {
            keys.push(("discretisation.cells", "hexahedra".to_owned()));
            keys.push(("discretisation.points_per_hexahedron", self.points_per_hexahedron.to_string()));
        } else {
            keys.push(("discretisation.cells", "tetrahedra".to_owned()));
        }
        match self.steps {
            Steps::Auto => {}
            Steps::Fixed(steps) => {
                keys.push(("stepping.min_steps_per_pose", steps.to_string()));
                keys.push(("stepping.max_steps_per_pose", steps.to_string()));
            }
            Steps::Rest => keys.push(("stepping.tolerance", TOLERANCE_AT_REST.to_owned())),
        }
        keys
    }

    /// The scene with the case's keys, without a correction.
    ///
    /// # Errors
    /// [`StudyError::Scene`] if the scene does not accept the keys.
    pub(crate) fn scene(&self, scene: &Scene) -> Result<Scene, StudyError> {
        let keys: Vec<_> = self.keys().iter().map(|(path, value)| Override::text(path, value, "study")).collect();
        // a correction belongs to the scene's own cloud
        let plain = Scene { correction: None, ..scene.clone() };
        Ok(plain.with(&keys)?)
    }

    /// Whether it is a half-plane model.
    #[must_use]
    pub fn is_half_plane(&self) -> bool {
        self.dimension == Dimension::Axisymmetric.as_str()
    }

    /// Whether it models one side of a plane of symmetry.
    #[must_use]
    pub fn is_half(&self) -> bool {
        self.dimension == Dimension::Mirrored.as_str()
    }

    /// Short name of the method with its treatment of locking, or the correction: `mmls`, `tet4, no cure`.
    #[must_use]
    pub fn method_name(&self) -> String {
        match self.volume_ratio.as_str() {
            "projected" | "mixed" if self.corrected => format!("{} corrected", self.method),
            "projected" | "mixed" => self.method.clone(),
            "pointwise" => format!("{}, no cure", self.method),
            other => format!("{}, {other}", self.method),
        }
    }

    /// Whether its cells are hexahedra. Half planes and linear tetrahedra have none.
    #[must_use]
    pub fn has_hexahedra(&self) -> bool {
        self.points_per_hexahedron > 0 && !self.is_half_plane() && self.method != Method::Tet4.as_str()
    }

    /// Number of cells per integration point.
    #[must_use]
    pub fn joined(&self) -> u32 {
        let meshless = !self.has_hexahedra() && self.method != Method::Tet4.as_str();
        let follows = !self.is_half_plane() && self.points_per_cell == 1 && meshless;
        if follows { self.cells_per_point } else { 1 }
    }

    /// Least number, of eight neighbouring points, that must share a support node; 1 for linear tetrahedra, which have no supports.
    #[must_use]
    pub(crate) fn sharing(&self) -> u32 {
        if self.method == Method::Tet4.as_str() { 1 } else { self.points_per_support_node }
    }

    /// Description of the integration points: `1 point per cell`, `1 point per 2 cells`.
    #[must_use]
    pub(crate) fn integration(&self) -> String {
        if self.has_hexahedra() {
            let plural = if self.points_per_hexahedron == 1 { "" } else { "s" };
            return format!("{} point{plural} per hexahedron", self.points_per_hexahedron);
        }
        match (self.points_per_cell, self.joined()) {
            (1, 1) => "1 point per cell".to_owned(),
            (points, 1) => format!("{points} points per cell"),
            (_, cells) => format!("1 point per {cells} cells"),
        }
    }

    /// All settings of the case in one line.
    #[must_use]
    pub fn name(&self) -> String {
        format!(
            "{}, {}, spacing {} mm ({} mm at the edge), growth {}{}, support {}{}, {}, {}, {} Hz, steps {}",
            self.method_name(),
            self.dimension,
            millimetres(self.spacing_m),
            millimetres(self.edge_spacing_m),
            self.growth,
            if self.path_rings == 0 { String::new() } else { format!(", {} rings", self.path_rings) },
            self.support_factor,
            if self.sharing() == 1 { String::new() } else { format!(" (nodes of {} points)", self.sharing()) },
            self.integration(),
            self.precision,
            self.pose_hz,
            self.steps
        )
    }
}

/// A length in mm with four digits, without trailing zeros.
pub(super) fn millimetres(length_m: f64) -> String {
    rounded(1e3 * length_m).to_string()
}

/// A positive number rounded to [`DIGITS`] digits.
pub(super) fn rounded(x: f64) -> f64 {
    // via text, so that 0.00275 is not 0.0027500000000000003
    format!("{x:.*e}", DIGITS as usize - 1).parse().unwrap_or(x)
}
