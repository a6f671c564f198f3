//! The tip's region over the depth.

use super::Run;

/// An interval of depths in which the tip is in one region.
#[derive(Clone, Debug, PartialEq)]
pub struct Depths {
    /// Number of the region; 0 is the sample's own material.
    pub region: u8,
    /// Its name.
    pub name: String,
    /// Depth at its start, m.
    pub from: f64,
    /// Depth at its end, m.
    pub to: f64,
}

impl Run {
    /// Regions over the depth of the insertion; empty if the scene has none.
    #[must_use]
    pub fn regions_over_depth(&self) -> Vec<Depths> {
        let mut found: Vec<Depths> = Vec::new();
        if self.along.names().len() < 2 {
            return found;
        }
        let mut deepest = 0.0;
        for a in &self.answers[..self.legs().hold] {
            let Some(region) = self.along.region(a.depth_m, a.phase).filter(|_| a.depth_m > deepest) else { continue };
            deepest = a.depth_m;
            match found.last_mut() {
                Some(last) if last.region == region => last.to = a.depth_m,
                last => {
                    let from = last.map_or(0.0, |last| {
                        last.to = a.depth_m;
                        a.depth_m
                    });
                    found.push(Depths { region, name: self.along.name_of(region).to_owned(), from, to: a.depth_m });
                }
            }
        }
        found
    }
}
