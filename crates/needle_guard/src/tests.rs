#![allow(clippy::panic)]

use super::*;

const ORDERS: Orders = Orders {
    motion: MotionLimits { speed_m_per_s: 0.002, acceleration_m_per_s2: 0.5, jerk_m_per_s3: 100.0 },
    step_s: 0.004,
    force_limit_n: 0.1,
    max_probability_of_force_limit: 1.0,
    max_probability_of_miss: 1.0,
    look_ahead_m: 5e-4,
    miss_radius_m: 1e-3,
    outlook_timeout_s: 0.5,
    timeout_s: 0.025,
    target_timeout_s: 0.2,
    tolerance_m: 1e-4,
    dwell_s: 0.1,
    following_error_m: 5e-4,
    slow_factor: 0.5,
    stop_before_m: None,
    resume_after_s: 0.0,
};

fn now<T>(value: T) -> Option<Heard<T>> {
    Some(Heard::unstamped(value, 0.001))
}

fn well(depth_m: f64) -> Sight {
    Sight {
        depth_m: now(depth_m),
        force_n: now(0.01),
        safe: now(true),
        held_up_s: 0.004,
        two_publish: None,
        warned: false,
        goal_m: now(0.005),
        boundary: None,
        odds: None,
        goal_moves: true,
        twin_offset_m: None,
    }
}

/// Runs ticks with a driver that follows its setpoint, and with changes to the received values.
fn run(guard: &mut Guard, depth_m: &mut f64, ticks: usize, change: impl Fn(&mut Sight)) {
    for _ in 0..ticks {
        let mut sight = well(*depth_m);
        change(&mut sight);
        *depth_m = guard.tick(&sight).unwrap_or(*depth_m);
    }
}

fn moving() -> (Guard, f64) {
    let (mut guard, mut depth_m) = (Guard::new(ORDERS), 0.001);
    run(&mut guard, &mut depth_m, 100, |_| {});
    assert_eq!(guard.phase(), Phase::Moving);
    assert!((guard.speed_m_per_s() - 0.002).abs() < 1e-9);
    (guard, depth_m)
}

#[test]
fn it_starts_where_the_needle_is_and_arrives() {
    let (mut guard, mut depth_m) = moving();
    assert!(depth_m > 0.001 && depth_m < 0.002);
    run(&mut guard, &mut depth_m, 600, |_| {});
    assert_eq!((guard.phase(), depth_m), (Phase::Arrived, 0.005));
    // the tissue has moved on
    run(&mut guard, &mut depth_m, 200, |s| s.goal_m = now(0.0052));
    assert_eq!(depth_m, 0.0052);
}

#[test]
fn a_twin_whose_pose_departs_from_the_needle_stops_it() {
    let (mut guard, mut depth_m) = (Guard::new(ORDERS), 0.001);
    // a difference of the sensors' zeros is no fault
    run(&mut guard, &mut depth_m, 100, |s| s.twin_offset_m = Some(3e-4));
    assert_eq!(guard.phase(), Phase::Moving);
    run(&mut guard, &mut depth_m, 10, |s| s.twin_offset_m = None);
    run(&mut guard, &mut depth_m, 10, |s| s.twin_offset_m = Some(2.1e-4));
    assert_eq!(guard.phase(), Phase::Moving);
    run(&mut guard, &mut depth_m, 1, |s| s.twin_offset_m = Some(1.9e-4));
    assert!(matches!(guard.phase(), Phase::Stopped(Trouble::OtherPose(_))), "{:?}", guard.phase());
}

#[test]
fn it_says_nothing_before_all_is_well() {
    let mut guard = Guard::new(ORDERS);
    assert_eq!(guard.tick(&Sight::default()), None);
    assert_eq!(guard.phase(), Phase::Waiting(Some(Trouble::PositionLost)));
    assert_eq!(guard.tick(&Sight { safe: now(false), ..well(0.0) }), None);
    assert_eq!(guard.phase(), Phase::Waiting(Some(Trouble::NotVouched)));
    assert!(guard.tick(&well(0.0)).is_some());
}

