//! Files of forecasts: the prediction of each recording, its picture, and the comparison of all.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use super::ReportError;
use super::files::{self, Rendered};
use super::metrics::{baselines_json, verdict_json};
use super::picture::{Anchor, Colour, Pen, Picture, Type};
use super::plot::{Axis, BLUE, End, INK, MUTED, Panel, VERMILION, label, legend};
use super::unit::significant;
use needle_estimate::baseline::{Against, Standing};
use needle_estimate::forecast::{Judged, Prediction};
use serde_json::{Value, json};

const WIDTH: u32 = 960;
const HEIGHT: u32 = 520;
const SIDES: [f64; 2] = [84.0, 932.0];
const MEASURED: Pen = Pen::new(INK, 1.5);
const TWIN: Pen = Pen::new(BLUE, 2.2).dashed([8.0, 5.0]);
const BAND: Pen = Pen::new(Colour(0x0b, 0x62, 0xc4, 0.45), 1.0);
const BASELINE: Pen = Pen::new(VERMILION, 1.6).dashed([3.0, 4.0]);
/// Forces below this are shown in mN.
const SMALL_N: f64 = 0.2;
/// Number of drawn points per curve.
const DRAWN: usize = 1500;
/// A forecast within this share of the peak is counted.
const CLOSE: f64 = 0.05;

/// One recording: its prediction and the comparison, or why there is none.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Forecasted {
    /// Name of the recording.
    pub name: String,
    /// Name of its scene.
    pub scene: String,
    /// The law of tissue that other recordings taught, in words; `None`: the scene's own.
    pub law: Option<String>,
    /// The prediction and the comparison with the measured rest.
    pub made: Option<(Prediction, Judged)>,
    /// Why there is none.
    pub failed: Option<String>,
    /// Losses of the recording or of the prediction.
    pub losses: Vec<String>,
}

/// Writes `NAME.csv`, the prediction of a recording, with nothing of the measured rest: `time_s`, `depth_m`,
/// `fitted_n` (the measured force where it was fitted), `predicted_n`, its band, and a column for each baseline.
///
/// # Errors
/// [`ReportError`] naming the file and the reason.
pub fn write_prediction(out: &Path, name: &str, prediction: &Prediction) -> Result<PathBuf, ReportError> {
    let mut text = "time_s,depth_m,fitted_n,predicted_n,predicted_low_n,predicted_high_n".to_owned();
    for baseline in &prediction.baselines {
        let _ = write!(text, ",{}_n", baseline.name.replace(' ', "_")); // writing to a String can't fail
    }
    text.push('\n');
    let fitted: BTreeMap<usize, f64> = prediction.fitted.iter().copied().collect();
    for i in 0..prediction.time_s.len() {
        let [low, high] = prediction.band_n(i);
        let (time, depth, force) = (prediction.time_s[i], prediction.depth_m[i], prediction.force_n[i]);
        let known = fitted.get(&i).map_or_else(String::new, ToString::to_string);
        let _ = write!(text, "{time},{depth},{known},{force},{low},{high}");
        for baseline in &prediction.baselines {
            let _ = write!(text, ",{}", baseline.force_n[i]);
        }
        text.push('\n');
    }
    let path = out.join(format!("{name}.csv"));
    super::write_file(&path, text.as_bytes())?;
    Ok(path)
}

/// Writes `forecast.json`, `forecast.csv` with a row per recording, and `NAME.svg` (and `.png`) of each; returns
/// their paths. `json` is the result of [`forecast_json`].
///
/// # Errors
/// As [`super::write_all`].
pub fn write_forecast(out: &Path, all: &[Forecasted], json: &str) -> Result<Vec<PathBuf>, ReportError> {
    let mut rendered = vec![Rendered::new("forecast.json", json), Rendered::new("forecast.csv", csv(all))];
    for one in all {
        if let Some((prediction, judged)) = &one.made {
            super::push_picture(&mut rendered, &one.name, &plot(one, prediction, judged))?;
        }
    }
    files::write(out, &rendered)
}

