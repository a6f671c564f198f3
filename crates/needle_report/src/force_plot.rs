//! `force.png` and `force.svg`: predicted and measured force over depth, with the residual below.

use super::{
    fonts::{fitted, text_width},
    phases::over_depth,
    picture::{Anchor, Colour, Pen, Picture, Type},
    plot::{Axis, BLUE, End, INK, Panel, VERMILION, label, legend},
    regions,
    thin::thin,
    unit::{Scale, significant},
};
use needle_core::twin::Event;
use needle_estimate::compare::{Answer, Pass, Run};
use std::ops::Range;

const WIDTH: u32 = 960;
const HEIGHT: u32 = 692;
/// Left, right edge of the panels, px.
const SIDES: [f64; 2] = [84.0, 932.0];

/// Insertion and retraction of the first pass, then of the others.
const MEASURED: [[Pen; 2]; 2] = [
    [Pen::new(INK, 1.5), Pen::new(Colour(0xa3, 0xab, 0xb6, 1.0), 1.5)],
    [Pen::new(Colour(0x8a, 0x5a, 0x2b, 1.0), 1.5), Pen::new(Colour(0xcd, 0xaf, 0x8c, 1.0), 1.5)],
];
const PREDICTED: [[Pen; 2]; 2] = [
    [Pen::new(BLUE, 2.4), Pen::new(Colour(0x5a, 0x9d, 0xe6, 1.0), 2.4).dashed([8.0, 5.0])],
    [
        Pen::new(Colour(0x1a, 0x7f, 0x4b, 1.0), 2.4).dashed([12.0, 3.0]),
        Pen::new(Colour(0x6f, 0xb8, 0x8f, 1.0), 2.4).dashed([3.0, 3.0]),
    ],
];
/// Fill between the ends of the ensemble's band.
const FAN: Colour = Colour(0x0b, 0x62, 0xc4, 0.2);
const RESIDUAL: [[Pen; 2]; 2] = [
    [Pen::new(VERMILION, 1.5), Pen::new(Colour(0xea, 0xa2, 0x77, 1.0), 1.5)],
    [Pen::new(Colour(0x8b, 0x3f, 0xa8, 1.0), 1.5), Pen::new(Colour(0xc5, 0x9c, 0xd3, 1.0), 1.5)],
];

/// The pen of a pass.
const fn pen(of: &[[Pen; 2]; 2], pass: &Pass) -> Pen {
    of[if pass.number == 0 { 0 } else { 1 }][pass.back as usize]
}

