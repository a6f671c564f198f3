//! Output of the node on its live page, and the commands of viewers with the token.

use std::net::{IpAddr, Ipv4Addr};
use std::sync::Arc;

use crossbeam_channel::Receiver;
use serde_json::{Value, json};

use super::answer::{Model, Snapshot};
use super::declared;
use super::shared::{Banded, Compared, Live, Shared};
use crate::live::{self, Asked, Server};
pub(super) use crate::live::{Board, Command};
use needle_core::scene::{Instrument, InstrumentKind, Scene};
use needle_report::region_colour;
use ros2_guarded::Bell;
use ros2_messages::needle_twin::TwinStatus;
use ros2_node::parameters::Parameters;
use ros2_node::recorder::RECORD;
use ros2_node::start::NodeError;

/// Queue length of commands for the housekeeping thread.
const WAITING: usize = 8;
/// A comparison older than this relative to the newest answer is not shown, ns.
const OLD_NANOS: i64 = 500_000_000;

/// A page that is served.
pub(super) struct Page {
    pub board: Arc<Board>,
    asked: Receiver<Asked>,
    /// Whether there is a recording.
    recorded: bool,
    _server: Server,
}

impl Page {
    /// Serves the page, if the parameters enable it.
    ///
    /// # Errors
    /// [`NodeError`] if the port is in use.
    pub(crate) fn open(parameters: &Parameters, shared: &Arc<Shared>, bell: Bell) -> Result<Option<Self>, NodeError> {
        if !parameters.get(declared::PAGE) {
            return Ok(None);
        }
        let address = parameters.get(declared::PAGE_ADDRESS).parse().unwrap_or(IpAddr::V4(Ipv4Addr::LOCALHOST));
        let port = u16::try_from(parameters.get(declared::PAGE_PORT)).unwrap_or(0);
        if !address.is_loopback() {
            tracing::warn!(
                "page_address {address}: whoever reaches this machine can watch, and read the token on the way of whoever \
                 uses it, since nothing is encrypted"
            );
        }
        let (sender, asked) = crossbeam_channel::bounded(WAITING);
        let board = Arc::new(Board::default());
        let figures = {
            let shared = Arc::clone(shared);
            move || figures(&shared.lock()).to_string()
        };
        let server = Server::start((address, port), Arc::clone(&board), figures, sender, move || bell.ring())
            .map_err(|e| NodeError::Other(e.to_string()))?;
        tracing::info!("live page: {} (read-only: {})", server.url_with_token(), server.url());
        let recorded = !parameters.get(RECORD).is_empty();
        Ok(Some(Self { board, asked, recorded, _server: server }))
    }

    /// A viewer's command, if there is one.
    pub(crate) fn asked(&self) -> Option<Asked> {
        self.asked.try_recv().ok()
    }

    /// Shows phase, pace, latency, health.
    pub(crate) fn status(&self, message: &TwinStatus, residual_band_n: f64) {
        let mut status = serde_json::to_value(message).unwrap_or_default();
        status["kind"] = json!("status");
        status["residual_band_n"] = json!(residual_band_n);
        status["recorded"] = json!(self.recorded);
        self.board.status(status.to_string());
    }
}

/// Shows the sample.
pub(super) fn model(board: &Board, model: &Model) {
    let mut about = json!({
        "scene": model.scene,
        "model_id": model.id.to_string(),
        "nodes": model.nodes,
        "instrument": model.instrument,
        "targets": model.target_names,
        "target_references_m": model.target_references,
    });
    let Model { points, surface, cells, region, .. } = model;
    if !region.is_empty() {
        let named = (0..).zip(model.along.names());
        about["regions"] = named.map(|(i, name)| json!({ "name": name, "colour": region_colour(i) })).collect();
    }
    board.model(&live::Model { points, surface, cells, region, about: &about });
}

/// Shows the sample at one time.
pub(super) fn tissue(board: &Board, snapshot: &Snapshot) {
    let Snapshot { depth_m, tip, axis, targets, displacements, .. } = snapshot;
    board.tissue(&live::Frame { depth_m: *depth_m, tip: *tip, axis: *axis, targets, displacements });
}

/// The instrument in the format of the page, lengths in m.
pub(super) fn instrument(scene: &Scene, points: &[[f64; 3]]) -> Value {
    let Some(Instrument { kind, entry, .. }) = &scene.instrument else { return Value::Null };
    let across = || points.iter().map(|p| p[0].hypot(p[1])).fold(0.0, f64::max);
    let (kind, radius) = match kind {
        InstrumentKind::Plate => ("plate", across()),
        InstrumentKind::Indenter { diameter, .. } => ("indenter", 0.5 * diameter.get()),
        InstrumentKind::Needle(needle) => ("needle", 0.5 * needle.diameter.get()),
    };
    json!({ "kind": kind, "radius": radius, "x": entry[0].get(), "y": entry[1].get() })
}

/// The newest point of the curves, and the events since the start of the run.
#[allow(clippy::cast_precision_loss)] // seconds of one run
fn figures(live: &Live) -> Value {
    let origin = live.first_stamp_nanos.unwrap_or(0);
    let seconds = |nanos: i64| (nanos - origin) as f64 * 1e-9;
    let events: Vec<_> = live
        .events
        .iter()
        .map(|e| json!({ "time_s": seconds(e.stamp_nanos), "depth_m": e.depth_m, "kind": e.kind, "text": e.text }))
        .collect();
    let mut figures = json!({ "kind": "figures", "run": origin.to_string(), "events": events });
    let Some(answer) = &live.last else { return figures };
    let stamp = answer.stamp.nanos();
    // A band from before a reset does not belong to this run.
    let of_run = |band: &Banded| (origin..=stamp).contains(&band.stamp_nanos);
    // without members the error of the model
    let of_model = || {
        let (force_n, error_n) = (answer.predicted_n(), answer.prediction.model_error_n());
        Banded { stamp_nanos: stamp, low_n: force_n - error_n, high_n: force_n + error_n }
    };
    let members = live.band.filter(of_run);
    let name = if members.is_some() { "95 % of the members" } else { "error of the model" };
    let Banded { stamp_nanos, low_n, high_n } = members.unwrap_or_else(of_model);
    figures["band"] = json!({ "name": name, "time_s": seconds(stamp_nanos), "low_n": low_n, "high_n": high_n });
    let compared = live.compared.filter(|c| stamp - c.stamp_nanos < OLD_NANOS);
    let point = compared.unwrap_or_else(|| Compared {
        stamp_nanos: stamp,
        depth_m: answer.prediction.depth_m,
        predicted_n: answer.predicted_n(),
        measured_n: f64::NAN,
    });
    figures["point"] = json!({
        "time_s": seconds(point.stamp_nanos),
        "depth_m": point.depth_m,
        "predicted_n": point.predicted_n,
        "measured_n": point.measured_n, // null if there is none
        "phase": answer.prediction.phase.as_str(),
        "region": live.region(),
    });
    figures["spring"] = json!(live.against_spring.map(|so_far| so_far.words()));
    figures
}
