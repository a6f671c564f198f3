//! VTK's XML format for unstructured grids (.vtu), as ParaView, PyVista and meshio write it.
//!
//! Read are points, linear tetrahedra, hexahedra, wedges and pyramids, and groups: arrays of one component at the points or cells whose
//! name was asked for; what is not zero is a member. Vertices and lines only carry groups, and so do
//! triangles and quadrangles beside cells; alone they are a surface.

use roxmltree::{Document, Node};

use super::arrays::{Appended, Encoding};
use super::imported::{Flaw, Imported};

/// VTK's numbers of linear cells with their corners: vertex, line, triangle, pixel and quadrangle; tetrahedron, hexahedron, wedge, pyramid.
const SMALLER: [(f64, usize); 5] = [(1.0, 1), (3.0, 2), (5.0, 3), (PIXEL, 4), (9.0, 4)];
const SOLID: [(f64, usize); 5] = [(10.0, 4), (VOXEL, 8), (12.0, 8), (13.0, 6), (14.0, 5)];
/// Cells that make a surface: triangles, pixels and quadrangles.
const FACETS: [f64; 3] = [5.0, PIXEL, 9.0];
/// An upright rectangle, whose corners are counted along two axes instead of round it.
const PIXEL: f64 = 8.0;
/// An upright box, whose corners are counted along x, y and z instead of round its faces.
const VOXEL: f64 = 11.0;

/// A cell as the file has it.
struct Cell {
    kind: f64,
    corners: Vec<u32>,
}

/// Reads a file's content.
pub(super) fn read(bytes: &[u8], wanted: &[&str]) -> Result<Imported, Flaw> {
    let (xml, appended) = split(bytes)?;
    let document = Document::parse(&xml).map_err(|e| Flaw {
        line: Some(e.pos().row as usize),
        reason: format!("not the XML of a VTU: {e}; was it cut short?"),
    })?;
    let file = document.root_element();
    let kind = file.attribute("type").unwrap_or_default();
    if !file.has_tag_name("VTKFile") || kind != "UnstructuredGrid" {
        return Err(Flaw::of_file(format!(
            "a <{}> of type \"{kind}\", not VTK's unstructured grid: save it as .vtu",
            file.tag_name().name()
        )));
    }
    let encoding = encoding(file, appended, bytes.len())?;
    let mut pieces = file.descendants().filter(|n| n.has_tag_name("Piece"));
    match (pieces.next(), pieces.next()) {
        (Some(piece), None) => Piece { node: piece, encoding }.read(wanted),
        (None, _) => Err(Flaw::of_file("it has no Piece: it holds no mesh")),
        _ => Err(Flaw::of_file("it has several pieces: merge them into one")),
    }
}

/// The XML without the content of `AppendedData` (which may not be text), and that content after its underscore.
fn split(bytes: &[u8]) -> Result<(String, Option<Appended<'_>>), Flaw> {
    const TAG: &[u8] = b"<AppendedData";
    let Some(start) = bytes.windows(TAG.len()).position(|w| w == TAG) else {
        return text(bytes).map(|xml| (xml.to_owned(), None));
    };
    let (xml, rest) = (text(&bytes[..start])?, &bytes[start..]);
    let close = rest.iter().position(|b| *b == b'>').unwrap_or(rest.len());
    let base64 = match text(&rest[..close])? {
        tag if tag.contains("\"base64\"") => true,
        tag if tag.contains("\"raw\"") => false,
        _ => return Err(Flaw::of_file("its AppendedData is neither raw nor base64")),
    };
    let underscore = rest[close..].iter().position(|b| *b == b'_');
    let underscore = underscore.ok_or_else(|| Flaw::of_file("its AppendedData doesn't start with an underscore"))?;
    Ok((format!("{xml}</VTKFile>"), Some(Appended { content: &rest[close + underscore + 1..], base64 })))
}