/// The plot of a run.
pub(super) fn force_plot(run: &Run) -> Picture {
    let mut picture = Picture::new(WIDTH, HEIGHT);
    heading(&mut picture, run);
    let kept = thin(run, 500);
    let answers: Vec<&Answer> = kept.iter().map(|&i| &run.answers[i]).collect();
    let at = |answer: usize| kept.partition_point(|&i| i < answer);
    // a pass starts with the last answer before the turn, so that the curve has no gap
    let range = |pass: &Pass| at(pass.range.start).saturating_sub(1)..at(pass.range.end);
    let ways: Vec<(Pass, Range<usize>)> = run.passes().into_iter().map(|pass| (pass.clone(), range(&pass))).collect();
    let measured = answers.iter().any(|a| a.residual_n().is_some());

    let force = Scale::of_force(run);
    let x = Axis::holding(answers.iter().map(|a| 1e3 * a.depth_m).chain([0.0]), 10, 0.025);
    let forces = answers.iter().flat_map(|a| [Some(a.predicted_n), a.measured_n]).flatten().map(|f| force.factor * f);
    let band = |&i: &usize| run.shown_band(i).unwrap_or([f64::NAN; 2]);
    let bands = kept.iter().flat_map(band).map(|f| force.factor * f);
    let y = Axis::holding(forces.chain(bands).chain([0.0]), 6, 0.06);
    let bottom = if measured { 470.0 } else { 636.0 };
    let upper = Panel { frame: [SIDES[0], 172.0, SIDES[1], bottom], x: x.clone(), y };
    let ground = regions::ground(&run.regions_over_depth());
    upper.ground(&mut picture, &ground);
    upper.grid(&mut picture, !measured);
    upper.strip(&mut picture, &ground);
    upper.title(&mut picture, &format!("Force against insertion in {}", force.unit), 26.0);
    let stretches = over_depth(run);
    upper.ribbon(&mut picture, stretches.iter().map(|s| (1e3 * s.from, 1e3 * s.to, s.word, tint(s.word))));
    if let Some((depth_m, duration_s)) = run.hold() {
        upper.event(&mut picture, 1e3 * depth_m, &format!("held for {} s", significant(duration_s, 2)), End::Lower);
    }
    for (_, range) in &ways {
        fan(&mut picture, &upper, run, &kept[range.clone()], force.factor);
    }
    for (pass, range) in &ways {
        let way = &answers[range.clone()];
        upper.curve(&mut picture, column(way, |a| a.measured_n, force.factor), pen(&MEASURED, pass));
        upper.curve(&mut picture, column(way, |a| Some(a.predicted_n), force.factor), pen(&PREDICTED, pass));
    }
    punctures(&mut picture, &upper, run, force.factor);
    if measured {
        let residuals = answers.iter().filter_map(|a| a.residual_n()).map(|e| force.factor * e);
        let y = Axis::holding(residuals.chain([0.0]), 3, 0.06);
        let lower = Panel { frame: [SIDES[0], 520.0, SIDES[1], 636.0], x, y };
        lower.ground(&mut picture, &ground);
        lower.grid(&mut picture, true);
        lower.strip(&mut picture, &ground);
        lower.title(&mut picture, &format!("Predicted − measured in {}", force.unit), 11.0);
        for (pass, range) in &ways {
            let residual = column(&answers[range.clone()], Answer::residual_n, force.factor);
            lower.curve(&mut picture, residual, pen(&RESIDUAL, pass));
        }
    }
    let centre = 0.5 * (SIDES[0] + SIDES[1]);
    picture.text(
        [centre, 676.0],
        "Depth of the tip below the undeformed surface in mm",
        Type { bold: true, colour: INK, ..label(Anchor::Middle) },
    );
    let passes: Vec<Pass> = ways.into_iter().map(|(pass, _)| pass).collect();
    let entries = entries(&passes, measured, run.band_name());
    let entries: Vec<(&str, Pen)> = entries.iter().map(|(text, pen)| (text.as_str(), *pen)).collect();
    // more do not fit beside each other; with several insertions, predicted and measured curves have a row each
    let row = if entries.len() > 4 { entries.len().div_ceil(2) } else { entries.len() };
    for (entries, y) in entries.chunks(row.max(1)).zip([114.0, 130.0]) {
        legend(&mut picture, [SIDES[0], y], entries);
    }
    picture
}

/// Value pairs of a leg in which both numbers exist. If answers lack the number, as with a load cell slower than the
/// poses, the line bridges a short gap. A long gap (2% of the leg's time) interrupts it.
fn column(leg: &[&Answer], of: impl Fn(&Answer) -> Option<f64>, factor: f64) -> Vec<[f64; 2]> {
    let long = leg.last().map_or(0.0, |last| 0.02 * (last.time_s - leg[0].time_s));
    let mut points = Vec::with_capacity(leg.len());
    let (mut last_s, mut lacking) = (f64::NEG_INFINITY, false);
    for a in leg {
        let Some(force) = of(a).filter(|f| f.is_finite()) else {
            lacking = true;
            continue;
        };
        if lacking && a.time_s - last_s > long {
            points.push([f64::NAN; 2]);
        }
        points.push([1e3 * a.depth_m, factor * force]);
        (last_s, lacking) = (a.time_s, false);
    }
    points
}

/// Fills the area between the band's ends over a leg.
fn fan(picture: &mut Picture, panel: &Panel, run: &Run, leg: &[usize], factor: f64) {
    let ends = leg.iter().filter_map(|&i| Some((1e3 * run.answers[i].depth_m, run.shown_band(i)?)));
    let ends: Vec<_> = ends.map(|(x, band)| band.map(|f| panel.at(x, factor * f))).collect();
    if ends.len() > 1 {
        picture.area(ends.iter().map(|e| e[0]).chain(ends.iter().rev().map(|e| e[1])), FAN);
    }
}

fn entries(passes: &[Pass], measured: bool, band: &str) -> Vec<(String, Pen)> {
    let mut entries = vec![(band.to_owned(), Pen { width: 9.0, ..Pen::new(FAN, 1.0) })];
    for (what, pens) in [("predicted", &PREDICTED), ("measured", &MEASURED)].into_iter().take(1 + usize::from(measured))
    {
        // all passes after the first insertion share their pens
        let shown = passes.iter().filter(|pass| pass.number < 2);
        entries.extend(shown.map(|pass| (format!("{what}, {}", way(pass, passes)), pen(pens, pass))));
    }
    entries
}

