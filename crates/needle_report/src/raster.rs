//! Renders a picture to PNG.

use super::{
    ReportError,
    fonts::Fonts,
    picture::{Anchor, Colour, Mark, Pen, Picture, Type},
};
use ab_glyph::{Font as _, OutlineCurve, ScaleFont as _};
use tiny_skia::{FillRule, LineCap, LineJoin, Paint, Path, PathBuilder, Pixmap, Stroke, StrokeDash, Transform};

impl Picture {
    /// The picture as a PNG with `scale` pixels per px.
    ///
    /// # Errors
    /// [`ReportError::Picture`] if the picture is too large to be drawn.
    pub(crate) fn to_png(&self, file: &'static str, scale: f32) -> Result<Vec<u8>, ReportError> {
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

impl Fonts {
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

/// Appends a glyph's contours. ab_glyph lists their curves one after another, without marking the end of a contour.
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
