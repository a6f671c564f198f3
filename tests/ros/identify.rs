//! Identification while it runs: what it finds on the shipped bags, how soon, and what makes it stop learning.
#![allow(clippy::unwrap_used, clippy::panic)]

use crate::ros::{Peer, Program, TWIN, free_domain};
use needle_core::scene::{Override, Scene};
use needle_core::twin::Phase;
use needle_estimate::compare::identifier::{Cause, Identifier, Parameter, State};
use needle_estimate::compare::{Keep, Run, Session};
use needle_recording::{At, ForceSeries, Reading};
use needle_recording::{Recording, TopicNames};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng as _;
use rand_distr::{Distribution as _, StandardNormal};
use serde_json::json;

/// A shipped bag through the twin of its scene with some keys changed.
fn replayed(bag: &str, changes: &[(&str, f64)]) -> Run {
    let path = format!("{}/bags/{bag}", env!("CARGO_MANIFEST_DIR"));
    let recording = Recording::load(path, &TopicNames::default()).unwrap();
    let changes: Vec<_> = changes.iter().map(|(key, value)| Override::typed(key, *value, "test")).collect();
    let scene = Scene::preset(bag).unwrap().with(&changes).unwrap();
    let readings: Vec<Reading> =
        recording.depths.iter().map(|s| Reading { time_s: s.time_s, at: At::Depth(s.depth_m) }).collect();
    let measured = ForceSeries::new(recording.forces.iter().map(|s| (s.time_s, s.force_n)).collect());
    Session::new(&scene, "test", Keep::ANSWERS).unwrap().compared_with(&measured).unwatched(readings)
}

/// (time since the instrument began to move the tissue, value, standard error, state) after every reading.
fn followed(run: &Run, identifier: &mut Identifier, parameter: Parameter) -> Vec<(f64, f64, f64, State)> {
    let contact = run.answers.iter().find(|a| a.depth_m > 0.0).unwrap().time_s;
    let readings = run.answers.iter().filter_map(|a| a.measured_n.map(|m| (a, m)));
    let mut seen = Vec::new();
    for (a, measured_n) in readings {
        let inserted = matches!(a.phase, Phase::Penetration | Phase::Retraction);
        identifier.update(a.time_s, a.predicted_n, inserted, measured_n, 0.0);
        let (value, error) = identifier.estimate(parameter).unwrap();
        seen.push((a.time_s - contact, value, error, identifier.state()));
    }
    seen
}

/// Within 5 %, but the needle's is said to be known to 3 % half a second later: two seconds are 2 mm of insertion there, and over the first of them the
/// bag's force is a cubic from the origin to the reference's first point, 5 to 7 % above both the preset's and a fine cloud's (0.40 mN at 0.5 mm).
#[test]
fn shipped_bags_give_what_made_them_within_two_seconds_of_motion_in_the_tissue() {
    use Parameter::{DeformationCoefficient as Coefficient, Offset, ShearModulus};
    let cases = [
        // the scene is off by 40 % and by 25 %: what has to be found is what made the bag
        ("compression", "material.shear_modulus_pa", 1678.0, 1200.0, ShearModulus),
        ("indentation", "material.shear_modulus_pa", 1678.0, 2100.0, ShearModulus),
        ("needle_insertion", "material.shear_modulus_pa", 1678.0, 2500.0, ShearModulus),
        ("needle_insertion", "instrument.deformation_coefficient", 0.4, 0.5, Coefficient),
    ];
    for (bag, key, truth, start, parameter) in cases {
        let mut changes = vec![(key, start)];
        if parameter == Coefficient {
            changes.push(("instrument.retraction_coefficient", start));
        }
        let run = replayed(bag, &changes);
        let mut identifier =
            Identifier::new(&[parameter, Offset], if parameter == ShearModulus { start } else { 1678.0 }, start);
        let seen = followed(&run, &mut identifier, parameter);
        let converged = seen.iter().find(|(_, _, _, state)| *state == State::Converged).unwrap();
        let from_two: Vec<_> = seen.iter().filter(|(t, ..)| *t >= 2.0).collect();
        let worst = from_two.iter().map(|(_, v, ..)| (v / truth - 1.0).abs()).fold(0.0, f64::max);
        let outside = from_two.iter().filter(|(_, v, e, _)| (v - truth).abs() > 1.96 * e).count();
        let last = seen.last().unwrap();
        let (offset, offset_error) = identifier.estimate(Offset).unwrap();
        println!(
            "{bag} {key}: converged {:.2} s after contact, worst from 2 s on {:.2} %, at the end {:.5} +- {:.5}, \
             {outside} of {} outside 95 %, offset {:.2} +- {:.2} mN",
            converged.0,
            100.0 * worst,
            last.1,
            last.2,
            from_two.len(),
            1e3 * offset,
            1e3 * offset_error
        );
        assert!(converged.0 <= if bag == "needle_insertion" { 2.5 } else { 2.0 }, "{bag}: {converged:?}");
        assert!(worst <= 0.05, "{bag}: {worst}");
        assert!((last.1 / truth - 1.0).abs() <= 0.03, "{bag}: {last:?}");
        assert!(!seen.iter().any(|(.., state)| matches!(state, State::Frozen(_))), "{bag}: frozen on a good recording");
        assert!(outside * 10 <= from_two.len(), "{bag}: {outside} of {}", from_two.len());
    }
}

