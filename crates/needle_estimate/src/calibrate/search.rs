//! The search on one recording: aligned, fitted, and fitted again without spikes.

use super::problem::Recorded;
use super::unknown::Sought;
use super::{CalibrateError, LoadCell, Parts, Task};
use crate::compare::alignment::{Alignment, align};
use crate::compare::rows::Rows;
use crate::compare::{Run, least_squares};

/// Largest number of clouds after the first; a new one is made if the layers' depths are far from the start.
const MOST_CLOUDS: usize = 3;

/// The end of the search of one recording.
pub(super) struct Searched {
    pub unknowns: Vec<least_squares::Unknown>,
    /// Start values.
    pub begun: Vec<f64>,
    pub solution: least_squares::Solution,
    pub realigned: [bool; 2],
    pub left_out: usize,
}

/// Aligns and fits one recording.
pub(super) fn search(problem: &mut Recorded, task: &Task) -> Result<Searched, CalibrateError> {
    let mut unknowns =
        problem.sought.iter().map(|s| s.unknown(task.scene, task.wanted)).collect::<Result<Vec<_>, _>>()?;
    let begun: Vec<f64> = unknowns.iter().map(|u| u.start).collect();
    let mut first = problem.first(0.0)?;
    if problem.makes_steady(&first) {
        first = problem.first(0.0)?;
    }
    let mut realigned = [Sought::Contact, Sought::Clock].map(|s| problem.sought.contains(&s));
    let before = first.alignment_of(rows_of(task, &first));
    let mut shift = [0.0; 2];
    if let Some(found) = &before {
        realigned = [realigned[0] || found.contact_is_off(), realigned[1] || found.clock_is_off()];
        shift = starts(found, realigned);
        add(problem, &mut unknowns, task, shift, realigned)?;
        if shift[0] != 0.0 {
            first = problem.first(shift[0])?;
        }
    }
    problem.take(&first, shift[1])?;
    problem.keep(&first, shift[0]);
    if let Some(found) = &before {
        problem.begin_at_size(found.size, &mut unknowns);
    }
    problem.begin_in_table(&mut unknowns)?;
    let mut solution = least_squares::solve(problem, &unknowns)?.ok_or_else(|| problem.beyond_start())?;
    for _ in 0..MOST_CLOUDS {
        if problem.makes_anew(&solution.x)? {
            unknowns.iter_mut().zip(&solution.x).for_each(|(u, x)| u.start = *x);
            solution = again(problem, &unknowns, &solution)?;
        }
    }
    // with a force of the right shape the alignment is more accurate
    let seen = aligned(problem, &solution.x)?;
    if let Some(found) = &seen {
        let off = [realigned[0] || found.contact_is_off(), realigned[1] || found.clock_is_off()];
        if off != realigned {
            realigned = off;
            unknowns.iter_mut().zip(&solution.x).for_each(|(u, x)| u.start = *x);
            add(problem, &mut unknowns, task, starts(found, realigned), realigned)?;
            solution = again(problem, &unknowns, &solution)?;
        }
    }
    let left_out = problem.leave_out(solution.residuals.as_slice());
    if left_out > 0 {
        unknowns.iter_mut().zip(&solution.x).for_each(|(u, x)| u.start = *x);
        solution = again(problem, &unknowns, &solution)?;
    }
    Ok(Searched { unknowns, begun, solution, realigned, left_out })
}

/// Readings of a run that are fitted. Held-out readings are not used.
fn rows_of(task: &Task, run: &Run) -> Rows {
    let rows = Rows::of(run);
    let fitted = &run.answers[Parts::of(run, task.part).fitted];
    let (Some(first), Some(last)) = (fitted.first(), fitted.last()) else { return Rows::default() };
    let within = |t: f64| (first.time_s..=last.time_s).contains(&t);
    let kept = |column: &[f64]| rows.time_s.iter().zip(column).filter(|(t, _)| within(**t)).map(|(_, x)| *x).collect();
    let measured = rows.measured_n.iter().map(|m| if task.load_cell == LoadCell::Exact { m + rows.zero_n } else { *m });
    Rows {
        time_s: kept(&rows.time_s),
        depth_m: kept(&rows.depth_m),
        predicted_n: kept(&rows.predicted_n),
        measured_n: kept(&measured.collect::<Vec<f64>>()),
        zero_n: if task.load_cell == LoadCell::Exact { 0.0 } else { rows.zero_n },
        known: task.load_cell.known(),
        ..rows
    }
}

/// Continues the search.
fn again(
    problem: &mut Recorded,
    unknowns: &[least_squares::Unknown],
    before: &least_squares::Solution,
) -> Result<least_squares::Solution, CalibrateError> {
    let solution = least_squares::solve(problem, unknowns)?.ok_or_else(|| problem.beyond_start())?;
    Ok(least_squares::Solution { iterations: before.iterations + solution.iterations, ..solution })
}

/// Shifts of contact (m) and clock (s) at which the search begins.
fn starts(found: &Alignment, realigned: [bool; 2]) -> [f64; 2] {
    let at = |off: bool, value: f64| if off { value } else { 0.0 };
    [at(realigned[0], found.contact_depth_m.value), at(realigned[1], found.time_offset_s.value)]
}

/// Adds the shifts that are significant to the unknowns, starting from their estimates.
fn add(
    problem: &mut Recorded,
    unknowns: &mut Vec<least_squares::Unknown>,
    task: &Task,
    shift: [f64; 2],
    realigned: [bool; 2],
) -> Result<(), CalibrateError> {
    for (k, sought) in [Sought::Contact, Sought::Clock].into_iter().enumerate().filter(|(k, _)| realigned[*k]) {
        let place = problem.sought.iter().position(|s| *s == sought);
        let unknown = sought.unknown(task.scene, task.wanted)?;
        let unknown = least_squares::Unknown { start: shift[k].clamp(unknown.bounds[0], unknown.bounds[1]), ..unknown };
        match place {
            Some(place) => unknowns[place] = unknown,
            None => {
                problem.seek(sought);
                unknowns.push(unknown);
            }
        }
    }
    Ok(())
}

/// Alignment of the recording with the model at the values x: that of the last run plus the shifts that it contains.
pub(super) fn aligned(problem: &mut Recorded, x: &[f64]) -> Result<Option<Alignment>, CalibrateError> {
    let forces = problem.forces(x)?;
    let rows: Rows = problem.rows(&forces, &forces.model_n, x);
    let clock = problem.value(x, &Sought::Clock);
    let Some(path) = problem.path() else { return Ok(None) };
    // the depths of the run already contain the contact shift; the clock shift is removed from the readings here
    let rows = Rows { time_s: rows.time_s.iter().map(|t| t - clock).collect(), ..rows };
    let zero =
        x[..].iter().zip(&problem.sought).find(|(_, s)| matches!(s, Sought::Zero { .. })).map_or(0.0, |(x, _)| *x);
    let shift = [problem.value(x, &Sought::Contact), clock];
    Ok(align(path, &rows, &problem.beside()).map(|mut found| {
        found.contact_depth_m.value += shift[0];
        found.time_offset_s.value += shift[1];
        found.force_zero_n.value += zero;
        found
    }))
}
