//! Gmsh's MSH format, versions 4.1 and 2.2, as text and in bytes (Gmsh reference manual, "MSH file format").
//!
//! Read are nodes, tetrahedra, hexahedra, wedges and pyramids of first order, and the physical groups of surfaces (by their triangles and
//! quadrangles) and volumes. Triangles and quadrangles alone are a surface. Points, lines and sections that no mesh needs are skipped.
//!
//! Version 4.1 has groups by the entity (surface, volume) that an element is of. Version 2.2 has them by the element, which is there once for
//! each group that it is in: elements of the same nodes are one here, and what is in the same groups is an entity.

use std::collections::{BTreeMap, BTreeSet};

use super::imported::{Flaw, Imported, Volumes};
use super::words::{Words, short};

/// What to do about a file of another form.
const SAVE_AS: &str = "save it with Mesh.MshFileVersion = 4.1";
/// What to do about a file without cells whose surface can't be used.
const NO_CELLS: &str = "; it has no tetrahedra and no hexahedra: mesh in 3 dimensions, and name a physical volume as well (or save with \
                        Mesh.SaveAll = 1): Gmsh leaves out what is in no physical group";
/// Gmsh's numbers of the element types that are read or skipped.
const LINE: i64 = 1;
const TRIANGLE: i64 = 2;
const QUADRANGLE: i64 = 3;
const TETRAHEDRON: i64 = 4;
const HEXAHEDRON: i64 = 5;
const WEDGE: i64 = 6;
const PYRAMID: i64 = 7;
const POINT: i64 = 15;

/// Reads a file's content.
pub(super) fn read(bytes: &[u8], wanted: &[&str]) -> Result<Imported, Flaw> {
    let mut reader = Reader::new(bytes);
    reader.format()?;
    while reader.section()? {}
    reader.finish(wanted)
}

/// Versions that are read.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Version {
    Two,
    FourOne,
}

/// An element of version 2.2.
struct OldElement {
    tag: u64,
    kind: i64,
    corners: Vec<u32>,
    /// Physical groups.
    groups: Vec<i64>,
}

struct Reader<'a> {
    words: Words<'a>,
    version: Version,
    binary: bool,
    mesh: Imported,
    /// Node by its tag: tags may be sparse.
    node_of: BTreeMap<u64, u32>,
    /// Names of physical surfaces by their tag.
    names: BTreeMap<i64, String>,
    /// Physical groups of each surface.
    groups_of: BTreeMap<i64, Vec<i64>>,
    /// Names of physical volumes by their tag, the groups of each volume, and the volume of each cell.
    volume_names: BTreeMap<i64, String>,
    volume_groups_of: BTreeMap<i64, Vec<i64>>,
    volume_of_cell: Vec<i64>,
    /// Nodes of the triangles and quadrangles of each surface.
    patches: BTreeMap<i64, Vec<u32>>,
    seen: Vec<&'a str>,
}

impl<'a> Reader<'a> {
    fn new(bytes: &'a [u8]) -> Self {
        Self {
            words: Words::new(bytes),
            version: Version::FourOne,
            binary: false,
            mesh: Imported::default(),
            node_of: BTreeMap::new(),
            names: BTreeMap::new(),
            groups_of: BTreeMap::new(),
            volume_names: BTreeMap::new(),
            volume_groups_of: BTreeMap::new(),
            volume_of_cell: Vec::new(),
            patches: BTreeMap::new(),
            seen: Vec::new(),
        }
    }

    fn format(&mut self) -> Result<(), Flaw> {
        match self.words.next() {
            Some("$MeshFormat") => {}
            _ => return Err(self.words.flaw("not a Gmsh mesh: it doesn't start with $MeshFormat")),
        }
        self.version = match self.words.next().unwrap_or_default() {
            "4.1" => Version::FourOne,
            "2" | "2.0" | "2.1" | "2.2" => Version::Two,
            other => {
                let other = short(other);
                return Err(self
                    .words
                    .flaw(format!("MSH version \"{other}\" is not read, only 4.1 and 2.2: {SAVE_AS}")));
            }
        };
        self.binary = self.words.number::<u32>("the file type (0: text, 1: binary)")? != 0;
        let size: u32 = self.words.number("the size of a number")?;
        if self.binary {
            let one = self.in_bytes(|reader| reader.words.whole("the number 1"))?;
            if size != 8 || one != 1 {
                return Err(self.words.flaw(format!(
                    "its numbers are of {size} bytes, or of another byte order than little endian: {SAVE_AS}, Mesh.Binary = 0"
                )));
            }
        }
        self.end("MeshFormat")
    }

