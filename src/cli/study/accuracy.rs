//! `needle_twin study accuracy` and `study merge`: a table that grows as runs finish, and its pictures.

use needle_core::scene::Word as _;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;

use clap::Args;
use indicatif::ProgressBar;

use super::super::interrupt::Interrupt;
use super::super::output::OutputFolder;
use super::super::progress::bar;
use super::super::shard::Shard;
use super::super::{CliError, Outcome, print, scene_file, warn};
use needle_core::scene::{Method, Scene};
use needle_studies::accuracy::{self, Case, Extent, Row, StudyError, Table};
use needle_studies::composites::{Composite, posed};
use needle_studies::correction;
use needle_studies::reference_solution::{ReferenceSolution, study_depth};

/// Presets that have a reference solution.
pub(super) const PRESETS: [&str; 3] = ["compression", "indentation", "needle_insertion"];
/// Name of the whole table.
const TABLE: &str = "accuracy.csv";

/// Chart error against cost: methods, dimensions, spacings, supports, points, precisions, steps per pose
#[derive(Debug, Args)]
pub(super) struct Accuracy {
    /// Preset, scene file, or sample of several materials as in `study verification` (may be repeated) [default: the three presets]
    #[arg(long = "scene", value_name = "NAME|FILE")]
    scenes: Vec<String>,

    /// Method to study (may be repeated) [default: all]
    #[arg(long = "method", value_name = "NAME", value_parser = Method::WORDS.to_vec())]
    methods: Vec<String>,

    /// Coarse clouds and few steps: under three minutes for the three presets on two cores
    #[arg(long)]
    quick: bool,

    /// Instead of the stream of poses: wait at each depth until the tissue is at rest, on three clouds in space, and
    /// print observed orders of convergence
    #[arg(long, conflicts_with = "quick")]
    at_rest: bool,

    /// Only every n-th run, beginning with the i-th; `study merge` joins the parts
    #[arg(long, value_name = "I/N")]
    shard: Option<Shard>,

    /// Write the table and its pictures into this folder; runs that its table has already are not run again
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,

    /// Runs at a time, each on one thread [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

/// Join the tables of several shards, and draw them
#[derive(Debug, Args)]
pub(super) struct Merge {
    /// Tables, or folders with tables, that `study accuracy` has written
    #[arg(required = true, value_name = "DIR|FILE")]
    parts: Vec<PathBuf>,

    /// Write the whole table and its pictures into this folder
    #[arg(long, value_name = "DIR")]
    out: PathBuf,

    /// Say what is missing of the quick study instead of the full one
    #[arg(long)]
    quick: bool,

    /// Say what is missing of the study at rest
    #[arg(long, conflicts_with = "quick")]
    at_rest: bool,
}

/// Name of a part's table.
fn table_of(Shard { number, of }: Shard) -> String {
    format!("accuracy.{number}of{of}.csv")
}

fn extent(quick: bool, at_rest: bool) -> Extent {
    match (quick, at_rest) {
        (true, _) => Extent::Quick,
        (_, true) => Extent::AtRest,
        _ => Extent::Full,
    }
}

/// A scene that is studied, and what it is held against.
struct Subject {
    scene: Scene,
    reference_solution: ReferenceSolution,
}

/// One run that is still to be made.
struct Task<'a> {
    subject: &'a Subject,
    case: Case,
    work: u64,
    /// It has a name of its own in the picture.
    named: bool,
}

impl Accuracy {
    pub(super) fn run(&self) -> Result<Outcome, CliError> {
        let folder = self.out.as_deref().map(OutputFolder::prepare).transpose()?;
        let subjects = self.subjects()?;
        let name = self.shard.map_or_else(|| TABLE.to_owned(), table_of);
        let mut table = folder.as_ref().map(|f| Table::open(&f.path.join(name))).transpose()?;
        let mut rows = table.as_ref().map_or_else(Vec::new, |t| t.rows.clone());
        let known = rows.len();
        let tasks = self.tasks(&subjects, &rows)?;
        if known > 0 {
            warn(&format!("{known} runs are known, {} are left", tasks.len()));
        }
        print(&accuracy::heading())?;
        let interrupt = Interrupt::listen();
        side_by_side(&tasks, self.threads, &interrupt, &mut |row| {
            if let Some(table) = &mut table {
                table.append(row.clone())?;
            }
            rows.push(row);
            Ok(())
        })?;
        let complete = rows.len() == known + tasks.len();
        if !complete {
            warn(&format!("interrupted after {} of {} runs", rows.len() - known, tasks.len()));
        }
        finish(folder.as_ref().map(|f| f.path.as_path()), &rows)?;
        Ok(if complete { Outcome::Complete } else { Outcome::Lossy })
    }