/// A cone pressed in and held by a press that rests now and then: predicted force, N.
fn predicted(time_s: f64) -> f64 {
    let depth = (time_s - 1.0).clamp(0.0, 6.0);
    0.002 * depth * depth
}

/// What a load cell says, 200 times a second from `from_s`: `truth` of time and predicted force, N, with noise.
fn stream(identifier: &mut Identifier, span_s: [f64; 2], truth: impl Fn(f64, f64) -> f64) -> Vec<(f64, State)> {
    let mut generator = ChaCha8Rng::seed_from_u64(7);
    let readings = ((span_s[1] - span_s[0]) * 200.0) as u32;
    let mut changes = Vec::new();
    for i in 0..readings {
        let time_s = span_s[0] + f64::from(i) / 200.0;
        let noise: f64 = StandardNormal.sample(&mut generator);
        let measured = truth(time_s, predicted(time_s)) + 4e-4 * noise;
        changes.extend(identifier.update(time_s, predicted(time_s), true, measured, 0.0).map(|state| (time_s, state)));
    }
    changes
}

fn modulus_and_offset() -> Identifier {
    Identifier::new(&[Parameter::ShearModulus, Parameter::Offset], 1000.0, 0.4)
}

#[test]
fn a_stream_gives_scale_and_offset_with_errors_that_are_true() {
    let mut identifier = modulus_and_offset();
    let changes = stream(&mut identifier, [0.0, 7.0], |_, f| 1.3 * f + 0.002);
    assert!(changes.iter().any(|(_, state)| *state == State::Converged), "{changes:?}");
    let (modulus, error) = identifier.estimate(Parameter::ShearModulus).unwrap();
    assert!(
        (modulus - 1300.0).abs() < 0.01 * 1300.0 && (0.012..0.02).contains(&(error / modulus)),
        "{modulus} {error}"
    );
    let (offset, error) = identifier.estimate(Parameter::Offset).unwrap();
    assert!((offset - 0.002).abs() < 3.0 * error && error < 1.5e-4, "{offset} {error}");
    assert_eq!(identifier.estimate(Parameter::DeformationCoefficient), None, "it was not asked for");
    assert!((identifier.expected_n(0.05, true) - (1.3 * 0.05 + 0.002)).abs() < 1e-3);
    identifier.reset();
    assert_eq!(identifier.estimate(Parameter::ShearModulus).unwrap().0, 1000.0);
}

#[test]
fn what_only_scales_the_force_twice_is_not_known_apart() {
    let all = [Parameter::ShearModulus, Parameter::DeformationCoefficient, Parameter::Offset];
    let mut identifier = Identifier::new(&all, 1000.0, 0.4);
    let changes = stream(&mut identifier, [0.0, 7.0], |_, f| 1.3 * f);
    assert!(!changes.iter().any(|(_, state)| *state == State::Converged), "{changes:?}");
    let [(modulus, error), (coefficient, _)] = [all[0], all[1]].map(|p| identifier.estimate(p).unwrap());
    assert!((modulus / 1000.0 * coefficient / 0.4 - 1.3).abs() < 0.02, "their product is known");
    assert!(error > 0.2 * modulus, "and neither of them: {error}");
}

