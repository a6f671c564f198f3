//! Contract of mesh files: a cube is what it is in every form that is read, and a file that can't be used is refused with what, where
//! and what to do.
#![allow(clippy::unwrap_used, clippy::panic)]

use crate::mesh_import::{TARGETS, WANTED, on_mesh};
use std::fs;
use std::path::Path;

use base64::{Engine as _, engine::general_purpose::STANDARD};
use mtled::cloud::{BASE, Cloud, SIDE, TOP};
use needle_core::mesh::{self};
use needle_core::scene::Scene;
use needle_core::twin::Twin;
use proptest::prelude::*;
use tempfile::TempDir;

/// Corners of a cube of edge 10 by their bits, and its six tetrahedra round the diagonal.
const CUBE: [[usize; 4]; 6] = [[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]];

fn corner(i: usize) -> [f64; 3] {
    [0, 1, 2].map(|k| 10.0 * (i >> k & 1) as f64)
}

/// The cube as Gmsh writes it, with sparse tags 10, 20, ...
fn cube_msh() -> String {
    let mut text = String::from(
        "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$PhysicalNames\n3\n2 1 \"base\"\n2 2 \"contact\"\n3 3 \"soft tissue\"\n\
         $EndPhysicalNames\n$Entities\n0 0 2 1\n1 0 0 0 10 10 0 1 1 0\n2 0 0 10 10 10 10 1 2 0\n\
         1 0 0 0 10 10 10 1 3 2 1 2\n$EndEntities\n$Comments\nanything $ at all\n$EndComments\n$Nodes\n1 8 10 80\n3 1 0 8\n",
    );
    (0..8).for_each(|i| text += &format!("{}\n", 10 * (i + 1)));
    (0..8).for_each(|i| text += &format!("{}\n", corner(i).map(|x| x.to_string()).join(" ")));
    text += "$EndNodes\n$Elements\n4 11 1 11\n0 1 15 1\n1 10\n2 1 2 2\n2 10 20 40\n3 10 30 40\n";
    text += "2 2 2 2\n4 50 60 80\n5 50 70 80\n3 1 4 6\n";
    for (i, c) in CUBE.iter().enumerate() {
        text += &format!("{} {}\n", i + 6, c.map(|n| (10 * (n + 1)).to_string()).join(" "));
    }
    text + "$EndElements\n"
}

/// Numbers as bytes, one after the other.
#[derive(Default)]
struct Bytes(Vec<u8>);

impl Bytes {
    fn text(mut self, text: &str) -> Self {
        self.0.extend(text.bytes());
        self
    }

    fn ints(mut self, numbers: &[i32]) -> Self {
        self.0.extend(numbers.iter().flat_map(|n| n.to_le_bytes()));
        self
    }

    fn sizes(mut self, numbers: &[u64]) -> Self {
        self.0.extend(numbers.iter().flat_map(|n| n.to_le_bytes()));
        self
    }

    fn reals(mut self, numbers: &[f64]) -> Self {
        self.0.extend(numbers.iter().flat_map(|n| n.to_le_bytes()));
        self
    }
}

const NAMES: &str = "$PhysicalNames\n3\n2 1 \"base\"\n2 2 \"contact\"\n3 3 \"soft tissue\"\n$EndPhysicalNames\n";
/// Corners of the triangles of base and contact.
const FACES: [[usize; 3]; 4] = [[0, 1, 3], [0, 2, 3], [4, 5, 7], [4, 6, 7]];

