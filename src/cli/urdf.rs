//! `needle_twin scene urdf`: rig and sample as a robot, for RViz and for what takes its joint from a description.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::Args;

use super::options::SetOptions;
use super::{CliError, print, scene_file};
use mtled::cloud::check;
use needle_core::scene::{IndenterTip, Instrument, InstrumentKind, Scene, Shape};
use needle_core::twin::Body;
use needle_report::ReportError;

/// Highest and lowest position of the instrument above the top, m: the rig's default.
const ABOVE_M: f64 = 0.05;
/// Largest speed, m/s: the twin refuses poses that are further apart.
const SPEED_M_PER_S: f64 = 0.5;
/// Largest force, N. A description has to have one.
const EFFORT_N: f64 = 100.0;
/// Radius and length of the mark at the load cell's origin over the instrument's diameter.
const MARK: [f64; 2] = [2.0, 1.0];

#[derive(Debug, Args)]
pub(super) struct Urdf {
    /// Preset or scene file
    #[arg(value_name = "NAME|FILE")]
    scene: String,
    #[command(flatten)]
    set: SetOptions,
    /// Name of the joint whose position is the depth
    #[arg(long, value_name = "NAME", default_value = "insertion")]
    joint: String,
    /// For a sample that is neither cylinder nor box: write its surface into this STL file, which the description names
    #[arg(long, value_name = "FILE")]
    mesh: Option<PathBuf>,
}

pub(super) fn run(arguments: &Urdf) -> Result<(), CliError> {
    let scene = arguments.set.apply(&scene_file::load(&arguments.scene)?, [])?;
    let sample = match scene.sample.shape {
        Shape::Cylinder { height, diameter } => {
            let (height, diameter) = (height.get(), diameter.get());
            let shape = cylinder(0.5 * diameter, height);
            Drawn { shape, middle: 0.5 * height, top: height, height, across: diameter }
        }
        Shape::Box { height, size_x, size_y } => {
            let [x, y, z] = [size_x, size_y, height].map(|edge| edge.get());
            let shape = format!("<box size=\"{x} {y} {z}\"/>");
            Drawn { shape, middle: 0.5 * z, top: z, height: z, across: x.hypot(y) }
        }
        Shape::Mesh(_) | Shape::Outline(_) => {
            let file = arguments.mesh.as_deref().ok_or_else(|| CliError::NoMeshFile { scene: scene.name.clone() })?;
            surface(&scene, file)?
        }
    };
    print(&robot(&scene, &sample, &arguments.joint))
}

/// The sample: its geometry, z of that geometry's origin, and sizes, m.
struct Drawn {
    shape: String,
    middle: f64,
    top: f64,
    height: f64,
    across: f64,
}

fn cylinder(radius: f64, length: f64) -> String {
    format!("<cylinder radius=\"{radius}\" length=\"{length}\"/>")
}

/// Writes the surface of a sample with a mesh.
fn surface(scene: &Scene, file: &Path) -> Result<Drawn, CliError> {
    let body = Body::new(scene).map_err(|source| CliError::Build { scene: scene.name.clone(), source })?.whole();
    let points = &body.cloud.points;
    // a cloud has been checked for a closed surface
    let triangles = check::surface(points.len(), &body.cloud.cells).unwrap_or_default();
    let written = |source| CliError::Report(ReportError::File { path: file.to_owned(), source });
    std::fs::write(file, stl(points, &triangles)).map_err(written)?;
    let path = file.canonicalize().map_err(written)?;
    let across = 2.0 * points.iter().map(|p| p[0].hypot(p[1])).fold(0.0, f64::max);
    let shape = format!("<mesh filename=\"file://{}\"/>", encoded(&path));
    Ok(Drawn { shape, middle: 0.0, top: body.top, height: body.height, across })
}

