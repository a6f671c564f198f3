//! How a Zenoh session is opened.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

/// What the user says of it; the rest is as rmw_zenoh_cpp has it.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ZenohSession {
    /// A Zenoh configuration in JSON5 that takes the place of the built-in one.
    pub config_file: Option<PathBuf>,
    /// `key=value` in JSON5, separated by `;`, on top of it.
    pub overrides: String,
    /// For so many seconds a router is looked for; for ever if 0, not at all if negative.
    pub router_checks: i64,
}
