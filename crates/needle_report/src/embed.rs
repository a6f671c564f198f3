//! The run in the format of the report's script: JSON whose arrays are base64 of little-endian numbers.
//!
//! The size is bounded: curves are thinned, the field is stored in 16-bit steps at as many times as fit, and a sample
//! that is too large for a page is left out.

use super::{
    ReportError,
    phases::{self, Stretch},
    regions,
    section::{Plane, Section},
    strain::{Strains, moduli_pa},
    thin::thin,
    unit::Scale,
};
use base64::{Engine as _, engine::general_purpose::STANDARD};
use needle_core::scene::{Instrument, InstrumentKind};
use needle_core::twin::Event;
use needle_estimate::compare::{Answer, Pass, Run, Snapshot, TargetRow};
use serde_json::{Value, json};

/// Name of the page, for errors.
const FILE: &str = "report.html";
/// Number of time buckets for which the curves keep the extremes.
const BUCKETS: usize = 500;
/// Bytes of the field before base64; the whole page stays under 5 MB with it.
const FIELD_BYTES: usize = 2_400_000;
/// Bytes of the mesh before base64.
const MESH_BYTES: usize = 900_000;
/// Steps of a 16-bit number on either side of zero.
const STEPS: f64 = 32_767.0;

/// The data of a report.
///
/// # Errors
/// [`ReportError::Length`] or [`ReportError::Index`] if fields and cells don't fit the points.
pub(super) fn data(run: &Run) -> Result<Value, ReportError> {
    let kept = thin(run, BUCKETS);
    let answers: Vec<&Answer> = kept.iter().map(|&i| &run.answers[i]).collect();
    let force = Scale::of_force(run);
    Ok(json!({
        "force": { "factor": force.factor, "unit": force.unit },
        "rows": rows(&answers),
        "band": band(run, &kept),
        "passes": passes(run, &kept),
        "phases": bands(&phases::over_time(run)),
        "depth_phases": bands(&phases::over_depth(run)),
        "depth_regions": depth_regions(run),
        "hold": hold(run),
        "events": events(run),
        "period_ms": period_ms(run),
        "targets": targets(run),
        "view": view(run)?,
    }))
}

/// Numbers that go into the page as base64.
trait Packed: Copy {
    const TYPE: &'static str;
    fn push(self, bytes: &mut Vec<u8>);
}

macro_rules! packed {
    ($($number:ty => $name:literal),*) => {$(
        impl Packed for $number {
            const TYPE: &'static str = $name;
            fn push(self, bytes: &mut Vec<u8>) {
                bytes.extend_from_slice(&self.to_le_bytes());
            }
        }
    )*};
}

packed!(f32 => "f32", i16 => "i16", u16 => "u16", u32 => "u32", u8 => "u8");

fn pack<T: Packed>(values: impl IntoIterator<Item = T>) -> Value {
    let mut bytes = Vec::new();
    values.into_iter().for_each(|v| v.push(&mut bytes));
    json!({ "type": T::TYPE, "base64": STANDARD.encode(bytes) })
}

/// 64-bit numbers as 32-bit ones. Numbers that are not finite become 0; the caller masks them or leaves them out.
fn pack_f32(values: impl IntoIterator<Item = f64>) -> Value {
    pack(values.into_iter().map(|v| v as f32).map(|v| if v.is_finite() { v } else { 0.0 }))
}

fn rows(answers: &[&Answer]) -> Value {
    let has: Vec<bool> = answers.iter().map(|a| a.residual_n().is_some()).collect();
    let measured = || pack_f32(answers.iter().map(|a| a.measured_n.unwrap_or(0.0)));
    json!({
        "time": pack_f32(answers.iter().map(|a| a.time_s)),
        "depth": pack_f32(answers.iter().map(|a| a.depth_m)),
        "predicted": pack_f32(answers.iter().map(|a| a.predicted_n)),
        "measured": has.contains(&true).then(measured),
        "has_measured": has.contains(&false).then(|| pack(has.iter().map(|&h| u8::from(h)))),
        "steps": pack(answers.iter().map(|a| a.steps)),
        "latency": pack_f32(answers.iter().map(|a| 1e3 * a.latency_s)),
    })
}

