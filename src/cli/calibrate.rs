//! `needle_twin calibrate`: values of scene keys from a recording, with their uncertainty.

use std::cell::RefCell;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};

use super::options::ThreadOptions;
use super::output::OutputFolder;
use super::progress::{Progress, Runs};
use super::recorded::{RecordedOptions, positive};
use super::replay::refuse;
use super::summary::{aligned, screen, written};
use super::{CliError, Outcome, layers, print, scene_file, warn};
use needle_core::scene::Scene;
use needle_estimate::calibrate::{
    self, Alternative, Assumption, Calibration, Estimate, HoldOut, LoadCell, MarkerFit, MarkerTask, Prediction, Task,
    Wanted, alternatives, calibrate,
};
use needle_estimate::compare::scale::mistaken;
use needle_estimate::compare::uncertainty::FORCE_ERROR;
use needle_estimate::compare::{self, Explains};
use needle_estimate::layers::of_recording;
use needle_estimate::prior::{self, Prior};
use needle_recording::Recording;

/// Find the values of scene keys with which the twin's force comes nearest to the recorded one, and say how sure they are
#[derive(Debug, Args)]
pub(super) struct Arguments {
    #[command(flatten)]
    recorded: RecordedOptions,

    /// Key to find, one of the scene or align.contact_depth_m, align.time_offset_s, align.force_zero_n of the recording, with bounds where the key's own range is too wide: material.shear_modulus_pa or
    /// instrument.deformation_coefficient=0.2..0.8 (may be repeated; the search begins at the scene's value)
    #[arg(long, value_name = "KEY[=LOW..HIGH]", required_unless_present = "layers", num_args = 1.., value_parser = Wanted::parse, help_heading = "Fit")]
    fit: Vec<Wanted>,

    /// What earlier recordings have taught (`forecast --write-prior`): their law of tissue, whose factor is fitted in place of the modulus
    #[arg(long, value_name = "FILE", help_heading = "Fit")]
    prior: Option<PathBuf>,

    /// Instead: friction, cutting and puncture forces of so many layers and where they begin, straight from a recording of an insertion,
    /// the way out and a second insertion (one that goes as deep); no run of the twin, and depth 0 is the surface
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=16), conflicts_with = "fit", help_heading = "Fit")]
    layers: Option<u8>,

    /// What of the load cell is estimated alongside
    #[arg(long, value_enum, default_value_t = Cell::Auto, help_heading = "Fit")]
    load_cell: Cell,

    /// Standard uncertainty of the force's size that no number of readings removes (discretisation, straightness of the load
    /// cell), as a share of it; part of every standard error
    #[arg(long, value_name = "SHARE", default_value_t = FORCE_ERROR, value_parser = share, help_heading = "Fit")]
    force_error: f64,

    /// What you know of the setup and is not varied. Of plates and indenters `calibrate` fits again with other ends, with the contact fitted
    /// too, and with another law: where these explain the readings as well, the intervals hold them
    #[arg(long, value_enum, value_name = "WHAT", num_args = 1.., help_heading = "Fit")]
    certain: Vec<Certain>,

    /// Part of the recording that is not fitted
    #[arg(long, value_enum, default_value_t = Held::None, help_heading = "Fit")]
    hold_out: Held,

    /// Recorded depth up to which is fitted, m; the rest of the insertion is then predicted
    #[arg(long, value_name = "D", value_parser = positive, conflicts_with = "hold_out", help_heading = "Fit")]
    fit_to_depth_m: Option<f64>,

    /// Another bag to predict with the values found, in the scene that it names
    #[arg(long, value_name = "BAG", help_heading = "Fit")]
    predict: Option<PathBuf>,

    /// Fit the tracked points (measured_targets) as well: standard deviation of one of their coordinates. The scene's targets are the
    /// points, in their order
    #[arg(long, value_name = "M", value_parser = positive, conflicts_with_all = ["hold_out", "fit_to_depth_m", "predict"], help_heading = "Fit")]
    marker_noise_m: Option<f64>,

    /// Leave the force out: fit the tracked points alone
    #[arg(long, requires = "marker_noise_m", help_heading = "Fit")]
    markers_only: bool,

    #[command(flatten)]
    threads: ThreadOptions,

    /// Write calibration.json, calibration.csv, calibration.png and .svg, and scene.toml with the values found into this
    /// folder
    #[arg(long, value_name = "DIR", help_heading = "Output")]
    out: Option<PathBuf>,

    /// Print the result as JSON instead of a summary
    #[arg(long, help_heading = "Output")]
    json: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Cell {
    /// Its reading without load and how that drifts, unless the recording can't tell the drift from what is fitted
    Auto,
    /// Its reading without load and how that drifts
    Drift,
    /// Its reading without load
    Offset,
    /// Nothing: it is taken at its word
    Exact,
}

