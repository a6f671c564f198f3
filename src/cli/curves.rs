//! Force over depth in the terminal during a run: predicted and measured, drawn with braille dots.

use console::{Style, style};

/// Size of the picture, characters; each has two by four dots.
const COLUMNS: usize = 60;
const ROWS: usize = 9;
/// Dots of a braille character, by column and row.
const DOT: [[u8; 4]; 2] = [[0x01, 0x02, 0x04, 0x40], [0x08, 0x10, 0x20, 0x80]];

/// Two curves of force over depth. The scale follows the largest values.
#[derive(Debug, Default)]
pub(super) struct Curves {
    /// (depth, force) in m and N.
    predicted: Vec<[f64; 2]>,
    measured: Vec<[f64; 2]>,
    /// Largest depth and force so far.
    full: [f64; 2],
}

impl Curves {
    /// Adds what is known at a depth, m and N. What is no number is left out.
    pub(super) fn add(&mut self, depth_m: f64, predicted_n: Option<f64>, measured_n: Option<f64>) {
        for (curve, force_n) in [(&mut self.predicted, predicted_n), (&mut self.measured, measured_n)] {
            if let Some(point) = force_n.map(|f| [depth_m, f]).filter(|p| p.iter().all(|x| x.is_finite())) {
                curve.push(point);
                (0..2).for_each(|k| self.full[k] = self.full[k].max(point[k]));
            }
        }
    }

    /// The picture, a line of text per row, with its scales.
    pub(super) fn picture(&self) -> String {
        let (predicted, measured) = (self.dots(&self.predicted), self.dots(&self.measured));
        let (blue, orange) = (Style::new().for_stderr().cyan(), Style::new().for_stderr().yellow());
        let mut out = String::new();
        for row in 0..ROWS {
            let label = match row {
                0 => format!("{:>9.4} N", self.full[1]),
                _ if row == ROWS - 1 => format!("{:>9} N", 0),
                _ => " ".repeat(11),
            };
            out += &format!("{label} │");
            for column in 0..COLUMNS {
                // both curves' dots; where they share a character the prediction's colour is on top
                let (own, other) = (predicted[row][column], measured[row][column]);
                let dots = char::from_u32(0x2800 + u32::from(own | other)).unwrap_or(' ');
                out += &match (own, other) {
                    (0, 0) => " ".to_owned(),
                    (0, _) => orange.apply_to(dots).to_string(),
                    _ => blue.apply_to(dots).to_string(),
                };
            }
            out.push('\n');
        }
        let end = format!("{:.2} mm", 1e3 * self.full[0]);
        out += &format!("{:>11} └{}\n", "", "─".repeat(COLUMNS));
        out += &format!(
            "{:>11}  {:<12} {} {}{:>width$}",
            "",
            "depth 0",
            style("predicted").for_stderr().cyan(),
            style("measured").for_stderr().yellow(),
            end,
            width = COLUMNS - 31
        );
        out
    }

    /// Braille dots of a curve, by row and column.
    fn dots(&self, curve: &[[f64; 2]]) -> [[u8; COLUMNS]; ROWS] {
        let mut dots = [[0; COLUMNS]; ROWS];
        let place = |value: f64, full: f64, count: usize| {
            let share = if full > 0.0 { (value / full).clamp(0.0, 1.0) } else { 0.0 };
            ((share * (count - 1) as f64).round() as usize).min(count - 1)
        };
        for &[depth, force] in curve {
            let x = place(depth, self.full[0], 2 * COLUMNS);
            let y = 4 * ROWS - 1 - place(force, self.full[1], 4 * ROWS);
            dots[y / 4][x / 2] |= DOT[x % 2][y % 4];
        }
        dots
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plain(curves: &Curves) -> Vec<String> {
        console::strip_ansi_codes(&curves.picture()).lines().map(str::to_owned).collect()
    }

    #[test]
    fn a_straight_line_goes_from_corner_to_corner() {
        let mut curves = Curves::default();
        (0..=500).for_each(|k| curves.add(2e-5 * f64::from(k), Some(1e-4 * f64::from(k)), None));
        let lines = plain(&curves);
        assert_eq!(lines.len(), ROWS + 2);
        assert!(lines.iter().all(|line| line.chars().count() <= 13 + COLUMNS), "{lines:#?}");
        assert!(lines[0].contains("0.0500 N") && lines[0].ends_with('⠉'), "{lines:#?}");
        assert!(lines[ROWS - 1].contains("0 N │⣀"), "{lines:#?}");
        assert!(lines[ROWS + 1].contains("10.00 mm"), "{lines:#?}");
        // every column has its dot
        let drawn =
            |column: usize| (0..ROWS).any(|row| lines[row].chars().nth(13 + column).is_some_and(|c| c > '\u{2800}'));
        assert!((0..COLUMNS).all(drawn), "{lines:#?}");
    }

    #[test]
    fn what_is_no_number_leaves_no_trace() {
        let mut curves = Curves::default();
        assert_eq!(plain(&curves).len(), ROWS + 2, "an empty picture is one");
        curves.add(f64::NAN, Some(1.0), Some(2.0));
        curves.add(1e-3, Some(f64::INFINITY), None);
        assert_eq!(curves.full, [0.0, 0.0]);
        curves.add(1e-3, Some(-0.1), Some(0.1));
        assert_eq!(curves.full, [1e-3, 0.1]);
    }
}
