//! The files that a run leaves: complete, finite, self-contained, and never half written.
#![allow(clippy::unwrap_used, clippy::panic)]

use crate::synthetic_run;
use base64::{Engine as _, engine::general_purpose::STANDARD};
use needle_core::twin::Event;
use needle_estimate::compare::Run;
use needle_report as report;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::{fs, path::Path, process::Command};

const FILES: [&str; 7] =
    ["final.vtu", "force.csv", "force.png", "force.svg", "metrics.json", "report.html", "targets.csv"];

fn names(folder: &Path) -> Vec<String> {
    let name = |e: std::io::Result<fs::DirEntry>| e.unwrap().file_name().into_string().unwrap();
    fs::read_dir(folder).unwrap().map(name).collect::<BTreeSet<_>>().into_iter().collect()
}

/// A run in which nearly everything went wrong.
fn broken() -> Run {
    let mut run = synthetic_run::needle(50.0);
    run.scene = "</script><script>alert(1)</script> & \"quotes\"".into();
    run.target_names[0] = "vessel, \"left\" </script>".into();
    for (i, a) in run.answers.iter_mut().enumerate() {
        match i % 7 {
            0 => a.predicted_n = f64::NAN,
            1 => a.measured_n = Some(f64::INFINITY),
            2 => a.measured_n = None,
            3 => a.latency_s = f64::NAN,
            4 => a.depth_m = f64::NAN,
            5 => a.time_s = f64::NEG_INFINITY,
            _ => {}
        }
    }
    run.answers[20].event = Some(Event::Puncture { depth_m: f64::NAN, region: 0 });
    run.targets[3].positions[1][2] = f64::NAN;
    run.targets[4].time_s = f64::NAN;
    run.snapshots[5].displacement[9][1] = f64::NAN;
    run.snapshots[6].jacobian[9] = f64::INFINITY;
    run.final_state.displacement[11] = [f64::NAN; 3];
    run.diverged = Some("volume ratio -0.1 at point 17".into());
    run.wall_s = 0.0;
    for figure in [
        &mut run.min_jacobian,
        &mut run.max_kinetic_to_strain_energy,
        &mut run.force_imbalance,
        &mut run.constraint_error_m,
        &mut run.folded_energy,
        &mut run.build_s,
        &mut run.simulated_s,
    ] {
        *figure = f64::NAN;
    }
    run
}

#[test]
fn all_files_are_written_and_nothing_else() {
    let out = tempfile::tempdir().unwrap();
    let folder = out.path().join("new/folder");
    for run in [synthetic_run::needle(100.0), Run::default(), broken()] {
        report::prepare(&folder).unwrap();
        let paths = report::write_all(&folder, &run).unwrap();
        assert!(paths.iter().all(|p| p.metadata().unwrap().len() > 0));
        assert_eq!(names(&folder), FILES);
    }
}

#[test]
fn what_cannot_be_written_is_named_and_leaves_nothing_half_done() {
    let out = tempfile::tempdir().unwrap();
    let file = out.path().join("a_file");
    fs::write(&file, "mine").unwrap();
    let run = synthetic_run::needle(10.0);
    for result in [report::prepare(&file), report::write_all(&file, &run).map(drop)] {
        let message = result.unwrap_err().to_string();
        assert!(message.contains("a_file") && message.contains("--out"), "{message}");
    }
    // A folder lies where a file should go.
    let folder = out.path().join("results");
    fs::create_dir_all(folder.join("force.png/keep")).unwrap();
    let message = report::write_all(&folder, &run).unwrap_err().to_string();
    assert!(message.contains("force.png"), "{message}");
    assert!(names(&folder).iter().all(|n| !n.contains("partial")), "{:?}", names(&folder));
    // A run that contradicts itself: nothing that lay there before is touched.
    let folder = out.path().join("before");
    fs::create_dir(&folder).unwrap();
    fs::write(folder.join("metrics.json"), "old").unwrap();
    let mut wrong = run;
    wrong.final_state.von_mises_pa.pop();
    report::write_all(&folder, &wrong).unwrap_err();
    assert_eq!(names(&folder), ["metrics.json"]);
    assert_eq!(fs::read_to_string(folder.join("metrics.json")).unwrap(), "old");
    assert_eq!(fs::read_to_string(file).unwrap(), "mine");
}

