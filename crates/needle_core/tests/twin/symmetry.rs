//! What breaks the axis of symmetry: scenes that say so, poses that are refused, and noise that is borne.
#![allow(clippy::unwrap_used, clippy::panic)]

use crate::axisymmetric::twin;
use needle_core::scene::{Dimension, Override, Scene};
use needle_core::twin::{Halt, StampedPose, Twin};
use testkit::coarse::{at_depth, digits, travel};

#[test]
fn poses_that_break_the_symmetry_are_refused_with_the_way_out() {
    for preset in ["needle_insertion", "indentation"] {
        let (mut one, mut control) = (twin(preset, &[]), twin(preset, &[]));
        for t in [&mut one, &mut control] {
            travel(t, 0.0, 1e-3, 20);
        }
        let good = one.pose_at_depth(1.05e-3);
        let mut beside = good;
        beside.tip[1] += 1e-4;
        let mut tilted = good;
        tilted.axis = [0.01, 0.0, -(1.0f64 - 1e-4).sqrt()];
        for pose in [beside, tilted] {
            let Err(Halt::Pose { reason }) = one.step(StampedPose { time_s: 0.0, pose }) else {
                panic!("{preset}: {pose:?} is taken")
            };
            assert!(reason.contains("discretisation.dimension = \"full\""), "{preset}: {reason}");
        }
        assert_eq!(digits(&[at_depth(&mut one, 1.1e-3)]), digits(&[at_depth(&mut control, 1.1e-3)]), "{preset}");
    }
}

#[test]
fn a_trembling_sensor_is_borne() {
    let mut twin = twin("needle_insertion", &[]);
    let mut pose = twin.pose_at_depth(5e-4);
    pose.tip[0] += 1e-5;
    let answer = twin.step(StampedPose { time_s: 0.0, pose }).unwrap();
    assert_eq!(answer.force_n[..2], [0.0; 2]);
}

#[test]
fn a_scene_says_what_breaks_its_symmetry() {
    let with = |preset: &str, changes: &[(&str, &str)]| {
        let changes: Vec<_> = changes.iter().map(|(path, value)| Override::text(path, value, "test")).collect();
        Scene::preset(preset).unwrap().with(&changes)
    };
    let broken: [(&[(&str, &str)], &str); 3] = [
        (&[("instrument.entry_x_m", "0.001")], "entry_x_m"),
        (&[("instrument.tilt_rad", "0.1")], "tilt_rad"),
        (
            &[
                ("sample.shape", "box"),
                ("sample.size_x_m", "0.03"),
                ("sample.size_y_m", "0.03"),
                ("sample.height_m", "0.017"),
            ],
            "box",
        ),
    ];
    for (changes, word) in broken {
        let scene = with("needle_insertion", changes);
        let Ok(scene) = scene else { panic!("{changes:?}: {:?}", scene.err().map(|e| e.to_string())) };
        let resolved = scene.dimension();
        assert_eq!(resolved.dimension, Dimension::Mirrored);
        assert!(resolved.because.contains(word), "{}", resolved.because);
        assert!(resolved.because.len() < 200, "one clause: {}", resolved.because);
        let mut asked = changes.to_vec();
        asked.push(("discretisation.dimension", "axisymmetric"));
        let refused = with("needle_insertion", &asked).unwrap_err().to_string();
        assert!(refused.contains("discretisation.dimension") && refused.contains(word), "{refused}");
    }
}

/// The least model that the scene allows.
#[test]
fn auto_takes_the_half_plane_where_it_can() {
    for preset in ["compression", "indentation", "needle_insertion"] {
        let scene = Scene::preset(preset).unwrap();
        assert_eq!(scene.discretisation.dimension, Dimension::Auto, "{preset}");
        let twin = Twin::new(&scene).unwrap();
        assert_eq!(twin.dimension(), Dimension::Axisymmetric, "{preset}");
        assert!(twin.dimension_because().contains("axis"), "{preset}: {}", twin.dimension_because());
    }
}
