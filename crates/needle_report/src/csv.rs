//! `force.csv` and `targets.csv`: the series of a run, for plotting tools.

use needle_estimate::calibrate::Forces;
use needle_estimate::compare::Run;
use std::fmt::Write as _;

/// Content of `force.csv`, one line per answered pose. The columns are `time_s,depth_m,predicted_n,measured_n`, then
/// the force on the instrument in frame `sample`, predicted and measured (`predicted_x_n` to `measured_z_n`). With an
/// ensemble there are also `predicted_low_n,predicted_high_n`, the ends of its 95 % band. The last is `model_error_n`, the error that
/// discretisation and steps make.
///
/// A measured force is empty if there is none, and so is any number that is not finite.
#[must_use]
pub fn force_csv(run: &Run) -> String {
    let mut text = String::from("time_s,depth_m,predicted_n,measured_n");
    text.push_str(",predicted_x_n,predicted_y_n,predicted_z_n,measured_x_n,measured_y_n,measured_z_n");
    text.push_str(if run.ensemble.is_some() { ",predicted_low_n,predicted_high_n" } else { "" });
    text.push_str(",model_error_n\n");
    for (i, a) in run.answers.iter().enumerate() {
        let measured = a.measured_n.map_or(Cell(f64::NAN), Cell);
        push(&mut text, format_args!("{},{},{},{measured}", Cell(a.time_s), Cell(a.depth_m), Cell(a.predicted_n)));
        for component in a.predicted_vector_n.iter().chain(&a.measured_vector_n.unwrap_or([f64::NAN; 3])) {
            push(&mut text, format_args!(",{}", Cell(*component)));
        }
        if run.ensemble.is_some() {
            let [low, high] = run.band(i).map_or([f64::NAN; 2], |band| [band.low_n, band.high_n]);
            push(&mut text, format_args!(",{},{}", Cell(low), Cell(high)));
        }
        push(&mut text, format_args!(",{}\n", Cell(a.model_error_n)));
    }
    text
}

/// Content of `forecast.csv`: `time_s,depth_m,measured_n,forecast_n,forecast_low_n,forecast_high_n`, one line per
/// reading that was forecast from readings up to one horizon before. `None` without a load cell or an ensemble.
#[must_use]
pub(super) fn forecast_csv(run: &Run) -> Option<String> {
    let (answers, found) = run.ensemble.as_ref()?.assimilated.as_ref().filter(|(answers, _)| !answers.is_empty())?;
    let mut text = String::from("time_s,depth_m,measured_n,forecast_n,forecast_low_n,forecast_high_n\n");
    for (i, forecast) in answers.iter().zip(&found.forecasts) {
        let (Some(f), a) = (forecast, &run.answers[*i]) else { continue };
        let band = f.band();
        let row = [a.time_s, a.depth_m, a.measured_n.unwrap_or(f64::NAN), f.mean_n, band.low_n, band.high_n].map(Cell);
        let [time, depth, measured, mean, low, high] = row;
        push(&mut text, format_args!("{time},{depth},{measured},{mean},{low},{high}\n"));
    }
    Some(text)
}

/// Content of `keys.csv`: `time_s,depth_m,KEY,KEY_standard_deviation,...`, the assimilated value of each uncertain
/// key after each block of readings. `None` without measurements or without an ensemble.
#[must_use]
pub(super) fn keys_csv(run: &Run) -> Option<String> {
    let ensemble = run.ensemble.as_ref()?;
    let (_, found) = ensemble.assimilated.as_ref().filter(|(_, found)| !found.history.is_empty())?;
    let mut text = String::from("time_s,depth_m");
    for key in &ensemble.keys {
        push(&mut text, format_args!(",{},{}", quoted(&key.key), quoted(&format!("{}_standard_deviation", key.key))));
    }
    text.push('\n');
    for (time_s, keys) in &found.history {
        let next = run.answers.partition_point(|answer| answer.time_s < *time_s);
        let depth_m = run.answers.get(next).or(run.answers.last()).map_or(f64::NAN, |answer| answer.depth_m);
        push(&mut text, format_args!("{},{}", Cell(*time_s), Cell(depth_m)));
        for number in keys.iter().flatten() {
            push(&mut text, format_args!(",{}", Cell(*number)));
        }
        text.push('\n');
    }
    Some(text)
}