/// The cube as Gmsh writes it in bytes, version 4.1.
fn cube_msh_binary() -> Vec<u8> {
    let tag = |n: usize| 10 * (n as u64 + 1);
    let mut file = Bytes::default().text("$MeshFormat\n4.1 1 8\n").ints(&[1]).text("\n$EndMeshFormat\n").text(NAMES);
    file = file.text("$Entities\n").sizes(&[1, 0, 2, 1]).ints(&[1]).reals(&[0.0; 3]).sizes(&[0]);
    for surface in [1, 2] {
        file = file.ints(&[surface]).reals(&[0.0; 6]).sizes(&[1]).ints(&[surface]).sizes(&[0]);
    }
    file = file.ints(&[1]).reals(&[0.0; 6]).sizes(&[1]).ints(&[3]).sizes(&[2]).ints(&[1, -2]).text("\n$EndEntities\n");
    file = file
        .text("$Nodes\n")
        .sizes(&[1, 8, 10, 80])
        .ints(&[3, 1, 0])
        .sizes(&[8])
        .sizes(&[0, 1, 2, 3, 4, 5, 6, 7].map(tag));
    file = (0..8).fold(file, |file, i| file.reals(&corner(i))).text("\n$EndNodes\n$Elements\n").sizes(&[3, 10, 1, 10]);
    for (surface, faces) in [(1, &FACES[..2]), (2, &FACES[2..])] {
        file = file.ints(&[2, surface, 2]).sizes(&[2]);
        file = faces.iter().fold(file, |file, f| file.sizes(&[1]).sizes(&f.map(tag)));
    }
    file = file.ints(&[3, 1, 4]).sizes(&[6]);
    file = CUBE.iter().zip(6..).fold(file, |file, (c, name)| file.sizes(&[name]).sizes(&c.map(tag)));
    file.text("\n$EndElements\n").0
}

/// The cube as older programs write it, version 2.2; `twice`: every cell is in a second group too.
fn cube_msh_old(binary: bool, twice: bool) -> Vec<u8> {
    let tag = |n: usize| 10 * (n as i32 + 1);
    let faces = FACES.iter().zip([1, 1, 2, 2]).map(|(f, group)| (2, group, f.map(tag).to_vec()));
    let cells = |group| CUBE.iter().map(move |c| (4, group, c.map(tag).to_vec()));
    let elements: Vec<_> = faces.chain(cells(3)).chain(cells(4).take(if twice { 6 } else { 0 })).collect();
    let names = if twice { NAMES.replace("\n3\n2 1", "\n4\n3 4 \"all\"\n2 1") } else { NAMES.to_owned() };
    let mut file = Bytes::default().text(if binary { "$MeshFormat\n2.2 1 8\n" } else { "$MeshFormat\n2.2 0 8\n" });
    file = if binary { file.ints(&[1]).text("\n") } else { file };
    file = file.text("$EndMeshFormat\n").text(&names).text("$Nodes\n8\n");
    for i in 0..8 {
        let [x, y, z] = corner(i);
        file = if binary {
            file.ints(&[tag(i)]).reals(&[x, y, z])
        } else {
            file.text(&format!("{} {x} {y} {z}\n", tag(i)))
        };
    }
    file = file.text(&format!("$EndNodes\n$Elements\n{}\n", elements.len()));
    for (i, (kind, group, corners)) in (1..).zip(&elements) {
        let corners: Vec<i32> = corners.clone();
        let text: String = corners.iter().map(|n| format!(" {n}")).collect();
        file = if binary {
            file.ints(&[*kind, 1, 2, i, *group, 7]).ints(&corners)
        } else {
            file.text(&format!("{i} {kind} 2 {group} 7{text}\n"))
        };
    }
    file.text("$EndElements\n").0
}

#[test]
fn a_cube_in_bytes_and_of_an_older_version_is_the_same_cube() {
    let cube = load("cube.msh", cube_msh().as_bytes()).unwrap();
    assert_eq!(load("cube.msh", &cube_msh_binary()).unwrap(), cube);
    assert_eq!(load("cube.msh", &cube_msh_old(false, false)).unwrap(), cube);
    assert_eq!(load("cube.msh", &cube_msh_old(true, false)).unwrap(), cube);
    assert_eq!(load("cube.msh", &cube_msh_old(true, true)).unwrap(), cube, "a cell in two groups is one cell");
    for whole in [cube_msh_binary(), cube_msh_old(true, false), cube_msh_old(false, true)] {
        let end = whole.len() - "$EndElements\n".len();
        for end in (0..end).step_by(7) {
            assert!(load("cube.msh", &whole[..end]).is_err(), "cut at {end}");
        }
    }
}

