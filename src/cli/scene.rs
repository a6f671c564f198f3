//! `needle_twin scene`: what scenes there are, what is in one, and whether it can be used.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::{Args, Subcommand};
use serde_json::{Map, json};

use super::options::SetOptions;
use super::urdf::{self, Urdf};
use super::{CliError, Outcome, print, scene_file};
use needle_core::scene::keys::{KEYS, SECTIONS};
use needle_core::scene::size::Estimate;
use needle_core::scene::{Key, PRESETS, Scene, Value, Word as _};
use needle_core::twin::{Body, extents, shown};
use needle_estimate::compare::{Cancel, Finished, Keep, Run, Session};

/// List, print and check scenes
#[derive(Debug, Args)]
pub(super) struct Arguments {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// Name the presets that are compiled in
    List {
        /// Print JSON
        #[arg(long)]
        json: bool,
    },
    /// Print a scene, ready to be edited; with --set, as it then is
    Show(Show),
    /// Describe rig and sample as a robot (URDF), for RViz and ros2_control
    Urdf(Urdf),
    /// Read and check scenes, and try each for a second: what it costs and how far off it is
    Check {
        /// Presets or scene files
        #[arg(required = true, value_name = "NAME|FILE")]
        scenes: Vec<String>,
        #[command(flatten)]
        set: SetOptions,
        /// Print JSON
        #[arg(long)]
        json: bool,
    },
}

#[derive(Debug, Args)]
struct Show {
    /// Preset or scene file
    #[arg(value_name = "NAME|FILE", required_unless_present = "keys")]
    scene: Option<String>,
    #[command(flatten)]
    set: SetOptions,
    /// Document every key that a scene can have: type, range, unit, default
    #[arg(long, conflicts_with_all = ["scene", "set"])]
    keys: bool,
    /// Print JSON: every key by its dotted path
    #[arg(long)]
    json: bool,
    /// Instead, draw the sample cut open along the instrument, with its regions: an .svg or .png file
    #[arg(long, value_name = "FILE", conflicts_with_all = ["keys", "json"])]
    section: Option<PathBuf>,
}

pub(super) fn run(arguments: Arguments) -> Result<Outcome, CliError> {
    match arguments.verb {
        Verb::List { json } => list(json)?,
        Verb::Show(Show { scene: Some(scene), set, section: Some(file), .. }) => draw(&scene, &set, &file)?,
        Verb::Show(show) => print(&show.text()?)?,
        Verb::Urdf(arguments) => urdf::run(&arguments)?,
        Verb::Check { scenes, set, json } => check(&scenes, &set, json)?,
    }
    Ok(Outcome::Complete)
}

fn list(as_json: bool) -> Result<(), CliError> {
    let scenes = PRESETS.iter().map(needle_core::scene::Preset::scene).collect::<Result<Vec<_>, _>>()?;
    if as_json {
        let rows = scenes.iter().map(|s| json!({ "name": s.name, "description": s.description }));
        return print(&format!("{:#}\n", serde_json::Value::from_iter(rows)));
    }
    let rows = scenes.iter().map(|s| format!("{:<18}{}\n", s.name, s.description.trim()));
    print(&rows.collect::<String>())
}

/// Draws a scene's section.
fn draw(name: &str, set: &SetOptions, file: &Path) -> Result<(), CliError> {
    let scene = set.apply(&scene_file::load(name)?, [])?;
    let body = Body::new(&scene).map_err(|source| CliError::Build { scene: scene.name.clone(), source })?.whole();
    Ok(needle_report::write_section(file, &scene, &body)?)
}

impl Show {
    fn text(&self) -> Result<String, CliError> {
        let Some(name) = &self.scene else {
            return Ok(if self.json { keys_json() } else { keys_text() });
        };
        let (text, origin) = scene_file::text(name)?;
        let scene = scene_file::from_text(&text, &origin)?;
        if self.json {
            return Ok(scene_json(&self.set.apply(&scene, [])?));
        }
        // Unchanged, it is shown as it was written, comments and all.
        Ok(if self.set.set.is_empty() { text } else { self.set.apply(&scene, [])?.to_toml() })
    }
}

fn scene_json(scene: &Scene) -> String {
    let entries = scene.entries().into_iter().map(|(path, value)| (path, value_json(value)));
    format!("{:#}\n", serde_json::Value::Object(entries.collect::<Map<_, _>>()))
}

fn value_json(value: Value) -> serde_json::Value {
    match value {
        Value::Text(text) => json!(text),
        Value::Real(x) => json!(x),
        Value::Integer(i) => json!(i),
        Value::Boolean(yes) => json!(yes),
        Value::Point(point) => json!(point),
        Value::List(numbers) => json!(numbers),
    }
}

