//! A picture as an SVG document. Text stays text, so that it can be searched and edited.

use super::picture::{Anchor, Colour, Mark, Pen, Picture, Type};
use std::fmt::Write as _;

/// Fonts requested from a viewer; the PNG is drawn with the first.
const FAMILIES: &str = "Inter, 'Helvetica Neue', Arial, sans-serif";

impl Picture {
    /// The picture as an SVG document.
    pub(crate) fn to_svg(&self) -> String {
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

/// The colour as a quoted attribute value, followed by an opacity attribute if necessary.
fn svg_colour(Colour(r, g, b, alpha): Colour, attribute: &str) -> String {
    let opaque = format!("\"#{r:02x}{g:02x}{b:02x}\"");
    if alpha < 1.0 { format!("{opaque} {attribute}-opacity=\"{alpha}\"") } else { opaque }
}

/// Text escaped for XML and HTML, in content and in quoted attributes. Control characters, which XML forbids, become
/// spaces.
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