#[test]
fn a_volume_in_two_groups_is_in_both_whatever_their_tags() {
    let two = |first: &str, second: &str| {
        cube_msh()
            .replace("3\n2 1 \"base\"", &format!("4\n3 4 \"{second}\"\n2 1 \"base\""))
            .replace("soft tissue", first)
            .replace("1 0 0 0 10 10 10 1 3 2 1 2", "1 0 0 0 10 10 10 2 3 4 2 1 2")
    };
    for content in [two("tumour", "organ").into_bytes(), two("organ", "tumour").into_bytes(), cube_msh_old(false, true)]
    {
        let folder = TempDir::new().unwrap();
        let path = folder.path().join("cube.msh");
        fs::write(&path, content).unwrap();
        let (_, volumes, _) = mesh::load_with_volumes(&path, &WANTED).unwrap();
        assert_eq!(volumes.names.len(), 2);
        for cell in &volumes.of_cell {
            assert!(volumes.names.iter().all(|name| volumes.is_in(cell.unwrap(), name)), "{volumes:?}");
        }
    }
}

/// The cube with its coordinates changed, under a plate, at a unit.
fn body(at: impl Fn([f64; 3]) -> [f64; 3], unit: &str) -> Result<Vec<String>, String> {
    let (nodes, end) = (cube_msh().find("\n80\n0 0 0").unwrap() + 4, cube_msh().find("$EndNodes").unwrap());
    let places: String = (0..8).map(|i| format!("{}\n", at(corner(i)).map(|x| x.to_string()).join(" "))).collect();
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("cube.msh");
    fs::write(&path, format!("{}{places}{}", &cube_msh()[..nodes], &cube_msh()[end..])).unwrap();
    let scene = on_mesh("compression", &path, &[("sample.mesh_unit_m", unit), ("motion.depth_m", "0.002")]);
    needle_core::twin::Body::new(&scene).map(|body| body.warnings).map_err(|e| e.to_string())
}

#[test]
fn a_mesh_in_another_unit_or_frame_is_named() {
    let said = |found: Result<Vec<String>, String>| found.map_or_else(|e| e, |warnings| warnings.join("; "));
    // four nodes under a plate are too few for a force, so an error is what carries it
    let right = said(body(|p| p, "0.001"));
    assert!(!right.contains("mesh_unit_m") && !right.contains("is up"), "{right}");
    let large = said(body(|p| p, "1.0"));
    assert!(large.contains("mesh_unit_m = 0.001") && large.contains("10 x 10 x 10 mm"), "{large}");
    type Turn = fn([f64; 3]) -> [f64; 3];
    let turned: [(&str, Turn); 4] = [
        ("y is up", |[x, y, z]| [x, z, -y]),
        ("-z is up", |[x, y, z]| [x, -y, -z]),
        ("x is up", |[x, y, z]| [z, y, -x]),
        ("-y is up", |[x, y, z]| [x, -z, y]),
    ];
    for (words, turn) in turned {
        let turned = said(body(turn, "0.001"));
        assert!(turned.contains(words) && turned.contains("mesh.points = mesh.points"), "{turned}");
    }
}