/// A surface as STL in bytes, m.
#[allow(clippy::cast_possible_truncation)] // the format's numbers have 32 bits
fn stl(points: &[[f64; 3]], triangles: &[[u32; 3]]) -> Vec<u8> {
    let mut bytes = vec![b' '; 80];
    bytes.extend(u32::try_from(triangles.len()).unwrap_or(u32::MAX).to_le_bytes());
    for triangle in triangles {
        let [a, b, c] = triangle.map(|i| points[i as usize]);
        let (u, v): ([f64; 3], [f64; 3]) = (std::array::from_fn(|k| b[k] - a[k]), std::array::from_fn(|k| c[k] - a[k]));
        let normal = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        let length = normal.iter().map(|x| x * x).sum::<f64>().sqrt();
        for vector in [normal.map(|x| x / length), a, b, c] {
            vector.iter().for_each(|x| bytes.extend((*x as f32).to_le_bytes()));
        }
        bytes.extend([0; 2]);
    }
    bytes
}

/// The description: `sample` at the root, `needle_tip` on a prismatic joint, `load_cell` fixed to it. The twin's frames
/// on `/tf` have the same names and places.
fn robot(scene: &Scene, sample: &Drawn, joint: &str) -> String {
    let mut text = String::from("<?xml version=\"1.0\"?>\n");
    // Writing to a String can't fail.
    let _ = writeln!(text, "<!-- Made by: needle_twin scene urdf {}. Lengths in m. -->", comment(&scene.name));
    let _ = writeln!(text, "<robot name=\"{}\">", escaped(&scene.name));
    for (name, colour) in [("tissue", "0.91 0.62 0.55 0.4"), ("steel", "0.7 0.72 0.75 1")] {
        let _ = writeln!(text, "  <material name=\"{name}\"><color rgba=\"{colour}\"/></material>");
    }
    link(&mut text, "sample", &[(sample.middle, sample.shape.clone(), "tissue")]);
    if let Some(instrument) = &scene.instrument {
        let height = instrument.load_cell_height.get();
        let (shapes, diameter) = drawn(instrument, sample);
        link(&mut text, "needle_tip", &shapes);
        let mark = MARK.map(|over| over * diameter);
        let mark = if height > 0.0 { vec![(0.0, cylinder(mark[0], mark[1]), "steel")] } else { Vec::new() };
        link(&mut text, "load_cell", &mark);
        let ([x, y], [roll, pitch, yaw]) = (instrument.entry.map(|m| m.get()), angles(instrument.axis()));
        let _ = writeln!(
            text,
            "  <joint name=\"{}\" type=\"prismatic\">\n    <parent link=\"sample\"/>\n    <child link=\"needle_tip\"/>\n    \
             <origin xyz=\"{x} {y} {}\" rpy=\"{roll} {pitch} {yaw}\"/>\n    <axis xyz=\"0 0 1\"/>\n    \
             <limit lower=\"{}\" upper=\"{}\" velocity=\"{SPEED_M_PER_S}\" effort=\"{EFFORT_N}\"/>\n  </joint>",
            escaped(joint),
            sample.top,
            -ABOVE_M,
            sample.height
        );
        let _ = writeln!(
            text,
            "  <joint name=\"load_cell\" type=\"fixed\">\n    <parent link=\"needle_tip\"/>\n    <child link=\"load_cell\"/>\n    \
             <origin xyz=\"0 0 {}\"/>\n  </joint>",
            0.0 - height
        );
    }
    text.push_str("</robot>\n");
    text
}

