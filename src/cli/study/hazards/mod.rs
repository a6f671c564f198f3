//! `needle_twin study hazards`: every input of a closed loop with every fault, and for how long the twin still says that it is safe.
//!
//! Driver, load cell, twin and guard run as they do for a user, each a process of its own. Between them lies a cable that spoils one
//! stream while the needle goes on into the tissue, at a depth at which the load cell has something to say. For each cell the needle
//! starts anew.

mod cable;
mod fault;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use clap::Args;
use rustix::process::{Pid, Signal, kill_process};

use self::cable::{Cable, Heard, Setting, Stream};
use self::fault::Fault;
use super::super::nodes::Node;
use super::super::output::OutputFolder;
use super::super::progress::Progress;
use super::super::{CliError, Outcome, print};
use needle_estimate::compare::Watch as _;
use ros2_guarded::hung::Hung;
use ros2_node::clock::wall_nanos;
use ros2_node::environment;

/// The fault begins at this depth, m: the force is twice the band there.
const FAULT_AT_M: f64 = 0.007;
/// Longest time that a loop may take to bring the needle there.
const PATIENCE: Duration = Duration::from_secs(60);
/// A needle that has not moved for so long stands.
const STANDS: Duration = Duration::from_millis(400);
/// A fault lasts for so long; then all is well again for as long.
const LASTS: Duration = Duration::from_millis(1500);
/// How long a yes may be believed after its stamp, and so how long a false one may last, s: `guard_timeout_s`.
const LONGEST_S: f64 = 0.025;

/// A value that stands still is distinguished from one at rest by the sensor's noise, which takes a number of readings, or by the velocity, s.
const LONGEST_FROZEN_S: f64 = 0.2;

/// What the housekeeping thread of the twin looks after is not evidence of a pose: the twin says no when it has not looked for half a second, s.
const LONGEST_UNWATCHED_S: f64 = 0.55;

/// Every input of the closed loop with every fault: time to the no, longest false yes, where the needle comes to stand
#[derive(Debug, Args)]
pub(super) struct Hazards {
    /// One cell of each kind: about a minute
    #[arg(long)]
    quick: bool,

    /// The cells with this text in "input, fault" alone
    #[arg(long, value_name = "TEXT")]
    only: Option<String>,

    /// Times that each cell is run; the worst counts
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=100))]
    trials: u32,

    /// Busy threads beside it, for a loaded machine
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=256))]
    load: u32,

    /// Write hazards.csv and hazards.md, and the logs of the nodes, into this folder
    #[arg(long, value_name = "DIR", default_value = "out/hazards")]
    out: PathBuf,
}

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Hazard {
    Message(Stream, Fault),
    /// A process gets SIGSTOP, and after [`LASTS`] SIGCONT.
    Frozen(Process),
    /// A process gets SIGKILL.
    Killed(Process),
    /// One thread of a process stands still for [`LASTS`].
    Hung(Process, Thread),
    /// Every process stands still for [`LASTS`], as on a machine that is suspended.
    Suspended,
    /// Somebody sets a parameter.
    Set(Setting),
    /// `~/tare` inside the tissue, with the load cell jumping.
    Tare,
}

/// A thread by its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Thread {
    name: &'static str,
    fault: &'static str,
}

const INPUT: Thread = Thread { name: "input", fault: "thread input hangs" };
const SOLVER: Thread = Thread { name: "solver", fault: "thread solver hangs" };
const FORCE: Thread = Thread { name: "force", fault: "thread force hangs" };
const HOUSEKEEPING: Thread = Thread { name: "housekeeping", fault: "thread housekeeping hangs" };
const MIDDLEWARE: Thread = Thread { name: "middleware", fault: "thread middleware hangs" };
const CONTROL: Thread = Thread { name: "control", fault: "thread control hangs" };
const DRIVER: Thread = Thread { name: "driver", fault: "thread driver hangs" };

/// Settings that a node can't take.
const REFUSED: [Setting; 4] = [
    Setting { of_guard: false, name: "residual_band_n", value: f64::NAN, fault: "residual_band_n NaN" },
    Setting { of_guard: false, name: "residual_band_n", value: -0.02, fault: "residual_band_n of the wrong sign" },
    Setting { of_guard: false, name: "guard_timeout_s", value: 25_000.0, fault: "guard_timeout_s in microseconds" },
    Setting { of_guard: true, name: "force_limit_n", value: 1e4, fault: "force_limit_n in millinewtons" },
];

