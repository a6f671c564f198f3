//! Is a mesh in the unit and in the frame that the scene takes it for? What is odd is no error: it is said, beside other errors as well.

use mtled::cloud::{BASE, Cloud, TOP};

use super::BuildError;
use crate::scene::{Instrument, InstrumentKind, MeshFile, Scene};

const DEPTH: &str = "motion.depth_m";
/// No sample is longer than this, m.
const LARGEST_M: f64 = 10.0;
/// Extents of bodies that are met with, m.
const USUAL: [f64; 2] = [1e-3, 0.5];
/// An extent of more than this many depths or diameters of the instrument is not seen in a test.
const LARGE: f64 = 50.0;
/// Units that meshes come in, m, and how unlikely each is (in factors of e).
const UNITS: [(&str, f64, f64); 5] =
    [("m", 1.0, 0.0), ("cm", 1e-2, 1.2), ("mm", 1e-3, 0.0), ("um", 1e-6, 0.0), ("inches", 0.0254, 2.5)];
/// Depth of usual motions over the body's height, and diameter of usual instruments over its width.
const DEPTHS: [f64; 2] = [0.02, 0.5];
const DIAMETERS: [f64; 2] = [0.003, 0.5];
/// How unlikely the unit is in which the mesh looks odd, in factors of e.
const ODD: f64 = 2.5;
/// Difference of two units' likelihoods, in factors of e, up to which both are named.
const NEARLY: f64 = 1.5;
/// How much worse it is that a body is too small for motion or instrument than that it is too large.
const TOO_SMALL: f64 = 3.0;
/// Share of its area by which a contact surface that faces some way does so.
const FACING: f64 = 0.3;

/// Extents along x, y and z, m.
pub fn extents(cloud: &Cloud) -> [f64; 3] {
    std::array::from_fn(|k| {
        let along = || cloud.points.iter().map(|p| p[k]);
        along().fold(f64::NEG_INFINITY, f64::max) - along().fold(f64::INFINITY, f64::min)
    })
}

/// Extents as a person reads them.
pub fn shown(extents: [f64; 3]) -> String {
    let [x, y, z] = extents.map(|e| short(1e3 * e));
    format!("{x} x {y} x {z} mm")
}

