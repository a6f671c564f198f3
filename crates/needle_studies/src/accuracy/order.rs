//! Observed order of convergence.

use std::fmt::Write as _;

use super::{Case, Row, Steps};

/// Observed order q of an error in the mean distance of nodes h = (V / nodes)^(1/3): the slope of the least-squares
/// line through log(error) over log(h). `None` for fewer than two rows, or if an error is missing or zero.
#[must_use]
pub(crate) fn observed_order<'a>(
    rows: impl Iterator<Item = &'a Row>,
    error: impl Fn(&Row) -> Option<f64>,
) -> Option<f64> {
    let mut points = Vec::new();
    for row in rows {
        let e = error(row).filter(|e| *e > 0.0)?;
        points.push((-(row.nodes as f64).ln() / 3.0, e.ln()));
    }
    if points.len() < 2 {
        return None;
    }
    let n = points.len() as f64;
    let mean = |f: fn(&(f64, f64)) -> f64| points.iter().map(f).sum::<f64>() / n;
    let (x, y) = (mean(|p| p.0), mean(|p| p.1));
    let square: f64 = points.iter().map(|p| (p.0 - x).powi(2)).sum();
    (square > 0.0).then(|| points.iter().map(|p| (p.0 - x) * (p.1 - y)).sum::<f64>() / square)
}

/// Name of a convergence series: the case without its spacing.
#[must_use]
pub fn refined(case: &Case) -> String {
    if case.has_hexahedra() {
        return format!("{}, {}", case.method_name(), case.integration());
    }
    let points = if case.points_per_cell == 1 { String::new() } else { format!(", {} points", case.points_per_cell) };
    format!("{}{points}", case.method_name())
}

/// Observed orders of the runs to equilibrium, a line per scene and discretisation.
#[must_use]
pub fn orders(rows: &[Row]) -> String {
    let mut out = String::new();
    let key = |row: &Row| (row.scene.clone(), refined(&row.case));
    let mut groups = Vec::new();
    for row in rows.iter().filter(|r| r.case.steps == Steps::Rest) {
        if !groups.contains(&key(row)) {
            groups.push(key(row));
        }
    }
    for group in groups {
        let of = || rows.iter().filter(|r| r.case.steps == Steps::Rest && key(r) == group);
        let order = |q: Option<f64>| q.map_or_else(|| "-".to_owned(), |q| format!("{q:.1}"));
        let _ = writeln!(
            out,
            "observed order, {}, {}: force {}, displacement {}",
            group.0,
            group.1,
            order(observed_order(of(), Row::max_force_error)),
            order(observed_order(of(), |r| r.displacement_error)),
        );
    }
    out
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::super::row::tests::row;
    use super::*;

    fn at_rest(nodes: usize, error: f64) -> Row {
        let mut row = Row { displacement_error: None, ..row(nodes, error) };
        row.case.steps = Steps::Rest;
        row
    }

    #[test]
    fn the_order_of_a_quadratic_error_is_two() {
        let rows = [at_rest(1000, 0.04), at_rest(8000, 0.01), at_rest(64_000, 0.0025)];
        let order = observed_order(rows.iter(), Row::max_force_error).unwrap();
        assert!((order - 2.0).abs() < 1e-12, "{order}");
        assert_eq!(observed_order(rows[..1].iter(), Row::max_force_error), None);
        assert_eq!(observed_order(rows.iter(), |r| r.displacement_error), None);
        assert!(orders(&rows).contains("compression, mmls: force 2.0, displacement -"), "{}", orders(&rows));
        assert_eq!(orders(&[row(1000, 0.04)]), "", "a moving row has no order");
    }
}
