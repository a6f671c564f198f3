//! Drawing helpers for all plots: colours, axes with round ticks, panels, legends.

use super::{
    fonts::text_width,
    picture::{Anchor, Colour, Pen, Picture, Type},
};

// Distinguishable by colour-blind readers and in grey print: lightness differs as well as hue.
pub(super) const INK: Colour = Colour(0x1c, 0x22, 0x2b, 1.0);
pub(super) const MUTED: Colour = Colour(0x5b, 0x65, 0x73, 1.0);
pub(super) const RULE: Colour = Colour(0xe3, 0xe7, 0xec, 1.0);
pub(super) const FRAME: Colour = Colour(0x9a, 0xa4, 0xb1, 1.0);
pub(super) const BLUE: Colour = Colour(0x0b, 0x62, 0xc4, 1.0);
pub(super) const VERMILION: Colour = Colour(0xc4, 0x47, 0x00, 1.0);

/// Style of labels.
pub(super) const fn label(anchor: Anchor) -> Type {
    Type { size: 13.0, bold: false, colour: MUTED, anchor }
}

/// A linear axis with round ticks.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Axis {
    pub min: f64,
    pub max: f64,
    /// Ticks within [min, max].
    ticks: Vec<f64>,
    decimals: usize,
}

impl Axis {
    /// An axis that contains all finite values, extended by a part `margin` of their range at each end that is
    /// not zero. It has about `count` ticks of 1, 2 or 5 times a power of ten. For a single value or none it gets a default
    /// width.
    pub(crate) fn holding(values: impl IntoIterator<Item = f64>, count: usize, margin: f64) -> Self {
        let finite = values.into_iter().filter(|v| v.is_finite());
        let (mut min, mut max) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        if min > max {
            (min, max) = (0.0, 1.0);
        } else if max - min <= 1e-12 * max.abs().max(min.abs()) {
            let half = if max == 0.0 { 0.5 } else { 0.5 * max.abs() };
            (min, max) = (min - half, max + half);
        }
        let margin = margin * (max - min);
        min -= if min == 0.0 { 0.0 } else { margin };
        max += if max == 0.0 { 0.0 } else { margin };
        let step = round_step((max - min) / count.max(1) as f64);
        // The tolerance prevents 0.30000000000000004 from removing a tick.
        let (first, last) = ((min / step - 1e-9).ceil(), (max / step + 1e-9).floor());
        let ticks = (0..=(last - first) as usize).map(|i| (first + i as f64) * step + 0.0).collect();
        Self { min, max, ticks, decimals: (-step.log10().floor()).clamp(0.0, 12.0) as usize }
    }

    fn tick_label(&self, tick: f64) -> String {
        // A typographic minus is as wide as a digit.
        format!("{tick:.*}", self.decimals).replace('-', "−")
    }

    fn fraction(&self, value: f64) -> f64 {
        (value - self.min) / (self.max - self.min)
    }
}

/// The smallest of 1, 2, 5 times a power of ten that is at least `raw`.
fn round_step(raw: f64) -> f64 {
    let power = 10f64.powf(raw.log10().floor());
    [1.0, 2.0, 5.0].into_iter().map(|m| m * power).find(|&s| s >= raw * (1.0 - 1e-9)).unwrap_or(10.0 * power)
}

/// Height of the strip with the names over the depth, px.
const STRIP: f64 = 16.0;

/// A plot area with its two axes.
pub(super) struct Panel {
    /// Left, top, right, bottom, px.
    pub frame: [f64; 4],
    pub x: Axis,
    pub y: Axis,
}

impl Panel {
    /// Position of a value pair in the picture.
    pub(crate) fn at(&self, x: f64, y: f64) -> [f64; 2] {
        let [left, top, right, bottom] = self.frame;
        [left + self.x.fraction(x) * (right - left), bottom - self.y.fraction(y) * (bottom - top)]
    }

    /// Grid lines and tick labels; those of x only if `x_labels`.
    pub(crate) fn grid(&self, picture: &mut Picture, x_labels: bool) {
        let [left, top, right, bottom] = self.frame;
        for &tick in &self.y.ticks {
            let y = self.at(self.x.min, tick)[1];
            let colour = if tick == 0.0 { FRAME } else { RULE };
            picture.line([[left, y], [right, y]], Pen::new(colour, 1.0));
            picture.text([left - 10.0, y + 4.5], self.y.tick_label(tick), label(Anchor::End));
        }
        for &tick in &self.x.ticks {
            let x = self.at(tick, self.y.min)[0];
            picture.line([[x, top], [x, bottom]], Pen::new(RULE, 1.0));
            if x_labels {
                picture.line([[x, bottom], [x, bottom + 5.0]], Pen::new(FRAME, 1.0));
                picture.text([x, bottom + 20.0], self.x.tick_label(tick), label(Anchor::Middle));
            }
        }
    }

    /// Title of the vertical axis, at a height `above` the panel's upper left corner.
    pub(crate) fn title(&self, picture: &mut Picture, text: &str, above: f64) {
        let typ = Type { bold: true, colour: INK, ..label(Anchor::Start) };
        picture.text([self.frame[0], self.frame[1] - above], text, typ);
    }