/// Up to four decimals.
fn short(x: f64) -> String {
    format!("{x:.4}").trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// What looks wrong with unit and frame of a mesh.
///
/// # Errors
/// [`BuildError::Mesh`] of a mesh that is too large for any sample.
pub(super) fn oddities(scene: &Scene, file: &MeshFile, cloud: &Cloud) -> Result<Vec<String>, BuildError> {
    let size = size(scene, file, extents(cloud));
    let largest = extents(cloud).into_iter().fold(0.0, f64::max);
    if largest > LARGEST_M {
        let reason = format!(
            "{}: it is {largest:.4} m long with {} m per unit (mesh_unit_m); at most {LARGEST_M} m are taken",
            file.path, file.unit_m
        );
        return Err(with_oddities(BuildError::Mesh { key: "sample.mesh".to_owned(), reason }, size.as_slice()));
    }
    Ok(size.into_iter().chain(direction(cloud)).collect())
}

/// An error of a mesh, or of the nodes in it, with what looks wrong about it besides.
pub(super) fn with_oddities(error: BuildError, odd: &[String]) -> BuildError {
    match error {
        other if odd.is_empty() => other,
        BuildError::Mesh { key, reason } => BuildError::Mesh { key, reason: format!("{reason}; {}", odd.join("; ")) },
        other => BuildError::Mesh { key: "sample.mesh".to_owned(), reason: format!("{}; {other}", odd.join("; ")) },
    }
}

/// Lengths of the scene that go with the body's: the depth, and the instrument's diameter.
fn lengths(scene: &Scene) -> Vec<(&'static str, f64)> {
    let depth = scene.motion.map(|m| (DEPTH, m.depth.get()));
    let diameter = scene.instrument.as_ref().and_then(Instrument::diameter_m).map(|d| ("instrument.diameter_m", d));
    depth.into_iter().chain(diameter).filter(|(_, length)| *length > 0.0).collect()
}

fn size(scene: &Scene, file: &MeshFile, extents: [f64; 3]) -> Option<String> {
    let largest = extents.into_iter().fold(0.0, f64::max);
    let lengths = lengths(scene);
    let beside = lengths.iter().map(|(_, length)| *length).fold(0.0, f64::max);
    let [least, most] = USUAL;
    if (least..=most).contains(&largest) || (largest > most && beside > 0.0 && largest < LARGE * beside) {
        return None;
    }
    let [x, y, z] = extents;
    let factor = |unit: f64| unit / file.unit_m;
    // outside of what is usual, in factors of e
    let outside = |share: f64, [low, high]: [f64; 2]| (low / share).ln().max(TOO_SMALL * (share / high).ln()).max(0.0);
    let off = |(_, unit, unlikely): &(&str, f64, f64)| {
        let extent = largest * factor(*unit);
        let of = |(key, length): &(&str, f64)| match *key {
            DEPTH => outside(length / (z * factor(*unit)), DEPTHS),
            _ => outside(length / (x.max(y) * factor(*unit)), DIAMETERS),
        };
        let odd = if *unit == file.unit_m { ODD } else { 0.0 };
        lengths.iter().map(of).fold(outside(1.0 / extent, [1.0 / most, 1.0 / least]), f64::max) + unlikely + odd
    };
    let mut units = UNITS;
    units.sort_by(|a, b| off(a).total_cmp(&off(b)));
    let [(name, unit, _), next, ..] = units;
    let of = |unit: f64| shown(extents.map(|e| e * factor(unit)));
    let or = if off(&next) - off(&units[0]) < NEARLY {
        format!("; or {}, {} (then {})", next.0, next.1, of(next.1))
    } else {
        String::new()
    };
    let scale = lengths.iter().map(|(key, length)| format!("{key} = {length}")).collect::<Vec<_>>().join(", ");
    let with = if scale.is_empty() { String::new() } else { format!(" beside {scale}") };
    let likely = if unit == file.unit_m {
        format!("is sample.mesh_unit_m = {} right?", file.unit_m)
    } else {
        format!(
            "its unit is likely {name}: give sample.mesh_unit_m = {unit} (then {}) instead of {}{or}",
            of(unit),
            file.unit_m
        )
    };
    Some(format!("the mesh is {}{with}: {likely}", shown(extents)))
}

/// Sum of a face's outward areas as vectors, and of their sizes, m^2.
fn area(cloud: &Cloud, face: u8) -> ([f64; 3], f64) {
    let mut sum = ([0.0; 3], 0.0);
    for (t, _) in cloud.surface.iter().zip(&cloud.surface_faces).filter(|(_, f)| **f == face) {
        let [a, b, c] = t.map(|n| cloud.points[n as usize]);
        let [u, v]: [[f64; 3]; 2] = [b, c].map(|p| std::array::from_fn(|k| p[k] - a[k]));
        let area: [f64; 3] = std::array::from_fn(|k| {
            let (i, j) = ((k + 1) % 3, (k + 2) % 3);
            0.5 * (u[i] * v[j] - u[j] * v[i])
        });
        (0..3).for_each(|k| sum.0[k] += area[k]);
        sum.1 += area.iter().map(|x| x * x).sum::<f64>().sqrt();
    }
    sum
}

/// The contact surface should face up, or the base down where there is no contact surface.
fn direction(cloud: &Cloud) -> Option<String> {
    let [(contact, whole), (base, base_whole)] = [area(cloud, TOP), area(cloud, BASE)];
    let (up, whole) = if whole > 0.0 { (contact, whole) } else { (base.map(|x| -x), base_whole) };
    let k = (0..3).max_by(|&a, &b| up[a].abs().total_cmp(&up[b].abs()))?;
    // a base all round the body faces nowhere
    if whole == 0.0 || up[k].abs() < FACING * whole || (k == 2 && up[k] > 0.0) {
        return None;
    }
    let (name, turn) = match (k, up[k] > 0.0) {
        (0, true) => ("x is up", "points[:, [2, 1, 0]] * [-1, 1, 1]"),
        (0, false) => ("-x is up", "points[:, [2, 1, 0]] * [1, 1, -1]"),
        (1, true) => ("y is up", "points[:, [0, 2, 1]] * [1, -1, 1]"),
        (1, false) => ("-y is up", "points[:, [0, 2, 1]] * [1, 1, -1]"),
        _ => ("-z is up", "points * [1, -1, -1]"),
    };
    Some(format!(
        "in the mesh {name}, by the way its groups face; z must be, and the instrument comes along -z: turn it (with meshio: \
         mesh.points = mesh.{turn})"
    ))
}

impl Instrument {
    /// Diameter of an indenter or a needle, m.
    fn diameter_m(&self) -> Option<f64> {
        match &self.kind {
            InstrumentKind::Indenter { diameter, .. } => Some(diameter.get()),
            InstrumentKind::Needle(_) => self.needle_diameter_m(),
            InstrumentKind::Plate => None,
        }
    }
}
