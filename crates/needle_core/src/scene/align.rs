//! `[align]`: how a recording lies to the model, as `calibrate` found it. Of a recording, not of the physics.

use super::section::section;
use super::{Key, Metres, Range, Seconds};

section! {
    /// What is taken out of a recording before it is compared: a force f with the stamp t becomes f less `zero_n` and `drift` (t - t_0), at
    /// t less `time_offset`; t_0 is the stamp of the first position. A depth becomes less by `contact_depth`.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Align when |values| values.has_section("align") => {
        /// Recorded depth of the first contact.
        contact_depth: Metres = Key::real("align.contact_depth_m", Range::closed(-10.0, 10.0), "m").or("0.0"),
        /// How late the force's stamps are against the position's.
        time_offset: Seconds = Key::real("align.time_offset_s", Range::closed(-1e9, 1e9), "s").or("0.0"),
        /// What the load cell reads without load, at the first position.
        zero_n: f64 = Key::real("align.force_zero_n", Range::closed(-1e9, 1e9), "N").or("0.0"),
        /// Change of that with time.
        drift_n_per_s: f64 = Key::real("align.force_drift_n_per_s", Range::closed(-1e9, 1e9), "N/s").or("0.0"),
    }
}

impl Align {
    /// A recording that lies as the model does.
    pub const NONE: Self =
        Self { contact_depth: Metres(0.0), time_offset: Seconds(0.0), zero_n: 0.0, drift_n_per_s: 0.0 };

    /// This first, then another one of what it leaves.
    #[must_use]
    pub fn then(self, next: Self) -> Self {
        Self {
            contact_depth: Metres(self.contact_depth.get() + next.contact_depth.get()),
            time_offset: Seconds(self.time_offset.get() + next.time_offset.get()),
            zero_n: self.zero_n + next.zero_n - next.drift_n_per_s * self.time_offset.get(),
            drift_n_per_s: self.drift_n_per_s + next.drift_n_per_s,
        }
    }
}

/// As a person reads it.
impl std::fmt::Display for Align {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { contact_depth, time_offset, zero_n, drift_n_per_s } = self;
        write!(
            f,
            "contact at a recorded {:.4} mm, force {:.2} ms late",
            1e3 * contact_depth.get(),
            1e3 * time_offset.get()
        )?;
        write!(f, ", load cell's zero {zero_n:.6} N, drift {drift_n_per_s:.2e} N/s")
    }
}
