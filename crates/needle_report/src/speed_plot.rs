//! `speed.png`: cost of an integration point per step over the size of the model, with the bounds of the machine.

use super::{
    picture::{Anchor, Colour, Pen, Picture, Type},
    plot::{Axis, BLUE, INK, Panel, VERMILION, label, legend},
};
use needle_studies::bounds::Bounds;
use needle_studies::speed::Row;

const WIDTH: u32 = 960;
const HEIGHT: u32 = 560;
const SIDES: [f64; 2] = [84.0, 932.0];
const GREY: Colour = Colour(0x77, 0x77, 0x77, 1.0);

/// The plot of all three-dimensional rows; other models are too small for the scale.
pub(super) fn speed_plot(processor: &str, bounds: Bounds, rows: &[Row]) -> Picture {
    let rows: Vec<&Row> = rows.iter().filter(|r| r.points > 5000).collect();
    let mut picture = Picture::new(WIDTH, HEIGHT);
    let title = Type { size: 19.0, bold: true, colour: INK, anchor: Anchor::Start };
    picture.text([SIDES[0], 36.0], "Cost of an integration point per step", title);
    let about =
        format!("{processor}; best of 120 steps. Bars: what reading and computing alone would take one thread.");
    picture.text([SIDES[0], 60.0], about, label(Anchor::Start));
    let entries = [
        ("one thread", Pen::new(BLUE, 6.0)),
        ("more threads", Pen::new(VERMILION, 6.0)),
        ("bound by bytes", Pen::new(INK, 2.0)),
        ("bound by operations", Pen::new(GREY, 2.0)),
    ];
    legend(&mut picture, [SIDES[0], 86.0], &entries);
    let x = Axis::holding(rows.iter().map(|r| 1e-3 * r.points as f64).chain([0.0]), 8, 0.04);
    let y = Axis::holding(rows.iter().map(|r| r.ns_per_point()).chain([0.0]), 6, 0.08);
    let panel = Panel { frame: [SIDES[0], 130.0, SIDES[1], f64::from(HEIGHT) - 60.0], x, y };
    panel.grid(&mut picture, true);
    panel.title(&mut picture, "ns per point and step", 12.0);
    for row in rows {
        let thousand = 1e-3 * row.points as f64;
        if row.case.threads == 1 {
            for (bound, colour) in
                [(1e9 * row.work.bytes / bounds.bytes_per_s, INK), (1e9 * row.work.flops / bounds.flops, GREY)]
            {
                let [x, y] = panel.at(thousand, bound);
                picture.line([[x - 7.0, y], [x + 7.0, y]], Pen::new(colour, 2.0));
            }
        }
        let colour = if row.case.threads == 1 { BLUE } else { VERMILION };
        picture.dot(panel.at(thousand, row.ns_per_point()), 5.0, colour);
    }
    let centre = Type { bold: true, colour: INK, ..label(Anchor::Middle) };
    picture.text([0.5 * (SIDES[0] + SIDES[1]), f64::from(HEIGHT) - 14.0], "Integration points in thousands", centre);
    picture
}
