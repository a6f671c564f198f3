//! Number formats.

use super::super::unit::is_measure;

/// Separators between groups of three digits, in addition to the point or comma that is not the decimal sign.
const GROUPS: [char; 5] = ['\'', '’', ' ', '\u{a0}', '\u{202f}'];

/// A number: 0.5, or 0,5 with a decimal comma. 1,005.0, 1.005,0 and 1'005.0 have groups of three digits.
pub(super) fn number(cell: &str, decimal_comma: bool) -> Option<f64> {
    let cell = cell.trim();
    // most cells of a long table
    if cell.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'.' | b'-' | b'+' | b'e' | b'E')) && !decimal_comma {
        return cell.parse().ok();
    }
    // the sign of typesetters
    let plain = cell.strip_prefix('\u{2212}').map(|rest| format!("-{rest}"));
    let cell = plain.as_deref().unwrap_or(cell);
    let (point, other) = if decimal_comma { (',', '.') } else { ('.', ',') };
    if (cell.contains(other) || cell.contains(GROUPS))
        && let Some(plain) = ungrouped(cell, point, other)
    {
        return plain.parse().ok();
    }
    let plain = if decimal_comma && cell.contains(',') { cell.replace(',', ".").parse() } else { cell.parse() };
    plain.ok().or_else(|| fortran(cell, decimal_comma))
}

/// A number with the exponent of Fortran's double precision: `0.25D-01`.
fn fortran(cell: &str, decimal_comma: bool) -> Option<f64> {
    let (digits, exponent) = cell.split_once(['D', 'd'])?;
    let signed = exponent.starts_with(['+', '-']) && digits.ends_with(|c: char| c.is_ascii_digit() || c == '.');
    signed.then(|| number(&format!("{digits}E{exponent}"), decimal_comma)).flatten()
}

/// Number and unit of a cell that has both: `0.25 mm`.
pub(super) fn measure(cell: &str) -> Option<(&str, &str)> {
    let cell = cell.trim();
    let end = cell.rfind(|c: char| c.is_ascii_digit())? + 1;
    let (digits, unit) = (&cell[..end], cell[end..].trim());
    (cell.starts_with(|c: char| c.is_ascii_digit() || "+-.".contains(c)) && is_measure(unit)).then_some((digits, unit))
}

/// The digits without group separators, with a decimal point.
fn ungrouped(cell: &str, point: char, other: char) -> Option<String> {
    let (whole, fraction) = cell.split_once(point).map_or((cell, None), |(whole, fraction)| (whole, Some(fraction)));
    let digits = whole.trim_start_matches(['-', '+']);
    let mark = digits.chars().find(|c| !c.is_ascii_digit()).filter(|c| *c == other || GROUPS.contains(c))?;
    let mut groups = digits.split(mark);
    let is_group = |group: &str, lengths: std::ops::RangeInclusive<usize>| {
        lengths.contains(&group.len()) && group.bytes().all(|b| b.is_ascii_digit())
    };
    // 0,005 is not five
    let first = groups.next().filter(|first| is_group(first, 1..=3) && !first.starts_with('0'))?;
    let rest = groups.map(|group| is_group(group, 3..=3).then_some(group)).collect::<Option<String>>()?;
    let sign = if whole.starts_with('-') { "-" } else { "" };
    Some(format!("{sign}{first}{rest}.{}", fraction.unwrap_or("0")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_with_units() {
        assert_eq!(measure("-0.25 mm"), Some(("-0.25", "mm")));
        assert_eq!(measure("1 005,5N"), Some(("1 005,5", "N")));
        for text in ["0.25", "0.25 bar", "Gel 3", "Gel 3 mm", "mm", "3 runs"] {
            assert_eq!(measure(text), None, "{text}");
        }
    }

    #[test]
    fn groups_of_digits() {
        for (text, value) in [
            ("1,005.30", Some(1005.3)),
            ("-12,345,678", Some(-12_345_678.0)),
            ("1'005.5", Some(1005.5)),
            ("1 005", Some(1005.0)),
            ("0,005", None),
            ("1,05", None),
            ("1,0055", None),
            ("1.5e-3", Some(1.5e-3)),
            ("0.25D-01", Some(0.025)),
            ("-1.d+2", Some(-100.0)),
            ("\u{2212}0.5", Some(-0.5)),
            ("3D", None),
            ("1D2", None),
            ("OVER", None),
            ("", None),
        ] {
            assert_eq!(number(text, false), value, "{text}");
        }
        for (text, value) in [
            ("1.005,3", Some(1005.3)),
            ("1.005", Some(1005.0)),
            ("0.005", Some(0.005)),
            ("-0,5", Some(-0.5)),
            ("0,1E+1", Some(1.0)),
        ] {
            assert_eq!(number(text, true), value, "{text}");
        }
    }
}
