//! Gmsh's MSH format, version 4.1, ASCII (Gmsh reference manual, "MSH file format").
//!
//! Read are nodes, tetrahedra, hexahedra, wedges and pyramids of first order, and the physical groups of surfaces by their triangles and
//! quadrangles. Points, lines and sections that no mesh needs are skipped.

use std::collections::BTreeMap;

use super::words::Words;
use super::{Flaw, Imported, Volumes};

/// What to do about a file of another form.
const SAVE_AS: &str = "save it with Mesh.MshFileVersion = 4.1, Mesh.Binary = 0";
/// Gmsh's numbers of the element types that are read or skipped, with their nodes.
const POINT: (u32, usize) = (15, 1);
const LINE: (u32, usize) = (1, 2);
const TRIANGLE: u32 = 2;
const QUADRANGLE: u32 = 3;
const TETRAHEDRON: u32 = 4;
const HEXAHEDRON: u32 = 5;
const WEDGE: u32 = 6;
const PYRAMID: u32 = 7;

/// Reads a file's content.
pub(super) fn read(bytes: &[u8], wanted: &[&str]) -> Result<Imported, Flaw> {
    let (text, broken) = match std::str::from_utf8(bytes) {
        Ok(text) => (text, None),
        Err(e) => (std::str::from_utf8(&bytes[..e.valid_up_to()]).unwrap_or_default(), Some(e.valid_up_to())),
    };
    let mut reader = Reader::new(text);
    reader.format()?; // says first if the file is binary
    if let Some(at) = broken {
        return Err(Flaw::of_file(format!("byte {at} is not UTF-8 text: {SAVE_AS}")));
    }
    while reader.section()? {}
    reader.finish(wanted)
}

struct Reader<'a> {
    words: Words<'a>,
    mesh: Imported,
    /// Node by its tag: tags may be sparse.
    node_of: BTreeMap<u64, u32>,
    /// Names of physical surfaces by their tag.
    names: BTreeMap<i64, String>,
    /// Physical groups of each surface.
    groups_of: BTreeMap<i64, Vec<i64>>,
    /// Names of physical volumes by their tag, the group of each volume, and the volume of each cell.
    volume_names: BTreeMap<i64, String>,
    volume_group_of: BTreeMap<i64, i64>,
    volume_of_cell: Vec<i64>,
    /// Nodes of the triangles and quadrangles of each surface.
    patches: BTreeMap<i64, Vec<u32>>,
    seen: Vec<&'a str>,
}

