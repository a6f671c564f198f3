//! Contract of files with hexahedra: they are read, and bad ones refused.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::fs;

use crate::mesh_import::WANTED;
use mtled::cloud::{BASE, Cloud, TOP};
use needle_core::mesh;
use tempfile::TempDir;

/// Cells along each edge of a cube of 20 mm.
pub(crate) const CELLS: usize = 6;

/// Kinds of cells of a file.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Kinds {
    Hexahedra,
    /// In each layer hexahedra, and in the upper half two wedges, or six pyramids, or six tetrahedra in a place.
    Mixed,
}

fn node(i: usize, j: usize, k: usize) -> usize {
    i + (CELLS + 1) * (j + (CELLS + 1) * k)
}

/// Nodes of the cube in mm, those inside pushed about, so that faces are warped; and one in the middle of each cell, for pyramids.
fn points() -> Vec<[f64; 3]> {
    let pushed = |x: usize, n: usize, axis: usize| {
        let inside = [n % (CELLS + 1), n / (CELLS + 1) % (CELLS + 1), n / (CELLS + 1).pow(2)];
        let push = if inside.iter().all(|i| *i > 0 && *i < CELLS) { ((3 * n + axis) as f64).sin() } else { 0.0 };
        (x as f64 + 0.12 * push) * 20.0 / CELLS as f64
    };
    let corner = |n: usize| {
        let at = [n % (CELLS + 1), n / (CELLS + 1) % (CELLS + 1), n / (CELLS + 1).pow(2)];
        std::array::from_fn(|axis| pushed(at[axis], n, axis))
    };
    let corners: Vec<[f64; 3]> = (0..(CELLS + 1).pow(3)).map(corner).collect();
    let middle = |c: [usize; 8]| std::array::from_fn(|axis| c.iter().map(|&n| corners[n][axis]).sum::<f64>() / 8.0);
    let middles: Vec<[f64; 3]> = boxes().map(middle).collect();
    [corners, middles].concat()
}

fn boxes() -> impl Iterator<Item = [usize; 8]> {
    (0..CELLS.pow(3)).map(|b| {
        let (i, j, k) = (b % CELLS, b / CELLS % CELLS, b / CELLS.pow(2));
        let face = |k: usize| [node(i, j, k), node(i + 1, j, k), node(i + 1, j + 1, k), node(i, j + 1, k)];
        let ([a, b, c, d], [e, f, g, h]) = (face(k), face(k + 1));
        [a, b, c, d, e, f, g, h]
    })
}

/// Gmsh's type of each cell, and its corners.
pub(crate) fn cells(kinds: Kinds) -> Vec<(u32, Vec<usize>)> {
    let mut cells = Vec::new();
    for (n, c) in boxes().enumerate() {
        let [a, b, cc, d, e, f, g, h] = c;
        match (kinds, n / CELLS.pow(2) * 2 / CELLS, n % 3) {
            (Kinds::Mixed, 1, 0) => cells.extend([(6, vec![a, b, cc, e, f, g]), (6, vec![a, cc, d, e, g, h])]),
            (Kinds::Mixed, 1, 1) => {
                let tip = (CELLS + 1).pow(3) + n;
                let faces = [[a, b, cc, d], [e, h, g, f], [a, e, f, b], [b, f, g, cc], [cc, g, h, d], [d, h, e, a]];
                cells.extend(faces.map(|face| (7, [&face[..], &[tip]].concat())));
            }
            _ => cells.push((5, c.to_vec())),
        }
    }
    cells
}

/// The mesh as Gmsh writes it, with groups of quadrangles; tags from 1.
pub(crate) fn msh(cells: &[(u32, Vec<usize>)]) -> String {
    let points = points();
    let mut text = String::from(
        "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$PhysicalNames\n4\n2 1 \"base\"\n2 2 \"contact\"\n3 3 \"lower\"\n3 4 \"upper\"\n\
         $EndPhysicalNames\n$Entities\n0 0 2 2\n1 0 0 0 20 20 0 1 1 0\n2 0 0 20 20 20 20 1 2 0\n\
         1 0 0 0 20 20 10 1 3 0\n2 0 0 10 20 20 20 1 4 0\n$EndEntities\n$Nodes\n",
    );
    text += &format!("1 {0} 1 {0}\n3 1 0 {0}\n", points.len());
    (1..=points.len()).for_each(|n| text += &format!("{n}\n"));
    points.iter().for_each(|p| text += &format!("{} {} {}\n", p[0], p[1], p[2]));
    let quadrangles = 2 * CELLS * CELLS;
    let blocks = 2 + cells.len();
    text += &format!("$EndNodes\n$Elements\n{blocks} {0} 1 {0}\n", quadrangles + cells.len());
    let mut tag = 0;
    let mut line = |text: &mut String, corners: &[usize]| {
        tag += 1;
        let words: Vec<String> = corners.iter().map(|n| (n + 1).to_string()).collect();
        *text += &format!("{tag} {}\n", words.join(" "));
    };
    for (surface, k) in [(1, 0), (2, CELLS)] {
        text += &format!("2 {surface} 3 {}\n", CELLS * CELLS);
        for (i, j) in (0..CELLS * CELLS).map(|q| (q % CELLS, q / CELLS)) {
            line(&mut text, &[node(i, j, k), node(i + 1, j, k), node(i + 1, j + 1, k), node(i, j + 1, k)]);
        }
    }
    for (kind, corners) in cells {
        let upper = corners.iter().filter(|&&n| points[n][2] > 10.5).count() > 1;
        text += &format!("3 {} {kind} 1\n", if upper { 2 } else { 1 });
        line(&mut text, corners);
    }
    text + "$EndElements\n"
}

