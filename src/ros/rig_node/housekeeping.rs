//! The housekeeping thread of the rig: the player's services, parameters, discovery, `/rosout`.

use std::sync::Arc;
use std::time::Duration;

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender};
use ros2_client::{NodeLoggingHandle, Server};

use super::playback::Command;
use crate::ros::clock::NodeClock;
use crate::ros::graph::Graph;
use crate::ros::logging::Record;
use crate::ros::messages::rosbag2_interfaces::{
    BurstRequest, BurstResponse, Empty, GetRateResponse, IsPausedResponse, SeekRequest, SetRateRequest, Success,
};
use crate::ros::parameter_services::{ParameterServices, answer};
use crate::ros::parameters::Parameters;
use crate::ros::participant::{Participant, ParticipantError};
use crate::ros::rosout;

const TICK: Duration = Duration::from_millis(10);
/// Longest wait for the playback thread.
const PATIENCE: Duration = Duration::from_millis(500);
const PACKAGE: &str = "rosbag2_interfaces";

struct PlayerServices {
    pause: Server<Empty, Empty>,
    resume: Server<Empty, Empty>,
    toggle: Server<Empty, Empty>,
    is_paused: Server<Empty, IsPausedResponse>,
    get_rate: Server<Empty, GetRateResponse>,
    set_rate: Server<SetRateRequest, Success>,
    seek: Server<SeekRequest, Success>,
    play_next: Server<Empty, Success>,
    burst: Server<BurstRequest, BurstResponse>,
    stop: Server<Empty, Empty>,
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
        })
    }

    fn serve(&self, commands: &Sender<Command>) {
        let tell = |command| {
            // Fails only when the playback has ended.
            let _ = commands.send(command);
            Empty::default()
        };
        answer(&self.pause, |_| tell(Command::SetPaused(true)));
        answer(&self.resume, |_| tell(Command::SetPaused(false)));
        answer(&self.toggle, |_| tell(Command::Toggle));
        answer(&self.stop, |_| tell(Command::Stop));
        answer(&self.is_paused, |_| IsPausedResponse { paused: ask(commands, Command::State).is_none_or(|s| s.0) });
        answer(&self.get_rate, |_| GetRateResponse { rate: ask(commands, Command::State).map_or(0.0, |s| s.1) });
        answer(&self.set_rate, |q| success(ask(commands, |reply| Command::SetRate(q.rate, reply))));
        answer(&self.seek, |q| success(ask(commands, |reply| Command::Seek(q.time.nanos(), reply))));
        answer(&self.play_next, |_| success(ask(commands, Command::PlayNext)));
        answer(&self.burst, |q| BurstResponse {
            actually_burst: ask(commands, |reply| Command::Burst(q.num_messages, reply)).unwrap_or(0),
        });
    }
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
    player: Option<PlayerServices>,
    graph: Graph,
}

impl Housekeeping {
    /// The last endpoints of the node.
    pub fn new(
        participant: &mut Participant,
        parameters: &Arc<Parameters>,
        plays: bool,
    ) -> Result<Self, ParticipantError> {
        Ok(Self {
            parameters: Arc::clone(parameters),
            parameter_services: ParameterServices::new(participant)?,
            player: if plays { Some(PlayerServices::new(participant)?) } else { None },
            graph: participant.graph(),
        })
    }

    pub fn run(
        mut self,
        clock: &NodeClock,
        commands: &Sender<Command>,
        logger: &NodeLoggingHandle,
        lines: &Receiver<Record>,
        stop: &Receiver<()>,
    ) {
        loop {
            self.graph.poll();
            self.parameter_services.poll(&self.parameters, clock, &mut |name, value| {
                tracing::info!("parameter {name} is now {}", crate::ros::parameters::show(value));
                if name == "use_sim_time" {
                    clock.set_simulated(false);
                    tracing::warn!("use_sim_time has no effect on the rig: it makes the time");
                }
            });
            if let Some(player) = &self.player {
                player.serve(commands);
            }
            rosout::publish(logger, lines);
            if !matches!(stop.recv_timeout(TICK), Err(RecvTimeoutError::Timeout)) {
                rosout::publish(logger, lines);
                return;
            }
        }
    }
}
