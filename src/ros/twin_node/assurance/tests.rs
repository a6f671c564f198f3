#![allow(clippy::unwrap_used)]
use proptest::prelude::*;

use super::*;
use crate::ros::twin_node::declared::declarations;

const TIMEOUT: Duration = Duration::from_millis(25);

fn settings(band_n: f64) -> Settings {
    let (parameters, _) = Parameters::declare(declarations(), &[], "/twin").unwrap();
    Settings { residual_band_n: band_n, ..Settings::of(&parameters) }
}

/// The two clocks at a time after the start.
struct Clocks(Instant);

impl Clocks {
    fn now(&self, ms: u64) -> Now {
        let nanos = i64::try_from(ms * 1_000_000).unwrap();
        Now { steady: self.0 + Duration::from_millis(ms), node_nanos: Some(1_000_000_000_000 + nanos) }
    }

    /// A message received at a time, with an offset of its stamp.
    fn seen(&self, ms: u64, off_ms: i64) -> Seen {
        let Now { steady, node_nanos } = self.now(ms);
        Seen { received: steady, stamp_nanos: node_nanos.unwrap() + off_ms * 1_000_000 }
    }
}

fn agreement(received: Instant, error_n: f64, error_nm: Option<f64>) -> Agreement {
    Agreement { pose_received: received, reading_received: received, error_n, error_nm, measured_n: 0.1 }
}

/// Judges every millisecond, with the messages from `evidence`; returns the times of each "safe", ms.
fn yes(
    settings: &Settings,
    ms: std::ops::Range<u64>,
    assured: &mut Assured,
    evidence: impl Fn(u64, &mut Assured, &Clocks),
) -> Vec<u64> {
    let clocks = Clocks(Instant::now());
    ms.filter(|ms| {
        evidence(*ms, assured, &clocks);
        let verdict = assured.judge(Vec::new(), settings, &clocks.now(*ms));
        assert_eq!(assured.safe, verdict.reasons.is_empty(), "a no has a reason");
        assured.safe
    })
    .collect()
}

/// A valid pose and reading per ms.
fn well(ms: u64, assured: &mut Assured, clocks: &Clocks) {
    let seen = clocks.seen(ms, -1);
    assured.pose = Some((seen, 0.1, [0.0, 0.0, -1.0]));
    assured.cell = Cell { usable: Some((seen.stamp_nanos, seen.received)), fault: None };
    assured.agreement = Some(agreement(seen.received, 0.001, None));
}

/// The last "safe" after a fault that begins at 1 s, and their number.
fn after_fault(band_n: f64, fault: impl Fn(u64, &mut Assured, &Clocks)) -> (u64, usize) {
    let settings = settings(band_n);
    let mut assured = Assured::new(0.01);
    let said = yes(&settings, 0..4000, &mut assured, |ms, assured, clocks| {
        if ms < 1000 { well(ms, assured, clocks) } else { fault(ms, assured, clocks) }
    });
    let before = said.iter().filter(|ms| **ms < 1000).count();
    assert_eq!(before, 900, "all is well from {HOLD:?} on");
    let last = said.last().unwrap().saturating_sub(999);
    (last, said.len() - before)
}

#[test]
fn no_fault_of_the_evidence_leaves_a_yes_longer_than_the_timeout_and_none_comes_later() {
    let limit = u64::try_from(TIMEOUT.as_millis()).unwrap();
    type Fault = fn(u64, &mut Assured, &Clocks);
    let faults: [(&str, f64, u64, Fault); 9] = [
        ("poses silent", 0.0, limit, |_, _, _| ()),
        ("load cell silent", 0.02, limit, |ms, assured, clocks| {
            let cell = assured.cell;
            well(ms, assured, clocks);
            assured.cell = cell;
        }),
        ("load cell not finite", 0.02, 0, |ms, assured, clocks| {
            well(ms, assured, clocks);
            assured.cell.fault = Some(ForceComparison::LOAD_CELL_NOT_FINITE);
        }),
        ("poses late", 0.0, 0, |ms, assured, clocks| {
            well(ms, assured, clocks);
            assured.pose.as_mut().unwrap().0 = clocks.seen(ms, -1000);
        }),
        ("poses early", 0.0, 0, |ms, assured, clocks| {
            well(ms, assured, clocks);
            assured.pose.as_mut().unwrap().0 = clocks.seen(ms, 500);
        }),
        ("load cell's clock ahead", 0.02, 0, |ms, assured, clocks| {
            well(ms, assured, clocks);
            assured.cell.usable = Some((clocks.seen(ms, 500).stamp_nanos, clocks.seen(ms, 0).received));
        }),
        ("50 N across", 0.02, 0, |ms, assured, clocks| {
            well(ms, assured, clocks);
            assured.agreement = Some(agreement(clocks.now(ms).steady, 50.0, None));
        }),
        ("torque", 0.02, 0, |ms, assured, clocks| {
            well(ms, assured, clocks);
            assured.agreement = Some(agreement(clocks.now(ms).steady, 0.0, Some(1.0)));
        }),
        ("old comparisons made again", 0.02, 2 * limit, |ms, assured, clocks| {
            let old = assured.agreement;
            well(ms, assured, clocks);
            assured.agreement = old;
        }),
    ];
    for (name, band_n, limit, fault) in faults {
        let (last, count) = after_fault(band_n, fault);
        assert!(last <= limit + 1 && count as u64 <= last, "{name}: {count} yes, the last after {last} ms");
    }
}

