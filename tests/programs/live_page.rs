//! The live page's server as a viewer meets it: what comes in, what is let in, what a command needs, and that nobody waits for a
//! viewer.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::io::{Read, Write};
use std::net::{Ipv4Addr, TcpStream};
use std::sync::Arc;
use std::time::{Duration, Instant};

use crossbeam_channel::Receiver;
use needle_twin::live::{Asked, Board, Command, Frame, Model, Server, VIEWERS};
use serde_json::{Value, json};
use tungstenite::client::IntoClientRequest;
use tungstenite::{Message, WebSocket};

type Viewer = WebSocket<TcpStream>;

/// Corners of a tetrahedron.
const POINTS: [[f64; 3]; 4] = [[0.0, 0.0, 0.0], [0.03, 0.0, 0.0], [0.0, 0.03, 0.0], [0.0, 0.0, 0.017]];
const SURFACE: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];

struct Page {
    board: Arc<Board>,
    asked: Receiver<Asked>,
    server: Server,
}

fn page() -> Page {
    let (sender, asked) = crossbeam_channel::bounded(2);
    let board = Arc::new(Board::default());
    let mut n = 0;
    let figures = move || {
        n += 1;
        json!({ "kind": "figures", "n": n }).to_string()
    };
    let place = (Ipv4Addr::LOCALHOST.into(), 0);
    let server = Server::start(place, Arc::clone(&board), figures, sender, || {}).unwrap();
    Page { board, asked, server }
}

impl Page {
    fn host(&self) -> String {
        self.server.url().trim_start_matches("http://").trim_end_matches('/').to_owned()
    }

    fn token(&self) -> String {
        self.server.url_with_token().split_once("#token=").unwrap().1.to_owned()
    }

    /// Head and body of an answer to a plain request.
    fn get(&self, path: &str, host: &str, more: &str) -> (String, String) {
        let mut stream = TcpStream::connect(self.host()).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        write!(stream, "GET {path} HTTP/1.1\r\nHost: {host}\r\n{more}Connection: close\r\n\r\n").unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        let (head, body) = answer.split_once("\r\n\r\n").unwrap();
        (head.to_owned(), body.to_owned())
    }

    fn try_view(&self, origin: Option<&str>) -> Result<Viewer, String> {
        let mut request = format!("ws://{}/stream", self.host()).into_client_request().unwrap();
        origin.map(|o| request.headers_mut().insert("Origin", o.parse().unwrap()));
        let stream = TcpStream::connect(self.host()).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        tungstenite::client(request, stream).map(|(viewer, _)| viewer).map_err(|e| e.to_string())
    }

    fn view(&self) -> Viewer {
        self.try_view(Some(self.server.url().trim_end_matches('/'))).unwrap()
    }

    fn model(&self) {
        let about = json!({ "scene": "x", "targets": ["t"] });
        self.board.model(&Model {
            points: &POINTS,
            surface: &SURFACE,
            cells: &[[0, 1, 2, 3]],
            region: &[],
            about: &about,
        });
    }

    fn tissue(&self, depth_m: f64) {
        let displacements = [[0.0, 0.0, -depth_m]; 4];
        let (axis, targets) = ([0.0, 0.0, -1.0], [[0.0; 3]]);
        self.board.tissue(&Frame { depth_m, tip: [0.0; 3], axis, targets: &targets, displacements: &displacements });
    }
}

fn say(viewer: &mut Viewer, request: &Value) {
    viewer.send(Message::text(request.to_string())).unwrap();
}

/// Asks for more until a binary message comes; its first word and length.
fn binary(viewer: &mut Viewer) -> Vec<u8> {
    loop {
        say(viewer, &json!({ "ask": "next" }));
        if let Message::Binary(bytes) = viewer.read().unwrap() {
            return bytes.to_vec();
        }
    }
}

fn word(bytes: &[u8], i: usize) -> u32 {
    u32::from_le_bytes(bytes[4 * i..4 * i + 4].try_into().unwrap())
}

/// The next message of a kind.
fn text(viewer: &mut Viewer, kind: &str) -> Value {
    loop {
        match viewer.read().unwrap() {
            Message::Text(text) => {
                let value: Value = serde_json::from_str(&text).unwrap();
                if value["kind"] == kind {
                    return value;
                }
            }
            Message::Close(frame) => panic!("closed: {frame:?}"),
            _ => {}
        }
    }
}