/// Settings that are within their range, and wrong.
const TAKEN: [Setting; 3] = [
    Setting { of_guard: false, name: "residual_band_n", value: 20.0, fault: "residual_band_n in millinewtons" },
    Setting { of_guard: false, name: "residual_band_n", value: 0.0, fault: "residual_band_n 0" },
    Setting { of_guard: false, name: "guard_timeout_s", value: 25.0, fault: "guard_timeout_s in milliseconds" },
];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Process {
    Twin,
    TwinMiddleware,
    Guard,
    GuardMiddleware,
    Driver,
}

impl Process {
    const fn words(self) -> &'static str {
        match self {
            Self::Twin => "twin",
            Self::TwinMiddleware => "twin's middleware",
            Self::Guard => "guard",
            Self::GuardMiddleware => "guard's middleware",
            Self::Driver => "driver",
        }
    }
}

impl Hazard {
    fn words(self) -> [&'static str; 2] {
        match self {
            Self::Message(stream, fault) => {
                let stream = match stream {
                    Stream::Pose => "pose",
                    Stream::PoseOfTwin => "pose, twin alone",
                    Stream::Force => "load cell",
                    Stream::Prediction => "prediction, to the guard",
                    Stream::Safety => "safety, to the guard",
                    Stream::Command => "command, to the driver",
                    Stream::Clock => "/clock",
                };
                // the time itself, not the stamps of somebody's clock
                let fault = match (self, fault) {
                    (Self::Message(Stream::Clock, _), Fault::Ahead) => "10 s ahead",
                    (Self::Message(Stream::Clock, _), Fault::Behind) => "10 s behind",
                    _ => fault.words(),
                };
                [stream, fault]
            }
            Self::Hung(process, thread) => [process.words(), thread.fault],
            Self::Suspended => ["machine", "suspended and resumed"],
            Self::Set(Setting { of_guard, fault, .. }) => {
                [if of_guard { "parameters of the guard" } else { "parameters" }, fault]
            }
            Self::Frozen(process) => [process.words(), "frozen and thawed"],
            Self::Killed(process) => [process.words(), "killed"],
            Self::Tare => ["service", "tare in tissue"],
        }
    }

    /// Whether it is refused.
    fn is_refused(self) -> bool {
        // NaN is not equal to itself
        matches!(self, Self::Set(setting) if REFUSED.iter().any(|refused| refused.fault == setting.fault))
    }

    /// Whether all goes on as before, and rightly. The guard's housekeeping thread answers `~/resume` and says how it is; what moves the
    /// needle is its control thread.
    fn goes_on(self) -> bool {
        self.is_refused() || self == Self::Hung(Process::Guard, HOUSEKEEPING)
    }

    /// Why a yes after the first no can be a true one.
    const fn later_yes(self) -> Option<&'static str> {
        match self {
            Self::Frozen(Process::TwinMiddleware) | Self::Killed(Process::TwinMiddleware) => Some("replaced"),
            Self::Set(_) => Some("as set"),
            _ => None,
        }
    }

    /// Longest false yes, s.
    fn longest_s(self) -> f64 {
        if self == Self::Hung(Process::Twin, HOUSEKEEPING) {
            LONGEST_UNWATCHED_S
        } else if matches!(self, Self::Message(Stream::Pose | Stream::PoseOfTwin | Stream::Force, Fault::Frozen)) {
            LONGEST_FROZEN_S
        } else {
            LONGEST_S
        }
    }

    /// Whether what the twin is asked about is affected: else its yes is a true one, and the guard or the driver has to act.
    const fn concerns_twin(self) -> bool {
        !matches!(
            self,
            Self::Message(Stream::Prediction | Stream::Safety | Stream::Command, _)
                | Self::Hung(Process::Guard, _)
                | Self::Frozen(Process::Guard | Process::GuardMiddleware)
                | Self::Killed(Process::Guard | Process::GuardMiddleware)
        )
    }
}