#[test]
fn what_the_model_cannot_explain_freezes_and_is_not_learnt() {
    // what happens at 4 s, when the force is 23 mN: (measured force, what is said of it)
    type Truth = fn(f64, f64) -> f64;
    // whether it is a jump: a gradual change may be seen as either
    let cases: [(&str, Truth, bool); 4] = [
        ("a knock on the load cell", |t, f| f + if t < 4.0 { 0.0 } else { 0.01 }, true),
        ("a slip", |t, f| if t < 4.0 { f } else { 0.5 * f }, true),
        ("the reading stands still", |t, f| if t < 4.0 { f } else { predicted(4.0) }, false),
        ("the tissue yields", |t, f| f * (1.0 - 0.5 * (t - 4.0).clamp(0.0, 1.0)), false),
    ];
    for (what, truth, sudden) in cases {
        let mut identifier = modulus_and_offset();
        let changes = stream(&mut identifier, [0.0, 7.0], truth);
        let frozen =
            changes.iter().find_map(|(t, s)| if let State::Frozen(cause) = s { Some((*t, *cause)) } else { None });
        let (at, cause) = frozen.unwrap_or_else(|| unreachable!("{what}: nothing was noticed, {changes:?}"));
        println!("{what}: {:.3} s later: {cause}", at - 4.0);
        assert!((4.0..4.7).contains(&at), "{what}: {at}");
        assert!(!sudden || matches!(cause, Cause::Jump(n) if n.abs() > 3e-3), "{what}: {cause:?}");
        assert!(cause != Cause::Sensor, "{what}: {cause:?}");
        assert!(matches!(identifier.state(), State::Frozen(_)), "{what}: it stays wrong, so nothing is learnt");
        let (modulus, _) = identifier.estimate(Parameter::ShearModulus).unwrap();
        let (offset, _) = identifier.estimate(Parameter::Offset).unwrap();
        println!("  {modulus:.1} Pa, {:.3} mN", 1e3 * offset);
        assert!((modulus / 1000.0 - 1.0).abs() < 0.03, "{what}: {modulus}");
        assert!(offset.abs() < 5e-4, "{what}: {offset}");
    }
}

#[test]
fn a_knock_is_noticed_from_a_few_millinewtons_on() {
    let noticed = |knock_n: f64| {
        let mut identifier = modulus_and_offset();
        let changes = stream(&mut identifier, [0.0, 6.0], |t, f| f + if t < 4.0 { 0.0 } else { knock_n });
        changes.iter().any(|(t, s)| *t > 4.0 && matches!(s, State::Frozen(_)))
    };
    let least = (1..40).map(|k| 5e-4 * f64::from(k)).find(|k| noticed(*k)).unwrap();
    println!("noise 0.4 mN, force 18 mN: noticed from {:.1} mN on", 1e3 * least);
    assert!(!noticed(0.0) && (1e-3..=8e-3).contains(&least), "{least}");
    assert!([1.0, 1.5, 3.0].iter().all(|more| noticed(more * least)));
}

#[test]
fn it_goes_on_when_the_residual_is_right_again_and_a_fault_of_the_cell_stops_it_at_once() {
    let mut identifier = modulus_and_offset();
    // a slip that catches again after a second
    let slip = |t: f64, f: f64| if (4.0..5.0).contains(&t) { 0.5 * f } else { f };
    let changes = stream(&mut identifier, [0.0, 7.0], slip);
    let states: Vec<State> = changes.iter().map(|(_, state)| *state).collect();
    assert!(states.iter().any(|s| matches!(s, State::Frozen(_))), "{changes:?}");
    assert_eq!(identifier.state(), State::Converged, "{changes:?}");
    let (modulus, _) = identifier.estimate(Parameter::ShearModulus).unwrap();
    assert!((modulus / 1000.0 - 1.0).abs() < 0.01, "{modulus}");
    let told = identifier.fault();
    assert_eq!(told, Some(State::Frozen(Cause::Sensor)));
    assert_eq!(identifier.fault(), None, "said once");
    let again = stream(&mut identifier, [7.0, 8.0], |_, f| f);
    assert!(matches!(again[..], [(t, State::Converged)] if (7.45..7.6).contains(&t)), "{again:?}");
    // nonsense changes nothing
    let before = identifier.estimate(Parameter::ShearModulus);
    assert_eq!(identifier.update(f64::NAN, 0.1, true, 0.1, 0.0), None);
    assert_eq!(identifier.update(9.0, 0.1, true, f64::INFINITY, 0.0), None);
    assert_eq!(identifier.estimate(Parameter::ShearModulus), before);
}

