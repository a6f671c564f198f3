//! The matrix: every instrument with every dimension of the model, law and sample, and what each costs.
//!
//! Each cell is the soft cylinder of the presets with an instrument that goes in at 5 mm/s and 1000 poses per second,
//! with every default and no key of the discretisation but the dimension. A cell works, or is refused with a reason.
//! The error of a cell is that of its steps: the force at the end of the motion against the force after the instrument
//! has stayed there until the force no longer changes, over the peak. It holds nothing of the cloud's error
//! (`verification` has that), and is not known where the tissue relaxes.

use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{Duration, Instant};

use serde::Serialize;

use super::csv;
use needle_core::scene::Scene;
use needle_core::twin::{StampedPose, Twin};
use needle_estimate::compare::{Answer, Cancel, Finished, Keep, Session, Watch};

/// Speed, m/s, and poses per second.
const SPEED_M_PER_S: f64 = 0.005;
const POSE_HZ: f64 = 1000.0;
/// Poses for which the instrument stays at the end, at most, and between two looks at the force.
const STAY: usize = 600;
const LOOK: usize = 50;
/// Change of the force between two looks, over the peak, at which it is at rest.
const AT_REST: f64 = 1e-4;

/// Instruments: name, keys, depth in m.
const INSTRUMENTS: [(&str, &str, f64); 4] = [
    ("plate", "kind = \"plate\"", 0.0025),
    ("indenter", "kind = \"indenter\"\ndiameter_m = 0.01", 0.003),
    ("needle", NEEDLE, 0.006),
    (FRICTION, NEEDLE, 0.006),
];
const NEEDLE: &str = "kind = \"needle\"\ndiameter_m = 0.001\ncapture_radius_m = 0.0005";
const FRICTION: &str = "needle, friction";

/// Dimensions of the model: name, word in a scene, keys of a needle.
const DIMENSIONS: [(&str, &str, &str); 4] = [
    ("half plane", "axisymmetric", ""),
    ("mirrored", "mirrored", ""),
    ("mirrored, 15 deg", "mirrored", "tilt_rad = 0.26"),
    ("full", "full", ""),
];

/// Laws: name, keys. All have the preset's modulus at small strain.
const LAWS: [(&str, &str); 7] = [
    ("neo-Hookean", "model = \"neo_hookean\"\nshear_modulus_pa = 1678.0"),
    ("Ogden", "model = \"ogden\"\nogden_shear_moduli_pa = [1678.0]\nogden_exponents = [4.0]"),
    ("Mooney-Rivlin", "model = \"mooney_rivlin\"\nc10_pa = 600.0\nc01_pa = 239.0"),
    ("Yeoh", "model = \"yeoh\"\nc10_pa = 839.0\nc20_pa = 200.0\nc30_pa = 50.0"),
    ("Veronda-Westmann", "model = \"veronda_westmann\"\nshear_modulus_pa = 1678.0\nstiffening_exponent = 1.0"),
    (
        "2 Prony terms",
        "model = \"neo_hookean\"\nshear_modulus_pa = 1678.0\nprony_shares = [0.2, 0.2]\nprony_times_s = [0.5, 5.0]",
    ),
    (
        "Ogden, 2 Prony",
        "model = \"ogden\"\nogden_shear_moduli_pa = [1678.0]\nogden_exponents = [4.0]\nprony_shares = [0.2, 0.2]\n\
         prony_times_s = [0.5, 5.0]",
    ),
];

/// Samples.
const SAMPLES: [&str; 4] = ["one material", "layers", "inclusion", "membranes"];

/// One cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cell {
    instrument: usize,
    dimension: usize,
    law: usize,
    sample: usize,
}

/// What a cell came to.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Instrument.
    pub instrument: &'static str,
    /// Dimension of the model.
    pub dimension: &'static str,
    /// Law.
    pub law: &'static str,
    /// Sample.
    pub sample: &'static str,
    /// Nodes, and integration points.
    pub nodes: usize,
    /// Integration points.
    pub points: usize,
    /// Depth reached, m, and the depth of the motion.
    pub reached_m: f64,
    /// Depth of the motion, m.
    pub depth_m: f64,
    /// Simulated time over wall time.
    pub real_time_factor: Option<f64>,
    /// Longest pose, ms.
    pub longest_pose_ms: Option<f64>,
    /// Mean steps per pose.
    pub steps_per_pose: Option<f64>,
    /// Largest imbalance of forces over the peak.
    pub imbalance: Option<f64>,
    /// Error of the steps at the end, over the peak; see the module.
    pub step_error: Option<f64>,
    /// `ok`, or why not.
    pub outcome: String,
}

