//! Messages of OpenIGTLink, header version 1 ([protocol](http://openigtlink.org/developers/spec)). All numbers are big-endian.
//!
//! ```text
//! header, 58 bytes: version u16, type 12 bytes, device 20 bytes, stamp u64 (seconds in 2^-32), bytes of the body u64,
//!                   CRC-64 of the body u64 (ECMA-182: x^64 + ..., 0x42f0e1eba9ea3693, not reflected, from 0)
//! ```

use std::sync::Arc;

use crc::{CRC_64_ECMA_182, Crc};

/// A message including its header.
pub(super) type Packet = Arc<[u8]>;

const CRC: Crc<u64> = Crc::<u64>::new(&CRC_64_ECMA_182);
const VERSION: u16 = 1;
const MM: f64 = 1e3;
/// Size of the name of a point, of its group, and of the image that owns it, bytes.
const NAME: usize = 64;
const GROUP: usize = 32;
const OWNER: usize = 20;
/// Colour of a target (red, green, blue, opacity), and its diameter, mm.
const COLOUR: [u8; 4] = [255, 170, 0, 255];
const DIAMETER: f32 = 1.0;

/// Pose of the instrument.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Instrument {
    /// Stamp of the pose, ns.
    pub stamp_nanos: i64,
    /// Tip in frame `sample`, m.
    pub tip: [f64; 3],
    /// Unit vector along the instrument, into the sample.
    pub axis: [f64; 3],
}

/// A body with its header. Names that are too long are truncated.
pub(super) fn packet(kind: &str, device: &str, stamp_nanos: i64, body: &[u8]) -> Packet {
    let mut bytes = Vec::with_capacity(58 + body.len());
    bytes.extend(VERSION.to_be_bytes());
    bytes.extend(fixed::<12>(kind));
    bytes.extend(fixed::<20>(device));
    bytes.extend(stamp(stamp_nanos).to_be_bytes());
    bytes.extend((body.len() as u64).to_be_bytes());
    bytes.extend(CRC.checksum(body).to_be_bytes());
    bytes.extend_from_slice(body);
    bytes.into()
}

/// Text of a fixed size, padded with zeros; at least one zero terminates it.
fn fixed<const N: usize>(text: &str) -> [u8; N] {
    let mut bytes = [0; N];
    for (place, byte) in bytes.iter_mut().take(N - 1).zip(text.bytes()) {
        *place = byte;
    }
    bytes
}

/// Seconds in the upper 32 bits, their fraction in the lower. Times before 1970 give 0.
fn stamp(nanos: i64) -> u64 {
    const SECOND: u64 = 1_000_000_000;
    let nanos = u64::try_from(nanos).unwrap_or(0);
    ((nanos / SECOND) << 32) | (((nanos % SECOND) << 32) / SECOND)
}

fn millimetres(metres: [f64; 3]) -> impl Iterator<Item = u8> {
    metres.into_iter().flat_map(|x| ((MM * x) as f32).to_be_bytes())
}

/// TRANSFORM: the columns of the rotation, then the tip. The third column points along the instrument into the
/// sample. Slicer's module Create Models draws needles in the same way: the tip is at the origin and points to +z.
pub(super) fn transform(at: &Instrument) -> Vec<u8> {
    let columns = frame(at.axis);
    let rotation = columns.into_iter().flatten().flat_map(|x| (x as f32).to_be_bytes());
    rotation.chain(millimetres(at.tip)).collect()
}

/// A right-handed frame whose third axis is a given unit vector. Its first axis is as close to x as possible, or to y
/// if the third axis is x.
fn frame(axis: [f64; 3]) -> [[f64; 3]; 3] {
    let near = if axis[0].abs() < 0.9 { 0 } else { 1 };
    let across: [f64; 3] = std::array::from_fn(|k| f64::from(u8::from(k == near)) - axis[near] * axis[k]);
    let length = across.iter().map(|x| x * x).sum::<f64>().sqrt();
    let [x, a] = [across.map(|x| x / length), axis];
    let y = [a[1] * x[2] - a[2] * x[1], a[2] * x[0] - a[0] * x[2], a[0] * x[1] - a[1] * x[0]];
    [x, y, a]
}

