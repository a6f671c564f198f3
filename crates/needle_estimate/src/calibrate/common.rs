//! The cloud and the steps that all runs of a calibration share.

use super::unknown::Sought;
use needle_core::scene::{Region, Scene};
use needle_core::twin::Twin;

/// What all runs share if a key of a region or its material is sought.
pub(super) struct Common {
    pub of_regions: bool,
    /// Regions for which the cloud was made; `None`: each run has its own cloud.
    pub made_for: Option<Vec<Region>>,
    /// Least number of steps of a pose in motion; `None`: chosen by the twin.
    pub steps: Option<u32>,
}

impl Common {
    pub(crate) fn new(scene: &Scene, sought: &[Sought]) -> Self {
        let of_regions = sought.iter().any(Sought::is_of_regions);
        let moves = of_regions && Twin::stretch_from(scene, &scene.regions).is_some();
        Self { of_regions, made_for: moves.then(|| scene.regions.clone()), steps: None }
    }

    /// The scene as it is run, with the least number of steps raised. Only the first poses, where contact begins with
    /// an impulse, take more steps than that.
    pub(crate) fn posed(&self, scene: &Scene) -> Scene {
        let mut scene = scene.clone();
        let stepping = &mut scene.stepping;
        let steps = self.steps.unwrap_or(0).min(stepping.max_steps_per_pose);
        stepping.min_steps_per_pose = stepping.min_steps_per_pose.max(steps);
        scene
    }
}