/// All cells; with `quick` one of each kind.
fn hazards(quick: bool) -> Vec<Hazard> {
    use Fault as F;
    use Hazard::{Frozen, Hung, Killed, Message, Set, Suspended, Tare};
    use Process as P;
    use Stream as S;
    if quick {
        return vec![
            Message(S::Pose, F::Silent),
            Message(S::PoseOfTwin, F::Late),
            Message(S::Force, F::Silent),
            Message(S::Force, F::NotFinite),
            Message(S::Force, F::TwoSources),
            Message(S::Force, F::Across),
            Message(S::Clock, F::Frozen),
            Frozen(P::Twin),
            Frozen(P::Guard),
            Hung(P::Twin, SOLVER),
            Hung(P::Guard, CONTROL),
            Set(REFUSED[0]),
            Set(TAKEN[0]),
            Suspended,
            Tare,
        ];
    }
    let pose = [
        F::Silent,
        F::Frozen,
        F::Repeated,
        F::Late,
        F::Behind,
        F::Ahead,
        F::Jumping,
        F::WrongSign,
        F::WrongUnit,
        F::NotFinite,
        F::TwoSources,
        F::WrongFrame,
    ];
    let force = [
        F::Silent,
        F::Frozen,
        F::Repeated,
        F::Late,
        F::Behind,
        F::Ahead,
        F::Jumping,
        F::WrongSign,
        F::WrongUnit,
        F::NotFinite,
        F::TwoSources,
        F::WrongFrame,
        F::Across,
        F::Twisted,
    ];
    let of = |stream, faults: &[Fault]| faults.iter().map(move |fault| Message(stream, *fault)).collect::<Vec<_>>();
    let threads = [
        (P::Twin, INPUT),
        (P::Twin, SOLVER),
        (P::Twin, FORCE),
        (P::Twin, HOUSEKEEPING),
        (P::Twin, MIDDLEWARE),
        (P::Guard, CONTROL),
        (P::Guard, HOUSEKEEPING),
        (P::Driver, DRIVER),
    ];
    let processes = [P::Twin, P::TwinMiddleware, P::Guard, P::GuardMiddleware, P::Driver];
    [
        of(S::Pose, &pose),
        of(S::PoseOfTwin, &[F::Silent, F::Frozen, F::Late, F::Behind]),
        of(S::Force, &force),
        of(S::Prediction, &[F::Silent, F::Repeated, F::Late, F::NotFinite, F::Jumping, F::TwoSources]),
        of(S::Safety, &[F::Silent, F::Repeated, F::Behind, F::Ahead, F::TwoSources]),
        of(S::Command, &[F::Silent, F::Frozen, F::Repeated, F::Behind, F::NotFinite, F::TwoSources]),
        of(S::Clock, &[F::Silent, F::Frozen, F::Ahead, F::Behind, F::TwoSources]),
        vec![Tare],
        REFUSED.map(Set).to_vec(),
        TAKEN.map(Set).to_vec(),
        threads.map(|(process, thread)| Hung(process, thread)).to_vec(),
        vec![Suspended],
        processes.map(Frozen).to_vec(),
        processes.map(Killed).to_vec(),
    ]
    .concat()
}

/// What a cell showed.
#[derive(Clone, Debug, Default)]
struct Seen {
    /// From the fault to the first no, s, if there was one.
    no_s: Option<f64>,
    /// From the fault to the stamp of the last yes before the first no, s.
    false_yes_s: f64,
    /// Times that it said yes after the first no while the fault lasted.
    later: usize,
    /// From the fault to when the needle stood, s.
    stood_s: f64,
    /// Way that the needle made after the fault was over, m.
    went_on_m: f64,
    /// Why the twin said no.
    reason: String,
    /// Whether a node refused what was asked of it.
    refused: bool,
}

