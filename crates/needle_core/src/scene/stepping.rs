//! `[stepping]`: how poses become explicit steps.

use super::section::section;
use super::{Key, Range};

section! {
    /// How poses become explicit steps.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Stepping => {
        /// Tolerated relative error of the force from too few steps; `auto`: the scene's accuracy.
        tolerance: Option<f64> = Key::real("stepping.tolerance", Range::open(0.0, 1.0), "").or_auto().live(),
        /// Fraction of the largest stable step that is used; 1 and more are for studies of what happens then. With less than a
        /// hundredth the tissue has no time to come to rest, and the force can be wrong while instrument and base agree.
        step_factor: f64 = Key::real("stepping.step_factor", Range::below(0.01, 2.0), "").or("0.9"),
        /// Largest number of explicit steps for one pose; of a needle with friction for each fiftieth of its radius of way, or one pose that is shorter.
        max_steps_per_pose: u32 = Key::integer("stepping.max_steps_per_pose", 1, 1_000_000).or("2000").live(),
        /// Smallest number of explicit steps for a moving pose.
        min_steps_per_pose: u32 = Key::integer("stepping.min_steps_per_pose", 1, 1_000_000).or("1").live(),
    }
}
