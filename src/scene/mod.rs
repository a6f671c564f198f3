//! What is modelled: sample, material, instrument, discretisation, motion, targets, outputs.
//!
//! A scene is a TOML file that names only what is in it. [`Scene`] is the validated form, SI units.
//!
//! The way of a scene: text → `parse` (every key looked up in the one registry, [`keys`]) → raw values →
//! `convert` → [`Scene`] → `check` (do the parts fit together?). `--set` and parameters meet the file at the raw
//! values, so that all of them obey the same types, ranges and messages.

use mtled::material::{Distortional, Law, Ogden, Prony, Volumetric};
use mtled::solver::{Precision, VolumeRatio};

mod advice;
mod check;
mod convert;
mod edit;
mod error;
pub mod file;
mod key;
pub mod keys;
mod motion;
mod parse;
mod presets;
mod range;
pub mod size;
mod symmetry;
mod units;
mod value;
mod values;
mod words;

pub use edit::{NewValue, Override};
pub use error::SceneError;
pub use key::{Key, Kind};
pub use presets::{PRESETS, Preset};
pub use range::Range;
pub use symmetry::Resolved;
pub use units::{Hertz, KilogramsPerCubicMetre, Metres, MetresPerSecond, Pascals, PoissonRatio, Radians, Seconds};
pub use value::Value;
pub use words::Word;

/// A validated scene: everything that [`crate::twin::Twin`] needs, and nothing that is not modelled.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Short name, as `scene list` prints it.
    pub name: String,
    /// One or more sentences: what it is, what is assumed.
    pub description: String,
    /// The tissue sample.
    pub sample: Sample,
    /// Its constitutive law.
    pub material: Material,
    /// The instrument; absent: nothing touches the sample.
    pub instrument: Option<Instrument>,
    /// How the field is approximated.
    pub discretisation: Discretisation,
    /// How poses become explicit steps.
    pub stepping: Stepping,
    /// The scene's own motion, for `solve`; absent: poses come from outside only.
    pub motion: Option<Motion>,
    /// Material points whose position is predicted.
    pub targets: Vec<Target>,
}

/// The sample's geometry. Frame `sample`: origin at the centre of the bottom face, z up; a mesh brings its own origin.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    /// Shape and size.
    pub shape: Shape,
}

/// Shape and size of the sample.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// Upright cylinder.
    Cylinder {
        /// Diameter.
        diameter: Metres,
        /// Height; the top face is at z = height.
        height: Metres,
    },
    /// Upright box, centred on the z axis.
    Box {
        /// Edge along x.
        size_x: Metres,
        /// Edge along y.
        size_y: Metres,
        /// Height; the top face is at z = height.
        height: Metres,
    },
    /// A tetrahedral mesh from a file, in the file's own frame, z up.
    Mesh(MeshFile),
}

impl Shape {
    /// Height of a cylinder or box; a mesh has to be read for it.
    #[must_use]
    pub const fn height(&self) -> Option<Metres> {
        match self {
            Self::Cylinder { height, .. } | Self::Box { height, .. } => Some(*height),
            Self::Mesh(_) => None,
        }
    }
}

/// A mesh file and what its parts stand for.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshFile {
    /// Path of the .msh or .vtu file.
    pub path: String,
    /// Metres per unit of the file.
    pub unit_m: f64,
    /// Group of the nodes that are held.
    pub base_group: String,
    /// Group of the surface that the instrument may touch.
    pub contact_group: String,
}

/// Constitutive law with its constants.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Which law.
    pub model: MaterialModel,
    /// Small-strain shear modulus mu, instantaneous where the material relaxes; Ogden: the sum of its terms.
    pub shear_modulus: Pascals,
    /// Terms of Ogden's law; none for the other model.
    pub ogden: Ogden,
    /// Energy of a change of volume.
    pub volumetric: Volumetric,
    /// Relaxation of the change of shape; no terms: elastic.
    pub prony: Prony,
    /// Poisson's ratio nu.
    pub poisson_ratio: PoissonRatio,
    /// Density of the reference configuration.
    pub density: KilogramsPerCubicMetre,
}

impl Material {
    /// Bulk modulus kappa = 2 mu (1 + nu) / (3 (1 - 2 nu)), Pa.
    #[must_use]
    pub fn bulk_modulus(&self) -> f64 {
        let nu = self.poisson_ratio.get();
        2.0 * self.shear_modulus.get() * (1.0 + nu) / (3.0 * (1.0 - 2.0 * nu))
    }

    /// The law with all its constants.
    #[must_use]
    pub fn law(&self) -> Law {
        Law {
            distortional: match self.model {
                MaterialModel::NeoHookean => Distortional::NeoHookean { shear_modulus: self.shear_modulus.get() },
                MaterialModel::Ogden => Distortional::Ogden(self.ogden),
            },
            volumetric: self.volumetric,
            bulk_modulus: self.bulk_modulus(),
            prony: self.prony,
        }
    }
}

/// Which constitutive law (`material.model`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MaterialModel {
    /// `neo_hookean`: W = mu/2 (J^-2/3 I1 - 3).
    NeoHookean,
    /// `ogden`: W = sum_k 2 mu_k / a_k^2 (lb_1^a_k + lb_2^a_k + lb_3^a_k - 3).
    Ogden,
}

