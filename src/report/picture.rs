//! A picture as a list of marks, written as SVG or drawn into a PNG. Nothing outside this crate is asked for:
//! the font is our own (`assets/fonts`).

use super::ReportError;
use ab_glyph::{Font as _, FontRef, OutlineCurve, PxScale, ScaleFont as _};
use std::fmt::Write as _;
use tiny_skia::{FillRule, LineCap, LineJoin, Paint, Path, PathBuilder, Pixmap, Stroke, StrokeDash, Transform};

static REGULAR: &[u8] = include_bytes!("../../assets/fonts/Inter-Regular-subset.otf");
static SEMIBOLD: &[u8] = include_bytes!("../../assets/fonts/Inter-SemiBold-subset.otf");

/// What an SVG viewer uses; the PNG is drawn with the first.
const FAMILIES: &str = "Inter, 'Helvetica Neue', Arial, sans-serif";

/// Red, green, blue and opacity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Colour(pub u8, pub u8, pub u8, pub f32);

/// How a line is drawn, px.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pen {
    pub colour: Colour,
    pub width: f32,
    /// Lengths of dash and gap.
    pub dash: Option<[f32; 2]>,
}

impl Pen {
    pub const fn new(colour: Colour, width: f32) -> Self {
        Self { colour, width, dash: None }
    }

    pub const fn dashed(self, dash: [f32; 2]) -> Self {
        Self { dash: Some(dash), ..self }
    }
}

/// Which point of a text lies at its position. Vertically it is always the baseline.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

/// How a text is set, px.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Type {
    pub size: f32,
    pub bold: bool,
    pub colour: Colour,
    pub anchor: Anchor,
}

enum Mark {
    Line { points: Vec<[f64; 2]>, pen: Pen },
    Area { points: Vec<[f64; 2]>, colour: Colour },
    Text { at: [f64; 2], text: String, typ: Type },
}

/// A picture of a size in px, origin at the top left, white ground.
pub(super) struct Picture {
    width: u32,
    height: u32,
    marks: Vec<Mark>,
}

impl Picture {
    pub const fn new(width: u32, height: u32) -> Self {
        Self { width, height, marks: Vec::new() }
    }

    /// A line through the points; broken where a point is not finite.
    pub fn line(&mut self, points: impl IntoIterator<Item = [f64; 2]>, pen: Pen) {
        let mut run = Vec::new();
        for point in points {
            if point.iter().all(|c| c.is_finite()) {
                run.push(point);
            } else {
                self.push_line(std::mem::take(&mut run), pen);
            }
        }
        self.push_line(run, pen);
    }

    fn push_line(&mut self, points: Vec<[f64; 2]>, pen: Pen) {
        if points.len() > 1 {
            self.marks.push(Mark::Line { points, pen });
        }
    }

    /// A filled rectangle between two corners.
    pub fn rectangle(&mut self, [x0, y0]: [f64; 2], [x1, y1]: [f64; 2], colour: Colour) {
        self.marks.push(Mark::Area { points: vec![[x0, y0], [x1, y0], [x1, y1], [x0, y1]], colour });
    }

    /// A filled circle.
    pub fn dot(&mut self, [x, y]: [f64; 2], radius: f64, colour: Colour) {
        let corner = |i: i32| {
            let (sin, cos) = (f64::from(i) * std::f64::consts::TAU / 24.0).sin_cos();
            [x + radius * cos, y + radius * sin]
        };
        self.marks.push(Mark::Area { points: (0..24).map(corner).collect(), colour });
    }

    pub fn text(&mut self, at: [f64; 2], text: impl Into<String>, typ: Type) {
        self.marks.push(Mark::Text { at, text: text.into(), typ });
    }

