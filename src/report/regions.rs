//! Regions in pictures: their colours, their names, and where along the depth the tip is in which.

use super::picture::Colour;
use crate::compare::Run;

/// The sample's own material, then the regions in turn: told apart by colour-blind eyes (Okabe and Ito).
const COLOURS: [[u8; 3]; 9] = [
    [216, 207, 194],
    [230, 159, 0],
    [86, 180, 233],
    [0, 158, 115],
    [204, 121, 167],
    [240, 228, 66],
    [0, 114, 178],
    [213, 94, 0],
    [130, 130, 130],
];

/// Colour of a region by its number.
pub(super) fn colour(region: u8) -> [u8; 3] {
    match region {
        0 => COLOURS[0],
        region => COLOURS[1 + (usize::from(region) - 1) % (COLOURS.len() - 1)],
    }
}

/// The same, so pale that curves and names are read on it.
pub(super) fn tint(region: u8) -> Colour {
    let [r, g, b] = colour(region).map(|c| 255 - (255 - c) / 5 * 2);
    Colour(r, g, b, 1.0)
}

/// A stretch of depths, m, in which the tip is in one region.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Depths {
    pub region: u8,
    pub from: f64,
    pub to: f64,
}

/// Regions over the depth of the insertion; empty where the scene has none.
pub(super) fn over_depth(run: &Run) -> Vec<Depths> {
    let mut found: Vec<Depths> = Vec::new();
    if run.along.names().len() < 2 {
        return found;
    }
    let mut deepest = 0.0;
    for a in &run.answers[..run.legs().hold] {
        let Some(region) = run.along.region(a.depth_m, a.phase).filter(|_| a.depth_m > deepest) else { continue };
        deepest = a.depth_m;
        match found.last_mut() {
            Some(last) if last.region == region => last.to = a.depth_m,
            last => {
                let from = last.map_or(0.0, |last| {
                    last.to = a.depth_m;
                    a.depth_m
                });
                found.push(Depths { region, from, to: a.depth_m });
            }
        }
    }
    found
}

/// Name of a region.
pub(super) fn name(run: &Run, region: u8) -> &str {
    run.along.names().get(usize::from(region)).map_or("", String::as_str)
}
