//! The demo's second act: a needle that rubs, cuts and breaks through goes into skin, fat and muscle, without a network.

use std::path::Path;

use super::super::options::SeriesOptions;
use super::super::output::{self, OutputFolder};
use super::super::{CliError, Outcome, print, scene_file, solve};
use needle_core::scene::{Override, Value};

/// Scene of the second act, and the folder of its results.
const SCENE: &str = "layered_tissue";

/// Runs its first insertion, and leaves the same files as `solve` in a folder of its own.
pub(super) fn run(out: &Path) -> Result<Outcome, CliError> {
    print(&format!(
        "\nsecond act: {SCENE}, a needle with friction goes into skin, fat and muscle; moduli of fat and muscle from a paper, \
         everything else assumed (solve --scene {SCENE}: out, and in again)\n"
    ))?;
    let once = Override::typed("motion.insertions", Value::Integer(1), "demo");
    let scene = scene_file::load(SCENE)?.with(&[once])?;
    let motion = scene.motion.ok_or_else(|| CliError::NoMotion { scene: scene.name.clone() })?;
    let folder = OutputFolder::prepare(&out.join(SCENE))?;
    let series = SeriesOptions::default();
    let duration_s = Some((motion.pose_count() - 1.0) / motion.pose_rate.get());
    let run = solve::solve(&scene, &motion, series.keep(true, duration_s)?, None)?;
    output::deliver(&run, Some(&folder), &series, false)
}
