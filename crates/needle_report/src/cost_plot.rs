//! `accuracy_SCENE.png`: largest error of the force against the cost of a pose, both logarithmic, with a mark per
//! row.

use super::{
    cost_marks::{AREA, MARK, legend, mark},
    fonts::text_width,
    picture::{Anchor, Colour, Pen, Picture, Type},
    place::{Box4, place},
    plot::{FRAME, INK, MUTED, RULE, VERMILION, label},
};
use needle_studies::accuracy::{Case, Row, Steps, front, named};
use needle_studies::composites::posed;
use needle_studies::reference::{self, ElementStability};

const WIDTH: u32 = 1160;
const HEIGHT: u32 = 860;
/// Rates of poses whose period is drawn as a line, with the name of the rate.
const RATES: [(f64, &str); 2] = [(100.0, "100 Hz"), (1000.0, "1 kHz")];
const TYPE: f32 = 12.0;
/// Size of the finite elements whose errors are drawn, mm.
const ELEMENT_SIZE_MM: f64 = 0.5;
/// Those finite elements: prefix of their names in the reference, and their names in the plot.
const ELEMENTS: [(&str, &str); 2] = [("P1_", "linear triangles"), ("Q1P0", "hybrid quadrilaterals")];
/// Relative improvement of the error over the last labelled row from which on a row of the front gets a label.
const BETTER: f64 = 0.05;

/// Cost of a pose in ms and largest error of the force in %, for a row that has both.
pub(super) fn place_of(row: &Row) -> Option<[f64; 2]> {
    let place = [1e3 * row.cost_per_pose_s(), 100.0 * row.max_force_error()?];
    place.iter().all(|v| v.is_finite() && *v > 0.0).then_some(place)
}

/// Two logarithmic axes over [`AREA`], in decades.
struct Axes {
    x: [f64; 2],
    y: [f64; 2],
}

impl Axes {
    /// Axes that contain all points and levels, with a margin.
    fn holding(places: &[[f64; 2]], levels: &[Level]) -> Self {
        let range = |values: &mut dyn Iterator<Item = f64>, least: [f64; 2]| {
            let (min, max) = values.map(f64::log10).fold((least[0], least[1]), |(a, b), v| (a.min(v), b.max(v)));
            [min - 0.06 * (max - min), max + 0.06 * (max - min)]
        };
        let errors = places.iter().map(|p| p[1]).chain(levels.iter().map(|l| l.error));
        Self { x: range(&mut places.iter().map(|p| p[0]), [-1.0, 1.2]), y: range(&mut errors.into_iter(), [-0.5, 1.0]) }
    }

    fn at(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [left, top, right, bottom] = AREA;
        let share = |v: f64, [min, max]: [f64; 2]| (v.log10() - min) / (max - min);
        [left + share(x, self.x) * (right - left), bottom - share(y, self.y) * (bottom - top)]
    }
}

/// 1, 2 and 5 times the powers of ten within decades.
fn ticks([min, max]: [f64; 2]) -> impl Iterator<Item = (f64, bool)> {
    let powers = (min.floor() as i32)..=(max.ceil() as i32);
    let all = powers.flat_map(|p| [1.0, 2.0, 5.0].map(|m| (m * 10f64.powi(p), m == 1.0)));
    all.filter(move |(v, _)| (min..=max).contains(&v.log10()))
}

/// The plot of the rows of one scene that are not runs to equilibrium.
pub(super) fn cost_plot(scene: &str, rows: &[&Row]) -> Picture {
    let mut picture = Picture::new(WIDTH, HEIGHT);
    let shown: Vec<&Row> = rows.iter().copied().filter(|r| place_of(r).is_some()).collect();
    let places: Vec<[f64; 2]> = shown.iter().filter_map(|r| place_of(r)).collect();
    let levels = levels_of(scene, &shown);
    let axes = Axes::holding(&places, &levels);
    let points: Vec<[f64; 2]> = places.iter().map(|p| axes.at(*p)).collect();
    heading(&mut picture, scene, rows.len() - shown.len());
    legend(&mut picture);
    grid(&mut picture, &axes);
    let mut taken = real_time(&mut picture, &axes);
    taken.extend(draw_levels(&mut picture, &axes, &levels, &points));
    let fronts = RATES.map(|(hz, _)| front(&shown, hz));
    for ((hz, _), front) in RATES.iter().zip(&fronts) {
        let pen = Pen::new(INK, 1.4);
        let pen = if *hz < 1000.0 { pen.dashed([6.0, 4.0]) } else { pen };
        picture.line(front.iter().map(|&i| axes.at(places[i])), pen);
    }
    shown.iter().zip(&points).for_each(|(row, at)| mark(&mut picture, *at, &row.case));
    let labels: Vec<([f64; 2], String)> =
        labelled(scene, &shown, &fronts).into_iter().map(|(i, text)| (points[i], text)).collect();
    write_labels(&mut picture, &labels, &points, &taken);
    picture
}