/// The cube as VTU, its arrays in one of VTK's forms.
fn cube_vtu(format: &str) -> Vec<u8> {
    let points: Vec<f64> = (0..8).flat_map(corner).collect();
    let connectivity: Vec<f64> = CUBE.iter().flatten().map(|n| *n as f64).collect();
    let offsets: Vec<f64> = (1..=6).map(|i| 4.0 * f64::from(i)).collect();
    let group = |z: f64| (0..8).map(|i| f64::from(u8::from(corner(i)[2] == z))).collect::<Vec<f64>>();
    let mut appended: Vec<u8> = Vec::new();
    let mut array = |name: &str, components: usize, values: &[f64]| {
        let bytes: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
        let mut block = (bytes.len() as u32).to_le_bytes().to_vec();
        block.extend(bytes);
        let head = format!("<DataArray type=\"Float64\" Name=\"{name}\" NumberOfComponents=\"{components}\"");
        let offset = appended.len();
        match format {
            "raw" => appended.extend(&block),
            "base64" => appended.extend(STANDARD.encode(&block).bytes()),
            "binary" => return format!("{head} format=\"binary\">\n {}\n</DataArray>", STANDARD.encode(&block)),
            _ => {
                let text: Vec<String> = values.iter().map(f64::to_string).collect();
                return format!("{head} format=\"ascii\">{}</DataArray>", text.join(" "));
            }
        }
        format!("{head} format=\"appended\" offset=\"{offset}\"/>")
    };
    let body = format!(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"0.1\" byte_order=\"LittleEndian\">\n\
         <UnstructuredGrid><Piece NumberOfPoints=\"8\" NumberOfCells=\"6\">\n<PointData>{}\n{}</PointData>\n\
         <Points>{}</Points>\n<Cells>{}\n{}\n{}</Cells></Piece></UnstructuredGrid>",
        array("base", 1, &group(0.0)),
        array("contact", 1, &group(10.0)),
        array("Points", 3, &points),
        array("connectivity", 1, &connectivity),
        array("offsets", 1, &offsets),
        array("types", 1, &[10.0; 6]),
    );
    let mut bytes = body.into_bytes();
    if matches!(format, "raw" | "base64") {
        bytes.extend(format!("\n<AppendedData encoding=\"{format}\">\n_").bytes());
        bytes.extend(&appended);
        bytes.extend(b"\n</AppendedData>\n");
    }
    bytes.extend(b"</VTKFile>\n");
    bytes
}

fn load(name: &str, content: &[u8]) -> Result<(Cloud, Vec<String>), String> {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join(name);
    fs::write(&path, content).unwrap();
    mesh::load(&path, &WANTED).map_err(|e| e.to_string())
}

#[test]
fn a_cube_is_what_it_is() {
    let (cloud, warnings) = load("cube.msh", cube_msh().as_bytes()).unwrap();
    assert!(warnings.is_empty(), "{warnings:?}");
    assert_eq!((cloud.points.len(), cloud.cells.len(), cloud.surface.len()), (8, 6, 12));
    assert!((cloud.volumes().iter().sum::<f64>() - 1e-6).abs() < 1e-18, "metres");
    for (p, f) in cloud.points.iter().zip(&cloud.faces) {
        assert_eq!((f & BASE != 0, f & TOP != 0), (p[2] == 0.0, p[2] == 0.01));
    }
    for (t, face) in cloud.surface.iter().zip(&cloud.surface_faces) {
        let [a, b, c] = t.map(|n| cloud.points[n as usize]);
        let level = a[2] == b[2] && b[2] == c[2];
        assert_eq!(*face & SIDE == 0, level);
        let up = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        assert!(!level || (up > 0.0) == (*face == TOP), "outward");
    }
    for format in ["ascii", "binary", "raw", "base64"] {
        assert_eq!(load("cube.vtu", &cube_vtu(format)), Ok((cloud.clone(), Vec::new())), "{format}");
    }
    assert_eq!(load("cube.MSH", cube_msh().replace('\n', "\r\n").as_bytes()), Ok((cloud, Vec::new())));
}

#[test]
fn what_is_no_error_is_put_right_and_said() {
    let inverted = cube_msh().replace("\n6 10 20 40 80", "\n6 20 10 40 80");
    let unused = inverted
        .replace("1 8 10 80\n3 1 0 8\n", "1 9 10 90\n3 1 0 9\n90\n")
        .replace("\n80\n0 0 0", "\n80\n5 5 50\n0 0 0");
    let (cloud, warnings) = load("cube.msh", unused.as_bytes()).unwrap();
    assert_eq!(cloud, load("cube.msh", cube_msh().as_bytes()).unwrap().0);
    assert_eq!(warnings.len(), 2, "{warnings:?}");
    assert!(warnings[0].starts_with("1 nodes belong to no cell") && warnings[1].starts_with("1 inverted"));
    let low = cube_msh().replace("10 10 10\n", "10 10 0.01\n").replace("0 0 10\n", "0 0 0.01\n");
    let low = low.replace("\n10 0 10\n", "\n10 0 0.01\n").replace("\n0 10 10\n", "\n0 10 0.01\n");
    let (_, warnings) = load("cube.msh", low.as_bytes()).unwrap();
    assert!(warnings[0].contains("6 of 6 cells are poor"), "{warnings:?}");
}