fn default_of(key: &Key) -> String {
    match (key.follows, key.default) {
        (Some(other), _) => format!("that of {other}"),
        (None, Some("")) => "empty".to_owned(),
        (None, Some(default)) => default.to_owned(),
        (None, None) => "required".to_owned(),
    }
}

fn keys_text() -> String {
    let mut out = String::from("Keys of a scene. Sections that are absent are not modelled.\n");
    for section in std::iter::once(&"").chain(SECTIONS.iter()) {
        out.push('\n');
        for key in KEYS.iter().filter(|key| key.section() == *section) {
            let live = if key.live { "; can change while running" } else { "" };
            let only = key.only_with.map_or_else(String::new, |(selector, words)| {
                format!("; only with {selector} = {}", words.join(" or "))
            });
            // Writing to a String can't fail.
            let _ = writeln!(out, "{}: {}; default: {}{only}{live}", key.shown_path(), key.allowed(), default_of(key));
            let _ = writeln!(out, "    {}", key.description);
        }
    }
    out
}

fn keys_json() -> String {
    let rows = KEYS.iter().map(|key| {
        json!({
            "key": key.shown_path(),
            "allowed": key.allowed(),
            "default": key.default,
            "follows": key.follows,
            "required": key.default.is_none(),
            "unit": key.unit,
            "only_with": key.only_with.map(|(selector, words)| json!({ "key": selector, "values": words })),
            "live": key.live,
            "description": key.description,
        })
    });
    format!("{:#}\n", serde_json::Value::from_iter(rows))
}

/// How the nodes are spaced, after a semicolon; empty where a mesh brings them.
fn spaced(scene: &Scene) -> String {
    scene.grading().map_or_else(String::new, |grading| {
        let far = grading.spacing.get();
        format!(
            "; nodes {:.2} mm apart, {:.3} mm at the instrument, growing by {} per metre between; supports of {} spacings",
            1e3 * far,
            1e3 * far * grading.edge_refinement,
            grading.growth,
            scene.support_factor()
        )
    })
}

fn check(scenes: &[String], set: &SetOptions, as_json: bool) -> Result<(), CliError> {
    let sized = |scene: Scene| {
        scene.advice().iter().chain(&scene.absent_regions()).for_each(|advice| super::warn(advice));
        size(&scene).map(|size| (scene, size))
    };
    let checked: Vec<_> = scenes.iter().map(|name| set.apply(&scene_file::load(name)?, []).and_then(sized)).collect();
    if as_json {
        let rows = scenes.iter().zip(&checked).map(|(name, result)| match result {
            Ok((scene, Sized { size, extents, built, tried })) => {
                let model = scene.dimension();
                let because = model.because + &scene.left_out();
                json!({
                    "mesh_extents_m": extents,
                    "scene": name, "ok": true, "name": scene.name,
                    "dimension": model.dimension.as_str(), "dimension_because": because,
                    "estimated_nodes": size.nodes, "estimated_bytes": size.bytes,
                    "nodes": built.map(|[nodes, _]| nodes), "integration_points": built.map(|[_, points]| points),
                    "tried": tried.as_ref().map(Tried::json),
                    "accuracy": scene.accuracy,
                    "spacing_m": scene.grading().map(|g| g.spacing.get()),
                    "edge_refinement": scene.grading().map(|g| g.edge_refinement),
                    "growth": scene.grading().map(|g| g.growth),
                    "support_factor": scene.support_factor(),
                    "cells_per_point": scene.cells_per_point(),
                    "points_per_support_node": scene.discretisation.points_per_support_node,
                    "integration": if scene.is_consistent_in(model.dimension) { "consistent" } else { "plain" },
                })
            }
            Err(error) => json!({ "scene": name, "ok": false, "error": error.to_string() }),
        });
        print(&format!("{:#}\n", serde_json::Value::from_iter(rows)))?;
    } else {
        let each = scenes.iter().zip(&checked).filter_map(|(n, r)| r.as_ref().ok().map(|s| (n, s)));
        for (name, (scene, Sized { size, extents, built, tried })) in each {
            let (model, megabytes) = (scene.dimension(), size.bytes / 1e6);
            let kind = model.dimension.as_str();
            let mesh = extents.map_or_else(String::new, |extents| format!(", mesh of {}", shown(extents)));
            print(&format!(
                "{name}: ok, about {megabytes:.0} MB, {}{mesh}; {kind}: {}{}{}{}\n",
                match built {
                    Some([nodes, points]) => format!("{nodes} nodes, {points} integration points"),
                    None => format!("some {:.0} nodes (too many to build for a check)", size.nodes),
                },
                model.because,
                scene.left_out(),
                spaced(scene),
                tried.as_ref().map_or_else(String::new, |tried| tried.words(scene.accuracy))
            ))?;
        }
    }
    let all = checked.len();
    let mut errors: Vec<CliError> = checked.into_iter().filter_map(Result::err).collect();
    match errors.len() {
        0 => Ok(()),
        1 => Err(errors.remove(0)),
        bad => {
            errors.iter().for_each(|error| super::warn(&error.to_string()));
            Err(CliError::ScenesRefused { bad, all })
        }
    }
}