#[test]
fn the_page_and_its_assets_need_nothing_else() {
    let page = page();
    let host = page.host();
    for (path, kind, holds) in [
        ("/", "text/html", "live.js"),
        ("/live.css", "text/css", "prefers-color-scheme"),
        ("/live.js", "text/javascript", "class View"),
    ] {
        let (head, body) = page.get(path, &host, "");
        assert!(head.starts_with("HTTP/1.1 200") && head.contains(kind), "{path}: {head}");
        assert!(body.contains(holds), "{path}");
        assert!(head.contains("default-src 'none'") && head.contains("nosniff"), "{head}");
        let outside = body.split("http").skip(1).filter(|rest| rest.starts_with("://") || rest.starts_with("s://"));
        // the name of SVG's elements is no address that is fetched
        assert!(
            outside.into_iter().all(|rest| rest.starts_with("://www.w3.org/2000/svg")),
            "{path} names another site"
        );
    }
    assert!(page.get("/more", &host, "").0.starts_with("HTTP/1.1 404"));
}

#[test]
fn another_sites_page_and_another_name_get_nothing() {
    let page = page();
    let host = page.host();
    let port = host.split_once(':').unwrap().1;
    assert!(page.get("/", &format!("localhost:{port}"), "").0.starts_with("HTTP/1.1 200"));
    for (host, origin) in [
        (format!("evil.test:{port}"), String::new()),
        ("127.0.0.1:1".to_owned(), String::new()),
        (host.clone(), "Origin: http://evil.test\r\n".to_owned()),
        (host.clone(), "Origin: null\r\n".to_owned()),
        (host.clone(), format!("Host: evil.test:{port}\r\n")),
    ] {
        let (head, body) = page.get("/", &host, &origin);
        assert!(head.starts_with("HTTP/1.1 403") && !body.contains("script"), "{host} {origin}: {head}");
    }
    assert!(page.try_view(Some("http://evil.test")).is_err());
    assert!(page.try_view(None).is_ok(), "what is no browser has no origin");
}

#[test]
fn the_sample_comes_once_and_then_what_has_changed() {
    let page = page();
    page.model();
    page.tissue(0.001);
    let mut viewer = page.view();
    let model = binary(&mut viewer);
    assert_eq!([word(&model, 0), word(&model, 2), word(&model, 3), word(&model, 4)], [1, 4, 4, 1]);
    let depth = |frame: &[u8]| (word(frame, 0), f32::from_bits(word(frame, 1)), frame.len());
    assert_eq!(depth(&binary(&mut viewer)), (2, 0.001, 32 + 12 + 24));
    page.tissue(0.001);
    page.tissue(0.002);
    page.tissue(0.003);
    assert_eq!(depth(&binary(&mut viewer)).1, 0.003, "the newest, and nothing twice");
}

#[test]
fn a_command_needs_the_token_and_reaches_who_runs_the_twin() {
    let page = page();
    let mut viewer = page.view();
    for token in ["", "0", &"0".repeat(32)] {
        say(&mut viewer, &json!({ "ask": "reset", "token": token }));
        let reply = text(&mut viewer, "reply");
        assert!(reply["done"] == false && reply["message"].as_str().unwrap().contains("token"), "{reply}");
    }
    assert!(page.asked.try_recv().is_err(), "nothing was asked for");
    say(&mut viewer, &json!({ "ask": "mark", "token": page.token(), "text": "here" }));
    let asked = page.asked.recv_timeout(Duration::from_secs(20)).unwrap();
    assert_eq!(asked.command, Command::Mark("here".to_owned()));
    asked.answer(true, "marked".to_owned());
    assert_eq!(text(&mut viewer, "reply"), json!({ "kind": "reply", "done": true, "message": "marked" }));
}