    /// Reads one section; false at the end of the file.
    fn section(&mut self) -> Result<bool, Flaw> {
        let Some(word) = self.words.next() else { return Ok(false) };
        let Some(name) = word.strip_prefix('$') else {
            let word = short(word);
            return Err(self.words.flaw(format!("\"{word}\" where a section ($Nodes, $Elements ...) should begin")));
        };
        if self.seen.contains(&name) && matches!(name, "Entities" | "Nodes" | "Elements") {
            return Err(self.words.flaw(format!("a second section ${name}: one mesh a file")));
        }
        match (name, self.version) {
            ("PhysicalNames", _) => self.physical_names()?,
            ("Entities", Version::FourOne) => self.in_bytes(Self::entities)?,
            ("Nodes", Version::FourOne) => self.in_bytes(Self::nodes)?,
            ("Elements", Version::FourOne) => self.in_bytes(Self::elements)?,
            ("Nodes", Version::Two) => self.old_nodes()?,
            ("Elements", Version::Two) => self.old_elements()?,
            ("PartitionedEntities", _) => {
                return Err(self.words.flaw("a partitioned mesh is not read: save it without partitions"));
            }
            _ if self.words.skip_to(&format!("$End{name}")) => {}
            _ => return Err(self.words.flaw(format!("the file ends before $End{name}: it was cut short"))),
        }
        self.seen.push(name);
        self.end(name)?;
        Ok(true)
    }

    /// Reads numbers as the file has them: bytes begin on the next line.
    fn in_bytes<T>(&mut self, read: impl FnOnce(&mut Self) -> Result<T, Flaw>) -> Result<T, Flaw> {
        if self.binary {
            self.words.end_line()?;
        }
        self.words.binary = self.binary;
        let done = read(self);
        self.words.binary = false;
        done
    }

    fn end(&mut self, section: &str) -> Result<(), Flaw> {
        match self.words.next() {
            Some(word) if word.strip_prefix("$End") == Some(section) => Ok(()),
            Some(word) => {
                let word = short(word);
                Err(self
                    .words
                    .flaw(format!("\"{word}\" where $End{section} should be: the section's counts are wrong")))
            }
            None => Err(self.words.flaw(format!("the file ends before $End{section}: it was cut short"))),
        }
    }

    fn physical_names(&mut self) -> Result<(), Flaw> {
        for _ in 0..self.words.number::<u64>("the number of physical names")? {
            let dimension: u32 = self.words.number("the dimension of a physical group")?;
            let tag: i64 = self.words.number("the tag of a physical group")?;
            let quoted = self.words.rest_of_line()?;
            let name = quoted.strip_prefix('"').and_then(|name| name.strip_suffix('"'));
            let name = name.ok_or_else(|| self.words.flaw("a physical group's name should stand in quotes"))?;
            match dimension {
                2 => _ = self.names.insert(tag, name.to_owned()),
                3 => _ = self.volume_names.insert(tag, name.to_owned()),
                _ => {}
            }
        }
        Ok(())
    }