#[test]
fn every_trouble_stops_it_within_the_braking_time_for_good() {
    type Change = fn(&mut Sight);
    let troubles: [(Change, Trouble); 14] = [
        (|s| s.depth_m = s.depth_m.map(|h| Heard { age_s: 0.026, ..h }), Trouble::PositionLost),
        (|s| s.depth_m = now(f64::NAN), Trouble::PositionLost),
        (|s| s.force_n = s.force_n.map(|h| Heard { age_s: 0.026, ..h }), Trouble::PredictionLost),
        (|s| s.force_n = now(f64::NAN), Trouble::PredictionLost),
        (|s| s.safe = now(false), Trouble::NotVouched),
        (|s| s.safe = None, Trouble::NotVouched),
        (|s| s.goal_m = s.goal_m.map(|h| Heard { age_s: 0.21, ..h }), Trouble::TargetLost),
        (|s| s.force_n = now(0.099), Trouble::ForceLimit(0.099)),
        (|s| s.held_up_s = 2.0, Trouble::HeldUp(2.0)),
        (|s| s.two_publish = Some("safety"), Trouble::TwoPublish("safety")),
        (|s| s.depth_m = s.depth_m.map(|h| Heard { since_stamp_s: 1.0, ..h }), Trouble::PositionStamp(1.0)),
        (|s| s.depth_m = s.depth_m.map(|h| Heard { since_stamp_s: -0.5, ..h }), Trouble::PositionStamp(-0.5)),
        (|s| s.force_n = s.force_n.map(|h| Heard { since_stamp_s: 0.1, ..h }), Trouble::PredictionLate(0.1)),
        (|s| s.safe = s.safe.map(|h| Heard { since_stamp_s: f64::INFINITY, ..h }), Trouble::SafetyStamp(f64::INFINITY)),
    ];
    for (change, trouble) in troubles {
        let (mut guard, mut depth_m) = moving();
        // 2 sqrt(V/J) = 9 ms, in steps of 4 ms
        run(&mut guard, &mut depth_m, 4, change);
        assert_eq!(guard.phase(), Phase::Stopped(trouble));
        assert_eq!(guard.speed_m_per_s(), 0.0, "{trouble}");
        let stood = depth_m;
        run(&mut guard, &mut depth_m, 500, |_| {});
        assert_eq!((depth_m, guard.phase()), (stood, Phase::Stopped(trouble)), "until somebody says so");
        assert!(guard.resume());
        run(&mut guard, &mut depth_m, 1500, |_| {});
        assert_eq!((depth_m, guard.phase()), (0.005, Phase::Arrived));
    }
}

#[test]
fn a_guard_that_was_held_up_does_not_move_a_needle_that_stands() {
    let (mut guard, mut depth_m) = moving();
    let before = depth_m;
    run(&mut guard, &mut depth_m, 1, |s| s.held_up_s = 2.0);
    run(&mut guard, &mut depth_m, 100, |_| {});
    assert_eq!((depth_m, guard.phase()), (before, Phase::Stopped(Trouble::HeldUp(2.0))));
}

#[test]
fn a_driver_that_does_not_follow_is_noticed() {
    let (mut guard, depth_m) = moving();
    for _ in 0..100 {
        guard.tick(&well(depth_m));
    }
    assert!(matches!(guard.phase(), Phase::Stopped(Trouble::NotFollowing(gap)) if gap < 6e-4), "{:?}", guard.phase());
}

#[test]
fn it_slows_down_before_it_stops() {
    let (mut guard, mut depth_m) = moving();
    run(&mut guard, &mut depth_m, 20, |s| s.warned = true);
    assert!((guard.speed_m_per_s() - 0.001).abs() < 1e-9, "{}", guard.speed_m_per_s());
    run(&mut guard, &mut depth_m, 20, |s| s.force_n = now(0.095));
    assert!((guard.speed_m_per_s() - 0.0005).abs() < 1e-9, "{}", guard.speed_m_per_s());
    assert_eq!(guard.phase(), Phase::Moving);
}

#[test]
fn a_force_that_rises_with_depth_stays_under_the_limit() {
    let (mut guard, mut depth_m) = (Guard::new(ORDERS), 0.0);
    // 50 N/m, received with a delay of 20 ms
    let mut forces = std::collections::VecDeque::from([0.0; 5]);
    let mut most = 0.0_f64;
    for _ in 0..5000 {
        forces.push_back(50.0 * depth_m);
        let heard = forces.pop_front().unwrap_or(0.0);
        depth_m = guard.tick(&Sight { force_n: now(heard), ..well(depth_m) }).unwrap_or(depth_m);
        most = most.max(50.0 * depth_m);
    }
    assert!(matches!(guard.phase(), Phase::Stopped(Trouble::ForceLimit(_))), "{:?}", guard.phase());
    assert!(most < 0.1 && most > 0.09, "{most}");
}

#[test]
fn it_goes_on_by_itself_only_when_told_so_and_when_all_has_been_well_for_long_enough() {
    let mut guard = Guard::new(Orders { resume_after_s: 0.2, ..ORDERS });
    let mut depth_m = 0.0;
    run(&mut guard, &mut depth_m, 50, |_| {});
    run(&mut guard, &mut depth_m, 10, |s| s.safe = now(false));
    run(&mut guard, &mut depth_m, 49, |_| {});
    assert_eq!(guard.phase(), Phase::Stopped(Trouble::NotVouched));
    run(&mut guard, &mut depth_m, 3, |_| {});
    assert_eq!(guard.phase(), Phase::Moving);
}

