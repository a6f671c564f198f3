//! `[discretisation]`: how the field is approximated and integrated.

use mtled::solver::{self, Precision};

use super::section::{choice, section, words};
use super::{Key, Metres, Range, Word};

/// The shapes whose nodes the twin places itself.
const GENERATED: [&str; 3] = ["cylinder", "box", "outline"];

section! {
    /// How the field is approximated and integrated.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Discretisation => {
        /// Approximation of the field.
        method: Method = Key::word("discretisation.method", Method::WORDS).or("mmls"),
        /// Three dimensions, half of them beside a plane of symmetry, or the axisymmetric half plane; auto takes the least model that the
        /// scene allows.
        dimension: Dimension = Key::word("discretisation.dimension", Dimension::WORDS).or("auto"),
        /// How the nodes are spaced; absent where a mesh file brings them.
        grading: Option<AskedGrading>,
        /// alpha: support radius over mean edge length at a node; 0, the default, is 1.8, and 2.1 under an indenter with consistent
        /// gradients in three dimensions in a sample of one material.
        support_factor: f64 = Key::real("discretisation.support_factor", Range::closed(0.0, 4.0), "").or("0.0"),
        /// eta: MMLS penalty on the quadratic coefficients, dimensionless (local scaled coordinates).
        penalty: f64 = Key::real("discretisation.penalty", Range::closed(0.0, 1e6), "").or("1e-2").for_research(),
        /// Integration points per tetrahedral cell; a triangle of the half plane then has 3, 6 or 7.
        points_per_cell: u32 = Key::one_of("discretisation.points_per_cell", &[1, 4, 5]).or("1"),
        /// Tetrahedra that share an integration point: 2 joins neighbours in pairs, for half the work. Only meshless
        /// methods with one point per cell do so, and no half plane. 0, the default: 2 in a cylinder or box round a needle, and
        /// under a plate on one material; else 1.
        cells_per_point: u32 = Key::one_of("discretisation.cells_per_point", &[0, 1, 2]).or("0"),
        /// Fewest of eight integration points beside each other whose support a node has to be in: one that fewer have is left out of those
        /// supports, which saves work. 1, the default, leaves none out. Only meshless methods have supports.
        points_per_support_node: u32 = Key::integer("discretisation.points_per_support_node", 1, 4).or("1"),
        /// What is integrated.
        cells: Cells,
        /// Gradients of the shape functions at the integration points: exact, or corrected so that a uniform stress is in balance, in space
        /// alone; `auto`: so corrected in a cylinder or box of one material.
        integration: Integration = Key::word("discretisation.integration", Integration::WORDS).or("auto"),
        /// Volume ratio that the law sees: projected (onto a coarser cloud) cures volumetric locking, mixed cures that of sheared tissue
        /// as well, averaged (over each node) half-way; `auto`: mixed round a needle in space, else projected.
        volume_ratio: VolumeRatio = Key::word("discretisation.volume_ratio", VolumeRatio::WORDS)
            .for_research_after(4)
            .or("auto"),
        /// Precision of the internal-force kernel.
        precision: Precision = Key::word("discretisation.precision", Precision::WORDS).or("f32"),
    }
}

choice! {
    /// Background cells (`discretisation.cells`).
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Cells = Key::word("discretisation.cells", Cells::WORDS)
        .described("Background cells of a meshless method: tetrahedra, which hexahedra in a mesh are cut into, or hexahedra in three \
                    dimensions: those of a mesh, a cylinder or box of them, or in other bodies those inside, with tetrahedra about them.")
        .for_research_after(1)
        .or("tetrahedra")
    => {
        /// Tetrahedra.
        "tetrahedra" => Tetrahedra,
        /// Hexahedra, with the tetrahedra beside them.
        "hexahedra" => Hexahedra {
            /// Integration points per hexahedron; 1 does not converge, and is for comparison.
            points_per_hexahedron: u32 = Key::one_of("discretisation.points_per_hexahedron", &[1, 8]).or("8").for_research(),
        },
    }
}