#[test]
fn gmsh_files_that_are_refused_say_why() {
    let cube = cube_msh();
    let line_of = |needle: &str| cube[..cube.find(needle).unwrap()].lines().count() + 1;
    let other = |from: &str, to: &str| {
        assert!(cube.contains(from), "{from}");
        cube.replacen(from, to, 1).into_bytes()
    };
    let two = "$EndNodes\n";
    for (content, parts) in [
        (other("4.1 0 8", "3 0 8"), vec!["cube.msh:2", "\"3\"", "Mesh.MshFileVersion = 4.1"]),
        (other("4.1 0 8", "4 0 8"), vec!["cube.msh:2", "\"4\"", "Mesh.MshFileVersion = 4.1"]),
        (other("4.1 0 8", "4.1 1 8"), vec!["byte order", "Mesh.Binary = 0"]),
        (b"solid cube\n".to_vec(), vec!["not a Gmsh mesh", "$MeshFormat"]),
        (Vec::new(), vec!["not a Gmsh mesh"]),
        (other("\"base\"", "\"bottom\""), vec!["no surface group \"base\"", "base_group", "bottom, contact"]),
        (other("\"base\"", "base"), vec!["cube.msh:6", "quotes"]),
        (other("1 8 10 80", "1 9 10 80"), vec!["9 nodes are declared", "hold 8"]),
        (other("1 8 10 80", "1 99999999999999 10 80"), vec!["99999999999999 nodes are declared"]),
        (
            other("3 1 0 8\n", "3 1 0 18446744073709551615\n"),
            vec!["cube.msh:21", "18446744073709551615 nodes", "only 8"],
        ),
        (other("4 11 1 11", "5 11 1 11"), vec!["\"$EndElements\""]),
        (other("10 10 10\n$End", "10 nan 10\n$End"), vec!["node 80", "finite"]),
        (other("10 10 10\n$End", "10 1e999 10\n$End"), vec!["node 80", "finite"]),
        (other("10 10 10\n$End", "10 ten 10\n$End"), vec!["\"ten\" is not a coordinate"]),
        (other("\n20\n", "\n10\n"), vec!["node 10 is there twice"]),
        (other("\n6 10 20 40 80", "\n6 10 20 40 85"), vec!["element 6", "node 85", "doesn't have"]),
        (other("3 1 4 6\n", "3 1 11 6\n"), vec!["10-node tetrahedron", "Mesh.ElementOrder = 1"]),
        (other("3 1 4 6\n", "3 1 17 6\n"), vec!["hexahedron of second order", "Mesh.ElementOrder = 1"]),
        (other("\n6 10 20 40 80", "\n6 10 20 40 30"), vec!["1 of its 6 tetrahedra are flat", "the first is 6"]),
        (other("$Comments", "$PartitionedEntities"), vec!["partitioned"]),
        (other(two, "$EndNodes\n$Nodes\n0 0 0 0\n$EndNodes\n"), vec!["a second section $Nodes"]),
        (other("11 1 11\n", "10 1 11\n"), vec!["a block of 6 elements after 5", "only 10"]),
        (cube.as_bytes()[..cube.find("$Elements").unwrap()].to_vec(), vec!["no section $Elements"]),
        ([cube.as_bytes(), b"\xff\xfe"].concat(), vec!["where a section"]),
        (
            other("\"base\"", "\"b\u{e4}se\"").iter().map(|b| if *b == 0xc3 { 0xff } else { *b }).collect(),
            vec!["cube.msh:6", "UTF-8"],
        ),
    ] {
        let message = load("cube.msh", &content).unwrap_err();
        for part in ["cube.msh"].iter().chain(&parts) {
            assert!(message.contains(part), "\"{part}\" is not named in: {message}");
        }
    }
    let message = load("cube.msh", &other("\n6 10 20 40 80", "\n6 10 20 40 85")).unwrap_err();
    assert!(message.contains(&format!("cube.msh:{}:", line_of("6 10 20 40 80"))), "{message}");
    let only_surface = other("4 11 1 11", "3 5 1 11");
    let end = String::from_utf8(only_surface).unwrap();
    let end = format!("{}$EndElements\n", &end[..end.find("3 1 4 6").unwrap()]);
    assert!(load("cube.msh", end.as_bytes()).unwrap_err().contains("Mesh.SaveAll = 1"));
    let message = mesh::load(Path::new("no/such.msh"), &WANTED).unwrap_err().to_string();
    assert!(message.contains("no/such.msh: can't be read"), "{message}");
    assert!(load("cube.obj", b"").unwrap_err().contains("neither .msh, .vtu nor .stl"));
    for (content, part) in [
        ("", "no triangle"),
        ("solid a\nfacet", "\"normal\""),
        ("solid a\nendsolid a\n", "no triangle"),
        ("v 1 2 3", "not an STL"),
    ] {
        let message = load("cube.stl", content.as_bytes()).unwrap_err();
        assert!(message.contains(part), "{content:?}: {message}");
    }
}

