//! A material law of one's own in a twin: Demiray's exponential law (1972). Scene, pace, recovery, health and force are the twin's.
//!
//! `cargo run --release -p needle_core --example twin_of_own_law`

use mtled::material::{IsochoricLaw, Own, Slopes};
use mtled::number::Number;
use needle_core::scene::Scene;
use needle_core::twin::{StampedPose, Twin};

/// W = mu / (2 c) (exp(c (a - 3)) - 1).
#[derive(Clone, Copy, Debug)]
pub struct Demiray {
    /// mu, Pa.
    pub mu: f64,
    /// c.
    pub stiffening: f64,
}

impl IsochoricLaw<2> for Demiray {
    const SECOND: bool = false;

    fn constants(&self) -> [f64; 2] {
        [self.mu, self.stiffening]
    }

    #[inline(always)]
    fn slopes<N: Number>(&[mu, c]: &[N; 2], a: N, _: N) -> Slopes<N> {
        let excess = (c * (a - N::of(3.0))).exp_m1();
        let slope = N::of(0.5) * mu * (N::of(1.0) + excess);
        Slopes { w: N::of(0.5) * mu / c * excess, a: slope, aa: c * slope, ..Slopes::default() }
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut scene = Scene::preset("compression")?;
    scene.material.own = Some(Own::new(&Demiray { mu: 1678.0, stiffening: 3.0 }));
    let mut twin = Twin::new(&scene)?;
    for i in 1..=100 {
        let pose = twin.pose_at_depth(2e-5 * f64::from(i));
        let answer = twin.step(StampedPose { time_s: 0.01 * f64::from(i), pose })?;
        if i % 25 == 0 {
            println!("depth {:.2} mm: {:.4} N, {} steps", 1e3 * answer.depth_m, answer.force_n[2], answer.steps);
        }
    }
    Ok(())
}
