//! What stands in the place of Zenoh in a build without it.

use std::os::unix::net::UnixStream;
use std::sync::Arc;

use crossbeam_channel::Receiver;

use super::frames::Frames;
use super::session::ZenohSession;
use super::uplink::Uplink;
use super::wire::{Kind, Plan};

/// Refuses.
pub(super) fn run(
    _: &Plan,
    _: &ZenohSession,
    _: Frames,
    _: &UnixStream,
    uplink: &Arc<Uplink>,
    _: &Receiver<(u8, String)>,
) -> Result<(), String> {
    uplink.text(Kind::Refused, "Zenoh is not in this build: cargo build --release --features zenoh");
    Ok(())
}
