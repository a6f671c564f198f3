//! `needle_twin tune`: a scene file that is as coarse as a tolerance allows and as fast as a stream of poses asks.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread;
use std::time::{Duration, Instant};

use clap::Args;

use super::interrupt::Interrupt;
use super::options::{SetOptions, ThreadOptions};
use super::progress::two_figures;
use super::tune_progress::{Shown, best_so_far};
use super::{CliError, Outcome, print, scene_file, warn};
use needle_core::scene::{Motion, Override, Scene, Seconds};
use needle_estimate::compare::{Keep, Run, Session};
use needle_studies::accuracy::{self, Row, StudyError, largest_error};
use needle_studies::correction::{self, Learnt};
use needle_studies::progress::Progress;
use needle_studies::reference_solution::ReferenceSolution;
use needle_studies::tune::{self, Goal, Tuned};

/// How far off a cloud may be that is to be corrected, over the tolerance: what was left at depths between was 0.3 to 0.6 of it (docs/lab/performance.md).
const TO_BE_CORRECTED: f64 = 4.0;
/// Time between two looks at the search.
const LOOK: Duration = Duration::from_millis(100);
/// Time after a signal in which the search may still end by itself.
const GRACE: Duration = Duration::from_millis(300);

/// Find the coarsest cloud and the fewest steps that meet a tolerance and a rate of poses on this machine, and write
/// them as a scene file
#[derive(Clone, Debug, Args)]
pub(super) struct Arguments {
    /// Preset or scene file
    #[arg(long, value_name = "NAME|FILE", help_heading = "Scene")]
    scene: String,

    #[command(flatten)]
    set: SetOptions,

    /// Largest relative error of the force, from a fifth of the scene's path on
    #[arg(long, value_name = "E", default_value_t = 0.02, value_parser = share, help_heading = "Goal")]
    tolerance: f64,

    /// Poses per second that have to be answered
    #[arg(long, value_name = "R", default_value_t = 1000.0, value_parser = rate, help_heading = "Goal")]
    pose_hz: f64,

    /// Take a coarser cloud, and correct its force and targets by what a finer one has at rest along the scene's path. What is left is
    /// measured in a run with another deformation coefficient or Poisson's ratio, and held to the tolerance; clouds within 4 times that are tried
    #[arg(long, help_heading = "Goal")]
    correct: bool,

    /// Correct the scene with this key of discretisation or stepping changed, at its own pace, and look for no other cloud (may be repeated)
    #[arg(long, value_name = "KEY=VALUE", requires = "correct", value_parser = of_cloud, help_heading = "Goal")]
    cloud: Vec<String>,

    #[command(flatten)]
    threads: ThreadOptions,

    /// Write the scene into this file [default: to stdout]
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    out: Option<PathBuf>,
}

fn share(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|x| (0.0..1.0).contains(x) && *x > 0.0);
    number.ok_or_else(|| "a number between 0 and 1, as 0.02 for 2 %".to_owned())
}

fn of_cloud(text: &str) -> Result<String, String> {
    let is_one = text.starts_with("discretisation.") || text.starts_with("stepping.");
    let why = "a key of [discretisation] or [stepping] and its value, as discretisation.spacing_m=0.004; --set changes the others";
    if is_one { Ok(text.to_owned()) } else { Err(why.to_owned()) }
}

fn rate(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|x| (0.1..=1e6).contains(x));
    number.ok_or_else(|| "a number of Hz from 0.1 to 1000000".to_owned())
}

