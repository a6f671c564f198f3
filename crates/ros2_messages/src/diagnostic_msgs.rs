//! Package `diagnostic_msgs`.

use super::{ros_messages, std_msgs::Header};
use serde::{Deserialize, Serialize};

/// A label and a value, both text.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct KeyValue {
    /// Label.
    pub key: String,
    /// Value.
    pub value: String,
}

/// State of one component.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct DiagnosticStatus {
    /// One of the constants of this type.
    pub level: u8,
    /// What this is about, `twin: rate`.
    pub name: String,
    /// One line.
    pub message: String,
    /// Which piece of hardware.
    pub hardware_id: String,
    /// Numbers behind it.
    pub values: Vec<KeyValue>,
}

impl DiagnosticStatus {
    /// All is well.
    pub const OK: u8 = 0;
    /// Needs attention.
    pub const WARN: u8 = 1;
    /// Does not work.
    pub const ERROR: u8 = 2;
    /// No news for too long.
    pub const STALE: u8 = 3;
}

/// States of several components.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct DiagnosticArray {
    /// When.
    pub header: Header,
    /// The states.
    pub status: Vec<DiagnosticStatus>,
}

ros_messages!("diagnostic_msgs": KeyValue, DiagnosticStatus, DiagnosticArray);
