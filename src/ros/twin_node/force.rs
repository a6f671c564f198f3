//! The force thread: all predictions are published here.

use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

use super::answer::{Answer, Progress, Sighting, is_finite};
use super::assurance::{Assurance, Assured};
use super::comparison::Comparator;
use super::identification::Identification;
use super::members::{Answered, Measured, Newest};
use super::shared::{Compared, Live, Noted, Reject, Shared};
use super::solver::Event;
use super::tf::{self, Transforms};
use super::tissue::bends;
use needle_core::instrument::reading::COORDINATE_M;
use needle_core::scene::Scene;
use needle_estimate::compare::crossing::{Crossing, Crossings};
use ros2_messages::builtin_interfaces::Time;
use ros2_messages::geometry_msgs::{PoseStamped, Wrench, WrenchStamped};
use ros2_messages::needle_twin::{ForceComparison, TissueEvent};
use ros2_messages::std_msgs::{Header, String as Text};
use ros2_node::logging::Throttle;
use ros2_node::parameters::Parameters;
use ros2_node::participant::{Output, Participant, ParticipantError};
use ros2_node::qos;

/// A first pose deeper than this is not the start of an insertion: a driver at 100 mm/s covers this distance between
/// two poses at 100 Hz.
const SEEN_FROM_M: f64 = 1e-3;

/// Shortest interval between two log lines about refused poses.
const SAID_AGAIN: Duration = Duration::from_secs(1);

/// Interval of the checks for a subscriber of `safe_to_go_on`.
const UNHEARD: Duration = Duration::from_millis(100);

/// Number of events that a late subscriber receives.
const EVENTS: usize = 100;

/// The events detected so far.
pub(super) struct Seen {
    number: u64,
    /// Detector of punctures in the measured force of a needle.
    crossings: Option<Crossings>,
}

impl Seen {
    /// For a needle with a diameter, m.
    pub(crate) fn new(needle: Option<f64>) -> Self {
        Self { number: 0, crossings: needle.map(Crossings::new) }
    }

    fn reset(&mut self) {
        self.number = 0;
        self.crossings.iter_mut().for_each(Crossings::reset);
    }
}

/// The publishers.
pub(super) struct ForceOutputs {
    pub force: Output<WrenchStamped>,
    pub comparison: Output<ForceComparison>,
    region: Output<Text>,
    events: Output<TissueEvent>,
    assurance: Assurance,
    transforms: Option<Transforms>,
    /// Tip of a needle that bends.
    tip: Option<Output<PoseStamped>>,
}

impl ForceOutputs {
    pub(crate) fn new(
        participant: &mut Participant,
        parameters: &Parameters,
        scene: &Scene,
    ) -> Result<Self, ParticipantError> {
        Ok(Self {
            force: participant.publisher("predicted_cf", qos::reliable(10))?,
            comparison: participant.publisher("comparison", qos::reliable(10))?,
            region: participant.publisher("region", qos::latched())?,
            events: participant.publisher("events", qos::latest(EVENTS))?,
            assurance: Assurance::new(participant, parameters)?,
            transforms: Transforms::new(participant, parameters, scene)?,
            tip: bends(scene).then(|| participant.publisher("predicted_tip", qos::reliable(10))).transpose()?,
        })
    }

    pub(crate) fn failed(&self) -> u64 {
        let transforms = self.transforms.as_ref().map_or(0, Transforms::failed);
        let tip = self.tip.as_ref().map_or(0, Output::failed);
        self.force.failed() + self.comparison.failed() + self.region.failed() + self.events.failed() + transforms + tip
    }
}

