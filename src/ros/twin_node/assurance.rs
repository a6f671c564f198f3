//! Reports whether it is safe to continue the insertion: `safety`, with the reasons and the age of the evidence, and
//! `safe_to_go_on`, the same as a boolean.
//!
//! A report of "safe" needs fresh evidence. A pose must have been received within `guard_timeout_s`, with a stamp no
//! further than that from the present time in either direction; and its answer must have been published. With a
//! `residual_band_n`, a reading of the load cell must be equally fresh and agree with the prediction as a vector. A
//! repeated comparison does not renew the age of its data.
//!
//! After a report of "not safe", all conditions must hold for [`HOLD`] without interruption. After a disagreement,
//! the residual must also fall to half of the band. So a prediction that passes a wrong reading by chance does not
//! count as agreement.
//!
//! A parameter that decides what counts as safe and changes is one report of "not safe". So a guard or driver stops, and
//! somebody has to confirm that it goes on under the new terms.
//!
//! "Not safe" is published at once, "safe" at a fixed rate. A suspended or dead node publishes nothing, so silence
//! also means "not safe".

use std::time::{Duration, Instant};

use super::answer::Answer;
use super::comparison::{Agreement, Cell};
use super::declared::{GUARD_TIMEOUT_S, Settings};
use super::judgement::{Around, judge};
use super::shared::{Live, Shared};
use needle_core::scene::Scene;
use ros2_messages::builtin_interfaces::Time;
use ros2_messages::needle_twin::{ForceComparison, Safety};
use ros2_messages::std_msgs::{Bool, Header};
use ros2_node::parameters::Parameters;
use ros2_node::participant::{Output, Participant, ParticipantError};
use ros2_node::qos;

/// Time for which all conditions must hold after a report of "not safe".
const HOLD: Duration = Duration::from_millis(100);

/// The housekeeping thread, which finds other twins and silent inputs, looks every 0.1 s. After this time without a look it hangs, s.
const UNWATCHED_S: f64 = 0.5;

/// Longest distance of a force from the load cell's origin, m. The force acts on the instrument between its tip,
/// `load_cell_height_m` below that origin, and its point of entry. The error of the force times this length bounds
/// that of the torque.
pub(super) fn lever_m(scene: &Scene) -> f64 {
    let height_m = scene.instrument.map_or(0.0, |instrument| instrument.load_cell_height.get());
    scene.motion.as_ref().map_or(0.0, |motion| motion.depth.get()).max(height_m)
}

/// The present time of the clocks with which evidence is compared.
#[derive(Clone, Copy, Debug)]
pub(super) struct Now {
    /// Monotonic.
    pub steady: Instant,
    /// The node's time, the time base of stamps, ns; `None` before simulated time has begun.
    pub node_nanos: Option<i64>,
}

/// A message: its stamp, and the time of its reception.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    pub stamp_nanos: i64,
    pub received: Instant,
}

impl Seen {
    /// Time since its reception, s.
    fn waited_s(&self, now: &Now) -> f64 {
        now.steady.saturating_duration_since(self.received).as_secs_f64()
    }

    /// Time since its stamp, s: negative for a stamp in the future.
    #[allow(clippy::cast_precision_loss)] // a duration
    fn since_stamp_s(&self, now: &Now) -> f64 {
        now.node_nanos.map_or(Safety::NEVER, |nanos| nanos.saturating_sub(self.stamp_nanos) as f64 * 1e-9)
    }

    /// Its age, s.
    fn age_s(&self, now: &Now) -> f64 {
        self.waited_s(now).max(self.since_stamp_s(now))
    }

    /// Why it is not evidence of the present state; `None` if it is.
    fn stale(&self, what: &str, now: &Now, timeout_s: f64) -> Option<String> {
        let (waited_s, since_s) = (self.waited_s(now), self.since_stamp_s(now));
        if waited_s > timeout_s {
            return Some(format!("{what} came {waited_s:.3} s ago, guard_timeout_s is {timeout_s}"));
        }
        let (by_s, side) = if since_s < 0.0 { (-since_s, "ahead of") } else { (since_s, "behind") };
        (by_s > timeout_s).then(|| {
            format!(
                "the stamp of {what} is {by_s:.3} s {side} this node's clock, guard_timeout_s is {timeout_s}: it is late, or the clocks \
                 differ (synchronise them, or use_sim_time)"
            )
        })
    }
}