#[test]
fn bodies_that_are_not_one_are_refused_with_the_files_own_names() {
    // four nodes far away, and a cell of them
    let text = cube_msh()
        .replace("1 8 10 80\n3 1 0 8\n", "1 12 10 120\n3 1 0 12\n90\n100\n110\n120\n")
        .replace("\n80\n", "\n80\n30 0 0\n31 0 0\n30 1 0\n30 0 1\n")
        .replace("4 11 1 11", "4 12 1 12")
        .replace("3 1 4 6\n", "3 1 4 7\n12 90 100 110 120\n");
    let message = load("cube.msh", text.as_bytes()).unwrap_err();
    assert!(message.contains("2 bodies that are not joined") && message.contains("in the file, node"), "{message}");
}

#[test]
fn vtu_files_that_are_refused_say_why() {
    let cube = String::from_utf8(cube_vtu("ascii")).unwrap();
    let other = |from: &str, to: &str| {
        assert!(cube.contains(from), "{from}");
        cube.replacen(from, to, 1)
    };
    for (content, parts) in [
        (other("10 10 10 10 10 10<", "24 10 10 10 10 10<"), vec!["cell 0", "10-node tetrahedron", "linear"]),
        (other("\"UnstructuredGrid\"", "\"PolyData\""), vec!["PolyData", "unstructured grid"]),
        (other("LittleEndian\"", "LittleEndian\" compressor=\"vtkLZ4DataCompressor\""), vec!["vtkLZ4", "zlib"]),
        (other("NumberOfPoints=\"8\"", "NumberOfPoints=\"9999999999\""), vec!["9999999999", "hold 8"]),
        (other("Name=\"base\"", "Name=\"bottom\""), vec!["no surface group \"base\"", "bottom, contact"]),
        (other("0 1 3 7", "0 1 3 8"), vec!["cell 0", "point 8"]),
        (other("0 1 3 7", "0 1 3 nan"), vec!["cell 0", "NaN"]),
        (other("4 8 12", "4 9 12"), vec!["cell 1", "4 corners"]),
        (other("0 0 0 10 0 0", "0 0 inf 10 0 0"), vec!["point 0", "finite"]),
        (other("</Piece>", ""), vec!["XML"]),
        ("<a>".repeat(100_000), vec!["XML"]),
        (String::new(), vec!["XML"]),
    ] {
        let message = load("cube.vtu", content.as_bytes()).unwrap_err();
        for part in ["cube.vtu"].iter().chain(&parts) {
            assert!(message.contains(part), "\"{part}\" is not named in: {message}");
        }
    }
    let binary = String::from_utf8(cube_vtu("binary")).unwrap();
    let huge = STANDARD.encode(u32::MAX.to_le_bytes());
    let start = binary.find("\n ").unwrap() + 2;
    let declared = format!("{}{}{}", &binary[..start], &huge[..5], &binary[start + 5..]);
    let message = load("cube.vtu", declared.as_bytes()).unwrap_err();
    assert!(message.contains("array base") && message.contains("are declared"), "{message}");
}

