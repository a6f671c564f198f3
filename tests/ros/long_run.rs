//! 1 kHz for long: nothing that DDS delivered is lost, memory stays flat, latency stays as it was.
//!
//! `cargo test --release --test ros long_run -- --ignored --nocapture`: five minutes, or `LONG_RUN_S` seconds.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::time::{Duration, Instant};

use crate::ros::{Program, TWIN, free_domain, node_mb};
use ros2_messages::builtin_interfaces::Time;
use ros2_messages::geometry_msgs::WrenchStamped;
use ros2_messages::needle_twin::TwinStatus;
use ros2_messages::sensor_msgs::JointState;
use ros2_messages::std_msgs::Header;
use ros2_node::arguments::RosArguments;
use ros2_node::clock::wall_nanos;
use ros2_node::environment::Environment;
use ros2_node::names::Names;
use ros2_node::participant::Participant;
use ros2_node::qos;

/// Rate of the poses, Hz.
const RATE_HZ: u64 = 1000;
/// The needle goes in and out at 1 mm/s, to this depth, m.
const DEPTH_M: f64 = 0.003;

/// What was measured in one tenth of the time.
#[derive(Debug, Default)]
struct Tenth {
    round_trips_s: Vec<f64>,
    memory_mb: Vec<f64>,
}

impl Tenth {
    fn percentile_ms(&self, share: f64) -> f64 {
        let mut sorted = self.round_trips_s.clone();
        sorted.sort_by(f64::total_cmp);
        1e3 * sorted.get((share * sorted.len() as f64) as usize).copied().unwrap_or(f64::NAN)
    }

    fn memory_mb(&self) -> f64 {
        self.memory_mb.iter().sum::<f64>() / self.memory_mb.len() as f64
    }
}

/// There and back again.
fn depth_m(time_s: f64) -> f64 {
    let way = 0.001 * time_s % (2.0 * DEPTH_M);
    if way < DEPTH_M { way } else { 2.0 * DEPTH_M - way }
}

#[test]
#[ignore = "five minutes, or LONG_RUN_S seconds: .ci/long runs it"]
fn a_thousand_poses_a_second_for_long() {
    let seconds = std::env::var("LONG_RUN_S").map_or(300, |s| s.parse::<u64>().unwrap());
    let domain = free_domain();
    // the needle preset as it ships
    let twin = Program::start(TWIN, &["--scene", "needle_insertion"], domain, &[]);
    let domain = domain.to_string();
    let environment = Environment::from_lookup(|name| (name == "ROS_DOMAIN_ID").then(|| domain.clone())).unwrap();
    let names = Names::new("driver", &[]).unwrap();
    let mut node = Participant::new(names, &environment, &RosArguments::default()).unwrap();
    node.set_program(TWIN);
    let positions = node.publisher::<JointState>("measured_js", qos::reliable(10)).unwrap();
    let forces = node.subscription::<WrenchStamped>("predicted_cf", qos::reliable(1000)).unwrap();
    let states = node.subscription::<TwinStatus>("status", qos::sensor(100)).unwrap();
    node.start(None).unwrap();
    let begun = Instant::now();
    while !(states.take().is_some_and(|s| s.model_id != 0) && positions.subscribers() > 0) {
        assert!(begun.elapsed() < Duration::from_secs(60), "the twin does not start");
        std::thread::sleep(Duration::from_millis(20));
    }

    let poses = seconds * RATE_HZ;
    let mut tenths: Vec<Tenth> = (0..10).map(|_| Tenth::default()).collect();
    let (mut answered, mut last) = (0_u64, TwinStatus::default());
    let (begun, mut before) = (Instant::now(), 0);
    let mut listen = |tenth: &mut Tenth| {
        while let Some((message, [received, _])) = forces.take_timed() {
            let stamp = message.header.stamp.nanos();
            assert!(stamp > before && message.wrench.force.z.is_finite(), "in order, and a number");
            before = stamp;
            answered += 1;
            tenth.round_trips_s.push((received - stamp) as f64 * 1e-9);
        }
        while let Some(state) = states.take() {
            last = state;
        }
        (answered, last.clone())
    };
    for i in 0..poses {
        let due = begun + Duration::from_nanos(1_000_000_000 / RATE_HZ * i);
        let tenth = &mut tenths[(10 * i / poses) as usize];
        loop {
            listen(tenth);
            let left = due.saturating_duration_since(Instant::now());
            if left.is_zero() {
                break;
            }
            std::thread::sleep(left.min(Duration::from_micros(300)));
        }
        let header = Header { stamp: Time::from_nanos(wall_nanos()), frame_id: String::new() };
        let position = vec![depth_m(i as f64 / RATE_HZ as f64)];
        positions.send(JointState { header, name: vec!["insertion".into()], position, ..JointState::default() });
        if i % (RATE_HZ / 2) == 0 {
            tenth.memory_mb.push(node_mb(twin.id()));
        }
        if i % (60 * RATE_HZ) == 0 {
            eprintln!("{} s, {:.1} MB", i / RATE_HZ, node_mb(twin.id()));
        }
    }
    std::thread::sleep(Duration::from_secs(1));
    let (answered, last) = listen(&mut tenths[9]);
    // The first tenth is a start: caches, histograms, discovery. Some 0.4 MB more come within two minutes, and then no more.
    let (early, middle, late) = (&tenths[1], &tenths[4], &tenths[9]);
    println!(
        "{poses} poses in {:.0} s: {} received, {} answered ({answered} heard), {} coalesced, {} refused",
        begun.elapsed().as_secs_f64(),
        last.poses_received,
        last.poses_answered,
        last.poses_coalesced,
        last.poses_rejected
    );
    for (name, tenth) in [("second tenth", early), ("fifth tenth", middle), ("last tenth", late)] {
        let [p10, p50, p99] = [0.1, 0.5, 0.99].map(|share| tenth.percentile_ms(share));
        println!(
            "{name}: {:.2} MB; stamp to answer: p10 {p10:.3} ms, p50 {p50:.3} ms, p99 {p99:.2} ms",
            tenth.memory_mb()
        );
    }
    // Every pose that DDS delivered is answered, or was replaced by a newer one and counted.
    assert_eq!(last.poses_received, last.poses_answered + last.poses_coalesced);
    assert_eq!(last.poses_rejected, 0);
    // What was answered was heard, but for pauses of a busy machine: the writer keeps ten.
    assert!(answered as f64 > 0.9 * last.poses_answered as f64, "{answered} of {}", last.poses_answered);
    assert!(late.memory_mb() < 1.01 * middle.memory_mb(), "{} MB, then {} MB", middle.memory_mb(), late.memory_mb());
    // The fast ones say what the program costs, the slow ones what else the machine does.
    assert!(late.percentile_ms(0.1) < 1.5 * early.percentile_ms(0.1) + 0.2, "latency has grown");
    assert!(late.percentile_ms(0.5) < 3.0 * early.percentile_ms(0.5) + 10.0, "the median has grown");
    let (code, log, _) = twin.stop("INT");
    assert!(code == Some(0) && !log.contains("ERROR"), "{log}");
}