    fn subjects(&self) -> Result<Vec<Subject>, CliError> {
        let all = PRESETS.map(str::to_owned);
        let names = if self.scenes.is_empty() { all.as_slice() } else { &self.scenes };
        let mut subjects: Vec<Subject> = Vec::new();
        for name in names {
            let composite = Composite::find(name).map(Composite::scene).transpose()?;
            let scene = composite.map_or_else(|| scene_file::load(name), Ok)?;
            if subjects.iter().all(|s| s.scene.name != scene.name) {
                let reference_solution = alone(|| ReferenceSolution::of(&scene, study_depth(&scene)?))??;
                subjects.push(Subject { scene, reference_solution });
            }
        }
        Ok(subjects)
    }

    /// The runs that are this part's and not known yet: those with a name first, then the cheapest.
    fn tasks<'a>(&self, subjects: &'a [Subject], known: &[Row]) -> Result<Vec<Task<'a>>, StudyError> {
        let mut tasks = Vec::new();
        for subject in subjects {
            let scene = &subject.scene;
            let named = accuracy::named(scene)?;
            for case in accuracy::plan(scene, extent(self.quick, self.at_rest))? {
                let travel = subject.reference_solution.depth_m() / scene.motion.map_or(1e-3, |m| m.speed.get());
                let work = (travel * accuracy::work(scene, &case) / 1e4) as u64 + 1;
                let named = named.iter().any(|(known, _)| *known == case);
                tasks.push(Task { subject, case, work, named });
            }
        }
        tasks.sort_by_key(|task| (!task.named, task.work));
        let Shard { number, of } = self.shard.unwrap_or(Shard::WHOLE);
        let asked = |case: &Case| self.methods.is_empty() || self.methods.contains(&case.method);
        let mine = tasks.into_iter().filter(|task| asked(&task.case)).skip(number - 1).step_by(of);
        Ok(mine.filter(|task| !known.iter().any(|row| row.is_of(&task.subject.scene.name, &task.case))).collect())
    }
}

/// Runs tasks, each on a thread of its own, until all are done or Ctrl-C is pressed; `take` gets the rows as they finish.
fn side_by_side(
    tasks: &[Task<'_>],
    threads: Option<u16>,
    interrupt: &Interrupt,
    take: &mut dyn FnMut(Row) -> Result<(), CliError>,
) -> Result<(), CliError> {
    let workers = threads.map_or_else(|| std::thread::available_parallelism().map_or(1, usize::from), usize::from);
    let bar = bar(tasks.iter().map(|task| task.work).sum(), "{percent:>3}%");
    let queue = Mutex::new(tasks.iter());
    let failed = AtomicBool::new(false);
    // a failure ends the other runs as well
    let cancel = interrupt.cancel();
    let (sender, finished) = mpsc::channel();
    std::thread::scope(|scope| {
        for _ in 0..workers.min(tasks.len()) {
            let (sender, queue) = (sender.clone(), &queue);
            scope.spawn(move || {
                loop {
                    let next = queue.lock().map(|mut queue| queue.next());
                    let (Ok(Some(task)), false) = (next, cancel.is_cancelled()) else { return };
                    let row = alone(|| {
                        correction::row(&task.case, &task.subject.scene, &task.subject.reference_solution, cancel)
                    });
                    if sender.send((row, task.work)).is_err() {
                        return;
                    }
                }
            });
        }
        drop(sender);
        let taken = receive(&finished, tasks.len(), &bar, take);
        failed.store(taken.is_err(), Ordering::Relaxed);
        bar.finish_and_clear();
        taken
    })
}

/// A row, or that it was stopped; and the work that it was.
type Finished = (Result<Result<Option<Row>, StudyError>, CliError>, u64);

fn receive(
    finished: &mpsc::Receiver<Finished>,
    all: usize,
    bar: &ProgressBar,
    take: &mut dyn FnMut(Row) -> Result<(), CliError>,
) -> Result<(), CliError> {
    let mut done = 0;
    for (row, work) in finished {
        if let Some(row) = row?? {
            done += 1;
            bar.suspend(|| print(&row.line()))?;
            bar.set_message(format!("{done} of {all} runs"));
            bar.inc(work);
            take(row)?;
        }
    }
    Ok(())
}

/// Does some work with one thread per twin.
fn alone<T: Send>(work: impl FnOnce() -> T + Send) -> Result<T, CliError> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    Ok(pool.map_err(|source| CliError::Threads { threads: 1, source })?.install(work))
}