#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
enum Certain {
    /// How plates and faces hold the sample: bonded or frictionless, as the scene says
    Ends,
    /// The recorded depth of the first contact
    Contact,
    /// The constitutive law
    Law,
    /// All of it: one fit, as the scene says
    All,
}

impl Certain {
    fn assumptions(self) -> Vec<Assumption> {
        match self {
            Self::Ends => vec![Assumption::Ends],
            Self::Contact => vec![Assumption::Contact],
            Self::Law => vec![Assumption::Law],
            Self::All => vec![Assumption::Ends, Assumption::Contact, Assumption::Law],
        }
    }
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Held {
    /// Nothing: all of it is fitted
    None,
    /// The way out
    Retraction,
    /// The second half of the insertion, which is then predicted
    Half,
}

fn share(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|x| (0.0..1.0).contains(x));
    number.ok_or_else(|| "a share from 0 to 1, as 0.01 for 1 %".to_owned())
}

pub(super) fn run(arguments: &Arguments) -> Result<Outcome, CliError> {
    refuse_repeats(&arguments.fit)?;
    let (recording, scene) = arguments.recorded.load()?;
    if let Some(layers) = arguments.layers {
        return of_layers(arguments, &recording, &scene, usize::from(layers));
    }
    if let Some(noise_m) = arguments.marker_noise_m {
        return of_markers(arguments, &recording, &scene, noise_m);
    }
    let other = arguments.predict.as_deref().map(|bag| other(arguments, bag, &scene)).transpose()?;
    let folder = arguments.out.as_deref().map(OutputFolder::prepare).transpose()?;
    let work = || found(arguments, &scene, &recording, other.as_ref());
    let (calibration, prediction) = arguments.threads.install(work)??;
    let json = needle_report::calibration_json(&calibration, &recording.source, prediction.as_ref());
    let files = match &folder {
        Some(folder) => {
            let accepted = !calibration.rejected() || arguments.recorded.force;
            let scene = accepted.then(|| scene_toml(&calibration, &recording.source));
            needle_report::write_calibration(&folder.path, &calibration, &recording.source, &json, scene.as_deref())?
        }
        None => Vec::new(),
    };
    remarks(&calibration).iter().for_each(|remark| warn(remark));
    recording.losses.iter().for_each(|loss| warn(&loss.to_string()));
    print(&if arguments.json { json } else { summary(&calibration, prediction.as_ref(), &recording.source, &files) })?;
    let complete = recording.losses.is_empty() && !calibration.rejected();
    Ok(if complete { Outcome::Complete } else { Outcome::Lossy })
}

/// Layers from a double insertion.
fn of_layers(arguments: &Arguments, recording: &Recording, scene: &Scene, layers: usize) -> Result<Outcome, CliError> {
    recording.warnings.iter().for_each(|text| warn(text));
    let readings = arguments.recorded.topics.readings(recording);
    let found = of_recording(scene, &readings, &recording.measured(), layers)?;
    let text = needle_report::layers_json(&found, &recording.source);
    let folder = arguments.out.as_deref().map(OutputFolder::prepare).transpose()?;
    let written = folder.map(|folder| needle_report::write_layers(&folder.path, &text)).transpose()?;
    recording.losses.iter().for_each(|loss| warn(&loss.to_string()));
    let doubt = layers::doubt(&found);
    doubt.iter().for_each(|doubt| warn(doubt));
    print(&if arguments.json { text } else { layers::summary(&found, written.as_deref()) })?;
    Ok(if recording.losses.is_empty() && doubt.is_none() { Outcome::Complete } else { Outcome::Lossy })
}