/// Runs until the solver has ended.
pub(super) fn run(
    outputs: &ForceOutputs,
    frame_id: &str,
    shared: &Shared,
    events: &Receiver<Event>,
    identification: Option<Identification>,
    members: Option<&Newest>,
    mut seen: Seen,
    lever_m: f64,
) {
    let mut comparator = Comparator::new(identification);
    let mut said = Assured::new(lever_m);
    let mut refusals = Throttle::new(SAID_AGAIN);
    let mut untracked = Throttle::new(Duration::from_secs(600));
    let mut due = Instant::now();
    let mut tip = tf::Newest::new(due);
    let transforms = outputs.transforms.as_ref();
    transforms.inspect(|transforms| transforms.announce(shared.clock.stamp()));
    let mut region: Option<String> = None;
    loop {
        let next = tip.due().map_or(due, |tip| tip.min(due));
        match events.recv_timeout(next.saturating_duration_since(Instant::now())) {
            Ok(Event::Answer(answer)) => {
                if transforms.is_some() && shared.is_active() {
                    tip.put(Some((answer.stamp, answer.bent_tip.unwrap_or(answer.pose.pose))));
                }
                if answered(outputs, frame_id, shared, &mut comparator, &answer) {
                    said.answered(&answer);
                    members.inspect(|newest| newest.put(Answered::of(&answer)));
                    entered(outputs, shared, &mut region);
                }
            }
            Ok(Event::Happened(sighting)) => {
                seen.number += 1;
                happened(outputs, frame_id, shared, seen.number, &sighting);
            }
            Ok(Event::Measured(reading)) => {
                shared.lock().measured += 1;
                let settings = shared.settings();
                comparator.measured(reading, settings.load_cell_range_n, settings.residual_band_n);
                said.cell = comparator.cell();
                comparator.unmeasured().inspect(|axes| tracing::warn!("measured_cf: {axes}; one alone is taken for z"));
            }
            Ok(Event::Tracked(seen)) => match members {
                Some(newest) => newest.tracked(seen),
                None if untracked.pass().is_some() => {
                    tracing::warn!("measured_targets is not used: only members learn from it (parameter members)");
                }
                None => {}
            },
            Ok(Event::UnderWay(progress)) => under_way(shared, progress),
            Ok(Event::Refused { depth_m, reason }) => refused(shared, depth_m, reason, &mut refusals),
            Ok(Event::Halted(reason)) => halted(shared, reason),
            Ok(Event::Recovered) => {
                shared.lock().halted = None;
                tracing::warn!("the twin is back from its last good state: predicted_cf goes on");
            }
            Ok(Event::Reset(reason)) => {
                comparator.reset();
                tip.put(None);
                members.inspect(|newest| newest.reset());
                said.reset();
                seen.reset();
                shared.lock().reset();
                entered(outputs, shared, &mut region);
                tracing::info!("back in the undeformed state ({reason})");
            }
            Ok(Event::Tare { forced, reply }) => {
                // Fails only if the caller has given up.
                let _ = reply.send(tare(shared, &mut comparator, forced));
            }
            Err(RecvTimeoutError::Timeout) => {}
            Ok(Event::Stop) | Err(RecvTimeoutError::Disconnected) => {
                // The last message: a node that ends reports that it is not safe to continue.
                outputs.assurance.deny(frame_id, shared);
                return;
            }
        }
        compare(outputs, frame_id, shared, &mut comparator, &mut said, members, &mut seen);
        let now = Instant::now();
        let is_due = now >= due;
        if is_due {
            let mut period = Duration::from_secs_f64(1.0 / shared.settings().guard_rate_hz);
            if !outputs.assurance.is_wanted() {
                period = period.max(UNHEARD);
            }
            // Absolute deadlines; missed ones are skipped.
            due = if now - due > period { now + period } else { due + period };
        }
        outputs.assurance.publish(frame_id, &mut said, shared, is_due);
        if let (Some(transforms), Some((stamp, pose))) = (transforms, tip.take(now)) {
            transforms.moved(stamp, &pose);
        }
    }
}

/// Takes the present reading as zero. Inside tissue the reading contains the tissue's force; a tare would hide the
/// force that the load cell must show.
fn tare(shared: &Shared, comparator: &mut Comparator, forced: bool) -> Result<[f64; 3], String> {
    let settings = shared.settings();
    let depth_m = shared.lock().last.map_or(0.0, |answer| answer.prediction.depth_m);
    if !forced && depth_m > 0.0 {
        return Err(format!(
            "the instrument is {depth_m:.6} m inside the sample, and presses on the load cell: retract it first. To take the present \
             reading all the same, call ~/force_tare"
        ));
    }
    comparator.tare(settings.load_cell_range_n, if forced { 0.0 } else { settings.residual_band_n })
}

