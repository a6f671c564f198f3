//! The housekeeping thread: services, discovery, status, diagnostics and `/rosout`. None of its work is urgent, and
//! peers can't affect the solver through it.

use std::sync::Arc;
use std::sync::mpsc::SyncSender;
use std::time::{Duration, Instant};

use crossbeam_channel::Receiver;

use super::answer::Model;
use super::declared::{self, Settings};
use super::force::ForceOutputs;
use super::inbox::Inbox;
use super::judgement::{Around, judge};
use super::page::{Command, Page};
use super::rivals::{self, Rivals};
use super::shared::{Noted, Shared};
use super::solver::Event;
use super::status;
use super::tissue::TissueOutputs;
use super::warnings::Watch;
use ros2_guarded::Bell;
use ros2_guarded::Health;
use ros2_messages::diagnostic_msgs::DiagnosticArray;
use ros2_messages::needle_twin::{TissueModel, TwinStatus};
use ros2_messages::std_srvs::{TriggerRequest, TriggerResponse};
use ros2_node::environment::Reach;
use ros2_node::lifecycle::Change;
use ros2_node::lifecycle_services::{LifecycleServices, Outcome};
use ros2_node::logger_services::LoggerServices;
use ros2_node::parameter_services::ParameterServices;
use ros2_node::parameters::Parameters;
use ros2_node::participant::{Output, Participant, ParticipantError, Wish};
use ros2_node::qos;
use ros2_node::rosout::Rosout;
use ros2_node::service::Service;
use ros2_node::start::USE_SIM_TIME;

/// Longest interval between two checks of anything that does not ring the bell.
const TICK: Duration = Duration::from_millis(100);
/// Interval between two log lines about missing inputs.
const WAITING: Duration = Duration::from_secs(5);
/// The largest interval if nothing has changed.
const LONGEST_WAITING: Duration = Duration::from_secs(640);

type Trigger = Service<TriggerRequest, TriggerResponse>;

/// Endpoints of the thread.
pub(super) struct Housekeeping {
    parameters: Arc<Parameters>,
    parameter_services: ParameterServices,
    logger_services: Option<LoggerServices>,
    reset: Trigger,
    tare: Trigger,
    force_tare: Trigger,
    status: Output<TwinStatus>,
    diagnostics: Output<DiagnosticArray>,
    model: Output<TissueModel>,
    lifecycle: LifecycleServices,
    shared: Arc<Shared>,
    wishes: [Wish; 4],
    rivals: Rivals,
    instance: String,
    node: String,
    /// Time of the last pose, if poses have stopped.
    lost: Option<Instant>,
    warned_of_clocks: bool,
    watch: Watch,
    /// Whether the model has been published.
    started: bool,
}

/// Its access to the other threads.
pub(super) struct Context {
    pub frame_id: String,
    pub inbox: Arc<Inbox>,
    pub events: SyncSender<Event>,
    pub force: Arc<ForceOutputs>,
    pub tissue: Arc<TissueOutputs>,
    pub models: Receiver<Option<Arc<Model>>>,
    pub rosout: Rosout,
    pub reach: Reach,
    pub middleware: Arc<Health>,
    pub bell: Bell,
    pub page: Option<Page>,
}

impl Housekeeping {
    /// Creates the endpoints.
    pub(crate) fn new(
        participant: &mut Participant,
        parameters: &Arc<Parameters>,
        shared: &Arc<Shared>,
        wishes: [Wish; 4],
        rivals: Rivals,
    ) -> Result<Self, ParticipantError> {
        Ok(Self {
            parameters: Arc::clone(parameters),
            parameter_services: ParameterServices::new(participant)?,
            logger_services: LoggerServices::offer(participant, parameters)?,
            reset: participant.server("~/reset", "std_srvs", "Trigger")?,
            tare: participant.server("~/tare", "std_srvs", "Trigger")?,
            force_tare: participant.server("~/force_tare", "std_srvs", "Trigger")?,
            status: participant.publisher("status", qos::reliable(10))?,
            diagnostics: participant.publisher("/diagnostics", qos::reliable(10))?,
            model: participant.publisher("tissue_model", qos::latched())?,
            lifecycle: LifecycleServices::new(participant)?,
            shared: Arc::clone(shared),
            wishes,
            rivals,
            instance: rivals::instance(),
            node: participant.names().fully_qualified(),
            lost: None,
            warned_of_clocks: false,
            watch: Watch::new(),
            started: false,
        })
    }