pub(super) fn run(arguments: &Arguments) -> Result<Outcome, CliError> {
    let interrupt = Interrupt::listen();
    let scene = arguments.set.apply(&scene_file::load(&arguments.scene)?, [])?;
    let depth = scene.motion.ok_or_else(|| StudyError::NoMotion(scene.name.clone()))?.depth.get();
    let goal = Goal { tolerance: arguments.tolerance, pose_hz: arguments.pose_hz };
    let progress = Progress::of(interrupt.cancel());
    let (tell, news) = channel();
    let job = Job { scene, depth, goal, arguments: arguments.clone(), progress: progress.clone(), tell };
    // A cloud that is being built hears no signal. So the search has a thread of its own, which the end of the process
    // ends.
    let thread = thread::spawn(move || job.work());
    let mut shown = Shown::new(goal.tolerance);
    let (mut known, mut learnt) = (None, None);
    let mut ended_early = None;
    let finished = loop {
        let next = news.recv_timeout(LOOK);
        shown.show(&progress.now());
        match next {
            Ok(News::Said(text)) => shown.say(&text),
            Ok(News::Known(reference_solution)) => known = Some(*reference_solution),
            Ok(News::Learnt(what)) => learnt = Some(*what),
            Ok(News::Done(finished)) => break (*finished)?,
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => match thread.join() {
                Err(panic) => std::panic::resume_unwind(panic),
                Ok(()) => break None,
            },
        }
        if interrupt.cancel().is_cancelled() && ended_early.get_or_insert_with(Instant::now).elapsed() > GRACE {
            break None;
        }
    };
    shown.finish();
    if let Some(Finished { text, proof }) = finished {
        write(arguments, &text, &proof.text)?;
        return Ok(if proof.met { Outcome::Complete } else { Outcome::Lossy });
    }
    // before it is corrected, a cloud may be off by more than the tolerance
    let within = |tuned: &Tuned| tuned.row.max_force_error().is_some_and(|error| error <= goal.tolerance);
    let best = progress.now().best.filter(|tuned| learnt.is_some() || within(tuned));
    match best.zip(known) {
        None => warn("interrupted: nothing was found yet, so nothing is written"),
        Some((tuned, known)) => {
            let text = written(&tuned, &known, goal, arguments, learnt.as_ref());
            let text = format!("# The search was interrupted: this is the best so far.\n{text}");
            write(arguments, &text, &format!("interrupted: {}\n", best_so_far(&tuned)))?;
        }
    }
    Ok(Outcome::Lossy)
}

/// Writes the scene into its file or to stdout, and says something about it.
fn write(arguments: &Arguments, scene: &str, said: &str) -> Result<(), CliError> {
    match &arguments.out {
        Some(path) => {
            needle_report::write_file(path, scene.as_bytes())?;
            print(&format!("{}\n{said}", path.display()))
        }
        None => {
            eprint(said);
            print(scene)
        }
    }
}

/// What the search says to those who wait.
enum News {
    Said(String),
    Known(Box<ReferenceSolution>),
    Learnt(Box<Learnt>),
    Done(Box<Result<Option<Finished>, CliError>>),
}

/// The scene that was found, and what a run of it shows.
struct Finished {
    text: String,
    proof: Proof,
}

fn rayon_threads(arguments: &Arguments) -> usize {
    let cores = || thread::available_parallelism().map_or(1, usize::from);
    arguments.threads.threads.map_or_else(cores, usize::from)
}

fn eprint(text: &str) {
    use std::io::Write as _;
    let _ = write!(std::io::stderr(), "{text}"); // nowhere left to say that it can't be said
}

/// What was found, and what was measured on the way.
struct Found {
    reference_solution: ReferenceSolution,
    tuned: Tuned,
    learnt: Option<Learnt>,
}

/// A search, and those whom it tells.
struct Job {
    scene: Scene,
    depth: f64,
    goal: Goal,
    arguments: Arguments,
    progress: Progress,
    tell: Sender<News>,
}

impl Job {
    fn work(&self) {
        let finished = self.arguments.threads.install(|| self.finish()).flatten();
        self.tell(News::Done(Box::new(finished)));
    }

    fn tell(&self, news: News) {
        let _ = self.tell.send(news); // nobody listens any more once it was interrupted
    }

    fn said(&self, text: String) {
        self.tell(News::Said(text));
    }

    fn known(&self, reference_solution: &ReferenceSolution) {
        self.tell(News::Known(Box::new(reference_solution.clone())));
    }

    /// Searches, and runs the scene that will be written; `None` if it was interrupted.
    fn finish(&self) -> Result<Option<Finished>, CliError> {
        let goal = self.goal;
        let Some(Found { reference_solution, tuned, learnt }) = self.search()? else { return Ok(None) };
        let text = written(&tuned, &reference_solution, goal, &self.arguments, learnt.as_ref());
        // what is shown is what the file says
        let scene = scene_file::from_text(&text, &tuned.scene.name)?;
        let Some(run) = self.run_of(&scene)? else { return Ok(None) };
        let mut proof = proof(&run, &reference_solution, goal);
        if let Some(learnt) = &learnt {
            proof.text += &(told(learnt, goal) + &told_of_targets(&tuned.row, goal));
            proof.met &=
                learnt.left <= goal.tolerance && tuned.row.way_error.is_none_or(|error| error <= goal.tolerance);
        }
        Ok(Some(Finished { text, proof }))
    }