/// Insertions and retractions among the drawn answers. Each begins with the last answer of the one before, so that
/// curves have no gap.
fn passes(run: &Run, kept: &[usize]) -> Value {
    let at = |answer: usize| kept.partition_point(|&i| i < answer);
    let one = |pass: &Pass| json!({ "from": at(pass.range.start).saturating_sub(1), "to": at(pass.range.end), "back": pass.back, "number": pass.number });
    run.passes().iter().filter(|pass| at(pass.range.start) < at(pass.range.end)).map(one).collect()
}

/// Ends of the band about the force at the drawn answers, and what it is.
fn band(run: &Run, kept: &[usize]) -> Value {
    let all: Vec<_> = kept.iter().map(|&i| run.shown_band(i)).collect();
    let end = |which: usize| pack_f32(all.iter().map(|band| band.map_or(0.0, |ends| ends[which])));
    json!({
        "name": run.band_name(),
        "low": end(0),
        "high": end(1),
        "mask": pack(all.iter().map(|band| u8::from(band.is_some()))),
    })
}

fn bands(stretches: &[Stretch]) -> Value {
    stretches.iter().map(|s| json!({ "word": s.word, "from": s.from, "to": s.to })).collect()
}

/// Regions over the depth, with their pale colours in CSS format.
fn depth_regions(run: &Run) -> Value {
    let colour = |[r, g, b]: [u8; 3]| format!("rgb({r},{g},{b})");
    let depths = run.regions_over_depth();
    let stretches = depths
        .iter()
        .map(|s| json!({ "name": s.name, "from": s.from, "to": s.to, "colour": colour(regions::colour(s.region)) }));
    stretches.collect()
}

/// Depth and time at the deepest point, if the run holds there.
fn hold(run: &Run) -> Option<Value> {
    run.hold().map(|(depth_m, duration_s)| json!({ "depth": depth_m, "duration": duration_s }))
}

fn events(run: &Run) -> Value {
    let event = |a: &Answer| match a.event {
        Some(Event::Puncture { depth_m, .. }) if a.time_s.is_finite() && depth_m.is_finite() => {
            Some(json!({ "word": "puncture", "time": a.time_s, "depth": depth_m }))
        }
        _ => None,
    };
    run.answers.iter().filter_map(event).collect()
}

/// Median time between poses: the time limit of an answer for real-time operation.
fn period_ms(run: &Run) -> Option<f64> {
    let mut gaps: Vec<f64> = run.answers.windows(2).map(|w| 1e3 * (w[1].time_s - w[0].time_s)).collect();
    gaps.retain(|g| g.is_finite() && *g > 0.0);
    gaps.sort_unstable_by(f64::total_cmp);
    gaps.get(gaps.len() / 2).copied()
}

fn targets(run: &Run) -> Option<Value> {
    let names = &run.target_names;
    let usable = |t: &&TargetRow| {
        t.time_s.is_finite() && t.positions.len() == names.len() && t.positions.iter().flatten().all(|c| c.is_finite())
    };
    let all: Vec<_> = run.targets.iter().filter(usable).collect();
    let kept = evenly(&all, 1000);
    (!names.is_empty() && !kept.is_empty()).then(|| {
        json!({
            "names": names,
            "time": pack_f32(kept.iter().map(|t| t.time_s)),
            "positions": pack_f32(kept.iter().flat_map(|t| t.positions.iter().flatten().copied())),
        })
    })
}

