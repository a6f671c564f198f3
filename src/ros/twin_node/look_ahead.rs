//! The look-ahead thread: answers `~/look_ahead` with a scratch copy of the twin, at a lower priority than the
//! twin's.
//!
//! ```text
//! request ──► inbox ──► solver thread: state copied between two poses ──► this thread: the motion ──► response
//! ```
//! The scratch copy belongs to the solver. It is sent out with the solver's state and returned through the inbox.

use std::time::{Duration, Instant};

use crossbeam_channel::Receiver;

use super::answer::is_finite;
use super::inbox::{Departure, Double, Inbox};
use super::shared::Shared;
use named_threads::lower_priority;
use needle_core::twin::{Motion, Prediction, StampedPose};
use ros2_messages::needle_twin::{LookAheadRequest, LookAheadResponse};
use ros2_messages::std_msgs::Header;
use ros2_node::service::Service;

/// Time limit for the solver thread, which answers between two poses.
const PATIENCE: Duration = Duration::from_millis(500);
/// Default speed of a motion, m/s.
const SPEED_M_PER_S: f64 = 0.001;
/// Wall time for the steps of one answer, s: the rest of 50 ms is for the transfers.
const BUDGET_S: f64 = 0.035;
/// With fewer steps the inertia of the tissue affects the force (by a third with 50 steps per millimetre of the
/// needle in three dimensions). A model with slow steps answers late rather than wrongly.
const FEWEST_STEPS: f64 = 200.0;
/// Limit of the distance, m: larger than the depth of any sample.
const FARTHEST_M: f64 = 1.0;
/// Length of a piece of the scene's own motion that is evaluated at once, m, and the wall time for all pieces.
const PIECE_M: f64 = 1e-3;
const OWN_MOTION: Duration = Duration::from_secs(1);
/// Depth over which a change of the force is evaluated, m. Over shorter distances, the oscillation of the tissue in a
/// motion with few steps would matter.
const SLOPE_OVER_M: f64 = 2.5e-4;
/// Interval of the checks for a model.
const NO_MODEL_YET: Duration = Duration::from_millis(200);

/// The service.
pub(super) type LookAhead = Service<LookAheadRequest, LookAheadResponse>;

/// The scene's own motion, from which the effect of a delay is estimated.
#[derive(Clone, Copy, Debug)]
pub(super) struct OwnMotion {
    pub depth_m: f64,
    pub speed_m_per_s: f64,
}

/// Runs until `stop` is closed.
pub(super) fn run(
    service: &LookAhead,
    frame_id: &str,
    inbox: &Inbox,
    departures: &Receiver<Departure>,
    stop: &smol::channel::Receiver<()>,
    shared: &Shared,
    mut own: Option<OwnMotion>,
) {
    lower_priority();
    let mut thread = LookAheadThread { frame_id, inbox, departures, way: Vec::new(), step_s: 0.0 };
    loop {
        let stopped = async {
            // The channel is only closed, never written to.
            let _ = stop.recv().await;
            None
        };
        let asked = async { Some(Some(service.next().await)) };
        let later = async {
            match own {
                Some(_) => drop(smol::Timer::after(NO_MODEL_YET).await),
                None => std::future::pending().await,
            }
            Some(None)
        };
        match smol::block_on(smol::future::or(stopped, smol::future::or(asked, later))) {
            None => return,
            Some(Some((caller, request))) => service.send(caller, &thread.answer(&request)),
            Some(None) => {
                if let Some(motion) = own
                    && let Ok(steepest) = thread.steepest(motion)
                {
                    own = None;
                    say_delay(shared, motion, &steepest);
                }
            }
        }
    }
}

/// Largest derivative of the force by the depth along the scene's own motion, N/m, and the evaluated depth, m.
struct Steepest {
    n_per_m: f64,
    depth_m: f64,
}

/// Largest derivative of a force (N) by the depth (m), N/m.
fn steepest(curve: &[(f64, [f64; 3])]) -> f64 {
    let mut most = 0.0_f64;
    for (i, (depth_m, force_n)) in curve.iter().enumerate() {
        let Some((from_m, before_n)) = curve[..i].iter().rev().find(|(from_m, _)| depth_m - from_m >= SLOPE_OVER_M)
        else {
            continue;
        };
        let change_n = (0..3).map(|k| (force_n[k] - before_n[k]).powi(2)).sum::<f64>().sqrt();
        most = most.max(change_n / (depth_m - from_m));
    }
    most
}

/// Logs the effect of the tolerated delay.
fn say_delay(shared: &Shared, motion: OwnMotion, steepest: &Steepest) {
    let timeout_s = shared.settings().guard_timeout_s;
    let distance_m = timeout_s * motion.speed_m_per_s;
    shared.lock().steepest_n_per_m = steepest.n_per_m;
    tracing::info!(
        "safety is a yes on poses up to {:.0} ms old (guard_timeout_s): at the scene's {:.1} mm/s these are {:.3} mm, and at most {:.2} mN where \
         the force changes most down to {:.1} mm",
        1e3 * timeout_s,
        1e3 * motion.speed_m_per_s,
        1e3 * distance_m,
        1e3 * distance_m * steepest.n_per_m,
        1e3 * steepest.depth_m
    );
}

