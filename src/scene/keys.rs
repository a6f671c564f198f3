//! The one registry of scene keys.
//!
//! Parsing, validation, `--set`, error messages, `scene show --keys` and parameter descriptors all read
//! [`KEYS`]; a new key is one entry here and one line in each direction of `convert.rs`.

use crate::scene::Word as _;
use mtled::material::{Volumetric, ogden, prony};

use super::{
    DeformationRule, Dimension, InstrumentKind, MaterialModel, Method, Precision, Range, SceneError, Shape,
    VolumeRatio, key::Key,
};

const CYLINDER: (&str, &[&str]) = ("sample.shape", &["cylinder"]);
const MESH: (&str, &[&str]) = ("sample.shape", &["mesh"]);
const GENERATED: (&str, &[&str]) = ("sample.shape", &["cylinder", "box"]);
const BOX: (&str, &[&str]) = ("sample.shape", &["box"]);
const NEO_HOOKEAN: (&str, &[&str]) = ("material.model", &["neo_hookean"]);
const OGDEN: (&str, &[&str]) = ("material.model", &["ogden"]);
const NEEDLE: (&str, &[&str]) = ("instrument.kind", &["needle"]);
const NOT_PLATE: (&str, &[&str]) = ("instrument.kind", &["indenter", "needle"]);

