//! Package `std_srvs`: request and response of each service.

use serde::{Deserialize, Serialize};

/// Request of `Trigger`: empty, which CDR writes as one octet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TriggerRequest {
    /// Always 0.
    pub structure_needs_at_least_one_member: u8,
}

/// Response of `Trigger`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TriggerResponse {
    /// Whether it was done.
    pub success: bool,
    /// What happened, or why not.
    pub message: String,
}