/// The sample for the 3D view; `None` without a mesh, or if it is too large for a page.
fn view(run: &Run) -> Result<Option<Value>, ReportError> {
    let state = &run.final_state;
    let points = state.points.len();
    let indices = || state.cells.iter().flatten().chain(state.surface.iter().flatten());
    if let Some(&index) = indices().find(|&&i| i as usize >= points) {
        return Err(ReportError::Index { file: FILE, index, points });
    }
    let last = Snapshot {
        time_s: run.answers.last().map_or(0.0, |a| a.time_s),
        depth_m: run.answers.last().map_or(0.0, |a| a.depth_m),
        displacement: state.displacement.clone(),
        jacobian: state.jacobian.clone(),
        needle: Vec::new(),
    };
    let moments = if run.snapshots.is_empty() { std::slice::from_ref(&last) } else { &run.snapshots };
    for snapshot in moments {
        fits("snapshots.displacement", snapshot.displacement.len(), points)?;
        if !snapshot.jacobian.is_empty() {
            fits("snapshots.jacobian", snapshot.jacobian.len(), points)?;
        }
    }
    if state.surface.is_empty() || !state.points.iter().flatten().all(|c| c.is_finite()) {
        return Ok(None);
    }
    let plane = Plane::of(run.instrument.as_ref());
    let section = Section::new(&state.points, &state.cells, &state.surface, &plane);
    let triangles = section.surface.len() + section.half.len() + section.cut.len();
    let finite = |s: &&Snapshot| {
        let numbers = s.displacement.iter().flatten().chain(&s.jacobian);
        s.time_s.is_finite() && s.depth_m.is_finite() && numbers.copied().all(f64::is_finite)
    };
    let usable: Vec<&Snapshot> = moments.iter().filter(finite).collect();
    let too_large = 12 * (section.nodes.len() + section.on_edges.len() + triangles) > MESH_BYTES;
    if usable.is_empty() || too_large {
        return Ok(None);
    }
    let most = (FIELD_BYTES / (10 * section.nodes.len())).max(1);
    let shown = evenly(&usable, most);
    let mut view = json!({
        "points": pack_f32(section.nodes.iter().flat_map(|&i| state.points[i as usize])),
        "edge_a": pack(section.on_edges.iter().map(|e| e.a)),
        "edge_b": pack(section.on_edges.iter().map(|e| e.b)),
        "edge_t": pack_f32(section.on_edges.iter().map(|e| e.t)),
        "surface": pack(section.surface.iter().copied().flatten()),
        "half": pack(section.half.iter().copied().flatten()),
        "cut": pack(section.cut.iter().copied().flatten()),
        "time": pack_f32(shown.iter().map(|s| s.time_s)),
        "depth": pack_f32(shown.iter().map(|s| s.depth_m)),
        "azimuth": plane.azimuth,
        "instrument": run.instrument.as_ref().map(|i| instrument(i, &state.points)),
    });
    let places = shown[0].needle.len();
    if places > 1 && shown.iter().all(|s| s.needle.len() == places) {
        view["needle"] = pack_f32(shown.iter().flat_map(|s| s.needle.iter().flatten().copied()));
    }
    region_of_triangles(&mut view, &section, run);
    displacement(&mut view, &section, &shown);
    jacobian(&mut view, &section, &shown);
    strains(&mut view, &section, &shown, run);
    Ok(Some(view))
}

fn fits(field: &'static str, found: usize, expected: usize) -> Result<(), ReportError> {
    if found == expected { Ok(()) } else { Err(ReportError::Length { file: FILE, field, found, expected }) }
}

/// At most `most` of the items, evenly spaced, including the first and the last.
fn evenly<'a, T>(items: &[&'a T], most: usize) -> Vec<&'a T> {
    let (n, most) = (items.len(), most.min(items.len()));
    if most < 2 {
        return items.last().copied().into_iter().collect();
    }
    (0..most).map(|k| items[k * (n - 1) / (most - 1)]).collect()
}

/// Region of each triangle, with names and colours; nothing if the scene has no regions.
fn region_of_triangles(view: &mut Value, section: &Section, run: &Run) {
    let region = &run.final_state.region;
    if region.is_empty() {
        return;
    }
    let of = |cells: &Vec<u32>| pack(cells.iter().map(|&c| region.get(c as usize).copied().unwrap_or(0)));
    let [surface, half, cut] = &section.cell;
    view["region"] = json!({ "surface": of(surface), "half": of(half), "cut": of(cut) });
    let named = (0..).zip(run.along.names()).map(|(i, name)| json!({ "name": name, "colour": regions::colour(i) }));
    view["regions"] = named.collect();
}

