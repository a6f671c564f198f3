//! Regions in plots: their colours, and backgrounds over the depth.

use super::picture::Colour;
use needle_estimate::compare::Depths;

/// The sample's own material, then the regions in turn; distinguishable by colour-blind readers (Okabe and Ito).
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
pub fn colour(region: u8) -> [u8; 3] {
    match region {
        0 => COLOURS[0],
        region => COLOURS[1 + (usize::from(region) - 1) % (COLOURS.len() - 1)],
    }
}

/// The same in a pale tint on which curves and names are legible.
fn tint(region: u8) -> Colour {
    let [r, g, b] = colour(region).map(|c| 255 - (255 - c) / 5 * 2);
    Colour(r, g, b, 1.0)
}

/// Intervals in the format of a panel over millimetres.
pub(super) fn ground(depths: &[Depths]) -> Vec<(f64, f64, String, Colour)> {
    depths.iter().map(|d| (1e3 * d.from, 1e3 * d.to, d.name.clone(), tint(d.region))).collect()
}