    fn entities(&mut self) -> Result<(), Flaw> {
        let mut counts = [0u64; 4];
        for count in &mut counts {
            *count = self.words.size("a number of entities")?;
        }
        for (dimension, count) in counts.into_iter().enumerate() {
            for _ in 0..count {
                let tag = self.words.whole("the tag of an entity")?;
                self.words.skip_reals(if dimension == 0 { 3 } else { 6 }, "a coordinate of an entity")?;
                let mut groups = Vec::new();
                for _ in 0..self.words.size("the number of an entity's physical groups")? {
                    groups.push(self.words.whole("the tag of a physical group")?.wrapping_abs());
                }
                if dimension > 0 {
                    for _ in 0..self.words.size("the number of an entity's boundaries")? {
                        self.words.whole("the tag of a boundary")?;
                    }
                }
                groups.sort_unstable();
                groups.dedup();
                match dimension {
                    2 => _ = self.groups_of.insert(tag, groups),
                    3 => _ = self.volume_groups_of.insert(tag, groups),
                    _ => {}
                }
            }
        }
        Ok(())
    }

    fn nodes(&mut self) -> Result<(), Flaw> {
        let (blocks, declared) = self.counts("nodes")?;
        for _ in 0..blocks {
            let dimension = self.words.whole("the dimension of an entity")?;
            self.words.whole("the tag of an entity")?;
            let parametric = self.words.whole("whether the nodes are parametric (0 or 1)")? != 0;
            let count = self.words.size("the number of nodes of an entity")?;
            self.within("nodes", count, declared, self.mesh.points.len())?;
            let first = self.mesh.node_names.len();
            for _ in 0..count {
                let tag = self.words.size("the tag of a node")?;
                self.node(tag)?;
            }
            for node in first..self.mesh.node_names.len() {
                self.place(node)?;
                self.words.skip_reals(
                    if parametric { dimension.clamp(0, 3) as usize } else { 0 },
                    "a parametric coordinate",
                )?;
            }
        }
        self.as_declared("nodes", declared, self.mesh.points.len())
    }

    /// Takes a node's tag.
    fn node(&mut self, tag: u64) -> Result<(), Flaw> {
        if self.node_of.insert(tag, self.mesh.node_names.len() as u32).is_some() {
            return Err(self.words.flaw(format!("node {tag} is there twice")));
        }
        self.mesh.node_names.push(tag);
        Ok(())
    }

    /// Reads where a node is.
    fn place(&mut self, node: usize) -> Result<(), Flaw> {
        let mut point = [0.0; 3];
        for x in &mut point {
            *x = self.words.real("a coordinate")?;
            if !x.is_finite() {
                let tag = self.mesh.node_names[node];
                return Err(self.words.flaw(format!("node {tag} has a coordinate that is not a finite number")));
            }
        }
        self.mesh.points.push(point);
        Ok(())
    }

    fn old_nodes(&mut self) -> Result<(), Flaw> {
        let declared: u64 = self.words.number("the number of nodes")?;
        self.in_bytes(|reader| {
            for node in 0..declared {
                let tag = reader.words.whole("the tag of a node")?;
                reader.node(tag.unsigned_abs())?;
                reader.place(node as usize)?;
            }
            Ok(())
        })
    }

    fn elements(&mut self) -> Result<(), Flaw> {
        let (blocks, declared) = self.counts("elements")?;
        let mut read = 0usize;
        for _ in 0..blocks {
            self.words.whole("the dimension of an entity")?;
            let entity = self.words.whole("the tag of an entity")?;
            let kind = self.words.whole("the type of an element")?;
            let count = self.words.size("the number of elements of an entity")?;
            self.within("elements", count, declared, read)?;
            for _ in 0..count {
                let tag = self.words.size("the tag of an element")?;
                let corners = self.corners(tag, kind, |words| words.size("the tag of a node"))?;
                self.element(entity, tag, kind, &corners)?;
                read += 1;
            }
        }
        self.as_declared("elements", declared, read)
    }

    fn old_elements(&mut self) -> Result<(), Flaw> {
        let declared: u64 = self.words.number("the number of elements")?;
        let elements = self.in_bytes(|reader| reader.collected(declared))?;
        let mut entities: BTreeMap<(bool, Vec<i64>), i64> = BTreeMap::new();
        for OldElement { tag, kind, corners, groups } in elements {
            let flat = matches!(kind, TRIANGLE | QUADRANGLE);
            let next = entities.len() as i64;
            let entity = *entities.entry((flat, groups)).or_insert(next);
            self.element(entity, tag, kind, &corners)?;
        }
        for ((flat, groups), entity) in entities {
            let of = if flat { &mut self.groups_of } else { &mut self.volume_groups_of };
            of.insert(entity, groups);
        }
        Ok(())
    }