/// Observed orders to stdout, pictures into the folder.
fn finish(folder: Option<&Path>, rows: &[Row]) -> Result<(), CliError> {
    print(&accuracy::orders(rows))?;
    if let Some(folder) = folder {
        for path in needle_report::write_accuracy(folder, rows)? {
            print(&format!("{}\n", path.display()))?;
        }
    }
    Ok(())
}

impl Merge {
    pub(super) fn run(&self) -> Result<Outcome, CliError> {
        let folder = OutputFolder::prepare(&self.out)?;
        let mut parts = Vec::new();
        for path in self.tables()? {
            let rows = accuracy::read(&path)?;
            warn(&format!("{}: {} rows", path.display(), rows.len()));
            parts.extend(rows);
        }
        let (rows, again) = accuracy::merge(parts);
        if again > 0 {
            warn(&format!("{again} rows were there more than once: the cheapest run of each is kept"));
        }
        let path = folder.path.join(TABLE);
        let unwritable = |e: std::io::Error| StudyError::Table { path: path.clone(), reason: e.to_string() };
        let partial = path.with_extension("csv.partial");
        let written = std::fs::write(&partial, accuracy::csv(&rows)).and_then(|()| std::fs::rename(&partial, &path));
        written.map_err(unwritable)?;
        let missing = self.missing(&rows)?;
        missing.iter().for_each(|what| warn(what));
        print(&format!("{}: {} rows, {} missing\n", path.display(), rows.len(), missing.len()))?;
        finish(Some(&folder.path), &rows)?;
        Ok(if missing.is_empty() { Outcome::Complete } else { Outcome::Lossy })
    }

    /// Every table that is named or lies in a folder that is named, each once.
    fn tables(&self) -> Result<Vec<PathBuf>, CliError> {
        let mut tables = Vec::new();
        for part in &self.parts {
            if part.is_dir() {
                let refuse = |reason: String| StudyError::Table { path: part.clone(), reason };
                let entries = std::fs::read_dir(part).map_err(|e| refuse(format!("can't be read ({e})")))?;
                let is_table = |path: &PathBuf| {
                    let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
                    name.starts_with("accuracy.") && name.ends_with(".csv")
                };
                let mut found: Vec<PathBuf> = entries.flatten().map(|e| e.path()).filter(is_table).collect();
                if found.is_empty() {
                    return Err(refuse("holds no accuracy*.csv of `study accuracy`".to_owned()).into());
                }
                found.sort();
                tables.extend(found);
            } else {
                tables.push(part.clone());
            }
        }
        Ok(tables)
    }

    /// The cases of the presets in the rows that have no row.
    fn missing(&self, rows: &[Row]) -> Result<Vec<String>, CliError> {
        let mut of_scene: BTreeMap<&str, Vec<&Row>> = BTreeMap::new();
        rows.iter().for_each(|row| of_scene.entry(&row.scene).or_default().push(row));
        let mut missing = Vec::new();
        for (name, rows) in of_scene {
            let Ok(scene) = posed(name) else {
                warn(&format!("{name} is no preset: what is missing of its study can't be said"));
                continue;
            };
            let cases = accuracy::plan(&scene, extent(self.quick, self.at_rest))?;
            let lacking = cases.iter().filter(|case| !rows.iter().any(|row| row.is_of(name, case)));
            missing.extend(lacking.map(|case| format!("missing: {name}, {}", case.name())));
        }
        Ok(missing)
    }
}
