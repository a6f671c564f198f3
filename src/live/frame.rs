//! Binary encoding of the sample for viewers: positions and triangles once, then displacements in 16-bit steps.
//!
//! Little-endian. A model has, in this order:
//!
//! - the words 1, bytes of JSON, points, triangles and cells (u32 each);
//! - the JSON, padded to a multiple of four with spaces;
//! - x, y, z of each point as f32;
//! - the indices as u32;
//! - if it has `regions`, that of each cell as a byte.
//!
//! A frame has, in this order:
//!
//! - the word 2;
//! - depth of the tip, tip (x, y, z) and axis (x, y, z) as f32;
//! - x, y, z of each target as f32;
//! - displacements in steps of the model's `unit_m`, x, y, z of each point as i16.

use axum::body::Bytes;
use serde_json::{Value, json};

/// First word of each kind.
const MODEL: u32 = 1;
const FRAME: u32 = 2;
/// Steps of a 16-bit number on either side of zero.
const STEPS: f64 = 32_767.0;

/// The constant data of a sample.
#[derive(Clone, Copy, Debug)]
pub struct Model<'a> {
    /// Undeformed positions, m.
    pub points: &'a [[f64; 3]],
    /// Outward triangles.
    pub surface: &'a [[u32; 3]],
    /// Tetrahedra, for sections.
    pub cells: &'a [[u32; 4]],
    /// Region of each cell as an index into the `regions` of `about`, which have a name and a colour; empty: one
    /// region.
    pub region: &'a [u8],
    /// Further data for the page, as a JSON object.
    pub about: &'a Value,
}

/// The sample at one time; lengths in m.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    /// Depth of the tip.
    pub depth_m: f64,
    /// Position of the tip.
    pub tip: [f64; 3],
    /// Direction of the instrument into the sample.
    pub axis: [f64; 3],
    /// Positions of the targets.
    pub targets: &'a [[f64; 3]],
    /// Displacement of each point.
    pub displacements: &'a [[f64; 3]],
}

/// Size of one step, m, such that the sample's largest extent is the largest displacement.
pub(super) fn unit_m(points: &[[f64; 3]]) -> f64 {
    let extent = |k: usize| {
        let (low, high) =
            points.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), p| (low.min(p[k]), high.max(p[k])));
        high - low
    };
    let largest = (0..3).map(extent).fold(0.0, f64::max);
    if largest > 0.0 && largest.is_finite() { largest / STEPS } else { 1.0 / STEPS }
}

impl Model<'_> {
    /// Encodes with the given step size.
    pub(super) fn encode(&self, unit_m: f64) -> Bytes {
        let mut about = self.about.clone();
        about["unit_m"] = json!(unit_m);
        let mut text = about.to_string();
        while !text.len().is_multiple_of(4) {
            text.push(' ');
        }
        let counts = [text.len(), self.points.len(), self.surface.len(), self.cells.len()];
        let mut bytes = MODEL.to_le_bytes().to_vec();
        bytes.extend(counts.iter().flat_map(|n| u32::try_from(*n).unwrap_or(u32::MAX).to_le_bytes()));
        bytes.extend_from_slice(text.as_bytes());
        bytes.extend(self.points.iter().flatten().flat_map(|x| (*x as f32).to_le_bytes()));
        let indices = self.surface.iter().flatten().chain(self.cells.iter().flatten());
        bytes.extend(indices.flat_map(|i| i.to_le_bytes()));
        bytes.extend_from_slice(self.region);
        Bytes::from(bytes)
    }
}

impl Frame<'_> {
    /// Encodes with the given step size.
    pub(super) fn encode(&self, unit_m: f64) -> Bytes {
        let floats = [self.depth_m].into_iter().chain(self.tip).chain(self.axis);
        let floats = floats.chain(self.targets.iter().flatten().copied());
        let mut bytes = Vec::with_capacity(32 + 12 * self.targets.len() + 6 * self.displacements.len());
        bytes.extend(FRAME.to_le_bytes());
        bytes.extend(floats.flat_map(|x| (x as f32).to_le_bytes()));
        let step = |u: &f64| (u / unit_m).round().clamp(-STEPS, STEPS) as i16;
        bytes.extend(self.displacements.iter().flatten().flat_map(|u| step(u).to_le_bytes()));
        Bytes::from(bytes)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn what_is_sent_can_be_read_again() {
        let points = [[0.0, 0.0, 0.0], [0.03, 0.0, 0.017]];
        let unit = unit_m(&points);
        assert_eq!(unit, 0.03 / STEPS);
        let about = json!({ "scene": "x" });
        let model =
            Model { points: &points, surface: &[[0, 1, 0]], cells: &[[0, 1, 0, 1]], region: &[7], about: &about };
        let model = model.encode(unit);
        let word = |i: usize| u32::from_le_bytes(model[4 * i..4 * i + 4].try_into().unwrap()) as usize;
        assert_eq!([word(0), word(2), word(3), word(4)], [1, 2, 1, 1]);
        let text: Value = serde_json::from_slice(&model[20..20 + word(1)]).unwrap();
        assert_eq!((&text["scene"], text["unit_m"].as_f64()), (&json!("x"), Some(unit)));
        assert_eq!(model.len(), 20 + word(1) + 4 * (6 + 3 + 4) + 1);
        assert_eq!(model.last(), Some(&7));

        let (axis, targets) = ([0.0, 0.0, -1.0], [[1.0; 3]]);
        let displacements = [[0.0, -0.001, 1.0], [f64::MIN, 0.0, 0.5 * unit]];
        let frame = Frame { depth_m: 0.001, tip: [0.0; 3], axis, targets: &targets, displacements: &displacements }
            .encode(unit);
        let steps: Vec<i16> = frame[44..].chunks_exact(2).map(|b| i16::from_le_bytes([b[0], b[1]])).collect();
        assert_eq!(steps, [0, -1092, 32_767, -32_767, 0, 1]);
    }
}