/// The rigid instrument that meets the top face.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Instrument {
    /// Plate, indenter or needle.
    pub kind: InstrumentKind,
    /// Where the instrument's axis meets the top face: x, y in frame `sample`.
    pub entry: [Metres; 2],
}

/// Kind of instrument with the keys that only it has (`instrument.kind`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum InstrumentKind {
    /// `plate`: covers and sticks to the whole top face.
    Plate,
    /// `indenter`: flat disc that sticks to the top face.
    Indenter {
        /// Diameter of the flat face.
        diameter: Metres,
    },
    /// `needle`: kinematic needle of the source paper (method.md, section 9).
    Needle(Needle),
}

/// Kinematic needle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Needle {
    /// Diameter of the shaft.
    pub diameter: Metres,
    /// Material within this distance of the axis and behind the tip moves with the needle.
    pub capture_radius: Metres,
    /// C_D: fraction of the needle's displacement that captured material follows.
    pub deformation_coefficient: f64,
    /// The same fraction while the needle is withdrawn.
    pub retraction_coefficient: f64,
    /// Incremental (displacement since capture) or absolute (since first contact).
    pub deformation_rule: DeformationRule,
    /// epsilon_p: maximum principal Green-Lagrange strain under the tip at which the surface is punctured.
    pub puncture_strain: f64,
    /// Angle between the path and the vertical.
    pub tilt: Radians,
    /// Direction, from x towards y, in which the tip moves sideways on its way down.
    pub azimuth: Radians,
}

impl Needle {
    /// Lateral way (x, y) per metre of depth: tan(tilt) in direction azimuth.
    #[must_use]
    pub fn slope(&self) -> [f64; 2] {
        let (sin, cos) = self.azimuth.get().sin_cos();
        let tan = self.tilt.get().tan();
        [tan * cos, tan * sin]
    }
}

impl Instrument {
    /// Lateral way (x, y) of the tip per metre of depth: zero for all but an oblique needle.
    #[must_use]
    pub fn slope(&self) -> [f64; 2] {
        match &self.kind {
            InstrumentKind::Needle(needle) => needle.slope(),
            InstrumentKind::Plate | InstrumentKind::Indenter { .. } => [0.0; 2],
        }
    }
}

/// What the deformation coefficient multiplies (`instrument.deformation_rule`; method.md, section 9.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DeformationRule {
    /// u_i = C_D (d - d_capture,i). The default.
    Incremental,
    /// u_i = C_D d.
    Absolute,
}

/// How the field is approximated and integrated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Discretisation {
    /// Approximation method.
    pub method: Method,
    /// Full 3D or axisymmetric; `auto` decides.
    pub dimension: Dimension,
    /// How the nodes are spaced; absent where a mesh file brings them.
    pub grading: Option<Grading>,
    /// alpha: support radius over mean edge length at a node.
    pub support_factor: f64,
    /// eta: dimensionless MMLS penalty on the quadratic coefficients (local scaled coordinates).
    pub penalty: f64,
    /// Integration points per tetrahedral cell: 1, 4 or 5.
    pub points_per_cell: u32,
    /// Tetrahedra that share an integration point: 1 or 2.
    pub cells_per_point: u32,
    /// Cure for volumetric locking.
    pub volume_ratio: VolumeRatio,
    /// Whether cells at the edge of contact resist folding.
    pub fold_guard: bool,
    /// Precision of the internal-force kernel.
    pub precision: Precision,
}

/// Spacing of the nodes of a generated cloud.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grading {
    /// Spacing far from every edge.
    pub spacing: Metres,
    /// Spacing at the instrument's contact edge as a fraction of `spacing`, in (0, 1].
    pub edge_refinement: f64,
    /// Growth of the spacing per metre of distance from an edge (isotropic grading).
    pub growth: f64,
}

/// Approximation method (`discretisation.method`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Modified moving least squares, quadratic basis with penalty.
    Mmls,
    /// Moving least squares, linear basis.
    Mls,
    /// Linear tetrahedra: the finite-element baseline.
    Tet4,
}

/// `discretisation.dimension`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dimension {
    /// The least model that the scene allows.
    Auto,
    /// r-z half plane with the hoop term.
    Axisymmetric,
    /// Three dimensions.
    Full,
}

/// How poses become explicit steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stepping {
    /// Tolerated relative error of the force from too few steps.
    pub tolerance: f64,
    /// Fraction of the largest stable step that is used, in (0, 1).
    pub step_factor: f64,
    /// Largest number of explicit steps that one pose may cost.
    pub max_steps_per_pose: u32,
    /// Smallest number of explicit steps that a moving pose gets.
    pub min_steps_per_pose: u32,
}

/// A scene's own motion: approach is at zero depth, then insertion, hold and retraction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Depth to reach, positive into the sample.
    pub depth: Metres,
    /// Speed of insertion (and retraction).
    pub speed: MetresPerSecond,
    /// Rate of the pose stream.
    pub pose_rate: Hertz,
    /// Time to stay at depth.
    pub hold: Seconds,
    /// Whether the instrument then goes back to depth 0.
    pub retract: bool,
}

/// A material point whose position is predicted.
#[derive(Clone, Debug, PartialEq)]
pub struct Target {
    /// Name.
    pub name: String,
    /// Reference position in frame `sample`, m.
    pub position: [f64; 3],
}
