//! Package `builtin_interfaces`.

use super::ros_messages;
use serde::{Deserialize, Serialize};

/// A point in time: s and ns since the clock's origin (1970 for wall time).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Time {
    /// Seconds.
    pub sec: i32,
    /// Nanoseconds on top, in [0, 1e9).
    pub nanosec: u32,
}

/// A span of time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Duration {
    /// Seconds.
    pub sec: i32,
    /// Nanoseconds on top, in [0, 1e9).
    pub nanosec: u32,
}

impl Time {
    /// Time from nanoseconds; saturates where 32-bit seconds end (year 2038).
    #[must_use]
    pub fn from_nanos(nanos: i64) -> Self {
        let sec = nanos.div_euclid(1_000_000_000).clamp(i64::from(i32::MIN), i64::from(i32::MAX));
        Self { sec: sec as i32, nanosec: nanos.rem_euclid(1_000_000_000) as u32 }
    }

    /// Nanoseconds since the origin.
    #[must_use]
    pub fn nanos(self) -> i64 {
        i64::from(self.sec) * 1_000_000_000 + i64::from(self.nanosec)
    }

    /// Seconds since the origin. For wall time it resolves 0.2 us: subtract two times in nanoseconds first.
    #[must_use]
    pub fn seconds(self) -> f64 {
        f64::from(self.sec) + f64::from(self.nanosec) * 1e-9
    }

    /// True for the zero stamp, which means "not stamped" or "clock not started".
    #[must_use]
    pub fn is_zero(self) -> bool {
        self == Self::default()
    }
}

impl Duration {
    /// Duration from nanoseconds; saturates where 32-bit seconds end.
    #[must_use]
    pub fn from_nanos(nanos: i64) -> Self {
        let Time { sec, nanosec } = Time::from_nanos(nanos);
        Self { sec, nanosec }
    }

    /// Nanoseconds.
    #[must_use]
    pub fn nanos(self) -> i64 {
        Time { sec: self.sec, nanosec: self.nanosec }.nanos()
    }
}

ros_messages!("builtin_interfaces": Time, Duration);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nanoseconds_and_back() {
        for nanos in [0, 1, 999_999_999, 1_000_000_000, -1, -1_000_000_001, 1_700_000_000_123_456_789] {
            assert_eq!(Time::from_nanos(nanos).nanos(), nanos);
            assert_eq!(Duration::from_nanos(nanos).nanos(), nanos);
        }
        assert_eq!(Time::from_nanos(i64::MAX).sec, i32::MAX);
    }
}
