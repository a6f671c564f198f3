//! The health of the twin, whether its prediction is valid, and the reasons.

use super::declared::Settings;
use super::rivals::REMEDY;
use super::shared::{Doubt, Live, Shared};
use needle_core::twin::Health;
use ros2_messages::needle_twin::{ForceComparison, TwinStatus};
use ros2_node::clock::NodeClock;
use ros2_node::lifecycle::State;

/// Health and the reasons for it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Judgement {
    pub health: u8,
    pub reasons: Vec<String>,
    /// Those reasons for which the prediction is not valid.
    pub denials: Vec<String>,
    /// Whether another twin publishes on the same topics, so that readers can't distinguish the forces.
    pub contested: bool,
}

impl Judgement {
    fn add(&mut self, health: u8, reason: String) {
        self.health = worse(self.health, health);
        if health > TwinStatus::HEALTH_WARN {
            self.denials.push(reason.clone());
        }
        self.reasons.push(reason);
    }

    /// Whether the twin answers every pose with a valid force.
    pub(crate) fn vouches(&self) -> bool {
        self.health <= TwinStatus::HEALTH_WARN && !self.contested
    }
}

/// The housekeeping thread's own observations, in addition to the shared figures.
#[derive(Clone, Debug, Default)]
pub(super) struct Around {
    /// Number of messages that reliable readers were too slow for.
    pub failed_outputs: u64,
    /// Whether simulated time is used without a publisher.
    pub clock_gone: bool,
    /// Why the middleware process was replaced, if that was recent.
    pub replaced: Option<String>,
}

/// ERROR is worse than STALE, which is worse than WARN.
fn worse(a: u8, b: u8) -> u8 {
    let rank = |h| match h {
        TwinStatus::HEALTH_ERROR => 3,
        TwinStatus::HEALTH_STALE => 2,
        other => u8::from(other == TwinStatus::HEALTH_WARN),
    };
    if rank(a) >= rank(b) { a } else { b }
}