impl Seen {
    /// Judges what was heard of a fault that began and ended at these times, ns. `by_arrival`: the stamps are of the clock that is spoilt.
    #[allow(clippy::cast_precision_loss)] // spans
    fn of(heard: &Heard, begun: i64, ended: i64, by_arrival: bool) -> Self {
        let since = |nanos: i64| (nanos - begun) as f64 * 1e-9;
        let said = || heard.safety.iter().map(move |(at, safe, reason)| (&at[usize::from(by_arrival)], safe, reason));
        let during = || said().filter(move |(at, ..)| (begun..ended).contains(*at));
        let no = during().find(|(_, safe, _)| !**safe);
        let no_at = no.map_or(ended, |(at, ..)| *at);
        let last_yes = during().filter(|(at, safe, _)| **safe && **at < no_at).map(|(at, ..)| *at).max();
        let moved = |from: i64, to: i64| {
            // by the driver's own velocity: its position sensor scatters
            heard.motion.windows(2).filter(move |w| w[1].0 > from && w[1].0 < to && w[1].2 != 0.0)
        };
        Self {
            no_s: no.map(|(at, ..)| since(*at)),
            false_yes_s: last_yes.map_or(0.0, since),
            later: during().filter(|(at, safe, _)| **safe && **at > no_at).count(),
            stood_s: moved(begun, ended).map(|w| since(w[1].0)).fold(0.0, f64::max),
            went_on_m: moved(ended, i64::MAX).map(|w| (w[1].2 * (w[1].0 - w[0].0) as f64 * 1e-9).abs()).sum(),
            reason: no.map(|(.., reason)| reason.to_owned()).unwrap_or_default(),
            refused: heard.taken == Some(false),
        }
    }

    /// The worse of two trials.
    fn worse(self, other: Self) -> Self {
        let later = |a: Option<f64>, b: Option<f64>| a.zip(b).map(|(a, b)| a.max(b));
        Self {
            no_s: later(self.no_s, other.no_s),
            false_yes_s: self.false_yes_s.max(other.false_yes_s),
            later: self.later.max(other.later),
            stood_s: self.stood_s.max(other.stood_s),
            went_on_m: self.went_on_m.max(other.went_on_m),
            reason: if self.reason.is_empty() { other.reason } else { self.reason },
            refused: self.refused && other.refused,
        }
    }

    /// Whether the loop did what it has to. The stop itself takes the guard's timeout, a cycle, the driver's timeout and braking; a machine
    /// that is busy makes it longer, and that is shown, not judged.
    fn holds(&self, hazard: Hazard) -> bool {
        if hazard.goes_on() {
            // a busy machine may make it say no for another reason
            return self.refused == hazard.is_refused() && !self.reason.contains("was changed");
        }
        let twin = !hazard.concerns_twin()
            || (self.false_yes_s <= hazard.longest_s() && (self.later == 0 || hazard.later_yes().is_some()));
        // a needle without a guard that was killed stands for good, and so do all others until somebody says ~/resume
        twin && self.stood_s < 1.0 && self.went_on_m < 1e-6
    }

    fn row(&self, hazard: Hazard) -> String {
        let [input, fault] = hazard.words();
        let mark = if self.holds(hazard) { "yes" } else { "**no**" };
        if hazard.goes_on() {
            let first = if hazard.is_refused() { "refused" } else { "-" };
            return format!("| {input} | {fault} | {first} | - | - | goes on | - | {mark} |");
        }
        let twin = if hazard.concerns_twin() {
            let no = self.no_s.map_or("silent".to_owned(), |s| format!("{:.0}", 1e3 * s));
            let later = hazard.later_yes().map_or_else(|| self.later.to_string(), str::to_owned);
            format!("{no} | {:.0} | {later}", 1e3 * self.false_yes_s.max(0.0))
        } else {
            "- | - | -".to_owned()
        };
        let went_on = if self.went_on_m < 1e-6 { "no".to_owned() } else { format!("{:.3} mm", 1e3 * self.went_on_m) };
        format!("| {input} | {fault} | {twin} | {:.0} | {went_on} | {mark} |", 1e3 * self.stood_s)
    }

    fn csv(&self, hazard: Hazard) -> String {
        let [input, fault] = hazard.words();
        let no_s = self.no_s.map_or(String::new(), |s| s.to_string());
        let Self { false_yes_s, later, stood_s, went_on_m, .. } = self;
        let reason = self.reason.replace('"', "'");
        format!(
            "\"{input}\",\"{fault}\",{no_s},{false_yes_s},{later},{stood_s},{went_on_m},{},\"{reason}\"",
            self.holds(hazard)
        )
    }
}

const HEADING: &str = "| input | fault | first no, ms | longest false yes, ms | later yes | needle stands after, ms | goes on when it is over | holds |\n\
                       |---|---|---|---|---|---|---|---|";
const COLUMNS: &str = "input,fault,first_no_s,false_yes_s,later_yes,stood_s,went_on_m,holds,reason";

/// The processes of one cell.
struct Loop {
    cable: Cable,
    twin: Node,
    guard: Node,
    driver: Node,
}

