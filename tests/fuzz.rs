//! Whatever a file, a command line or a peer says: no panic, no hang, no runaway memory.
//!
//! The same checks run as `cargo-fuzz` targets (`fuzz/`). The inputs here come from the corpora by numbers, so that a find
//! is a target and a number; what was found once stays in `fuzz/regressions`.
#![allow(clippy::unwrap_used, clippy::panic, clippy::expect_used)]

#[path = "fuzz/cdr.rs"]
mod cdr;
#[path = "fuzz/command_line.rs"]
mod command_line;
#[path = "fuzz/manifest.rs"]
mod manifest;
#[path = "fuzz/mcap.rs"]
mod mcap;
#[path = "fuzz/mesh.rs"]
mod mesh;
#[path = "fuzz/mutate.rs"]
mod mutate;
#[path = "fuzz/parameter_file.rs"]
mod parameter_file;
#[path = "fuzz/scene.rs"]
mod scene;
#[path = "fuzz/selection.rs"]
mod selection;
#[path = "fuzz/table.rs"]
mod table;
#[path = "fuzz/viewer.rs"]
mod viewer;

use std::alloc::{GlobalAlloc, Layout, System};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::time::{Duration, Instant};

type Exercise = fn(&[u8]);

const TARGETS: [(&str, Exercise); 10] = [
    ("scene", scene::exercise),
    ("parameter_file", parameter_file::exercise),
    ("command_line", command_line::exercise),
    ("msh", |data| mesh::exercise("fuzz.msh", data)),
    ("vtu", |data| mesh::exercise("fuzz.vtu", data)),
    ("mcap", mcap::exercise),
    ("cdr", cdr::exercise),
    ("table", table::exercise),
    ("manifest", manifest::exercise),
    ("viewer", viewer::exercise),
];
/// Memory that one input may take beyond what was taken before: so much, and so much per byte of it.
const MOST_BYTES: usize = 64 << 20;
const MOST_PER_BYTE: usize = 300;
/// Time that one input may take; a busy machine's pauses included.
const LONGEST: Duration = Duration::from_secs(20);

/// The system's allocator, with the present sum and the largest since it was last asked.
struct Weighing;

static PRESENT: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

fn add(bytes: usize) {
    PEAK.fetch_max(PRESENT.fetch_add(bytes, Relaxed) + bytes, Relaxed);
}

// SAFETY: every call is handed to the system's allocator unchanged.
unsafe impl GlobalAlloc for Weighing {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        add(layout.size());
        // SAFETY: the caller's promise.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        add(layout.size());
        // SAFETY: the caller's promise.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        PRESENT.fetch_sub(layout.size(), Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.dealloc(at, layout) }
    }

    unsafe fn realloc(&self, at: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        add(size);
        PRESENT.fetch_sub(layout.size(), Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.realloc(at, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Weighing = Weighing;

/// One target at a time: the memory is the whole process's.
static ONE: Mutex<()> = Mutex::new(());

fn folder(of: &str, target: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz").join(of).join(target)
}

/// Files of a folder with their names, in order.
fn files(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let mut found: Vec<_> = entries
        .flatten()
        .map(|e| (e.file_name().to_string_lossy().into_owned(), std::fs::read(e.path()).unwrap()))
        .collect();
    found.sort();
    found
}

/// Largest memory (bytes) and longest time of one input, or what went wrong.
fn one(exercise: Exercise, data: &[u8]) -> Result<(usize, Duration), String> {
    let before = PRESENT.load(Relaxed);
    PEAK.store(before, Relaxed);
    let begun = Instant::now();
    let outcome = catch_unwind(AssertUnwindSafe(|| exercise(data)));
    let (took, bytes) = (begun.elapsed(), PEAK.load(Relaxed).saturating_sub(before));
    match outcome {
        Err(panic) => {
            let text = panic.downcast_ref::<String>().cloned();
            Err(format!(
                "panic: {}",
                text.unwrap_or_else(|| (*panic.downcast_ref::<&str>().unwrap_or(&"?")).to_owned())
            ))
        }
        Ok(()) if took > LONGEST => Err(format!("it took {took:?}")),
        Ok(()) if bytes > MOST_BYTES + MOST_PER_BYTE * data.len() => Err(format!("it took {bytes} bytes")),
        Ok(()) => Ok((bytes, took)),
    }
}

/// So many inputs of one target, from a number on. What goes wrong is kept beside the corpora's regressions.
fn run(target: &str, exercise: Exercise, from: u64, count: u64) {
    let _alone = ONE.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    let corpus: Vec<Vec<u8>> = files(&folder("corpus", target)).into_iter().map(|(_, data)| data).collect();
    assert!(!corpus.is_empty(), "{target} has no corpus");
    let (begun, mut memory, mut longest, mut wrong) = (Instant::now(), 0, Duration::ZERO, Vec::new());
    for index in from..from + count {
        let data = mutate::input(&corpus, index);
        match one(exercise, &data) {
            Ok((bytes, took)) => (memory, longest) = (memory.max(bytes), longest.max(took)),
            Err(reason) => {
                let place = folder("regressions", target);
                std::fs::create_dir_all(&place).unwrap();
                std::fs::write(place.join(format!("number_{index}")), &data).unwrap();
                wrong.push(format!("number {index}, {} bytes: {reason}", data.len()));
            }
        }
        if wrong.len() > 20 {
            break;
        }
        if (index + 1 - from).is_multiple_of(100_000) {
            eprintln!("{target}: {} inputs in {:.0} s", index + 1 - from, begun.elapsed().as_secs_f64());
        }
    }
    println!(
        "{target}: {count} inputs in {:.1} s; one took {:.1} MB and {:.1} ms at most",
        begun.elapsed().as_secs_f64(),
        memory as f64 / 1e6,
        1e3 * longest.as_secs_f64()
    );
    assert!(wrong.is_empty(), "{target}: {wrong:#?}");
}

#[test]
fn what_was_found_once_does_no_harm_again() {
    let _alone = ONE.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    for (target, exercise) in TARGETS {
        for of in ["corpus", "regressions"] {
            for (name, data) in files(&folder(of, target)) {
                one(exercise, &data).unwrap_or_else(|reason| panic!("{of}/{target}/{name}: {reason}"));
            }
        }
    }
}

#[test]
fn a_short_run_does_no_harm() {
    for (target, exercise) in TARGETS {
        run(target, exercise, 0, 3000);
    }
}

/// `FUZZ_INPUTS` inputs (1,000,000 unless set) of the target `FUZZ_TARGET` (of all unless set), from number `FUZZ_FROM` on.
#[test]
#[ignore = "minutes, the long form of a_short_run_does_no_harm: .ci/long runs it"]
fn a_long_run_does_no_harm() {
    let number = |name: &str, otherwise| std::env::var(name).map_or(otherwise, |v| v.parse::<u64>().unwrap());
    let wanted = std::env::var("FUZZ_TARGET").ok();
    std::panic::set_hook(Box::new(|_| {}));
    for (target, exercise) in TARGETS.into_iter().filter(|(t, _)| wanted.as_deref().is_none_or(|w| w == *t)) {
        run(target, exercise, number("FUZZ_FROM", 0), number("FUZZ_INPUTS", 1_000_000));
    }
}