#[allow(clippy::cast_precision_loss)] // counts, shown as a percentage
pub(super) fn judge(live: &Live, shared: &Shared, settings: &Settings, around: &Around) -> Judgement {
    let mut judgement = Judgement { contested: !live.rivals.is_empty(), ..Judgement::default() };
    let clock = &shared.clock;
    if let Some(reason) = not_active(shared.state()) {
        judgement.add(TwinStatus::HEALTH_STALE, reason);
    }
    if let Some(reason) = &live.halted {
        judgement.add(TwinStatus::HEALTH_ERROR, format!("{reason}: retract the instrument, or call ~/reset"));
    }
    if let Some(reason) = &live.dying {
        judgement.add(TwinStatus::HEALTH_ERROR, format!("the node ends: {reason}"));
    }
    if let Some(stuck_s) = live.stuck_s {
        let limit = settings.solver_timeout_s;
        judgement.add(
            TwinStatus::HEALTH_ERROR,
            format!(
                "the solver has not come back from a pose for {stuck_s:.1} s, and predicted_cf is silent; after {limit} s \
                 (solver_timeout_s) the node ends"
            ),
        );
    }
    if judgement.contested {
        let who = live.rivals.join(", ");
        let reason = format!("another twin ({who}) speaks here: {REMEDY}");
        judgement.denials.push(reason.clone());
        judgement.add(TwinStatus::HEALTH_WARN, reason);
    }
    if let Some(depth_m) = live.first_seen_m {
        judgement.add(
            TwinStatus::HEALTH_WARN,
            format!(
                "the instrument was {depth_m:.4} m deep already when the first pose came: its way there and the puncture \
                 were not seen. Retract it and call ~/reset for a prediction with its history"
            ),
        );
    }
    if let Some(reason) = not_there_yet(live) {
        judgement.add(TwinStatus::HEALTH_STALE, reason);
    }
    let silent = live.silence_s(clock, around.clock_gone);
    if silent.is_none_or(|s| s > settings.input_timeout_s) {
        judgement.add(TwinStatus::HEALTH_STALE, silence(silent, clock, around));
    }
    let window = &live.last_window;
    if window.withheld > 0 {
        judgement.add(
            TwinStatus::HEALTH_ERROR,
            format!(
                "{} answers of the last second came later than input_timeout_s after their pose and were withheld: \
                 choose a coarser discretisation or fewer steps",
                window.withheld
            ),
        );
    } else if window.coalesced * 10 > window.received {
        let share = 100.0 * window.coalesced as f64 / window.received.max(1) as f64;
        judgement.add(TwinStatus::HEALTH_WARN, skipped(live, share));
    }
    if window.rejected > 0 {
        let most = live.rejects.iter().max_by_key(|(_, n)| **n).map_or("", |(why, _)| why.word());
        judgement
            .add(TwinStatus::HEALTH_WARN, format!("{} poses refused in the last second ({most})", window.rejected));
    }
    let folded = live.last.map_or(0.0, |answer| answer.prediction.health.folded_energy);
    if folded >= Health::MOST_FOLDED {
        let share = 100.0 * folded;
        judgement.add(
            TwinStatus::HEALTH_WARN,
            format!(
                "{share:.0}% of the strain energy is in cells that have turned over: the tissue is crushed further than the cloud \
                 resolves, and the force may be off by as much. Retract the instrument, or choose a finer discretisation"
            ),
        );
    }
    for (doubt, words) in live.doubts(settings.input_timeout_s) {
        // a topic without stamps is as usable as the network for a prediction, and was reported once
        if !matches!(doubt, Doubt::Unstamped(_)) {
            judgement.add(TwinStatus::HEALTH_WARN, format!("{} {words}", doubt.topic()));
        }
    }
    if let Some(reason) = clocks_differ(live, settings.time_offset_s) {
        judgement.add(TwinStatus::HEALTH_WARN, reason);
    }
    if let Some(reason) = load_cell_problem(live) {
        judgement.add(TwinStatus::HEALTH_WARN, reason.to_owned());
    }
    if let Some((residual_n, ..)) = live.residual
        && settings.residual_band_n > 0.0
        && residual_n.abs() > 0.5 * settings.residual_band_n
    {
        let band = settings.residual_band_n;
        judgement.add(
            TwinStatus::HEALTH_WARN,
            format!(
                "predicted and measured force differ by {residual_n:.4} N, more than half of residual_band_n ({band} N): \
                 the tissue is not as modelled, or the load cell is not tared"
            ),
        );
    }
    for warning in &live.warnings {
        judgement.add(TwinStatus::HEALTH_WARN, warning.clone());
    }
    if let Some(reason) = live.identified.as_ref().map(|i| i.reason.as_str()).filter(|reason| !reason.is_empty()) {
        judgement.add(
            TwinStatus::HEALTH_WARN,
            format!(
                "identification has stopped: {reason}. It goes on when the residual is right again, or after ~/reset"
            ),
        );
    }
    if let Some(reason) = &around.replaced {
        judgement.add(TwinStatus::HEALTH_WARN, format!("the middleware process {reason}: it was replaced"));
    }
    if around.failed_outputs > 0 {
        let failed = around.failed_outputs;
        judgement.add(TwinStatus::HEALTH_WARN, format!("{failed} messages not taken: a reliable reader is behind"));
    }
    judgement
}

/// Largest difference of the sensors' clocks for which their stamps can be compared, s: readings further apart are
/// not interpolated.
const CLOCKS_DIFFER_S: f64 = 0.1;

/// Why the stamps of load cell and poses can't be compared.
fn clocks_differ(live: &Live, given_s: f64) -> Option<String> {
    let [Some(pose_s), Some(cell_s)] = live.ahead_s else { return None };
    let (ahead_s, side) = if cell_s > pose_s { (cell_s - pose_s, "ahead of") } else { (pose_s - cell_s, "behind") };
    (ahead_s > CLOCKS_DIFFER_S).then(|| {
        format!(
            "the stamps of measured_cf are {ahead_s:.3} s {side} those of the poses: readings and predictions of different moments are \
             compared. Synchronise the clocks of the sensors, or give the offset (-p time_offset_s:={:.3}) if it stays",
            given_s + cell_s - pose_s
        )
    })
}