#[test]
fn no_text_holds_a_number_that_is_not_finite() {
    let run = broken();
    let texts = [
        report::metrics_json(&run),
        report::force_csv(&run),
        report::targets_csv(&run),
        report::final_vtu(&run).unwrap(),
        report::force_svg(&run),
        report::report_html(&run).unwrap(),
    ];
    for text in texts {
        // The page's own script says NaN as a word of its language.
        let text = text.split_once("<script>\n'use strict'").map_or(text.as_str(), |(data, _)| data);
        // Base64 can hold any word by chance; its numbers are looked at where it is decoded.
        let plain: String =
            text.split("\"base64\":\"").map(|part| part.split_once('"').map_or(part, |(_, p)| p)).collect();
        let plain: String = plain.lines().filter(|l| !text.contains("<VTKFile") || l.starts_with('<')).collect();
        let mut words = plain.split(|c: char| !c.is_ascii_alphanumeric());
        assert!(plain.len() > 100 && words.all(|w| !["NaN", "nan", "inf", "Inf", "Infinity"].contains(&w)), "{plain}");
    }
}

#[test]
fn metrics_have_the_promised_keys() {
    let run = synthetic_run::needle(1000.0);
    let metrics: Value = serde_json::from_str(&report::metrics_json(&run)).unwrap();
    for key in ["scene", "method", "checksum"] {
        assert!(metrics[key].is_string(), "{key}");
    }
    for pointer in [
        "/nodes",
        "/integration_points",
        "/poses",
        "/steps",
        "/force/peak_predicted_n",
        "/force/peak_measured_n",
        "/force/rmse_n",
        "/force/nrmse",
        "/force/max_abs_error_n",
        "/timing/build_s",
        "/timing/wall_s",
        "/timing/simulated_s",
        "/timing/real_time_factor",
        "/timing/step_us",
        "/timing/pose_latency_ms/p50",
        "/timing/pose_latency_ms/p99",
        "/timing/pose_latency_ms/max",
        "/timing/missed_deadlines",
        "/timing/coalesced_poses",
        "/stability/min_jacobian",
        "/stability/max_kinetic_to_strain_energy",
        "/stability/force_imbalance",
    ] {
        assert!(metrics.pointer(pointer).is_some_and(Value::is_number), "{pointer}");
    }
    assert_eq!(metrics["stability"]["diverged"], false);
    assert_eq!(metrics["poses"], run.answers.len());
    let factor = metrics["timing"]["real_time_factor"].as_f64().unwrap();
    assert!((factor - run.simulated_s / run.wall_s).abs() < 1e-12);
    let force = &metrics["force"];
    let nrmse = force["rmse_n"].as_f64().unwrap() / force["peak_measured_n"].as_f64().unwrap();
    assert!((force["nrmse"].as_f64().unwrap() - nrmse).abs() < 1e-12);
    assert_eq!(metrics["null_because"], serde_json::json!({}));
}

#[test]
fn a_null_figure_says_why() {
    let mut run = synthetic_run::needle(10.0);
    run.answers.iter_mut().for_each(|a| a.measured_n = None);
    run.min_jacobian = f64::NAN;
    let metrics: Value = serde_json::from_str(&report::metrics_json(&run)).unwrap();
    assert!(metrics["force"]["rmse_n"].is_null() && metrics["stability"]["min_jacobian"].is_null());
    let why = &metrics["null_because"];
    assert!(why["force.rmse_n"].as_str().unwrap().contains("no measured force"));
    assert!(why["stability.min_jacobian"].as_str().unwrap().contains("not a finite number"));
}