/// Relative errors of every model over the recordings, by name, the twin first.
fn errors(all: &[Forecasted]) -> Vec<(&str, Vec<f64>)> {
    let mut errors: Vec<(&str, Vec<f64>)> = vec![("twin", Vec::new())];
    for (_, judged) in all.iter().filter_map(|one| one.made.as_ref()) {
        let Some(standing) = judged.standing.as_ref().filter(|_| judged.peak_n > 0.0) else { continue };
        errors[0].1.push(standing.twin_rmse_n / judged.peak_n);
        for baseline in &standing.baselines {
            let error = baseline.rmse_n / judged.peak_n;
            match errors.iter_mut().find(|(name, _)| *name == baseline.name) {
                Some((_, list)) => list.push(error),
                None => errors.push((&baseline.name, vec![error])),
            }
        }
    }
    errors
}

fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

fn standings(all: &[Forecasted]) -> [usize; 3] {
    let of = |wanted: Against| {
        let standing = |one: &&Forecasted| {
            let judged = one.made.as_ref().map(|(_, judged)| judged);
            judged.and_then(|j| j.standing.as_ref()).is_some_and(|s| s.against() == wanted)
        };
        all.iter().filter(standing).count()
    };
    [of(Against::Better), of(Against::AsGood), of(Against::Worse)]
}

/// All of it for a screen: a word and a line each.
#[must_use]
pub fn forecast_lines(all: &[Forecasted]) -> Vec<(&'static str, String)> {
    let mut lines = Vec::new();
    for one in all {
        let Some((prediction, judged)) = &one.made else {
            lines.push(("failed", one.name.clone()));
            continue;
        };
        let found: Vec<String> = prediction.calibration.estimates[..prediction.calibration.keys]
            .iter()
            .map(|e| format!("{} {:.5e}", e.name, e.value))
            .collect();
        lines.push((
            "forecast",
            format!("{}, scene {}, after {}: {}", one.name, one.scene, prediction.words, found.join(", ")),
        ));
        lines.extend(one.law.iter().map(|law| ("law", law.clone())));
        lines.extend(prediction.correction.iter().map(|words| ("learnt", words.clone())));
        if let Some(standing) = &judged.standing {
            let share = |n: f64| if judged.peak_n > 0.0 { 100.0 * n / judged.peak_n } else { 0.0 };
            let models: Vec<String> = std::iter::once(("twin", standing.twin_rmse_n))
                .chain(judged.alone_rmse_n.map(|rmse| ("twin alone", rmse)))
                .chain(standing.baselines.iter().map(|b| (b.name.as_str(), b.rmse_n)))
                .map(|(name, rmse)| format!("{name} {:.1} %", share(rmse)))
                .collect();
            lines.push((
                "error",
                format!(
                    "{} of the peak {:.4} N (root mean square, {} readings)",
                    models.join(", "),
                    judged.peak_n,
                    standing.readings
                ),
            ));
            let coverage = judged
                .coverage
                .map_or_else(String::new, |c| format!("; its band holds {:.0} % of the readings", 1e2 * c));
            lines.push(("verdict", format!("{} than the best baseline{coverage}", against(standing))));
        }
    }
    if all.len() > 1 {
        lines.extend(forecast_totals(all).into_iter().map(|line| ("all", line)));
    }
    lines
}

fn against(standing: &Standing) -> &'static str {
    match standing.against() {
        Against::Better => "better",
        Against::AsGood => "no better and no worse",
        Against::Worse => "worse",
        Against::NoMeasurement => "not comparable",
    }
}

/// What all recordings say together, in lines.
fn forecast_totals(all: &[Forecasted]) -> Vec<String> {
    let [better, as_good, worse] = standings(all);
    let line = |(name, errors): (&str, Vec<f64>)| {
        let close = errors.iter().filter(|e| **e <= CLOSE).count();
        let n = errors.len();
        mean(&errors)
            .map(|mean| format!("{name}: {:.1} % of the peak on average, {close} of {n} within 5 %", 1e2 * mean))
    };
    let mut lines: Vec<String> = errors(all).into_iter().filter_map(line).collect();
    lines
        .push(format!("the twin is better than the best baseline in {better}, as good in {as_good}, worse in {worse}"));
    lines
}