impl Loop {
    fn start(hazard: Hazard, folder: &Path) -> Result<Self, CliError> {
        let domain = environment::free_domain()
            .ok_or_else(|| CliError::Nodes("every ROS domain of this machine is in use".to_owned()))?;
        let simulated = matches!(hazard, Hazard::Message(Stream::Clock, _));
        let cable = Cable::start(domain, simulated)?;
        let driver = [
            "--ros-args",
            "-p",
            "mode:=driver",
            "-p",
            "driver_rate_hz:=500.0",
            "-p",
            "command_timeout_s:=0.03",
            "-p",
            "load_cell:=subminiature",
            "-p",
            "displacement_sensor:=magnetostrictive",
            "-r",
            "servo_jp:=rig_jp",
        ];
        let time = format!("use_sim_time:={simulated}");
        let twin = [
            "--scene",
            "needle_insertion",
            "--ros-args",
            "-p",
            "threads:=1",
            "-p",
            "residual_band_n:=0.02",
            "-p",
            "tissue_rate_hz:=0.0",
            "-p",
            &time,
            "-r",
            "measured_js:=twin_js",
            "-r",
            "measured_cf:=twin_cf",
        ];
        let guard = [
            "--ros-args",
            "-p",
            "goal_depth_m:=0.0095",
            "-p",
            "speed_m_per_s:=0.002",
            "-p",
            "force_limit_n:=10.0",
            "-r",
            "measured_js:=guard_js",
            "-r",
            "predicted_cf:=guard_cf",
            "-r",
            "safety:=guard_safety",
        ];
        Ok(Self {
            cable,
            driver: Node::start("rig-node", &driver, domain, folder)?,
            twin: Node::start("twin-node", &twin, domain, folder)?,
            guard: Node::start("guard", &guard, domain, folder)?,
        })
    }

