//! Contract: looking ahead leaves the twin as it is, bit for bit; a double that makes the same motion predicts the same
//! bits, and one that makes it in few steps is right to two per cent; the service answers within 50 ms.
#![allow(clippy::unwrap_used, clippy::panic)]

use crate::ros::{Peer, Program, TWIN, free_domain};
use needle_core::scene::{Override, Scene};
use needle_core::twin::{Motion, Prediction, StampedPose, Twin};
use serde_json::{Value, json};
use testkit::coarse;
use testkit::coarse::{alone, digits};

/// One pose, at 2 mm/s and 200 Hz.
fn pose(twin: &Twin, i: u32) -> StampedPose {
    StampedPose { time_s: 0.005 * f64::from(i), pose: twin.pose_at_depth(1e-5 * f64::from(i)) }
}

fn step(twin: &mut Twin, i: u32) -> Prediction {
    let pose = pose(twin, i);
    twin.step(pose).unwrap()
}

fn walk(twin: &mut Twin, poses: u32) {
    for i in 1..=poses {
        step(twin, i);
    }
}

/// Last predictions and the whole displacement field in digits that distinguish any two doubles.
fn state(twin: &mut Twin, answers: &[Prediction]) -> (Vec<String>, Vec<[u64; 3]>) {
    let mut field = Vec::new();
    twin.displacements(&mut field);
    (digits(answers), field.iter().map(|u| u.map(f64::to_bits)).collect())
}

fn scenes() -> Vec<(&'static str, Scene)> {
    let relaxing = [("material.prony_shares", "0.3, 0.2"), ("material.prony_times_s", "0.5, 5")];
    let relaxing: Vec<_> = relaxing.iter().map(|(key, value)| Override::text(key, value, "test")).collect();
    let half_plane = Scene::preset("needle_insertion").unwrap();
    vec![
        ("needle in a half plane", half_plane.clone()),
        ("needle in relaxing gel", half_plane.with(&relaxing).unwrap()),
        ("indenter", coarse::scene("indentation", &[])),
        ("needle in three dimensions", coarse::scene("needle_insertion", &[])),
    ]
}

#[test]
fn the_live_twin_has_the_same_bits_with_and_without_looking_ahead() {
    for (name, scene) in scenes() {
        alone(|| {
            let mut undisturbed = Twin::new(&scene).unwrap();
            let mut live = Twin::new(&scene).unwrap();
            let mut double = live.double();
            let (mut expected, mut answers, mut way) = (Vec::new(), Vec::new(), Vec::new());
            for i in 1..=150 {
                expected.push(step(&mut undisturbed, i));
                answers.push(step(&mut live, i));
                if i % 50 == 10 {
                    double.take_over(&live);
                    let motion = Motion::new(if i > 100 { -0.0005 } else { 0.001 }, 0.002, 40);
                    let from = pose(&live, i);
                    // as a node does: the motion is made beside the live one
                    std::thread::scope(|scope| {
                        scope.spawn(|| double.look_ahead(&from, &motion, &mut way).unwrap());
                    });
                    assert_eq!(way.len(), motion.poses as usize, "{name}");
                }
            }
            assert_eq!(state(&mut live, &answers), state(&mut undisturbed, &expected), "{name}");
        });
    }
}

#[test]
fn a_double_that_makes_the_same_motion_predicts_the_same_bits() {
    for (name, scene) in scenes() {
        alone(|| {
            let mut live = Twin::new(&scene).unwrap();
            let mut double = live.double();
            walk(&mut live, 100);
            double.take_over(&live);
            let from = pose(&live, 100);
            let mut ahead = Vec::new();
            let motion = Motion { distance_m: 5e-4, speed_m_per_s: 0.002, poses: 50, steps_per_pose: u32::MAX };
            double.look_ahead(&from, &motion, &mut ahead).unwrap();
            let made: Vec<Prediction> = (1..=50)
                .map(|i| {
                    let way = 5e-4 * (f64::from(i) / 50.0);
                    let tip = std::array::from_fn(|k| from.pose.tip[k] + way * from.pose.axis[k]);
                    let pose = needle_core::twin::Pose { tip, ..from.pose };
                    live.step(StampedPose { time_s: from.time_s + way / 0.002, pose }).unwrap()
                })
                .collect();
            assert_eq!(state(&mut double, &ahead), state(&mut live, &made), "{name}");
        });
    }
}