/// Content of `forecast.json`.
#[must_use]
pub fn forecast_json(all: &[Forecasted], fit_to: f64, of: &str) -> String {
    let [better, as_good, worse] = standings(all);
    let models: Vec<Value> = errors(all)
        .into_iter()
        .map(|(name, errors)| {
            json!({
                "name": name,
                "recordings": errors.len(),
                "mean_relative_rmse": mean(&errors),
                "within_5_percent": errors.iter().filter(|e| **e <= CLOSE).count(),
            })
        })
        .collect();
    let coverage: Vec<f64> =
        all.iter().filter_map(|one| one.made.as_ref().and_then(|(_, judged)| judged.coverage)).collect();
    let body = json!({
        "fit_to": fit_to,
        "of": of,
        "recordings": all.iter().map(entry).collect::<Vec<Value>>(),
        "models": models,
        "better": better,
        "as_good": as_good,
        "worse": worse,
        "failed": all.iter().filter(|one| one.made.is_none()).count(),
        "mean_coverage": mean(&coverage),
    });
    format!("{body:#}\n")
}

fn entry(one: &Forecasted) -> Value {
    let Some((prediction, judged)) = &one.made else {
        return json!({ "name": one.name, "scene": one.scene, "failed": one.failed, "losses": one.losses });
    };
    let (calibration, standing) = (&prediction.calibration, judged.standing.as_ref());
    let keys = calibration.estimates[..calibration.keys].iter();
    let fit: BTreeMap<&str, Value> =
        keys.map(|e| (e.name.as_str(), json!({ "value": e.value, "standard_error": e.standard_error() }))).collect();
    let parts: Vec<Value> = judged
        .parts
        .iter()
        .map(|part| {
            json!({
                "from_depth_m": part.depth_m[0],
                "to_depth_m": part.depth_m[1],
                "twin_rmse_n": part.rmse_n,
                "best_baseline_rmse_n": part.baseline_rmse_n,
            })
        })
        .collect();
    json!({
        "name": one.name,
        "scene": one.scene,
        "law": one.law,
        "correction": prediction.correction,
        "failed": Value::Null,
        "losses": one.losses,
        "fitted_to": prediction.words,
        "fit": fit,
        "fitted_rmse_n": calibration.rmse_n(),
        "verdict": verdict_json(&calibration.verdict, standing),
        "peak_n": judged.peak_n,
        "readings": standing.map(|s| s.readings),
        "rmse_n": standing.map(|s| s.twin_rmse_n),
        "twin_alone_rmse_n": judged.alone_rmse_n,
        "relative_rmse": standing.map(|s| s.twin_rmse_n / judged.peak_n).filter(|x| x.is_finite()),
        "baselines": baselines_json(standing),
        "against_baselines": standing.map_or(Against::NoMeasurement, |s| s.against()).as_str(),
        "coverage": judged.coverage,
        "over_depth": parts,
    })
}

/// A row per recording: errors of the twin and of every baseline over the predicted readings, N.
fn csv(all: &[Forecasted]) -> String {
    let names: Vec<&str> = errors(all).into_iter().skip(1).map(|(name, _)| name).collect();
    let mut text = "name,scene,fitted_to,readings,peak_n,coverage,against_baselines,twin_rmse_n".to_owned();
    for name in &names {
        let _ = write!(text, ",{}_rmse_n", name.replace(' ', "_")); // writing to a String can't fail
    }
    text.push('\n');
    for one in all {
        let quoted = |text: &str| format!("\"{}\"", text.replace('"', "\"\""));
        let _ = write!(text, "{},{}", quoted(&one.name), quoted(&one.scene));
        let Some((prediction, judged)) = &one.made else {
            text.push_str(&",".repeat(6 + names.len()));
            text.push('\n');
            continue;
        };
        let standing = judged.standing.clone().unwrap_or_default();
        let coverage = judged.coverage.map_or_else(String::new, |c| c.to_string());
        let against = judged.standing.as_ref().map_or(Against::NoMeasurement, |s| s.against());
        let (words, peak, n) = (quoted(&prediction.words), judged.peak_n, standing.readings);
        let _ = write!(text, ",{words},{n},{peak},{coverage},{},{}", against.as_str(), standing.twin_rmse_n);
        for name in &names {
            let rmse = standing.baselines.iter().find(|b| b.name == *name).map(|b| b.rmse_n.to_string());
            let _ = write!(text, ",{}", rmse.unwrap_or_default());
        }
        text.push('\n');
    }
    text
}

