//! A picture as a list of marks. [`super::svg`] writes it, and [`super::raster`] draws it.

/// Red, green, blue and opacity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Colour(pub u8, pub u8, pub u8, pub f32);

/// Style of a line, px.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pen {
    pub colour: Colour,
    pub width: f32,
    /// Lengths of dash and gap.
    pub dash: Option<[f32; 2]>,
}

impl Pen {
    pub(crate) const fn new(colour: Colour, width: f32) -> Self {
        Self { colour, width, dash: None }
    }

    pub(crate) const fn dashed(self, dash: [f32; 2]) -> Self {
        Self { dash: Some(dash), ..self }
    }
}

/// Horizontal anchor of a text. Vertically it is always the baseline.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

/// Style of a text, px.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Type {
    pub size: f32,
    pub bold: bool,
    pub colour: Colour,
    pub anchor: Anchor,
}

/// A drawn element.
pub(super) enum Mark {
    Line { points: Vec<[f64; 2]>, pen: Pen },
    Area { points: Vec<[f64; 2]>, colour: Colour },
    Text { at: [f64; 2], text: String, typ: Type },
}

/// A picture with a size in px, origin at the top left, white background.
pub(super) struct Picture {
    pub width: u32,
    pub height: u32,
    pub marks: Vec<Mark>,
}

impl Picture {
    pub(crate) const fn new(width: u32, height: u32) -> Self {
        Self { width, height, marks: Vec::new() }
    }

    /// A line through the points; interrupted where a point is not finite.
    pub(crate) fn line(&mut self, points: impl IntoIterator<Item = [f64; 2]>, pen: Pen) {
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
    pub(crate) fn rectangle(&mut self, [x0, y0]: [f64; 2], [x1, y1]: [f64; 2], colour: Colour) {
        self.marks.push(Mark::Area { points: vec![[x0, y0], [x1, y0], [x1, y1], [x0, y1]], colour });
    }

    /// A filled polygon.
    pub(crate) fn area(&mut self, points: impl IntoIterator<Item = [f64; 2]>, colour: Colour) {
        self.marks.push(Mark::Area { points: points.into_iter().collect(), colour });
    }

    /// A filled circle.
    pub(crate) fn dot(&mut self, [x, y]: [f64; 2], radius: f64, colour: Colour) {
        let corner = |i: i32| {
            let (sin, cos) = (f64::from(i) * std::f64::consts::TAU / 24.0).sin_cos();
            [x + radius * cos, y + radius * sin]
        };
        self.marks.push(Mark::Area { points: (0..24).map(corner).collect(), colour });
    }

    pub(crate) fn text(&mut self, at: [f64; 2], text: impl Into<String>, typ: Type) {
        self.marks.push(Mark::Text { at, text: text.into(), typ });
    }
}