#[test]
fn csv_holds_every_answer() {
    let mut run = synthetic_run::needle(100.0);
    run.answers[3].measured_n = None;
    run.answers[4].predicted_n = f64::NAN;
    let csv = report::force_csv(&run);
    let mut lines = csv.lines();
    let header = "time_s,depth_m,predicted_n,measured_n,predicted_x_n,predicted_y_n,predicted_z_n,\
                  measured_x_n,measured_y_n,measured_z_n,model_error_n";
    assert_eq!(lines.next(), Some(header));
    let rows: Vec<Vec<&str>> = lines.map(|l| l.split(',').collect()).collect();
    assert_eq!(rows.len(), run.answers.len());
    assert_eq!((rows[3][3], rows[4][2]), ("", ""));
    for (row, a) in rows.iter().zip(&run.answers).skip(5) {
        let numbers: Vec<f64> = row.iter().map(|c| c.parse().unwrap()).collect();
        assert_eq!(numbers[..4], [a.time_s, a.depth_m, a.predicted_n, a.measured_n.unwrap()]);
        assert_eq!((&numbers[4..7], &numbers[7..10]), (&a.predicted_vector_n[..], &a.measured_vector_n.unwrap()[..]));
        assert_eq!(numbers[10], a.model_error_n);
    }
}

#[test]
fn targets_have_three_columns_each() {
    let mut run = synthetic_run::needle(10.0);
    run.target_names[1] = "lesion, \"deep\"".into();
    let csv = report::targets_csv(&run);
    let header = "time_s,depth_m,vessel_x_m,vessel_y_m,vessel_z_m,\"lesion, \"\"deep\"\"_x_m\",\
                  \"lesion, \"\"deep\"\"_y_m\",\"lesion, \"\"deep\"\"_z_m\"";
    assert_eq!(csv.lines().next(), Some(header));
    let last: Vec<f64> = csv.lines().last().unwrap().split(',').map(|c| c.parse().unwrap()).collect();
    let row = run.targets.last().unwrap();
    assert_eq!(last[2..], *row.positions.as_flattened());
}

/// Pixels close to a colour.
fn pixels(png: &[u8], [r, g, b]: [u8; 3]) -> usize {
    let picture = tiny_skia::Pixmap::decode_png(png).unwrap();
    let near = |p: &&tiny_skia::PremultipliedColorU8| {
        [(p.red(), r), (p.green(), g), (p.blue(), b)].iter().all(|(a, b)| a.abs_diff(*b) < 8)
    };
    picture.pixels().iter().filter(near).count()
}

#[test]
fn the_picture_shows_what_there_is() {
    const PREDICTED: [u8; 3] = [0x0b, 0x62, 0xc4];
    const RESIDUAL: [u8; 3] = [0xc4, 0x47, 0x00];
    let mut run = synthetic_run::needle(1000.0);
    let png = report::force_png(&run).unwrap();
    let picture = tiny_skia::Pixmap::decode_png(&png).unwrap();
    assert_eq!((picture.width(), picture.height()), (1920, 1384));
    assert!(pixels(&png, PREDICTED) > 4000 && pixels(&png, RESIDUAL) > 4000);
    run.answers.iter_mut().for_each(|a| a.measured_n = None);
    let alone = report::force_png(&run).unwrap();
    assert_eq!(pixels(&alone, RESIDUAL), 0, "no residual without a measured force");
    assert!(pixels(&alone, PREDICTED) > 4000);
    assert!(pixels(&report::force_png(&synthetic_run::needle(1.0)).unwrap(), PREDICTED) > 4000, "few poses, one line");
}

#[test]
fn a_load_cell_slower_than_the_poses_is_still_drawn() {
    const RESIDUAL: [u8; 3] = [0xc4, 0x47, 0x00];
    let mut run = synthetic_run::needle(1000.0);
    run.answers.iter_mut().enumerate().filter(|(i, _)| i % 10 != 0).for_each(|(_, a)| a.measured_n = None);
    assert!(pixels(&report::force_png(&run).unwrap(), RESIDUAL) > 2000);
    // Nothing is drawn where there is a long gap.
    let gap = |a: &&mut needle_estimate::compare::Answer| (3.0..9.0).contains(&a.time_s);
    let before = pixels(&report::force_png(&run).unwrap(), RESIDUAL);
    run.answers.iter_mut().filter(gap).for_each(|a| a.measured_n = None);
    let after = pixels(&report::force_png(&run).unwrap(), RESIDUAL);
    assert!(after < before * 7 / 10, "{after} of {before}");
}

