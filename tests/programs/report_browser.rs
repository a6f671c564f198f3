//! `report.html` and `accuracy.html` in a browser: they draw without an error, and their controls do what they say.
//!
//! Needs Chromium or Chrome. Where there is none, the test says so and looks at what a page without a browser can show: its data
//! can be read, and every element that its script asks for is there. `NEEDLE_TWIN_BROWSER=1` makes a missing browser a failure.
#![allow(clippy::unwrap_used, clippy::panic)]

use crate::synthetic_run;
use needle_core::scene::Scene;
use needle_estimate::compare::Run;
use needle_report as report;
use needle_studies::accuracy::{Case, Extent, Row, plan};
use serde_json::Value;
use std::{fs, path::PathBuf, process::Command};

const NAMES: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "chrome"];

/// Runs before the page's own scripts: keeps every error, and lets a timer stand in for the frames of a display,
/// which come too rarely where there is none.
const BEFORE: &str = "<script>window.errors = [];
window.requestAnimationFrame = (f) => setTimeout(f, 16);
window.cancelAnimationFrame = clearTimeout;
addEventListener('error', (e) => errors.push(String(e.message)));
addEventListener('unhandledrejection', (e) => errors.push(String(e.reason)));
const consoleError = console.error;
console.error = (...a) => { errors.push(a.join(' ')); consoleError(...a); };</script>";

/// Runs after them: uses the controls as a reader would and notes what changed.
const AFTER: &str = r#"<script>(async () => {
  const seen = { errors };
  const paint = () => new Promise((done) => setTimeout(done, 120));
  const canvas = document.querySelector('canvas');
  const picture = () => {
    const data = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
    let hash = 0, drawn = 0;
    for (let i = 0; i < data.length; i += 4) {
      hash = (hash * 31 + data[i] + 7 * data[i + 1] + 13 * data[i + 2]) | 0;
      drawn += data[i + 3] > 200;
    }
    return { hash, part: drawn / (canvas.width * canvas.height) };
  };
  const control = (name) => document.querySelector(`[data-control=${name}]`);
  await paint();
  seen.paths = document.querySelectorAll('.chart path').length;
  seen.dotted = [...document.querySelectorAll('.chart path')].filter((e) => !e.getAttribute('d').includes('L')).length;
  seen.cut = [...document.querySelectorAll('.chart svg text')].filter((e) => e.getBBox().x < -0.5).map((e) => e.textContent);
  seen.broken = [...document.querySelectorAll('svg *')].filter((e) => /NaN|Infinity|undefined/.test(e.outerHTML)).length;
  seen.readouts = [...document.querySelectorAll('.readout')].map((e) => e.textContent);
  seen.overflow = document.documentElement.scrollWidth - innerWidth;
  if (canvas) {
    const slide = async (k) => {
      control('time').value = k;
      control('time').dispatchEvent(new Event('input', { bubbles: true }));
      await paint();
      return picture();
    };
    const choose = async (name, value) => {
      control(name).value = value;
      control(name).dispatchEvent(new Event('change', { bubbles: true }));
      await paint();
      return picture();
    };
    seen.moments = Number(control('time').max) + 1;
    seen.first = await slide(0);
    seen.deep = await slide(Math.round(seen.moments / 2));
    seen.label = document.querySelector('[data-show=moment]').textContent;
    seen.again = await slide(0);
    await slide(Math.round(seen.moments / 2));
    seen.whole = await choose('mode', 'whole');
    seen.ratio = await choose('field', 'jacobian');
    control('mesh').click(); await paint();
    seen.mesh = picture();
    const box = canvas.getBoundingClientRect();
    const pointer = (type, x, y) => canvas.dispatchEvent(new PointerEvent(type, { pointerId: 1, clientX: box.left + x, clientY: box.top + y, bubbles: true }));
    canvas.setPointerCapture = () => {};
    pointer('pointerdown', 100, 100); pointer('pointermove', 160, 120); pointer('pointerup', 160, 120); await paint();
    seen.turned = picture();
    control('in').click(); await paint();
    seen.zoomed = picture();
    const chart = document.querySelector('#force-time svg'), place = chart.getBoundingClientRect();
    chart.dispatchEvent(new PointerEvent('pointerdown', { clientX: place.left + 0.3 * place.width, clientY: place.top + 60, bubbles: true }));
    await paint();
    seen.clicked = document.querySelector('[data-show=moment]').textContent;
    seen.readout = document.querySelector('#force-time .readout').textContent;
  }
  const result = document.createElement('pre');
  result.id = 'seen';
  result.textContent = JSON.stringify(seen);
  document.body.append(result);
})();</script>"#;