/// The reference of the errors, for a scene name.
pub(super) fn against(scene: &str) -> &'static str {
    match reference::force(scene) {
        Some(_) => "independent finite elements",
        None => "independent finite elements where there are any, else the own model on a finer cloud",
    }
}

fn heading(picture: &mut Picture, scene: &str, ended: usize) {
    let title = Type { size: 19.0, bold: true, colour: INK, anchor: Anchor::Start };
    picture.text([AREA[0], 36.0], format!("{scene}: error of the force against cost"), title);
    let about = "A mark per run: method, dimension, spacing, support, points per cell, precision and steps per pose. Error, the largest \
                 from a fifth of the path on,";
    let mut more = format!("against {}. Cost: processor time of one thread.", against(scene));
    if ended > 0 {
        more += &format!(" {ended} runs that ended before their depth are left out.");
    }
    picture.text([AREA[0], 60.0], about, label(Anchor::Start));
    picture.text([AREA[0], 78.0], more, label(Anchor::Start));
}

fn grid(picture: &mut Picture, axes: &Axes) {
    let [left, top, right, bottom] = AREA;
    for (v, whole) in ticks(axes.x) {
        let x = axes.at([v, 1.0])[0];
        picture.line([[x, top], [x, bottom]], Pen::new(if whole { FRAME } else { RULE }, 1.0));
        picture.text([x, bottom + 20.0], v.to_string(), label(Anchor::Middle));
    }
    for (v, whole) in ticks(axes.y) {
        let y = axes.at([1.0, v])[1];
        picture.line([[left, y], [right, y]], Pen::new(if whole { FRAME } else { RULE }, 1.0));
        picture.text([left - 8.0, y + 4.5], v.to_string(), label(Anchor::End));
    }
    let bold = Type { bold: true, colour: INK, ..label(Anchor::Start) };
    picture.text([left, top - 10.0], "Largest error of the force in %", bold);
    let centre = Type { anchor: Anchor::Middle, ..bold };
    picture.text([0.5 * (left + right), bottom + 46.0], "Cost of a pose in ms", centre);
}

/// Vertical lines: left of them a stream of poses is answered in time. Returns the outlines of their labels.
fn real_time(picture: &mut Picture, axes: &Axes) -> Vec<Box4> {
    let mut taken = Vec::new();
    for (hz, name) in RATES {
        let [x, _] = axes.at([1e3 / hz, 1.0]);
        if !(AREA[0]..AREA[2]).contains(&x) {
            continue;
        }
        picture.line([[x, AREA[1]], [x, AREA[3]]], Pen::new(VERMILION, 1.6).dashed([8.0, 4.0]));
        let text = format!("real time at {name}: left of this");
        let width = text_width(&text, TYPE, false);
        let typ = Type { size: TYPE, ..label(Anchor::End) };
        taken.push([x - width - 10.0, AREA[1], x + 2.0, AREA[1] + 22.0]);
        picture.rectangle([x - width - 9.0, AREA[1] + 3.0], [x - 3.0, AREA[1] + 20.0], Colour(255, 255, 255, 0.9));
        picture.text([x - 6.0, AREA[1] + 16.0], text, typ);
    }
    taken
}

/// The error of another solution of the scene, whose cost is not known.
pub(super) struct Level {
    /// Error, %.
    pub error: f64,
    pub text: String,
}

/// The reference's own uncertainty, and the errors of ordinary finite elements.
pub(super) fn levels_of(scene: &str, rows: &[&Row]) -> Vec<Level> {
    let depth = rows.iter().filter_map(|r| r.force_error.last()).map(|p| p.0).fold(0.0, f64::max);
    let own = |u: f64| Level { error: 100.0 * u, text: "the reference's own uncertainty".to_owned() };
    let mut levels: Vec<Level> = reference::uncertainty(scene, depth).map(own).into_iter().collect();
    if scene == "indentation" {
        let level = |e: &ElementStability| {
            let (_, name) = ELEMENTS.iter().find(|(start, _)| e.element.starts_with(start))?;
            let text = format!("{name} of {ELEMENT_SIZE_MM} mm, implicit, at 4 mm");
            let of_size = (e.size_mm - ELEMENT_SIZE_MM).abs() < 1e-9;
            Some(Level { error: 100.0 * e.force_error?.abs(), text }).filter(|_| of_size)
        };
        levels.extend(reference::element_stability().iter().filter_map(level));
    }
    levels
}

