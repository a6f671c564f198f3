//! Simple line charts over time, for readers whose browser does not run scripts.

use super::{
    picture::{Anchor, Colour, Pen, Picture, Type},
    plot::{Axis, BLUE, INK, Panel, VERMILION, label, legend},
    thin::thin,
    unit::Scale,
};
use needle_estimate::compare::{Answer, Run};

pub(super) const WIDTH: u32 = 960;
pub(super) const HEIGHT: u32 = 320;
pub(super) const FRAME: [f64; 4] = [84.0, 70.0, 932.0, 262.0];
/// Pens that differ in more than colour.
pub(super) const PENS: [Pen; 6] = [
    Pen::new(BLUE, 2.0),
    Pen::new(VERMILION, 2.0).dashed([8.0, 4.0]),
    Pen::new(Colour(0x1a, 0x7f, 0x4b, 1.0), 2.0).dashed([2.0, 4.0]),
    Pen::new(Colour(0x8b, 0x3f, 0xa8, 1.0), 2.0).dashed([12.0, 3.0]),
    Pen::new(Colour(0x9a, 0x67, 0x00, 1.0), 2.0).dashed([5.0, 2.0]),
    Pen::new(Colour(0x00, 0x79, 0x8c, 1.0), 2.0).dashed([1.0, 3.0]),
];

type Line<'a> = (&'a str, Pen, Vec<[f64; 2]>);

fn chart(title: &str, lines: &[Line]) -> String {
    let mut picture = Picture::new(WIDTH, HEIGHT);
    let points = || lines.iter().flat_map(|(.., points)| points.iter().copied());
    let (x, y) =
        (Axis::holding(points().map(|p| p[0]), 10, 0.0), Axis::holding(points().map(|p| p[1]).chain([0.0]), 5, 0.06));
    let panel = Panel { frame: FRAME, x, y };
    panel.grid(&mut picture, true);
    panel.title(&mut picture, title, 11.0);
    for (_, pen, points) in lines {
        panel.curve(&mut picture, points.iter().copied(), *pen);
    }
    let entries: Vec<(&str, Pen)> = lines.iter().map(|(name, pen, _)| (*name, *pen)).collect();
    legend(&mut picture, [FRAME[0], 24.0], &entries);
    let centre = Type { bold: true, colour: INK, ..label(Anchor::Middle) };
    picture.text([0.5 * (FRAME[0] + FRAME[2]), 304.0], "Time since the first pose in s", centre);
    picture.to_svg()
}

fn column(run: &Run, of: impl Fn(&Answer) -> Option<f64>) -> Vec<[f64; 2]> {
    let answers = thin(run, 500).into_iter().map(|i| &run.answers[i]);
    let point = |a: &Answer| Some([a.time_s, of(a)?]).filter(|p| p.iter().all(|x| x.is_finite()));
    answers.filter_map(point).collect()
}

/// Predicted and measured force.
pub(super) fn force(run: &Run) -> String {
    let scale = Scale::of_force(run);
    let mut lines: Vec<Line> = vec![("predicted", PENS[0], column(run, |a| Some(scale.factor * a.predicted_n)))];
    let measured = column(run, |a| a.measured_n.map(|m| scale.factor * m));
    if !measured.is_empty() {
        lines.push(("measured", Pen::new(INK, 1.4), measured));
    }
    chart(&format!("Force against insertion in {}", scale.unit), &lines)
}

/// Explicit steps of each pose.
pub(super) fn cost(run: &Run) -> String {
    chart("Explicit steps per pose", &[("steps", PENS[0], column(run, |a| Some(f64::from(a.steps))))])
}

/// Distance of each target from its first position.
pub(super) fn targets(run: &Run) -> String {
    let step = run.targets.len().div_ceil(500).max(1);
    let of = |k: usize| -> Vec<[f64; 2]> {
        let Some(start) = run.targets.first().and_then(|row| row.positions.get(k)) else { return Vec::new() };
        let rows = run.targets.iter().step_by(step).filter_map(|row| Some((row.time_s, row.positions.get(k)?)));
        let moved = |p: &[f64; 3]| 1e3 * (0..3).map(|c| (p[c] - start[c]).powi(2)).sum::<f64>().sqrt();
        rows.map(|(t, p)| [t, moved(p)]).filter(|p| p.iter().all(|x| x.is_finite())).collect()
    };
    let names = run.target_names.iter().enumerate();
    let lines: Vec<Line> = names.map(|(k, name)| (name.as_str(), PENS[k % PENS.len()], of(k))).collect();
    chart("Moved from the start by, in mm", &lines)
}
