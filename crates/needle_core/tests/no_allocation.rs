//! Contract of [`Twin::step`]: no memory is allocated per pose, in any phase, on any of the solver's threads.
#![allow(clippy::unwrap_used)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU64, Ordering};

use needle_core::scene::{Override, Scene};
use needle_core::twin::{Phase, StampedPose, Team, Twin};
use testkit::coarse::scene;

/// The system's allocator, counting while told to. Freed memory counts too: a real-time loop must do neither.
struct Counting;

static COUNTS: AtomicBool = AtomicBool::new(false);
static CALLS: AtomicU64 = AtomicU64::new(0);
static BYTES: AtomicU64 = AtomicU64::new(0);
/// Bytes that are given out.
static HELD: AtomicI64 = AtomicI64::new(0);
/// Calls by the thread that calls [`Twin::step`].
static OWN: AtomicU64 = AtomicU64::new(0);

thread_local! {
    static STEPS: Cell<bool> = const { Cell::new(false) };
}

fn count(bytes: usize) {
    if COUNTS.load(Ordering::Relaxed) {
        CALLS.fetch_add(1, Ordering::Relaxed);
        OWN.fetch_add(STEPS.with(|own| u64::from(own.get())), Ordering::Relaxed);
        BYTES.fetch_add(bytes as u64, Ordering::Relaxed);
    }
}