/// Content of `deformation.csv`: `time_s,depth_m,deformation_coefficient`, for a needle with friction during its
/// insertion; otherwise `None`.
#[must_use]
pub(super) fn deformation_csv(run: &Run) -> Option<String> {
    let mut text = String::from("time_s,depth_m,deformation_coefficient\n");
    for [time, depth, coefficient] in &run.coefficients {
        push(&mut text, format_args!("{},{},{}\n", Cell(*time), Cell(*depth), Cell(*coefficient)));
    }
    (!run.coefficients.is_empty()).then_some(text)
}

/// Content of `needle.csv`, one line per answered pose of a needle that bends: place of its tip and distance from that of the straight
/// needle, force and torque at the load cell, all in frame `sample`; otherwise `None`.
#[must_use]
pub(super) fn needle_csv(run: &Run) -> Option<String> {
    let mut text = String::from("time_s,depth_m,tip_x_m,tip_y_m,tip_z_m,aside_m,force_x_n,force_y_n,force_z_n");
    text.push_str(",torque_x_nm,torque_y_nm,torque_z_nm\n");
    for row in &run.needle {
        push(&mut text, format_args!("{},{}", Cell(row.time_s), Cell(row.depth_m)));
        let numbers = row.tip.iter().chain([&row.aside_m]).chain(&row.force_n).chain(&row.torque_nm);
        numbers.for_each(|number| push(&mut text, format_args!(",{}", Cell(*number))));
        text.push('\n');
    }
    (!run.needle.is_empty()).then_some(text)
}

/// Content of `shape.csv`: `time_s,depth_m,arc_m,x_m,y_m,z_m`, the places along a needle that bends from its clamp to its tip, at each of the run's
/// snapshots; otherwise `None`.
#[must_use]
pub(super) fn shape_csv(run: &Run) -> Option<String> {
    let mut text = String::from("time_s,depth_m,arc_m,x_m,y_m,z_m\n");
    let empty = text.len();
    for snapshot in &run.snapshots {
        let (mut arc, mut before) = (0.0, None::<[f64; 3]>);
        for place in &snapshot.needle {
            let step = |from: [f64; 3]| (0..3).map(|k| (place[k] - from[k]).powi(2)).sum::<f64>().sqrt();
            arc += before.map_or(0.0, step);
            before = Some(*place);
            let row = [snapshot.time_s, snapshot.depth_m, arc, place[0], place[1], place[2]].map(Cell);
            let [time, depth, arc, x, y, z] = row;
            push(&mut text, format_args!("{time},{depth},{arc},{x},{y},{z}\n"));
        }
    }
    (text.len() > empty).then_some(text)
}

/// Content of `targets.csv`, one line per time and three columns per target, as plotting tools expect:
/// `time_s,depth_m,NAME_x_m,NAME_y_m,NAME_z_m,...` (present position in frame `sample`).
#[must_use]
pub fn targets_csv(run: &Run) -> String {
    let mut text = String::from("time_s,depth_m");
    for name in &run.target_names {
        for axis in ["x", "y", "z"] {
            push(&mut text, format_args!(",{}", quoted(&format!("{name}_{axis}_m"))));
        }
    }
    text.push('\n');
    for row in &run.targets {
        push(&mut text, format_args!("{},{}", Cell(row.time_s), Cell(row.depth_m)));
        for coordinate in row.positions.iter().flatten() {
            push(&mut text, format_args!(",{}", Cell(*coordinate)));
        }
        text.push('\n');
    }
    text
}

/// Content of `calibration.csv`: `time_s,depth_m,measured_n,start_n,fitted_n`, one line per pose with a measured
/// force. `fitted_n` includes the load cell's offset and drift.
pub(super) fn calibration_csv(forces: &Forces) -> String {
    let mut text = String::from("time_s,depth_m,measured_n,start_n,fitted_n\n");
    for i in 0..forces.time_s.len() {
        let row = [&forces.time_s, &forces.depth_m, &forces.measured_n, &forces.start_n, &forces.fitted_n];
        let [time, depth, measured, start, fitted] = row.map(|column| Cell(column[i]));
        push(&mut text, format_args!("{time},{depth},{measured},{start},{fitted}\n"));
    }
    text
}

fn push(text: &mut String, line: std::fmt::Arguments<'_>) {
    // Writing to a String can't fail.
    let _ = text.write_fmt(line);
}

/// A number that can be read back exactly; empty if it is not finite.
struct Cell(f64);

impl std::fmt::Display for Cell {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        // Debug instead of Display: 1.2e-17 instead of nineteen zeros.
        if self.0.is_finite() { write!(f, "{:?}", self.0) } else { Ok(()) }
    }
}

/// Quoted as in RFC 4180 if necessary.
fn quoted(field: &str) -> String {
    if field.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", field.replace('"', "\"\""))
    } else {
        field.to_owned()
    }
}
