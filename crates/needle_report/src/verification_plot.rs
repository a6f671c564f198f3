//! `verification_SCENE.png`: predicted force and the reference's points over depth, with the relative error below.

use super::{
    picture::Pen,
    picture::{Anchor, Picture, Type},
    plot::{Axis, BLUE, INK, Panel, VERMILION, label, legend},
    regions,
    unit::Scale,
};
use needle_studies::verification::{Compared, Verification};

const WIDTH: u32 = 960;
const HEIGHT: u32 = 660;
const SIDES: [f64; 2] = [84.0, 932.0];
/// Half of a mark's width, px.
const MARK: f64 = 5.0;

/// The plot of one scene.
pub(super) fn verification_plot(verification: &Verification) -> Picture {
    let Verification { scene, run, compared, .. } = verification;
    let mut picture = Picture::new(WIDTH, HEIGHT);
    let title = Type { size: 19.0, bold: true, colour: INK, anchor: Anchor::Start };
    picture.text([SIDES[0], 36.0], format!("{scene}: predicted force against independent finite elements"), title);
    let about = format!("{}, {} nodes, at the preset's own speed.", run.method, run.nodes);
    picture.text([SIDES[0], 60.0], about, label(Anchor::Start));
    legend(&mut picture, [SIDES[0], 86.0], &[("predicted", Pen::new(BLUE, 2.0)), ("reference", Pen::new(INK, 2.0))]);
    let force = Scale::of_force(run);
    let depths = || compared.iter().map(|c| 1e3 * c.depth_m).chain([0.0]);
    let forces = compared.iter().flat_map(|c| [c.predicted_n, c.reference_n]).map(|f| force.factor * f).chain([0.0]);
    let x = Axis::holding(depths(), 10, 0.025);
    let upper = Panel { frame: [SIDES[0], 128.0, SIDES[1], 430.0], x: x.clone(), y: Axis::holding(forces, 6, 0.06) };
    let ground = regions::ground(&run.regions_over_depth());
    upper.ground(&mut picture, &ground);
    upper.grid(&mut picture, false);
    upper.strip(&mut picture, &ground);
    upper.title(&mut picture, &format!("Force in {}", force.unit), 12.0);
    let last = compared.last().map_or(0.0, |c| c.depth_m);
    let shown = run.answers.iter().filter(|a| a.depth_m <= last).step_by(1 + run.answers.len() / 1000);
    upper.curve(&mut picture, shown.map(|a| [1e3 * a.depth_m, force.factor * a.predicted_n]), Pen::new(BLUE, 2.0));
    compared.iter().for_each(|c| cross(&mut picture, &upper, [1e3 * c.depth_m, force.factor * c.reference_n]));
    errors(&mut picture, x, compared);
    let centre = Type { bold: true, colour: INK, ..label(Anchor::Middle) };
    picture.text([0.5 * (SIDES[0] + SIDES[1]), f64::from(HEIGHT) - 14.0], "Depth in mm", centre);
    picture
}

fn errors(picture: &mut Picture, x: Axis, compared: &[Compared]) {
    let errors = || compared.iter().map(|c| [1e3 * c.depth_m, 100.0 * c.error()]);
    let y = Axis::holding(errors().map(|e| e[1]).chain([-1.0, 1.0]), 4, 0.06);
    let lower = Panel { frame: [SIDES[0], 478.0, SIDES[1], f64::from(HEIGHT) - 56.0], x, y };
    lower.grid(picture, true);
    lower.title(picture, "Predicted over reference \u{2212} 1, in %", 11.0);
    lower.curve(picture, errors(), Pen::new(VERMILION, 1.8));
}

/// A small upright cross.
fn cross(picture: &mut Picture, panel: &Panel, [x, y]: [f64; 2]) {
    let [x, y] = panel.at(x, y);
    picture.line([[x - MARK, y], [x + MARK, y]], Pen::new(INK, 2.0));
    picture.line([[x, y - MARK], [x, y + MARK]], Pen::new(INK, 2.0));
}