    /// Elements of version 2.2: one of the nodes of an earlier one adds to its groups.
    fn collected(&mut self, declared: u64) -> Result<Vec<OldElement>, Flaw> {
        let mut elements: Vec<OldElement> = Vec::new();
        let mut place: BTreeMap<Vec<u32>, usize> = BTreeMap::new();
        let mut read = 0;
        while read < declared {
            // bytes come in blocks of one type
            let mut head = if self.binary { self.old_head(true)? } else { (0, 1, 0) };
            for _ in 0..head.1.min(declared - read) {
                let tag = self.words.whole("the tag of an element")?.unsigned_abs();
                if !self.binary {
                    head = self.old_head(false)?;
                }
                let mut tags = Vec::new();
                for _ in 0..head.2 {
                    tags.push(self.words.whole("a tag of an element")?.wrapping_abs());
                }
                let corners =
                    self.corners(tag, head.0, |words| Ok(words.whole("the tag of a node")?.unsigned_abs()))?;
                read += 1;
                if corners.is_empty() {
                    continue;
                }
                let new = elements.len();
                let at = *place.entry(corners.clone()).or_insert(new);
                if at == new {
                    elements.push(OldElement { tag, kind: head.0, corners, groups: Vec::new() });
                }
                let groups = &mut elements[at].groups;
                groups.extend(tags.first().filter(|tag| **tag != 0));
                groups.sort_unstable();
                groups.dedup();
            }
        }
        Ok(elements)
    }

    /// Type of elements, how many there are, and how many tags each has.
    fn old_head(&mut self, block: bool) -> Result<(i64, u64, u64), Flaw> {
        let kind = self.words.whole("the type of an element")?;
        let count =
            if block { self.words.whole("the number of elements of a block")?.unsigned_abs().max(1) } else { 1 };
        Ok((kind, count, self.words.whole("the number of an element's tags")?.unsigned_abs()))
    }