/// The same as VTU, its hexahedra as voxels' corners are counted if they are to be.
fn vtu(cells: &[(u32, Vec<usize>)], voxels: bool) -> String {
    let points = points();
    let kind = |gmsh: u32| match gmsh {
        5 if voxels => 11,
        5 => 12,
        6 => 13,
        7 => 14,
        _ => 10,
    };
    let order = |(gmsh, c): &(u32, Vec<usize>)| match gmsh {
        5 if voxels => [0, 1, 3, 2, 4, 5, 7, 6].map(|k| c[k]).to_vec(),
        _ => c.clone(),
    };
    let words = |numbers: &mut dyn Iterator<Item = String>| numbers.collect::<Vec<_>>().join(" ");
    let array = |name: &str, components: u32, text: String| {
        format!(
            "<DataArray type=\"Float64\" Name=\"{name}\" NumberOfComponents=\"{components}\" format=\"ascii\">{text}</DataArray>"
        )
    };
    let group = |z: f64| words(&mut points.iter().map(|p| u8::from(p[2] == z).to_string()));
    let mut end = 0;
    let offsets = words(&mut cells.iter().map(|(_, c)| {
        end += c.len();
        end.to_string()
    }));
    format!(
        "<VTKFile type=\"UnstructuredGrid\" byte_order=\"LittleEndian\"><UnstructuredGrid><Piece NumberOfPoints=\"{}\" \
         NumberOfCells=\"{}\"><PointData>{}{}</PointData><Points>{}</Points><Cells>{}{}{}</Cells></Piece></UnstructuredGrid></VTKFile>",
        points.len(),
        cells.len(),
        array("base", 1, group(0.0)),
        array("contact", 1, group(20.0)),
        array("Points", 3, words(&mut points.iter().flatten().map(f64::to_string))),
        array("connectivity", 1, words(&mut cells.iter().flat_map(order).map(|n| n.to_string()))),
        array("offsets", 1, offsets),
        array("types", 1, words(&mut cells.iter().map(|(gmsh, _)| kind(*gmsh).to_string()))),
    )
}

fn load(folder: &TempDir, name: &str, content: &str) -> Result<(Cloud, Vec<String>), String> {
    let path = folder.path().join(name);
    fs::write(&path, content).unwrap();
    mesh::load(&path, &WANTED).map_err(|e| e.to_string())
}

#[test]
fn hexahedra_wedges_and_pyramids_fill_a_cube() {
    let folder = TempDir::new().unwrap();
    for kinds in [Kinds::Hexahedra, Kinds::Mixed] {
        let cells = cells(kinds);
        let (cloud, warnings) = load(&folder, "cube.msh", &msh(&cells)).unwrap();
        // the middles of cells are in the file for pyramids
        assert!(warnings.iter().all(|w| w.contains("belong to no cell")), "{warnings:?}");
        let hexahedra = cells.iter().filter(|(kind, _)| *kind == 5).count();
        assert_eq!(cloud.hexahedra.len(), hexahedra);
        let volume: f64 = cloud.volumes().iter().sum();
        assert!((volume / 8e-6 - 1.0).abs() < 1e-12, "{volume}");
        for h in &cloud.hexahedra {
            assert!(h.cells.iter().all(|&c| cloud.cells[c as usize].iter().all(|n| h.corners.contains(n))));
        }
        for (p, f) in cloud.points.iter().zip(&cloud.faces) {
            assert_eq!((f & BASE != 0, f & TOP != 0), (p[2] == 0.0, (p[2] - 0.02).abs() < 1e-12));
        }
        assert_eq!(load(&folder, "cube.vtu", &vtu(&cells, false)).unwrap().0, cloud);
        assert_eq!(load(&folder, "cube.vtu", &vtu(&cells, true)).unwrap().0, cloud, "voxels");
    }
}

#[test]
fn bad_hexahedra_are_refused_with_the_reason() {
    let folder = TempDir::new().unwrap();
    let all = cells(Kinds::Hexahedra);
    let changed = |change: &dyn Fn(&mut Vec<usize>)| {
        let mut cells = all.clone();
        change(&mut cells[3].1);
        let tag = 2 * CELLS * CELLS + 4;
        (load(&folder, "cube.msh", &msh(&cells)), load(&folder, "cube.vtu", &vtu(&cells, false)), tag)
    };
    let (msh_says, vtu_says, tag) = changed(&|c| c[6] = c[7]);
    let message = msh_says.unwrap_err();
    assert!(message.contains(&format!("element {tag} of 8 corners has a node twice")), "{message}");
    assert!(message.contains("cube.msh:") && message.contains("wedge"), "{message}");
    assert!(vtu_says.unwrap_err().contains("element 3 of 8 corners has a node twice"));
    let (msh_says, vtu_says, tag) = changed(&|c| c.swap(2, 3));
    let message = msh_says.unwrap_err();
    assert!(
        message.contains(&format!("hexahedron {tag}, at")) && message.contains("order of Gmsh and VTK"),
        "{message}"
    );
    assert!(vtu_says.unwrap_err().contains("hexahedron 3, at"));
    // inside out is no fault
    let (cloud, ..) = changed(&|c| c.rotate_left(4));
    let (cloud, warnings) = cloud.unwrap();
    assert!(warnings.iter().any(|w| w.contains("6 inverted")), "{warnings:?}");
    assert_eq!(cloud.cells, load(&folder, "cube.msh", &msh(&all)).unwrap().0.cells);
    let second = msh(&all).replacen(" 5 1\n", " 17 1\n", 1);
    let message = load(&folder, "cube.msh", &second).unwrap_err();
    assert!(message.contains("hexahedron of second order") && message.contains("Mesh.ElementOrder = 1"), "{message}");
}
