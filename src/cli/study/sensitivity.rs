//! `needle_twin study sensitivity`.

use std::fmt::Write as _;
use std::path::PathBuf;

use clap::Args;

use crate::cli::options::{SetOptions, ThreadOptions};
use crate::cli::output::OutputFolder;
use crate::cli::progress::{Bar, Progress};
use crate::cli::shard::Shard;
use crate::cli::{CliError, Outcome, print, scene_file, warn};
use needle_estimate::compare::Watch as _;
use needle_estimate::compare::ensemble::Crew;
use needle_recording::{At, Reading};
use needle_studies::sensitivity::{self, Output, Runs, Sensitivity};

/// Say which key of a scene's [uncertainty] makes peak force and targets uncertain: Sobol's indices over the scene's own motion
#[derive(Debug, Args)]
pub(super) struct SensitivityArguments {
    /// Preset or scene file
    #[arg(long, value_name = "NAME|FILE")]
    scene: String,

    #[command(flatten)]
    set: SetOptions,

    /// Base points: each takes as many members as there are keys, and two more; powers of two are best
    #[arg(long, value_name = "N", default_value_t = 64)]
    members: usize,

    /// Seed of the points
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,

    /// Write sensitivity.json and sensitivity.csv into this folder; runs that it has already are not run again
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,

    /// Make only every n-th run, beginning with the i-th; the same command without it makes the rest and puts all together
    #[arg(long, value_name = "I/N", requires = "out")]
    shard: Option<Shard>,

    /// Print JSON instead of a table
    #[arg(long)]
    json: bool,

    #[command(flatten)]
    threads: ThreadOptions,
}

impl SensitivityArguments {
    pub(super) fn run(&self) -> Result<Outcome, CliError> {
        let scene = self.set.apply(&scene_file::load(&self.scene)?, [])?;
        let motion = scene.motion.ok_or_else(|| CliError::NoMotion { scene: scene.name.clone() })?;
        let members = sensitivity::members(&scene, self.members, self.seed)?;
        let folder = self.out.as_deref().map(OutputFolder::prepare).transpose()?;
        let readings: Vec<Reading> =
            motion.poses().map(|(time_s, depth_m)| Reading { time_s, at: At::Depth(depth_m) }).collect();
        let mut runs = Runs::new(&scene, &members, &readings, folder.as_ref().map(|f| f.path.as_path()));
        let mine = self.shard.unwrap_or(Shard::WHOLE);
        let left = runs.left(|run| mine.has(run));
        let progress = Progress::silent();
        let bar = Bar::new(left.len() as u64, "runs");
        let done = || bar.add(1, "");
        self.threads.install(|| {
            let crew = Crew { threads: rayon::current_num_threads(), cancel: progress.cancel().clone(), done: &done };
            runs.make(&left, &crew)
        })??;
        bar.finish();
        let of_mine = (0..runs.count()).filter(|run| mine.has(*run)).count();
        let done = of_mine - runs.left(|run| mine.has(run)).len();
        if done < of_mine {
            warn(&format!(
                "interrupted: {done} of {of_mine} runs are done; with --out the same command goes on from there"
            ));
            return Ok(Outcome::Lossy);
        }
        if let Some(shard) = self.shard {
            print(&format!(
                "part {} of {}: {of_mine} of {} runs, {} made now\n",
                shard.number,
                shard.of,
                runs.count(),
                left.len()
            ))?;
            return Ok(Outcome::Complete);
        }
        let found = runs.sensitivity([self.members as u64, self.seed]);
        let json = format!("{:#}\n", serde_json::json!(found));
        if let Some(folder) = &folder {
            needle_report::write_file(&folder.path.join("sensitivity.json"), json.as_bytes())?;
            needle_report::write_file(&folder.path.join("sensitivity.csv"), csv(&found).as_bytes())?;
        }
        print(&if self.json { json } else { table(&found) })?;
        if found.left_out > 0 {
            warn(&format!("{} of {} points left out: a member of each came to no end", found.left_out, found.points));
        }
        Ok(if found.left_out == 0 { Outcome::Complete } else { Outcome::Lossy })
    }
}

fn table(found: &Sensitivity) -> String {
    let width = found.outputs.iter().flat_map(|output| &output.keys).map(|k| k.key.len()).max().unwrap_or(0);
    let mut text = format!("{}: {} points, {} runs\n", found.scene, found.points, found.runs);
    for Output { name, mean, standard_deviation, keys } in &found.outputs {
        // Writing to a String can't fail.
        let _ = writeln!(text, "\n{name}: {mean:.4e} with a standard deviation of {standard_deviation:.2e}");
        let _ = writeln!(text, "  {:width$}  {:>15}  {:>15}", "key", "first order", "total");
        for k in keys {
            let pair = |value: f64, error: f64| format!("{value:.3} ± {error:.3}");
            let (first, total) = (pair(k.first, k.first_standard_error), pair(k.total, k.total_standard_error));
            let _ = writeln!(text, "  {:width$}  {first:>15}  {total:>15}", k.key);
        }
    }
    text
}

fn csv(found: &Sensitivity) -> String {
    let mut text = "output,key,first,first_standard_error,total,total_standard_error\n".to_owned();
    for output in &found.outputs {
        for k in &output.keys {
            let (name, key) = (&output.name, &k.key);
            let name = if name.contains([',', '"', '\n']) {
                format!("\"{}\"", name.replace('"', "\"\""))
            } else {
                name.clone()
            };
            let figures = [k.first, k.first_standard_error, k.total, k.total_standard_error];
            let _ = writeln!(text, "{name},{key},{}", figures.map(|x| format!("{x:?}")).join(","));
        }
    }
    text
}