#[test]
fn svg_and_vtu_are_well_formed() {
    let out = tempfile::tempdir().unwrap();
    let parse = "import sys, xml.dom.minidom as m; [m.parse(f) for f in sys.argv[1:]]";
    for run in [synthetic_run::needle(100.0), broken(), Run::default()] {
        report::write_all(out.path(), &run).unwrap();
        let files = ["force.svg", "final.vtu"].map(|n| out.path().join(n));
        let output = Command::new("python3").args(["-c", parse]).args(files).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }
}

/// The data of a page with its arrays decoded to plain numbers.
fn embedded(html: &str) -> Value {
    let (_, rest) = html.split_once("<script type=\"application/json\" id=\"run\">").unwrap();
    unpacked(serde_json::from_str(rest.split_once("</script>").unwrap().0).unwrap())
}

fn unpacked(value: Value) -> Value {
    match value {
        Value::Object(object) => match (object.get("type"), object.get("base64")) {
            (Some(Value::String(kind)), Some(Value::String(text))) => numbers(kind, &STANDARD.decode(text).unwrap()),
            _ => object.into_iter().map(|(k, v)| (k, unpacked(v))).collect::<BTreeMap<_, _>>().into_iter().collect(),
        },
        Value::Array(items) => items.into_iter().map(unpacked).collect(),
        other => other,
    }
}

fn numbers(kind: &str, bytes: &[u8]) -> Value {
    fn of<const N: usize>(bytes: &[u8], number: impl Fn([u8; N]) -> f64) -> Value {
        let number = |b: &[u8]| {
            let n = number(b.try_into().unwrap());
            assert!(n.is_finite());
            n
        };
        bytes.chunks_exact(N).map(number).collect()
    }
    match kind {
        "f32" => of(bytes, |b| f64::from(f32::from_le_bytes(b))),
        "i16" => of(bytes, |b| f64::from(i16::from_le_bytes(b))),
        "u16" => of(bytes, |b| f64::from(u16::from_le_bytes(b))),
        "u32" => of(bytes, |b| f64::from(u32::from_le_bytes(b))),
        "u8" => of(bytes, |b: [u8; 1]| f64::from(b[0])),
        other => panic!("array type {other}"),
    }
}