/// Measured and predicted force over time, with the best baseline.
fn plot(one: &Forecasted, prediction: &Prediction, judged: &Judged) -> Picture {
    let mut picture = Picture::new(WIDTH, HEIGHT);
    let standing = judged.standing.as_ref();
    let best = standing.and_then(|s| s.best()).map(|b| b.name.as_str());
    let best = best.and_then(|name| prediction.baselines.iter().find(|f| f.name == name));
    let (factor, unit) = if judged.peak_n < SMALL_N { (1e3, "mN") } else { (1.0, "N") };
    let title = Type { size: 19.0, bold: true, colour: INK, anchor: Anchor::Start };
    picture.text([SIDES[0], 36.0], format!("{}: forecast after {}", one.name, prediction.words), title);
    let muted = Type { colour: MUTED, ..label(Anchor::Start) };
    if let Some(standing) = standing {
        let share = |n: f64| significant(100.0 * n / judged.peak_n, 2);
        let others: Vec<String> =
            standing.baselines.iter().map(|b| format!("{} {} %", b.name, share(b.rmse_n))).collect();
        let line = format!(
            "Error of the rest, share of the peak: twin {} %, {}",
            share(standing.twin_rmse_n),
            others.join(", ")
        );
        picture.text([SIDES[0], 60.0], line, muted);
    }
    let mut entries = vec![("measured", MEASURED), ("twin", TWIN), ("95 % of the readings", BAND)];
    entries.extend(best.map(|best| (best.name, BASELINE)));
    legend(&mut picture, [SIDES[0], 88.0], &entries);
    let step = 1 + prediction.time_s.len() / DRAWN;
    let all = |force: &dyn Fn(usize) -> f64| -> Vec<[f64; 2]> {
        (0..prediction.time_s.len()).step_by(step).map(|i| [prediction.time_s[i], factor * force(i)]).collect()
    };
    let measured: Vec<[f64; 2]> = judged
        .measured
        .iter()
        .step_by(1 + judged.measured.len() / DRAWN)
        .map(|(i, n)| [prediction.time_s[*i], factor * n])
        .collect();
    let twin = all(&|i| prediction.force_n[i]);
    let heights = measured.iter().chain(&twin).map(|[_, y]| *y).chain([0.0]);
    let y = Axis::holding(heights, 6, 0.16);
    let x = Axis::holding(prediction.time_s.iter().copied(), 10, 0.0);
    let panel = Panel { frame: [SIDES[0], 132.0, SIDES[1], 456.0], x, y };
    panel.grid(&mut picture, true);
    panel.title(&mut picture, &format!("Reading of the load cell in {unit}, over time in s"), 11.0);
    let clipped = |points: Vec<[f64; 2]>| -> Vec<[f64; 2]> {
        points.into_iter().map(|[t, n]| [t, n.clamp(panel.y.min, panel.y.max)]).collect()
    };
    panel.curve(&mut picture, measured, MEASURED);
    if let Some(best) = best {
        panel.curve(&mut picture, clipped(all(&|i| best.force_n[i])), BASELINE);
    }
    panel.curve(&mut picture, clipped(all(&|i| prediction.band_n(i)[0])), BAND);
    panel.curve(&mut picture, clipped(all(&|i| prediction.band_n(i)[1])), BAND);
    panel.curve(&mut picture, twin, TWIN);
    panel.event(&mut picture, prediction.cut_s, "fitted up to here, predicted from here", End::Upper);
    picture
}
