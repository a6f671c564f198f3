//! Physical ranges of inputs, checked in one place for live streams and recordings.
//!
//! A number beyond these ranges is finite and no reading of an instrument: a unit that was mistaken, a broken sensor, or an
//! attack. Let in, it costs the solution (a tip 1e300 m away) or the statistics (a force of 1e200 N squared).

use crate::scene::Range;

/// Distance of the tip from where the instrument meets the sample, along each axis, m: the largest size that a scene may have.
pub const COORDINATE_M: Range = Range::closed(-10.0, 10.0);
/// A component of a measured force, N: the largest load cells that are made end at a few meganewtons.
pub const FORCE_N: Range = Range::closed(-1e7, 1e7);
/// A time, s: what a stamp in nanoseconds of 64 bits holds, 292 years on either side.
pub const TIME_S: Range = Range::closed(-1e10, 1e10);
/// Fastest motion of an instrument's tip, m/s, where the scene's own motion is not faster: twice the 0.25 m/s that ISO 10218-1
/// allows a robot beside people.
pub const SPEED_M_PER_S: f64 = 0.5;

/// Whether a load cell can have measured this force.
#[must_use]
pub fn is_force(force_n: &[f64; 3]) -> bool {
    force_n.iter().all(|f| FORCE_N.contains(*f))
}

/// Which axes of a load cell are measured, by its readings so far: an axis that was never finite is not. Drivers of cells with one axis
/// fill the others with NaN.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MeasuredAxes([bool; 3]);

impl MeasuredAxes {
    /// Takes a reading into account, N.
    pub fn note(&mut self, force_n: &[f64; 3]) {
        self.0.iter_mut().zip(force_n).for_each(|(measured, f)| *measured |= f.is_finite());
    }

    /// The reading with 0 along the axes that are not measured, N; `None` where one that is has no number.
    #[must_use]
    pub fn force(&self, force_n: [f64; 3]) -> Option<[f64; 3]> {
        let of = |k: usize| if self.0[k] { force_n[k] } else { 0.0 };
        let force = [0, 1, 2].map(of);
        (self.0 != [false; 3] && force.iter().all(|f| f.is_finite())).then_some(force)
    }

    /// The one axis that is measured, 0 to 2 for x to z, where only one is.
    #[must_use]
    pub fn only(&self) -> Option<usize> {
        let mut measured = (0..3).filter(|k| self.0[*k]);
        measured.next().filter(|_| measured.next().is_none())
    }

    /// What is not measured, in one clause, where something is and something is not.
    #[must_use]
    pub fn missing(&self) -> Option<String> {
        let names =
            |of: bool| -> Vec<&str> { (0..3).filter(|k| self.0[*k] == of).map(|k| ["x", "y", "z"][k]).collect() };
        let (measured, not) = (names(true), names(false));
        (!measured.is_empty() && !not.is_empty()).then(|| {
            format!(
                "the load cell does not measure along {} (never a number there): {} alone is used",
                not.join(" and "),
                measured.join(" and ")
            )
        })
    }
}

/// Why an offset in m from the entry point at a time in s can't be that of a tip, if it can't.
#[must_use]
pub(crate) fn not_a_place(offset_m: &[f64; 3], time_s: f64) -> Option<String> {
    if !TIME_S.contains(time_s) {
        return Some(format!("its time is {time_s:e} s; a stamp is in {TIME_S} s"));
    }
    let far = offset_m.iter().find(|x| !COORDINATE_M.contains(**x))?;
    Some(format!(
        "its tip is {far:e} m away from where the instrument meets the sample; a tip is in {COORDINATE_M} m (in mm it has to be divided by 1000)"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_axis_that_was_never_finite_is_not_measured() {
        let nan = f64::NAN;
        let mut axes = MeasuredAxes::default();
        assert_eq!((axes.force([0.0; 3]), axes.missing()), (None, None), "nothing was read yet");
        for force in [[nan, nan, nan], [nan, nan, 0.5], [f64::INFINITY, nan, nan]] {
            axes.note(&force);
        }
        assert_eq!(axes.only(), Some(2));
        assert_eq!(axes.force([nan, nan, 0.5]), Some([0.0, 0.0, 0.5]));
        assert_eq!(axes.force([nan, nan, nan]), None, "a reading of the measured axis is missing");
        assert!(axes.missing().is_some_and(|text| text.contains("along x and y") && text.contains("z alone")));
        axes.note(&[1.0, 2.0, nan]);
        assert_eq!((axes.only(), axes.missing()), (None, None));
        assert_eq!(axes.force([nan, nan, 0.5]), None);
    }
}