/// The evidence, and the last report.
#[derive(Debug)]
pub(super) struct Assured {
    lever_m: f64,
    /// The newest pose whose answer was published, its force in N and the instrument's axis.
    pose: Option<(Seen, f64, [f64; 3])>,
    /// The newest valid comparison with the load cell.
    pub agreement: Option<Agreement>,
    pub cell: Cell,
    /// Whether the load cell has disagreed since all conditions held last.
    disagreed: bool,
    well_since: Option<Instant>,
    /// The last report.
    safe: bool,
    /// Under which it was made.
    terms: Option<Terms>,
}

/// Names and values of the parameters that decide what counts as safe.
type Terms = [(&'static str, f64); 6];

const fn terms(settings: &Settings) -> Terms {
    [
        ("residual_band_n", settings.residual_band_n),
        ("guard_timeout_s", settings.guard_timeout_s),
        ("force_limit_n", settings.force_limit_n),
        ("load_cell_range_n", settings.load_cell_range_n),
        ("input_timeout_s", settings.input_timeout_s),
        ("max_pose_age_s", settings.max_pose_age_s),
    ]
}

/// A judgement with its figures.
#[derive(Clone, Debug, Default)]
struct Verdict {
    reasons: Vec<String>,
    pose_age_s: f64,
    reading_age_s: f64,
    residual_n: f64,
    residual_margin_n: f64,
    torque_margin_nm: f64,
    force_margin_n: f64,
}

impl Assured {
    pub(crate) const fn new(lever_m: f64) -> Self {
        let cell = Cell { usable: None, fault: None };
        Self {
            lever_m,
            pose: None,
            agreement: None,
            cell,
            disagreed: false,
            well_since: None,
            safe: false,
            terms: None,
        }
    }

    /// Notes that an answer was published.
    pub(crate) fn answered(&mut self, answer: &Answer) {
        let seen = Seen { stamp_nanos: answer.stamp.nanos(), received: answer.received };
        let force_n = answer.prediction.force_n.iter().map(|f| f * f).sum::<f64>().sqrt();
        self.pose = Some((seen, force_n, answer.pose.pose.axis));
    }

    /// Resets with the tissue: earlier evidence belongs to another run.
    pub(crate) fn reset(&mut self) {
        (self.pose, self.agreement, self.well_since) = (None, None, None);
    }

    /// Judges the evidence. `denials`: further reasons against "safe".
    fn judge(&mut self, denials: Vec<String>, settings: &Settings, now: &Now) -> Verdict {
        let timeout_s = settings.guard_timeout_s;
        let mut verdict = Verdict {
            reasons: denials,
            pose_age_s: self.pose.map_or(Safety::NEVER, |(seen, ..)| seen.age_s(now)),
            reading_age_s: self.reading().map_or(Safety::NEVER, |seen| seen.age_s(now)),
            residual_margin_n: Safety::NEVER,
            torque_margin_nm: Safety::NEVER,
            force_margin_n: Safety::NEVER,
            residual_n: self.agreement.map_or(0.0, |agreement| agreement.error_n),
        };
        match &self.pose {
            None => verdict.reasons.push("no pose has been answered yet".to_owned()),
            Some((seen, ..)) => verdict.reasons.extend(seen.stale("the newest answered pose", now, timeout_s)),
        }
        let cell = self.ask_cell(&mut verdict, settings, now);
        verdict.reasons.extend(cell);
        self.hold_to_limit(&mut verdict, settings.force_limit_n);
        verdict.reasons.extend(self.changed(settings));
        self.hold(&mut verdict, now.steady);
        verdict
    }

    fn reading(&self) -> Option<Seen> {
        self.cell.usable.map(|(stamp_nanos, received)| Seen { stamp_nanos, received })
    }

    /// The load cell's reason against "safe", if it is used.
    fn ask_cell(&mut self, verdict: &mut Verdict, settings: &Settings, now: &Now) -> Option<String> {
        let (band_n, timeout_s) = (settings.residual_band_n, settings.guard_timeout_s);
        if band_n <= 0.0 {
            return None;
        }
        if let Some(fault) = self.cell.fault {
            return Some(fault_words(fault).to_owned());
        }
        let Some(reading) = self.reading() else {
            return Some("residual_band_n is set, and no reading of the load cell has come".to_owned());
        };
        if let Some(reason) = reading.stale("the newest reading of the load cell", now, timeout_s) {
            return Some(reason);
        }
        let Some(agreement) = self.agreement else {
            return Some("no prediction has been compared with the load cell yet".to_owned());
        };
        // The pose and the reading of a comparison; the reading came up to one period later. Neither may be the
        // newest any more.
        let compared = agreement.pose_received.min(agreement.reading_received);
        let compared_s = now.steady.saturating_duration_since(compared).as_secs_f64();
        if compared_s > 2.0 * timeout_s {
            return Some(format!("the last comparison with the load cell is of {compared_s:.3} s ago"));
        }
        verdict.residual_margin_n = band_n - agreement.error_n;
        let band_nm = band_n * self.lever_m;
        if let Some(error_nm) = agreement.error_nm.filter(|_| band_nm > 0.0) {
            verdict.torque_margin_nm = band_nm - error_nm;
        }
        let share = if self.disagreed { 0.5 } else { 1.0 };
        let within = |error: f64, band: f64| error < share * band;
        if !within(agreement.error_n, band_n) {
            self.disagreed = true;
            return Some(format!(
                "predicted and measured force differ by {:.4} N, residual_band_n is {band_n} N{}: the tissue is not as modelled, or the \
                 load cell is wrong or not tared",
                agreement.error_n,
                if share < 1.0 { ", half of it after a disagreement" } else { "" }
            ));
        }
        if let Some(error_nm) = agreement.error_nm.filter(|error| band_nm > 0.0 && !within(*error, band_nm)) {
            self.disagreed = true;
            return Some(format!(
                "predicted and measured torque differ by {error_nm:.6} N m, {band_nm:.6} N m are residual_band_n at {} m: something presses \
                 from the side, or instrument.load_cell_height_m is not where the load cell's origin is",
                self.lever_m
            ));
        }
        None
    }

    /// Says which parameter has changed since the last judgement.
    #[allow(clippy::float_cmp)] // whether it is the same value
    fn changed(&mut self, settings: &Settings) -> Option<String> {
        let now = terms(settings);
        let before = self.terms.replace(now)?;
        let ((name, from), (_, to)) = before.into_iter().zip(now).find(|(a, b)| a.1 != b.1)?;
        Some(format!("{name} was changed from {from} to {to}: confirm that the motion goes on (guard: ~/resume)"))
    }

    fn hold_to_limit(&self, verdict: &mut Verdict, limit_n: f64) {
        if limit_n <= 0.0 {
            return;
        }
        let measured_n = self.agreement.map_or(0.0, |agreement| agreement.measured_n);
        let force_n = self.pose.map_or(0.0, |(_, force_n, _)| force_n).max(measured_n);
        verdict.force_margin_n = limit_n - force_n;
        if verdict.force_margin_n <= 0.0 {
            verdict.reasons.push(format!("the force is {force_n:.4} N, force_limit_n is {limit_n} N"));
        }
    }

    /// After a report of "not safe", requires all conditions to hold for a while.
    fn hold(&mut self, verdict: &mut Verdict, now: Instant) {
        if !verdict.reasons.is_empty() {
            self.well_since = None;
        } else if !self.safe {
            let since = *self.well_since.get_or_insert(now);
            if now.saturating_duration_since(since) < HOLD {
                verdict.reasons.push(format!("all is well again; a yes comes after {} s of it", HOLD.as_secs_f64()));
            } else {
                self.disagreed = false;
            }
        }
        self.safe = verdict.reasons.is_empty();
    }
}

/// Why a reading of the load cell can't be compared.
fn fault_words(fault: u8) -> &'static str {
    match fault {
        ForceComparison::LOAD_CELL_STUCK => "load cell: the reading does not change",
        ForceComparison::LOAD_CELL_SATURATED => "load cell: the reading is at the end of its range",
        _ => "load cell: the reading is no number, or beyond any load cell",
    }
}

/// The publishers.
pub(super) struct Assurance {
    bare: Output<Bool>,
    safety: Output<Safety>,
}

impl Assurance {
    /// A message older than `guard_timeout_s` proves nothing. So the middleware drops it (lifespan) and reports if
    /// none came in time (deadline).
    pub(crate) fn new(participant: &mut Participant, parameters: &Parameters) -> Result<Self, ParticipantError> {
        let timeout = Duration::try_from_secs_f64(parameters.get(GUARD_TIMEOUT_S)).ok();
        let mut profile = qos::reliable(1);
        (profile.deadline, profile.lifespan) = (timeout, timeout);
        Ok(Self {
            bare: participant.publisher("safe_to_go_on", profile.clone())?,
            safety: participant.publisher("safety", profile)?,
        })
    }

    /// Publishes "not safe": the last message of a node that ends.
    pub(crate) fn deny(&self, frame_id: &str, shared: &Shared) {
        self.bare.send(Bool { data: false });
        let header = Header { stamp: shared.clock.stamp(), frame_id: frame_id.to_owned() };
        let reasons = vec!["the node ends".to_owned()];
        let never = Safety::NEVER;
        self.safety.send(Safety {
            header,
            reasons,
            pose_age_s: never,
            reading_age_s: never,
            force_margin_n: never,
            residual_margin_n: never,
            torque_margin_nm: never,
            ..Safety::default()
        });
    }

    /// Whether there is a subscriber.
    pub(crate) fn is_wanted(&self) -> bool {
        self.bare.is_wanted() || self.safety.is_wanted()
    }

    /// Publishes if it is due, or if the report changes to "not safe".
    pub(crate) fn publish(&self, frame_id: &str, assured: &mut Assured, shared: &Shared, is_due: bool) {
        if !self.is_wanted() {
            // a new subscriber must not get an earlier "safe"
            assured.safe = false;
            return;
        }
        let settings = shared.settings();
        let now = Now { steady: Instant::now(), node_nanos: shared.clock.now_nanos() };
        let (denials, steepest_n_per_m) = {
            let live = shared.lock();
            (denials(&live, shared, &settings), live.steepest_n_per_m)
        };
        let before = assured.safe;
        let verdict = assured.judge(denials, &settings, &now);
        if !is_due && (assured.safe || !before) {
            return;
        }
        self.bare.send(Bool { data: assured.safe });
        if self.safety.is_wanted() {
            let message = assured.message(verdict, &settings, &now, frame_id);
            self.safety.send(Safety { steepest_n_per_m, ..message });
        }
    }
}

impl Assured {
    fn message(&self, verdict: Verdict, settings: &Settings, now: &Now, frame_id: &str) -> Safety {
        let stamp = Time::from_nanos(now.node_nanos.unwrap_or(0));
        Safety {
            header: Header { stamp, frame_id: frame_id.to_owned() },
            pose_stamp: Time::from_nanos(self.pose.map_or(0, |(seen, ..)| seen.stamp_nanos)),
            pose_age_s: verdict.pose_age_s,
            reading_age_s: verdict.reading_age_s,
            safe: self.safe,
            force_margin_n: verdict.force_margin_n,
            residual_n: verdict.residual_n,
            reasons: verdict.reasons,
            residual_band_n: settings.residual_band_n,
            residual_margin_n: verdict.residual_margin_n,
            torque_margin_nm: verdict.torque_margin_nm,
            axis: self.pose.map_or([0.0; 3], |(.., axis)| axis).into(),
            steepest_n_per_m: 0.0,
        }
    }
}

/// The node's own reasons against "safe".
fn denials(live: &Live, shared: &Shared, settings: &Settings) -> Vec<String> {
    let mut denials = judge(live, shared, settings, &Around::default()).denials;
    for (doubt, words) in live.doubts(settings.input_timeout_s) {
        let is_cell = doubt.topic() == "measured_cf";
        if !is_cell || settings.residual_band_n > 0.0 {
            denials.push(format!("{} {words}", doubt.topic()));
        }
    }
    let unwatched_s = live.watched.map_or(0.0, |at| at.elapsed().as_secs_f64());
    if unwatched_s > UNWATCHED_S {
        denials.push(format!(
            "the node's own watch has stood still for {unwatched_s:.3} s: its housekeeping thread hangs"
        ));
    }
    if shared.clock.is_simulated() {
        let stood_s = live.last_clock.map_or(Safety::NEVER, |at| at.elapsed().as_secs_f64());
        if stood_s > settings.guard_timeout_s {
            denials.push(format!(
                "simulated time has stood still for {stood_s:.3} s, guard_timeout_s is {}: /clock is paused, or comes too seldom",
                settings.guard_timeout_s
            ));
        }
    }
    denials
}

#[cfg(test)]
#[path = "assurance/tests.rs"]
mod tests;