#[test]
fn what_no_viewer_says_ends_the_connection_only() {
    let page = page();
    let mut other = page.view();
    for wrong in [Message::text("{}"), Message::text("x".repeat(5000)), Message::binary(vec![1, 2, 3])] {
        let mut viewer = page.view();
        let _ = viewer.send(wrong);
        let begun = Instant::now();
        while viewer.read().is_ok_and(|m| !m.is_close()) {
            assert!(begun.elapsed() < Duration::from_secs(20));
        }
    }
    // one that never stops talking
    let mut viewer = page.view();
    let begun = Instant::now();
    while viewer.send(Message::text(r#"{"ask":"next"}"#)).is_ok() {
        assert!(begun.elapsed() < Duration::from_secs(20), "it is sent away");
    }
    say(&mut other, &json!({ "ask": "next" }));
    assert_eq!(text(&mut other, "figures")["kind"], "figures");
}

/// A large sample changes without end; one viewer asks and reads nothing, another one sees the newest, and whoever shows it never waits.
#[test]
fn a_viewer_that_does_not_read_holds_up_nobody() {
    let page = page();
    let points: Vec<[f64; 3]> = (0..100_000).map(|i| [1e-7 * f64::from(i), 0.0, 0.01]).collect();
    let about = json!({ "scene": "large", "targets": [] });
    page.board.model(&Model { points: &points, surface: &[], cells: &[], region: &[], about: &about });
    let mut deaf = page.view();
    let mut viewer = page.view();
    assert_eq!(word(&binary(&mut viewer), 0), 1);
    let axis = [0.0, 0.0, -1.0];
    let (mut largest, mut seen) = (Duration::ZERO, 0.0);
    for k in 1..=60 {
        // 0.6 MB each, far more than the buffers of a connection hold
        let displacements = vec![[0.0, 0.0, -1e-6 * f64::from(k)]; points.len()];
        let _ = deaf.send(Message::text(r#"{"ask":"next"}"#));
        let depth_m = f64::from(k);
        let frame = Frame { depth_m, tip: [0.0; 3], axis, targets: &[], displacements: &displacements };
        let begun = Instant::now();
        page.board.tissue(&frame);
        largest = largest.max(begun.elapsed());
        // an earlier frame may be on its way
        while k % 10 == 0 && seen != depth_m {
            seen = f64::from(f32::from_bits(word(&binary(&mut viewer), 1)));
        }
    }
    assert_eq!(seen, 60.0);
    assert!(largest < Duration::from_secs(5), "{largest:?}: less than the time that a connection may be stuck");
    assert!(page.board.is_watched());
}

#[test]
fn seats_are_bounded_and_given_back() {
    let page = page();
    let mut viewers: Vec<Viewer> = (0..VIEWERS).map(|_| page.view()).collect();
    let refused = page.try_view(None).unwrap_err();
    assert!(refused.contains("503"), "{refused}");
    drop(viewers.pop());
    let begun = Instant::now();
    while page.try_view(None).map(|v| viewers.push(v)).is_err() {
        assert!(begun.elapsed() < Duration::from_secs(20), "a seat becomes free");
        std::thread::sleep(Duration::from_millis(5));
    }
    let Page { server, board, .. } = page;
    drop(server);
    let mut last = viewers.pop().unwrap();
    let said = last.read().unwrap();
    assert!(said.to_text().unwrap_or("").contains("ended") || said.is_close(), "{said:?}");
    drop(viewers);
    drop(board);
}

/// More connections than there is room for, none of which says anything.
#[test]
fn silent_connections_keep_the_page_from_others_for_a_few_seconds_only() {
    let page = page();
    let silent: Vec<TcpStream> = (0..60).map(|_| TcpStream::connect(page.host()).unwrap()).collect();
    let answers = || {
        let mut stream = TcpStream::connect(page.host()).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        let mut answer = String::new();
        let asked = write!(stream, "GET / HTTP/1.1\r\nHost: {}\r\nConnection: close\r\n\r\n", page.host());
        asked.is_ok() && stream.read_to_string(&mut answer).is_ok() && answer.starts_with("HTTP/1.1 200")
    };
    let begun = Instant::now();
    while !answers() {
        assert!(begun.elapsed() < Duration::from_secs(40), "silent connections are closed");
        std::thread::sleep(Duration::from_millis(100));
    }
    drop(silent);
}

#[test]
fn a_port_that_is_taken_is_said_with_what_to_do() {
    let page = page();
    let port = page.host().split_once(':').unwrap().1.parse().unwrap();
    let place = (Ipv4Addr::LOCALHOST.into(), port);
    let (sender, _asked) = crossbeam_channel::bounded(1);
    let error = Server::start(place, Arc::default(), String::new, sender, || {}).unwrap_err().to_string();
    assert!(error.contains(&port.to_string()) && error.contains("page_port"), "{error}");
}