/// Publishes an answer; false if it must not be published.
fn answered(
    outputs: &ForceOutputs,
    frame_id: &str,
    shared: &Shared,
    comparator: &mut Comparator,
    answer: &Answer,
) -> bool {
    if !is_finite(&answer.prediction) {
        shared.lock().not_finite += 1;
        halted(shared, format!("the prediction at depth {:.6} m is not finite", answer.prediction.depth_m));
        return false;
    }
    let timeout = shared.settings().input_timeout_s;
    let late = (answer.done - answer.received).as_secs_f64() > timeout;
    let withheld = {
        let mut live = shared.lock();
        notice_gap(&mut live, answer, timeout, shared.clock.is_simulated());
        live.under_way = None;
        live.answer(answer);
        // After a divergence nothing is published until the reset; an inactive node publishes nothing.
        let withheld = late || live.halted.is_some() || !shared.is_active();
        live.withheld += u64::from(withheld);
        live.window.withheld += u64::from(withheld);
        withheld
    };
    if withheld {
        return false;
    }
    outputs.force.send(WrenchStamped {
        header: Header { stamp: answer.stamp, frame_id: frame_id.to_owned() },
        wrench: Wrench { force: answer.prediction.force_n.into(), torque: answer.prediction.torque_nm.into() },
    });
    if let (Some(output), Some(tip)) = (&outputs.tip, &answer.bent_tip)
        && tip.tip.iter().chain(&tip.axis).all(|x| x.is_finite())
    {
        let header = Header { stamp: answer.stamp, frame_id: frame_id.to_owned() };
        output.send(PoseStamped { header, pose: tf::pose(tip) });
    }
    {
        let mut live = shared.lock();
        live.total.record(Instant::now() - answer.received);
        live.spoken = true;
    }
    comparator.predicted(*answer);
    true
}

/// Logs the tip's region when it changes.
fn entered(outputs: &ForceOutputs, shared: &Shared, said: &mut Option<String>) {
    let live = shared.lock();
    if said.as_deref() != Some(live.region()) {
        let region = live.region().to_owned();
        drop(live);
        outputs.region.send(Text { data: region.clone() });
        *said = Some(region);
    }
}

/// Notes an event for the page; returns the name of its region.
fn noted(shared: &Shared, stamp: Time, event: &needle_core::twin::Event) -> String {
    let mut live = shared.lock();
    let region = live.along.name_of(event.region()).to_owned();
    let (depth_m, kind, text) = (event.depth_m(), event.kind(), region.clone());
    live.note(Noted { stamp_nanos: stamp.nanos(), depth_m, kind, text });
    region
}

/// Publishes an event, unless the node must be silent.
fn happened(outputs: &ForceOutputs, frame_id: &str, shared: &Shared, number: u64, sighting: &Sighting) {
    if !shared.is_active() {
        return;
    }
    let Sighting { stamp, interval_s, axis, happening } = *sighting;
    let against = |force: [f64; 3]| 0.0 - (0..3).map(|k| force[k] * axis[k]).sum::<f64>();
    let message = TissueEvent {
        header: Header { stamp, frame_id: frame_id.to_owned() },
        number,
        kind: happening.event.kind().to_owned(),
        region: noted(shared, stamp, &happening.event),
        depth_m: happening.event.depth_m(),
        force_before_n: against(happening.force_before_n),
        force_after_n: against(happening.force_after_n),
        interval_s,
        source: TissueEvent::MODEL.to_owned(),
    };
    let finite = [message.depth_m, message.force_before_n, message.force_after_n, message.interval_s];
    if finite.iter().all(|x| x.is_finite()) {
        tracing::info!("{} at {:.6} m, in {}", message.kind, message.depth_m, message.region);
        outputs.events.send(message);
    }
}

/// Publishes a puncture detected in the measured force. It does not depend on the model, so it is published even
/// while the twin is wrong.
fn crossed(outputs: &ForceOutputs, shared: &Shared, header: Header, number: u64, crossing: &Crossing) {
    let (stamp_nanos, depth_m) = (header.stamp.nanos(), crossing.depth_m);
    let Crossing { time_s, seen_s, force_before_n, force_after_n, .. } = *crossing;
    if ![depth_m, time_s, seen_s, force_before_n, force_after_n].iter().all(|x| x.is_finite()) {
        return;
    }
    let text = "in the measured force".to_owned();
    shared.lock().note(Noted { stamp_nanos, depth_m, kind: TissueEvent::PUNCTURE, text });
    tracing::info!(
        "puncture at {depth_m:.6} m in the measured force: from {force_before_n:.5} to {force_after_n:.5} N"
    );
    outputs.events.send(TissueEvent {
        header,
        number,
        kind: TissueEvent::PUNCTURE.to_owned(),
        region: String::new(),
        depth_m,
        force_before_n,
        force_after_n,
        interval_s: seen_s - time_s,
        source: TissueEvent::MEASURED.to_owned(),
    });
}

