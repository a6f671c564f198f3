//! Processor and memory, and how fast a preset runs on them now.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use needle_core::scene::Scene;
use needle_core::twin::{StampedPose, Twin};

use super::row::Row;
use crate::cli::processor;
use crate::cli::progress::two_figures;

/// What is run.
const PRESET: &str = "needle_insertion";
/// For how long.
const TIME: Duration = Duration::from_secs(1);
/// Below this memory a twin with its middleware and a report may not fit, MiB.
const LITTLE_MIB: u64 = 512;

pub(super) fn rows() -> Vec<Row> {
    vec![model(), cores(), vectors(), governor(), memory(), speed()]
}

fn model() -> Row {
    Row::ok("processor", processor::name())
}

/// Cores that the process may use, and how much of their time.
fn cores() -> Row {
    let online = fs::read_to_string("/proc/cpuinfo").unwrap_or_default().matches("\nprocessor").count() + 1;
    let allowed = rustix::thread::sched_getaffinity(None).map_or(online, |set| set.count() as usize);
    let quota = quota();
    let value = match quota {
        Some(quota) => format!("{allowed} of {online}, and {quota:.1} cores' worth of time"),
        None => format!("{allowed} of {online}"),
    };
    match quota {
        Some(quota) if quota < allowed as f64 => Row::note(
            "cores",
            value,
            format!(
                "Start runs with --threads {:.0}, or give the container more time: threads beyond its share are stopped in the middle of a step.",
                quota.floor().max(1.0)
            ),
        ),
        _ => Row::ok("cores", value),
    }
}

/// Cores' worth of time that the control group allows (cgroup v2 `cpu.max`: quota and period in us).
fn quota() -> Option<f64> {
    let shares = control_group_files("cpu.max").into_iter().filter_map(|text| {
        let (quota, period) = text.trim().split_once(' ')?;
        Some(quota.parse::<f64>().ok()? / period.parse::<f64>().ok()?)
    });
    shares.min_by(f64::total_cmp)
}

/// Files of this name of the process's control group and those above it.
fn control_group_files(name: &str) -> Vec<String> {
    let of_process = fs::read_to_string("/proc/self/cgroup").unwrap_or_default();
    let Some(group) = of_process.lines().find_map(|line| line.strip_prefix("0::/")) else { return Vec::new() };
    let root = Path::new("/sys/fs/cgroup");
    let own: PathBuf = root.join(group);
    own.ancestors()
        .take_while(|folder| folder.starts_with(root))
        .filter_map(|f| fs::read_to_string(f.join(name)).ok())
        .collect()
}

/// The vector instructions that the solver takes.
fn vectors() -> Row {
    match mtled::number::instructions() {
        Some(name) => Row::ok("vectors", format!("{name}, eight numbers at once")),
        None if cfg!(target_arch = "x86_64") => Row::note(
            "vectors",
            "neither AVX2 nor FMA: the loops as they were compiled",
            "Use a processor or virtual machine that has AVX2 and FMA: steps take several times as long without.",
        ),
        None => Row::ok("vectors", format!("those of {} that the compiler used", std::env::consts::ARCH)),
    }
}

fn governor() -> Row {
    let name = fs::read_to_string("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor");
    match name.as_deref().map(str::trim) {
        Ok(name @ ("powersave" | "ondemand" | "conservative" | "schedutil")) => Row::note(
            "frequency governor",
            name,
            "For a live twin set `cpupower frequency-set --governor performance`: after a pause the first poses are answered late otherwise.",
        ),
        Ok(name) => Row::ok("frequency governor", name),
        Err(_) => Row::ok("frequency governor", "not told by the system"),
    }
}

fn memory() -> Row {
    let text = fs::read_to_string("/proc/meminfo").unwrap_or_default();
    let mib = |name: &str| {
        let line = text.lines().find_map(|line| line.strip_prefix(name))?;
        line.split_whitespace().nth(1)?.parse::<u64>().ok().map(|kib| kib >> 10)
    };
    let limits = control_group_files("memory.max").into_iter().filter_map(|limit| limit.trim().parse::<u64>().ok());
    let limit = limits.min().map(|bytes| bytes >> 20);
    let (Some(all), Some(free)) = (mib("MemTotal"), mib("MemAvailable")) else {
        return Row::ok("memory", "not told by the system");
    };
    let limited = limit.map(|mib| format!(", at most {mib} MiB for this program")).unwrap_or_default();
    let value = format!("{all} MiB, {free} MiB free{limited}");
    if free.min(limit.unwrap_or(u64::MAX)) < LITTLE_MIB {
        Row::problem(
            "memory",
            value,
            format!("Free memory or raise the limit: a twin with its middleware needs about {LITTLE_MIB} MiB."),
        )
    } else {
        Row::ok("memory", value)
    }
}

/// Runs the preset for a second as a live node would, and says how much faster than its own motion that went.
fn speed() -> Row {
    const NAME: &str = "speed";
    let load = fs::read_to_string("/proc/loadavg").unwrap_or_default();
    let load = load.split(' ').next().unwrap_or("?").to_owned();
    match measure() {
        Ok(factor) => {
            let value = format!("{PRESET} runs at {} times real time at present (load {load})", two_figures(factor));
            if factor < 1.0 {
                Row::problem(
                    NAME,
                    value,
                    "End other programs, or choose a coarser model with `needle_twin tune`: a live twin would skip poses here.",
                )
            } else if factor < 3.0 {
                Row::note(
                    NAME,
                    value,
                    "End other programs before a live run: scenes in three dimensions will not keep up.",
                )
            } else {
                Row::ok(NAME, value)
            }
        }
        Err(error) => {
            Row::problem(NAME, format!("{PRESET}: {error}"), "Report this: the preset should run everywhere.")
        }
    }
}

fn measure() -> Result<f64, String> {
    let scene = Scene::preset(PRESET).map_err(|e| e.to_string())?;
    let motion = scene.motion.ok_or("no motion")?;
    let mut twin = Twin::new(&scene).map_err(|e| e.to_string())?;
    let end_s = motion.depth.get() / motion.speed.get();
    let (mut time_s, mut poses) = (0.0, 0_u32);
    let begun = Instant::now();
    while begun.elapsed() < TIME && time_s < end_s {
        poses += 1;
        time_s = f64::from(poses) / motion.pose_rate.get();
        let pose = twin.pose_at_depth(motion.speed.get() * time_s);
        twin.step(StampedPose { time_s, pose }).map_err(|e| e.to_string())?;
    }
    Ok(time_s / begun.elapsed().as_secs_f64())
}