    /// The picture as an SVG document.
    pub fn to_svg(&self) -> String {
        let (w, h) = (self.width, self.height);
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{w}\" height=\"{h}\" viewBox=\"0 0 {w} {h}\" \
             font-family=\"{FAMILIES}\">\n<rect width=\"{w}\" height=\"{h}\" fill=\"#fff\"/>\n"
        );
        for mark in &self.marks {
            // Writing to a String can't fail.
            let _ = match mark {
                Mark::Line { points, pen } => svg_line(&mut svg, points, *pen),
                Mark::Area { points, colour } => {
                    writeln!(svg, "<polygon points=\"{}\" fill={}/>", svg_points(points), svg_colour(*colour, "fill"))
                }
                Mark::Text { at, text, typ } => svg_text(&mut svg, *at, text, *typ),
            };
        }
        svg.push_str("</svg>\n");
        svg
    }

    /// The picture as a PNG with `scale` pixels per px.
    ///
    /// # Errors
    /// [`ReportError::Picture`] if the picture is too large to be drawn.
    pub fn to_png(&self, file: &'static str, scale: f32) -> Result<Vec<u8>, ReportError> {
        let fail = |reason: String| ReportError::Picture { file, reason };
        let fonts = Fonts::load().map_err(|e| fail(e.to_string()))?;
        let size = |px: u32| (px as f32 * scale).round() as u32;
        let mut pixmap = Pixmap::new(size(self.width), size(self.height))
            .ok_or_else(|| fail(format!("no picture of {} x {} px", self.width, self.height)))?;
        pixmap.fill(tiny_skia::Color::WHITE);
        let transform = Transform::from_scale(scale, scale);
        for mark in &self.marks {
            match mark {
                Mark::Line { points, pen } => {
                    if let Some(path) = path(points, false) {
                        pixmap.stroke_path(&path, &paint(pen.colour), &stroke(*pen), transform, None);
                    }
                }
                Mark::Area { points, colour } => {
                    if let Some(path) = path(points, true) {
                        pixmap.fill_path(&path, &paint(*colour), FillRule::Winding, transform, None);
                    }
                }
                Mark::Text { at, text, typ } => {
                    if let Some(path) = fonts.outline(*at, text, *typ) {
                        pixmap.fill_path(&path, &paint(typ.colour), FillRule::Winding, transform, None);
                    }
                }
            }
        }
        pixmap.encode_png().map_err(|e| fail(e.to_string()))
    }
}

/// The text, cut with an ellipsis if it is wider than `room` px.
pub(super) fn fitted(text: &str, size: f32, room: f64) -> String {
    if text_width(text, size, false) <= room {
        return text.to_owned();
    }
    let mut cut = text.to_owned();
    while cut.pop().is_some() && text_width(&cut, size, false) + f64::from(size) > room {}
    format!("{}…", cut.trim_end())
}

/// Width of a text, px.
pub(super) fn text_width(text: &str, size: f32, bold: bool) -> f64 {
    Fonts::load().map_or(0.0, |fonts| f64::from(fonts.width(text, size, bold)))
}

struct Fonts {
    regular: FontRef<'static>,
    semibold: FontRef<'static>,
}

impl Fonts {
    fn load() -> Result<Self, ab_glyph::InvalidFont> {
        Ok(Self { regular: FontRef::try_from_slice(REGULAR)?, semibold: FontRef::try_from_slice(SEMIBOLD)? })
    }

    const fn face(&self, bold: bool) -> &FontRef<'static> {
        if bold { &self.semibold } else { &self.regular }
    }

    /// ab_glyph's scale is the line height; `size` is the em, as in SVG.
    fn scale(&self, size: f32, bold: bool) -> PxScale {
        let face = self.face(bold);
        PxScale::from(size * face.height_unscaled() / face.units_per_em().unwrap_or(1000.0))
    }

    fn width(&self, text: &str, size: f32, bold: bool) -> f32 {
        let face = self.face(bold).as_scaled(self.scale(size, bold));
        text.chars().map(|c| face.h_advance(face.glyph_id(c))).sum()
    }

    fn outline(&self, at: [f64; 2], text: &str, typ: Type) -> Option<Path> {
        let face = self.face(typ.bold).as_scaled(self.scale(typ.size, typ.bold));
        let shift = match typ.anchor {
            Anchor::Start => 0.0,
            Anchor::Middle => 0.5,
            Anchor::End => 1.0,
        };
        let mut x = at[0] as f32 - shift * self.width(text, typ.size, typ.bold);
        let mut builder = PathBuilder::new();
        let [h, v] = [face.h_scale_factor(), face.v_scale_factor()];
        for c in text.chars() {
            let glyph = face.glyph_id(c);
            if let Some(outline) = face.font.outline(glyph) {
                let place = |p: ab_glyph::Point| [x + h * p.x, at[1] as f32 - v * p.y];
                trace(&mut builder, &outline.curves, place);
            }
            x += face.h_advance(glyph);
        }
        builder.finish()
    }
}

