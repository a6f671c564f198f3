//! Coarse scenes, and poses for them, for tests of the twin.

use needle_core::scene::{Override, Scene};
use needle_core::twin::{Pose, Prediction, StampedPose, Twin};

/// A preset in three dimensions on a coarse cloud, for depths up to 3 mm.
pub fn scene(preset: &str, changes: &[(&str, &str)]) -> Scene {
    let mut all = vec![
        ("discretisation.dimension", "full"),
        ("discretisation.spacing_m", "0.003"),
        ("discretisation.edge_refinement", "0.5"),
        ("motion.depth_m", "0.003"),
    ];
    if preset == "needle_insertion" {
        all.push(("instrument.capture_radius_m", "0.001"));
    }
    let changes: Vec<_> = all.iter().chain(changes).map(|(path, value)| Override::text(path, value, "test")).collect();
    Scene::preset(preset).unwrap().with(&changes).unwrap()
}

/// Does some work with one thread per twin: tests run side by side, and threads that wait for each other on a busy
/// machine wait long.
pub fn alone<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap().install(work)
}

/// The twin's answer to a depth, m.
pub fn at_depth(twin: &mut Twin, depth_m: f64) -> Prediction {
    let pose = StampedPose { time_s: 0.0, pose: twin.pose_at_depth(depth_m) };
    twin.step(pose).unwrap()
}

/// Moves from depth to depth in equal poses and returns all answers.
pub fn travel(twin: &mut Twin, from_m: f64, to_m: f64, poses: u32) -> Vec<Prediction> {
    let depth = |k| from_m + (to_m - from_m) * f64::from(k) / f64::from(poses);
    (1..=poses).map(|k| at_depth(twin, depth(k))).collect()
}

/// Stays at a pose until the twin finds nothing left to do.
pub fn rest(twin: &mut Twin, pose: Pose) -> Prediction {
    let stay = |twin: &mut Twin| twin.step(StampedPose { time_s: 0.0, pose }).unwrap();
    let mut answer = stay(twin);
    for _ in 0..3000 {
        if answer.steps == 0 {
            break;
        }
        answer = stay(twin);
    }
    answer
}

/// Presses to a depth in poses of 50 um and rests there.
pub fn press(twin: &mut Twin, depth_m: f64) -> Prediction {
    travel(twin, 0.0, depth_m, (depth_m / 50e-6).ceil() as u32);
    let pose = twin.pose_at_depth(depth_m);
    rest(twin, pose)
}

/// All of an answer in digits that distinguish any two doubles.
pub fn digits(answers: &[Prediction]) -> Vec<String> {
    answers.iter().map(|a| format!("{a:?}")).collect()
}