fn floats(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

#[test]
fn the_page_carries_the_run() {
    let run = synthetic_run::needle(1000.0);
    let data = embedded(&report::report_html(&run).unwrap());
    let rows = &data["rows"];
    let predicted = floats(&rows["predicted"]);
    assert!(predicted.len() < 7000 && predicted.len() > 1000, "thinned to {}", predicted.len());
    for column in ["time", "depth", "measured", "steps", "latency"] {
        assert_eq!(floats(&rows[column]).len(), predicted.len(), "{column}");
    }
    let largest = |v: &[f64]| v.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let peak = run.force_metrics().peak_measured_n.unwrap();
    assert!((largest(&floats(&rows["measured"])) / peak - 1.0).abs() < 1e-6, "the peak survives the thinning");
    let latency = run.latency_ms().unwrap().max;
    assert!((largest(&floats(&rows["latency"])) / latency - 1.0).abs() < 1e-6, "so does the longest answer");
    assert_eq!(data["events"][0]["word"], "puncture");
    let words: Vec<&str> = data["phases"].as_array().unwrap().iter().map(|p| p["word"].as_str().unwrap()).collect();
    assert_eq!(words, ["approach", "indentation", "penetration", "retraction", "approach"]);
    assert_eq!(floats(&data["targets"]["positions"]).len(), 6 * floats(&data["targets"]["time"]).len());
}

#[test]
fn the_sample_in_the_page_is_the_field_of_the_run() {
    let run = synthetic_run::needle(100.0);
    let data = embedded(&report::report_html(&run).unwrap());
    let view = &data["view"];
    let (points, time) = (floats(&view["points"]), floats(&view["time"]));
    let nodes = points.len() / 3;
    let vertices = nodes + floats(&view["edge_t"]).len();
    assert_eq!(time.len(), run.snapshots.len());
    for name in ["surface", "half", "cut"] {
        let triangles = floats(&view[name]);
        assert!(!triangles.is_empty() && triangles.len().is_multiple_of(3));
        assert!(triangles.iter().all(|&i| (i as usize) < vertices), "{name}");
    }
    let unit = view["displacement_unit"].as_f64().unwrap();
    let shown = floats(&view["displacement"]);
    let (low, step) = (view["jacobian_low"].as_f64().unwrap(), view["jacobian_unit"].as_f64().unwrap());
    let jacobian = floats(&view["jacobian"]);
    assert_eq!(shown.len(), 3 * nodes * time.len());
    for n in 0..nodes {
        let place = &points[3 * n..3 * n + 3];
        let near = |p: &[f64; 3]| (0..3).all(|c| (p[c] - place[c]).abs() < 1e-8);
        let i = run.final_state.points.iter().position(near).unwrap();
        for (f, snapshot) in run.snapshots.iter().enumerate() {
            for c in 0..3 {
                let error = unit * shown[3 * (nodes * f + n) + c] - snapshot.displacement[i][c];
                assert!(error.abs() < 0.51 * unit, "node {i}, moment {f}");
            }
            assert!((low + step * jacobian[nodes * f + n] - snapshot.jacobian[i]).abs() < 0.51 * step);
        }
    }
}

#[test]
fn moments_that_are_not_finite_are_left_out() {
    let data = embedded(&report::report_html(&broken()).unwrap());
    assert_eq!(floats(&data["view"]["time"]).len(), broken().snapshots.len() - 2);
    assert_eq!(data["targets"]["names"][0], "vessel, \"left\" </script>");
}

#[test]
fn a_run_without_snapshots_or_mesh_still_has_a_page() {
    let mut run = synthetic_run::needle(10.0);
    run.snapshots.clear();
    run.final_state.jacobian.clear();
    let data = embedded(&report::report_html(&run).unwrap());
    assert_eq!(floats(&data["view"]["time"]).len(), 1, "the end of the run");
    assert!(data["view"]["jacobian"].is_null());
    let html = report::report_html(&Run::default()).unwrap();
    assert!(embedded(&html)["view"].is_null() && !html.contains("<canvas"));
    assert!(html.contains("No pose was answered"));
}

#[test]
fn the_page_loads_nothing_and_stays_small() {
    // As many poses as a minute at 1 kHz, and a sample of 38,000 nodes.
    let mut run = synthetic_run::needle(3000.0);
    let (points, cells) = synthetic_run::cylinder(20, 60, 30);
    run.final_state.surface = synthetic_run::surface(&cells, &points);
    for snapshot in &mut run.snapshots {
        snapshot.displacement = points.iter().map(|p| [0.0, 0.0, -0.1 * p[2]]).collect();
        snapshot.jacobian = vec![0.9; points.len()];
    }
    run.final_state.displacement = run.snapshots[0].displacement.clone();
    run.final_state.jacobian.clear();
    run.final_state.von_mises_pa.clear();
    (run.final_state.points, run.final_state.cells) = (points, cells);
    for run in [run, broken()] {
        let html = report::report_html(&run).unwrap();
        assert!(html.len() < 5_000_000, "{} bytes", html.len());
        let outside = html.replace("http://www.w3.org/2000/svg", "");
        for word in ["http://", "https://", " src=", "@import", "url(", "fetch(", "XMLHttpRequest", "import("] {
            assert!(!outside.contains(word), "the page holds {word}");
        }
        assert!(html.contains("default-src 'none'") && html.contains("prefers-color-scheme: dark"));
        assert!(html.contains("width=device-width"));
        assert_eq!(html.matches("</script>").count(), 2, "no text of the run closes a script");
        assert!(!html.contains("<script>alert"));
        assert_eq!(html.matches("{{").count(), 0, "every placeholder is filled");
    }
}