/// Fits tracked points, with the force or without.
fn of_markers(arguments: &Arguments, recording: &Recording, scene: &Scene, noise_m: f64) -> Result<Outcome, CliError> {
    let progress = Progress::preparing("fitting the tracked points");
    recording.warnings.iter().for_each(|text| progress.warn(text));
    let readings = arguments.recorded.topics.readings(recording);
    let measured = recording.measured();
    let task = MarkerTask {
        scene,
        readings: &readings,
        markers: &recording.markers,
        noise_m,
        force: (!arguments.markers_only && !measured.is_empty()).then_some((&measured, arguments.force_error)),
        wanted: &arguments.fit,
    };
    let fit = arguments.threads.install(|| {
        let said = RefCell::new("fitting the tracked points".to_owned());
        calibrate::calibrate_markers(&task, &mut Runs::new(&progress, &said, readings.len()))
    })??;
    let folder = arguments.out.as_deref().map(OutputFolder::prepare).transpose()?;
    let written =
        folder.map(|folder| needle_report::write_marker_fit(&folder.path, &fit, &recording.source)).transpose()?;
    recording.losses.iter().for_each(|loss| warn(&loss.to_string()));
    let text = needle_report::marker_fit_json(&fit, &recording.source);
    print(&if arguments.json { text } else { marker_summary(&fit, written.as_deref().unwrap_or_default()) })?;
    let explained = fit.converged && fit.reduced_chi_square <= compare::verdict::EXPLAINED;
    if !explained {
        let chi = fit.reduced_chi_square;
        warn(&format!(
            "the model does not explain the tracked points within their noise (reduced chi-square {chi:.2}): see the residual map"
        ));
    }
    Ok(if explained && recording.losses.is_empty() { Outcome::Complete } else { Outcome::Lossy })
}

fn marker_summary(fit: &MarkerFit, files: &[PathBuf]) -> String {
    let mut lines = Vec::new();
    for e in &fit.estimates {
        let error = e.standard_error.map_or_else(|| "not determined by the data".to_owned(), |s| short(s, s));
        lines.push((
            "fit",
            format!("{} = {} ± {error}", e.key, e.standard_error.map_or(e.value.to_string(), |s| short(e.value, s))),
        ));
    }
    for r in &fit.residuals {
        let [x, y, z] = r.mean_m.map(|m| 1e3 * m + 0.0);
        let rms = 1e3 * r.rms_m;
        lines.push((
            "marker",
            format!("{}: rms {rms:.3} mm, mean {x:.3} {y:.3} {z:.3} mm, seen {} times", r.name, r.seen),
        ));
    }
    lines.extend(fit.rmse_n.map(|rmse| ("force", format!("rmse {rmse:.6} N at the times of the markers"))));
    lines.push(("search", format!("{} runs of the twin, reduced chi-square {:.2}", fit.runs, fit.reduced_chi_square)));
    lines.extend(files.first().map(|first| ("files", written(first, files))));
    screen(&lines)
}

fn refuse_repeats(fit: &[Wanted]) -> Result<(), CliError> {
    let twice = fit.iter().enumerate().find(|(i, w)| fit[..*i].iter().any(|before| before.key == w.key));
    twice.map_or(Ok(()), |(_, wanted)| {
        let reason = "it is named twice; name it once".to_owned();
        Err(calibrate::CalibrateError::Key { key: wanted.key.clone(), reason }.into())
    })
}

/// The other bag with the scene that it names, or else the fitted one's.
fn other(arguments: &Arguments, bag: &Path, fitted: &Scene) -> Result<(Recording, Scene), CliError> {
    let recording = Recording::open(&[bag.to_owned()], &arguments.recorded.selection())?;
    // the fitted recording's alignment is its own
    let own = || Ok(Scene { align: None, ..fitted.clone() });
    let scene = recording.scene.as_deref().map_or_else(own, scene_file::load)?;
    Ok((recording.aligned(&scene).into_owned(), scene))
}

