//! An instrument of one's own: a plate that drags the surface sideways as it goes down. Pace, recovery, health and force are the twin's.
//!
//! `cargo run --release -p needle_core --example own_instrument`

use mtled::solver::Solver;
use needle_core::instrument::{Instrument, Phase, Tip};
use needle_core::scene::Scene;
use needle_core::twin::{Held, StampedPose, Twin};

#[derive(Clone, Debug)]
struct DraggingPlate {
    nodes: Vec<u32>,
    /// Lateral displacement per metre of depth.
    drag: f64,
}

impl Instrument for DraggingPlate {
    fn impose(&mut self, tip: &Tip, solver: &mut Solver) -> Phase {
        let depth = tip.depth.max(0.0);
        for &node in &self.nodes {
            solver.prescribe(node as usize, [self.drag * depth, 0.0, -depth]);
        }
        if depth > 0.0 { Phase::Indentation } else { Phase::Approach }
    }

    fn reset(&mut self, solver: &mut Solver) {
        self.nodes.iter().for_each(|&node| solver.prescribe(node as usize, [0.0; 3]));
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut scene = Scene::preset("compression")?;
    scene.set("discretisation.dimension", "full")?;
    let mut twin = Twin::with_instrument(&scene, |Held { nodes, .. }| DraggingPlate { nodes, drag: 0.2 })?;
    for i in 1..=100 {
        let pose = twin.pose_at_depth(1e-5 * f64::from(i));
        let answer = twin.step(StampedPose { time_s: 0.01 * f64::from(i), pose })?;
        if i % 25 == 0 {
            let [x, _, z] = answer.force_n;
            println!("depth {:.2} mm: {x:+.4} N sideways, {z:.4} N up, {} steps", 1e3 * answer.depth_m, answer.steps);
        }
    }
    Ok(())
}