    fn search(&self) -> Result<Option<Found>, CliError> {
        let Self { scene, depth, goal, arguments, progress, .. } = self;
        if !arguments.cloud.is_empty() {
            return self.correct();
        }
        let Some(reference_solution) = ReferenceSolution::of_force(scene, *depth, progress)? else { return Ok(None) };
        self.known(&reference_solution);
        self.said(format!("forces are held against {}\n{}", reference_solution.source, accuracy::heading()));
        if !arguments.correct {
            let tuned = tune::tune(scene, &reference_solution, *goal, progress)?;
            return Ok(tuned.map(|tuned| Found { reference_solution, tuned, learnt: None }));
        }
        let wide = Goal { tolerance: (TO_BE_CORRECTED * goal.tolerance).min(0.5), ..*goal };
        let Some(tuned) = tune::coarsest(scene, &reference_solution, wide, progress)? else { return Ok(None) };
        let Some(learnt) = self.learn(&tuned.scene)? else { return Ok(None) };
        let scenes = [&learnt.scene, &Learnt::other(learnt.held_out, &learnt.scene)?];
        let paced = tune::paced(scenes, &tuned.row.case, &learnt.known, *goal, progress)?;
        Ok(paced.map(|tuned| Found { reference_solution, tuned, learnt: Some(learnt) }))
    }

    /// The scene with the keys of `--cloud`, corrected, at its own pace.
    fn correct(&self) -> Result<Option<Found>, CliError> {
        let Self { scene, goal, .. } = self;
        let keys = self.arguments.cloud.iter().map(|text| Override::parse(text, "--cloud"));
        let keys = keys.collect::<Result<Vec<_>, _>>()?;
        let cloud = Scene { name: format!("{}_tuned", scene.name), ..goal.asked_of(&scene.with(&keys)?)? };
        let Some(learnt) = self.learn(&cloud)? else { return Ok(None) };
        self.known(&learnt.learnt_from);
        self.said(accuracy::heading());
        let Some(row) = learnt.on_the_way(&self.progress)? else { return Ok(None) };
        let tuned = Tuned { scene: learnt.scene.clone(), row };
        self.progress.best(Some(tuned.clone()));
        Ok(Some(Found { reference_solution: learnt.learnt_from.clone(), tuned, learnt: Some(learnt) }))
    }

    fn learn(&self, cloud: &Scene) -> Result<Option<Learnt>, CliError> {
        self.said(
            "a finer cloud at rest along the path, for the correction, and once more for what is left of it\n"
                .to_owned(),
        );
        let learnt = correction::learn(&self.scene, cloud, self.depth, &self.progress)?;
        if let Some(learnt) = &learnt {
            // what was best before is not corrected
            self.progress.best(None);
            self.tell(News::Learnt(Box::new(learnt.clone())));
            self.said(told(learnt, self.goal));
        }
        Ok(learnt)
    }

    /// Runs the scene's insertion as `solve` does; `None` if it was interrupted.
    fn run_of(&self, scene: &Scene) -> Result<Option<Run>, CliError> {
        let motion = scene.motion.ok_or_else(|| CliError::NoMotion { scene: scene.name.clone() })?;
        let motion = Motion { hold: Seconds(0.0), retract: false, insertions: 1, ..motion };
        self.progress.begin("the scene that will be written", 0);
        let session = Session::new(scene, "tune", Keep::ANSWERS)
            .map_err(|source| CliError::Build { scene: scene.name.clone(), source })?;
        let mut watch = self.progress.poses(Session::motion(&motion).count());
        let run = session.run(Session::motion(&motion), &mut watch).run;
        Ok((!self.progress.cancel().is_cancelled()).then_some(run))
    }
}

