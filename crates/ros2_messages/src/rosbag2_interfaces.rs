//! Package `rosbag2_interfaces`: requests and responses of the player's services (`ros2 service type ~/pause` shows
//! `rosbag2_interfaces/srv/Pause`). An empty request or response is one octet on the wire: [`Empty`].

use super::builtin_interfaces::{Duration, Time};
use serde::{Deserialize, Serialize};

/// Request and response of `Pause`, `Resume`, `TogglePaused`, `Stop`; request of `GetRate`, `IsPaused`, `PlayNext`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Empty {
    /// Always 0.
    pub structure_needs_at_least_one_member: u8,
}

/// Response of `IsPaused`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct IsPausedResponse {
    /// Whether the player is paused.
    pub paused: bool,
}

/// Response of `GetRate`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GetRateResponse {
    /// Bag seconds per wall second.
    pub rate: f64,
}

/// Request of `SetRate`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SetRateRequest {
    /// Bag seconds per wall second, above 0.
    pub rate: f64,
}

/// Request of `Seek`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SeekRequest {
    /// Bag time to go to.
    pub time: Time,
}

/// Request of `Burst`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct BurstRequest {
    /// How many messages to play at once; 0 is all.
    pub num_messages: u64,
}

/// Response of `Burst`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct BurstResponse {
    /// How many were played.
    pub actually_burst: u64,
}

/// Request of `Play`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PlayRequest {
    /// Where to start, from the bag's start.
    pub start_offset: Time,
    /// How long; negative is all.
    pub playback_duration: Duration,
    /// Until when; negative is the end.
    pub playback_until_timestamp: Time,
}

/// Response of `SetRate`, `Seek`, `PlayNext`, `Play`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Success {
    /// Whether it was done.
    pub success: bool,
}
