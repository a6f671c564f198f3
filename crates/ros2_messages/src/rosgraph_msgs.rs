//! Package `rosgraph_msgs`.

use super::{builtin_interfaces::Time, ros_messages};
use serde::{Deserialize, Serialize};

/// Simulated time, on `/clock`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Clock {
    /// The time.
    pub clock: Time,
}

ros_messages!("rosgraph_msgs": Clock);