/// The cells; `quick` takes two laws, two dimensions and two samples.
#[must_use]
pub fn cells(quick: bool) -> Vec<Cell> {
    let all = |n: usize, few: &[usize]| if quick { few.to_vec() } else { (0..n).collect::<Vec<usize>>() };
    let mut cells = Vec::new();
    for instrument in 0..INSTRUMENTS.len() {
        for dimension in all(DIMENSIONS.len(), &[0, 2]) {
            for law in all(LAWS.len(), &[0, 6]) {
                for sample in all(SAMPLES.len(), &[0, 3]) {
                    let cell = Cell { instrument, dimension, law, sample };
                    if cell.is_physics() {
                        cells.push(cell);
                    }
                }
            }
        }
    }
    cells
}

impl Cell {
    /// Whether the combination means anything: a tilt is of needles, and a membrane is cut by one.
    fn is_physics(self) -> bool {
        let (name, tilt) = (INSTRUMENTS[self.instrument].0, DIMENSIONS[self.dimension].2);
        let needle = name.starts_with("needle");
        (tilt.is_empty() || needle) && (SAMPLES[self.sample] != "membranes" || name == FRICTION)
    }

    /// The scene file.
    fn toml(self) -> String {
        let (name, instrument, depth_m) = INSTRUMENTS[self.instrument];
        let (_, dimension, tilt) = DIMENSIONS[self.dimension];
        let (law, sample) = (LAWS[self.law].1, SAMPLES[self.sample]);
        let friction = name == FRICTION;
        let rubs = if friction { "friction_n_per_m = 3.0\ncutting_force_n = 0.003\n" } else { "" };
        let breaks = if sample == "membranes" { "puncture_force_n = 0.008\n" } else { "" };
        let gel = format!("{law}\npoisson_ratio = 0.49\ndensity_kg_per_m3 = 970.0\n");
        // of twice the stiffness
        let stiff = gel.replace("1678.0", "3356.0").replace("839.0", "1678.0").replace("600.0", "1439.0");
        let material = |name: &str, keys: &str| format!("[materials.{name}]\n{keys}{rubs}{breaks}\n");
        let region = |name: &str, material: &str, shape: &str| {
            format!("[[regions]]\nname = \"{name}\"\nmaterial = \"{material}\"\n{shape}\n\n")
        };
        let layer = |from: &str, to: &str| format!("shape = \"layer\"\nfrom_depth_m = {from}\nto_depth_m = {to}");
        let ball = "shape = \"sphere\"\ncentre_m = [0.0, 0.0, 0.009]\nradius_m = 0.003";
        let first = match sample {
            "one material" => None,
            "inclusion" => Some(region("nodule", "stiff", ball)),
            _ => Some(region("top", "stiff", &layer("0.0", "0.003"))),
        };
        // a needle's forces stand beside the instrument's keys where the sample is one material
        let own = if first.is_none() { rubs } else { "" };
        let regions = first.map_or_else(String::new, |first| {
            material("stiff", &stiff)
                + &material("deep", &gel)
                + &first
                + &region("rest", "deep", &layer("0.0", "0.017"))
        });
        let interaction = if friction { "interaction = \"frictional\"\n" } else { "" };
        let background = format!("[material]\n{gel}\n");
        format!(
            "name = \"matrix\"\ndescription = \"a cell of the matrix\"\n\n[sample]\nshape = \"cylinder\"\ndiameter_m = 0.03\nheight_m = 0.017\n\n\
             {background}{regions}[instrument]\n{instrument}\n{interaction}{own}{tilt}\n\n[discretisation]\ndimension = \"{dimension}\"\n\n\
             [motion]\ndepth_m = {depth_m}\nspeed_m_per_s = {SPEED_M_PER_S}\npose_hz = {POSE_HZ}\nhold_s = 0.0\n"
        )
    }

