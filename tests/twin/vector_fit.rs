//! A calibration and the verdict take the components of the force across the axis along, where the load cell measured them.
#![allow(clippy::unwrap_used)]

use crate::coarse::scene;
use needle_twin::compare::{Answer, At, Explains, ForceSeries, Reading, Run, Watch};
use needle_twin::study::calibrate::{HoldOut, LoadCell, Task, Wanted, calibrate};
use needle_twin::twin::{Phase, StampedPose, Twin};

struct Still;

impl Watch for Still {
    fn progress(&mut self, _: usize, _: Option<&Answer>) {}
    fn stop(&self) -> bool {
        false
    }
}

/// The truth along the axis is 1.1, across it 10 of the scene's modulus: least squares over all components take the mean, weighted by
/// their squares. The load cell's zero across the axis is no force of the tissue.
#[test]
fn a_modulus_is_fitted_to_all_components_of_an_oblique_needle() {
    let changes = [
        ("instrument.tilt_rad", "0.35"),
        ("motion.depth_m", "0.004"),
        ("discretisation.spacing_m", "0.003"),
        ("discretisation.edge_refinement", "0.1"),
    ];
    let scene = scene("needle_insertion", &changes);
    let mut twin = Twin::new(&scene).unwrap();
    let readings: Vec<Reading> =
        (0..250).map(|i| Reading { time_s: 0.01 * f64::from(i), at: At::Depth(2e-5 * f64::from(i - 50)) }).collect();
    let (mut measured, mut weights) = (Vec::new(), [0.0; 2]);
    for r in &readings {
        let At::Depth(depth) = r.at else { unreachable!() };
        let pose = twin.pose_at_depth(depth);
        let force = twin.step(StampedPose { time_s: r.time_s, pose }).unwrap().force_n;
        let along: f64 = (0..3).map(|k| force[k] * pose.axis[k]).sum();
        let across: [f64; 3] = std::array::from_fn(|k| force[k] - along * pose.axis[k]);
        weights[0] += along * along;
        weights[1] += across.iter().map(|f| f * f).sum::<f64>();
        let zero = [0.0, 0.01, 0.0]; // the path leans in the plane of x and z
        measured.push((r.time_s, std::array::from_fn(|k| 1.1 * along * pose.axis[k] + 10.0 * across[k] + zero[k])));
    }
    let task = Task {
        scene: &scene,
        readings: &readings,
        measured: &ForceSeries::new(measured).on_one_clock(true),
        wanted: &[Wanted { key: "material.shear_modulus_pa".to_owned(), bounds: None }],
        load_cell: LoadCell::Exact,
        force_error: 0.01,
        part: HoldOut::Nothing,
        table: None,
    };
    let found = calibrate(&task, &mut Still, &mut |_| {}).unwrap();
    let factor = found.estimates[0].value / 1678.0;
    let expected = (1.1 * weights[0] + 10.0 * weights[1]) / (weights[0] + weights[1]);
    println!("factor {factor:.5}, {expected:.5} expected");
    assert!(expected > 1.105, "the force across the axis has a say: {expected}");
    assert!((factor - expected).abs() < 5e-4, "{factor} {expected}");
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