fn found(
    arguments: &Arguments,
    scene: &Scene,
    recording: &Recording,
    other: Option<&(Recording, Scene)>,
) -> Result<(Calibration, Option<Prediction>), CliError> {
    let progress = Progress::preparing("building the model");
    let readings = arguments.recorded.topics.readings(recording);
    for warning in recording.warnings.iter().chain(&recording.foreign_frame()) {
        progress.warn(warning);
    }
    let measured = recording.measured();
    measured.loss().iter().for_each(|loss| warn(loss));
    let twin =
        needle_core::twin::Twin::new(scene).map_err(|source| CliError::Build { scene: scene.name.clone(), source })?;
    let found = mistaken(&twin, &readings, &measured, Some(recording));
    refuse(found, arguments.recorded.force, &progress)?;
    drop(twin);
    let prior = arguments.prior.as_deref().map(Prior::read).transpose()?.unwrap_or_default();
    let taught = prior::law(&prior.samples.iter().collect::<Vec<_>>(), scene, &arguments.fit)?;
    match &taught {
        Some(taught) => progress.warn(&format!("law of tissue: {}", taught.words)),
        None if arguments.prior.is_some() => warn("--prior teaches no law for this scene and these keys"),
        None => {}
    }
    let (scene, wanted) = taught.as_ref().map_or((scene, &arguments.fit), |taught| (&taught.scene, &taught.wanted));
    let task = Task {
        scene,
        readings: &readings,
        measured: &measured,
        wanted,
        load_cell: match arguments.load_cell {
            Cell::Auto => LoadCell::Auto,
            Cell::Drift => LoadCell::Drift,
            Cell::Offset => LoadCell::Offset,
            Cell::Exact => LoadCell::Exact,
        },
        force_error: arguments.force_error,
        table: None,
        part: match (arguments.hold_out, arguments.fit_to_depth_m) {
            (_, Some(depth_m)) => HoldOut::Beyond(depth_m),
            (Held::None, None) => HoldOut::Nothing,
            (Held::Retraction, None) => HoldOut::Retraction,
            (Held::Half, None) => HoldOut::Half,
        },
    };
    let said = RefCell::new("run 1: as the scene has it".to_owned());
    let say = |what: &str| {
        progress.say(what);
        what.clone_into(&mut said.borrow_mut());
    };
    let mut runs = Runs::new(&progress, &said, readings.len());
    let mut calibration = calibrate(&task, &mut runs, &mut |what| say(what))?;
    let certain: Vec<Assumption> = arguments.certain.iter().flat_map(|certain| certain.assumptions()).collect();
    calibration.alternatives = alternatives(&task, &calibration, &certain, &mut runs, &mut |what| say(what))?;
    let prediction = other.map(|(recording, scene)| {
        say("predicting the other bag");
        let readings = arguments.recorded.topics.readings(recording);
        calibrate::predict(&calibration, scene, &readings, &recording.measured(), &recording.source, &mut runs)
    });
    let prediction = prediction.transpose()?;
    Ok((calibration, prediction))
}

/// What the user must know before believing the numbers.
fn remarks(calibration: &Calibration) -> Vec<String> {
    let mut remarks = Vec::new();
    if calibration.rejected() {
        let with =
            if calibration.verdict.explains == Explains::NoMeasurement { "" } else { " with any of the values tried" };
        remarks.push(format!("rejected: {}{with}", calibration.verdict.line()));
    }
    remarks.extend(calibration.verdict.reasons.iter().cloned());
    if let Some(found) = calibration.alignment.filter(|_| calibration.realigned != [false; 2]) {
        let taken = found
            .reasons()
            .into_iter()
            .map(|reason| reason.replace("`calibrate` takes it out", "it is taken out here"));
        remarks.extend(taken);
    }
    if !calibration.drift_left_out_for.is_empty() {
        remarks.push(format!(
            "the load cell's drift was left out, since this recording can't tell it from {}; --load-cell drift fits it all the same",
            calibration.drift_left_out_for.join(", ")
        ));
    }
    for group in &calibration.indistinguishable {
        remarks.push(format!(
            "the data can't tell apart: {}. Their values and errors mean little: {}",
            group.join(", "),
            calibration.remedy(group)
        ));
    }
    for e in &calibration.estimates[..calibration.keys] {
        if !e.has_effect {
            remarks.push(format!("{} does not change the force of this recording: its value means nothing", e.name));
        } else if e.at_bound() {
            remarks
                .push(format!("{} ended at its bound {}: give other bounds, or take another model", e.name, e.value));
        }
    }
    if !calibration.converged {
        remarks.push(format!("the search ran out of steps after {}: start nearer with --set", calibration.iterations));
    }
    remarks
}

/// The scene file, with what was found above it.
fn scene_toml(calibration: &Calibration, source: &str) -> String {
    let mut text = format!("# Written by `needle_twin calibrate` from {source}.\n");
    for (k, e) in calibration.estimates.iter().enumerate() {
        let interval = if k < calibration.keys { calibration.interval_95(k) } else { e.interval_95() };
        let _ = writeln!(text, "# {}", line(e, interval)); // writing to a String can't fail
    }
    let _ = writeln!(text, "# Root mean square of the residual {:.6} N.\n", calibration.rmse_n());
    text + &calibration.scene.to_toml()
}

/// Value, standard error and where they come from.
fn line(e: &Estimate, interval: Option<[f64; 2]>) -> String {
    let Some((error, [low, high])) = e.standard_error().zip(interval) else {
        let reason = e.withheld.as_deref().unwrap_or("not determined by the data");
        return format!("{} = {:.6}, without an interval: {reason}", e.name, e.value);
    };
    let share = |part: Option<f64>| part.unwrap_or(0.0);
    format!(
        "{} = {} ± {} (noise {}, systematic {}); 95 % within {} to {}",
        e.name,
        short(e.value, error),
        short(error, error),
        short(share(e.noise_error), error),
        short(share(e.systematic_error), error),
        short(low, error),
        short(high, error),
    )
}