impl Cells {
    /// Points of each hexahedron; 0 where there are none.
    #[must_use]
    pub const fn points_per_hexahedron(self) -> u32 {
        match self {
            Self::Tetrahedra => 0,
            Self::Hexahedra { points_per_hexahedron } => points_per_hexahedron,
        }
    }
}

section! {
    /// Spacing of the nodes of a generated cloud, as far as the scene says; `None`: left to the program ([`super::Grading`]).
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct AskedGrading when |values| values.word("sample.shape").is_some_and(|s| GENERATED.contains(&s.as_str())) => {
        /// Spacing of the nodes far from every edge; `auto`: by the sample's size and the instrument. An outline needs a number.
        spacing: Option<Metres> = generated(Key::real("discretisation.spacing_m", Range::above(0.0, 1.0), "m").or_auto()),
        /// Spacing at the instrument's contact edge as a fraction of spacing_m; `auto`: by the instrument.
        edge_refinement: Option<f64> =
            generated(Key::real("discretisation.edge_refinement", Range::closed(0.01, 1.0), "").or_auto()),
        /// Growth of the spacing per metre of distance from an edge; `auto`: by the instrument.
        growth: Option<f64> = generated(
            Key::real("discretisation.growth", Range::above(0.0, 0.5), "m/m")
                .or_auto()
                .because("cells that grow faster than by half their size from one to the next lose their shape"),
        ),
        /// Fewest rings of nodes round a needle's path in space, within its capture radius; layers are as far apart as rings. 0: three
        /// down to ten radii where a kinematic needle leans and enters at once, else two.
        path_rings: u32 = generated(Key::one_of("discretisation.path_rings", &[0, 2, 3, 4]).or("0")),
    }
}

const fn generated(key: Key) -> Key {
    key.only("sample.shape", &GENERATED)
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

/// `discretisation.volume_ratio`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VolumeRatio {
    /// Mixed round a needle in space, else projected.
    Auto,
    /// [`mtled::solver::VolumeRatio::Mixed`].
    Mixed,
    /// [`mtled::solver::VolumeRatio::Projected`].
    Projected,
    /// [`mtled::solver::VolumeRatio::Pointwise`].
    Pointwise,
    /// [`mtled::solver::VolumeRatio::Averaged`].
    Averaged,
}

impl From<VolumeRatio> for solver::VolumeRatio {
    /// `auto` is to be resolved before ([`super::Scene::volume_ratio_in`]); left as it is, it is projected.
    fn from(ratio: VolumeRatio) -> Self {
        match ratio {
            VolumeRatio::Mixed => Self::Mixed,
            VolumeRatio::Auto | VolumeRatio::Projected => Self::Projected,
            VolumeRatio::Averaged => Self::Averaged,
            VolumeRatio::Pointwise => Self::Pointwise,
        }
    }
}

/// `discretisation.integration`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Integration {
    /// The derivatives of the shape functions.
    Plain,
    /// Corrected by as little as makes sums over the points the integrals that they stand for.
    Consistent,
    /// Consistent in a cylinder or box of one material, else plain.
    Auto,
}

/// `discretisation.dimension`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dimension {
    /// The least model that the scene allows.
    Auto,
    /// r-z half plane with the hoop term.
    Axisymmetric,
    /// The half of three dimensions beside a plane of symmetry.
    Mirrored,
    /// Three dimensions.
    Full,
}

words!(Method: Mmls = "mmls", Mls = "mls", Tet4 = "tet4");
words!(Integration: Plain = "plain", Consistent = "consistent", Auto = "auto");
words!(Dimension: Auto = "auto", Axisymmetric = "axisymmetric", Mirrored = "mirrored", Full = "full");
words!(VolumeRatio: Auto = "auto", Mixed = "mixed", Projected = "projected", Pointwise = "pointwise", Averaged = "averaged");
words!(Precision: F32 = "f32", F64 = "f64");