    /// Nodes of an element that is read; of points and lines none.
    fn corners(
        &mut self,
        element: u64,
        kind: i64,
        tag: impl Fn(&mut Words<'a>) -> Result<u64, Flaw>,
    ) -> Result<Vec<u32>, Flaw> {
        let count = match kind {
            POINT => 1,
            LINE => 2,
            TRIANGLE => 3,
            QUADRANGLE | TETRAHEDRON => 4,
            HEXAHEDRON => 8,
            WEDGE => 6,
            PYRAMID => 5,
            _ => return Err(self.words.flaw(foreign(element, kind))),
        };
        let mut corners = Vec::new();
        for _ in 0..count {
            let tag = tag(&mut self.words)?;
            if matches!(kind, POINT | LINE) {
                continue;
            }
            corners.push(*self.node_of.get(&tag).ok_or_else(|| {
                self.words.flaw(format!("element {element} names node {tag}, which the file doesn't have before it"))
            })?);
        }
        Ok(corners)
    }

    /// An element of a surface or a volume.
    fn element(&mut self, entity: i64, tag: u64, kind: i64, corners: &[u32]) -> Result<(), Flaw> {
        match kind {
            POINT | LINE => {}
            TRIANGLE | QUADRANGLE => {
                self.mesh.add_facet(corners);
                self.patches.entry(entity).or_default().extend(corners);
            }
            _ => {
                let cells = self.mesh.add(tag, corners).map_err(|reason| self.words.flaw(reason))?;
                self.volume_of_cell.extend(std::iter::repeat_n(entity, cells));
            }
        }
        Ok(())
    }

    /// Numbers of blocks and of what is in them; smallest and largest tag are passed over.
    fn counts(&mut self, what: &str) -> Result<(u64, u64), Flaw> {
        let blocks = self.words.size(&format!("the number of blocks of {what}"))?;
        let all = self.words.size(&format!("the number of {what}"))?;
        self.words.size("the smallest tag")?;
        self.words.size("the largest tag")?;
        Ok((blocks, all))
    }

    /// A block has no more than is declared for all of them.
    fn within(&self, what: &str, count: u64, declared: u64, read: usize) -> Result<(), Flaw> {
        if count <= declared.saturating_sub(read as u64) {
            return Ok(());
        }
        Err(self.words.flaw(format!("a block of {count} {what} after {read}, but only {declared} are declared in all")))
    }

    fn as_declared(&self, what: &str, declared: u64, read: usize) -> Result<(), Flaw> {
        if declared == read as u64 {
            return Ok(());
        }
        Err(self.words.flaw(format!("{declared} {what} are declared, but the blocks hold {read}")))
    }

    /// Physical volumes, in the order of their tags, and those that each cell is in: all that its volume is in.
    fn volumes(&self) -> Volumes {
        let meshed: BTreeSet<i64> = self.volume_of_cell.iter().copied().collect();
        let groups = |entity: &i64| self.volume_groups_of.get(entity).map_or(&[][..], Vec::as_slice);
        let tags: BTreeSet<i64> = meshed.iter().flat_map(|entity| groups(entity).iter().copied()).collect();
        let name = |tag: &i64| self.volume_names.get(tag).cloned().unwrap_or_else(|| tag.to_string());
        let mut names: Vec<String> = Vec::new();
        for name in tags.iter().map(name) {
            if !names.contains(&name) {
                names.push(name); // two groups may have one name
            }
        }
        let place = |tag: &i64| names.iter().position(|known| *known == name(tag)).map(|i| i as u32);
        let sets = meshed.iter().map(|entity| groups(entity).iter().filter_map(place).collect()).collect();
        let number: BTreeMap<i64, u32> = meshed.iter().copied().zip(0..).collect();
        let of_cell = self.volume_of_cell.iter().map(|entity| number.get(entity).copied()).collect();
        Volumes { names, sets, of_cell }
    }

    fn finish(mut self, wanted: &[&str]) -> Result<Imported, Flaw> {
        for section in ["Nodes", "Elements"] {
            if !self.seen.contains(&section) {
                return Err(Flaw::of_file(format!("it has no section ${section}: it was cut short, or holds no mesh")));
            }
        }
        if self.mesh.cells.is_empty() {
            self.mesh.remedy = NO_CELLS;
        } else {
            self.mesh.surface.clear();
        }
        if self.mesh.cells.is_empty() && self.mesh.surface.is_empty() {
            return Err(Flaw::of_file(NO_CELLS.trim_start_matches([' ', ';'])));
        }
        let mut known: BTreeMap<String, Vec<i64>> = BTreeMap::new();
        for surface in self.patches.keys() {
            for group in self.groups_of.get(surface).into_iter().flatten() {
                let name = self.names.get(group).cloned().unwrap_or_else(|| group.to_string());
                let surfaces = known.entry(name).or_default();
                if surfaces.last() != Some(surface) {
                    surfaces.push(*surface); // two groups may have one name
                }
            }
        }
        for name in wanted {
            let Some(surfaces) = known.get(*name) else { continue };
            let mut nodes: Vec<u32> = surfaces.iter().flat_map(|s| self.patches[s].iter().copied()).collect();
            nodes.sort_unstable();
            nodes.dedup();
            self.mesh.groups.insert((*name).to_owned(), nodes);
        }
        self.mesh.known_groups = known.into_keys().collect();
        self.mesh.volumes = self.volumes();
        self.mesh.name_by_height(wanted);
        Ok(self.mesh)
    }
}

/// What is said of an element that can't be used.
fn foreign(tag: u64, kind: i64) -> String {
    let name = match kind {
        8 => "a 3-node line",
        9 => "a 6-node triangle",
        10 | 16 => "a quadrangle of second order",
        11 => "a 10-node tetrahedron",
        12 | 17 => "a hexahedron of second order",
        _ => "none of a triangle, quadrangle, tetrahedron, hexahedron, prism and pyramid of first order",
    };
    format!("element {tag} is {name} (Gmsh type {kind}), which is not read: mesh with Mesh.ElementOrder = 1")
}