/// Skipped poses and their effect on the force. While the tissue lags behind the instrument, the forces on instrument
/// and base differ. That difference indicates the error of the force but can be smaller: an error of 20 % was seen
/// with a difference of 5 % (docs/lab/faults.md).
fn skipped(live: &Live, share: f64) -> String {
    let gap = live.last.map_or(0.0, |answer| 100.0 * answer.prediction.health.force_imbalance);
    format!(
        "{share:.0}% of the poses are skipped: the twin is slower than they come. Force and base reaction differ by \
         {gap:.1}% of the peak, and the force may be off by several times that until it rests: choose a coarser \
         discretisation"
    )
}

/// Why no pose has been answered, although poses come.
fn not_there_yet(live: &Live) -> Option<String> {
    if let Some(under_way) = &live.under_way {
        let (to_mm, percent, left) = (1e3 * under_way.to_m, 100.0 * under_way.share, under_way.left_s.ceil().max(1.0));
        return Some(format!(
            "taking the instrument to {to_mm:.1} mm: {percent:.0} % done, about {left} s left; predicted_cf is silent until it is there"
        ));
    }
    let waits = !live.spoken && live.last_pose.is_some();
    waits.then(|| "no pose has been answered yet".to_owned())
}

fn not_active(state: State) -> Option<String> {
    match state {
        State::Active => None,
        State::Configuring => Some("the model is being built".to_owned()),
        other => Some(format!(
            "the node is {}: a lifecycle manager has to activate it (or start it with autostart)",
            other.label()
        )),
    }
}

fn silence(silent: Option<f64>, clock: &NodeClock, around: &Around) -> String {
    if clock.is_simulated() && clock.now_nanos().is_none() {
        return "use_sim_time is set and /clock has not said anything".to_owned();
    }
    match silent {
        None => "no pose has come yet".to_owned(),
        Some(s) if around.clock_gone => format!("input lost: no pose for {s:.1} s, and nobody publishes /clock"),
        Some(s) => format!("input lost: no pose for {s:.1} s"),
    }
}

pub(super) fn load_cell_problem(live: &Live) -> Option<&'static str> {
    match live.load_cell? {
        // The load cell is optional: it can be missing only after it was received.
        ForceComparison::LOAD_CELL_MISSING if live.measured > 0 => Some("load cell: no reading near the pose's stamp"),
        ForceComparison::LOAD_CELL_NOT_FINITE => Some("load cell: the reading is no number, or beyond any load cell"),
        ForceComparison::LOAD_CELL_STUCK => Some("load cell: the reading does not change"),
        ForceComparison::LOAD_CELL_SATURATED => Some("load cell: the reading is at the end of its range"),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::ros::twin_node::answer::Answer;
    use crate::ros::twin_node::declared::declarations;
    use needle_core::twin::{Phase, Pose, Prediction, StampedPose, Work};
    use ros2_messages::builtin_interfaces::Time;
    use ros2_node::parameters::Parameters;
    use std::time::Instant;

    #[test]
    fn tissue_that_has_folded_is_a_reason_to_warn() {
        let (parameters, _) = Parameters::declare(declarations(), &[], "/twin").unwrap();
        let shared = Shared::new(Settings::of(&parameters), NodeClock::new(false));
        let said = |folded_energy| {
            let now = Instant::now();
            let prediction = Prediction {
                time_s: 0.0,
                depth_m: 0.012,
                force_n: [0.0, 0.0, 1.0],
                base_force_n: [0.0; 3],
                template_force_n: [0.0; 3],
                torque_nm: [0.0; 3],
                phase: Phase::Indentation,
                event: None,
                steps: 1,
                health: Health { folded_energy, ..Health::default() },
            };
            shared.lock().last = Some(Answer {
                stamp: Time::from_nanos(0),
                received: now,
                begun: now,
                done: now,
                pose: StampedPose { time_s: 0.0, pose: Pose { tip: [0.0; 3], axis: [0.0, 0.0, -1.0], roll_rad: 0.0 } },
                prediction,
                work: Work::default(),
                boundaries_m: None,
                bent_tip: None,
            });
            let judgement = judge(&shared.lock(), &shared, &shared.settings(), &Around::default());
            judgement.reasons.into_iter().find(|reason| reason.contains("turned over"))
        };
        assert_eq!(said(0.049), None);
        let reason = said(0.062).unwrap();
        assert!(reason.starts_with("6% of the strain energy"), "{reason}");
    }
}
