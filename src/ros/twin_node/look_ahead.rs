//! The look-ahead thread: answers `~/look_ahead` with a double of the twin, at a lower priority than the twin's own.
//!
//! ```text
//! request ──► inbox ──► solver thread: state copied between two poses ──► this thread: the motion ──► response
//! ```
//! The double belongs to the solver, goes out with its state and comes back through the inbox.

use std::time::{Duration, Instant};

use crossbeam_channel::Receiver;

use super::force::is_finite;
use super::inbox::Inbox;
use crate::ros::messages::builtin_interfaces::Time;
use crate::ros::messages::needle_twin::{LookAheadRequest, LookAheadResponse};
use crate::ros::messages::std_msgs::Header;
use crate::ros::service::Service;
use crate::ros::threads::lower_priority;
use crate::twin::{Motion, Prediction, StampedPose, Twin};

/// The solver thread is asked between two poses; longer than this and something else is wrong.
const PATIENCE: Duration = Duration::from_millis(500);
/// Speed of a motion that names none, m/s.
const SPEED_M_PER_S: f64 = 0.001;
/// Farther than any sample is deep, m.
const FARTHEST_M: f64 = 1.0;

/// A double of the twin with the state of one moment.
#[derive(Debug)]
pub(super) struct Double {
    pub twin: Twin,
    /// Where the motion starts: the last pose that was answered.
    pub from: Option<StampedPose>,
    /// Its stamp.
    pub stamp: Time,
    pub depth_m: f64,
    /// Which of the models that the solver has built this is a double of.
    pub generation: u64,
}

/// The double, or why there is none to be had.
pub(super) type Departure = Result<Box<Double>, &'static str>;
/// The service.
pub(super) type LookAhead = Service<LookAheadRequest, LookAheadResponse>;

/// Runs until `stop` is closed.
pub(super) fn run(
    service: &LookAhead,
    frame_id: &str,
    inbox: &Inbox,
    departures: &Receiver<Departure>,
    stop: &smol::channel::Receiver<()>,
) {
    lower_priority();
    let mut thread = LookAheadThread { frame_id, inbox, departures, way: Vec::new() };
    loop {
        let stopped = async {
            // The channel is closed, never written to.
            let _ = stop.recv().await;
            None
        };
        let Some((caller, request)) = smol::block_on(smol::future::or(stopped, async { Some(service.next().await) }))
        else {
            return;
        };
        service.send(caller, &thread.answer(&request));
    }
}

struct LookAheadThread<'a> {
    frame_id: &'a str,
    inbox: &'a Inbox,
    departures: &'a Receiver<Departure>,
    way: Vec<Prediction>,
}

impl LookAheadThread<'_> {
    fn answer(&mut self, request: &LookAheadRequest) -> LookAheadResponse {
        let begun = Instant::now();
        match self.look(request) {
            Ok(response) => LookAheadResponse { computed_s: begun.elapsed().as_secs_f64(), ..response },
            Err(message) => LookAheadResponse { message, ..LookAheadResponse::default() },
        }
    }

    fn look(&mut self, request: &LookAheadRequest) -> Result<LookAheadResponse, String> {
        let motion = motion(request)?;
        // One that came too late for an earlier request.
        while let Ok(departure) = self.departures.try_recv() {
            self.give_back(departure);
        }
        self.inbox.look_ahead();
        let mut double = self
            .departures
            .recv_timeout(PATIENCE)
            .map_err(|_| "the solver is busy (is the model being built?): ask again".to_owned())??;
        let outcome = self.go(&mut double, &motion);
        self.inbox.give_back(double);
        outcome
    }

    fn give_back(&self, departure: Departure) {
        if let Ok(double) = departure {
            self.inbox.give_back(double);
        }
    }

    fn go(&mut self, double: &mut Double, motion: &Motion) -> Result<LookAheadResponse, String> {
        let from = double.from.ok_or("no pose has been answered yet: move the instrument first")?;
        double.twin.look_ahead(&from, motion, &mut self.way).map_err(|halt| halt.to_string())?;
        let mut targets = Vec::new();
        double.twin.target_positions(&mut targets);
        if !(self.way.iter().all(is_finite) && targets.iter().flatten().all(|x| x.is_finite())) {
            return Err("the prediction is not finite".to_owned());
        }
        let axis = from.pose.axis;
        let force = |p: &Prediction| -(0..3).map(|k| p.force_n[k] * axis[k]).sum::<f64>();
        let forces_n: Vec<f64> = self.way.iter().map(force).collect();
        Ok(LookAheadResponse {
            success: true,
            message: String::new(),
            header: Header { stamp: double.stamp, frame_id: self.frame_id.to_owned() },
            depth_m: double.depth_m,
            depths_m: self.way.iter().map(|p| p.depth_m).collect(),
            peak_force_n: forces_n.iter().copied().fold(f64::NEG_INFINITY, f64::max),
            forces_n,
            targets: targets.into_iter().map(Into::into).collect(),
            computed_s: 0.0,
        })
    }
}

/// The motion that is asked for.
fn motion(request: &LookAheadRequest) -> Result<Motion, String> {
    let LookAheadRequest { distance_m, speed_m_per_s } = *request;
    if !(distance_m.abs() > 0.0 && distance_m.abs() <= FARTHEST_M) {
        return Err(format!("distance_m is {distance_m}: give a distance up to {FARTHEST_M} m, not 0"));
    }
    if !(speed_m_per_s >= 0.0 && speed_m_per_s.is_finite()) {
        return Err(format!("speed_m_per_s is {speed_m_per_s}: give a speed in m/s, or 0 for {SPEED_M_PER_S}"));
    }
    let speed = if speed_m_per_s > 0.0 { speed_m_per_s } else { SPEED_M_PER_S };
    Ok(Motion::new(distance_m, speed))
}
