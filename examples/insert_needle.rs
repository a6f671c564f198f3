//! A needle goes 10 mm into a block of silicone gel; the twin says what force it feels, pose by pose.
//!
//! The tissue is in equilibrium at every moment, so the solver looks for the displacement u(X) with
//!
//! ```text
//! Div P(F) = 0,   F = I + du/dX,   P = dW/dF,   W = mu/2 (J^-2/3 I1 - 3) + kappa/2 (J - 1)^2
//! ```
//!
//! where the base is fixed and tissue that the needle has captured moves with it. It gets there by explicit steps with
//! scaled masses and damping, from the state that the last pose left: that is why a pose costs milliseconds.
//!
//! ```text
//! cargo run --release --example insert_needle            # the preset: 326 nodes in a half plane
//! cargo run --release --example insert_needle -- 0.004   # coarser: 4 mm between nodes away from the needle
//! ```
//!
//! prints depth and force, one line per millimetre: after the puncture the force rises steadily to about 0.066 N.
use std::error::Error;

use needle_core::scene::{Override, Scene};
use needle_core::twin::{Event, StampedPose, Twin};

fn main() -> Result<(), Box<dyn Error>> {
    let mut scene = Scene::preset("needle_insertion")?;
    if let Some(spacing_m) = std::env::args().nth(1) {
        scene = scene.with(&[Override::text("discretisation.spacing_m", &spacing_m, "first argument")])?;
    }
    let mut twin = Twin::new(&scene)?;
    println!("{} nodes, {} integration points, {} threads", twin.nodes(), twin.integration_points(), twin.threads());
    println!("{:>9} {:>9} {:>12}", "depth mm", "force mN", "phase");

    let motion = scene.motion.ok_or("the scene has no motion")?;
    let mut printed_mm = 0.0;
    // A rig would send these poses over a topic; here they come from the scene's own motion, 1000 per second at 1 mm/s.
    for (time_s, depth_m) in motion.poses() {
        let answer = twin.step(StampedPose { time_s, pose: twin.pose_at_depth(depth_m) })?;
        if let Some(Event::Puncture { depth_m, .. }) = answer.event {
            println!("punctured at {:.3} mm", 1e3 * depth_m);
        }
        if 1e3 * depth_m >= printed_mm + 1.0 - 1e-9 {
            printed_mm += 1.0;
            // the force of the tissue on the needle points out of the sample
            println!("{:9.3} {:9.2} {:>12}", 1e3 * depth_m, 1e3 * answer.force_n[2], answer.phase.as_str());
        }
    }
    println!("{} explicit steps", twin.steps());
    Ok(())
}