fn browser() -> Option<PathBuf> {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let folders: Vec<PathBuf> = std::env::split_paths(&path).collect();
    let found = NAMES.iter().flat_map(|name| folders.iter().map(move |f| f.join(name))).find(|p| p.is_file());
    if found.is_none() {
        let names = NAMES.join(", ");
        assert!(
            std::env::var_os("NEEDLE_TWIN_BROWSER").is_none(),
            "no {names} on the path, and a browser is asked for"
        );
        eprintln!("no {names} on the path: the page's data and elements are looked at, its drawing is not");
    }
    found
}

/// What stands in `text` between each `before` and the next `after`.
fn between<'a>(text: &'a str, before: &'a str, after: &'a str) -> impl Iterator<Item = &'a str> {
    text.split(before).skip(1).filter_map(move |rest| rest.split_once(after).map(|(inner, _)| inner))
}

/// A page as far as it shows without a browser: its data is JSON of finite numbers, its pictures hold no broken number,
/// and its script finds each element that it asks for by name.
fn assert_whole(html: &str, name: &str) {
    let data = between(html, "<script type=\"application/json\" id=\"run\">", "</script>").next();
    let data: Value = serde_json::from_str(data.unwrap_or_else(|| panic!("{name}: no data"))).unwrap();
    assert!(!data.is_null(), "{name}");
    let script = between(html, "<script>", "</script>").collect::<String>();
    let static_part = html.replace(&script, "");
    for broken in ["NaN", "Infinity", "undefined"] {
        assert!(!static_part.contains(&format!("\"{broken}")), "{name}: {broken}");
    }
    let asked = |before: &'static str, after: &'static str| between(&script, before, after).map(str::to_owned);
    let ids = asked("getElementById('", "'").map(|id| format!("id=\"{id}\""));
    let shown = asked("[data-show=", "]").map(|what| format!("data-show=\"{what}\""));
    let controls = asked(" one('", "'").chain(asked(" control('", "'")).map(|what| format!("data-control=\"{what}\""));
    let mut asked: Vec<String> = ids.chain(shown).chain(controls).collect();
    asked.sort();
    asked.dedup();
    println!("{name}: {} elements asked for by name", asked.len());
    assert!(!asked.is_empty(), "{name}: the script asks for nothing");
    // what only some runs have is looked for and may be absent
    let optional = ["id=\"cost\"", "id=\"targets\"", "id=\"sample\""];
    for element in asked.iter().filter(|element| !optional.contains(&element.as_str())) {
        assert!(static_part.contains(element.as_str()), "{name}: the script asks for {element}, which is not there");
    }
}

/// What the browser saw of a run's page at a window width.
fn seen(browser: &PathBuf, run: &Run, width: u32) -> Value {
    used(browser, &report::report_html(run).unwrap(), AFTER, width)
}

/// What a script that uses a page's controls saw at a window width.
fn used(browser: &PathBuf, html: &str, after: &str, width: u32) -> Value {
    let folder = tempfile::tempdir().unwrap();
    let page = folder.path().join("page.html");
    let html =
        html.replacen("<style>", &format!("{BEFORE}<style>"), 1).replacen("</body>", &format!("{after}</body>"), 1);
    fs::write(&page, html).unwrap();
    let output = Command::new(browser)
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"])
        .args(["--disable-background-networking", "--disable-component-update", "--disable-sync"])
        .args(["--disable-dev-shm-usage", "--virtual-time-budget=20000", "--dump-dom"])
        .arg(format!("--window-size={width},900"))
        .arg(format!("--user-data-dir={}", folder.path().join("profile").display()))
        .arg(format!("file://{}", page.display()))
        .output()
        .unwrap();
    let dom = String::from_utf8_lossy(&output.stdout);
    let Some((_, found)) = dom.split_once("<pre id=\"seen\">") else {
        panic!("the page's test did not end: {}", String::from_utf8_lossy(&output.stderr))
    };
    let text = found.split_once("</pre>").unwrap().0.replace("&amp;", "&").replace("&lt;", "<").replace("&gt;", ">");
    serde_json::from_str(&text).unwrap()
}

