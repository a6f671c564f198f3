//! A driver of somebody else in the loop: Eclipse Cyclone DDS in Python at 500 Hz, as `ros2_control` would run it. It moves only while
//! `safety` says so, and the guard holds it after each fault until somebody says `~/resume`.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::io::{BufRead, BufReader, Write};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::ros::{CYCLONE, Program, TWIN, free_domain, python};
use super::{NEEDLE_TWIN, alone};

struct Driver {
    child: Child,
    lines: Receiver<Value>,
}

impl Driver {
    fn start(domain: u16) -> Self {
        let folder = env!("CARGO_MANIFEST_DIR");
        let mut child = Command::new(python::python())
            .arg(format!("{folder}/tests/peers/driver.py"))
            .arg(format!("{folder}/bags/reference/needle_force_capture_radius_0.50mm.csv"))
            .env("ROS_DOMAIN_ID", domain.to_string())
            .env("CYCLONEDDS_URI", CYCLONE)
            .env("PYTHONDONTWRITEBYTECODE", "1")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let (sender, lines) = channel();
        let stdout = BufReader::new(child.stdout.take().unwrap());
        std::thread::spawn(move || {
            for line in stdout.lines().map_while(Result::ok) {
                let _ = sender.send(serde_json::from_str(&line).unwrap());
            }
        });
        Self { child, lines }
    }

    fn fault(&mut self, name: &str) {
        writeln!(self.child.stdin.as_mut().unwrap(), "{}", json!({ "fault": name })).unwrap();
    }

    /// The next line that fits, with all before it.
    fn until(&self, patience: Duration, fits: impl Fn(&Value) -> bool) -> Option<Value> {
        let end = Instant::now() + patience;
        loop {
            let line = self.lines.recv_timeout(end.saturating_duration_since(Instant::now())).ok()?;
            println!("    driver: {line}");
            if fits(&line) {
                return Some(line);
            }
        }
    }
}

impl Drop for Driver {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn number(value: &Value, key: &str) -> f64 {
    value[key].as_f64().unwrap()
}

#[test]
fn a_driver_that_knows_the_topics_alone_stands_after_every_fault_until_somebody_says_so() {
    let _alone = alone();
    for fault in ["cell silent", "cell NaN", "side load", "cell frozen", "position silent"] {
        let domain = free_domain();
        let twin = ["--ros-args", "-p", "threads:=1", "-p", "residual_band_n:=0.02"];
        let guard = [
            "guard",
            "--ros-args",
            "-p",
            "goal_depth_m:=0.0095",
            "-p",
            "force_limit_n:=10.0",
            "-p",
            "resume_after_s:=0.0",
        ];
        let _twin = Program::start(TWIN, &twin, domain, &[]);
        let mut driver = Driver::start(domain);
        // a pause of a busy machine is a stop as well; then somebody says that it may go on, and so does the test
        let mut held = Program::start(NEEDLE_TWIN, &guard, domain, &[]);
        let begun = Instant::now();
        let moving = loop {
            let moves = driver.until(Duration::from_secs(60), |line| line["moves"] == true).expect("the needle moves");
            let stopped = driver.until(Duration::from_millis(800), |line| line["moves"] == false);
            if stopped.is_none() {
                break moves;
            }
            assert!(begun.elapsed() < Duration::from_secs(120), "{fault}: {stopped:?}");
            drop(held);
            held = Program::start(NEEDLE_TWIN, &guard, domain, &[]);
        };
        driver.fault(fault);
        let since = driver.until(Duration::from_secs(2), |line| line["fault"] == fault).unwrap();
        let stands = driver.until(Duration::from_secs(2), |line| line["moves"] == false).expect("it stands");
        let after_s = number(&stands, "last_s") - number(&since, "time_s");
        println!("{fault}: from {} m on, stands {:.0} ms after it", moving["depth_m"], 1e3 * after_s);
        assert!(after_s < 0.35, "{fault}: {after_s} s");
        driver.fault("none");
        let again = driver.until(Duration::from_millis(1500), |line| line["moves"] == true);
        assert_eq!(again, None, "{fault}: nobody has said ~/resume");
        let (_, log) = held.end();
        assert!(log.contains("stopped at depth"), "{fault}: {log}");
    }
}