/// What is seen of an instrument in frame `needle_tip`, and its diameter, m. A scene has no length: it is drawn up to
/// the load cell, or as twice the sample's height.
fn drawn(instrument: &Instrument, sample: &Drawn) -> (Vec<(f64, String, &'static str)>, f64) {
    let height = instrument.load_cell_height.get();
    let length = if height > 0.0 { height } else { 2.0 * sample.height };
    let shaft = |diameter: f64, from: f64, to: f64| (-0.5 * (from + to), cylinder(0.5 * diameter, to - from), "steel");
    match instrument.kind {
        InstrumentKind::Plate => (vec![shaft(sample.across, 0.0, 0.1 * sample.height)], 0.1 * sample.across),
        InstrumentKind::Indenter { diameter, tip: IndenterTip::Sphere, .. } => {
            let radius = 0.5 * diameter.get();
            let ball = (-radius, format!("<sphere radius=\"{radius}\"/>"), "steel");
            (vec![ball, shaft(2.0 * radius, radius, length.max(2.0 * radius))], 2.0 * radius)
        }
        InstrumentKind::Indenter { diameter, .. } => (vec![shaft(diameter.get(), 0.0, length)], diameter.get()),
        InstrumentKind::Needle(needle) => (vec![shaft(needle.diameter.get(), 0.0, length)], needle.diameter.get()),
    }
}

fn link(text: &mut String, name: &str, shapes: &[(f64, String, &str)]) {
    let _ = writeln!(text, "  <link name=\"{name}\">");
    for (z, shape, material) in shapes {
        let _ = writeln!(
            text,
            "    <visual><origin xyz=\"0 0 {z}\"/><geometry>{shape}</geometry><material name=\"{material}\"/></visual>"
        );
    }
    text.push_str("  </link>\n");
}

/// Roll, pitch and yaw of the rotation that the twin publishes for an instrument along this unit vector: half a turn
/// about x, then the shortest way from straight down.
fn angles([x, y, z]: [f64; 3]) -> [f64; 3] {
    // entries of its matrix: r_21 = -y, r_22 = z, r_20 = x, r_10 = -xy / (1 - z), r_00 = 1 - x^2 / (1 - z)
    let zero = |angle: f64| angle + 0.0;
    [zero((0.0 - y).atan2(z)), zero((0.0 - x).asin()), zero((0.0 - x * y / (1.0 - z)).atan2(1.0 - x * x / (1.0 - z)))]
}

/// A path as it stands in a URL.
fn encoded(path: &Path) -> String {
    let plain = |byte: u8| byte.is_ascii_alphanumeric() || b"/-._~".contains(&byte);
    let each = |byte: u8| if plain(byte) { char::from(byte).to_string() } else { format!("%{byte:02X}") };
    path.as_os_str().as_encoded_bytes().iter().map(|byte| each(*byte)).collect()
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// A comment must not hold two hyphens.
fn comment(text: &str) -> String {
    escaped(text).replace("--", "- -")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Columns x and z of the matrix of fixed-axis angles.
    fn columns([roll, pitch, yaw]: [f64; 3]) -> [[f64; 3]; 2] {
        let ((sr, cr), (sp, cp), (sy, cy)) = (roll.sin_cos(), pitch.sin_cos(), yaw.sin_cos());
        [[cy * cp, sy * cp, -sp], [cy * sp * cr + sy * sr, sy * sp * cr - cy * sr, cp * cr]]
    }

    #[test]
    fn the_joint_is_turned_as_the_twin_turns_the_tip() {
        for axis in [[0.0, 0.0, -1.0], [0.36, -0.48, -0.8], [-0.6, 0.0, -0.8], [0.0, 0.6, -0.8]] {
            let [x, y, z] = axis;
            // what a quaternion ((1 - z), 0, x, -y) / sqrt(2 (1 - z)) does to x
            let along_x = [1.0 - x * x / (1.0 - z), -x * y / (1.0 - z), x];
            let found = columns(angles(axis));
            for (found, wanted) in found.iter().zip([along_x, axis]) {
                assert!(found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-14), "{found:?}, not {wanted:?}");
            }
        }
        assert_eq!(angles([0.0, 0.0, -1.0]), [std::f64::consts::PI, 0.0, 0.0]);
    }

    #[test]
    fn a_surface_is_as_long_as_its_triangles_and_looks_outward() {
        let points = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let bytes = stl(&points, &[[0, 1, 2], [0, 2, 1]]);
        assert_eq!((bytes.len(), &bytes[80..84]), (84 + 2 * 50, &[2, 0, 0, 0][..]));
        assert_eq!(bytes[84..96], [[0; 4], [0; 4], 1.0_f32.to_le_bytes()].concat());
    }
}
