//! Stereolithography files (.stl), as text and in bytes: the closed surface of a body, without cells.
//!
//! Corners that are the same point are one node. A text may have several solids, whose names are groups.

use std::collections::BTreeMap;

use super::imported::{Flaw, Imported};
use super::words::{Words, short};

/// Bytes before the triangles, and of a triangle.
const HEAD: usize = 84;
const TRIANGLE: usize = 50;

/// Reads a file's content.
pub(super) fn read(bytes: &[u8], wanted: &[&str]) -> Result<Imported, Flaw> {
    let mut surface = Surface::default();
    match count(bytes) {
        Some(count) => surface.bytes(&bytes[HEAD..], count)?,
        None => surface.text(bytes)?,
    }
    surface.finish(wanted)
}

/// Number of triangles of a file in bytes, which is as long as they ask for; a text may begin like one.
fn count(bytes: &[u8]) -> Option<usize> {
    let count = u32::from_le_bytes(*bytes.get(80..)?.first_chunk()?) as usize;
    let begins_as_text = bytes.starts_with(b"solid");
    let whole = HEAD.checked_add(count.checked_mul(TRIANGLE)?)? == bytes.len();
    (whole || !begins_as_text).then_some(count)
}

#[derive(Default)]
struct Surface {
    mesh: Imported,
    node_of: BTreeMap<[u64; 3], u32>,
    /// Nodes of each named solid.
    solids: BTreeMap<String, Vec<u32>>,
}

impl Surface {
    fn bytes(&mut self, bytes: &[u8], count: usize) -> Result<(), Flaw> {
        let (triangles, rest) = bytes.as_chunks::<TRIANGLE>();
        if triangles.len() != count || !rest.is_empty() {
            let held = triangles.len();
            return Err(Flaw::of_file(format!(
                "{count} triangles are declared, and it has bytes for {held}: not an STL, or cut short"
            )));
        }
        for triangle in triangles {
            let (numbers, _) = triangle[12..48].as_chunks::<4>();
            let real = |i: usize| f64::from(f32::from_le_bytes(numbers[i]));
            let corners: [[f64; 3]; 3] = std::array::from_fn(|k| [3 * k, 3 * k + 1, 3 * k + 2].map(real));
            if corners.iter().flatten().any(|x| !x.is_finite()) {
                return Err(Flaw::of_file("a corner is not a finite number"));
            }
            self.add(corners, "");
        }
        Ok(())
    }

    fn text(&mut self, bytes: &[u8]) -> Result<(), Flaw> {
        let mut words = Words::new(bytes);
        while let Some(word) = words.next() {
            if word != "solid" {
                return Err(words.flaw(format!("\"{}\" where \"solid\" should be: not an STL", short(word))));
            }
            let name = words.rest_of_line()?.to_owned();
            loop {
                match words.next() {
                    Some("facet") => self.facet(&mut words, &name)?,
                    Some("endsolid") => break,
                    Some(word) => return Err(words.flaw(format!("\"{}\" where a facet should be", short(word)))),
                    None => return Err(words.flaw("the file ends before \"endsolid\": it was cut short")),
                }
            }
            words.rest_of_line()?;
        }
        Ok(())
    }

    fn facet(&mut self, words: &mut Words<'_>, name: &str) -> Result<(), Flaw> {
        expect(words, &["normal"])?;
        words.skip_reals(3, "a normal")?;
        expect(words, &["outer", "loop"])?;
        let mut corners = [[0.0; 3]; 3];
        for corner in &mut corners {
            expect(words, &["vertex"])?;
            for x in corner {
                *x = words.real("a coordinate")?;
                if !x.is_finite() {
                    return Err(words.flaw("a coordinate that is not a finite number"));
                }
            }
        }
        expect(words, &["endloop", "endfacet"])?;
        self.add(corners, name);
        Ok(())
    }

    fn add(&mut self, corners: [[f64; 3]; 3], name: &str) {
        let mesh = &mut self.mesh;
        let t = corners.map(|p| {
            // 0.0 and -0.0 are one place
            *self.node_of.entry(p.map(|x| (x + 0.0).to_bits())).or_insert_with(|| {
                mesh.node_names.push(mesh.points.len() as u64);
                mesh.points.push(p);
                mesh.points.len() as u32 - 1
            })
        });
        if t[0] != t[1] && t[1] != t[2] && t[2] != t[0] {
            mesh.surface.push(t);
            if !name.is_empty() {
                self.solids.entry(name.to_owned()).or_default().extend(t);
            }
        }
    }

    fn finish(mut self, wanted: &[&str]) -> Result<Imported, Flaw> {
        if self.mesh.surface.is_empty() {
            return Err(Flaw::of_file("it has no triangle with an area"));
        }
        for (name, mut nodes) in self.solids {
            nodes.sort_unstable();
            nodes.dedup();
            self.mesh.known_groups.push(name.clone());
            if wanted.contains(&name.as_str()) {
                self.mesh.groups.insert(name, nodes);
            }
        }
        self.mesh.name_by_height(wanted);
        Ok(self.mesh)
    }
}

fn expect(words: &mut Words<'_>, expected: &[&str]) -> Result<(), Flaw> {
    for wanted in expected {
        let word = words.next();
        if word != Some(wanted) {
            let found = word.map_or("the end of the file".to_owned(), |word| format!("\"{}\"", short(word)));
            return Err(words.flaw(format!("{found} where \"{wanted}\" should be: not an STL, or cut short")));
        }
    }
    Ok(())
}
