//! Measures the width of texts. The font is compiled in, so the result does not depend on the machine's fonts.

use super::picture::Type;
use ab_glyph::{Font as _, FontRef, PxScale, ScaleFont as _};

static REGULAR: &[u8] = include_bytes!("../assets/fonts/Inter-Regular-subset.otf");
static SEMIBOLD: &[u8] = include_bytes!("../assets/fonts/Inter-SemiBold-subset.otf");

/// The text, truncated with an ellipsis if it is wider than `room` px.
pub(super) fn fitted(text: &str, typ: Type, room: f64) -> String {
    let Ok(fonts) = Fonts::load() else { return text.to_owned() };
    let (mut width, mut cut) = (0.0_f32, 0);
    for (at, advance) in fonts.advances(text, typ.size, typ.bold) {
        if f64::from(width) + f64::from(typ.size) <= room {
            cut = at;
        }
        width += advance;
        // measures only the characters that fit: a name may be arbitrarily long
        if f64::from(width) > room {
            return format!("{}…", text[..cut].trim_end());
        }
    }
    text.to_owned()
}

/// Width of a text, px.
pub(super) fn text_width(text: &str, size: f32, bold: bool) -> f64 {
    Fonts::load().map_or(0.0, |fonts| f64::from(fonts.width(text, size, bold)))
}

/// The two font faces.
pub(super) struct Fonts {
    regular: FontRef<'static>,
    semibold: FontRef<'static>,
}

impl Fonts {
    pub(crate) fn load() -> Result<Self, ab_glyph::InvalidFont> {
        Ok(Self { regular: FontRef::try_from_slice(REGULAR)?, semibold: FontRef::try_from_slice(SEMIBOLD)? })
    }

    pub(crate) const fn face(&self, bold: bool) -> &FontRef<'static> {
        if bold { &self.semibold } else { &self.regular }
    }

    /// ab_glyph's scale is the line height; `size` is the em, as in SVG.
    pub(crate) fn scale(&self, size: f32, bold: bool) -> PxScale {
        let face = self.face(bold);
        PxScale::from(size * face.height_unscaled() / face.units_per_em().unwrap_or(1000.0))
    }

    pub(crate) fn width(&self, text: &str, size: f32, bold: bool) -> f32 {
        self.advances(text, size, bold).map(|(_, advance)| advance).sum()
    }

    /// Byte offset of each character, and its width, px.
    fn advances<'a>(&'a self, text: &'a str, size: f32, bold: bool) -> impl Iterator<Item = (usize, f32)> + 'a {
        let face = self.face(bold).as_scaled(self.scale(size, bold));
        text.char_indices().map(move |(at, c)| (at, face.h_advance(face.glyph_id(c))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::Anchor;
    use crate::plot::{INK, label};

    /// The time to truncate must grow with the visible part only: quadratic time for this text would be days.
    #[test]
    fn a_name_may_be_as_long_as_it_likes() {
        let typ = Type { colour: INK, ..label(Anchor::Start) };
        let cut = fitted(&"wide ".repeat(1_000_000), typ, 300.0);
        assert!(cut.ends_with('…') && text_width(&cut, typ.size, typ.bold) <= 300.0, "{cut}");
        assert!(text_width(&cut, typ.size, typ.bold) > 250.0, "{cut}");
        assert_eq!(fitted("short", typ, 300.0), "short");
    }
}
