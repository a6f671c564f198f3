//! The Pareto front of the rows.

use super::Row;

/// Indices of the Pareto-optimal rows in cost per pose and largest force error, among those with the same rate of
/// poses, cheapest first. Rows without an error (ended early) are excluded.
#[must_use]
pub fn front(rows: &[&Row], pose_hz: f64) -> Vec<usize> {
    let mut order: Vec<(usize, f64, f64)> = rows
        .iter()
        .enumerate()
        .filter(|(_, row)| row.case.pose_hz == pose_hz)
        .filter_map(|(i, row)| Some((i, row.cost_per_pose_s(), row.max_force_error()?)))
        .collect();
    order.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.2.total_cmp(&b.2)));
    let mut least = f64::INFINITY;
    order.retain(|&(_, _, error)| {
        let better = error < least;
        least = least.min(error);
        better
    });
    order.into_iter().map(|(i, ..)| i).collect()
}

#[cfg(test)]
mod tests {
    use super::super::row::tests::row;
    use super::*;

    #[test]
    fn a_row_on_the_front_is_beaten_by_none() {
        let made = |cost_s: f64, error: f64| Row { cost_s, ..row(100, error) };
        let mut rows =
            [made(1.0, 0.1), made(2.0, 0.2), made(3.0, 0.05), made(0.5, 0.4), made(3.0, 0.04), made(9.0, 0.01)];
        rows[5].ended = Some("early".to_owned());
        let rows: Vec<&Row> = rows.iter().collect();
        assert_eq!(front(&rows, 1000.0), [3, 0, 4]);
        assert_eq!(front(&rows, 100.0), [0; 0], "rates of poses are not compared with each other");
    }
}
