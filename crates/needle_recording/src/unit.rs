//! Units in table headers and on the command line.

/// Standard gravity, m/s2 (ISO 80000-3): a gram-force is its weight.
const GRAVITY: f64 = 9.806_65;

/// Physical dimension of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dimension {
    /// In s.
    Time,
    /// In m.
    Length,
    /// In N.
    Force,
}

impl Dimension {
    /// Units of the dimension, each with its size in s, m or N.
    const fn units(self) -> &'static [(&'static str, f64)] {
        match self {
            Self::Time => &[
                ("s", 1.0),
                ("sec", 1.0),
                ("秒", 1.0),
                ("с", 1.0),
                ("сек", 1.0),
                ("ms", 1e-3),
                ("us", 1e-6),
                ("ns", 1e-9),
                ("min", 60.0),
                ("h", 3600.0),
                ("d", 86_400.0),
                ("초", 1.0),
            ],
            Self::Length => &[
                ("m", 1.0),
                ("cm", 1e-2),
                ("mm", 1e-3),
                ("um", 1e-6),
                ("nm", 1e-9),
                ("in", 0.0254),
                ("inch", 0.0254),
                ("毫米", 1e-3),
                ("мм", 1e-3),
            ],
            Self::Force => &[
                ("N", 1.0),
                ("kN", 1e3),
                ("mN", 1e-3),
                ("uN", 1e-6),
                ("nN", 1e-9),
                ("cN", 1e-2),
                ("daN", 10.0),
                ("gf", 1e-3 * GRAVITY),
                ("g", 1e-3 * GRAVITY),
                ("kgf", GRAVITY),
                ("kg", GRAVITY),
                ("lbf", 0.453_592_37 * GRAVITY),
                ("lb", 0.453_592_37 * GRAVITY),
                ("ozf", 0.453_592_37 / 16.0 * GRAVITY),
                ("牛", 1.0),
                ("Н", 1.0),
                ("мН", 1e-3),
                ("кН", 1e3),
            ],
        }
    }

    /// Words for units, and the unit: English, German and French, singular and plural.
    const fn words(self) -> &'static [(&'static str, &'static str)] {
        match self {
            Self::Time => &[
                ("second", "s"),
                ("seconds", "s"),
                ("sekunde", "s"),
                ("sekunden", "s"),
                ("seconde", "s"),
                ("secondes", "s"),
                ("secs", "s"),
                ("sek", "s"),
                ("msec", "ms"),
                ("millis", "ms"),
                ("millisecond", "ms"),
                ("milliseconds", "ms"),
                ("millisekunden", "ms"),
                ("usec", "us"),
                ("micros", "us"),
                ("microseconds", "us"),
                ("nanoseconds", "ns"),
                ("minutes", "min"),
                ("hours", "h"),
            ],
            Self::Length => &[
                ("meter", "m"),
                ("metre", "m"),
                ("meters", "m"),
                ("metres", "m"),
                ("mètre", "m"),
                ("mètres", "m"),
                ("millimeter", "mm"),
                ("millimetre", "mm"),
                ("millimeters", "mm"),
                ("millimetres", "mm"),
                ("millimètres", "mm"),
                ("micron", "um"),
                ("microns", "um"),
                ("micrometer", "um"),
                ("micrometers", "um"),
                ("micrometres", "um"),
                ("mikrometer", "um"),
                ("centimeters", "cm"),
                ("inches", "in"),
                ("微米", "um"),
            ],
            Self::Force => &[
                ("newton", "N"),
                ("newtons", "N"),
                ("millinewton", "mN"),
                ("millinewtons", "mN"),
                ("kilonewton", "kN"),
                ("gram", "g"),
                ("grams", "g"),
                ("gramm", "g"),
                ("lbs", "lb"),
                ("pounds", "lb"),
                ("牛顿", "N"),
                ("毫牛", "mN"),
            ],
        }
    }

    /// Size of a unit in s, m or N. A micro sign counts as u. Case matters, except for units that are unambiguous in
    /// any case (`MM`, `Sec`).
    #[must_use]
    pub(crate) fn unit(self, text: &str) -> Option<f64> {
        // `in.`, and a micro sign that was read in a wrong encoding
        let text = text.trim().trim_end_matches('.').replace("Âµ", "u").replace(['µ', 'μ'], "u");
        let exact = self.units().iter().find(|(name, _)| *name == text);
        // MN is not mN, and Ms is not ms
        let loose = |name: &str| name.eq_ignore_ascii_case(&text) && !text.starts_with('M');
        let any =
            exact.or_else(|| self.units().iter().find(|(name, _)| loose(name) || (text == "MM" && *name == "mm")));
        let size = |unit: &str| self.units().iter().find(|(name, _)| *name == unit).map(|(_, size)| *size);
        any.map(|(_, size)| *size).or_else(|| {
            let text = text.to_lowercase();
            self.words().iter().find(|(word, _)| *word == text).and_then(|(_, unit)| size(unit))
        })
    }

    /// The units, for messages.
    #[must_use]
    pub(crate) fn names(self) -> String {
        self.units().iter().map(|(name, _)| *name).filter(|name| name.is_ascii()).collect::<Vec<_>>().join(", ")
    }

    /// Whether a header has a unit of the dimension in brackets: `Untitled (N)`.
    #[must_use]
    pub(crate) fn in_brackets(self, header: &str) -> bool {
        let unit = header.rsplit_once(['(', '[']).and_then(|(_, rest)| rest.split_once([')', ']']));
        unit.is_some_and(|(unit, _)| self.unit(unit).is_some())
    }

    /// The unit in a header: `Load (N)`, `Load [N]`, `Load {N}`, `Load / N`, `Load, N`, `load_n`; `None` if there is none.
    #[must_use]
    pub(crate) fn of_header(self, header: &str) -> Option<(String, f64)> {
        let within = |open: char, close: char| {
            let (_, rest) = header.rsplit_once(open)?;
            rest.split_once(close).map(|(unit, _)| unit)
        };
        let behind = ['/', ',', '_', '.', ' '].map(|c| header.rsplit_once(c).map(|(_, unit)| unit));
        let found = [within('(', ')'), within('[', ']'), within('<', '>'), within('{', '}'), within('（', '）')]
            .into_iter()
            .chain(behind)
            .flatten();
        // Arduino's functions are names and units
        let alone =
            ["millis", "micros"].into_iter().find(|name| self == Self::Time && header.eq_ignore_ascii_case(name));
        found.chain(alone).map(str::trim).find_map(|unit| {
            // names in snake case have lower-case units: depth_m, force_n, and those of R: force.n
            let own =
                header.contains(['_', '.']).then(|| self.units().iter().find(|(name, _)| name.to_lowercase() == unit));
            let size = own.flatten().map(|(_, size)| *size).or_else(|| self.unit(unit))?;
            Some((unit.to_owned(), size))
        })
    }
}

