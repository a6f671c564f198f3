//! Places labels next to their points such that none covers another label or a point.

use super::fonts::text_width;

/// A rectangle: left, top, right, bottom, px.
pub(super) type Box4 = [f64; 4];

/// A label that was placed.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Placed {
    /// Index of the label.
    pub index: usize,
    /// Left end of the baseline.
    pub at: [f64; 2],
    /// Its outline.
    pub outline: Box4,
}

/// Clear distance around a label, px.
const CLEAR: f64 = 2.0;
/// Half of a point's width, px.
const POINT: f64 = 6.0;
/// Distances from the point that are tried, px, the smallest first.
const DISTANCES: [f64; 7] = [9.0, 16.0, 26.0, 40.0, 58.0, 80.0, 110.0];
/// Directions that are tried.
const DIRECTIONS: [[f64; 2]; 12] = [
    [1.0, 0.0],
    [-1.0, 0.0],
    [0.8, -0.7],
    [0.8, 0.7],
    [-0.8, -0.7],
    [-0.8, 0.7],
    [0.0, -1.0],
    [0.0, 1.0],
    [0.4, -1.0],
    [0.4, 1.0],
    [-0.4, -1.0],
    [-0.4, 1.0],
];

fn overlap(a: &Box4, b: &Box4) -> bool {
    a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3]
}

/// Places labels (point, text) of a type size in order of importance, within a frame, clear of all `points` and of
/// the `taken` rectangles. A label without room is left out.
pub(super) fn place(
    labels: &[([f64; 2], String)],
    size: f32,
    frame: &Box4,
    points: &[[f64; 2]],
    taken: &[Box4],
) -> Vec<Placed> {
    let mut placed: Vec<Placed> = Vec::new();
    let (ascent, descent) = (0.78 * f64::from(size), 0.24 * f64::from(size));
    for (index, ([x, y], text)) in labels.iter().enumerate() {
        let (width, height) = (text_width(text, size, false), ascent + descent);
        let candidate = |distance: f64, [dx, dy]: [f64; 2]| {
            // the nearest edge or corner of the label is in that direction
            let centre = [x + dx * distance + 0.5 * width * dx.signum() * f64::from(dx != 0.0), y + dy * distance];
            let [left, top] = [centre[0] - 0.5 * width, centre[1] - 0.5 * height];
            ([left, top + ascent], [left - CLEAR, top - CLEAR, left + width + CLEAR, top + height + CLEAR])
        };
        let free = |outline: &Box4| {
            let inside =
                outline[0] > frame[0] && outline[1] > frame[1] && outline[2] < frame[2] && outline[3] < frame[3];
            let covers = |p: &[f64; 2]| overlap(outline, &[p[0] - POINT, p[1] - POINT, p[0] + POINT, p[1] + POINT]);
            inside
                && !points.iter().any(covers)
                && !taken.iter().any(|t| overlap(outline, t))
                && !placed.iter().any(|p| overlap(outline, &p.outline))
        };
        let all = DISTANCES.iter().flat_map(|d| DIRECTIONS.iter().map(move |direction| (*d, *direction)));
        let found = all.map(|(d, direction)| candidate(d, direction)).find(|(_, outline)| free(outline));
        placed.extend(found.map(|(at, outline)| Placed { index, at, outline }));
    }
    placed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_of_a_crowd_cover_neither_each_other_nor_a_point() {
        let frame = [0.0, 0.0, 600.0, 400.0];
        let points: Vec<[f64; 2]> =
            (0..60).map(|i| [300.0 + 37.0 * f64::from(i % 7), 60.0 + 5.0 * f64::from(i)]).collect();
        let labels: Vec<_> = points.iter().map(|p| (*p, "a label of some length".to_owned())).collect();
        let placed = place(&labels, 12.0, &frame, &points, &[[0.0, 0.0, 100.0, 400.0]]);
        assert!((10..60).contains(&placed.len()), "{} labels", placed.len());
        for (i, a) in placed.iter().enumerate() {
            assert!(a.outline[0] >= 100.0 && a.outline[2] <= 600.0);
            assert!(placed[..i].iter().all(|b| !overlap(&a.outline, &b.outline)), "two labels overlap");
            let covered = |p: &&[f64; 2]| {
                (a.outline[0]..a.outline[2]).contains(&p[0]) && (a.outline[1]..a.outline[3]).contains(&p[1])
            };
            assert_eq!(points.iter().find(covered), None, "a point is covered");
        }
    }
}