/// The surface of a sample: its points and triangles.
#[derive(Debug, Default)]
pub(super) struct Surface {
    /// Index and undeformed position of each point, m.
    points: Vec<(usize, [f64; 3])>,
    /// Encoded triangles: the number of corners and the corners of each.
    polygons: Vec<u8>,
}

impl Surface {
    /// Takes triangles among points; triangles with invalid indices are left out.
    pub(crate) fn new(points: &[[f64; 3]], triangles: &[[u32; 3]]) -> Self {
        let mut number = vec![None; points.len()];
        let mut surface = Self::default();
        let there = |corner: &u32| usize::try_from(*corner).is_ok_and(|i| i < points.len());
        for triangle in triangles.iter().filter(|triangle| triangle.iter().all(there)) {
            surface.polygons.extend(3_u32.to_be_bytes());
            for corner in triangle.map(|i| i as usize) {
                let own = *number[corner].get_or_insert_with(|| {
                    surface.points.push((corner, points[corner]));
                    surface.points.len() as u32 - 1
                });
                surface.polygons.extend(own.to_be_bytes());
            }
        }
        surface
    }

    /// POLYDATA: number of points; number of cells and of their bytes for vertices, lines, polygons and strips;
    /// number of attributes; the points; the polygons; the displacement of each point, mm, as a scalar.
    /// `displacements` are those of all points, m.
    pub(crate) fn message(&self, displacements: &[[f64; 3]]) -> Vec<u8> {
        let (points, bytes) = (self.points.len() as u32, self.polygons.len() as u32);
        let head = [points, 0, 0, 0, 0, bytes / 16, bytes, 0, 0, 1];
        let mut body: Vec<u8> = head.iter().flat_map(|n| n.to_be_bytes()).collect();
        let moved = |i: usize| displacements.get(i).copied().unwrap_or_default();
        let at = |(i, x): &(usize, [f64; 3])| std::array::from_fn(|k| x[k] + moved(*i)[k]);
        body.extend(self.points.iter().flat_map(|point| millimetres(at(point))));
        body.extend_from_slice(&self.polygons);
        attribute(&mut body, "displacement (mm)", self.points.iter().map(|(i, _)| MM * norm(moved(*i))));
        body
    }
}

/// One scalar for each point: type 0, one component, their number; the name, padded to an even number of bytes; the
/// numbers.
fn attribute(body: &mut Vec<u8>, name: &str, values: impl ExactSizeIterator<Item = f64>) {
    body.extend([0, 1]);
    body.extend((values.len() as u32).to_be_bytes());
    body.extend_from_slice(name.as_bytes());
    body.resize(body.len() + 2 - name.len() % 2, 0);
    body.extend(values.flat_map(|x| (x as f32).to_be_bytes()));
}

fn norm([x, y, z]: [f64; 3]) -> f64 {
    (x * x + y * y + z * z).sqrt()
}