/// What is left after a correction in the run that it was not learnt from.
fn told(learnt: &Learnt, goal: Goal) -> String {
    let (key, value) = learnt.held_out;
    let dropped = if learnt.dropped.is_empty() {
        String::new()
    } else {
        format!(" (without a correction, since nearer so: {})", learnt.dropped.join("; "))
    };
    format!(
        "corrected{dropped}; with {key} = {value:.4}, which it was not learnt from, {:.2} % of force and targets are left of {:.2} %: {}\n",
        100.0 * learnt.left,
        100.0 * learnt.before,
        met(learnt.left <= goal.tolerance)
    )
}

/// How far targets of a corrected scene are off on the way, in the run that it was not learnt from.
fn told_of_targets(row: &Row, goal: Goal) -> String {
    row.way_error.map_or_else(String::new, |error| {
        format!(
            "on the way there the targets are within {:.2} % of their greatest motion: {}\n",
            100.0 * error,
            met(error <= goal.tolerance)
        )
    })
}

fn met(is: bool) -> &'static str {
    if is { "met" } else { "NOT met" }
}

/// The scene file, with what was measured above it.
fn written(
    tuned: &Tuned,
    reference_solution: &ReferenceSolution,
    goal: Goal,
    arguments: &Arguments,
    learnt: Option<&Learnt>,
) -> String {
    let (row, threads) = (&tuned.row, rayon_threads(arguments));
    let wanted = if arguments.cloud.is_empty() {
        format!("force within {} % of", accuracy_percent(goal.tolerance))
    } else {
        format!("with {}, against", arguments.cloud.join(", "))
    };
    let mut text = String::new();
    // Writing to a String can't fail.
    let _ = writeln!(
        text,
        "# Written by `needle_twin tune`: {wanted} {} at {} poses per second.\n\
         # Measured on {threads} thread{}: largest error {:.2} %, {:.4} ms of processor time per pose, {} nodes, {} points.\n\
         # Another machine has other costs: run it there.\n",
        learnt.map_or(&reference_solution.source, |learnt| &learnt.known.source),
        goal.pose_hz,
        if threads == 1 { "" } else { "s" },
        100.0 * row.max_force_error().unwrap_or(f64::NAN),
        1e3 * row.cost_per_pose_s(),
        row.nodes,
        row.integration_points,
    );
    if let Some(learnt) = learnt {
        let _ = write!(text, "# That is {}", told(learnt, goal));
        let targets = told_of_targets(row, goal);
        let _ = writeln!(text, "{}{targets}", if targets.is_empty() { "" } else { "# " });
    }
    text + &tuned.scene.to_toml()
}

fn accuracy_percent(share: f64) -> String {
    format!("{:.4}", 100.0 * share).trim_end_matches('0').trim_end_matches('.').to_owned()
}

struct Proof {
    text: String,
    met: bool,
}

/// What the run of the written scene shows.
fn proof(run: &Run, reference_solution: &ReferenceSolution, goal: Goal) -> Proof {
    let path: Vec<(f64, f64)> = run.answers.iter().map(|a| (a.depth_m, a.predicted_n)).collect();
    let vectors: Vec<[f64; 3]> = run.answers.iter().map(|a| a.predicted_vector_n).collect();
    let errors = reference_solution.force_errors(&path, &vectors);
    let whole = errors.len() == reference_solution.force.len() && run.diverged.is_none();
    let error = largest_error(&errors).filter(|_| whole);
    let factor = run.real_time_factor().unwrap_or(0.0);
    let latency = run.latency_ms().map_or_else(String::new, |l| {
        format!("; a pose is answered in {:.3} ms (median), {:.3} ms (99 of 100)", l.p50, l.p99)
    });
    let right = error.is_some_and(|e| e <= goal.tolerance);
    // the depth says whether it is one layer of nodes or the whole way
    let at = errors
        .iter()
        .find(|(_, e)| Some(e.abs()) == error)
        .map_or_else(String::new, |(d, _)| format!(" at {:.2} mm", 1e3 * d));
    let told = error.map_or_else(|| "ended early".to_owned(), |e| format!("{:.2} %{at}", 100.0 * e));
    Proof {
        text: format!(
            "run of the written scene: largest error of the force {told} of {} %: {}; {} times real time at {} Hz: \
             {}{latency}\n",
            accuracy_percent(goal.tolerance),
            met(right),
            two_figures(factor),
            goal.pose_hz,
            met(factor >= 1.0),
        ),
        met: right && factor >= 1.0,
    }
}
