//! A calibration and the verdict take the components of the force across the axis along, where the load cell measured them.
#![allow(clippy::unwrap_used)]

use needle_core::scene::{Override, Scene};
use needle_core::twin::{Phase, StampedPose, Twin};
use needle_estimate::calibrate::{Calibration, Estimate, HoldOut, LoadCell, Task, Wanted, calibrate};
use needle_estimate::compare::{Answer, Cancel, Explains, Keep, Run, Session};
use needle_recording::{At, ForceSeries, Reading};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng as _;
use rand_distr::{Distribution as _, StandardNormal};
use testkit::coarse::scene;

/// An inserted needle goes sideways: 3 mm down, 0.3 mm aside and back to half of that, held still at both.
fn down_and_aside(twin: &Twin) -> Vec<Reading> {
    let reading = |i: u32| {
        let depth = 2e-5 * (f64::from(i.min(200)) - 50.0);
        let way = |from: u32| f64::from(i.clamp(from, from + 50) - from) / 50.0;
        let mut pose = twin.pose_at_depth(depth);
        pose.tip[0] += 3e-4 * way(250) - 1.5e-4 * way(350);
        Reading { time_s: 0.01 * f64::from(i), at: At::Pose(pose) }
    };
    (0..450).map(reading).collect()
}

/// A twin's force over a motion, N, less the load cell's own sign: that of the tissue on the instrument.
fn forces(scene: &Scene, readings: &[Reading]) -> Vec<(f64, [f64; 3])> {
    let mut twin = Twin::new(scene).unwrap();
    let force = |r: &Reading| {
        let pose = match r.at {
            At::Depth(depth) => twin.pose_at_depth(depth),
            At::Pose(pose) => pose,
        };
        (r.time_s, twin.step(StampedPose { time_s: r.time_s, pose }).unwrap().force_n)
    };
    readings.iter().map(force).collect()
}

/// A load cell with noise (standard, N), zero (N) and drift (N/s) of each axis.
fn read(forces: &[(f64, [f64; 3])], noise: [f64; 3], zero: [f64; 3], drift: [f64; 3], seed: u64) -> ForceSeries {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    let mut normal = || -> f64 { StandardNormal.sample(&mut generator) };
    let axis = |t: f64, f: f64, k: usize, normal: f64| f + zero[k] + drift[k] * t + noise[k] * normal;
    let reading = |(t, f): &(f64, [f64; 3])| (*t, std::array::from_fn(|k| axis(*t, f[k], k, normal())));
    ForceSeries::new(forces.iter().map(reading).collect()).on_one_clock(true)
}

/// The same from a load cell of one axis, that of an upright needle.
fn along(forces: &ForceSeries, readings: &[Reading]) -> ForceSeries {
    let only = |r: &Reading| Some((r.time_s, [0.0, 0.0, forces.at(r.time_s)?[2]]));
    ForceSeries::new(readings.iter().filter_map(only).collect()).on_one_clock(true)
}

fn fit(scene: &Scene, readings: &[Reading], measured: &ForceSeries, keys: &[&str], load_cell: LoadCell) -> Calibration {
    let wanted: Vec<Wanted> = keys.iter().map(|key| Wanted { key: (*key).to_owned(), bounds: None }).collect();
    let task = Task {
        scene,
        readings,
        measured,
        wanted: &wanted,
        load_cell,
        force_error: FORCE_ERROR,
        part: HoldOut::Nothing,
        table: None,
    };
    calibrate(&task, &mut Cancel::default(), &mut |_| {}).unwrap()
}

/// Of the fits.
const FORCE_ERROR: f64 = 0.005;
const MODULUS: &str = "material.shear_modulus_pa";
const COEFFICIENT: &str = "instrument.deformation_coefficient";
const OBLIQUE: [(&str, &str); 4] = [
    ("instrument.tilt_rad", "0.35"),
    ("motion.depth_m", "0.004"),
    ("discretisation.spacing_m", "0.003"),
    ("discretisation.edge_refinement", "0.1"),
];