/// Whether a header has a unit of time, length or force.
pub(super) fn has_unit(header: &str) -> bool {
    [Dimension::Time, Dimension::Length, Dimension::Force].iter().any(|d| d.of_header(header).is_some())
}

/// Whether a text is a unit of time, length or force.
pub(super) fn is_measure(text: &str) -> bool {
    [Dimension::Time, Dimension::Length, Dimension::Force].iter().any(|d| d.unit(text).is_some())
}

/// Whether a cell may belong to a row of units: `(mm)`, `[N]`, `s`, `-`, `%`, or empty.
pub(super) fn is_unit(cell: &str) -> bool {
    let cell = cell.trim();
    let bare = cell.trim_matches(['(', ')', '[', ']', '<', '>']);
    bare.is_empty()
        || (cell.len() < 12 && [("(", ")"), ("[", "]")].iter().any(|(a, b)| cell.starts_with(a) && cell.ends_with(b)))
        || ["-", "%", "mm/mm", "kPa", "MPa", "Pa", "V", "mV", "°C", "mm/s", "mm/min", "N/mm", "N/s"].contains(&bare)
        || is_measure(bare)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_of_headers() {
        let of = |d: Dimension, text: &str| d.of_header(text).map(|(_, size)| size);
        for text in
            ["Compression (mm)", "Extension [mm]", "Weg/mm", "depth_mm", "Position, mm", "Travel mm", "depth.mm"]
        {
            assert_eq!(of(Dimension::Length, text), Some(1e-3), "{text}");
        }
        assert_eq!(of(Dimension::Length, "Compression"), None);
        assert_eq!(of(Dimension::Length, "Strain (-)"), None);
        assert_eq!(of(Dimension::Force, "Load (mN)"), Some(1e-3));
        assert_eq!(of(Dimension::Force, "Load (MN)"), None, "a meganewton is no millinewton");
        assert_eq!(of(Dimension::Force, "force_n"), Some(1.0));
        assert_eq!(of(Dimension::Time, "Time (µs)"), Some(1e-6));
        assert_eq!(of(Dimension::Time, "Time (Sec)"), Some(1.0));
        assert_eq!(of(Dimension::Length, "Weg (Millimeters)"), Some(1e-3));
        assert_eq!(of(Dimension::Force, "Kraft (Newtons)"), Some(1.0));
        assert!(Dimension::Force.in_brackets("Untitled [mN]") && !Dimension::Force.in_brackets("Untitled N"));
        assert_eq!(of(Dimension::Length, "Weg (in.)"), Some(0.0254));
        assert_eq!(of(Dimension::Length, "Weg (Âµm)"), Some(1e-6));
        assert_eq!(of(Dimension::Time, "millis"), Some(1e-3));
        assert!(is_unit("(mm)") && is_unit("") && !is_unit("Load"));
    }
}
