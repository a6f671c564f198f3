//! A rough ball that is pressed on and then drawn sideways: stick and slip after Cattaneo (1938) and Mindlin (J. Appl. Mech. 16, 1949).
//!
//! ```text
//! c / a = (1 - q)^(1/3)                    radius of the circle that sticks; q = Q / (mu N), a: radius of the contact
//! d     = 3 mu N / (2 k) (1 - (1 - q)^(2/3))    way aside; k = 8 G a / (2 - nu): stiffness before any slip
//! ```
//!
//! On a layer of finite thickness the way is shorter by a share of Q: k is taken from the start of the motion.
#![allow(clippy::unwrap_used)]

use needle_core::scene::{Override, Scene};
use needle_core::twin::{Pose, StampedPose, Twin};
use testkit::coarse::{alone, rest, travel};

const HEIGHT: f64 = 0.017;
const BALL: f64 = 0.01;
const DEPTH: f64 = 4e-4;
const FRICTION: f64 = 0.3;

/// Place and displacement of the top face's nodes.
fn face(twin: &Twin) -> Vec<([f64; 3], [f64; 3])> {
    let mut u = Vec::new();
    twin.displacements(&mut u);
    let all = twin.reference_points().iter().copied().zip(u);
    all.filter(|(x, _)| x[2] > HEIGHT - 1e-9).collect()
}

#[test]
fn a_rough_ball_drawn_sideways_slips_from_the_rim_inwards() {
    let changes = [
        ("discretisation.dimension", "full"),
        // the wide supports of consistent sums spread the slip of a node over its neighbours
        ("discretisation.integration", "plain"),
        ("instrument.tip", "sphere"),
        ("instrument.diameter_m", "0.02"),
        ("instrument.contact", "coulomb"),
        ("instrument.friction_coefficient", "0.3"),
        ("motion.depth_m", "0.0005"),
        ("discretisation.spacing_m", "0.003"),
        ("discretisation.edge_refinement", "0.1"),
    ];
    let changes: Vec<_> = changes.iter().map(|(path, value)| Override::text(path, value, "test")).collect();
    let mut twin = alone(|| Twin::new(&Scene::preset("indentation").unwrap().with(&changes).unwrap()).unwrap());
    travel(&mut twin, 0.0, DEPTH, 100);
    let down = twin.pose_at_depth(DEPTH);
    let pressed = rest(&mut twin, down).force_n;
    let before = face(&twin);
    let radius = (BALL * DEPTH).sqrt();
    let aside = |way: f64| Pose { tip: [way, 0.0, down.tip[2]], ..down };
    let mut at = 0.0;
    let mut go = |twin: &mut Twin, to: f64| {
        for i in 1..=20 {
            let pose = aside(at + (to - at) * f64::from(i) / 20.0);
            twin.step(StampedPose { time_s: 0.0, pose }).unwrap();
        }
        at = to;
        rest(twin, aside(to)).force_n
    };
    let first = go(&mut twin, 5e-6);
    let stiffness = (pressed[0] - first[0]) / 5e-6;
    println!("{} nodes; {stiffness:.2} N/m", twin.nodes());
    for way in [4e-5, 8e-5, 1.2e-4, 1.6e-4, 2.8e-4] {
        let force = go(&mut twin, way);
        let limit = FRICTION * force[2];
        let q = -force[0] / limit;
        let formula = 1.5 * limit / stiffness * (1.0 - (1.0 - q).max(0.0).powf(2.0 / 3.0));
        let sticks = radius * (1.0 - q).max(0.0).cbrt();
        println!(
            "{:.0} um: q {q:.4}, {:.1} um by the formula, sticks to {:.3} mm",
            1e6 * way,
            1e6 * formula,
            1e3 * sticks
        );
        if way > 2e-4 {
            assert!((q - 1.0).abs() < 0.015, "it slides: {q}");
            continue;
        }
        // nearly all slips at last: 1 % of the force is then 3 % of the way
        let most = if q < 0.8 { 0.06 } else { 0.09 };
        assert!((formula / way - 1.0).abs() < most, "{formula} m, {way} m");
        // a node's place tells the circle to about their distance
        for ((x, u), (_, before)) in face(&twin).iter().zip(&before) {
            let (r, slip) = (x[0].hypot(x[1]), 1.0 - (u[0] - before[0]) / way);
            assert!(r > sticks - 1.5e-4 || slip.abs() < 0.03, "{r} m within {sticks} m: slips by {slip}");
            assert!(r < sticks + 3e-4 || r > radius || slip > 0.01, "{r} m beyond {sticks} m: slips by {slip}");
        }
    }
}
