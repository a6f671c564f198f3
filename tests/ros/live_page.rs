//! The live page of a running twin: seen by a viewer that is no browser, and in a real one.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::net::TcpStream;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tungstenite::{Message, WebSocket};

use crate::chromium::Browser;
use crate::ros::{Peer, Program, TWIN, coarse_twin, free_domain};

/// The page's address with its token, from the node's log file.
pub fn address(logs: &tempfile::TempDir) -> String {
    let begun = Instant::now();
    loop {
        for file in std::fs::read_dir(logs.path()).unwrap().flatten() {
            let text = std::fs::read_to_string(file.path()).unwrap_or_default();
            if let Some((_, rest)) = text.split_once("live page: ") {
                return rest.split(' ').next().unwrap().to_owned();
            }
        }
        assert!(begun.elapsed() < Duration::from_secs(60), "the node says where its page is");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// A coarse twin with a page at a free port, and a peer that is connected with it.
fn twin() -> (Program, Peer, String) {
    let (domain, logs) = (free_domain(), tempfile::tempdir().unwrap());
    // on a busy machine poses may pause for longer than the default, and then the health is another
    let more = ["-p", "page:=true", "-p", "page_port:=0", "-p", "input_timeout_s:=60.0"];
    let node = coarse_twin(domain, &more, &[("ROS_LOG_DIR", logs.path().to_str().unwrap())]);
    let address = address(&logs);
    let mut peer = Peer::start(domain);
    peer.connect();
    (node, peer, address)
}

pub fn view(address: &str) -> WebSocket<TcpStream> {
    let host = address.trim_start_matches("http://").split('/').next().unwrap();
    let stream = TcpStream::connect(host).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    tungstenite::client(format!("ws://{host}/stream"), stream).unwrap().0
}

fn say(viewer: &mut WebSocket<TcpStream>, request: &Value) {
    viewer.send(Message::text(request.to_string())).unwrap();
}

/// Asks until a message of a kind fits.
pub fn until(viewer: &mut WebSocket<TcpStream>, kind: &str, fits: impl Fn(&Value) -> bool) -> Value {
    let begun = Instant::now();
    let mut last = Value::Null;
    while begun.elapsed() < Duration::from_secs(60) {
        say(viewer, &json!({ "ask": "next" }));
        if let Message::Text(text) = viewer.read().unwrap() {
            let value: Value = serde_json::from_str(&text).unwrap();
            if value["kind"] == kind {
                if fits(&value) {
                    return value;
                }
                last = value;
            }
        }
    }
    panic!("no {kind} that fits; the last was {last}");
}

/// Down to `depth_m` in poses of 0.1 ms, from stamp `from` s on.
fn press(peer: &mut Peer, from: i64, depth_m: f64, poses: i64) -> Vec<Option<f64>> {
    let poses: Vec<(i64, f64)> =
        (0..poses).map(|k| (from * 1_000_000_000 + k * 10_000_000, depth_m * k as f64 / (poses - 1) as f64)).collect();
    peer.steps(&poses)
}

#[test]
fn a_viewer_sees_the_twin_and_commands_it_with_the_token() {
    let (node, mut peer, address) = twin();
    let token = address.split_once("#token=").unwrap().1;
    let mut viewer = view(&address);
    let forces = press(&mut peer, 100, 0.001, 20);
    let last = forces.last().unwrap().unwrap();
    let figures = until(&mut viewer, "figures", |f| f["point"]["depth_m"].as_f64().is_some_and(|d| d > 0.00099));
    let shown = figures["point"]["predicted_n"].as_f64().unwrap();
    assert!((shown - last).abs() < 1e-9 * last, "{shown} N is shown, {last} N was published");
    assert_eq!(figures["point"]["phase"], "indentation");
    let status = until(&mut viewer, "status", |s| s["poses_answered"] == 20);
    assert_eq!(status["health"], 0, "{status}");

    say(&mut viewer, &json!({ "ask": "tare", "token": token }));
    let refused = until(&mut viewer, "reply", |_| true);
    assert!(
        refused["done"] == false && refused["message"].as_str().unwrap().contains("inside the sample"),
        "{refused}"
    );
    // outside of the tissue, with a load cell that reads 0.5 N, it is done, and what is measured after that is nothing
    peer.ask(json!({"op": "advertise", "topic": "/measured_cf", "type": "geometry_msgs/msg/WrenchStamped"}));
    assert_eq!(peer.ask(json!({"op": "wait_matched", "topics": ["/measured_cf"]}))["missing"], json!([]));
    let load = |peer: &mut Peer, from: i64| {
        let poses: Vec<(i64, f64)> = (0..10).map(|k| (from * 1_000_000_000 + k * 20_000_000, 0.0)).collect();
        // a cell that never changes is taken for stuck
        let wrenches: Vec<[f64; 3]> = (0..10).map(|k| [0.0, 0.0, 0.5 + 1e-6 * f64::from(k)]).collect();
        peer.ask(json!({
            "op": "steps", "topic": "/measured_js", "joint": "insertion", "poses": poses, "answers": "/predicted_cf",
            "wrench_topic": "/measured_cf", "wrenches": wrenches,
        }));
    };
    load(&mut peer, 101);
    until(&mut viewer, "figures", |f| f["point"]["measured_n"].as_f64().is_some_and(|n| (n - 0.5).abs() < 1e-4));
    say(&mut viewer, &json!({ "ask": "tare", "token": token }));
    let tared = until(&mut viewer, "reply", |_| true);
    assert_eq!(tared["done"], true, "{tared}");
    load(&mut peer, 102);
    until(&mut viewer, "figures", |f| f["point"]["measured_n"].as_f64().is_some_and(|n| n.abs() < 1e-4));
    say(&mut viewer, &json!({ "ask": "mark", "token": token, "text": "here" }));
    assert_eq!(until(&mut viewer, "reply", |_| true)["done"], true);
    let marked = until(&mut viewer, "figures", |f| f["events"][0]["kind"] == "mark");
    assert_eq!(marked["events"][0]["text"], "here");
    say(&mut viewer, &json!({ "ask": "reset", "token": "wrong" }));
    assert_eq!(until(&mut viewer, "reply", |_| true)["done"], false);
    say(&mut viewer, &json!({ "ask": "reset", "token": token }));
    assert_eq!(until(&mut viewer, "reply", |_| true)["done"], true);
    until(&mut viewer, "figures", |f| f["point"].is_null());
    let (code, log, _) = node.stop("INT");
    assert_eq!(code, Some(0), "{log}");
    assert!(log.contains("mark at depth 0.000000 m") && !log.contains("page_address"), "{log}");
}

#[test]
fn an_address_of_a_network_is_warned_of_and_a_port_that_is_taken_ends_the_node() {
    let domain = free_domain();
    let node = coarse_twin(domain, &["-p", "page:=true", "-p", "page_port:=0", "-p", "page_address:=0.0.0.0"], &[]);
    let mut peer = Peer::start(domain);
    peer.connect();
    let (code, log, _) = node.stop("INT");
    assert!(code == Some(0) && log.contains("whoever reaches this machine can watch"), "{log}");
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = format!("page_port:={}", taken.local_addr().unwrap().port());
    let node = Program::start(TWIN, &["--ros-args", "-p", "page:=true", "-p", &port], free_domain(), &[]);
    let (code, log) = node.ended();
    assert!(code == Some(1) && log.contains("page_port (0: any that is free)"), "{code:?} {log}");
}

/// Where pictures go, if somebody wants them.
fn picture(browser: &mut Browser, name: &str) {
    if let Some(folder) = std::env::var_os("NEEDLE_TWIN_PICTURES") {
        browser.picture(&PathBuf::from(folder).join(format!("{name}.png")));
    }
}

/// What the canvas looks like: a number, and the share of it that is drawn.
const CANVAS: &str = "(() => { const c = document.querySelector('canvas'), d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
    let hash = 0, drawn = 0; for (let i = 0; i < d.length; i += 4) { hash = (hash * 31 + d[i] + 7 * d[i + 1] + 13 * d[i + 2]) | 0; drawn += d[i + 3] > 200; }
    return [hash, drawn / (c.width * c.height)]; })()";