/// Appends a glyph's contours: ab_glyph lists their curves one after another, without marking where one ends.
fn trace(builder: &mut PathBuilder, curves: &[OutlineCurve], place: impl Fn(ab_glyph::Point) -> [f32; 2]) {
    let mut pen = None;
    for curve in curves {
        let (from, to) = match curve {
            OutlineCurve::Line(a, b) | OutlineCurve::Quad(a, _, b) | OutlineCurve::Cubic(a, _, _, b) => (*a, *b),
        };
        if pen != Some(from) {
            let [x, y] = place(from);
            builder.move_to(x, y);
        }
        let [x, y] = place(to);
        match curve {
            OutlineCurve::Line(..) => builder.line_to(x, y),
            OutlineCurve::Quad(_, c, _) => {
                let [cx, cy] = place(*c);
                builder.quad_to(cx, cy, x, y);
            }
            OutlineCurve::Cubic(_, c, d, _) => {
                let ([cx, cy], [dx, dy]) = (place(*c), place(*d));
                builder.cubic_to(cx, cy, dx, dy, x, y);
            }
        }
        pen = Some(to);
    }
}

fn path(points: &[[f64; 2]], closed: bool) -> Option<Path> {
    let mut builder = PathBuilder::new();
    for (i, [x, y]) in points.iter().enumerate() {
        let (x, y) = (*x as f32, *y as f32);
        if i == 0 { builder.move_to(x, y) } else { builder.line_to(x, y) }
    }
    if closed {
        builder.close();
    }
    builder.finish()
}

fn paint(Colour(r, g, b, alpha): Colour) -> Paint<'static> {
    let mut paint = Paint { anti_alias: true, ..Paint::default() };
    paint.set_color_rgba8(r, g, b, (255.0 * alpha).round() as u8);
    paint
}

fn stroke(pen: Pen) -> Stroke {
    Stroke {
        width: pen.width,
        line_cap: if pen.dash.is_some() { LineCap::Butt } else { LineCap::Round },
        line_join: LineJoin::Round,
        dash: pen.dash.and_then(|[on, off]| StrokeDash::new(vec![on, off], 0.0)),
        ..Stroke::default()
    }
}

fn svg_line(svg: &mut String, points: &[[f64; 2]], pen: Pen) -> std::fmt::Result {
    write!(
        svg,
        "<polyline points=\"{}\" fill=\"none\" stroke={} stroke-width=\"{}\" stroke-linejoin=\"round\"",
        svg_points(points),
        svg_colour(pen.colour, "stroke"),
        pen.width
    )?;
    match pen.dash {
        Some([on, off]) => writeln!(svg, " stroke-dasharray=\"{on} {off}\"/>"),
        None => writeln!(svg, " stroke-linecap=\"round\"/>"),
    }
}

fn svg_text(svg: &mut String, [x, y]: [f64; 2], text: &str, typ: Type) -> std::fmt::Result {
    let anchor = match typ.anchor {
        Anchor::Start => "start",
        Anchor::Middle => "middle",
        Anchor::End => "end",
    };
    let weight = if typ.bold { 600 } else { 400 };
    writeln!(
        svg,
        "<text x=\"{x:.2}\" y=\"{y:.2}\" font-size=\"{}\" font-weight=\"{weight}\" text-anchor=\"{anchor}\" \
         fill={}>{}</text>",
        typ.size,
        svg_colour(typ.colour, "fill"),
        escaped(text)
    )
}

fn svg_points(points: &[[f64; 2]]) -> String {
    let mut text = String::with_capacity(14 * points.len());
    for [x, y] in points {
        let _ = write!(text, "{x:.2},{y:.2} ");
    }
    text.truncate(text.trim_end().len());
    text
}

/// The colour as a quoted attribute value, followed by the attribute of its opacity where it has one.
fn svg_colour(Colour(r, g, b, alpha): Colour, attribute: &str) -> String {
    let opaque = format!("\"#{r:02x}{g:02x}{b:02x}\"");
    if alpha < 1.0 { format!("{opaque} {attribute}-opacity=\"{alpha}\"") } else { opaque }
}

/// Text made safe for XML and HTML, in content and in quoted attributes. Control characters, which XML forbids,
/// become spaces.
pub(super) fn escaped(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            '\'' => safe.push_str("&#39;"),
            '\n' => safe.push('\n'),
            c if c.is_control() => safe.push(' '),
            c => safe.push(c),
        }
    }
    safe
}