/// POINT: name, group, colour, position, diameter and owner of each.
pub(super) fn points(names: &[String], places: &[[f64; 3]]) -> Vec<u8> {
    let one = |(name, place): (&String, &[f64; 3])| {
        let mut bytes = fixed::<NAME>(name).to_vec();
        bytes.extend(fixed::<GROUP>("targets"));
        bytes.extend(COLOUR);
        bytes.extend(millimetres(*place));
        bytes.extend(DIAMETER.to_be_bytes());
        bytes.extend([0; OWNER]);
        bytes
    };
    names.iter().zip(places).flat_map(one).collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn floats(bytes: &[u8]) -> Vec<f32> {
        bytes.chunks_exact(4).map(|b| f32::from_be_bytes(b.try_into().unwrap())).collect()
    }

    #[test]
    fn the_header_says_type_device_stamp_length_and_checksum() {
        // the published check value of this polynomial
        assert_eq!(CRC.checksum(b"123456789"), 0x6c40_df5f_0b49_7347);
        let packet = packet("TRANSFORM", "NeedleToSample", 1_500_000_000, b"123456789");
        assert_eq!((&packet[..2], &packet[2..11], packet[11]), (&[0, 1][..], &b"TRANSFORM"[..], 0));
        assert_eq!(&packet[14..28], b"NeedleToSample");
        assert_eq!(packet[34..42], (3_u64 << 31).to_be_bytes());
        assert_eq!(packet[42..50], 9_u64.to_be_bytes());
        assert_eq!((&packet[50..58], &packet[58..]), (&0x6c40_df5f_0b49_7347_u64.to_be_bytes()[..], &b"123456789"[..]));
    }

    #[test]
    fn the_third_column_lies_along_the_instrument() {
        for axis in [[0.0, 0.0, -1.0], [0.6, 0.0, -0.8], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] {
            let at = Instrument { stamp_nanos: 0, tip: [1e-3, 0.0, 0.017], axis };
            let matrix = floats(&transform(&at));
            assert_eq!(&matrix[9..], &[1.0, 0.0, 17.0]);
            let columns: Vec<&[f32]> = matrix[..9].chunks(3).collect();
            let dot = |i: usize, j: usize| (0..3).map(|k| columns[i][k] * columns[j][k]).sum::<f32>();
            for (i, j) in [(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0)] {
                assert!((dot(i, j) - f32::from(u8::from(i == j))).abs() < 1e-6, "{matrix:?}");
            }
            let [x, y, z] = [columns[0], columns[1], columns[2]];
            let triple = (0..3).map(|k| z[k] * (x[(k + 1) % 3] * y[(k + 2) % 3] - x[(k + 2) % 3] * y[(k + 1) % 3]));
            assert!((triple.sum::<f32>() - 1.0).abs() < 1e-6, "right-handed");
            assert!((0..3).all(|k| (z[k] - axis[k] as f32).abs() < 1e-7));
        }
    }

    #[test]
    fn a_surface_has_its_own_points_only() {
        let points = [[9.0; 3], [0.0; 3], [1e-3, 0.0, 0.0], [0.0, 1e-3, 0.0]];
        let surface = Surface::new(&points, &[[1, 2, 3], [3, 2, 1], [1, 2, 7]]);
        let moved = [[0.0; 3], [0.0; 3], [0.0, 0.0, -2e-3], [0.0; 3]];
        let body = surface.message(&moved);
        let word = |i: usize| u32::from_be_bytes(body[4 * i..4 * i + 4].try_into().unwrap());
        let head: Vec<u32> = (0..10).map(word).collect();
        assert_eq!(head, [3, 0, 0, 0, 0, 2, 32, 0, 0, 1]);
        assert_eq!(floats(&body[40..76]), [0.0, 0.0, 0.0, 1.0, 0.0, -2.0, 0.0, 1.0, 0.0]);
        let corners: Vec<u32> = (19..27).map(word).collect();
        assert_eq!(corners, [3, 0, 1, 2, 3, 2, 1, 0]);
        assert_eq!(&body[108..114], &[0, 1, 0, 0, 0, 3]);
        assert_eq!(&body[114..132], b"displacement (mm)\0");
        assert_eq!(floats(&body[132..]), [0.0, 2.0, 0.0]);
    }

    #[test]
    fn targets_are_points_with_names() {
        let body = points(&["tumour".to_owned()], &[[1e-3, 2e-3, 3e-3]]);
        assert_eq!(body.len(), 136);
        assert_eq!((&body[..7], &body[64..71]), (&b"tumour\0"[..], &b"targets"[..]));
        assert_eq!(floats(&body[100..116]), [1.0, 2.0, 3.0, 1.0]);
    }
}
