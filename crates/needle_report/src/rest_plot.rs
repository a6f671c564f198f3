//! `at_rest_SCENE.png`: relative error of the force over depth in equilibrium, with a line per discretisation.

use super::{
    cost_plot::against,
    picture::{Anchor, Colour, Pen, Picture, Type},
    plot::{Axis, BLUE, INK, Panel, VERMILION, label},
};
use needle_studies::accuracy::{Row, refined};

const WIDTH: u32 = 960;
const SIDES: [f64; 2] = [84.0, 932.0];
/// Larger errors are outside the plot, %.
const WIDEST: f64 = 40.0;
const LEGEND_TOP: f64 = 84.0;
const LINE: f64 = 20.0;

/// Colour by method; width and dash by cloud, with the widest line for the finest.
fn pen(row: &Row, rows: &[&Row]) -> Pen {
    let colour = match refined(&row.case).as_str() {
        "mmls" => BLUE,
        "mls" => VERMILION,
        "tet4" => INK,
        "mmls, averaged" => Colour(0x1b, 0x8a, 0x5a, 1.0),
        "mmls, no cure" => Colour(0x8a, 0x4f, 0xc7, 1.0),
        _ => Colour(0x9a, 0x7b, 0x00, 1.0),
    };
    let same = rows.iter().filter(|r| refined(&r.case) == refined(&row.case));
    match same.filter(|r| r.nodes > row.nodes).count() {
        0 => Pen::new(colour, 2.4),
        1 => Pen::new(colour, 1.6).dashed([8.0, 5.0]),
        _ => Pen::new(colour, 1.2).dashed([2.0, 3.0]),
    }
}

/// The plot of the rows of one scene.
pub(super) fn rest_plot(scene: &str, rows: &[&Row]) -> Picture {
    let lines = rows.len().div_ceil(3);
    let top = LEGEND_TOP + LINE * lines as f64 + 34.0;
    let bottom = top + 380.0;
    let mut picture = Picture::new(WIDTH, (bottom + 60.0) as u32);
    let title = Type { size: 19.0, bold: true, colour: INK, anchor: Anchor::Start };
    picture.text([SIDES[0], 36.0], format!("{scene}: error of the force at rest"), title);
    picture.text(
        [SIDES[0], 60.0],
        format!(
            "Predicted over reference - 1; reference: {}. Dotted: coarse, dashed: medium, full: finest.",
            against(scene)
        ),
        label(Anchor::Start),
    );
    for (i, row) in rows.iter().enumerate() {
        let (x, y) = (SIDES[0] + 285.0 * (i % 3) as f64, LEGEND_TOP + LINE * (i / 3) as f64);
        picture.line([[x, y - 4.5], [x + 26.0, y - 4.5]], pen(row, rows));
        let text = format!("{}, {} nodes", refined(&row.case), row.nodes);
        picture.text([x + 33.0, y], text, Type { colour: INK, ..label(Anchor::Start) });
    }
    let points = |row: &Row| -> Vec<[f64; 2]> {
        let shown = row.force_error.iter().filter(|(_, e)| (100.0 * e).abs() <= WIDEST);
        shown.map(|(depth, e)| [1e3 * depth, 100.0 * e]).collect()
    };
    let all: Vec<[f64; 2]> = rows.iter().flat_map(|r| points(r)).collect();
    let x = Axis::holding(all.iter().map(|p| p[0]).chain([0.0]), 10, 0.025);
    let y = Axis::holding(all.iter().map(|p| p[1]).chain([0.0]), 8, 0.06);
    let panel = Panel { frame: [SIDES[0], top, SIDES[1], bottom], x, y };
    panel.grid(&mut picture, true);
    panel.title(&mut picture, "Error of the force in %", 12.0);
    for row in rows {
        panel.curve(&mut picture, points(row), pen(row, rows));
    }
    let centre = Type { bold: true, colour: INK, ..label(Anchor::Middle) };
    picture.text([0.5 * (SIDES[0] + SIDES[1]), bottom + 44.0], "Depth in mm", centre);
    picture
}
