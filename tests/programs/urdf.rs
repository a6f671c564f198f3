//! `needle_twin scene urdf`, read by an XML parser that is not this project's.
#![allow(clippy::unwrap_used, clippy::panic)]

use serde_json::{Value, json};
use std::process::{Command, Output};
use testkit::python::python;

/// Names, joints and shapes of a description.
const READ: &str = "
import json, sys, xml.etree.ElementTree as xml
robot = xml.fromstring(sys.stdin.read())
joints = {j.get('name'): [j.get('type'), j.find('parent').get('link'), j.find('child').get('link'), j.find('origin').get('xyz')] for j in robot.iter('joint')}
shapes = {l.get('name'): [[g[0].tag, dict(g[0].items())] for g in l.iter('geometry')] for l in robot.iter('link')}
assert {m.get('name') for m in robot.iter('material')} == {m.get('name') for m in robot.findall('material')}
print(json.dumps({'name': robot.get('name'), 'joints': joints, 'shapes': shapes}))
";

fn urdf(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_needle_twin")).args(["scene", "urdf"]).args(arguments).output().unwrap()
}

fn read(arguments: &[&str]) -> Value {
    let output = urdf(arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    let mut parser = Command::new(python());
    parser.args(["-c", READ]).stdin(std::process::Stdio::piped()).stdout(std::process::Stdio::piped());
    let mut parser = parser.spawn().unwrap();
    std::io::Write::write_all(&mut parser.stdin.take().unwrap(), &output.stdout).unwrap();
    let parsed = parser.wait_with_output().unwrap();
    serde_json::from_slice(&parsed.stdout)
        .unwrap_or_else(|e| panic!("{e}: {}", String::from_utf8_lossy(&output.stdout)))
}

#[test]
fn the_frames_are_those_of_the_twin_and_the_sizes_those_of_the_scene() {
    let entry =
        ["--set", "instrument.entry_x_m=0.002", "--set", "instrument.load_cell_height_m=0.08", "--joint", "z<1>"];
    let robot = read(&[&["needle_insertion", "--set", "name=a \"b\" & c"][..], &entry].concat());
    assert_eq!(robot["name"], "a \"b\" & c");
    let shown = Command::new(env!("CARGO_BIN_EXE_needle_twin"))
        .args(["scene", "show", "needle_insertion", "--json"])
        .output()
        .unwrap();
    let scene: Value = serde_json::from_slice(&shown.stdout).unwrap();
    let (height, needle) = (&scene["sample.height_m"], scene["instrument.diameter_m"].as_f64().unwrap());
    let joints = json!({
        "z<1>": ["prismatic", "sample", "needle_tip", format!("0.002 0 {height}")],
        "load_cell": ["fixed", "needle_tip", "load_cell", "0 0 -0.08"],
    });
    assert_eq!(robot["joints"], joints);
    let radius = 0.5 * scene["sample.diameter_m"].as_f64().unwrap();
    let sizes = |radius: f64, length: f64| json!({"radius": radius.to_string(), "length": length.to_string()});
    assert_eq!(robot["shapes"]["sample"], json!([["cylinder", sizes(radius, height.as_f64().unwrap())]]));
    assert_eq!(robot["shapes"]["needle_tip"], json!([["cylinder", sizes(0.5 * needle, 0.08)]]));
    for (scene, shapes) in [("compression", 1), ("indentation", 1)] {
        assert_eq!(read(&[scene])["shapes"]["needle_tip"].as_array().unwrap().len(), shapes, "{scene}");
    }
}

#[test]
fn a_sample_with_a_mesh_is_drawn_by_its_surface() {
    let folder = tempfile::tempdir().unwrap();
    let (first, second) = (folder.path().join("first.stl"), folder.path().join("second one.stl"));
    let (first, second) = (first.to_str().unwrap(), second.to_str().unwrap());
    // a block of 20 x 20 x 10 mm, closed
    let corner =
        |i: usize| [0.01 * (2.0 * (i & 1) as f64 - 1.0), 0.01 * ((i & 2) as f64 - 1.0), 0.0025 * (i & 4) as f64];
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let facet = |[a, b, c]: [usize; 3]| {
        let vertex = |i: usize| corner(i).iter().fold("vertex".to_owned(), |text, x| format!("{text} {x}")) + "\n";
        format!("facet normal 0 0 0\nouter loop\n{}{}{}endloop\nendfacet\n", vertex(a), vertex(b), vertex(c))
    };
    let facets: String = faces.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).map(facet).collect();
    std::fs::write(first, format!("solid\n{facets}endsolid\n")).unwrap();
    let scene = folder.path().join("scene.toml");
    let text = format!(
        "name = \"block\"\n[sample]\nshape = \"outline\"\nmesh = \"{first}\"\n\
         [material]\nmodel = \"neo_hookean\"\nshear_modulus_pa = 1678.0\npoisson_ratio = 0.49\ndensity_kg_per_m3 = 970.0\n\
         [instrument]\nkind = \"indenter\"\ndiameter_m = 0.004\ntip = \"sphere\"\n[discretisation]\nspacing_m = 0.003\n"
    );
    std::fs::write(&scene, text).unwrap();
    let scene = scene.to_str().unwrap();
    let refused = urdf(&[scene]);
    let said = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(refused.status.code() == Some(1) && said.contains("--mesh FILE.stl"), "{said}");
    let robot = read(&[scene, "--mesh", second]);
    let [(kind, file)] =
        [(&robot["shapes"]["sample"][0][0], robot["shapes"]["sample"][0][1]["filename"].as_str().unwrap())];
    assert_eq!(
        (kind, file),
        (&json!("mesh"), &*format!("file://{}", std::fs::canonicalize(second).unwrap().display()).replace(' ', "%20"))
    );
    assert_eq!(robot["joints"]["insertion"][3], "0 0 0.01");
    let kinds: Vec<&Value> = robot["shapes"]["needle_tip"].as_array().unwrap().iter().map(|shape| &shape[0]).collect();
    assert_eq!(kinds, ["sphere", "cylinder"]);
    // the file is read again, as a sample
    let again = std::fs::read_to_string(scene).unwrap().replace("first.stl", "second one.stl");
    let copy = folder.path().join("again.toml");
    std::fs::write(&copy, again).unwrap();
    let checked = Command::new(env!("CARGO_BIN_EXE_needle_twin")).args(["scene", "check"]).arg(&copy).output().unwrap();
    let said = String::from_utf8_lossy(&checked.stdout).into_owned();
    assert!(
        checked.status.success() && said.contains("mesh of 20"),
        "{said}{}",
        String::from_utf8_lossy(&checked.stderr)
    );
}