/// Every key of a scene, in the order in which a scene file is written. Paths that start with `targets.`
/// belong to each element of the list `[[targets]]` and take an index there: `targets.0.name`.
pub static KEYS: &[Key] = &[
    Key::text("name", "Short name; the file's name where it is absent.").or("scene"),
    Key::text("description", "What the scene is and what it assumes.").or(""),
    // sample
    Key::word("sample.shape", Shape::WORDS, "Shape of the sample: upright on its base, or a mesh from a file.").or("cylinder"),
    Key::real("sample.diameter_m", Range::above(0.0, 10.0), "m", "Diameter of the cylinder.").only(CYLINDER),
    Key::real("sample.size_x_m", Range::above(0.0, 10.0), "m", "Edge of the box along x.").only(BOX),
    Key::real("sample.size_y_m", Range::above(0.0, 10.0), "m", "Edge of the box along y.").only(BOX),
    Key::real("sample.height_m", Range::above(0.0, 10.0), "m", "Height; the top face is at z = height.").only(GENERATED),
    Key::text(
        "sample.mesh",
        "Mesh of tetrahedra, Gmsh .msh 4.1 ASCII or VTU, z up; its path, from the scene file's folder (with --set: from here).",
    )
    .only(MESH),
    Key::real("sample.mesh_unit_m", Range::above(0.0, 1e3), "m", "Metres per unit of the mesh file: 0.001 for mm.")
        .or("1.0")
        .only(MESH),
    Key::text("sample.base_group", "Group of the mesh's surface that is held.").or("base").only(MESH),
    Key::text("sample.contact_group", "Group of the mesh's surface that the instrument may touch.")
        .or("contact")
        .only(MESH),
    // material
    Key::word("material.model", MaterialModel::WORDS, "Constitutive law of the change of shape.").or("neo_hookean"),
    Key::real(
        "material.shear_modulus_pa",
        Range::above(0.0, 1e12),
        "Pa",
        "Small-strain shear modulus mu; the instantaneous one where the material relaxes.",
    )
    .only(NEO_HOOKEAN),
    Key::list(
        "material.ogden_shear_moduli_pa",
        Range::above(0.0, 1e12),
        ogden::MOST_TERMS,
        "Pa",
        "mu_k of W = sum 2 mu_k / a_k^2 (l1^a_k + l2^a_k + l3^a_k - 3); their sum is the initial shear modulus.",
    )
    .because(
        "a term with a negative modulus makes the tissue unstable; the constants of a source that writes \
         W = sum mu_k / a_k (...) are to be multiplied by a_k / 2",
    )
    .only(OGDEN),
    Key::list(
        "material.ogden_exponents",
        Range::closed(-30.0, 30.0),
        ogden::MOST_TERMS,
        "",
        "a_k of the same terms, in the same order; the exponent 2 is the neo-Hookean law.",
    )
    .only(OGDEN),
    Key::word(
        "material.volumetric",
        Volumetric::WORDS,
        "Energy of a change of volume: quadratic, or logarithmic, which grows without bound as the volume goes to 0.",
    )
    .or("quadratic"),
    Key::list(
        "material.prony_shares",
        Range::open(0.0, 1.0),
        prony::MOST_TERMS,
        "",
        "g_i: shares of the instantaneous stiffness in shear that relax; empty: elastic.",
    )
    .or("[]"),
    Key::list(
        "material.prony_times_s",
        Range::above(0.0, 1e9),
        prony::MOST_TERMS,
        "s",
        "tau_i: the times in which they relax, in the same order.",
    )
    .or("[]"),
    Key::real("material.poisson_ratio", Range::open(-1.0, 0.5), "", "Poisson's ratio nu.").because(
        "at 0.5 the bulk modulus 2 mu (1 + nu) / (3 (1 - 2 nu)) is infinite, and so is the number of explicit steps: \
         0.49 to 0.499 serves for nearly incompressible tissue",
    ),
    Key::real("material.density_kg_per_m3", Range::above(0.0, 1e5), "kg/m3", "Density of the undeformed sample."),
    // instrument
    Key::word("instrument.kind", InstrumentKind::WORDS, "What meets the top face."),
    Key::real(
        "instrument.diameter_m",
        Range::above(0.0, 10.0),
        "m",
        "Diameter of the indenter's face or the needle's shaft.",
    )
    .only(NOT_PLATE),
    Key::real(
        "instrument.capture_radius_m",
        Range::above(0.0, 10.0),
        "m",
        "Material within this distance of the axis and behind the tip moves with the needle.",
    )
    .only(NEEDLE),
    Key::real(
        "instrument.deformation_coefficient",
        Range::closed(0.0, 1.0),
        "",
        "C_D: fraction of the needle's displacement that captured material follows.",
    )
    .or("0.4")
    .only(NEEDLE)
    .live(),
    Key::real(
        "instrument.retraction_coefficient",
        Range::closed(0.0, 1.0),
        "",
        "The same fraction while the needle is withdrawn.",
    )
    .or("0.4")
    .only(NEEDLE)
    .live(),
    Key::word(
        "instrument.deformation_rule",
        DeformationRule::WORDS,
        "Whether captured material follows the displacement since its capture or since first contact.",
    )
    .or("incremental")
    .only(NEEDLE),
    Key::real(
        "instrument.puncture_strain",
        Range::closed(0.0, 10.0),
        "",
        "Largest principal Green-Lagrange strain under the tip at which the surface is punctured.",
    )
    .or("1e-6")
    .only(NEEDLE)
    .live(),
    Key::real("instrument.entry_x_m", Range::closed(-10.0, 10.0), "m", "Where the axis meets the top face: x.")
        .or("0.0")
        .only(NOT_PLATE),
    Key::real("instrument.entry_y_m", Range::closed(-10.0, 10.0), "m", "Where the axis meets the top face: y.")
        .or("0.0")
        .only(NOT_PLATE),
    Key::real("instrument.tilt_rad", Range::closed(0.0, 0.7), "rad", "Angle between the needle's path and the vertical.")
        .or("0.0")
        .only(NEEDLE),
    Key::real(
        "instrument.azimuth_rad",
        Range::closed(-6.3, 6.3),
        "rad",
        "Direction, from x towards y, in which an oblique needle moves sideways on its way down.",
    )
    .or("0.0")
    .only(NEEDLE),
    // discretisation
    Key::word("discretisation.method", Method::WORDS, "Approximation of the field.").or("mmls"),
    Key::word(
        "discretisation.dimension",
        Dimension::WORDS,
        "Three dimensions or the axisymmetric half plane; auto takes the least model that the scene allows.",
    )
    .or("auto"),
    Key::real("discretisation.spacing_m", Range::above(0.0, 1.0), "m", "Spacing of the nodes far from every edge.")
        .only(GENERATED),
    Key::real(
        "discretisation.edge_refinement",
        Range::closed(0.01, 1.0),
        "",
        "Spacing at the instrument's contact edge as a fraction of spacing_m.",
    )
    .or("0.3")
    .only(GENERATED),
    Key::real(
        "discretisation.growth",
        Range::above(0.0, 0.5),
        "m/m",
        "Growth of the spacing per metre of distance from an edge.",
    )
    .because("cells that grow faster than by half their size from one to the next lose their shape")
    .or("0.35")
    .only(GENERATED),
    Key::real(
        "discretisation.support_factor",
        Range::above(1.0, 4.0),
        "",
        "alpha: support radius over mean edge length at a node.",
    )
    .or("1.8"),
    Key::real(
        "discretisation.penalty",
        Range::closed(0.0, 1e6),
        "",
        "eta: MMLS penalty on the quadratic coefficients, dimensionless (local scaled coordinates).",
    )
    .or("1e-2"),
    Key::one_of(
        "discretisation.points_per_cell",
        &[1, 4, 5],
        "Integration points per tetrahedral cell; a triangle of the half plane then has 3, 6 or 7.",
    )
    .or("1"),
    Key::one_of(
        "discretisation.cells_per_point",
        &[1, 2],
        "Tetrahedra that share an integration point: 2 joins neighbours in pairs, for half the work. Only meshless methods with one point per cell do so, and no half plane.",
    )
    .or("1"),
    Key::word(
        "discretisation.volume_ratio",
        VolumeRatio::WORDS,
        "Volume ratio that the pressure sees: projected (onto a coarser cloud) cures volumetric locking, averaged (over each node) half-way.",
    )
    .or("projected"),
    Key::boolean(
        "discretisation.fold_guard",
        "Whether cells at the edge of a plate or indenter resist folding, so that they come back from any depth; not in the half plane.",
    )
    .or("true"),
    Key::word("discretisation.precision", Precision::WORDS, "Precision of the internal-force kernel.").or("f32"),
    // stepping
    Key::real(
        "stepping.tolerance",
        Range::open(0.0, 1.0),
        "",
        "Tolerated relative error of the force from too few steps.",
    )
    .or("0.01")
    .live(),
    Key::real("stepping.step_factor", Range::open(0.0, 2.0), "", "Fraction of the largest stable step that is used; 1 and more are for studies of what happens then.")
        .or("0.9"),
    Key::integer("stepping.max_steps_per_pose", 1, 1_000_000, "Largest number of explicit steps for one pose.")
        .or("2000")
        .live(),
    Key::integer("stepping.min_steps_per_pose", 1, 1_000_000, "Smallest number of explicit steps for a moving pose.")
        .or("1")
        .live(),
    // motion
    Key::real("motion.depth_m", Range::closed(0.0, 10.0), "m", "Depth to reach, positive into the sample."),
    Key::real("motion.speed_m_per_s", Range::above(0.0, 100.0), "m/s", "Speed of insertion and retraction.").or("1e-3"),
    Key::real("motion.pose_hz", Range::above(0.0, 1e6), "Hz", "Rate of the pose stream.").or("1000.0"),
    Key::real("motion.hold_s", Range::closed(0.0, 1e6), "s", "Time to stay at depth.").or("0.0"),
    Key::boolean("motion.retract", "Whether the instrument then goes back to depth 0.").or("false"),
    // targets
    Key::text("targets.name", "Name of the target."),
    Key::point("targets.position_m", "m", "Position in the undeformed sample, frame `sample`."),
];

