//! Contract of ensembles: each member is a run of its own, to the last bit, and nothing depends on the threads.
#![allow(clippy::unwrap_used, clippy::panic)]

use needle_core::scene::{Override, Prior, Scene};
use needle_estimate::compare::ensemble::{self, Crew, Driven, Member, MemberPath, Paths, Size};
use needle_estimate::compare::{Cancel, Keep, Run, Session};
use needle_recording::Reading;

use testkit::coarse::alone;

/// A half plane with few nodes, pressed in a few poses.
fn scene(changes: &[(&str, &str)]) -> Scene {
    let few = [
        ("discretisation.spacing_m", "0.003"),
        ("motion.depth_m", "0.001"),
        ("motion.speed_m_per_s", "0.02"),
        ("uncertainty.instrument.diameter_m", "{ normal = [0.01, 0.0003] }"),
        ("uncertainty.material.poisson_ratio", "{ uniform = [0.45, 0.49] }"),
    ];
    let changes: Vec<_> = few.iter().chain(changes).map(|(path, value)| Override::text(path, value, "test")).collect();
    Scene::preset("indentation").unwrap().with(&changes).unwrap()
}

fn readings(scene: &Scene) -> Vec<Reading> {
    Session::motion(&scene.motion.unwrap()).collect()
}

fn single(scene: &Scene, readings: &[Reading]) -> Run {
    alone(|| Session::new(scene, "test", Keep::ANSWERS).unwrap().unwatched(readings.iter().copied()))
}

fn members(scene: &Scene, members: usize) -> Vec<Member> {
    ensemble::members(scene, Size { members, seed: 0 }).unwrap()
}

fn paths(members: &[Member], readings: &[Reading], threads: usize) -> Paths {
    ensemble::paths(members, readings, &Crew { threads, cancel: Cancel::default(), done: &|| {} }).unwrap()
}

fn bits(path: &Result<MemberPath, String>) -> Vec<u64> {
    path.as_ref().unwrap().force_n.iter().map(|f| f.to_bits()).collect()
}

#[test]
fn a_member_is_a_single_run_with_its_values_for_any_number_of_threads() {
    let scene = scene(&[]);
    let (readings, members) = (readings(&scene), members(&scene, 4));
    let one = paths(&members, &readings, 1);
    assert_eq!(one.runs, 4);
    for (k, member) in members.iter().enumerate() {
        // as a user would run it
        let key = |path: &str, value: f64| Override::text(path, &format!("{value:?}"), "--set");
        let [diameter, ratio] = [member.values[0], member.values[1]];
        let changes = [key("instrument.diameter_m", diameter), key("material.poisson_ratio", ratio)];
        let run = single(&scene.with(&changes).unwrap(), &readings);
        let alone: Vec<u64> = run.answers.iter().map(|a| a.predicted_n.to_bits()).collect();
        assert!(run.answers.iter().any(|a| a.predicted_n > 1e-3), "there is a force to compare");
        assert_eq!(alone, bits(&one.of_member[k]), "member {k}");
    }
    let three = paths(&members, &readings, 3);
    assert!(one.of_member.iter().zip(&three.of_member).all(|(a, b)| bits(a) == bits(b)), "the same bits on 3 threads");
    assert!(bits(&one.of_member[0]) != bits(&one.of_member[1]), "members differ");
}

#[test]
fn members_that_differ_in_a_modulus_share_a_run_that_is_right_to_a_thousandth() {
    let modulus = ("uncertainty.material.shear_modulus_pa", "{ normal = [1678, 170] }");
    let mut scene = scene(&[modulus]);
    scene.uncertainty.drain(..2);
    let (readings, members) = (readings(&scene), members(&scene, 4));
    let found = paths(&members, &readings, 2);
    assert_eq!(found.runs, 1);
    for (member, path) in members.iter().zip(&found.of_member) {
        let own = Override::text("material.shear_modulus_pa", &format!("{:?}", member.values[0]), "--set");
        let run = single(&scene.with(&[own]).unwrap(), &readings);
        let peak = run.answers.iter().map(|a| a.predicted_n).fold(0.0, f64::max);
        let off = run.answers.iter().zip(&path.as_ref().unwrap().force_n).map(|(a, f)| (a.predicted_n - f).abs());
        let largest = off.fold(0.0, f64::max);
        assert!(peak > 1e-3 && largest < 1e-3 * peak, "{} Pa: {largest} N of {peak} N", member.values[0]);
    }
    // what is not of one material, or may slip or open, has runs of its own
    for change in [("instrument.contact", "frictionless"), ("sample.base", "frictionless")] {
        let other = scene.with(&[Override::text(change.0, change.1, "test")]).unwrap();
        assert!(self::members(&other, 4).iter().all(|m| m.factor == 1.0), "{change:?}");
    }
}