fn text(bytes: &[u8]) -> Result<&str, Flaw> {
    std::str::from_utf8(bytes)
        .map_err(|e| Flaw::of_file(format!("byte {} is not UTF-8 text: not a VTU", e.valid_up_to())))
}

fn encoding<'a>(file: Node<'_, '_>, appended: Option<Appended<'a>>, length: usize) -> Result<Encoding<'a>, Flaw> {
    let attribute = |name: &str, default: &'static str| file.attribute(name).unwrap_or(default).to_owned();
    let refuse = |name: &str, value: &str, remedy: &str| {
        Err(Flaw::of_file(format!("{name}=\"{value}\" is not read: save it {remedy}")))
    };
    Ok(Encoding {
        big: match attribute("byte_order", "LittleEndian").as_str() {
            "LittleEndian" => false,
            "BigEndian" => true,
            other => return refuse("byte_order", other, "in little endian"),
        },
        header: match attribute("header_type", "UInt32").as_str() {
            "UInt32" => 4,
            "UInt64" => 8,
            other => return refuse("header_type", other, "with UInt64"),
        },
        zlib: match attribute("compressor", "").as_str() {
            "" => false,
            "vtkZLibDataCompressor" => true,
            other => return refuse("compressor", other, "with zlib or without compression"),
        },
        appended,
        length,
    })
}

struct Piece<'a, 'd> {
    node: Node<'a, 'd>,
    encoding: Encoding<'a>,
}

impl<'a, 'd> Piece<'a, 'd> {
    fn read(&self, wanted: &[&str]) -> Result<Imported, Flaw> {
        let coordinates = self.section("Points").and_then(|s| arrays(s).next());
        let coordinates = coordinates.ok_or_else(|| Flaw::of_file("its Piece has no Points"))?;
        let mut mesh = Imported { points: points(&self.encoding.numbers(coordinates)?)?, ..Imported::default() };
        self.as_declared("NumberOfPoints", mesh.points.len())?;
        mesh.node_names = (0..mesh.points.len() as u64).collect();
        let all = self.cells(mesh.points.len())?;
        for (i, cell) in (0..).zip(&all) {
            if SOLID.iter().any(|(kind, _)| *kind == cell.kind) {
                mesh.add(i, &cell.corners).map_err(Flaw::of_file)?;
            }
        }
        if mesh.cells.is_empty() {
            all.iter().filter(|cell| FACETS.contains(&cell.kind)).for_each(|cell| mesh.add_facet(&cell.corners));
            mesh.remedy =
                "; none of its cells is a tetrahedron or a hexahedron: mesh in 3 dimensions, or close its surface";
        }
        if mesh.cells.is_empty() && mesh.surface.is_empty() {
            return Err(Flaw::of_file(format!(
                "none of its {} cells is a tetrahedron or a hexahedron: mesh in 3 dimensions",
                all.len()
            )));
        }
        self.groups(&mut mesh, &all, wanted)?;
        mesh.name_by_height(wanted);
        Ok(mesh)
    }

    fn section(&self, name: &str) -> Option<Node<'a, 'd>> {
        self.node.children().find(|n| n.has_tag_name(name))
    }

    fn as_declared(&self, name: &str, read: usize) -> Result<(), Flaw> {
        let declared = self.node.attribute(name).unwrap_or_default();
        if declared.parse() == Ok(read) {
            return Ok(());
        }
        Err(Flaw::of_file(format!("{name}=\"{declared}\", but the arrays hold {read}")))
    }