/// The canvas after it was painted again.
fn painted(browser: &mut Browser) -> (i64, f64) {
    browser.eval("new Promise((done) => setTimeout(done, 300))");
    let seen = browser.eval(CANVAS);
    (seen[0].as_i64().unwrap(), seen[1].as_f64().unwrap())
}

#[test]
fn in_a_browser_it_is_turned_and_cut_and_followed_to_the_end_of_a_run() {
    let Some(mut browser) = Browser::start() else { return };
    let (node, mut peer, address) = twin();
    browser.resize(1280, 1000, false);
    browser.open(&address);
    browser.wait("typeof state !== 'undefined' && state.sample", "the sample comes");
    press(&mut peer, 100, 0.002, 40);
    let shown = "document.querySelector('[data-show=depth]').textContent";
    browser.wait(&format!("{shown} === '2.00 mm'"), "the depth is followed");
    // a browser that was busy meanwhile has seen the newest point alone, and a curve needs two
    for (at, depth_m) in (101..).zip([0.00201, 0.00202, 0.00203]) {
        peer.steps(&[(at * 1_000_000_000, depth_m)]);
        browser.wait(&format!("{shown} === '{:.2} mm'", 1e3 * depth_m), "the depth is followed");
    }
    browser.wait("document.querySelectorAll('.chart path.predicted').length >= 2", "curves are drawn");
    let front = painted(&mut browser);
    assert!(front.1 > 0.1, "the sample fills some of the canvas: {front:?}");
    picture(&mut browser, "live");
    assert_eq!(
        browser.eval(
            "[...document.querySelectorAll('svg *')].filter((e) => /NaN|Infinity|undefined/.test(e.outerHTML)).length"
        ),
        0
    );

    // turned by pointer and by keyboard, cut elsewhere, whole
    let place = browser.eval("(() => { const b = document.querySelector('canvas').getBoundingClientRect(); return [b.left + 150, b.top + 150]; })()");
    let at = [place[0].as_f64().unwrap(), place[1].as_f64().unwrap()];
    browser.drag(at, [at[0] + 60.0, at[1] + 20.0]);
    let turned = painted(&mut browser);
    browser.eval("document.querySelector('canvas').focus()");
    browser.key("ArrowLeft", 37);
    let again = painted(&mut browser);
    browser.eval("document.querySelector('[data-control=at]').focus()");
    (0..10).for_each(|_| browser.key("ArrowRight", 39));
    let cut = painted(&mut browser);
    browser.eval("(() => { const s = document.querySelector('[data-control=plane]'); s.value = 'whole'; s.dispatchEvent(new Event('change')); })()");
    let whole = painted(&mut browser);
    for (before, after, what) in
        [(front, turned, "drag"), (turned, again, "key"), (again, cut, "cut"), (cut, whole, "whole")]
    {
        assert_ne!(before.0, after.0, "{what} changes the picture");
    }

    // commands by keyboard: every control is reached by Tab
    browser.eval("document.getElementById('text').focus()");
    browser.call("Input.insertText", json!({ "text": "seen <b>" }));
    browser.key("Enter", 13);
    browser
        .wait("document.getElementById('events').textContent.includes('mark seen <b>')", "the mark is shown as text");
    let order = browser
        .eval("[...document.querySelectorAll('button, select, input, canvas')].filter((e) => e.tabIndex >= 0).length");
    assert!(order.as_u64().unwrap() >= 12, "{order}");

    // a telephone
    browser.resize(390, 844, true);
    painted(&mut browser);
    assert!(
        browser.eval("document.documentElement.scrollWidth - innerWidth").as_i64().unwrap() <= 0,
        "wider than the window"
    );
    picture(&mut browser, "live_390");

    // motion reduced: the sample is drawn once a second
    let count = "state.n = 0; { const take = state.sample.frame_in; state.sample.frame_in = function (f) { state.n++; take.call(this, f); }; } 0";
    browser.eval(count);
    browser.call(
        "Emulation.setEmulatedMedia",
        json!({ "features": [{ "name": "prefers-reduced-motion", "value": "reduce" }] }),
    );
    let begun = Instant::now();
    for (from, depth_m) in [(200, 0.0021), (300, 0.0022), (400, 0.0023)] {
        press(&mut peer, from, depth_m, 60);
    }
    browser.wait(&format!("{shown} === '2.30 mm'"), "figures are followed");
    let drawn = browser.eval("state.n").as_f64().unwrap();
    assert!(drawn <= begun.elapsed().as_secs_f64() + 2.0, "{drawn} frames in {:?}", begun.elapsed());
    browser.call("Emulation.setEmulatedMedia", json!({ "features": [] }));

    // held by its reader, or frozen by the browser, the page costs the twin nothing and comes back to the newest
    browser.resize(1280, 1000, false);
    browser.eval("document.getElementById('freeze').click()");
    press(&mut peer, 500, 0.0025, 30);
    assert_eq!(browser.eval(shown), "2.30 mm");
    browser.eval("document.getElementById('freeze').click()");
    browser.wait(&format!("{shown} === '2.50 mm'"), "the newest");
    browser.call("Page.setWebLifecycleState", json!({ "state": "frozen" }));
    let forces = press(&mut peer, 600, 0.003, 60);
    assert!(forces.iter().all(Option::is_some), "the twin answers every pose: {forces:?}");
    browser.call("Page.setWebLifecycleState", json!({ "state": "active" }));
    browser.wait(&format!("{shown} === '3.00 mm'"), "the newest again");

    // the run ends, and the page says so
    let (code, log, _) = node.stop("INT");
    assert_eq!(code, Some(0), "{log}");
    browser.wait("document.getElementById('health').textContent.includes('The twin has ended')", "the end is said");
    let errors: Vec<_> = browser.errors.iter().filter(|e| !e.contains("WebSocket connection to")).collect();
    assert!(errors.is_empty(), "{errors:?}");
}

