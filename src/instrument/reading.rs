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

/// Why an offset in m from the entry point at a time in s can't be that of a tip, if it can't.
#[must_use]
pub fn not_a_place(offset_m: &[f64; 3], time_s: f64) -> Option<String> {
    if !TIME_S.contains(time_s) {
        return Some(format!("its time is {time_s:e} s; a stamp is in {TIME_S} s"));
    }
    let far = offset_m.iter().find(|x| !COORDINATE_M.contains(**x))?;
    Some(format!("its tip is {far:e} m away from where the instrument meets the sample; a tip is in {COORDINATE_M} m"))
}
