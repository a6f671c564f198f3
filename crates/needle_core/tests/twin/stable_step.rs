//! The explicit step follows the deformation: it is below the true limit of the present state, and a step that isn't is
//! found out.
#![allow(clippy::unwrap_used)]

use needle_core::twin::{Halt, StampedPose, Trouble, Twin};
use testkit::coarse::{alone, scene, travel};

/// Largest stable frequency of the central difference, rad per step.
const LIMIT: f64 = 2.0;

fn indentation(changes: &[(&str, &str)]) -> Twin {
    let deep = [("motion.depth_m", "0.011"), ("discretisation.edge_refinement", "0.25")];
    alone(|| Twin::new(&scene("indentation", &[&deep, changes].concat())).unwrap())
}

#[test]
fn the_step_stays_below_the_true_limit_at_every_depth() {
    for changes in [&[][..], &[("material.poisson_ratio", "0.499")], &[("discretisation.volume_ratio", "pointwise")]] {
        let mut twin = indentation(changes);
        let mut from = 0.0;
        for depth in [0.0, 4e-3, 8e-3, 1e-2] {
            if depth > from {
                travel(&mut twin, from, depth, ((depth - from) / 4e-6) as u32);
                from = depth;
            }
            let fastest = twin.fastest();
            println!("{changes:?}: at {:.0} mm fastest mode {fastest:.3} rad per step of {LIMIT}", 1e3 * depth);
            assert!(fastest < LIMIT, "{changes:?} at {depth} m");
            assert!(fastest > 0.5 * LIMIT || depth > 0.0, "the step is not wasted: {fastest}");
        }
        assert_eq!(twin.recoveries(), 0, "{changes:?}");
    }
}

/// 1.1 and 1.5 times the true limit, which the largest eigenvalue at rest gives.
#[test]
fn a_step_beyond_the_limit_is_found_out() {
    let at_limit = 0.9 * LIMIT / indentation(&[]).fastest();
    for over in [1.1, 1.5] {
        let factor = (over * at_limit).to_string();
        let mut twin = indentation(&[("stepping.step_factor", &factor)]);
        assert!((twin.fastest() / LIMIT / over - 1.0).abs() < 0.01, "{over} times the limit");
        let mut halt = None;
        for i in 1..=2000 {
            let pose = StampedPose { time_s: 0.0, pose: twin.pose_at_depth(f64::from(i) * 2e-6) };
            match twin.step(pose) {
                Ok(answer) => {
                    assert!(answer.force_n.iter().all(|f| f.is_finite()), "nothing non-finite leaves");
                    if twin.recoveries() > 0 {
                        break;
                    }
                }
                Err(why) => {
                    halt = Some(why);
                    break;
                }
            }
        }
        println!("{over} of the limit, step factor {factor}: {} recoveries, {halt:?}", twin.recoveries());
        assert!(twin.recoveries() > 0, "step factor {factor}: the overrun was seen");
        if let Some(halt) = halt {
            assert!(halt.to_string().contains("stepping.step_factor"), "says what to change: {halt}");
            assert!(matches!(halt, Halt::Diverged { trouble: Trouble::RunsAway { .. } | Trouble::NotFinite, .. }));
        }
    }
}
