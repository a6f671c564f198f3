//! Simulated time that somebody else makes.
#![allow(clippy::unwrap_used, clippy::panic)]

use crate::ros::{Peer, coarse_twin, free_domain, joint_state};
use serde_json::{Value, json};

fn tick(peer: &mut Peer, sec: i64, nanosec: i64) {
    // Best effort: said twice, heard once.
    for _ in 0..2 {
        let value = json!({"clock": {"sec": sec, "nanosec": nanosec}});
        peer.ask(json!({"op": "publish", "topic": "/clock", "value": value}));
    }
}

fn status(peer: &mut Peer, wanted: impl Fn(&Value) -> bool) -> Value {
    peer.until("/status", wanted)
}

fn pose(peer: &mut Peer, sec: i64, nanosec: i64) -> Value {
    peer.ask(json!({"op": "publish", "topic": "/measured_js", "value": joint_state(sec, nanosec, 0.0001)}));
    peer.ask(json!({"op": "take", "topic": "/predicted_cf", "timeout": 5.0}))["messages"][0]["header"]["stamp"].clone()
}

#[test]
fn pauses_pause_and_a_jump_back_resets() {
    let domain = free_domain();
    let node = coarse_twin(domain, &["-p", "use_sim_time:=true"], &[]);
    let mut peer = Peer::start(domain);
    peer.ask(json!({"op": "advertise", "topic": "/clock", "type": "rosgraph_msgs/msg/Clock", "qos": "best_effort"}));
    peer.ask(json!({"op": "advertise", "topic": "/measured_js", "type": "sensor_msgs/msg/JointState"}));
    peer.ask(json!({"op": "subscribe", "topic": "/predicted_cf", "type": "geometry_msgs/msg/WrenchStamped"}));
    peer.ask(json!({"op": "subscribe", "topic": "/status", "type": "needle_twin/msg/TwinStatus"}));
    peer.ask(
        json!({"op": "subscribe", "topic": "/tissue_model", "type": "needle_twin/msg/TissueModel", "qos": "latched"}),
    );
    peer.ask(json!({"op": "take", "topic": "/tissue_model", "timeout": 60.0}));
    let topics = ["/clock", "/measured_js", "/predicted_cf", "/status"];
    assert_eq!(peer.ask(json!({"op": "wait_matched", "topics": topics}))["missing"], json!([]));
    let before = status(&mut peer, |s| s["reasons"].to_string().contains("/clock has not said anything"));
    assert!(before["reasons"].to_string().contains("/clock has not said anything"), "{before}");

    tick(&mut peer, 1000, 0);
    assert_eq!(pose(&mut peer, 1000, 5), json!({"sec": 1000, "nanosec": 5}), "the stamp of the pose");
    // Paused for longer than the input may be silent: no time has gone by.
    std::thread::sleep(std::time::Duration::from_millis(700));
    let paused = status(&mut peer, |s| s["health"] == 0);
    assert_eq!((&paused["health"], &paused["prediction_valid"]), (&json!(0), &json!(true)), "{paused}");
    tick(&mut peer, 1000, 10_000_000);
    assert_eq!(pose(&mut peer, 1000, 10_000_005)["nanosec"], 10_000_005, "the pause is over");
    // Time goes on, poses don't.
    tick(&mut peer, 1002, 0);
    let lost = status(&mut peer, |s| s["health"] == 3);
    assert_eq!((&lost["health"], &lost["prediction_valid"]), (&json!(3), &json!(false)), "{lost}");
    assert_eq!(pose(&mut peer, 1002, 7)["nanosec"], 7, "and they come again");

    tick(&mut peer, 10, 0);
    let reset = status(&mut peer, |s| s["poses_received"] == 0);
    assert_eq!((&reset["poses_received"], &reset["poses_rejected"]), (&json!(0), &json!(0)), "{reset}");
    assert_eq!(pose(&mut peer, 10, 9), json!({"sec": 10, "nanosec": 9}));
    let (code, log, _) = node.stop("INT");
    assert_eq!(code, Some(0));
    assert_eq!(log.matches("input lost").count(), 1, "not while time stood still: {log}");
    assert_eq!(log.matches("unseen").count(), 1, "a pause is no gap: {log}");
    assert!(log.contains("time went back by 992.000 s") && log.contains("poses come again"), "{log}");
}

#[test]
fn two_clocks_are_said() {
    let domain = free_domain();
    let node = coarse_twin(domain, &["-p", "use_sim_time:=true", "-p", "autostart:=false"], &[]);
    let mut peers = [Peer::start(domain), Peer::start(domain)];
    for peer in &mut peers {
        peer.ask(
            json!({"op": "advertise", "topic": "/clock", "type": "rosgraph_msgs/msg/Clock", "qos": "best_effort"}),
        );
        peer.ask(json!({"op": "wait_matched", "topics": ["/clock"]}));
    }
    node.wait_for("/clock has 2 publishers");
    let (_, log, _) = node.stop("INT");
    assert!(log.contains("/clock has 2 publishers") && log.contains("-r /clock:=clock"), "{log}");
}