#[test]
fn the_page_draws_and_its_controls_work() {
    let run = synthetic_run::needle(1000.0);
    assert_whole(&report::report_html(&run).unwrap(), "a run");
    let Some(browser) = browser() else { return };
    for width in [1280, 500] {
        let seen = seen(&browser, &run, width);
        assert_eq!(seen["errors"], serde_json::json!([]), "width {width}");
        assert!(seen["paths"].as_u64().unwrap() >= 11 && seen["broken"] == 0, "{seen:#}");
        assert!(seen["overflow"].as_i64().unwrap() <= 0, "the page is wider than the window: {seen:#}");
        assert!(seen["readouts"][0].as_str().unwrap().contains("57.4 mN"), "starts at the peak: {seen:#}");
        assert_eq!(seen["moments"], run.snapshots.len());
        let picture = |name: &str| (seen[name]["hash"].as_i64().unwrap(), seen[name]["part"].as_f64().unwrap());
        assert!(picture("first").1 > 0.1, "the sample fills some of the canvas: {seen:#}");
        assert_eq!(picture("first"), picture("again"), "the same moment looks the same");
        let order = ["first", "deep", "whole", "ratio", "mesh", "turned", "zoomed"];
        for pair in order.windows(2) {
            assert_ne!(picture(pair[0]).0, picture(pair[1]).0, "{} looks like {}", pair[1], pair[0]);
        }
        assert!(picture("zoomed").1 > picture("turned").1);
        assert_ne!(seen["clicked"], seen["label"], "a click in the curves moves the sample: {seen:#}");
        let time = seen["readout"].as_str().unwrap().split(' ').next().unwrap().parse::<f64>().unwrap();
        assert!((4.4..6.7).contains(&time), "30 % of the width, axis labels off it, is 20 to 30 % of 22.3 s: {time}");
    }
}

#[test]
fn a_page_of_little_or_broken_data_draws_too() {
    let browser = browser();
    let mut unmeasured = synthetic_run::needle(20.0);
    unmeasured.answers.iter_mut().for_each(|a| (a.measured_n, a.event) = (None, None));
    unmeasured.targets.clear();
    unmeasured.snapshots.clear();
    let mut one = synthetic_run::needle(20.0);
    one.answers.truncate(1);
    let mut gaps = synthetic_run::needle(20.0);
    gaps.answers.iter_mut().step_by(3).for_each(|a| a.measured_n = None);
    gaps.answers.iter_mut().step_by(5).for_each(|a| a.predicted_n = f64::NAN);
    let mut still = synthetic_run::needle(20.0);
    still.answers.iter_mut().for_each(|a| (a.depth_m, a.predicted_n, a.measured_n) = (0.0, 0.0, Some(0.0)));
    still.snapshots.iter_mut().for_each(|s| s.displacement.fill([0.0; 3]));
    still.snapshots.iter_mut().for_each(|s| s.jacobian.fill(1.0));
    for (name, run) in
        [("still", still), ("unmeasured", unmeasured), ("one", one), ("gaps", gaps), ("empty", Run::default())]
    {
        // without snapshots there is no sample to be shown, and so no control of it
        if !run.snapshots.is_empty() {
            assert_whole(&report::report_html(&run).unwrap(), name);
        }
        let Some(browser) = &browser else { continue };
        let seen = seen(browser, &run, 1280);
        assert_eq!(seen["errors"], serde_json::json!([]), "{name}");
        assert_eq!(seen["broken"], 0, "{name}: {seen:#}");
    }
}

/// Uses the page of a study: hovers, clicks, filters, and goes to another scene.
const STUDY: &str = r#"<script>(async () => {
  const seen = { errors };
  const paint = () => new Promise((done) => setTimeout(done, 120));
  const marks = () => document.querySelectorAll('#cost .point').length;
  const text = () => document.querySelector('#cost .readout').textContent;
  const at = (type, mark, dx) => {
    const box = mark.getBoundingClientRect();
    const place = { clientX: box.left + box.width / 2 + dx, clientY: box.top + box.height / 2, bubbles: true };
    document.querySelector('#cost svg').dispatchEvent(new PointerEvent(type, place));
  };
  const choose = async (name, value) => {
    const control = document.querySelector(`[data-control=${name}]`);
    control.value = value;
    control.dispatchEvent(new Event('change', { bubbles: true }));
    await paint();
  };
  await paint();
  seen.marks = marks();
  seen.idle = text();
  const first = document.querySelector('#cost .point');
  at('pointermove', first, 2);
  seen.hovered = text();
  seen.on = document.querySelectorAll('#cost .point.on').length;
  at('pointermove', first, -5000);
  seen.left = text();
  at('pointerdown', first, 1); at('pointermove', first, -5000);
  seen.pinned = text();
  document.querySelector('[data-filter="method=tet4"]').click(); await paint();
  seen.without = marks();
  seen.pressed = document.querySelector('[data-filter="method=tet4"]').getAttribute('aria-pressed');
  document.querySelector('[data-filter="method=tet4"]').click(); await paint();
  seen.again = marks();
  const names = [...document.querySelectorAll('#cost text.name')].map((e) => e.getBoundingClientRect());
  const points = [...document.querySelectorAll('#cost .point')].map((e) => e.getBoundingClientRect());
  const over = (a, b) => a.left < b.right - 1 && b.left < a.right - 1 && a.top < b.bottom - 1 && b.top < a.bottom - 1;
  seen.names = names.length;
  seen.collisions = names.filter((a, i) => names.slice(0, i).some((b) => over(a, b)) || points.some((b) => over(a, b))).length;
  seen.limits = [...document.querySelectorAll('#cost text')].filter((e) => /^real time/.test(e.textContent)).map((e) => e.textContent);
  seen.fronts = document.querySelectorAll('#cost .front').length;
  seen.best = document.querySelectorAll('#best tbody tr').length;
  seen.broken = [...document.querySelectorAll('svg *')].filter((e) => /NaN|Infinity|undefined/.test(e.outerHTML)).length;
  seen.overflow = document.documentElement.scrollWidth - innerWidth;
  await choose('x', 'second');
  seen.second = document.querySelector('#cost svg').getAttribute('aria-label');
  await choose('y', 'moved');
  seen.moved = marks();
  await choose('scene', '1');
  seen.other = marks();
  const result = document.createElement('pre');
  result.id = 'seen';
  result.textContent = JSON.stringify(seen);
  document.body.append(result);
})();</script>"#;