struct LookAheadThread<'a> {
    frame_id: &'a str,
    inbox: &'a Inbox,
    departures: &'a Receiver<Departure>,
    way: Vec<Prediction>,
    /// Recent wall time of one explicit step in this thread, s.
    step_s: f64,
}

impl LookAheadThread<'_> {
    fn answer(&mut self, request: &LookAheadRequest) -> LookAheadResponse {
        let begun = Instant::now();
        match self.look(request) {
            Ok(response) => LookAheadResponse { computed_s: begun.elapsed().as_secs_f64(), ..response },
            Err(message) => LookAheadResponse { message, ..LookAheadResponse::default() },
        }
    }

    /// Evaluates the scene's own motion, as far as the time allows.
    fn steepest(&mut self, own: OwnMotion) -> Result<Steepest, String> {
        let mut double = self.borrow()?;
        let mut from = double.from.unwrap_or_else(|| StampedPose { time_s: 0.0, pose: double.twin.pose_at_depth(0.0) });
        let (begun, mut found) = (Instant::now(), Steepest { n_per_m: 0.0, depth_m: double.depth_m });
        let mut curve: Vec<(f64, [f64; 3])> = Vec::new();
        while found.depth_m < own.depth_m && begun.elapsed() < OWN_MOTION {
            let distance_m = PIECE_M.min(own.depth_m - found.depth_m);
            let motion = Motion::new(distance_m, own.speed_m_per_s, self.affordable(double.step_s));
            if double.twin.look_ahead(&from, &motion, &mut self.way).is_err() {
                break;
            }
            let Some(last) = self.way.last().filter(|last| is_finite(last)) else { break };
            let (time_s, depth_m) = (last.time_s, last.depth_m);
            curve.extend(self.way.iter().map(|p| (p.depth_m, p.force_n)));
            (from, found.depth_m) = (StampedPose { time_s, pose: double.twin.pose_at_depth(depth_m) }, depth_m);
        }
        self.inbox.give_back(double);
        found.n_per_m = steepest(&curve);
        Ok(found)
    }

    /// Gets the scratch copy with the present state from the solver.
    fn borrow(&mut self) -> Result<Box<Double>, String> {
        // One that came too late for an earlier request.
        while let Ok(departure) = self.departures.try_recv() {
            self.give_back(departure);
        }
        self.inbox.look_ahead();
        let departure = self.departures.recv_timeout(PATIENCE);
        Ok(departure.map_err(|_| "the solver is busy (is the model being built?): ask again".to_owned())??)
    }

    fn look(&mut self, request: &LookAheadRequest) -> Result<LookAheadResponse, String> {
        check(request)?;
        let mut double = self.borrow()?;
        let outcome = self.go(&mut double, request);
        self.inbox.give_back(double);
        outcome
    }

    /// Number of explicit steps within the time. Their cost is that of the live twin until it was measured here.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // clamped
    fn affordable(&self, step_s: f64) -> u32 {
        let step_s = if self.step_s > 0.0 { self.step_s } else { step_s };
        let steps = if step_s > 0.0 { BUDGET_S / step_s } else { f64::INFINITY };
        steps.clamp(FEWEST_STEPS, f64::from(Motion::STEPS)) as u32
    }

    fn give_back(&self, departure: Departure) {
        if let Ok(double) = departure {
            self.inbox.give_back(double);
        }
    }

    fn go(&mut self, double: &mut Double, request: &LookAheadRequest) -> Result<LookAheadResponse, String> {
        let from = double.from.ok_or("no pose has been answered yet: move the instrument first")?;
        let speed_m_per_s = if request.speed_m_per_s > 0.0 { request.speed_m_per_s } else { SPEED_M_PER_S };
        let motion = Motion::new(request.distance_m, speed_m_per_s, self.affordable(double.step_s));
        let (begun, before) = (Instant::now(), double.twin.steps());
        double.twin.look_ahead(&from, &motion, &mut self.way).map_err(|halt| halt.to_string())?;
        let steps = u32::try_from(double.twin.steps() - before).unwrap_or(u32::MAX);
        let step_s = begun.elapsed().as_secs_f64() / f64::from(steps.max(1));
        self.step_s += if self.step_s > 0.0 { 0.3 * (step_s - self.step_s) } else { step_s };
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
            steps,
            depths_m: self.way.iter().map(|p| p.depth_m).collect(),
            peak_force_n: forces_n.iter().copied().fold(f64::NEG_INFINITY, f64::max),
            forces_n,
            targets: targets.into_iter().map(Into::into).collect(),
            computed_s: 0.0,
        })
    }
}

/// Whether a requested motion is valid.
fn check(request: &LookAheadRequest) -> Result<(), String> {
    let LookAheadRequest { distance_m, speed_m_per_s } = *request;
    if !(distance_m.abs() > 0.0 && distance_m.abs() <= FARTHEST_M) {
        return Err(format!("distance_m is {distance_m}: give a distance up to {FARTHEST_M} m, not 0"));
    }
    if !(speed_m_per_s >= 0.0 && speed_m_per_s.is_finite()) {
        return Err(format!("speed_m_per_s is {speed_m_per_s}: give a speed in m/s, or 0 for {SPEED_M_PER_S}"));
    }
    Ok(())
}