#[test]
fn files_cut_short_are_refused_wherever_the_cut_is() {
    let cube = cube_msh();
    for end in 0..cube.find("$EndElements").unwrap() {
        let message = load("cube.msh", &cube.as_bytes()[..end]).unwrap_err();
        assert!(message.contains("cube.msh"), "{message}");
    }
    for format in ["ascii", "binary"] {
        let cube = cube_vtu(format);
        for end in 0..cube.len() - 2 {
            assert!(load("cube.vtu", &cube[..end]).is_err(), "{format} cut at {end}");
        }
    }
}

#[test]
fn scenes_that_a_mesh_does_not_fit_are_refused() {
    let folder = TempDir::new().unwrap();
    let cube = folder.path().join("cube.msh");
    fs::write(&cube, cube_msh()).unwrap();
    let indenter =
        [("instrument.diameter_m", "0.004"), ("instrument.entry_x_m", "0.005"), ("instrument.entry_y_m", "0.005")];
    let refused = |preset: &str, changes: &[(&str, &str)]| {
        let scene = on_mesh(preset, &cube, &[&[("motion.depth_m", "0.001")], changes].concat());
        Twin::new(&scene).unwrap_err().to_string()
    };
    for (message, parts) in [
        (refused("indentation", &indenter), &["sample.mesh", "0 nodes", "refine"] as &[&str]),
        (refused("indentation", &[("instrument.entry_x_m", "0.02")]), &["instrument.entry_x_m", "contact_group"]),
        (refused("indentation", &[("sample.contact_group", "lid")]), &["\"lid\"", "base, contact"]),
        (refused("indentation", &[("sample.mesh_unit_m", "1.5")]), &["mesh_unit_m", "15", "0.001"]),
        (refused("indentation", &[("sample.mesh", "no/such.msh")]), &["sample.mesh", "no/such.msh", "can't be read"]),
        (
            refused("needle_insertion", &[("targets.0.position_m", "[0.02, 0, 0]")]),
            &["targets.0.position_m", "on_path", "no cell"],
        ),
        (
            refused("needle_insertion", &[&TARGETS[..], &indenter[1..]].concat()),
            &["instrument.capture_radius_m", "too coarse", "refine"],
        ),
    ] {
        for part in parts {
            assert!(message.contains(part), "\"{part}\" is not named in: {message}");
        }
    }
    let mut scene = on_mesh("indentation", &cube, &[]);
    for (key, value, part) in [
        ("discretisation.spacing_m", "0.001", "belongs to \"cylinder\" and \"box\""),
        ("sample.height_m", "0.001", "belongs to \"cylinder\" and \"box\""),
        ("discretisation.dimension", "axisymmetric", "body of revolution"),
        ("sample.contact_group", "base", "held"),
        ("sample.mesh_unit_m", "0", "(0, "),
        ("sample.mesh", "", "name"),
    ] {
        let message = scene.set(key, value).unwrap_err().to_string();
        assert!(message.contains(key) && message.contains(part), "{message}");
    }
    let mut own = Scene::preset("indentation").unwrap();
    let message = own.set("sample.mesh", "a.msh").unwrap_err().to_string();
    assert!(message.contains("sample.mesh") && message.contains("belongs to \"mesh\""), "{message}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 512, ..ProptestConfig::default() })]

    #[test]
    fn damaged_files_never_panic(form in 0usize..5, hits in proptest::collection::vec((any::<u16>(), any::<u8>()), 1..4)) {
        let (name, mut content) = match form {
            0 => ("cube.msh", cube_msh().into_bytes()),
            i => ("cube.vtu", cube_vtu(["ascii", "binary", "raw", "base64"][i - 1])),
        };
        for (at, byte) in hits {
            let at = usize::from(at) % content.len();
            content[at] = byte;
        }
        let _ = load(name, &content);
    }
}
