//! `stability.png`: largest depth of each method, a row per method and a column per change; finite elements below.

use super::{
    picture::{Anchor, Colour, Picture, Type},
    plot::{INK, label},
};
use needle_studies::{
    reference::{self, ElementStability},
    stability::{CHANGES, DEEPEST_M, METHODS, Row},
};

const LEFT: f64 = 150.0;
const TOP: f64 = 150.0;
/// Size of a cell of the map, px.
const CELL: [f64; 2] = [74.0, 46.0];
/// Gap between two groups of columns, px.
const GAP: f64 = 10.0;
const SMALL: f32 = 11.0;

/// The map.
pub(super) fn stability_map(rows: &[Row]) -> Picture {
    let width = LEFT + columns().last().map_or(0.0, |c| c.1) + CELL[0] + 24.0;
    let elements = reference::element_stability();
    let mut names: Vec<&str> = elements.iter().map(|e| e.element.as_str()).collect();
    names.dedup();
    names.sort_unstable();
    names.dedup();
    let second = TOP + CELL[1] * METHODS.len() as f64 + 96.0;
    let height = second + CELL[1] * names.len() as f64 + 40.0;
    let mut picture = Picture::new(width as u32, height as u32);
    heading(&mut picture);
    methods(&mut picture, rows);
    finite_elements(&mut picture, second, &names, &elements);
    picture
}

fn heading(picture: &mut Picture) {
    let title = Type { size: 19.0, bold: true, colour: INK, anchor: Anchor::Start };
    picture.text([24.0, 36.0], "Indentation: the depth at which each method ends, in mm", title);
    let about = format!(
        "Bold: furthest depth of {:.0} mm. Below it the error of the force at 4 mm (before, if it ended there) and why it ended.",
        1e3 * DEEPEST_M
    );
    picture.text([24.0, 60.0], about, label(Anchor::Start));
    picture.text([24.0, 80.0], "One property is changed at a time; an empty cell was not run.", label(Anchor::Start));
}

/// Left edge of each column, px from [`LEFT`].
fn columns() -> Vec<(usize, f64)> {
    let mut x = 0.0;
    let place = |i: usize| {
        if i > 0 {
            x += CELL[0] + if CHANGES[i].group == CHANGES[i - 1].group { 0.0 } else { GAP };
        }
        (i, x)
    };
    (0..CHANGES.len()).map(place).collect()
}

fn methods(picture: &mut Picture, rows: &[Row]) {
    for (i, x) in columns() {
        let change = &CHANGES[i];
        let centre = LEFT + x + 0.5 * CELL[0];
        picture.text([centre, TOP - 8.0], change.label, label(Anchor::Middle));
        if i == 0 || CHANGES[i - 1].group != change.group {
            let typ = Type { bold: true, colour: INK, ..label(Anchor::Start) };
            picture.text([LEFT + x, TOP - 28.0], change.group, typ);
        }
        for (j, method) in METHODS.iter().enumerate() {
            let is = |r: &&Row| r.method == method.name && r.group == change.group && r.label == change.label;
            if let Some(row) = rows.iter().find(is) {
                cell(picture, [LEFT + x, TOP + CELL[1] * j as f64], row.depth_m / DEEPEST_M, &texts(row));
            }
        }
    }
    for (j, method) in METHODS.iter().enumerate() {
        let y = TOP + CELL[1] * (j as f64 + 0.5) + 5.0;
        picture.text([LEFT - 10.0, y], method.name, Type { colour: INK, ..label(Anchor::End) });
    }
}

fn texts(row: &Row) -> [String; 3] {
    let error = row.force_error.map_or_else(String::new, |e| format!("{:+.1} %", 100.0 * e).replace('-', "\u{2212}"));
    let why = match row.ended.as_str() {
        "reached" => String::new(),
        "singular moment matrix" => "singular".to_owned(),
        other => other.to_owned(),
    };
    [format!("{:.1}", 1e3 * row.depth_m), error, why]
}

/// A coloured cell: its depth in bold, with two lines below.
fn cell(picture: &mut Picture, [x, y]: [f64; 2], share: f64, [depth, error, why]: &[String; 3]) {
    picture.rectangle([x + 1.0, y + 1.0], [x + CELL[0] - 1.0, y + CELL[1] - 1.0], shade(share));
    let colour = if share > 0.55 { Colour(255, 255, 255, 1.0) } else { INK };
    let typ = Type { size: SMALL, bold: false, colour, anchor: Anchor::Middle };
    let middle = x + 0.5 * CELL[0];
    picture.text([middle, y + 15.0], depth, Type { bold: true, size: 13.0, ..typ });
    picture.text([middle, y + 28.0], error, typ);
    picture.text([middle, y + 40.0], why, typ);
}

/// From pale orange for zero depth to dark blue for the full depth; distinguishable in grey print by lightness.
fn shade(share: f64) -> Colour {
    let s = share.clamp(0.0, 1.0);
    let mix = |from: f64, to: f64| (from + s * (to - from)) as u8;
    Colour(mix(254.0, 16.0), mix(220.0, 70.0), mix(178.0, 140.0), 1.0)
}

fn finite_elements(picture: &mut Picture, top: f64, names: &[&str], elements: &[ElementStability]) {
    let bold = Type { bold: true, colour: INK, ..label(Anchor::Start) };
    picture.text(
        [24.0, top - 40.0],
        "Finite elements with Newton's method, driven to 10 mm, by size in mm (reference)",
        bold,
    );
    let mut sizes: Vec<f64> = elements.iter().map(|e| e.size_mm).collect();
    sizes.sort_by(|a, b| b.total_cmp(a));
    sizes.dedup();
    // the names are longer than those of the methods
    let left = LEFT + 130.0;
    for (i, size) in sizes.iter().enumerate() {
        let x = left + CELL[0] * i as f64;
        picture.text([x + 0.5 * CELL[0], top - 8.0], size.to_string(), label(Anchor::Middle));
        for (j, name) in names.iter().enumerate() {
            if let Some(e) = elements.iter().find(|e| e.element == *name && e.size_mm == *size) {
                let error =
                    e.force_error.map_or_else(String::new, |e| format!("{:+.1} %", 100.0 * e).replace('-', "\u{2212}"));
                let texts = [format!("{:.1}", 1e3 * e.depth_m), error, if e.reached { "" } else { "ended" }.to_owned()];
                cell(picture, [x, top + CELL[1] * j as f64], e.depth_m / DEEPEST_M, &texts);
            }
        }
    }
    for (j, name) in names.iter().enumerate() {
        let y = top + CELL[1] * (j as f64 + 0.5) + 5.0;
        picture.text([left - 10.0, y], *name, Type { size: 12.0, colour: INK, ..label(Anchor::End) });
    }
}
