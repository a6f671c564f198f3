//! The interval that a number must lie in, and how it is said.

use std::fmt;

/// An interval of real numbers. NaN and the infinities are never inside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// Lower end.
    pub low: f64,
    /// Whether the lower end itself is allowed.
    pub low_allowed: bool,
    /// Upper end.
    pub high: f64,
    /// Whether the upper end itself is allowed.
    pub high_allowed: bool,
}

impl Range {
    /// `(low, high)`
    #[must_use]
    pub(crate) const fn open(low: f64, high: f64) -> Self {
        Self { low, low_allowed: false, high, high_allowed: false }
    }

    /// `[low, high]`
    #[must_use]
    pub(crate) const fn closed(low: f64, high: f64) -> Self {
        Self { low, low_allowed: true, high, high_allowed: true }
    }

    /// `[low, high)`
    #[must_use]
    pub(crate) const fn below(low: f64, high: f64) -> Self {
        Self { low, low_allowed: true, high, high_allowed: false }
    }

    /// `(low, high]`
    #[must_use]
    pub(crate) const fn above(low: f64, high: f64) -> Self {
        Self { low, low_allowed: false, high, high_allowed: true }
    }

    /// Whether a number is inside.
    #[must_use]
    pub fn contains(&self, x: f64) -> bool {
        let above = x > self.low || (self.low_allowed && x == self.low);
        let below = x < self.high || (self.high_allowed && x == self.high);
        x.is_finite() && above && below
    }
}

impl fmt::Display for Range {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let left = if self.low_allowed { '[' } else { '(' };
        let right = if self.high_allowed { ']' } else { ')' };
        write!(f, "{left}{}, {}{right}", plain(self.low), plain(self.high))
    }
}

/// A number without a tail of zeros.
fn plain(x: f64) -> String {
    if x.abs() < 1e5 { x.to_string() } else { format!("{x:e}") }
}