#[test]
fn a_scene_keeps_its_correlations_in_its_file() {
    let linked = "{ normal = [0.01, 0.0003], correlation = { \"material.poisson_ratio\" = -0.5 } }";
    let scene = scene(&[("uncertainty.instrument.diameter_m", linked)]);
    let again = Scene::from_toml(&scene.to_toml(), "again").unwrap();
    assert_eq!(again.uncertainty, scene.uncertainty);
    assert_eq!(again.uncertainty.iter().map(|one| one.correlation.len()).sum::<usize>(), 1);
    // keys as TOML nests them, and a material that is named as the word is
    let nested = "{ normal = [0.01, 0.0003], correlation = { material.poisson_ratio = -0.5 } }";
    let changed = scene.with(&[Override::text("uncertainty.instrument.diameter_m", nested, "test")]).unwrap();
    assert_eq!(changed.uncertainty, scene.uncertainty);
    // the key that it goes with falls away with what has it
    let plate = [Override::text("instrument.kind", "plate", "test")];
    let with_plate = scene.with(&plate).unwrap();
    assert!(with_plate.uncertainty.iter().all(|one| one.correlation.is_empty()), "{:?}", with_plate.uncertainty);
}

#[test]
fn keys_that_are_equal_stay_equal_unless_both_are_uncertain() {
    let prior = ("uncertainty.instrument.deformation_coefficient", "{ uniform = [0.3, 0.5] }");
    let back = ("uncertainty.instrument.retraction_coefficient", "{ uniform = [0.3, 0.5] }");
    let drawn = |priors: &[(&str, &str)]| {
        let changes: Vec<_> = priors.iter().map(|(path, value)| Override::text(path, value, "test")).collect();
        members(&Scene::preset("needle_insertion").unwrap().with(&changes).unwrap(), 8)
    };
    let pair = |m: &Member| ["deformation", "retraction"].map(|k| m.scene.get(&format!("instrument.{k}_coefficient")));
    assert!(drawn(&[prior]).iter().map(pair).all(|[forth, back]| forth == back));
    assert!(drawn(&[prior, back]).iter().map(pair).any(|[forth, back]| forth != back));
}

#[test]
fn a_scene_computes_the_same_with_what_is_uncertain_and_without() {
    let scene = scene(&[("uncertainty.align.force_zero_n", "{normal=[0,0.01]}")]);
    assert_eq!(scene.uncertainty.len(), 3);
    let mut plain = scene.clone();
    plain.uncertainty.clear();
    let readings = readings(&scene);
    assert_eq!(single(&scene, &readings).checksum, single(&plain, &readings).checksum);
    let written = Scene::from_toml(&scene.to_toml(), "again").unwrap();
    assert_eq!(written, scene, "it is written and read back");
    assert_eq!(written.uncertainty[1].prior, Prior::Uniform(0.45, 0.49));
}