/// The truth along the axis is 1.1, across it 10 of the scene's modulus, with noise: what is found is the least squares over all components
/// with their weights, `sum w^2 F M / sum w^2 F^2`. So it is in the half of a body, too.
#[test]
fn a_modulus_is_fitted_to_all_components_of_an_oblique_needle() {
    for dimension in ["full", "mirrored"] {
        let scene = scene("needle_insertion", &[&OBLIQUE[..], &[("discretisation.dimension", dimension)]].concat());
        let readings: Vec<Reading> = (0..250)
            .map(|i| Reading { time_s: 0.01 * f64::from(i), at: At::Depth(2e-5 * f64::from(i - 50)) })
            .collect();
        let session = Session::new(&scene, "test", Keep::ANSWERS).unwrap();
        let axis = session.twin().pose_at_depth(0.0).axis;
        let dot = |a: [f64; 3], b: [f64; 3]| (0..3).map(|k| a[k] * b[k]).sum::<f64>();
        let other = |f: [f64; 3]| std::array::from_fn(|k| 10.0 * f[k] - 8.9 * dot(f, axis) * axis[k]);
        let forces: Vec<_> = forces(&scene, &readings).into_iter().map(|(t, f)| (t, other(f))).collect();
        let measured = read(&forces, [4e-4; 3], [0.0; 3], [0.0; 3], 21);
        let run = session.compared_with(&measured).unwatched(readings.iter().copied());
        let answers: Vec<&Answer> = run.answers.iter().collect();
        let sums = |unit: [f64; 3], weight: f64| {
            let products = |a: &&Answer| {
                let (f, m) = (dot(a.predicted_vector_n, unit), dot(a.measured_vector_n.unwrap(), unit));
                [weight * weight * f * m, weight * weight * f * f]
            };
            answers.iter().map(products).fold([0.0; 2], |sum, x| [sum[0] + x[0], sum[1] + x[1]])
        };
        let along = sums(axis, 1.0);
        let across = run.across(&answers, FORCE_ERROR);
        let all = across.iter().map(|c| sums(c.unit, c.weight)).fold(along, |sum, x| [sum[0] + x[0], sum[1] + x[1]]);
        let found = fit(&scene, &readings, &measured, &[MODULUS], LoadCell::Exact);
        let (factor, expected) = (found.estimates[0].value / 1678.0, all[0] / all[1]);
        println!("{dimension}: factor {factor:.5}, {expected:.5} expected, {:.5} along the axis", along[0] / along[1]);
        assert!((expected - along[0] / along[1]).abs() > 3e-3, "the force across the axis has a say");
        assert!((factor - expected).abs() < 5e-4, "{factor} {expected}");
        assert!(found.rejected(), "no modulus explains both");
        assert!(found.verdict.reasons.iter().any(|r| r.contains("x, across the axis")), "{:?}", found.verdict.reasons);
    }
}

/// The force along the axis gives little more than the product of modulus and coefficient; a way aside tells the modulus, and the load
/// cell's zero, drift and noise of each axis are its own.
#[test]
fn a_way_aside_tells_modulus_and_coefficient_apart() {
    // as many steps for each pose, so that two runs differ by their keys alone: the two are nearly one
    let steady = ["stepping.min_steps_per_pose", "stepping.max_steps_per_pose"].map(|key| (key, "8"));
    let changes = [("discretisation.spacing_m", "0.004"), ("motion.depth_m", "0.0035"), steady[0], steady[1]];
    let scene = scene("needle_insertion", &changes);
    let truth = [1.15 * 1678.0, 0.46];
    let changes =
        [MODULUS, COEFFICIENT, "instrument.retraction_coefficient"].into_iter().zip([truth[0], truth[1], truth[1]]);
    let changes: Vec<Override> = changes.map(|(key, value)| Override::typed(key, value, "test")).collect();
    let readings = down_and_aside(&Twin::new(&scene).unwrap());
    let forces = forces(&scene.with(&changes).unwrap(), &readings);
    let keys = [MODULUS, COEFFICIENT];
    let of_seed = |seed: u64| read(&forces, [2e-4, 5e-5, 1e-4], [0.3, -0.02, 0.05], [1e-5, -2e-5, 5e-5], seed);
    let found = [21, 22, 23].map(|seed| fit(&scene, &readings, &of_seed(seed), &keys, LoadCell::Drift));
    let mut held = 0;
    for (e, truth) in found.iter().flat_map(|found| found.estimates.iter().zip(truth)) {
        let error = e.standard_error().unwrap();
        println!("{}: {:.5} ± {error:.5} of {truth:.5}", e.name, e.value);
        held += u32::from((e.value - truth).abs() < 1.96 * error);
        assert!((e.value / truth - 1.0).abs() < 0.02, "{} of {truth}", e.value);
    }
    // one of twenty draws is beyond 1.96 standard errors, and then for both keys, which are nearly one
    assert!(held >= 4, "{held} of 6 intervals hold the truth");
    let measured = of_seed(21);
    let alone = fit(&scene, &readings, &along(&measured, &readings), &keys, LoadCell::Drift);
    let raw = |e: &Estimate| e.noise_error.unwrap_or(f64::INFINITY).hypot(e.systematic_error.unwrap_or(f64::INFINITY));
    for ((e, a), truth) in found[0].estimates.iter().zip(&alone.estimates).zip(truth) {
        println!(
            "{}: {:.5} ± {:.5} of {truth:.5}; along the axis alone {:.5} ± {:.5} ({:?})",
            e.name,
            e.value,
            raw(e),
            a.value,
            raw(a),
            a.withheld
        );
        assert!(a.withheld.is_some() && raw(a) > 1.8 * raw(e), "{} along the axis alone", a.value);
    }
}

