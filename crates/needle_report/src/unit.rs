//! Number formats for readers.

use needle_estimate::compare::Run;

/// Unit for the forces of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Scale {
    /// Shown number per newton.
    pub factor: f64,
    pub unit: &'static str,
}

impl Scale {
    /// mN for a run whose forces stay below 0.2 N, otherwise N.
    pub(crate) fn of_force(run: &Run) -> Self {
        let m = run.force_metrics();
        let peak = [m.peak_predicted_n, m.peak_measured_n].into_iter().flatten().map(f64::abs).fold(0.0, f64::max);
        if peak > 0.0 && peak < 0.2 { Self { factor: 1e3, unit: "mN" } } else { Self { factor: 1.0, unit: "N" } }
    }
}

/// A number with a given number of significant digits. A power of ten is used only if zeros would hide the digits.
/// "–" if it is not finite.
pub(super) fn significant(value: f64, figures: usize) -> String {
    if !value.is_finite() {
        return "–".to_owned();
    }
    if value == 0.0 {
        return "0".to_owned();
    }
    // The exponent after rounding: 9.996 with three digits is 10.0.
    let scientific = format!("{value:.*e}", figures.saturating_sub(1));
    let (mantissa, exponent) = scientific.split_once('e').unwrap_or((&scientific, "0"));
    let exponent: i32 = exponent.parse().unwrap_or(0);
    if (-4..7).contains(&exponent) {
        let decimals = (figures as i32 - 1 - exponent).max(0) as usize;
        return format!("{value:.decimals$}").replace('-', "−");
    }
    let raised: String = exponent.to_string().chars().map(superscript).collect();
    format!("{mantissa} × 10{raised}").replace('-', "−")
}

fn superscript(c: char) -> char {
    const DIGITS: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    c.to_digit(10).and_then(|d| DIGITS.get(d as usize).copied()).unwrap_or('⁻')
}

/// An integer with thin spaces between thousands.
pub(super) fn count(n: u64) -> String {
    let digits = n.to_string();
    let mut text = String::with_capacity(digits.len() + digits.len() / 3);
    for (i, c) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push('\u{202f}');
        }
        text.push(c);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_are_significant() {
        let cases = [(0.0675432, "0.0675"), (9.996, "10.0"), (-12.3456, "−12.3"), (1234567.0, "1234567")];
        for (value, text) in cases {
            assert_eq!(significant(value, 3), text);
        }
        assert_eq!(significant(1.2e-9, 2), "1.2 × 10⁻⁹");
        assert_eq!(significant(f64::NAN, 3), "–");
        assert_eq!(significant(0.0, 3), "0");
    }

    #[test]
    fn counts_are_grouped() {
        assert_eq!(count(999), "999");
        assert_eq!(count(28645), "28\u{202f}645");
        assert_eq!(count(1_234_567), "1\u{202f}234\u{202f}567");
    }
}