#[test]
fn few_steps_are_right_to_two_per_cent_of_the_force_and_to_a_hundredth_of_a_millimetre() {
    for name in ["needle_insertion", "indentation"] {
        alone(|| {
            let scene = Scene::preset(name).unwrap();
            let mut live = Twin::new(&scene).unwrap();
            let mut double = live.double();
            walk(&mut live, 400);
            double.take_over(&live);
            let (from, mut ahead) = (pose(&live, 400), Vec::new());
            double.look_ahead(&from, &Motion::new(0.001, 0.002, Motion::STEPS), &mut ahead).unwrap();
            // the motion itself, in poses of 1 um
            let fine = |twin: &Twin, i: u32| StampedPose {
                time_s: from.time_s + 5e-4 * f64::from(i),
                pose: twin.pose_at_depth(0.004 + 1e-6 * f64::from(i)),
            };
            let made: Vec<Prediction> = (1..=1000)
                .map(|i| {
                    let pose = fine(&live, i);
                    live.step(pose).unwrap()
                })
                .collect();
            let force = |p: &Prediction| p.force_n[2];
            let peak = force(made.last().unwrap());
            for p in &ahead {
                let i = ((p.depth_m - 0.004) / 1e-6).round() as usize;
                let error = (force(p) - force(&made[i - 1])) / peak;
                assert!(error.abs() < 0.02, "{name}: force at {} m off by {error}", p.depth_m);
            }
            let error = (force(ahead.last().unwrap()) - peak) / peak;
            let (mut there, mut then) = (Vec::new(), Vec::new());
            double.target_positions(&mut there);
            live.target_positions(&mut then);
            let off = there.iter().zip(&then).map(|(a, b)| (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt());
            let off = off.fold(0.0, f64::max);
            println!("{name}: 1 mm ahead, force {:.2} % off at the end, targets {:.1} um", 100.0 * error, 1e6 * off);
            assert!(off < 1e-5, "{name}: a target is {off} m off");
        });
    }
}

#[test]
fn what_can_not_be_followed_is_refused_with_the_reason() {
    alone(|| {
        let mut live = Twin::new(&Scene::preset("needle_insertion").unwrap()).unwrap();
        let mut double = live.double();
        let from = pose(&live, 10);
        step(&mut live, 10);
        double.take_over(&live);
        let mut way = Vec::new();
        let refused = double.look_ahead(&from, &Motion::new(0.02, 0.002, 300), &mut way);
        assert!(refused.unwrap_err().to_string().contains("beyond"));
        // and the next question is answered
        double.take_over(&live);
        double.look_ahead(&from, &Motion::new(0.0005, 0.002, 300), &mut way).unwrap();
        assert!((way.last().unwrap().depth_m - 0.0006).abs() < 1e-12);
    });
}

fn call(peer: &mut Peer, distance_m: f64) -> Value {
    peer.ask(json!({
        "op": "call", "service": "/twin/look_ahead", "type": "needle_twin/srv/LookAhead",
        "request": {"distance_m": distance_m, "speed_m_per_s": 0.0},
    }))["response"]
        .clone()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

#[test]
fn the_service_answers_while_the_twin_goes_on() {
    let domain = free_domain();
    let node = Program::start(TWIN, &["--ros-args", "-p", "threads:=1"], domain, &[]);
    let mut peer = Peer::start(domain);
    for (topic, kind, qos) in [
        ("/tissue_model", "needle_twin/msg/TissueModel", "latched"),
        ("/predicted_cf", "geometry_msgs/msg/WrenchStamped", "reliable"),
    ] {
        peer.ask(json!({"op": "subscribe", "topic": topic, "type": kind, "qos": qos}));
    }
    peer.ask(json!({"op": "advertise", "topic": "/measured_js", "type": "sensor_msgs/msg/JointState"}));
    let topics = json!(["/tissue_model", "/predicted_cf", "/measured_js"]);
    assert_eq!(peer.ask(json!({"op": "wait_matched", "topics": topics}))["missing"], json!([]));
    peer.ask(json!({"op": "take", "topic": "/tissue_model", "timeout": 60.0}));
    let early = call(&mut peer, 0.001);
    assert!(early["success"] == false && early["message"].as_str().unwrap().contains("no pose"), "{early}");
    let insert = |peer: &mut Peer, from_m: f64, depth_m: f64, poses: u32| {
        peer.ask(json!({
            "op": "insert", "topic": "/measured_js", "joint": "insertion", "poses": poses, "rate_hz": 100.0,
            "from_m": from_m, "depth_m": depth_m, "answers": "/predicted_cf",
        }))
    };
    insert(&mut peer, 0.0, 0.004, 300);
    let answers: Vec<Value> = (0..15).map(|_| call(&mut peer, 0.001)).collect();
    let last = answers.last().unwrap();
    assert_eq!(last["success"], true, "{last}");
    let mut took: Vec<f64> = answers.iter().map(|a| a["computed_s"].as_f64().unwrap()).collect();
    took.sort_by(f64::total_cmp);
    println!(
        "computed in {:?} ms, steps {}",
        took.iter().map(|t| (1e4 * t).round() / 10.0).collect::<Vec<_>>(),
        last["steps"]
    );
    // other programs of the machine take their share of some of them
    assert!(took[took.len() / 4] <= 0.05, "{took:?}");
    let (depths, forces) = (numbers(&last["depths_m"]), numbers(&last["forces_n"]));
    assert!(depths.len() == forces.len() && (depths.last().unwrap() - 0.005).abs() < 1e-9, "{last}");
    assert_eq!(last["targets"].as_array().unwrap().len(), 3);
    // the motion is made
    let made = insert(&mut peer, 0.004, 0.005, 150);
    let force = made["forces"].as_array().unwrap().last().unwrap()[2].as_f64().unwrap();
    let error = forces.last().unwrap() / force - 1.0;
    println!("1 mm ahead: {:.4} N, then {force:.4} N, {:.2} % off", forces.last().unwrap(), 100.0 * error);
    // a machine that is busy leaves time for fewer steps; what the usual number gives is tested above
    assert!(error.abs() < 0.10, "{error}");
    for (distance_m, word) in [(0.0, "distance_m"), (0.02, "beyond")] {
        let refused = call(&mut peer, distance_m);
        assert!(refused["success"] == false && refused["message"].as_str().unwrap().contains(word), "{refused}");
    }
    let (code, log, _) = node.stop("INT");
    assert_eq!(code, Some(0), "{log}");
}