/// Draws the levels, with labels as far right as the points allow. Returns the outlines of the labels.
fn draw_levels(picture: &mut Picture, axes: &Axes, levels: &[Level], points: &[[f64; 2]]) -> Vec<Box4> {
    let mut taken = Vec::new();
    for Level { error, text } in levels {
        let [_, y] = axes.at([1.0, *error]);
        picture.line([[AREA[0], y], [AREA[2], y]], Pen::new(MUTED, 1.4).dashed([2.0, 3.0]));
        let width = text_width(text, TYPE, false);
        let outline = |right: f64| [right - width - 8.0, y - 17.0, right, y - 1.0];
        let rights = (0..40).map(|i| AREA[2] - 2.0 - 20.0 * f64::from(i));
        let mut free = rights.filter(|r| !points.iter().any(|p| near(&outline(*r), *p)));
        let right = free.next().unwrap_or(AREA[2] - 2.0);
        let room = outline(right);
        picture.rectangle([room[0], room[1]], [room[2], room[3]], Colour(255, 255, 255, 0.9));
        picture.text([right - 4.0, y - 5.0], text.as_str(), Type { size: TYPE, ..label(Anchor::End) });
        taken.push(room);
    }
    taken
}

/// Whether a point's mark is inside a rectangle or at its edge.
fn near(outline: &Box4, [x, y]: [f64; 2]) -> bool {
    let m = MARK + 2.0;
    (outline[0] - m..outline[2] + m).contains(&x) && (outline[1] - m..outline[3] + m).contains(&y)
}

/// Rows with names: as shipped, and the source paper's setting.
pub(super) fn special(scene: &str, rows: &[&Row]) -> Vec<(usize, &'static str)> {
    let named = posed(scene).ok().and_then(|scene| named(&scene).ok()).unwrap_or_default();
    let found = |(case, name): (Case, _)| Some((rows.iter().position(|row| row.case == case)?, name));
    named.into_iter().filter_map(found).collect()
}

/// Rows with labels, the most important first: those with names, then the Pareto fronts.
fn labelled(scene: &str, rows: &[&Row], fronts: &[Vec<usize>; 2]) -> Vec<(usize, String)> {
    let mut labels: Vec<(usize, String)> =
        special(scene, rows).into_iter().map(|(i, name)| (i, name.to_owned())).collect();
    for front in fronts.iter().rev() {
        let mut last = f64::INFINITY;
        for &i in front {
            let error = rows[i].max_force_error().unwrap_or(f64::INFINITY);
            if error < (1.0 - BETTER) * last {
                last = error;
                if labels.iter().all(|(known, _)| *known != i) {
                    labels.push((i, short(rows[i])));
                }
            }
        }
    }
    labels
}

/// Short description of a row.
fn short(row: &Row) -> String {
    let c = &row.case;
    let mut text = format!("{}, {} nodes", c.method_name(), row.nodes);
    if c.has_hexahedra() {
        text += &format!(", hexahedra of {}", c.points_per_hexahedron);
    } else if c.points_per_cell != 1 {
        text += &format!(", {} points", c.points_per_cell);
    }
    if c.joined() != 1 {
        text += ", pairs";
    }
    if c.is_half() {
        text += ", half";
    }
    if (c.support_factor - 1.8).abs() > 1e-9 && c.method != "tet4" {
        text += &format!(", support {}", c.support_factor);
    }
    match c.steps {
        Steps::Fixed(1) => text + ", 1 step",
        steps => text + &format!(", {steps} steps"),
    }
}

fn write_labels(picture: &mut Picture, labels: &[([f64; 2], String)], points: &[[f64; 2]], taken: &[Box4]) {
    for placed in place(labels, TYPE, &AREA, points, taken) {
        let (point, text) = &labels[placed.index];
        let [left, top, right, bottom] = placed.outline;
        let nearest = [point[0].clamp(left, right), point[1].clamp(top, bottom)];
        picture.line([*point, nearest], Pen::new(MUTED, 0.8));
        picture.rectangle([left, top], [right, bottom], Colour(255, 255, 255, 0.8));
        picture.text(placed.at, text.as_str(), Type { size: TYPE, colour: INK, ..label(Anchor::Start) });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_of_a_logarithmic_axis() {
        let at: Vec<f64> = ticks([-1.05, 0.5]).map(|t| t.0).collect();
        assert_eq!(at.len(), 5, "{at:?}");
        assert!((at[0] - 0.1).abs() < 1e-12 && (at[4] - 2.0).abs() < 1e-12);
    }
}
