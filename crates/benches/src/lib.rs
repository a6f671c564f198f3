//! What both benches build: a preset whose every pose is worth one step, on one thread.
#![allow(clippy::missing_panics_doc, clippy::unwrap_used)]

use needle_core::scene::{Override, Scene};
use needle_core::twin::Twin;

/// `preset` in `dimension` (`auto`, `axisymmetric`, `full`), with one step per pose.
pub fn scene(preset: &str, dimension: &str) -> Scene {
    let keys = [("discretisation.dimension", dimension), ("stepping.max_steps_per_pose", "1")];
    Scene::preset(preset).unwrap().with(&keys.map(|(key, value)| Override::text(key, value, "benchmark"))).unwrap()
}

/// The twin of `scene`, built and stepped on one thread.
pub fn twin_on_one_thread(scene: &Scene) -> Twin {
    rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap().install(|| Twin::new(scene)).unwrap()
}