    /// Corners of every cell.
    fn cells(&self, points: usize) -> Result<Vec<Cell>, Flaw> {
        let array = |name: &str| {
            let found = self.section("Cells").and_then(|s| arrays(s).find(|a| a.attribute("Name") == Some(name)));
            self.encoding.numbers(found.ok_or_else(|| Flaw::of_file(format!("its Cells have no array {name}")))?)
        };
        let (connectivity, offsets, types) = (array("connectivity")?, array("offsets")?, array("types")?);
        self.as_declared("NumberOfCells", types.len())?;
        if offsets.len() != types.len() {
            return Err(Flaw::of_file(format!("{} cells have {} offsets", types.len(), offsets.len())));
        }
        let mut start = 0;
        let mut cells = Vec::new();
        for (i, (&end, &kind)) in offsets.iter().zip(&types).enumerate() {
            let corners = corners(kind).ok_or_else(|| Flaw::of_file(foreign(i, kind)))?;
            if end != (start + corners) as f64 || start + corners > connectivity.len() {
                return Err(Flaw::of_file(format!("cell {i} of type {kind} doesn't have {corners} corners")));
            }
            let cell = connectivity[start..start + corners].iter().map(|&n| {
                let known = n >= 0.0 && n < points as f64 && n.fract() == 0.0;
                known.then_some(n as u32).ok_or_else(|| Flaw::of_file(format!("cell {i} names point {n} of {points}")))
            });
            let mut corners: Vec<u32> = cell.collect::<Result<_, _>>()?;
            if kind == VOXEL || kind == PIXEL {
                corners.swap(2, 3);
            }
            if kind == VOXEL {
                corners.swap(6, 7);
            }
            start += corners.len();
            cells.push(Cell { kind, corners });
        }
        Ok(cells)
    }

    fn groups(&self, mesh: &mut Imported, cells: &[Cell], wanted: &[&str]) -> Result<(), Flaw> {
        for (section, members) in [("PointData", mesh.points.len()), ("CellData", cells.len())] {
            for array in self.section(section).into_iter().flat_map(arrays) {
                let name = array.attribute("Name").unwrap_or_default();
                if array.attribute("NumberOfComponents").is_some_and(|n| n != "1") {
                    continue;
                }
                mesh.known_groups.push(name.to_owned());
                if !wanted.contains(&name) {
                    continue;
                }
                let marks = self.encoding.numbers(array)?;
                if marks.len() != members {
                    let reason = format!("array {name} of {section} has {} values for {members}", marks.len());
                    return Err(Flaw::of_file(reason));
                }
                let member = (0..members as u32).filter(|&i| marks[i as usize] != 0.0);
                let nodes: Vec<u32> = match section {
                    "PointData" => member.collect(),
                    _ => member.flat_map(|i| cells[i as usize].corners.iter().copied()).collect(),
                };
                let group = mesh.groups.entry(name.to_owned()).or_default();
                group.extend(nodes);
                group.sort_unstable();
                group.dedup();
            }
        }
        mesh.known_groups.sort_unstable();
        mesh.known_groups.dedup();
        Ok(())
    }
}

fn arrays<'a, 'd>(section: Node<'a, 'd>) -> impl Iterator<Item = Node<'a, 'd>> {
    section.children().filter(|n| n.has_tag_name("DataArray"))
}

fn points(numbers: &[f64]) -> Result<Vec<[f64; 3]>, Flaw> {
    let (points, rest) = numbers.as_chunks::<3>();
    if !rest.is_empty() {
        return Err(Flaw::of_file(format!("{} coordinates are not three for each point", numbers.len())));
    }
    match points.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
        Some(i) => Err(Flaw::of_file(format!("point {i} has a coordinate that is not a finite number"))),
        None => Ok(points.to_vec()),
    }
}

fn corners(kind: f64) -> Option<usize> {
    SMALLER.iter().chain(&SOLID).find(|(number, _)| *number == kind).map(|(_, corners)| *corners)
}

/// What is said of a cell that can't be used.
fn foreign(cell: usize, kind: f64) -> String {
    let name = match kind as i64 {
        7 => "a polygon",
        22 => "a 6-node triangle",
        23 => "an 8-node quadrangle",
        24 => "a 10-node tetrahedron",
        25 => "a 20-node hexahedron",
        29 => "a 27-node hexahedron",
        42 => "a polyhedron",
        _ => "none of a triangle, quadrangle, tetrahedron, hexahedron, wedge and pyramid",
    };
    format!("cell {cell} is {name} (VTK type {kind}), which is not read: save it with linear cells")
}