#[test]
fn the_recordings_own_keys_need_no_run_but_for_the_contact() {
    let recorded = |key: &str, prior: &str| {
        let mut scene = scene(&[(key, prior)]);
        scene.uncertainty.drain(..2);
        scene
    };
    let clock_and_zero = {
        let mut scene = recorded("uncertainty.align.time_offset_s", "{uniform=[-0.004,0.004]}");
        scene = scene.with(&[Override::text("uncertainty.align.force_zero_n", "{normal=[0.1,0.01]}", "test")]).unwrap();
        scene
    };
    let readings = readings(&clock_and_zero);
    let members_of_both = members(&clock_and_zero, 8);
    let found = paths(&members_of_both, &readings, 2);
    assert_eq!(found.runs, 1);
    let run = single(&clock_and_zero, &readings);
    let last = readings.len() - 1;
    for (member, path) in members_of_both.iter().zip(&found.of_member) {
        let force = &path.as_ref().unwrap().force_n;
        // pressed at a constant rate, the force is nearly linear over eight poses
        let rate = (run.answers[last - 10].predicted_n - run.answers[last - 20].predicted_n) / 0.01;
        let expected =
            run.answers[last - 15].predicted_n - rate * member.shift.time_offset_s + member.shift.force_zero_n;
        assert!((force[last - 15] - expected).abs() < 2e-3, "{} {expected}", force[last - 15]);
    }
    let touched = recorded("uncertainty.align.contact_depth_m", "{uniform=[-1e-4,3e-4]}");
    let (members, peak) = (members(&touched, 4), run.answers[last].predicted_n);
    let found = paths(&members, &readings, 2);
    assert_eq!(found.runs, 4);
    for (member, path) in members.iter().zip(&found.of_member) {
        let force = path.as_ref().unwrap().force_n[last - 5];
        let share = (force - run.answers[last - 5].predicted_n) / peak;
        assert!(
            (share + member.shift.contact_depth_m / 1e-3).abs() < 0.05,
            "{} m: {share}",
            member.shift.contact_depth_m
        );
    }
}

#[test]
fn a_member_that_is_lost_is_counted_and_left_out() {
    let scene = scene(&[]);
    let readings = readings(&scene);
    let mut members = members(&scene, 4);
    let nothing = [("shape", "mesh"), ("mesh", "none.msh"), ("base_group", "base"), ("contact_group", "top")];
    let nothing = nothing.map(|(key, value)| Override::text(&format!("sample.{key}"), value, "test"));
    members[2].scene = members[2].scene.with(&nothing).unwrap();
    let mut run = single(&scene, &readings);
    let at: Vec<usize> = (0..run.answers.len()).collect();
    let crew = Crew { threads: 2, cancel: Cancel::default(), done: &|| {} };
    let driven = Driven { readings: &readings, at: &at, sightings: &[], twin: None };
    ensemble::add(&mut run, &scene, &members, driven, Size { members: 4, seed: 0 }, &crew).unwrap();
    let found = run.ensemble.clone().unwrap();
    assert_eq!((found.members, found.used), (4, 3));
    assert!(
        run.losses[0].starts_with("1 of 4 members left out of the ensemble; the first, member 2: "),
        "{:?}",
        run.losses
    );
    let last = run.answers.len() - 1;
    let band = run.band(last).unwrap();
    assert!(band.low_n < run.answers[last].predicted_n && run.answers[last].predicted_n < band.high_n, "{band:?}");
}

#[test]
fn wrong_entries_are_refused_by_key_value_and_range() {
    let refused = |path: &str, value: &str| {
        let scene = Scene::preset("indentation").unwrap();
        scene.with(&[Override::text(&format!("uncertainty.{path}"), value, "--set")]).unwrap_err().to_string()
    };
    for (path, value, said) in [
        ("material.shear_modulus", "{normal=[1,2]}", "material.shear_modulus_pa"),
        ("material.shear_modulus_pa", "{normal=[1678]}", "mean, standard deviation"),
        ("material.shear_modulus_pa", "1678", "one distribution is needed"),
        ("material.shear_modulus_pa", "{gamma=[1,2]}", "normal, lognormal, uniform"),
        ("material.poisson_ratio", "{uniform=[0.4,0.6]}", "= 0.6 is out of range; allowed: number in (-1, 0.5)"),
        ("instrument.capture_radius_m", "{normal=[5e-4,1e-5]}", "has no such key"),
        ("discretisation.method", "{normal=[1,2]}", "only a single number can be uncertain"),
        ("motion.speed_m_per_s", "{uniform=[1,2]}", "the motion is given"),
        ("align.contact_m", "{uniform=[0,1]}", "align.contact_depth_m"),
    ] {
        let error = refused(path, value);
        assert!(error.contains(said) && error.contains(path), "{error}");
    }
    // the mean is allowed, but not what is drawn far from it
    let wide = scene(&[("uncertainty.material.poisson_ratio", "{ normal = [0.49, 0.02] }")]);
    let error = ensemble::members(&wide, Size { members: 16, seed: 0 }).unwrap_err().to_string();
    assert!(error.contains("material.poisson_ratio = 0.5") && error.contains("number in (-1, 0.5)"), "{error}");
    assert!(error.contains("member ") && error.contains("choose a narrower one"), "{error}");
}
