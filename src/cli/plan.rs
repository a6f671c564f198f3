//! `needle_twin plan`: where a needle has to enter to meet a target that moves with the tissue.

use std::fs;
use std::path::PathBuf;

use clap::Args;

use super::interrupt::Interrupt;
use super::options::{SetOptions, ThreadOptions};
use super::progress::newtons;
use super::summary::screen;
use super::{CliError, Outcome, print, scene_file, warn};
use needle_estimate::plan::{Direction, End, Plan, PlanError, Wanted, check, plan};
use needle_report::{ReportError, plan_json};

/// Plan an insertion: entry point, direction and depth that bring a needle's tip to a target which moves with the tissue
///
/// The insertion is run, and entry point and depth are moved by what the tip misses, until it is there. Of several directions the one is taken that
/// leaves enough room to what is to be avoided and misses least often; `--members` runs the scene's [uncertainty] for that.
#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Preset or scene file with a needle, [motion] and [[targets]]
    #[arg(long, value_name = "NAME|FILE")]
    scene: String,

    #[command(flatten)]
    set: SetOptions,

    /// Name of the target
    #[arg(long, value_name = "NAME", help_heading = "Goal")]
    target: String,

    /// Region that the needle must not touch (may be repeated)
    #[arg(long, value_name = "REGION", help_heading = "Goal")]
    avoid: Vec<String>,

    /// Least distance from those, m
    #[arg(long, value_name = "M", default_value_t = 0.0, value_parser = length, help_heading = "Goal")]
    clearance_m: f64,

    /// Distance from the target within which it is met, m
    #[arg(long, value_name = "M", default_value_t = 0.0005, value_parser = length, help_heading = "Goal")]
    radius_m: f64,

    /// Distance at which the search ends, m
    #[arg(long, value_name = "M", default_value_t = 0.00005, value_parser = length, help_heading = "Goal")]
    tolerance_m: f64,

    /// Angle between path and vertical, rad (may be repeated) [default: the scene's]
    #[arg(long, value_name = "RAD", num_args = 1.., allow_negative_numbers = true, help_heading = "Directions")]
    tilt_rad: Vec<f64>,

    /// Direction in which the path leans, rad (may be repeated) [default: the scene's]
    #[arg(long, value_name = "RAD", num_args = 1.., allow_negative_numbers = true, help_heading = "Directions")]
    azimuth_rad: Vec<f64>,

    /// Rotation of a bevelled needle, rad (may be repeated) [default: the scene's]
    #[arg(long, value_name = "RAD", num_args = 1.., allow_negative_numbers = true, help_heading = "Directions")]
    roll_rad: Vec<f64>,

    /// Members of the scene's [uncertainty] that say how often the plan misses; 0: none
    #[arg(long, value_name = "N", default_value_t = 0, help_heading = "Uncertainty")]
    members: usize,

    #[command(flatten)]
    threads: ThreadOptions,

    /// Write the scene of the plan into this file
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    out: Option<PathBuf>,

    /// Print the plan as JSON instead of a summary
    #[arg(long, help_heading = "Output")]
    json: bool,
}

fn length(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|x| (0.0..=10.0).contains(x));
    number.ok_or_else(|| "a length in m from 0 to 10".to_owned())
}

pub(super) fn run(arguments: &Arguments) -> Result<Outcome, CliError> {
    let interrupt = Interrupt::listen();
    let scene = arguments.set.apply(&scene_file::load(&arguments.scene)?, [])?;
    let wanted = Wanted {
        target: arguments.target.clone(),
        avoid: arguments.avoid.clone(),
        clearance_m: arguments.clearance_m,
        radius_m: arguments.radius_m,
        tolerance_m: arguments.tolerance_m.max(1e-9),
        members: arguments.members,
    };
    check(&scene, &wanted)?;
    let angles = [&arguments.tilt_rad[..], &arguments.azimuth_rad, &arguments.roll_rad];
    let directions = Direction::all(&scene, angles);
    let found = arguments.threads.install(|| {
        plan(&scene, &wanted, &directions, interrupt.cancel(), |direction, tries, end| {
            if !arguments.json {
                warn_progress(direction, tries, end);
            }
        })
    })??;
    if let Some(path) = &arguments.out {
        let file = |source| ReportError::File { path: path.clone(), source };
        fs::write(path, found.scene.to_toml()).map_err(file)?;
    }
    if arguments.json {
        print(&format!("{:#}\n", plan_json(&found, &wanted)))?;
    } else {
        print(&summary(&found, &wanted))?;
    }
    let met = found.end.miss_m <= wanted.radius_m;
    if !met {
        warn(&format!(
            "the tip stays {:.3} mm away from the target, more than --radius-m: another direction, or a needle that bends less",
            1e3 * found.end.miss_m
        ));
    }
    Ok(if met { Outcome::Complete } else { Outcome::Lossy })
}

fn warn_progress(direction: &Direction, tries: u32, end: &End) {
    let Direction { tilt, azimuth, .. } = direction;
    let [x, y] = end.entry_m.map(|c| 1e3 * c);
    eprintln!(
        "tilt {tilt:.3}, azimuth {azimuth:.3} rad, run {tries}: entry ({x:.3}, {y:.3}) mm misses by {:.3} mm",
        1e3 * end.miss_m
    );
}

fn summary(plan: &Plan, wanted: &Wanted) -> String {
    let Plan { direction, straight, end, tries, spread, .. } = plan;
    let mm = |p: &[f64]| p.iter().map(|c| format!("{:.3}", 1e3 * c)).collect::<Vec<_>>().join(", ");
    let roll = direction.roll.map_or_else(String::new, |roll| format!(", roll {roll:.4} rad"));
    let mut lines = vec![
        ("entry", format!("({}) mm", mm(&end.entry_m))),
        ("direction", format!("tilt {:.4} rad, azimuth {:.4} rad{roll}", direction.tilt, direction.azimuth)),
        ("depth", format!("{:.3} mm along the path", 1e3 * end.depth_m)),
        ("target", format!("{} moves to ({}) mm", wanted.target, mm(&end.target_m))),
        (
            "miss",
            format!(
                "{:.3} mm after {tries} runs; {:.3} mm with a straight aim at the target at rest",
                1e3 * end.miss_m,
                1e3 * straight.miss_m
            ),
        ),
        ("force", format!("peak {}", newtons(end.peak_n))),
    ];
    if end.clearance_m.is_finite() {
        lines.push(("room", format!("{:.3} mm to {}", 1e3 * end.clearance_m, wanted.avoid.join(", "))));
    }
    if let Some(spread) = spread {
        let all = spread.miss_m.len() + spread.lost;
        let at = |share: f64| {
            spread
                .miss_m
                .get(((spread.miss_m.len() as f64 * share) as usize).min(spread.miss_m.len().saturating_sub(1)))
                .map_or(f64::NAN, |m| 1e3 * m)
        };
        let lost = if spread.lost > 0 { format!(", {} of them without an answer", spread.lost) } else { String::new() };
        lines.push((
            "risk",
            format!(
                "{:.1} % of {all} members miss by more than {:.3} mm{lost}; median {:.3} mm, 95 % within {:.3} mm",
                1e2 * spread.probability,
                1e3 * wanted.radius_m,
                at(0.5),
                at(0.95)
            ),
        ));
    }
    screen(&lines)
}

impl From<PlanError> for CliError {
    fn from(error: PlanError) -> Self {
        Self::Plan(Box::new(error))
    }
}
