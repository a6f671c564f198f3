//! `deformation.svg`: the deformation coefficient of a needle with friction over depth, compared with the source
//! paper's.

use super::line_plot::{FRAME, HEIGHT, PENS, WIDTH};
use super::picture::{Anchor, Picture, Type};
use super::plot::{Axis, INK, Panel, label, legend};
use needle_estimate::compare::Run;

/// C_D of the kinematic needle in the source paper.
const PAPER: f64 = 0.4;
/// Number of points of the curve.
const POINTS: usize = 1000;

/// `None` for a run without such a needle.
pub(super) fn deformation_plot(run: &Run) -> Option<Picture> {
    let deepest = run.coefficients.iter().map(|c| c[1]).fold(0.0, f64::max);
    let step = run.coefficients.len().div_ceil(POINTS).max(1);
    let points = || run.coefficients.iter().step_by(step).map(|c| [1e3 * c[1], c[2]]);
    points().next()?;
    let paper = [[0.0, PAPER], [1e3 * deepest, PAPER]];
    let x = Axis::holding(points().chain(paper).map(|p| p[0]), 10, 0.0);
    let y = Axis::holding(points().chain(paper).map(|p| p[1]).chain([0.0, 1.0]), 5, 0.06);
    let mut picture = Picture::new(WIDTH, HEIGHT);
    let panel = Panel { frame: FRAME, x, y };
    panel.grid(&mut picture, true);
    panel.title(
        &mut picture,
        "Deformation coefficient: displacement of the tissue at the shaft over that of the needle",
        11.0,
    );
    panel.curve(&mut picture, points(), PENS[0]);
    panel.curve(&mut picture, paper, PENS[1]);
    legend(&mut picture, [FRAME[0], 24.0], &[("computed from friction", PENS[0]), ("source paper: 0.4", PENS[1])]);
    let centre = Type { bold: true, colour: INK, ..label(Anchor::Middle) };
    picture.text([0.5 * (FRAME[0] + FRAME[2]), 304.0], "Depth in mm", centre);
    Some(picture)
}