    /// Runs until `stop` is closed.
    pub(crate) fn run(mut self, context: &Context, stop: &Receiver<()>) {
        let begun = Instant::now();
        let (mut status_due, mut diagnostics_due, mut waiting_due) = (begun, begun, begun + WAITING);
        let mut model: Option<Arc<Model>> = None;
        let (mut pause, mut said) = (WAITING, None);
        if self.parameters.get(declared::AUTOSTART) {
            self.manage(context, Some("configure"));
        }
        loop {
            self.logger_services.iter().for_each(LoggerServices::poll);
            self.serve(context);
            context.rosout.publish();
            if let Ok(built) = context.models.try_recv() {
                self.configured(context, built.as_deref());
                model = built.or(model);
            }
            self.manage(context, None);
            self.watch_input();
            self.watch_measurement();
            self.rivals.poll(&self.shared);
            let now = Instant::now();
            self.shared.lock().roll(now);
            if now >= status_due {
                status_due = now + Duration::from_secs_f64(1.0 / self.shared.settings().status_rate_hz);
                self.publish_status(context, model.as_deref());
            }
            if now >= diagnostics_due {
                diagnostics_due = now + Duration::from_secs(1);
                self.publish_diagnostics(context, model.as_deref());
            }
            if now >= waiting_due {
                let line = status::waiting(&self.shared.lock(), &self.shared, &self.wishes, begun, context.reach);
                // an unchanged line is repeated at growing intervals
                pause = if line.is_some() && line == said { (2 * pause).min(LONGEST_WAITING) } else { WAITING };
                waiting_due = now + pause;
                if let Some(line) = &line {
                    tracing::info!("{line}");
                }
                said = line;
            }
            let next = status_due.min(diagnostics_due).min(Instant::now() + TICK);
            if !context.bell.wait(stop, next) {
                break;
            }
        }
        if self.shared.lock().dying.is_some() {
            self.publish_status(context, model.as_deref());
            self.publish_diagnostics(context, model.as_deref());
        }
        context.rosout.publish();
    }

    /// Answers a lifecycle manager, and makes changes on the node's own initiative.
    fn manage(&mut self, context: &Context, own: Option<&str>) {
        let Self { lifecycle, shared, .. } = self;
        let mut act = |change| {
            match change {
                Change::Configure => {
                    context.inbox.build();
                    return Outcome::UnderWay;
                }
                Change::Cleanup | Change::Shutdown => context.inbox.discard(),
                Change::Activate => {}
                Change::Deactivate => context.inbox.reset("deactivated"),
            }
            Outcome::Done
        };
        match own {
            Some(label) => lifecycle.change(label, &shared.clock, &mut act),
            None => lifecycle.poll(&shared.clock, &mut act),
        }
        shared.set_state(lifecycle.state());
    }

    /// Handles the model, or the failure to build it. It is published once, since the same scene gives the same
    /// model. A node that activates automatically answers poses from then on.
    fn configured(&mut self, context: &Context, built: Option<&Model>) {
        self.lifecycle.finish(built.is_some(), &self.shared.clock);
        self.shared.set_state(self.lifecycle.state());
        let Some(built) = built.filter(|_| !self.started) else { return };
        self.started = true;
        if self.parameters.get(declared::AUTOSTART) {
            self.manage(context, Some("activate"));
        }
        self.model.send(built.message(self.shared.clock.stamp(), &context.frame_id));
    }

    /// Logs when poses stop and when they return, and when there are two publishers of the time.
    fn watch_input(&mut self) {
        let clock_gone = self.clock_gone();
        let timeout = self.shared.settings().input_timeout_s;
        let silence = self.shared.lock().silence_s(&self.shared.clock, clock_gone);
        let lost = silence.is_some_and(|s| s > timeout) && self.shared.is_active();
        if lost != self.lost.is_some() {
            let since = Instant::now().checked_sub(Duration::from_secs_f64(silence.unwrap_or(0.0)));
            let before = std::mem::replace(&mut self.lost, since.filter(|_| lost));
            if lost {
                let (joint, pose) = (&self.wishes[0], &self.wishes[1]);
                let publishers = joint.publishers() + pose.publishers();
                tracing::warn!(
                    "input lost: no pose on {} or {} for {timeout} s ({publishers} publishers); predicted_cf is silent \
                     until poses come again",
                    joint.topic,
                    pose.topic
                );
            } else if silence.is_some_and(|s| s <= timeout) {
                let missed = before.map_or(0.0, |then| then.elapsed().as_secs_f64());
                tracing::info!("poses come again: {missed:.2} s without one, and without a prediction");
            }
        }
        let time = &self.wishes[3];
        if self.shared.clock.is_simulated() && time.publishers() > 1 && !self.warned_of_clocks {
            self.warned_of_clocks = true;
            tracing::warn!(
                "{} has {} publishers: time will jump back and forth, and every jump back resets the twin. Give each \
                 simulation a clock of its own (--ros-args -r /clock:=clock in a namespace)",
                time.topic,
                time.publishers()
            );
        }
    }