    /// Runs the cell for `budget_s` seconds at most.
    #[must_use]
    pub fn run(self, budget_s: f64, cancel: &Cancel) -> Row {
        let (instrument, _, depth_m) = INSTRUMENTS[self.instrument];
        let row = Row {
            instrument,
            dimension: DIMENSIONS[self.dimension].0,
            law: LAWS[self.law].0,
            sample: SAMPLES[self.sample],
            nodes: 0,
            points: 0,
            reached_m: 0.0,
            depth_m,
            real_time_factor: None,
            longest_pose_ms: None,
            steps_per_pose: None,
            imbalance: None,
            step_error: None,
            outcome: String::new(),
        };
        let refused = |reason: String| Row { outcome: format!("refused: {reason}"), ..row.clone() };
        let scene = match Scene::from_toml(&self.toml(), "a cell of the matrix") {
            Ok(scene) => scene,
            Err(error) => return refused(error.to_string()),
        };
        let Some(motion) = scene.motion else { return refused("it has no motion".to_owned()) };
        let session = match Session::new(&scene, "study matrix", Keep::ANSWERS) {
            Ok(session) => session,
            Err(error) => return refused(error.to_string()),
        };
        let limit = Limit::new(budget_s, cancel);
        let way_in = Session::motion(&motion).take_while(|r| r.time_s <= depth_m / SPEED_M_PER_S + 1e-9);
        let Finished { run, twin, .. } = limit.watch(|watch| session.run(way_in, watch));
        let over = limit.is_over();
        let outcome = match &run.diverged {
            Some(reason) => format!("lost: {reason}"),
            None if over => format!("slower: stopped after {budget_s} s"),
            None if !run.unstable().is_empty() => run.unstable().join("; "),
            None => "ok".to_owned(),
        };
        let rests = run.diverged.is_none() && !over && !LAWS[self.law].0.contains("Prony");
        Row {
            nodes: run.nodes,
            points: run.integration_points,
            reached_m: run.answers.iter().map(|a| a.depth_m).fold(0.0, f64::max),
            real_time_factor: run.real_time_factor(),
            longest_pose_ms: run.latency_ms().map(|l| l.max),
            steps_per_pose: run.steps_per_pose(),
            imbalance: Some(run.force_imbalance),
            step_error: if rests { step_error(twin, &run.answers) } else { None },
            outcome,
            ..row
        }
    }
}

/// The force at the end of a motion against that after a stay, over the peak.
fn step_error(mut twin: Twin, answers: &[Answer]) -> Option<f64> {
    let (end, peak) = (answers.last()?, answers.iter().map(|a| a.predicted_n.abs()).fold(0.0, f64::max));
    let pose = twin.pose_at_depth(end.depth_m);
    twin.stop_on(Cancel::default().flag());
    let (mut before, mut time_s) = (end.predicted_vector_n, end.time_s);
    for i in 1..=STAY {
        time_s += 1.0 / POSE_HZ;
        let force = twin.follow(StampedPose { time_s, pose }).ok()?.force_n;
        if i % LOOK == 0 {
            if distance(force, before) < AT_REST * peak {
                return Some(distance(force, end.predicted_vector_n) / peak).filter(|e| e.is_finite());
            }
            before = force;
        }
    }
    None
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt()
}

/// Ends a run after some time, also in the middle of a pose.
struct Limit<'a> {
    budget_s: f64,
    cancel: &'a Cancel,
    own: Cancel,
    over: AtomicBool,
    done: AtomicBool,
}

impl<'a> Limit<'a> {
    fn new(budget_s: f64, cancel: &'a Cancel) -> Self {
        Self { budget_s, cancel, own: Cancel::default(), over: AtomicBool::new(false), done: AtomicBool::new(false) }
    }

    fn is_over(&self) -> bool {
        self.over.load(Relaxed)
    }

    fn watch<T>(&self, work: impl FnOnce(&mut dyn Watch) -> T) -> T {
        std::thread::scope(|scope| {
            scope.spawn(|| {
                let begun = Instant::now();
                while !self.done.load(Relaxed) {
                    let late = begun.elapsed().as_secs_f64() > self.budget_s;
                    if late || self.cancel.is_cancelled() {
                        self.over.store(true, Relaxed);
                        self.own.cancel();
                        break;
                    }
                    std::thread::sleep(Duration::from_millis(5));
                }
            });
            let result = work(&mut self.own.clone());
            self.done.store(true, Relaxed);
            result
        })
    }
}

impl Row {
    /// One line of the table.
    #[must_use]
    pub fn line(&self) -> String {
        let number = |x: Option<f64>, digits: usize| x.map_or_else(|| "-".to_owned(), |x| format!("{x:.digits$}"));
        let percent = |x: Option<f64>| number(x.map(|x| 100.0 * x), 2);
        format!(
            "{:<18}{:<18}{:<18}{:<14}{:>7}{:>8}{:>9}{:>10}{:>8}{:>8}{:>8}  {}\n",
            self.instrument,
            self.dimension,
            self.law,
            self.sample,
            self.nodes,
            self.points,
            number(self.real_time_factor, 2),
            number(self.longest_pose_ms, 2),
            number(self.steps_per_pose, 1),
            percent(self.imbalance),
            percent(self.step_error),
            self.outcome,
        )
    }
}

/// Heading of the table.
#[must_use]
pub fn heading() -> String {
    format!(
        "{:<18}{:<18}{:<18}{:<14}{:>7}{:>8}{:>9}{:>10}{:>8}{:>8}{:>8}  {}\n",
        "instrument",
        "model",
        "law",
        "sample",
        "nodes",
        "points",
        "factor",
        "longest ms",
        "steps",
        "bal. %",
        "step %",
        "outcome"
    )
}

/// Content of `matrix.csv`.
#[must_use]
pub fn csv(rows: &[Row]) -> String {
    csv::write(rows)
}