#[test]
fn in_a_browser_regions_are_cut_open_in_their_colours() {
    let Some(mut browser) = Browser::start() else { return };
    let (domain, logs) = (free_domain(), tempfile::tempdir().unwrap());
    let layer = "[materials.soft]\nmodel = \"neo_hookean\"\nshear_modulus_pa = 839.0\n[[regions]]\nname = \"fat\"\nmaterial = \"soft\"\n\
        shape = \"layer\"\nfrom_depth_m = 0.0\nto_depth_m = 0.006\n";
    let coarse = [("discretisation.spacing_m", "0.005"), ("discretisation.edge_refinement", "1.0")];
    let scene = logs.path().join("layered.toml");
    std::fs::write(&scene, testkit::coarse::scene("compression", &coarse).to_toml() + layer).unwrap();
    let more = ["--scene", scene.to_str().unwrap(), "--ros-args", "-p", "page:=true", "-p", "page_port:=0"];
    let node = Program::start(TWIN, &more, domain, &[("ROS_LOG_DIR", logs.path().to_str().unwrap())]);
    let address = address(&logs);
    browser.resize(1280, 1000, false);
    browser.open(&address);
    browser.wait("typeof state !== 'undefined' && state.sample", "the sample comes");
    browser.eval(
        "(() => { const s = document.querySelector('[data-control=field]'); s.value = 'region'; s.dispatchEvent(new Event('change')); })()",
    );
    let named = browser.eval("[...document.querySelectorAll('[data-show=regions] li')].map((e) => e.textContent)");
    assert_eq!(named, json!(["sample", "fat"]));
    // share of the picture in the orange of the first region, and in the grey of the rest: shades of one hue
    let hues = "(() => { const c = document.querySelector('canvas'), d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data; const n = [0, 0];
        for (let i = 0; i < d.length; i += 4) if (d[i + 3] > 200) n[+(d[i + 2] < 0.2 * d[i])]++; return n.map((k) => 4 * k / d.length); })()";
    for plane in ["front", "whole"] {
        browser.eval(&format!("(() => {{ const s = document.querySelector('[data-control=plane]'); s.value = '{plane}'; s.dispatchEvent(new Event('change')); }})()"));
        painted(&mut browser);
        let shares = browser.eval(hues);
        assert!((0..2).all(|k| shares[k].as_f64().unwrap() > 0.02), "{plane}: {shares}");
        picture(&mut browser, &format!("live_regions_{plane}"));
    }
    assert!(browser.errors.is_empty(), "{:?}", browser.errors);
    let (code, log, _) = node.stop("INT");
    assert_eq!(code, Some(0), "{log}");
}