#[test]
fn a_residual_that_passes_through_the_band_is_no_agreement() {
    // from beyond the band through it in a quarter of a second, to a constant value within the band but beyond half
    // of it
    let (last, count) = after_fault(0.02, |ms, assured, clocks| {
        well(ms, assured, clocks);
        let error_n = (0.05 - (ms - 1000) as f64 * 2e-4).max(-0.015).abs();
        assured.agreement = Some(agreement(clocks.now(ms).steady, error_n, None));
    });
    assert_eq!((last, count), (0, 0));
}

#[test]
fn without_a_band_the_load_cell_is_not_asked() {
    let (last, count) = after_fault(0.0, |ms, assured, clocks| {
        well(ms, assured, clocks);
        assured.cell.fault = Some(ForceComparison::LOAD_CELL_STUCK);
    });
    assert_eq!((last, count), (3000, 3000));
}

#[test]
fn the_force_limit_is_of_the_predicted_and_of_the_measured_force() {
    let settings = Settings { force_limit_n: 0.1, ..settings(0.02) };
    let mut assured = Assured::new(0.0);
    assert!(yes(&settings, 0..500, &mut assured, well).is_empty(), "0.1 N are at the limit");
    let said = yes(&settings, 500..1000, &mut assured, |ms, assured, clocks| {
        well(ms, assured, clocks);
        assured.pose.as_mut().unwrap().1 = 0.02;
        assured.agreement.as_mut().unwrap().measured_n = 0.05;
    });
    assert_eq!(said.len(), 400);
}

#[test]
fn a_parameter_that_changes_is_a_no_once_even_if_it_loosens() {
    let narrow = Settings { guard_timeout_s: 0.025, ..settings(0.02) };
    let mut assured = Assured::new(0.0);
    assert_eq!(yes(&narrow, 0..500, &mut assured, well).last(), Some(&499));
    for wide in [settings(20.0), settings(0.0), Settings { guard_timeout_s: 25.0, ..narrow.clone() }] {
        let said = yes(&wide, 500..1000, &mut assured, well);
        assert_eq!(said.first(), Some(&601), "a yes only when all was well for {HOLD:?} under the new terms");
        assert_eq!(yes(&narrow, 500..1000, &mut assured, well).first(), Some(&601));
    }
}

/// A possible event in a millisecond.
#[derive(Clone, Copy, Debug)]
enum Step {
    Pose { off_ms: i64 },
    Reading { off_ms: i64, fault: bool },
    Compared { age_ms: u64, error_n: f64 },
    Denied,
    Nothing,
    Frozen { ms: u64 },
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        6 => (-40..40_i64).prop_map(|off_ms| Step::Pose { off_ms }),
        6 => (-40..40_i64, prop::bool::weighted(0.1)).prop_map(|(off_ms, fault)| Step::Reading { off_ms, fault }),
        6 => (0..80_u64, 0.0..0.03).prop_map(|(age_ms, error_n)| Step::Compared { age_ms, error_n }),
        1 => Just(Step::Denied),
        4 => Just(Step::Nothing),
        1 => (1..3000_u64).prop_map(|ms| Step::Frozen { ms }),
    ]
}

/// Mostly valid evidence, since purely random evidence is almost never valid.
fn run() -> impl Strategy<Value = Vec<(u64, Option<Step>)>> {
    prop::collection::vec((1..200_u64, prop::option::weighted(0.7, step())), 1..60)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// For any sequence of events: at each "safe" there are a pose and a reading that were received, and are stamped,
    /// within the timeout. Their comparison is within the band, and these conditions have held for 100 ms.
    #[test]
    fn every_yes_has_fresh_evidence(steps in run()) {
        let (settings, clocks, mut assured) = (settings(0.02), Clocks(Instant::now()), Assured::new(0.0));
        let (mut ms, mut bad) = (0, 0);
        for (pause, step) in steps {
            for _ in 0..pause {
                ms += 1;
                well(ms, &mut assured, &clocks);
                assured.judge(Vec::new(), &settings, &clocks.now(ms));
            }
            let mut denials = Vec::new();
            ms += 1;
            match step {
                Some(Step::Pose { off_ms }) => assured.pose = Some((clocks.seen(ms, off_ms), 0.1, [0.0; 3])),
                Some(Step::Reading { off_ms, fault }) => {
                    let seen = clocks.seen(ms, off_ms);
                    let fault = fault.then_some(ForceComparison::LOAD_CELL_NOT_FINITE);
                    assured.cell = Cell { usable: Some((seen.stamp_nanos, seen.received)), fault };
                }
                Some(Step::Compared { age_ms, error_n }) => {
                    let received = clocks.now(ms.saturating_sub(age_ms)).steady;
                    assured.agreement = Some(agreement(received, error_n, None));
                }
                Some(Step::Denied) => denials.push("no".to_owned()),
                Some(Step::Frozen { ms: frozen }) => ms += frozen,
                Some(Step::Nothing) | None => {}
            }
            let now = clocks.now(ms);
            let denied = !denials.is_empty();
            let verdict = assured.judge(denials, &settings, &now);
            if !assured.safe {
                bad = if verdict.reasons[0].starts_with("all is well") { bad } else { ms };
                continue;
            }
            prop_assert!(!denied && assured.cell.fault.is_none());
            prop_assert!(ms - bad >= 100, "a yes {} ms after a fault", ms - bad);
            for seen in [assured.pose.unwrap().0, assured.reading().unwrap()] {
                let age = now.steady - seen.received;
                let off = (now.node_nanos.unwrap() - seen.stamp_nanos).unsigned_abs();
                prop_assert!(age <= TIMEOUT && Duration::from_nanos(off) <= TIMEOUT, "{age:?} {off}");
            }
            let agreement = assured.agreement.unwrap();
            prop_assert!(agreement.error_n < 0.02 && now.steady - agreement.reading_received <= 2 * TIMEOUT);
        }
    }
}
