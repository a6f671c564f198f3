//! The housekeeping thread of the rig: the player's services, parameters, discovery, `/rosout`.

use std::sync::Arc;
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, Sender};

use super::declared;
use super::playback::Command;
use needle_rig::Stretch;
use ros2_client::ParameterValue;
use ros2_guarded::Bell;
use ros2_messages::rosbag2_interfaces::{
    BurstRequest, BurstResponse, Empty, GetRateResponse, IsPausedResponse, PlayRequest, SeekRequest, SetRateRequest,
    Success,
};
use ros2_node::clock::NodeClock;
use ros2_node::logger_services::LoggerServices;
use ros2_node::parameter_services::ParameterServices;
use ros2_node::parameters::Parameters;
use ros2_node::participant::{Participant, ParticipantError};
use ros2_node::rosout::Rosout;
use ros2_node::service::Service;

/// Longest interval between two checks of anything that does not ring the bell.
const TICK: Duration = Duration::from_millis(100);
/// Longest wait for the playback thread.
const PATIENCE: Duration = Duration::from_millis(500);
const PACKAGE: &str = "rosbag2_interfaces";

struct PlayerServices {
    pause: Service<Empty, Empty>,
    resume: Service<Empty, Empty>,
    toggle: Service<Empty, Empty>,
    is_paused: Service<Empty, IsPausedResponse>,
    get_rate: Service<Empty, GetRateResponse>,
    set_rate: Service<SetRateRequest, Success>,
    seek: Service<SeekRequest, Success>,
    play_next: Service<Empty, Success>,
    burst: Service<BurstRequest, BurstResponse>,
    stop: Service<Empty, Empty>,
    play: Service<PlayRequest, Success>,
}

impl PlayerServices {
    fn new(participant: &mut Participant) -> Result<Self, ParticipantError> {
        Ok(Self {
            pause: participant.server("~/pause", PACKAGE, "Pause")?,
            resume: participant.server("~/resume", PACKAGE, "Resume")?,
            toggle: participant.server("~/toggle_paused", PACKAGE, "TogglePaused")?,
            is_paused: participant.server("~/is_paused", PACKAGE, "IsPaused")?,
            get_rate: participant.server("~/get_rate", PACKAGE, "GetRate")?,
            set_rate: participant.server("~/set_rate", PACKAGE, "SetRate")?,
            seek: participant.server("~/seek", PACKAGE, "Seek")?,
            play_next: participant.server("~/play_next", PACKAGE, "PlayNext")?,
            burst: participant.server("~/burst", PACKAGE, "Burst")?,
            stop: participant.server("~/stop", PACKAGE, "Stop")?,
            play: participant.server("~/play", PACKAGE, "Play")?,
        })
    }

    fn serve(&self, commands: &Sender<Command>, parameters: &Parameters) {
        let tell = |command| {
            // Fails only if the playback has ended.
            let _ = commands.send(command);
            Empty::default()
        };
        self.pause.answer(|_| tell(Command::SetPaused(true)));
        self.resume.answer(|_| tell(Command::SetPaused(false)));
        self.toggle.answer(|_| tell(Command::Toggle));
        self.stop.answer(|_| tell(Command::Stop));
        self.is_paused.answer(|_| IsPausedResponse { paused: ask(commands, Command::State).is_none_or(|s| s.0) });
        self.get_rate.answer(|_| GetRateResponse { rate: ask(commands, Command::State).map_or(0.0, |s| s.1) });
        self.set_rate.answer(|q| {
            let done = ask(commands, |reply| Command::SetRate(q.rate, reply));
            if done == Some(true) {
                // a rate that the service accepts is in the parameter's range; otherwise the parameter stays
                let _ = parameters.set(&[(declared::RATE.name().to_owned(), ParameterValue::Double(q.rate))]);
            }
            success(done)
        });
        self.seek.answer(|q| success(ask(commands, |reply| Command::Seek(q.time.nanos(), reply))));
        self.play_next.answer(|_| success(ask(commands, Command::PlayNext)));
        self.play.answer(|q| {
            let (offset, stretch) = stretch(&q);
            success(ask(commands, |reply| Command::Play(offset, stretch, reply)))
        });
        self.burst.answer(|q| BurstResponse {
            actually_burst: ask(commands, |reply| Command::Burst(q.num_messages, reply)).unwrap_or(0),
        });
    }
}

/// Negative times mean that there is no limit.
fn stretch(request: &PlayRequest) -> (Duration, Stretch) {
    let positive = |nanos: i64| u64::try_from(nanos).ok().map(Duration::from_nanos);
    let until_ns = Some(request.playback_until_timestamp.nanos()).filter(|t| *t >= 0);
    let stretch = Stretch { duration: positive(request.playback_duration.nanos()), until_ns };
    (positive(request.start_offset.nanos()).unwrap_or_default(), stretch)
}

fn success(done: Option<bool>) -> Success {
    Success { success: done.unwrap_or(false) }
}

fn ask<T>(commands: &Sender<Command>, command: impl FnOnce(Sender<T>) -> Command) -> Option<T> {
    let (reply, answer) = crossbeam_channel::bounded(1);
    commands.send(command(reply)).ok()?;
    answer.recv_timeout(PATIENCE).ok()
}

pub(super) struct Housekeeping {
    parameters: Arc<Parameters>,
    parameter_services: ParameterServices,
    logger_services: Option<LoggerServices>,
    bell: Bell,
    player: Option<PlayerServices>,
}

impl Housekeeping {
    pub(crate) fn new(
        participant: &mut Participant,
        parameters: &Arc<Parameters>,
        plays: bool,
    ) -> Result<Self, ParticipantError> {
        Ok(Self {
            parameters: Arc::clone(parameters),
            parameter_services: ParameterServices::new(participant)?,
            logger_services: LoggerServices::offer(participant, parameters)?,
            bell: participant.bell(),
            player: if plays { Some(PlayerServices::new(participant)?) } else { None },
        })
    }

    fn change_rate(&self, commands: &Sender<Command>, value: &ParameterValue) {
        let ParameterValue::Double(rate) = *value else { return };
        if self.player.is_none() || ask(commands, |reply| Command::SetRate(rate, reply)) != Some(true) {
            tracing::warn!("rate has no effect: no bag is played");
        }
    }

    pub(crate) fn run(self, clock: &NodeClock, commands: &Sender<Command>, rosout: &Rosout, stop: &Receiver<()>) {
        loop {
            self.parameter_services.poll(&self.parameters, clock, &mut |name, value| {
                tracing::info!("parameter {name} is now {}", ros2_node::parameters::show(value));
                if name == declared::RATE.name() {
                    self.change_rate(commands, value);
                }
                if name == "use_sim_time" {
                    clock.set_simulated(false);
                    tracing::warn!("use_sim_time has no effect on the rig, which makes the time: leave it out");
                }
            });
            self.logger_services.iter().for_each(LoggerServices::poll);
            if let Some(player) = &self.player {
                player.serve(commands, &self.parameters);
            }
            rosout.publish();
            if !self.bell.wait(stop, Instant::now() + TICK) {
                rosout.publish();
                return;
            }
        }
    }
}
