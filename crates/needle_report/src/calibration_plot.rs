//! `calibration.png` and `.svg`: measured force over depth with the twin's before and after the fit; residual over
//! time.

use super::{
    fonts::fitted,
    picture::{Anchor, Colour, Pen, Picture, Type},
    plot::{Axis, BLUE, End, INK, MUTED, Panel, VERMILION, label, legend},
    regions,
    unit::significant,
};
use needle_estimate::calibrate::Calibration;

const WIDTH: u32 = 960;
const HEIGHT: u32 = 740;
const SIDES: [f64; 2] = [84.0, 932.0];
const MEASURED: Pen = Pen::new(INK, 1.5);
const START: Pen = Pen::new(Colour(0x9a, 0xa4, 0xb1, 1.0), 1.8).dashed([3.0, 4.0]);
const FITTED: Pen = Pen::new(BLUE, 2.2).dashed([8.0, 5.0]);
/// Forces below this are shown in mN.
const SMALL_N: f64 = 0.2;
/// Number of drawn points per curve.
const DRAWN: usize = 1500;

/// The plot of a calibration.
pub(super) fn calibration_plot(calibration: &Calibration, source: &str) -> Picture {
    let mut picture = Picture::new(WIDTH, HEIGHT);
    let f = &calibration.forces;
    let peak = f.measured_n.iter().map(|f| f.abs()).fold(0.0, f64::max);
    let (factor, unit) = if peak < SMALL_N { (1e3, "mN") } else { (1.0, "N") };
    heading(&mut picture, calibration, source, factor, unit);
    legend(
        &mut picture,
        [SIDES[0], 132.0],
        &[("measured", MEASURED), ("twin at the start", START), ("twin, fitted (with the load cell's offset)", FITTED)],
    );
    let step = 1 + f.time_s.len() / DRAWN;
    let points = |x: &[f64], by: f64, y: &[f64]| -> Vec<[f64; 2]> {
        x.iter().zip(y).step_by(step).map(|(x, y)| [by * x, factor * y]).collect()
    };
    let forces = [&f.measured_n, &f.start_n, &f.fitted_n];
    let y = Axis::holding(forces.iter().flat_map(|v| v.iter().map(|f| factor * f)).chain([0.0]), 6, 0.06);
    let x = Axis::holding(f.depth_m.iter().map(|d| 1e3 * d).chain([0.0]), 10, 0.025);
    let upper = Panel { frame: [SIDES[0], 176.0, SIDES[1], 440.0], x, y };
    let ground = regions::ground(&calibration.regions);
    upper.ground(&mut picture, &ground);
    upper.grid(&mut picture, true);
    upper.strip(&mut picture, &ground);
    upper.title(&mut picture, &format!("Force against insertion in {unit}, over depth in mm"), 11.0);
    for (force, pen) in forces.into_iter().zip([MEASURED, START, FITTED]) {
        upper.curve(&mut picture, points(&f.depth_m, 1e3, force), pen);
    }
    if let Some(held) = &calibration.parts.held_out
        && let Some(depth) = f.depth_m.get(held.start)
    {
        upper.event(&mut picture, 1e3 * depth, "fitted up to here, predicted from here", End::Upper);
    }
    let left: Vec<f64> = f.fitted_n.iter().zip(&f.measured_n).map(|(a, b)| a - b).collect();
    let y = Axis::holding(left.iter().map(|e| factor * e).chain([0.0]), 4, 0.06);
    let x = Axis::holding(f.time_s.iter().copied().chain([0.0]), 10, 0.0);
    let lower = Panel { frame: [SIDES[0], 510.0, SIDES[1], 676.0], x, y };
    lower.grid(&mut picture, true);
    lower.title(&mut picture, &format!("Residual: fitted − measured in {unit}, over time"), 11.0);
    lower.curve(&mut picture, points(&f.time_s, 1.0, &left), Pen::new(VERMILION, 1.2));
    let centre = Type { bold: true, colour: INK, ..label(Anchor::Middle) };
    picture.text([0.5 * (SIDES[0] + SIDES[1]), f64::from(HEIGHT) - 16.0], "Time since the first pose in s", centre);
    picture
}

fn heading(picture: &mut Picture, calibration: &Calibration, source: &str, factor: f64, unit: &str) {
    let room = SIDES[1] - SIDES[0];
    let title = Type { size: 19.0, bold: true, colour: INK, anchor: Anchor::Start };
    picture.text([SIDES[0], 36.0], fitted(&format!("{}: calibration", calibration.scene.name), title, room), title);
    let one = |e: &needle_estimate::calibrate::Estimate| {
        let error = e.standard_error().map_or_else(|| "not determined".to_owned(), |s| significant(s, 2));
        format!("{} = {} ± {error}", e.name, significant(e.value, 5))
    };
    let keys: Vec<String> = calibration.estimates[..calibration.keys].iter().map(one).collect();
    let rmse = significant(factor * calibration.rmse_n(), 3);
    let predicted = calibration
        .held_out_rmse_n()
        .map_or_else(String::new, |e| format!("; of the part that was held out {} {unit}", significant(factor * e, 3)));
    let lines = [
        format!("{} (one standard error)", keys.join(", ")),
        format!("Root mean square of the residual {rmse} {unit}{predicted}. {} runs of the twin", calibration.runs),
        format!("Measured force: {source}"),
    ];
    for (y, line) in [60.0, 80.0, 100.0].into_iter().zip(lines) {
        let typ = Type { colour: MUTED, ..label(Anchor::Start) };
        picture.text([SIDES[0], y], fitted(&line, typ, room), typ);
    }
}
