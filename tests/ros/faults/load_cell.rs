//! A load cell that lies: the comparison says so, and the prediction does not care.
#![allow(clippy::unwrap_used, clippy::panic)]

use crate::ros::{Peer, connected_twin, free_domain};
use serde_json::{Value, json};

const START: i64 = 1_700_000_000_000_000_000;
const POSES: i64 = 50;

/// An insertion by 1 mm at 20 Hz with a load cell that says `cell(i)`: forces, and the last comparison and status.
fn run(
    peer: &mut Peer,
    number: i64,
    (code, reason): (u64, &str),
    cell: impl Fn(i64) -> Option<[Value; 3]>,
) -> (Vec<f64>, Value, Value) {
    let reset = peer.ask(json!({"op": "call", "service": "/twin/reset", "type": "std_srvs/srv/Trigger"}));
    assert_eq!(reset["response"]["success"], true);
    // each run later than the one before: a stamp that goes back is a straggler
    let begin = START + 100_000_000_000 * number;
    let poses: Vec<(i64, f64)> = (0..POSES).map(|i| (begin + 50_000_000 * i, 2e-5 * i as f64)).collect();
    let wrenches: Vec<Option<[Value; 3]>> = (0..POSES).map(cell).collect();
    let answer = peer.ask(json!({
        "op": "steps", "topic": "/measured_js", "joint": "insertion", "poses": poses, "answers": "/predicted_cf",
        "wrench_topic": "/measured_cf", "wrenches": wrenches,
    }));
    let forces = answer["forces"].as_array().unwrap().iter().map(|f| f.as_f64().expect("answered")).collect();
    let of_this_run = |c: &Value| c["header"]["stamp"]["sec"].as_i64() >= Some(begin / 1_000_000_000);
    let comparison = peer.until("/comparison", |c| of_this_run(c) && c["load_cell"] == code);
    let status = peer.until("/status", |s| s["reasons"].to_string().contains(reason));
    (forces, comparison, status)
}

#[test]
fn the_comparison_says_what_is_wrong_and_the_prediction_is_the_same() {
    let domain = free_domain();
    let more = ["-p", "load_cell_range_n:=5.0", "-p", "residual_band_n:=0.2", "-p", "input_timeout_s:=1.0"];
    let (node, mut peer) = connected_twin(domain, &more);
    peer.ask(json!({"op": "advertise", "topic": "/measured_cf", "type": "geometry_msgs/msg/WrenchStamped"}));
    peer.ask(json!({"op": "subscribe", "topic": "/comparison", "type": "needle_twin/msg/ForceComparison"}));
    let matched = peer.ask(json!({"op": "wait_matched", "topics": ["/measured_cf", "/comparison"]}));
    assert_eq!(matched["missing"], json!([]));
    let (truth, ..) = run(&mut peer, 0, (1, ""), |_| None);
    let right = |i: i64| [json!(0.0), json!(0.0), json!(truth[i as usize])];
    let (_, sound, _) = run(&mut peer, 1, (0, ""), |i| Some(right(i)));
    assert!(sound["valid"] == true && sound["residual_n"].as_f64().unwrap().abs() < 1e-6, "{sound}");
    type Cell<'a> = &'a dyn Fn(i64) -> Option<[Value; 3]>;
    let cases: [(&str, Cell, u64, &str); 5] = [
        ("falls silent", &|i| (i < 30).then(|| right(i)), 1, "no reading near"),
        ("one axis is NaN", &|i| Some([json!("nan"), json!(0.0), json!(truth[i as usize])]), 2, "no number"),
        ("is stuck", &|_| Some([json!(0.0), json!(0.0), json!(0.1)]), 3, "does not change"),
        ("is at its end", &|_| Some([json!(0.0), json!(0.0), json!(6.0)]), 4, "end of its range"),
        ("is off by 0.5 N", &|i| Some([json!(0.0), json!(0.0), json!(truth[i as usize] + 0.5)]), 0, "not tared"),
    ];
    for (number, (fault, cell, code, reason)) in (2..).zip(cases) {
        let (forces, comparison, status) = run(&mut peer, number, (code, reason), cell);
        assert_eq!(comparison["load_cell"], code, "{fault}: {comparison}");
        assert_eq!(comparison["valid"], code == 0, "{fault}: {comparison}");
        let said = status["reasons"].to_string();
        assert!(said.contains(reason), "{fault}: {said}");
        let difference = forces.iter().zip(&truth).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        println!("the load cell {fault}: predictions differ by {difference:.1e} N at most");
        assert!(difference <= 1e-9 * truth[POSES as usize - 1], "{fault}: {difference} N");
    }
    drop(node);
}