impl<'a> Reader<'a> {
    fn new(text: &'a str) -> Self {
        Self {
            words: Words::new(text),
            mesh: Imported::default(),
            node_of: BTreeMap::new(),
            names: BTreeMap::new(),
            groups_of: BTreeMap::new(),
            volume_names: BTreeMap::new(),
            volume_group_of: BTreeMap::new(),
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
        let version = self.words.next().unwrap_or_default();
        if version != "4.1" {
            let short: String = version.chars().take(40).collect();
            return Err(self.words.flaw(format!("MSH version \"{short}\" is not read, only 4.1: {SAVE_AS}")));
        }
        if self.words.number::<u32>("the file type (0: ASCII)")? != 0 {
            return Err(self.words.flaw(format!("a binary file is not read: {SAVE_AS}")));
        }
        self.words.skip(1, "the size of a number")?;
        self.end("MeshFormat")
    }

    /// Reads one section; false at the end of the file.
    fn section(&mut self) -> Result<bool, Flaw> {
        let Some(word) = self.words.next() else { return Ok(false) };
        let Some(name) = word.strip_prefix('$') else {
            let short: String = word.chars().take(40).collect();
            return Err(self.words.flaw(format!("\"{short}\" where a section ($Nodes, $Elements ...) should begin")));
        };
        if self.seen.contains(&name) && matches!(name, "Entities" | "Nodes" | "Elements") {
            return Err(self.words.flaw(format!("a second section ${name}: one mesh a file")));
        }
        match name {
            "PhysicalNames" => self.physical_names()?,
            "Entities" => self.entities()?,
            "Nodes" => self.nodes()?,
            "Elements" => self.elements()?,
            "PartitionedEntities" => {
                return Err(self.words.flaw("a partitioned mesh is not read: save it without partitions"));
            }
            _ => return self.skip_section(name).map(|()| true),
        }
        self.seen.push(name);
        self.end(name)?;
        Ok(true)
    }

    fn end(&mut self, section: &str) -> Result<(), Flaw> {
        match self.words.next() {
            Some(word) if word.strip_prefix("$End") == Some(section) => Ok(()),
            Some(word) => {
                let short: String = word.chars().take(40).collect();
                Err(self
                    .words
                    .flaw(format!("\"{short}\" where $End{section} should be: the section's counts are wrong")))
            }
            None => Err(self.words.flaw(format!("the file ends before $End{section}: it was cut short"))),
        }
    }

    fn skip_section(&mut self, name: &str) -> Result<(), Flaw> {
        while let Some(word) = self.words.next() {
            if word.strip_prefix("$End") == Some(name) {
                return Ok(());
            }
        }
        Err(self.words.flaw(format!("the file ends before $End{name}: it was cut short")))
    }

    fn physical_names(&mut self) -> Result<(), Flaw> {
        for _ in 0..self.words.number::<u64>("the number of physical names")? {
            let dimension: u32 = self.words.number("the dimension of a physical group")?;
            let tag: i64 = self.words.number("the tag of a physical group")?;
            let quoted = self.words.rest_of_line();
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
            *count = self.words.number("a number of entities")?;
        }
        for (dimension, count) in counts.into_iter().enumerate() {
            for _ in 0..count {
                let tag: i64 = self.words.number("the tag of an entity")?;
                self.words.skip(if dimension == 0 { 3 } else { 6 }, "a coordinate of an entity")?;
                let mut groups = Vec::new();
                for _ in 0..self.words.number::<u64>("the number of an entity's physical groups")? {
                    groups.push(self.words.number::<i64>("the tag of a physical group")?.wrapping_abs());
                }
                if dimension > 0 {
                    for _ in 0..self.words.number::<u64>("the number of an entity's boundaries")? {
                        self.words.number::<i64>("the tag of a boundary")?;
                    }
                }
                if dimension == 2 {
                    groups.sort_unstable();
                    groups.dedup();
                    self.groups_of.insert(tag, groups);
                } else if let (3, Some(group)) = (dimension, groups.first()) {
                    self.volume_group_of.insert(tag, *group);
                }
            }
        }
        Ok(())
    }

    fn nodes(&mut self) -> Result<(), Flaw> {
        let (blocks, declared) = self.counts("nodes")?;
        for _ in 0..blocks {
            let dimension: usize = self.words.number("the dimension of an entity")?;
            self.words.skip(1, "the tag of an entity")?;
            let parametric = self.words.number::<u32>("whether the nodes are parametric (0 or 1)")? != 0;
            let count: u64 = self.words.number("the number of nodes of an entity")?;
            self.within("nodes", count, declared, self.mesh.points.len())?;
            let first = self.mesh.node_names.len();
            for _ in 0..count {
                let tag = self.words.number("the tag of a node")?;
                let node = self.mesh.node_names.len() as u32;
                if self.node_of.insert(tag, node).is_some() {
                    return Err(self.words.flaw(format!("node {tag} is there twice")));
                }
                self.mesh.node_names.push(tag);
            }
            for node in first..self.mesh.node_names.len() {
                let mut point = [0.0; 3];
                for x in &mut point {
                    *x = self.words.number("a coordinate")?;
                    if !f64::is_finite(*x) {
                        let tag = self.mesh.node_names[node];
                        return Err(self
                            .words
                            .flaw(format!("node {tag} has a coordinate that is not a finite number")));
                    }
                }
                self.mesh.points.push(point);
                self.words.skip(if parametric { dimension.min(3) } else { 0 }, "a parametric coordinate")?;
            }
        }
        self.as_declared("nodes", declared, self.mesh.points.len())
    }

    fn elements(&mut self) -> Result<(), Flaw> {
        let (blocks, declared) = self.counts("elements")?;
        let mut read = 0usize;
        for _ in 0..blocks {
            self.words.skip(1, "the dimension of an entity")?;
            let entity: i64 = self.words.number("the tag of an entity")?;
            let kind: u32 = self.words.number("the type of an element")?;
            let count: u64 = self.words.number("the number of elements of an entity")?;
            self.within("elements", count, declared, read)?;
            for _ in 0..count {
                let tag: u64 = self.words.number("the tag of an element")?;
                match kind {
                    k if k == POINT.0 => self.words.skip(POINT.1, "the tag of a node")?,
                    k if k == LINE.0 => self.words.skip(LINE.1, "the tag of a node")?,
                    TRIANGLE => self.patch::<3>(entity, tag)?,
                    QUADRANGLE => self.patch::<4>(entity, tag)?,
                    TETRAHEDRON => self.cell::<4>(entity, tag)?,
                    HEXAHEDRON => self.cell::<8>(entity, tag)?,
                    WEDGE => self.cell::<6>(entity, tag)?,
                    PYRAMID => self.cell::<5>(entity, tag)?,
                    _ => return Err(self.words.flaw(foreign(tag, kind))),
                }
                read += 1;
            }
        }
        self.as_declared("elements", declared, read)
    }

    /// An element of a surface.
    fn patch<const N: usize>(&mut self, surface: i64, tag: u64) -> Result<(), Flaw> {
        let corners = self.corners::<N>(tag)?;
        self.patches.entry(surface).or_default().extend(corners);
        Ok(())
    }

    /// An element of a volume.
    fn cell<const N: usize>(&mut self, volume: i64, tag: u64) -> Result<(), Flaw> {
        let corners = self.corners::<N>(tag)?;
        let cells = self.mesh.add(tag, &corners).map_err(|reason| self.words.flaw(reason))?;
        self.volume_of_cell.extend(std::iter::repeat_n(volume, cells));
        Ok(())
    }

    /// Numbers of blocks and of what is in them; smallest and largest tag are passed over.
    fn counts(&mut self, what: &str) -> Result<(u64, u64), Flaw> {
        let blocks = self.words.number(&format!("the number of blocks of {what}"))?;
        let all = self.words.number(&format!("the number of {what}"))?;
        self.words.skip(2, "the smallest and largest tag")?;
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

    fn corners<const N: usize>(&mut self, element: u64) -> Result<[u32; N], Flaw> {
        let mut corners = [0; N];
        for corner in &mut corners {
            let tag: u64 = self.words.number("the tag of a node")?;
            *corner = *self.node_of.get(&tag).ok_or_else(|| {
                self.words.flaw(format!("element {element} names node {tag}, which the file doesn't have before it"))
            })?;
        }
        Ok(corners)
    }

    /// Physical volumes, in the order of their tags, and the one of each cell; of several that an entity is in the first.
    fn volumes(&self) -> Volumes {
        let mut tags: Vec<i64> =
            self.volume_of_cell.iter().filter_map(|entity| self.volume_group_of.get(entity).copied()).collect();
        tags.sort_unstable();
        tags.dedup();
        let name = |tag: &i64| self.volume_names.get(tag).cloned().unwrap_or_else(|| tag.to_string());
        let group = |entity: &i64| {
            let tag = self.volume_group_of.get(entity)?;
            tags.binary_search(tag).ok().map(|i| i as u32)
        };
        Volumes { names: tags.iter().map(name).collect(), of_cell: self.volume_of_cell.iter().map(group).collect() }
    }

    fn finish(mut self, wanted: &[&str]) -> Result<Imported, Flaw> {
        for section in ["Nodes", "Elements"] {
            if !self.seen.contains(&section) {
                return Err(Flaw::of_file(format!("it has no section ${section}: it was cut short, or holds no mesh")));
            }
        }
        if self.mesh.cells.is_empty() {
            return Err(Flaw::of_file(
                "it has no tetrahedra and no hexahedra: mesh in 3 dimensions, and name a physical volume as well (or save with \
                 Mesh.SaveAll = 1): Gmsh leaves out what is in no physical group",
            ));
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
        Ok(self.mesh)
    }
}

/// What is said of an element that can't be used.
fn foreign(tag: u64, kind: u32) -> String {
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