// SAFETY: every call is handed to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size());
        HELD.fetch_add(layout.size() as i64, Ordering::Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        count(0);
        HELD.fetch_sub(layout.size() as i64, Ordering::Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.dealloc(at, layout) }
    }

    unsafe fn realloc(&self, at: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count(size);
        HELD.fetch_add(size as i64 - layout.size() as i64, Ordering::Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.realloc(at, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Allocations during the poses from depth to depth, those by this thread, and the phases seen.
fn calls(twin: &mut Twin, depths: &[f64]) -> ([u64; 2], Vec<Phase>) {
    let mut phases = Vec::with_capacity(depths.len());
    let now = || [&CALLS, &OWN].map(|count| count.load(Ordering::SeqCst));
    let before = now();
    STEPS.set(true);
    for depth in depths {
        let pose = StampedPose { time_s: 0.01 * phases.len() as f64, pose: twin.pose_at_depth(*depth) };
        COUNTS.store(true, Ordering::SeqCst);
        let answer = twin.step(pose);
        COUNTS.store(false, Ordering::SeqCst);
        phases.push(answer.unwrap().phase);
    }
    let after = now();
    ([after[0] - before[0], after[1] - before[1]], phases)
}

/// A twin that steps on two threads. The threads that built it have ended: only those that step are left to be counted (a worker of rayon's
/// that looks for work now and then frees what its queues have left).
fn on_two_threads(scene: &Scene) -> Twin {
    let mut workers = Vec::new();
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(2)
        .spawn_handler(|worker| {
            workers.push(std::thread::spawn(|| worker.run()));
            Ok(())
        })
        .build()
        .unwrap();
    let twin = pool.install(|| Twin::new(scene)).unwrap();
    drop(pool);
    workers.into_iter().for_each(|worker| worker.join().unwrap());
    twin
}

/// Every part of a material that has one.
const GEL: [(&str, &str); 6] = [
    ("material.model", "ogden"),
    ("material.ogden_shear_moduli_pa", "1000, 678"),
    ("material.ogden_exponents", "2, -4"),
    ("material.volumetric", "logarithmic"),
    ("material.prony_shares", "0.3, 0.2"),
    ("material.prony_times_s", "0.5, 5"),
];

const HALF_PLANE: [(&str, &str); 3] = [
    ("discretisation.dimension", "axisymmetric"),
    // several blocks, so that both threads have work
    ("discretisation.spacing_m", "0.001"),
    // so much that the shaft has a wall
    ("instrument.puncture_strain", "0.2"),
];

// with the wall of an oblique shaft
const HALF: [(&str, &str); 3] =
    [("discretisation.dimension", "mirrored"), ("instrument.puncture_strain", "0.2"), ("instrument.tilt_rad", "0.2")];

// in the half, a wire with a bevelled tip
const BENDING: [(&str, &str); 7] = [
    ("instrument.puncture_strain", "0.2"),
    ("discretisation.dimension", "mirrored"),
    ("instrument.tip", "bevel"),
    ("instrument.bevel_force_n", "0.001"),
    ("instrument.flexible", "true"),
    ("instrument.length_m", "0.1"),
    ("instrument.outer_diameter_m", "0.0005"),
];

const FRICTIONAL: [(&str, &str); 7] = [
    ("discretisation.dimension", "axisymmetric"),
    ("instrument.interaction", "frictional"),
    ("instrument.friction_n_per_m", "3"),
    ("instrument.cutting_force_n", "0.003"),
    ("instrument.puncture_force_n", "0.006"),
    ("instrument.shaft_friction_coefficient", "0.2"),
    ("instrument.cutting_rate_exponent", "0.3"),
];

/// What a state has at most: 20 vectors, what surfaces do, and a few numbers per node; per point a deformation gradient in single precision, and
/// with a Prony series of two terms H, Pi and two h_i, all of them twice, since a good state is kept to come back to.
fn state_bytes(twin: &Twin, relaxing: bool) -> u64 {
    let per_point = if relaxing { 40 + 2 * 4 * 48 } else { 40 };
    (560 * twin.nodes() + per_point * twin.integration_points()) as u64
}

/// One test in this file, without libtest: allocations of another test, or of libtest's own thread, would be counted too.
fn main() {
    const NAME: &str = "a_step_allocates_nothing";
    let asked = std::env::args().skip(1).find(|a| !a.starts_with('-'));
    if asked.is_some_and(|filter| !NAME.contains(&filter)) {
        return;
    }
    a_step_allocates_nothing();
    a_step_of_a_team_allocates_nothing();
    a_further_member_is_a_small_part_of_a_twin();
    println!("test {NAME} ... ok");
}

/// Siblings that step together, one of which jumps now and then.
fn a_step_of_a_team_allocates_nothing() {
    let changes = [&HALF_PLANE[..], &[("instrument.deformation_coefficient", "0.3")]].concat();
    let first = on_two_threads(&scene("needle_insertion", &HALF_PLANE));
    let other = scene("needle_insertion", &changes);
    let mut twins: Vec<Twin> = (0..Team::MOST).map(|_| first.sibling(&other).unwrap()).collect();
    let mut team = Team::new(&twins.iter().collect::<Vec<_>>(), None).unwrap();
    let mut steps = 0;
    for pose in 1..=120 {
        let depth = |k: usize| if k == 2 && pose % 30 == 0 { 1e-3 } else { 2e-5 * f64::from(pose) };
        let at = |k: usize| StampedPose { time_s: 0.01 * f64::from(pose), pose: first.pose_at_depth(depth(k)) };
        let poses = std::array::from_fn(at);
        let mut all = twins.iter_mut();
        let mut places = std::array::from_fn(|_| all.next());
        let before = CALLS.load(Ordering::SeqCst);
        COUNTS.store(true, Ordering::SeqCst);
        let answers = team.step(&mut places, &poses);
        COUNTS.store(false, Ordering::SeqCst);
        assert_eq!(CALLS.load(Ordering::SeqCst) - before, 0, "pose {pose} of a team allocates");
        steps += answers.iter().flatten().map(|answer| answer.as_ref().unwrap().steps).sum::<u32>();
    }
    assert!(steps > 1000, "{steps}");
}

/// What a sibling adds to the bytes of a twin, and how much of these that may be (docs/lab/uncertainty.md).
fn a_further_member_is_a_small_part_of_a_twin() {
    let held = || HELD.load(Ordering::SeqCst);
    let space = ("discretisation.dimension", "full");
    let presets: [(&str, &[_], f64); 5] = [
        ("needle_insertion", &[], 0.18),
        ("indentation", &[], 0.13),
        ("compression", &[], 0.13),
        ("layered_tissue", &[], 0.15),
        ("needle_insertion", &[space], 0.25),
    ];
    for (preset, changes, most) in presets {
        let changes: Vec<Override> = changes.iter().map(|(key, value)| Override::text(key, value, "test")).collect();
        let scene = Scene::preset(preset).unwrap().with(&changes).unwrap();
        let before = held();
        // a member's steps are of one thread
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let twin = pool.install(|| Twin::new(&scene)).unwrap();
        let between = held();
        let sibling = pool.install(|| twin.sibling(&scene)).unwrap();
        let [first, further] = [between - before, held() - between];
        let share = further as f64 / first as f64;
        println!("{preset}, {} nodes: {first} bytes, {further} for a further member, {share:.3}", sibling.nodes());
        assert!(share < most, "{preset}: a member takes {share:.3} of a twin");
    }
}

fn a_step_allocates_nothing() {
    COUNTS.store(true, Ordering::SeqCst);
    drop(std::hint::black_box(vec![0u8; 100]));
    COUNTS.store(false, Ordering::SeqCst);
    assert!(CALLS.load(Ordering::SeqCst) >= 2, "the counter counts");
    for (preset, changes) in [
        ("needle_insertion", &[("instrument.puncture_strain", "0.1")] as &[_]),
        ("indentation", &[]),
        ("indentation", &GEL),
        ("needle_insertion", &HALF_PLANE),
        ("needle_insertion", &HALF),
        ("needle_insertion", &BENDING),
        ("needle_insertion", &FRICTIONAL),
    ] {
        let mut twin = on_two_threads(&scene(preset, changes));
        // the first poses wake the threads up
        calls(&mut twin, &[-2e-3, -1e-3, 1e-5, 2e-5]);
        let down = (1..=60).map(|k| f64::from(k) * 5e-5);
        let up = (0..60).rev().map(|k| f64::from(k) * 5e-5);
        let depths: Vec<f64> = down.chain(up).chain([-1e-3, 1e-3]).collect();
        let ([count, own], phases) = calls(&mut twin, &depths);
        assert!(phases.contains(&Phase::Indentation) && phases.contains(&Phase::Approach), "{phases:?}");
        assert_eq!(phases.contains(&Phase::Penetration), preset == "needle_insertion", "{phases:?}");
        // what stands between two poses when somebody looks ahead
        let before = BYTES.load(Ordering::SeqCst);
        COUNTS.store(true, Ordering::SeqCst);
        let mut double = twin.double();
        COUNTS.store(false, Ordering::SeqCst);
        let branch = BYTES.load(Ordering::SeqCst) - before;
        let state = state_bytes(&twin, changes.iter().any(|(key, _)| key.contains("prony")));
        println!("{preset} {changes:?}: {branch} bytes for a branch, a state has {state}");
        // in three dimensions the gradients alone would be two or three times as much again
        assert!(branch < 2 * state, "{preset} {changes:?}: {branch} bytes for a branch of a state of {state}");
        let before = CALLS.load(Ordering::SeqCst);
        COUNTS.store(true, Ordering::SeqCst);
        double.take_over(&twin);
        COUNTS.store(false, Ordering::SeqCst);
        assert_eq!(CALLS.load(Ordering::SeqCst) - before, 0, "{preset} {changes:?}: copying the state allocates");
        let poses = depths.len();
        assert_eq!(
            count, 0,
            "{preset} {changes:?}: {count} calls of the allocator in {poses} poses, {own} by the thread that steps"
        );
    }
}
