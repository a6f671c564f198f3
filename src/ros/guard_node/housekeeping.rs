//! The housekeeping thread of the guard: `~/resume`, parameters, discovery, `/diagnostics`, `/rosout`.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use crossbeam_channel::Receiver;

use super::control::{Report, Shared};
use needle_guard::Phase;
use ros2_guarded::Bell;
use ros2_guarded::Health;
use ros2_messages::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, KeyValue};
use ros2_messages::std_msgs::Header;
use ros2_messages::std_srvs::{TriggerRequest, TriggerResponse};
use ros2_node::clock::NodeClock;
use ros2_node::logger_services::LoggerServices;
use ros2_node::parameter_services::ParameterServices;
use ros2_node::parameters::Parameters;
use ros2_node::participant::{Output, Participant, ParticipantError};
use ros2_node::qos;
use ros2_node::rosout::Rosout;
use ros2_node::service::Service;

/// Longest interval between two checks of anything that does not ring the bell.
const TICK: Duration = Duration::from_millis(100);
/// Time between two diagnostics.
const DIAGNOSTICS: Duration = Duration::from_millis(200);

pub(super) struct Housekeeping {
    parameters: Arc<Parameters>,
    parameter_services: ParameterServices,
    logger_services: Option<LoggerServices>,
    bell: Bell,
    resume: Service<TriggerRequest, TriggerResponse>,
    diagnostics: Output<DiagnosticArray>,
    node: String,
}

impl Housekeeping {
    pub(crate) fn new(participant: &mut Participant, parameters: &Arc<Parameters>) -> Result<Self, ParticipantError> {
        Ok(Self {
            parameters: Arc::clone(parameters),
            parameter_services: ParameterServices::new(participant)?,
            logger_services: LoggerServices::offer(participant, parameters)?,
            bell: participant.bell(),
            resume: participant.server("~/resume", "std_srvs", "Trigger")?,
            diagnostics: participant.publisher("/diagnostics", qos::reliable(10))?,
            node: participant.names().fully_qualified(),
        })
    }

    pub(crate) fn run(self, shared: &Shared, rosout: &Rosout, health: &Health, stop: &Receiver<()>) {
        let clock = NodeClock::new(false);
        let node = self.node.trim_start_matches('/');
        let mut due = Instant::now();
        loop {
            self.logger_services.iter().for_each(LoggerServices::poll);
            self.parameter_services.poll(&self.parameters, &clock, &mut |_, _| {});
            self.resume.answer(|_| resume(shared));
            rosout.publish();
            if Instant::now() >= due {
                due = Instant::now() + DIAGNOSTICS;
                if let Some(report) = shared.report() {
                    self.diagnostics.send(DiagnosticArray {
                        header: Header { stamp: clock.stamp(), ..Header::default() },
                        status: vec![describe(&report, node), health.diagnostic(node, "")],
                    });
                }
            }
            if !self.bell.wait(stop, Instant::now() + TICK) {
                rosout.publish();
                return;
            }
        }
    }
}

fn resume(shared: &Shared) -> TriggerResponse {
    let stopped = shared.report().is_some_and(|r| matches!(r.phase, Phase::Stopped(_)));
    shared.resume.store(stopped, Ordering::Relaxed);
    let message = if stopped { "goes on as soon as all is well" } else { "it is not stopped" };
    TriggerResponse { success: stopped, message: message.to_owned() }
}

fn describe(report: &Report, node: &str) -> DiagnosticStatus {
    let level = match report.phase {
        Phase::Waiting(_) => DiagnosticStatus::WARN,
        Phase::Moving | Phase::Arrived => DiagnosticStatus::OK,
        Phase::Stopped(_) => DiagnosticStatus::ERROR,
    };
    let message = report.words();
    let sight = &report.sight;
    let known = [
        ("depth (m)", sight.depth_m.map(|h| h.value)),
        ("goal (m)", sight.goal_m.map(|h| h.value)),
        ("setpoint (m)", report.setpoint_m),
        ("setpoint speed (m/s)", Some(report.speed_m_per_s)),
        ("predicted force (N)", sight.force_n.map(|h| h.value)),
        ("probability of force limit", sight.odds.map(|h| h.value.force_limit)),
        ("probability of miss", sight.odds.map(|h| h.value.miss)),
    ];
    let values = known
        .into_iter()
        .filter_map(|(key, value)| value.map(|v| KeyValue { key: key.to_owned(), value: format!("{v:.6}") }))
        .collect();
    DiagnosticStatus { level, name: format!("{node}: guard"), message, hardware_id: String::new(), values }
}