/// How large a model is.
struct Sized {
    size: Estimate,
    /// Of the mesh, m, where there is one.
    extents: Option<[f64; 3]>,
    /// Nodes and integration points of the model that was built for the check.
    built: Option<[usize; 2]>,
    /// What the first second of its motion cost, where it has one and was built.
    tried: Option<Tried>,
}

/// A run of a scene's own motion, as far as it goes within [`TRIED`] of wall time.
struct Tried {
    run: Run,
    /// Whether it got to the end of the motion.
    whole: bool,
}

impl Tried {
    fn steps_per_pose(&self) -> f64 {
        self.run.steps_per_pose().unwrap_or_default()
    }

    fn longest_pose_ms(&self) -> f64 {
        self.run.latency_ms().map_or(0.0, |latency| latency.max)
    }

    fn json(&self) -> serde_json::Value {
        json!({
            "whole": self.whole,
            "simulated_s": self.run.simulated_s,
            "real_time_factor": self.run.real_time_factor(),
            "steps_per_pose": self.steps_per_pose(),
            "longest_pose_ms": self.longest_pose_ms(),
            "force_imbalance_rms": self.run.force_imbalance_rms,
            "model_error": self.run.relative_model_error(),
            "diverged": self.run.diverged,
        })
    }

    fn words(&self, accuracy: f64) -> String {
        let how_far = if self.whole {
            "its motion".to_owned()
        } else {
            format!("the first {:.3} s of its motion", self.run.simulated_s)
        };
        if let Some(reason) = &self.run.diverged {
            return format!("; {how_far}, tried: lost, {reason}");
        }
        let error = self.run.relative_model_error();
        let met = if error <= accuracy { "within" } else { "an upper bound, which does not show it to be within" };
        format!(
            "; {how_far}, tried: {:.2} times real time, {:.1} steps per pose, longest pose {:.1} ms; error of the model {:.1} % of the peak, \
             {met} the accuracy of {:.1} %",
            self.run.real_time_factor().unwrap_or(0.0),
            self.steps_per_pose(),
            self.longest_pose_ms(),
            100.0 * error,
            100.0 * accuracy,
        )
    }
}

/// Wall time for which a scene is tried.
const TRIED: Duration = Duration::from_secs(1);

/// Models that are estimated to have more nodes are not built for a check: it would take more than some ten seconds.
const BUILT: f64 = 30_000.0;

/// Size of a scene's model, which is built unless it is large; a mesh is read and checked in any case.
fn size(scene: &Scene) -> Result<Sized, CliError> {
    let refused = |source| CliError::Build { scene: scene.name.clone(), source };
    let (size, extents) = match scene.estimate() {
        Some(size) => (size, None),
        None => {
            let cloud = Body::new(scene).map_err(refused)?.cloud;
            (scene.estimate_of(cloud.points.len() as f64, cloud.cells.len() as f64), Some(extents(&cloud)))
        }
    };
    if size.nodes > BUILT {
        return Ok(Sized { size, extents, built: None, tried: None });
    }
    let session = Session::new(scene, "scene check", Keep::ANSWERS).map_err(refused)?;
    let (begun, mut cut_short) = (Instant::now(), false);
    let in_time = |_: &_| {
        cut_short = begun.elapsed() > TRIED;
        !cut_short
    };
    let readings = scene.motion.iter().flat_map(Session::motion).take_while(in_time);
    let Finished { run, twin, .. } = session.run(readings, &mut Cancel::default());
    let said = scene.advice();
    twin.warnings().iter().filter(|warning| !said.contains(warning)).for_each(|warning| super::warn(warning));
    let tried = (!run.answers.is_empty()).then_some(Tried { run, whole: !cut_short });
    Ok(Sized { size, extents, built: Some([twin.nodes(), twin.integration_points()]), tried })
}
