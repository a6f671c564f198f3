#![allow(clippy::unwrap_used)]
use super::*;
use crate::scene::{Override, Scene};

/// Small enough for Miri, which sees what the solver's threads do to each other's memory (SECURITY.md).
#[test]
fn a_tiny_tissue_answers_on_several_threads() {
    let changes = [
        ("discretisation.spacing_m", "0.008"),
        ("discretisation.edge_refinement", "1.0"),
        ("stepping.min_steps_per_pose", "2"),
        ("stepping.max_steps_per_pose", "2"),
    ];
    let changes = changes.map(|(path, value)| Override::text(path, value, "test"));
    let scene = Scene::preset("compression").unwrap().with(&changes).unwrap();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    pool.install(|| {
        let mut twin = Twin::new(&scene).unwrap();
        for i in 1..=3 {
            let pose = twin.pose_at_depth(1e-5 * f64::from(i));
            let answer = twin.step(StampedPose { time_s: 1e-3 * f64::from(i), pose }).unwrap();
            assert!(answer.force_n.iter().all(|f| f.is_finite()) && answer.steps > 0, "{answer:?}");
        }
    });
}
