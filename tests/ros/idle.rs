//! Contract: a twin that nobody sends poses to takes less than a hundredth of a core, both its processes together.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, clippy::panic)]

use std::fs;
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::ros::{Program, TWIN, free_domain, middleware_of};

/// Allowed share of a core. A busy machine, with cold caches and slow clocks, makes every wake dearer than the promise
/// knows: 0.7 % was seen, 1.3 % before.
const SHARE: f64 = 0.02;
/// Allowed wakes of all threads per second, which no other load changes: 120 were seen, 370 before.
const WAKES_PER_S: f64 = 200.0;

/// What Linux counts processor time in for everybody to see (USER_HZ).
const TICKS_PER_S: f64 = 100.0;

/// Processor time, s, and how often its threads have waited for something.
fn cost(process: u32) -> (f64, f64) {
    let stat = fs::read_to_string(format!("/proc/{process}/stat")).unwrap();
    // utime and stime, counted from the state, which follows the name
    let ticks = stat.rsplit_once(") ").unwrap().1.split(' ').skip(11).take(2).map(|t| t.parse::<f64>().unwrap());
    let waits = fs::read_dir(format!("/proc/{process}/task")).unwrap().flatten().map(|task| {
        let status = fs::read_to_string(task.path().join("status")).unwrap();
        let line = status.lines().find_map(|l| l.strip_prefix("voluntary_ctxt_switches:")).unwrap();
        line.trim().parse::<f64>().unwrap()
    });
    (ticks.sum::<f64>() / TICKS_PER_S, waits.sum())
}

#[test]
fn an_idle_twin_leaves_the_machine_alone() {
    let node = Program::start(TWIN, &["--scene", "needle_insertion"], free_domain(), &[]);
    // The model is built, and discovery at rest.
    sleep(Duration::from_secs(10));
    let middleware = middleware_of(node.id()).unwrap();
    let (begun, before) = (Instant::now(), [cost(node.id()), cost(middleware)]);
    sleep(Duration::from_secs(30));
    let seconds = begun.elapsed().as_secs_f64();
    let after = [cost(node.id()), cost(middleware)];
    let [of_node, of_middleware] =
        [0, 1].map(|i| [(after[i].0 - before[i].0) / seconds, (after[i].1 - before[i].1) / seconds]);
    let (share, wakes) = (of_node[0] + of_middleware[0], of_node[1] + of_middleware[1]);
    eprintln!(
        "node {:.2} % and {:.0} wakes/s, middleware process {:.2} % and {:.0} wakes/s: {:.2} % of a core in {seconds:.0} s",
        100.0 * of_node[0],
        of_node[1],
        100.0 * of_middleware[0],
        of_middleware[1],
        100.0 * share
    );
    assert!(wakes > 1.0 && share < SHARE, "{share} of a core");
    assert!(wakes < WAKES_PER_S, "{wakes} wakes per second");
    let (code, log, _) = node.stop("INT");
    assert!(code == Some(0) && log.contains("waiting for a pose"), "{log}");
}
