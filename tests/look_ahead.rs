//! Contract: looking ahead leaves the twin as it is, bit for bit; what it predicts is what the twin predicts when the
//! motion is made.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::time::Instant;

use needle_twin::scene::Scene;
use needle_twin::twin::{Motion, Prediction, StampedPose, Twin};

#[test]
#[ignore = "explore"]
fn explore() {
    for name in ["needle_insertion", "indentation"] {
        let mut scene = Scene::preset(name).unwrap();
        if std::env::var("FULL").is_ok() { scene.set("discretisation.dimension", "full").unwrap(); }
        let mut twin = Twin::new(&scene).unwrap();
        let t = Instant::now();
        let mut double = twin.double();
        println!("{name}: nodes {} double {:?}", twin.nodes(), t.elapsed());
        let ahead = 0.002;
        for depth in [0.002, 0.006] {
            twin.reset();
            let n = (depth / 1e-6) as u32;
            let mut from = None;
            let t = Instant::now();
            for i in 1..=n {
                let d = depth * f64::from(i) / f64::from(n);
                from = Some(StampedPose { time_s: f64::from(i) * 1e-3, pose: twin.pose_at_depth(d) });
                twin.step(from.unwrap()).unwrap();
            }
            println!(" live to {depth}: {:?}, steps {}", t.elapsed(), twin.steps());
            let from = from.unwrap();
            let mut outs: Vec<((u32, u32), Vec<Prediction>, f64, f64, u64)> = vec![];
            for (poses, most) in [(20, 10), (50, 4), (100, 2), (200, 1), (20, 15), (50, 6), (100, 3), (300, 1), (100, 5), (200, 4)] {
                let mut out = vec![];
                let t = Instant::now();
                double.take_over(&twin);
                let copy = t.elapsed();
                let t = Instant::now();
                double.look_ahead(&from, &Motion { distance_m: ahead, speed_m_per_s: 1e-3, poses, steps_per_pose: most }, &mut out).unwrap();
                outs.push(((poses, most), out, t.elapsed().as_secs_f64(), copy.as_secs_f64(), double.steps() - twin.steps()));
            }
            let mut live = vec![];
            for i in 1..=2000u32 {
                let d = depth + ahead * f64::from(i) / 2000.0;
                live.push(twin.step(StampedPose { time_s: from.time_s + f64::from(i) * 1e-3, pose: twin.pose_at_depth(d) }).unwrap());
            }
            for (poses, out, took, copy, steps) in outs {
                let peak = live.last().unwrap().force_n[2];
                let errors: Vec<f64> = out.iter().map(|p| {
                    let i = ((p.depth_m - depth) / 1e-6).round() as usize;
                    (p.force_n[2] - live[i.max(1) - 1].force_n[2]) / peak * 100.0
                }).collect();
                let most = errors.iter().fold(0.0f64, |a, e| a.max(e.abs()));
                println!("  {depth} poses {poses:?}: {:.1} ms, copy {:.3} ms, steps {steps}, last error {:.2} %, largest {most:.2} %", took * 1e3, copy * 1e3, errors.last().unwrap());
            }
        }
    }
}