#[test]
fn where_probabilities_are_ordered_they_decide_in_place_of_the_force() {
    let orders = Orders { max_probability_of_force_limit: 0.05, max_probability_of_miss: 0.2, ..ORDERS };
    let odds = |force_limit, miss| now(Odds { force_limit, miss, used: 0.0 });
    let (mut guard, mut depth_m) = (Guard::new(orders), 0.001);
    run(&mut guard, &mut depth_m, 10, |_| {});
    assert_eq!(guard.phase(), Phase::Waiting(Some(Trouble::OutlookLost)), "it does not begin without an outlook");
    // a predicted force far beyond the limit, from a model that the members have proved wrong
    run(&mut guard, &mut depth_m, 100, |s| (s.odds, s.force_n) = (odds(0.01, 0.0), now(0.5)));
    assert_eq!(guard.phase(), Phase::Moving);
    assert!((guard.speed_m_per_s() - 0.002).abs() < 1e-9, "{}", guard.speed_m_per_s());
    run(&mut guard, &mut depth_m, 20, |s| s.odds = odds(0.045, 0.0));
    assert!((guard.speed_m_per_s() - 0.001).abs() < 1e-9, "half of what is left from 80 %: {}", guard.speed_m_per_s());
    run(&mut guard, &mut depth_m, 20, |s| s.odds = odds(0.0, 0.19));
    assert!((guard.speed_m_per_s() - 5e-4).abs() < 1e-9, "{}", guard.speed_m_per_s());
    run(&mut guard, &mut depth_m, 20, |s| s.odds = now(Odds { used: 0.95, ..Odds::default() }));
    assert!((guard.speed_m_per_s() - 5e-4).abs() < 1e-9, "the outlook must not be outrun: {}", guard.speed_m_per_s());
    type Case = (Option<Heard<Odds>>, Trouble, &'static str);
    let cases: [Case; 3] = [
        (odds(0.049, 0.0), Trouble::ForceLikely(0.049), "limit"),
        (odds(0.0, 0.25), Trouble::MissLikely(0.25), "missed"),
        (Some(Heard::unstamped(Odds::default(), 0.6)), Trouble::OutlookLost, "outlook"),
    ];
    for (said, trouble, word) in cases {
        let (mut guard, mut depth_m) = (Guard::new(orders), 0.001);
        run(&mut guard, &mut depth_m, 100, |s| s.odds = odds(0.0, 0.0));
        run(&mut guard, &mut depth_m, 4, |s| s.odds = said);
        assert_eq!((guard.phase(), guard.speed_m_per_s()), (Phase::Stopped(trouble), 0.0));
        assert!(trouble.to_string().contains(word), "{trouble}");
    }
}

#[test]
fn leaving_brakes_first() {
    let (mut guard, depth_m) = moving();
    let places: Vec<f64> = std::iter::from_fn(|| guard.leave()).collect();
    assert!((2..=4).contains(&places.len()) && places.iter().all(|p| *p >= depth_m), "{places:?}");
    assert_eq!(guard.speed_m_per_s(), 0.0);
}

#[test]
fn it_stops_before_a_region_that_moves_and_not_without_knowing_where_it_is() {
    let orders = Orders { stop_before_m: Some(3e-4), ..ORDERS };
    let (mut guard, mut depth_m) = (Guard::new(orders), 0.001);
    run(&mut guard, &mut depth_m, 10, |_| {});
    assert_eq!(guard.phase(), Phase::Waiting(Some(Trouble::RegionUnknown)));
    // the needle displaces the boundary
    let at = |depth_m: f64, s: &mut Sight| {
        s.boundary = now(Boundary { depth_m: 3e-3 + 0.1 * (depth_m - 1e-3), predicted: true });
        s.depth_m = now(depth_m);
    };
    for _ in 0..1000 {
        let mut sight = well(depth_m);
        at(depth_m, &mut sight);
        depth_m = guard.tick(&sight).unwrap_or(depth_m);
    }
    let Phase::Stopped(Trouble::RegionAhead(boundary)) = guard.phase() else { panic!("{:?}", guard.phase()) };
    assert!(boundary.predicted && boundary.depth_m > 3.1e-3, "{boundary:?}");
    let left = boundary.depth_m - depth_m;
    assert!(left > 3e-4 - 1e-6 && left < 4.2e-4, "{left} m before it");
    assert!(Trouble::RegionAhead(boundary).to_string().contains("predicts"));
    // it does not resume either
    assert!(guard.resume());
    let held = depth_m;
    for _ in 0..100 {
        let mut sight = well(depth_m);
        at(depth_m, &mut sight);
        depth_m = guard.tick(&sight).unwrap_or(depth_m);
    }
    assert_eq!(depth_m, held);
    // a boundary that is no longer received
    let (mut guard, mut depth_m) = (Guard::new(orders), 0.001);
    let far = Boundary { depth_m: 0.01, predicted: false };
    run(&mut guard, &mut depth_m, 100, |s| s.boundary = now(far));
    assert_eq!(guard.phase(), Phase::Moving);
    run(&mut guard, &mut depth_m, 1, |s| s.boundary = Some(Heard::unstamped(far, 0.6)));
    assert_eq!(guard.phase(), Phase::Stopped(Trouble::RegionUnknown));
}