/// Sections in the order in which a scene file is written.
pub const SECTIONS: &[&str] = &["sample", "material", "instrument", "discretisation", "stepping", "motion", "targets"];

/// Sections without which there is no scene; the others are not modelled where they are absent.
pub const REQUIRED_SECTIONS: &[&str] = &["sample", "material", "discretisation"];

/// The entry of a dotted path. A target's key takes the target's index: `targets.0.name`.
#[must_use]
pub fn find(path: &str) -> Option<&'static Key> {
    match split_target(path) {
        Some((_, field)) => KEYS.iter().find(|key| key.section() == "targets" && key.field() == field),
        None => KEYS.iter().find(|key| key.section() != "targets" && key.path == path),
    }
}

/// The known entry whose path is most like an unknown one, unless none is like it at all.
#[must_use]
pub fn nearest(path: &str) -> Option<&'static Key> {
    let plain = match split_target(path) {
        Some((_, field)) => format!("targets.{field}"),
        None => path.to_owned(),
    };
    KEYS.iter()
        .map(|key| (likeness(&plain, key.path), key))
        .filter(|(score, _)| *score > 0.6)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, key)| key)
}

/// The word of a list that is most like an unknown one, unless none is like it at all.
#[must_use]
pub fn nearest_word<'a>(word: &str, words: &[&'a str]) -> Option<&'a str> {
    words
        .iter()
        .map(|known| (strsim::jaro_winkler(word, known), *known))
        .filter(|(score, _)| *score > 0.7)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, known)| known)
}

/// Likeness of two dotted paths in [0, 1]. A right last part in the wrong section counts nearly as much as the
/// right path, since that is the common mistake; so does a last part without its unit.
fn likeness(path: &str, known: &str) -> f64 {
    let whole = strsim::normalized_damerau_levenshtein(path, known);
    let (last, known_last) = (last_part(path), last_part(known));
    let part = strsim::normalized_damerau_levenshtein(last, known_last);
    let without_unit = if last.len() > 3 && known_last.starts_with(last) { 0.9 } else { 0.0 };
    whole.max(0.95 * part).max(without_unit)
}

fn last_part(path: &str) -> &str {
    path.rsplit('.').next().unwrap_or(path)
}

/// Index and field of `targets.INDEX.FIELD`.
pub(super) fn split_target(path: &str) -> Option<(usize, &str)> {
    let (index, field) = path.strip_prefix("targets.")?.split_once('.')?;
    Some((index.parse().ok()?, field))
}

/// The entry of a path that must be known; `value` is what the message shows.
///
/// # Errors
/// [`SceneError::UnknownKey`], with the nearest known key.
pub fn require(path: &str, value: &str, place: &str) -> Result<&'static Key, SceneError> {
    find(path).ok_or_else(|| SceneError::UnknownKey {
        place: place.to_owned(),
        key: path.to_owned(),
        value: value.to_owned(),
        hint: match nearest(path) {
            Some(key) => format!("the nearest known key is {} ({})", key.shown_path(), key.allowed()),
            None => "`needle_twin scene show --keys` lists every key".to_owned(),
        },
    })
}