/// Notes the progress of the twin's motion to a distant pose.
fn under_way(shared: &Shared, progress: Option<Progress>) {
    let mut live = shared.lock();
    let Some(progress) = progress else {
        live.under_way = None;
        return;
    };
    if live.under_way.is_none() {
        tracing::warn!(
            "the instrument is far from where the twin has it: it is taken to {:.6} m, and predicted_cf is silent until it is there",
            progress.to_m
        );
    }
    live.coalesced += progress.skipped;
    live.window.coalesced += progress.skipped;
    live.under_way = Some(progress);
}

/// Reports the part of the instrument's motion that was not observed: before the first pose, and while no poses came.
#[allow(clippy::cast_precision_loss)] // a duration
fn notice_gap(live: &mut Live, answer: &Answer, timeout_s: f64, simulated: bool) {
    let depth_m = answer.prediction.depth_m;
    let Some(last) = live.last else {
        if depth_m > SEEN_FROM_M {
            live.first_seen_m = Some(depth_m);
            tracing::warn!(
                "the first pose is {depth_m:.6} m deep: the way there and the puncture were not seen. The tissue was taken \
                 there straight, and its force is right when it rests"
            );
        }
        return;
    };
    if depth_m <= 0.0 {
        live.first_seen_m = None;
    }
    let gap_s = match live.under_way {
        // the time of the motion to a distant pose is no gap
        Some(progress) => progress.since.saturating_duration_since(last.received).as_secs_f64(),
        // while simulated time stands still, no pose is missing
        None if simulated => (answer.stamp.nanos() - last.stamp.nanos()) as f64 * 1e-9,
        None => answer.received.saturating_duration_since(last.received).as_secs_f64(),
    };
    if gap_s > timeout_s {
        let from_m = last.prediction.depth_m;
        live.gaps.count += 1;
        live.gaps.longest_s = live.gaps.longest_s.max(gap_s);
        live.gaps.unseen_m += (depth_m - from_m).abs();
        tracing::warn!(
            "no pose for {gap_s:.3} s: the instrument went from {from_m:.6} m to {depth_m:.6} m unseen, and the tissue is \
             taken there straight"
        );
    }
}

fn refused(shared: &Shared, depth_m: f64, reason: String, refusals: &mut Throttle) {
    let mut live = shared.lock();
    if reason.is_empty() {
        live.reject(Reject::Diverged);
        return;
    }
    live.reject(Reject::ByTwin);
    // a reason with numbers differs for each pose
    if live.refused.as_ref() != Some(&reason)
        && let Some(held) = refusals.pass()
    {
        let depth = if COORDINATE_M.contains(depth_m) { format!("{depth_m:.6}") } else { format!("{depth_m:e}") };
        let more = if held > 0 { format!(" ({held} more since the last such message)") } else { String::new() };
        tracing::warn!("pose at depth {depth} m refused by the twin: {reason}{more}");
    }
    live.refused = Some(reason);
}

fn halted(shared: &Shared, reason: String) {
    tracing::error!("predicted_cf stops: {reason}. It goes on by itself once the instrument is back, or after ~/reset");
    let mut live = shared.lock();
    (live.halted, live.under_way) = (Some(reason), None);
}

fn compare(
    outputs: &ForceOutputs,
    frame_id: &str,
    shared: &Shared,
    comparator: &mut Comparator,
    said: &mut Assured,
    members: Option<&Newest>,
    seen: &mut Seen,
) {
    let range_n = shared.settings().load_cell_range_n;
    while let Some((message, agreement)) = comparator.next(frame_id, range_n) {
        said.agreement = agreement.or(said.agreement);
        {
            let mut live = shared.lock();
            live.load_cell = Some(message.load_cell);
            if message.valid {
                live.compared = Some(Compared::of(&message));
                members.inspect(|newest| newest.measured(Measured::of(&message)));
            }
            live.residual = message.valid.then_some((message.residual_n, message.rmse_n, message.max_abs_error_n));
            live.against_spring = comparator.against_spring();
            live.identified(&message);
            live.samples.take(&message);
        }
        if let (true, Some(crossings)) = (message.valid && shared.is_active(), &mut seen.crossings) {
            let time_s = message.header.stamp.nanos() as f64 * 1e-9;
            if let Some(crossing) = crossings.take(time_s, message.depth_m, message.measured_n) {
                seen.number += 1;
                crossed(outputs, shared, message.header.clone(), seen.number, &crossing);
            }
        }
        if outputs.comparison.is_wanted() {
            outputs.comparison.send(message);
        }
    }
}