/// Name of a pass.
pub(super) fn way(pass: &Pass, passes: &[Pass]) -> String {
    let word = if pass.back { "retraction" } else { "insertion" };
    let most = passes.iter().map(|pass| pass.number).max().unwrap_or(0);
    match (pass.number, most) {
        (0, 0) => word.to_owned(),
        (0, _) => format!("first {word}"),
        (_, 1) => format!("second {word}"),
        _ => format!("later {word}s"),
    }
}

fn heading(picture: &mut Picture, run: &Run) {
    let title = Type { size: 19.0, bold: true, colour: INK, anchor: Anchor::Start };
    let room = SIDES[1] - SIDES[0];
    let mark = Type { size: 12.0, ..label(Anchor::End) };
    let own = identity(run);
    picture.text([SIDES[1], 36.0], own.clone(), mark);
    let room_left = room - text_width(&own, mark.size, mark.bold) - 16.0;
    picture.text([SIDES[0], 36.0], fitted(&format!("{}: force over depth", run.scene), title, room_left), title);
    let force = Scale::of_force(run);
    let m = run.force_metrics();
    let mut line = format!("{}, {} nodes", run.method, run.nodes);
    if let (Some(rmse), Some(nrmse), Some(max)) = (m.rmse_n, m.nrmse, m.max_abs_error_n) {
        line += &format!(
            ". RMSE {} {unit} ({} % of the measured peak), largest error {} {unit}",
            significant(force.factor * rmse, 3),
            significant(100.0 * nrmse, 2),
            significant(force.factor * max, 3),
            unit = force.unit,
        );
    }
    let source = match run.measured_source.as_str() {
        "" => "No measured force: a prediction alone".to_owned(),
        source => format!("Measured force: {source}"),
    };
    let typ = label(Anchor::Start);
    let (first, second) = broken(&source, typ, room);
    for (y, text) in [(60.0, line.as_str()), (78.0, first), (95.0, second)] {
        picture.text([SIDES[0], y], fitted(text, typ, room), typ);
    }
}

/// Identification of the run: command, and the checksum in `metrics.json`.
fn identity(run: &Run) -> String {
    let short: String = run.checksum.chars().take(12).collect();
    [run.command.as_str(), short.as_str()]
        .into_iter()
        .filter(|word| !word.is_empty())
        .collect::<Vec<_>>()
        .join(", run ")
}

/// A text in two lines if it is wider than `room` px, split at the last space for which the first line fits.
fn broken(text: &str, typ: Type, room: f64) -> (&str, &str) {
    let fits = |at: &usize| text_width(&text[..*at], typ.size, typ.bold) <= room;
    if fits(&text.len()) {
        return (text, "");
    }
    // names may be arbitrarily long: beyond two lines they are truncated anyway
    let spaces = text.char_indices().take(400).filter(|(_, c)| *c == ' ').map(|(at, _)| at);
    match spaces.filter(fits).last() {
        Some(at) => (&text[..at], &text[at + 1..]),
        None => (text, ""),
    }
}

/// Background of a phase's name.
fn tint(phase: &str) -> Colour {
    match phase {
        "indentation" => Colour(0xd9, 0xe7, 0xf8, 1.0),
        "penetration" => Colour(0xfb, 0xe3, 0xd6, 1.0),
        "retraction" => Colour(0xe6, 0xe0, 0xf6, 1.0),
        _ => Colour(0xe8, 0xeb, 0xef, 1.0),
    }
}

/// Marks each puncture by a line and by a dot on the predicted curve.
fn punctures(picture: &mut Picture, panel: &Panel, run: &Run, factor: f64) {
    for a in &run.answers {
        let Some(Event::Puncture { depth_m, .. }) = a.event else { continue };
        if depth_m.is_finite() && a.predicted_n.is_finite() {
            let depth = 1e3 * depth_m;
            panel.event(picture, depth, &format!("puncture at {depth:.3} mm"), End::Upper);
            picture.dot(panel.at(depth, factor * a.predicted_n), 4.5, BLUE);
        }
    }
}