/// Processor time of a node's threads by name, s.
#[cfg(target_os = "linux")]
fn threads(process: u32) -> std::collections::BTreeMap<String, f64> {
    let mut all = std::collections::BTreeMap::new();
    for task in std::fs::read_dir(format!("/proc/{process}/task")).unwrap().flatten() {
        let stat = std::fs::read_to_string(task.path().join("stat")).unwrap_or_default();
        let Some((head, rest)) = stat.rsplit_once(") ") else { continue };
        let ticks: f64 = rest.split(' ').skip(11).take(2).map(|t| t.parse::<f64>().unwrap()).sum();
        *all.entry(head.split_once('(').unwrap().1.to_owned()).or_insert(0.0) += ticks / 100.0;
    }
    all
}

/// A viewer that takes all that it can get, until it is told to stop; how many messages came.
#[cfg(target_os = "linux")]
fn greedy(address: &str, stop: &std::sync::Arc<std::sync::atomic::AtomicBool>) -> std::thread::JoinHandle<[u64; 2]> {
    let (mut viewer, stop) = (view(address), std::sync::Arc::clone(stop));
    std::thread::spawn(move || {
        let mut seen = [0, 0];
        say(&mut viewer, &json!({ "ask": "next" }));
        while !stop.load(std::sync::atomic::Ordering::Relaxed) {
            let message = viewer.read().unwrap();
            seen[usize::from(message.is_binary())] += 1;
            say(&mut viewer, &json!({ "ask": "next" }));
        }
        seen
    })
}