    /// A line through value pairs.
    pub(crate) fn curve(&self, picture: &mut Picture, points: impl IntoIterator<Item = [f64; 2]>, pen: Pen) {
        picture.line(points.into_iter().map(|[x, y]| self.at(x, y)), pen);
    }

    /// A labelled vertical line, with the label at its upper or lower end, on the side that has room.
    pub(crate) fn event(&self, picture: &mut Picture, x: f64, text: &str, end: End) {
        let [_, top, right, bottom] = self.frame;
        let at = self.at(x, self.y.min)[0];
        picture.line([[at, top], [at, bottom]], Pen::new(MUTED, 1.2).dashed([2.0, 3.0]));
        let width = text_width(text, 13.0, false);
        let y = if end == End::Upper { top + 17.0 } else { bottom - 9.0 };
        let (x, anchor) = if at + 8.0 + width < right { (at + 7.0, Anchor::Start) } else { (at - 7.0, Anchor::End) };
        let left = if anchor == Anchor::Start { x } else { x - width };
        picture.rectangle([left - 3.0, y - 12.0], [left + width + 3.0, y + 4.0], Colour(255, 255, 255, 0.85));
        picture.text([x, y], text, label(anchor));
    }

    /// Tints intervals of the panel, behind everything else.
    pub(crate) fn ground(&self, picture: &mut Picture, stretches: &[(f64, f64, String, Colour)]) {
        let [_, top, _, bottom] = self.frame;
        for (from, to, _, colour) in stretches {
            let [x0, x1] = self.between(*from, *to);
            picture.rectangle([x0, top], [x1, bottom], Colour(colour.0, colour.1, colour.2, 0.30));
        }
    }

    /// Named intervals along the lower edge, above the axis; names that don't fit are left out.
    pub(crate) fn strip(&self, picture: &mut Picture, stretches: &[(f64, f64, String, Colour)]) {
        let bottom = self.frame[3];
        for (from, to, word, colour) in stretches {
            let [x0, x1] = self.between(*from, *to);
            picture.rectangle([x0, bottom - STRIP], [x1, bottom], *colour);
            if x1 - x0 > text_width(word, 12.0, false) + 8.0 {
                let ink = Type { size: 12.0, colour: INK, ..label(Anchor::Middle) };
                picture.text([0.5 * (x0 + x1), bottom - 4.0], word.clone(), ink);
            }
        }
    }

    fn between(&self, from: f64, to: f64) -> [f64; 2] {
        let [left, _, right, _] = self.frame;
        [from, to].map(|x| self.at(x, self.y.min)[0].clamp(left, right))
    }

    /// Named intervals along the panel's upper edge; names that don't fit are left out.
    pub(crate) fn ribbon(
        &self,
        picture: &mut Picture,
        stretches: impl IntoIterator<Item = (f64, f64, &'static str, Colour)>,
    ) {
        let [left, top, right, _] = self.frame;
        for (from, to, word, colour) in stretches {
            let [x0, x1] = [from, to].map(|x| self.at(x, self.y.min)[0].clamp(left, right));
            picture.rectangle([x0, top - 17.0], [x1, top - 1.0], colour);
            if x1 - x0 > text_width(word, 12.0, false) + 8.0 {
                picture.text([x0 + 5.0, top - 5.0], word, Type { size: 12.0, ..label(Anchor::Start) });
            }
        }
    }
}

/// End of a vertical line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum End {
    Upper,
    Lower,
}

/// A row of pens with their names, starting at `at`. It is outside the panels, so that it covers no data.
pub(super) fn legend(picture: &mut Picture, [mut x, y]: [f64; 2], entries: &[(&str, Pen)]) {
    for (text, pen) in entries {
        picture.line([[x, y - 4.5], [x + 26.0, y - 4.5]], *pen);
        picture.text([x + 33.0, y], *text, Type { colour: INK, ..label(Anchor::Start) });
        x += 33.0 + text_width(text, 13.0, false) + 24.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        let axis = Axis::holding([0.0, 0.0675], 6, 0.06);
        assert_eq!(axis.ticks.len(), 4, "{axis:?}");
        assert!(axis.max > 0.0675 && axis.min == 0.0);
        assert_eq!(axis.tick_label(axis.ticks[1]), "0.02");
        let inside = Axis::holding([-0.3, 10.4], 6, 0.0);
        assert_eq!((inside.min, inside.max), (-0.3, 10.4));
        assert_eq!(inside.ticks, [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]);
    }

    #[test]
    fn an_axis_of_one_value_or_none_has_a_width() {
        for values in [vec![], vec![0.0], vec![3.0, 3.0], vec![f64::NAN, f64::INFINITY], vec![-1e-30, 1e-30]] {
            let axis = Axis::holding(values.clone(), 5, 0.06);
            assert!(axis.max > axis.min && !axis.ticks.is_empty(), "{values:?}: {axis:?}");
        }
    }
}