#[test]
fn the_force_goes_with_modulus_and_coefficient_as_the_filter_takes_it() {
    let forces = |changes: &[(&str, f64)]| -> Vec<(f64, f64)> {
        replayed("needle_insertion", changes).answers.iter().map(|a| (a.depth_m, a.predicted_n)).collect()
    };
    let base = forces(&[]);
    let stiff = forces(&[("material.shear_modulus_pa", 1.5 * 1678.0)]);
    let more = forces(&[("instrument.deformation_coefficient", 0.44), ("instrument.retraction_coefficient", 0.44)]);
    let deep = || (0..base.len()).filter(|&i| base[i].0 >= 2e-3);
    let worst = |of: &[(f64, f64)], factor: f64| {
        deep().map(|i| (of[i].1 / (factor * base[i].1) - 1.0).abs()).fold(0.0, f64::max)
    };
    let (modulus, coefficient) = (worst(&stiff, 1.5), worst(&more, 1.1));
    println!(
        "modulus x 1.5: force x 1.5 within {:.3} %; coefficient x 1.1: force x 1.1 within {:.2} %",
        100.0 * modulus,
        100.0 * coefficient
    );
    // at this pace any change of the stepping moves the force at 2 to 3 mm by up to 1 % (docs/lab/constants.md): 0.7 to 1.1 % were seen
    assert!(modulus < 0.015, "{modulus}");
    assert!(coefficient < 0.015, "{coefficient}");
}

#[test]
fn the_node_publishes_what_it_identifies_in_comparison_and_diagnostics() {
    let domain = free_domain();
    let bag = format!("{}/bags/compression", env!("CARGO_MANIFEST_DIR"));
    let wanted = "identify:=[material.shear_modulus_pa, load_cell.offset_n]";
    let coarse = ["-p", "discretisation.spacing_m:=0.003", "-p", "material.shear_modulus_pa:=1200.0"];
    let arguments = ["--scene", "compression", "--ros-args", "-p", "use_sim_time:=true", "-p", wanted];
    let node = Program::start(TWIN, &[&arguments[..], &coarse].concat(), domain, &[]);
    let mut peer = Peer::start(domain);
    for (topic, kind) in
        [("/comparison", "needle_twin/msg/ForceComparison"), ("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")]
    {
        peer.ask(json!({"op": "subscribe", "topic": topic, "type": kind}));
    }
    peer.ask(json!({"op": "wait_matched", "topics": ["/comparison", "/diagnostics"]}));
    let rig = Program::start(
        env!("CARGO_BIN_EXE_rig_node"),
        &[&bag, "--ros-args", "-p", "delay:=3.0", "-p", "rate:=2.0", "-p", "clock_hz:=100.0"],
        domain,
        &[],
    );
    // the last of what comes in ten seconds: the recording takes four, after the delay
    let last = peer.ask(json!({"op": "last", "topic": "/comparison", "seconds": 10.0}))["message"].clone();
    println!("{last}");
    assert_eq!(last["identified_names"], json!(["material.shear_modulus_pa", "load_cell.offset_n"]), "{last}");
    let number = |list: &str, i: usize| last[list][i].as_f64().unwrap();
    let (value, error) = (number("identified_values", 0), number("identified_standard_errors", 0));
    // the coarse cloud is stiffer than the reference by itself
    assert!((value / 1678.0 - 1.0).abs() < 0.05 && error < 0.03 * value, "{last}");
    assert!(number("identified_values", 1).abs() < 2e-3, "{last}");
    assert_eq!((&last["identification"], &last["identification_reason"]), (&json!(2), &json!("")), "{last}");
    let diagnostics = peer.until("/diagnostics", |d| !d.is_null());
    let said = diagnostics["status"].as_array().unwrap().iter().find(|s| s["name"] == "twin: identification").unwrap();
    assert_eq!(said["message"], "OK", "{said}");
    let (_, log, _) = node.stop("INT");
    assert!(log.contains("identified: material.shear_modulus_pa = "), "{log}");
    drop(rig);
}

#[test]
fn names_that_cannot_be_identified_are_refused_at_the_start() {
    for (scene, names, code, words) in [
        ("compression", "[material.poisson_ratio]", 2, vec!["material.poisson_ratio", "load_cell.offset_n"]),
        ("compression", "[instrument.deformation_coefficient]", 1, vec!["scene compression has no"]),
    ] {
        let identify = format!("identify:={names}");
        let output = std::process::Command::new(TWIN)
            .args(["--scene", scene, "--ros-args", "-p", &identify])
            .env("ROS_DOMAIN_ID", free_domain().to_string())
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{said}");
        assert!(words.iter().all(|word| said.contains(word)), "{said}");
    }
}