/// What another assumption gives.
fn other_fit(a: &Alternative) -> String {
    let value = |e: &Estimate| {
        let error = e.standard_error();
        let value = error.map_or_else(|| format!("{:.6}", e.value), |error| short(e.value, error));
        format!("{} = {value}{}", e.name, error.map_or_else(String::new, |error| format!(" ± {}", short(error, error))))
    };
    let values: Vec<String> = a.estimates.iter().map(value).collect();
    let verdict = if a.explains() { "explains the measurement too" } else { "does not explain the measurement" };
    let chi = a.verdict.reduced_chi_square.map_or_else(String::new, |c| format!(" (reduced chi-square {c:.2})"));
    format!("with {}: {}; {verdict}{chi}", a.what, values.join(", "))
}

/// As many decimals as show the error with two figures.
fn short(value: f64, error: f64) -> String {
    let decimals = (1.0 - error.log10().floor()).clamp(0.0, 12.0) as usize;
    if error > 0.0 { format!("{value:.decimals$}") } else { format!("{value:.6}") }
}

fn summary(calibration: &Calibration, prediction: Option<&Prediction>, source: &str, files: &[PathBuf]) -> String {
    let word = if calibration.rejected() { "rejected: " } else { "" };
    let mut lines = vec![("verdict", format!("{word}{}", calibration.verdict.line()))];
    lines.push(("scene", format!("{}, {source}", calibration.scene.name)));
    let (keys, beside) = calibration.estimates.split_at(calibration.keys);
    let cell: Vec<&Estimate> = beside.iter().filter(|e| e.name.starts_with("load_cell.")).collect();
    lines.extend(keys.iter().enumerate().map(|(k, e)| ("fit", line(e, calibration.interval_95(k)))));
    lines.extend(cell.iter().map(|e| ("alongside", line(e, e.interval_95()))));
    lines.extend(calibration.alternatives.iter().map(|a| ("or", other_fit(a))));
    if calibration.alternatives.iter().any(Alternative::explains) && !calibration.rejected() {
        let held = "nothing of this recording decides between these: the intervals above hold all that explain it (--certain what you know)";
        lines.push(("", held.to_owned()));
    }
    lines.extend(
        calibration
            .alignment
            .map(|a| ("alignment", aligned(&a, [calibration.realigned[0], calibration.realigned[1], true]))),
    );
    let tied = calibration.tied.iter();
    lines.extend(tied.map(|(key, other)| ("tied", format!("{key} = {other}, as the scene had them equal"))));
    for (a, b) in (0..keys.len()).flat_map(|a| (0..a).map(move |b| (a, b))) {
        if let Some(correlation) = calibration.correlation[a][b] {
            lines.push(("related", format!("{} and {}: correlation {correlation:.4}", keys[b].name, keys[a].name)));
        }
    }
    let readings = calibration.parts.fitted.len();
    let spikes = match calibration.left_out {
        0 => String::new(),
        n => format!(" (spikes among them, which were not fitted: {n})"),
    };
    lines.push(("residual", format!("rmse {:.6} N over {readings} readings{spikes}", calibration.rmse_n())));
    if let (Some(held), Some(rmse)) = (&calibration.parts.held_out, calibration.held_out_rmse_n()) {
        lines.push(("held out", format!("rmse {rmse:.6} N over {} readings that were not fitted", held.len())));
    }
    lines.extend(calibration.standing().map(|standing| ("baselines", standing.sentence())));
    if let Some(p) = prediction {
        let share = |rmse: f64| if p.peak_n > 0.0 { 100.0 * rmse / p.peak_n } else { 0.0 };
        lines.push((
            "predicted",
            format!(
                "{}: rmse {:.6} N ({:.2} % of the peak), {:.6} N ({:.2} %) with the scene's own values",
                p.source,
                p.rmse_n,
                share(p.rmse_n),
                p.rmse_before_n,
                share(p.rmse_before_n)
            ),
        ));
        if !p.left.is_empty() {
            lines.push(("", format!("scene {} has no {}", p.scene, p.left.join(", "))));
        }
    }
    lines.push(("search", format!("{} steps, {} runs of the twin", calibration.iterations, calibration.runs)));
    lines.extend(files.first().map(|first| ("files", written(first, files))));
    screen(&lines)
}