/// A study, not a test: what viewers cost, see docs/lab/closed_loop.md. Nothing and five viewers in turn, the needle bag each time.
#[cfg(target_os = "linux")]
#[test]
#[ignore = "three minutes, and a bound on times needs a machine of its own: .ci/long runs it"]
fn what_five_viewers_cost() {
    let (domain, logs) = (free_domain(), tempfile::tempdir().unwrap());
    let more = ["--scene", "needle_insertion", "--ros-args", "-p", "page:=true", "-p", "page_port:=0"];
    let node = Program::start(TWIN, &more, domain, &[("ROS_LOG_DIR", logs.path().to_str().unwrap())]);
    let address = address(&logs);
    let mut peer = Peer::start(domain);
    peer.connect();
    peer.ask(json!({"op": "subscribe", "topic": "/diagnostics", "type": "diagnostic_msgs/msg/DiagnosticArray"}));
    let bag = concat!(env!("CARGO_MANIFEST_DIR"), "/bags/needle_insertion");
    for k in 0..10 {
        let mut viewer = view(&address);
        say(&mut viewer, &json!({ "ask": "reset", "token": address.split_once("#token=").unwrap().1 }));
        assert_eq!(until(&mut viewer, "reply", |_| true)["done"], true);
        drop(viewer);
        let stop = std::sync::Arc::default();
        let viewers: Vec<_> = (0..5 * (k % 2)).map(|_| greedy(&address, &stop)).collect();
        let (before, begun) = (threads(node.id()), Instant::now());
        let rig = Program::start(env!("CARGO_BIN_EXE_rig_node"), &[bag], domain, &[]);
        std::thread::sleep(Duration::from_secs(14));
        let (after, seconds) = (threads(node.id()), begun.elapsed().as_secs_f64());
        stop.store(true, std::sync::atomic::Ordering::Relaxed);
        let said = peer.ask(json!({"op": "last", "topic": "/diagnostics", "seconds": 2.0}));
        rig.stop("INT");
        let values = said["message"]["status"][0]["values"].as_array().unwrap();
        let value = |key: &str| values.iter().find(|v| v["key"] == key).map_or("-", |v| v["value"].as_str().unwrap());
        let share = |name: &str| 100.0 * (after.get(name).unwrap_or(&0.0) - before.get(name).unwrap_or(&0.0)) / seconds;
        let n = viewers.len();
        let seen: Vec<[u64; 2]> = viewers.into_iter().map(|v| v.join().unwrap()).collect();
        println!(
            "viewers {n}: stepping p50 {} p99 {} ms, latency p50 {} p99 {} ms, coalesced {}; page {:.2} %, tissue {:.2} %, \
             solver {:.2} %; texts and frames {seen:?}",
            value("stepping p50 (ms)"),
            value("stepping p99 (ms)"),
            value("latency p50 (ms)"),
            value("latency p99 (ms)"),
            value("coalesced poses"),
            share("page"),
            share("tissue"),
            share("solver"),
        );
    }
}