/// What a load cell reads across the axis of a needle that goes straight down is noise: it changes nothing.
#[test]
fn noise_across_the_axis_costs_nothing() {
    let scene = scene("needle_insertion", &[]);
    let readings: Vec<Reading> =
        (0..300).map(|i| Reading { time_s: 0.01 * f64::from(i), at: At::Depth(1.2e-5 * f64::from(i - 50)) }).collect();
    let forces = forces(&scene.with(&[Override::typed(MODULUS, 1800.0, "test")]).unwrap(), &readings);
    for noise in [1e-4, 1e-3] {
        let measured = read(&forces, [noise, noise, 1e-4], [0.0; 3], [0.0; 3], 22);
        let found = fit(&scene, &readings, &measured, &[MODULUS], LoadCell::Drift);
        let alone = fit(&scene, &readings, &along(&measured, &readings), &[MODULUS], LoadCell::Drift);
        let (e, a) = (&found.estimates[0], &alone.estimates[0]);
        let (error, error_alone) = (e.standard_error().unwrap(), a.standard_error().unwrap());
        println!(
            "noise {noise} N across: {:.2} ± {error:.2}, along alone {:.2} ± {error_alone:.2} Pa",
            e.value, a.value
        );
        assert!((e.value - a.value).abs() < 0.1 * error_alone, "{} {}", e.value, a.value);
        assert!((error / error_alone - 1.0).abs() < 0.15, "{error} {error_alone}");
        assert!((e.value - 1800.0).abs() < 1.96 * error && !found.rejected(), "{:?}", found.verdict);
    }
}

/// A needle that goes down evenly can't tell a late clock from a deep contact; one that then goes aside can.
#[test]
fn a_way_aside_tells_the_clock() {
    let scene = scene("needle_insertion", &[("discretisation.spacing_m", "0.004"), ("motion.depth_m", "0.0035")]);
    let readings = down_and_aside(&Twin::new(&scene).unwrap());
    let late = 0.08;
    let forces: Vec<_> = forces(&scene, &readings).into_iter().map(|(t, f)| (t + late, f)).collect();
    let measured = read(&forces, [2e-5; 3], [0.01; 3], [0.0; 3], 21).on_one_clock(false);
    let clock = |measured: &ForceSeries| {
        let session = Session::new(&scene, "test", Keep::ANSWERS).unwrap();
        session.compared_with(measured).unwatched(readings.iter().copied()).alignment().unwrap()
    };
    let found = clock(&measured);
    let alone = clock(&along(&measured, &readings).on_one_clock(false));
    println!("{found:?}\nalone {alone:?}");
    let error = found.time_offset_s.error.unwrap();
    assert!((found.time_offset_s.value - late).abs() < (2.0 * error).max(5e-3), "{found:?}");
    assert!(found.contact_depth_m.value.abs() < 5e-5, "{found:?}");
    assert!(alone.time_offset_s.error.is_none_or(|alone| alone > 2.0 * error), "{alone:?}");
}

/// A force that is right along the axis and wrong across it is not explained; what a load cell's zero and cross-talk do is.
#[test]
fn the_verdict_judges_every_component_that_was_measured() {
    let verdict = |across: f64, zero: f64| {
        let answer = |i: u32| {
            let depth_m = 1e-5 * (f64::from(i) - 100.0);
            let (force, noise) = (1e3 * depth_m.max(0.0).powf(1.5), 1e-4 * (f64::from(i * i % 7) - 3.0));
            Answer {
                time_s: 0.01 * f64::from(i),
                depth_m,
                predicted_n: force,
                measured_n: Some(force + noise),
                predicted_vector_n: [-0.4 * force, 0.0, force],
                measured_vector_n: Some([-0.4 * across * force + zero + noise, zero - noise, force + noise]),
                model_error_n: 0.0,
                phase: if depth_m > 0.0 { Phase::Penetration } else { Phase::Approach },
                event: None,
                steps: 1,
                latency_s: 0.0,
            }
        };
        Run { answers: (0..1000).map(answer).collect(), ..Run::default() }.verdict()
    };
    for zero in [0.0, 0.3] {
        assert_eq!(verdict(1.0, zero).explains, Explains::Yes, "{:?}", verdict(1.0, zero));
    }
    let wrong = verdict(1.5, 0.0);
    println!("{:?}", wrong.reasons);
    assert_eq!(wrong.explains, Explains::No);
    assert!(wrong.reasons.iter().any(|r| r.starts_with("the force along x: ")), "{:?}", wrong.reasons);
}