    /// Waits until the needle is at a depth on its way, and moves. A pause of a busy machine stops it, as it must; then it is told to go on.
    fn reach(&mut self, depth_m: f64) -> Result<(), CliError> {
        let begun = Instant::now();
        let mut moved = begun;
        loop {
            let ((at_m, speed), now) = (self.cable.needle(), Instant::now());
            if at_m >= depth_m {
                return Ok(());
            }
            if speed != 0.0 {
                moved = now;
            } else if now - moved > STANDS {
                self.cable.resume();
                moved = now;
            }
            for node in [&mut self.driver, &mut self.twin, &mut self.guard] {
                if node.ended().is_some() {
                    return Err(node.failure("has ended"));
                }
            }
            if begun.elapsed() > PATIENCE {
                return Err(self.guard.failure("has not brought the needle to the depth at which the fault begins"));
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    fn process(&self, process: Process) -> Option<Pid> {
        match process {
            Process::Twin => Some(self.twin.process()),
            Process::TwinMiddleware => self.twin.middleware(),
            Process::Guard => Some(self.guard.process()),
            Process::GuardMiddleware => self.guard.middleware(),
            Process::Driver => Some(self.driver.process()),
        }
    }

    fn signal(&self, process: Process, signal: Signal) -> i64 {
        let now = wall_nanos();
        if let Some(id) = self.process(process) {
            // Fails only if it has just ended by itself.
            let _ = kill_process(id, signal);
        }
        now
    }

    /// Lets the fault happen and be over; when it began and ended, ns.
    ///
    /// # Errors
    /// A thread can't be stopped.
    fn suffer(&self, hazard: Hazard) -> Result<[i64; 2], CliError> {
        const ALL: [Process; 5] =
            [Process::Driver, Process::TwinMiddleware, Process::Twin, Process::GuardMiddleware, Process::Guard];
        let mut begun = wall_nanos();
        let mut hung = None;
        match hazard {
            Hazard::Message(stream, fault) => self.cable.spoil(Some((stream, fault))),
            Hazard::Frozen(process) => begun = self.signal(process, Signal::STOP),
            Hazard::Killed(process) => begun = self.signal(process, Signal::KILL),
            Hazard::Hung(process, thread) => {
                let stopped = self.process(process).ok_or_else(|| "has no such process".to_owned());
                hung = Some(
                    stopped
                        .and_then(|id| Hung::new(id.as_raw_nonzero().get().unsigned_abs(), thread.name))
                        .map_err(CliError::Nodes)?,
                );
            }
            Hazard::Suspended => {
                for process in ALL {
                    let _ = self.signal(process, Signal::STOP);
                }
            }
            Hazard::Set(setting) => self.cable.set(setting),
            Hazard::Tare => {
                self.cable.spoil(Some((Stream::Force, Fault::Jumping)));
                std::thread::sleep(Duration::from_millis(200));
                self.cable.tare();
            }
        }
        std::thread::sleep(LASTS);
        let ended = wall_nanos();
        match hazard {
            Hazard::Message(..) | Hazard::Tare => self.cable.spoil(None),
            Hazard::Frozen(process) => drop(self.signal(process, Signal::CONT)),
            Hazard::Suspended => {
                for process in ALL {
                    let _ = self.signal(process, Signal::CONT);
                }
            }
            Hazard::Killed(_) | Hazard::Hung(..) | Hazard::Set(_) => drop(hung),
        }
        std::thread::sleep(LASTS);
        // the first message that was spoilt, not the wish for it
        let first = self.cable.heard().begun;
        let by_message = matches!(hazard, Hazard::Message(..) | Hazard::Tare | Hazard::Set(_));
        Ok([if by_message { first.unwrap_or(begun) } else { begun }, ended])
    }
}

fn run_one(hazard: Hazard, folder: &Path) -> Result<Seen, CliError> {
    let mut run = Loop::start(hazard, folder)?;
    run.reach(FAULT_AT_M)?;
    let [begun, ended] = run.suffer(hazard)?;
    let heard = run.cable.heard();
    let mut seen = Seen::of(&heard, begun, ended, matches!(hazard, Hazard::Message(Stream::Clock, _)));
    if hazard == Hazard::Tare && heard.taken != Some(false) {
        seen.later = seen.later.max(1);
        seen.reason = "the tare was taken, or not answered".to_owned();
    }
    drop(heard);
    for node in [&mut run.guard, &mut run.twin, &mut run.driver] {
        let _ = node.stop(Duration::from_secs(2));
    }
    Ok(seen)
}

/// Threads that do nothing but use the processor, until dropped.
struct Load(Arc<AtomicBool>);

impl Load {
    fn start(threads: u32) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        for _ in 0..threads {
            let stop = Arc::clone(&stop);
            std::thread::spawn(move || {
                while !stop.load(Ordering::Relaxed) {
                    std::hint::spin_loop();
                }
            });
        }
        Self(stop)
    }
}

impl Drop for Load {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

impl Hazards {
    pub(crate) fn run(&self) -> Result<Outcome, CliError> {
        let folder = OutputFolder::prepare(&self.out)?;
        let _load = Load::start(self.load);
        let wanted = self.only.as_deref().unwrap_or_default();
        let mut all = hazards(self.quick);
        all.retain(|hazard| hazard.words().join(", ").contains(wanted));
        if all.is_empty() {
            return Err(CliError::Nodes(format!("--only {wanted}: no cell has this in its input and fault")));
        }
        let bar = super::bar(all.len() as u64, "{pos}/{len} hazards");
        let progress = Progress::silent();
        let (mut rows, mut csv, mut hold) = (vec![HEADING.to_owned()], vec![COLUMNS.to_owned()], true);
        print(&format!("{HEADING}\n"))?;
        for hazard in all {
            bar.set_message(hazard.words().join(", "));
            let mut worst: Option<Seen> = None;
            for _ in 0..self.trials {
                let seen = run_one(hazard, &folder.path)?;
                worst = Some(worst.map_or(seen.clone(), |before| before.worse(seen)));
            }
            let Some(seen) = worst else { continue };
            hold &= seen.holds(hazard);
            bar.suspend(|| print(&format!("{}\n", seen.row(hazard))))?;
            rows.push(seen.row(hazard));
            csv.push(seen.csv(hazard));
            bar.inc(1);
            if progress.cancel().is_cancelled() {
                break;
            }
        }
        bar.finish_and_clear();
        for (name, lines) in [("hazards.md", rows), ("hazards.csv", csv)] {
            let path = folder.path.join(name);
            std::fs::write(&path, lines.join("\n") + "\n")
                .map_err(|error| CliError::Nodes(format!("{}: {error}", path.display())))?;
        }
        Ok(if hold && !progress.cancel().is_cancelled() { Outcome::Complete } else { Outcome::Lossy })
    }
}