/// Displacement in steps of `displacement_unit`, for each time.
fn displacement(view: &mut Value, section: &Section, shown: &[&Snapshot]) {
    let values = || shown.iter().flat_map(|s| section.nodes.iter().map(|&i| s.displacement[i as usize]));
    let largest = values().flatten().map(f64::abs).fold(0.0, f64::max);
    let unit = if largest > 0.0 { largest / STEPS } else { 1.0 };
    let length = |u: [f64; 3]| u.iter().map(|c| c * c).sum::<f64>().sqrt();
    view["displacement_unit"] = json!(unit);
    view["displacement_max"] = json!(values().map(length).fold(0.0, f64::max));
    view["displacement"] = pack(values().flatten().map(|c| (c / unit).round() as i16));
}

/// Volume ratio in steps of `jacobian_unit` above `jacobian_low`; left out if it is missing at any time.
fn jacobian(view: &mut Value, section: &Section, shown: &[&Snapshot]) {
    if shown.iter().any(|s| s.jacobian.is_empty()) {
        return;
    }
    let values = || shown.iter().flat_map(|s| section.nodes.iter().map(|&i| s.jacobian[i as usize]));
    let (low, high) = values().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), j| (l.min(j), h.max(j)));
    let unit = if high > low { (high - low) / (2.0 * STEPS) } else { 1.0 };
    let mut spans: Vec<f64> = values().map(|j| (j - 1.0).abs()).collect();
    spans.sort_unstable_by(f64::total_cmp);
    // Some crushed cells at the tip must not determine the colour scale of the whole sample.
    let span = spans.get(spans.len() * 199 / 200).copied().unwrap_or(0.0).max(1e-4);
    view["jacobian_low"] = json!(low);
    view["jacobian_unit"] = json!(unit);
    view["jacobian_span"] = json!(span);
    view["jacobian"] = pack(values().map(|j| ((j - low) / unit).round() as u16));
}

/// Strain and von Mises stress in 255 steps from 0 to the value that all but two per cent of the points stay below.
/// At the needle, where points are dense, the strain of a few is unbounded.
fn strains(view: &mut Value, section: &Section, shown: &[&Snapshot], run: &Run) {
    let state = &run.final_state;
    let strains = Strains::new(&state.points, &state.cells, &state.region, moduli_pa(&run.scene_toml).as_deref());
    let mut fields: [Vec<f64>; 2] = Default::default();
    for snapshot in shown {
        for (field, values) in fields.iter_mut().zip(strains.at(&snapshot.displacement)) {
            field.extend(section.nodes.iter().filter_map(|&i| values.get(i as usize)));
        }
    }
    for (name, field) in ["strain", "stress"].iter().zip(fields) {
        let mut sorted: Vec<f64> = field.iter().copied().filter(|v| v.is_finite()).collect();
        sorted.sort_unstable_by(f64::total_cmp);
        let Some(most) = sorted.get(sorted.len() * 49 / 50).filter(|most| **most > 0.0) else { continue };
        view[format!("{name}_max")] = json!(most);
        view[format!("{name}_unit")] = json!(most / 255.0);
        view[*name] =
            pack(field.iter().map(|v| if v.is_finite() { (255.0 * v / most).min(255.0).round() as u8 } else { 0 }));
    }
}

fn instrument(instrument: &Instrument, points: &[[f64; 3]]) -> Value {
    let across = || points.iter().map(|p| p[0].hypot(p[1])).fold(0.0, f64::max);
    let (kind, radius) = match instrument.kind {
        InstrumentKind::Plate => ("plate", across()),
        InstrumentKind::Indenter { diameter, .. } => ("indenter", 0.5 * diameter.get()),
        InstrumentKind::Needle(needle) => ("needle", 0.5 * needle.diameter.get()),
    };
    let [x, y] = instrument.slope();
    let cosine = 1.0 / (1.0 + x * x + y * y).sqrt();
    json!({
        "kind": kind, "radius": radius, "x": instrument.entry[0].get(), "y": instrument.entry[1].get(),
        "axis": [x * cosine, y * cosine, -cosine],
    })
}