/// Rows of a preset as a study might find them; one run ended early, and every third says nothing of displacements.
fn rows(preset: &str) -> Vec<Row> {
    let scene = Scene::preset(preset).unwrap();
    let row = |(i, case): (usize, Case)| {
        let error = 0.3 / (1.0 + i as f64).powf(0.8) * (1.0 + 0.5 * (i as f64).sin());
        Row {
            scene: scene.name.clone(),
            nodes: 100 + i,
            integration_points: 500 + i,
            simulated_s: 2.5,
            poses: 250,
            steps: 1000,
            cost_s: 0.002 * 1.08_f64.powi(i as i32),
            force_error: vec![(0.0005, 0.5 * error), (0.0025, error)],
            displacement_error: (i % 3 > 0).then_some(0.1 * error),
            way_error: None,
            min_jacobian: 0.6,
            recoveries: 0,
            ended: (i == 5).then(|| "at 2 mm: diverged".to_owned()),
            case,
        }
    };
    plan(&scene, Extent::Full).unwrap().into_iter().enumerate().map(row).collect()
}

#[test]
fn the_page_of_a_study_draws_and_its_controls_work() {
    let (first, second) = (rows("compression"), rows("indentation"));
    let folder = tempfile::tempdir().unwrap();
    report::write_accuracy(folder.path(), &[first.clone(), second.clone()].concat()).unwrap();
    let html = fs::read_to_string(folder.path().join("accuracy.html")).unwrap();
    assert!(!html.contains("src=\"http") && !html.contains("@import"), "nothing is loaded");
    assert_whole(&html, "a study");
    let Some(browser) = browser() else { return };
    for width in [1280, 500] {
        let seen = used(&browser, &html, STUDY, width);
        let count = |name: &str| seen[name].as_u64().unwrap() as usize;
        let text = |name: &str| seen[name].as_str().unwrap().to_owned();
        assert_eq!(seen["errors"], serde_json::json!([]), "width {width}");
        assert_eq!((count("marks"), count("again")), (first.len() - 1, first.len() - 1), "{seen:#}");
        assert!(text("idle").contains("Hover") && text("left") == text("idle"), "{seen:#}");
        assert!(text("hovered").contains("nodes") && text("hovered").contains("ms per pose"), "{seen:#}");
        assert_eq!((count("on"), text("pinned")), (1, text("hovered")), "a click keeps the row: {seen:#}");
        let tetrahedra = first.iter().filter(|r| r.case.method == "tet4" && r.ended.is_none()).count();
        assert_eq!((count("without"), text("pressed")), (first.len() - 1 - tetrahedra, "false".to_owned()), "{seen:#}");
        assert_eq!(seen["limits"], serde_json::json!(["real time at 100 Hz", "real time at 1 kHz"]));
        // how many have room depends on the window and its fonts
        assert!(count("names") >= 1 && seen["collisions"] == 0, "width {width}: {seen:#}");
        assert_eq!((count("fronts"), count("broken")), (2, 0), "{seen:#}");
        assert!(count("best") > 5 && text("second").contains("simulated second"), "{seen:#}");
        let moved = first.iter().filter(|r| r.displacement_error.is_some()).count();
        assert!(count("moved") <= moved && count("moved") + 1 >= moved, "{seen:#}");
        let others = second.iter().filter(|r| r.displacement_error.is_some()).count();
        assert!(count("other") <= others && count("other") + 1 >= others, "{seen:#}");
        assert!(seen["overflow"].as_i64().unwrap() <= 0, "the page is wider than the window: {seen:#}");
    }
}