    /// Checks units, signs and alignment of the measurement; the lock is held only for a copy.
    fn watch_measurement(&mut self) {
        let seen = {
            let live = self.shared.lock();
            self.watch.is_due(&live.samples).then(|| (live.samples.clone(), live.identified.is_some()))
        };
        if let Some((samples, identified)) = seen {
            let (warnings, verdict) = self.watch.look(&samples, identified);
            let mut live = self.shared.lock();
            live.warnings = warnings;
            live.verdict = verdict;
        }
    }

    fn clock_gone(&self) -> bool {
        self.shared.clock.is_simulated() && self.wishes[3].publishers() == 0
    }

    fn around(&self, context: &Context) -> Around {
        Around {
            failed_outputs: context.force.failed() + context.tissue.failed(),
            clock_gone: self.clock_gone(),
            replaced: context.middleware.trouble(),
        }
    }

    fn serve(&self, context: &Context) {
        let mut changed = false;
        self.parameter_services.poll(&self.parameters, &self.shared.clock, &mut |name, value| {
            tracing::info!("parameter {name} is now {}", ros2_node::parameters::show(value));
            changed = true;
        });
        if changed {
            self.shared.set_settings(Settings::of(&self.parameters));
            self.shared.clock.set_simulated(self.parameters.get(USE_SIM_TIME));
        }
        self.reset.answer(|_| self.reset(context, "~/reset"));
        self.tare.answer(|_| tare(&context.events, false));
        self.force_tare.answer(|_| tare(&context.events, true));
        while let Some(asked) = context.page.as_ref().and_then(Page::asked) {
            let TriggerResponse { success, message } = match &asked.command {
                Command::Tare => tare(&context.events, false),
                Command::Reset => self.reset(context, "asked for on the live page"),
                Command::Mark(text) => self.mark(text),
            };
            asked.answer(success, message);
        }
    }

    fn reset(&self, context: &Context, who: &'static str) -> TriggerResponse {
        self.shared.lock().expect_reset();
        context.inbox.reset(who);
        TriggerResponse { success: true, message: "the twin starts anew from the undeformed state".to_owned() }
    }

    /// Records the time of the last answer, for viewers of the page and in the log, and thereby in a recording.
    fn mark(&self, text: &str) -> TriggerResponse {
        let text = terminal::line(text);
        let mut live = self.shared.lock();
        let Some(answer) = live.last else {
            return TriggerResponse { success: false, message: "no pose has been answered yet".to_owned() };
        };
        let (stamp_nanos, depth_m) = (answer.stamp.nanos(), answer.prediction.depth_m);
        live.note(Noted { stamp_nanos, depth_m, kind: "mark", text: text.to_string() });
        drop(live);
        let message = format!("mark at depth {depth_m:.6} m, stamp {:.6} s: {text}", stamp_nanos as f64 * 1e-9);
        tracing::info!("{message}");
        TriggerResponse { success: true, message }
    }

    fn publish_status(&self, context: &Context, model: Option<&Model>) {
        let page = context.page.as_ref().filter(|page| page.board.is_watched());
        if !self.status.is_wanted() && page.is_none() {
            return;
        }
        let settings = self.shared.settings();
        let message = {
            let live = self.shared.lock();
            let judgement = judge(&live, &self.shared, &settings, &self.around(context));
            status::status(&live, &judgement, model, &context.frame_id, &self.instance)
        };
        if let Some(page) = page {
            page.status(&message, settings.residual_band_n);
        }
        if self.status.is_wanted() {
            self.status.send(message);
        }
    }

    fn publish_diagnostics(&self, context: &Context, model: Option<&Model>) {
        if !self.diagnostics.is_wanted() {
            return;
        }
        let settings = self.shared.settings();
        let around = self.around(context);
        let judgement = judge(&self.shared.lock(), &self.shared, &settings, &around);
        let (wishes, health) = (&self.wishes, &context.middleware);
        self.diagnostics.send(status::diagnostics(
            &self.shared,
            &judgement,
            model,
            &self.node,
            wishes,
            &around,
            health,
        ));
    }
}

fn tare(events: &SyncSender<Event>, forced: bool) -> TriggerResponse {
    let (reply, answer) = crossbeam_channel::bounded(1);
    let asked = events.try_send(Event::Tare { forced, reply }).is_ok();
    let outcome = if asked { answer.recv_timeout(Duration::from_millis(500)).ok() } else { None };
    match outcome {
        Some(Ok([x, y, z])) => {
            let message = format!("zero is now ({x:.6}, {y:.6}, {z:.6}) N");
            if forced {
                tracing::warn!("load cell: {message}, forced");
            } else {
                tracing::info!("load cell: {message}");
            }
            TriggerResponse { success: true, message }
        }
        Some(Err(reason)) => TriggerResponse { success: false, message: reason },
        None => TriggerResponse { success: false, message: "the node is too busy, try again".to_owned() },
    }
}
