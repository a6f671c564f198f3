use needle_core::scene::{Override, Scene};
use needle_core::twin::{Event, StampedPose, Twin};
fn main() {
    let args: Vec<String> = std::env::args().skip(1).collect();
    // probe FILE depth_mm print_every from_mm [key=value...]
    let text = std::fs::read_to_string(&args[0]).unwrap();
    let depth: f64 = args[1].parse::<f64>().unwrap() * 1e-3;
    let every: usize = args[2].parse().unwrap();
    let from: f64 = args[3].parse::<f64>().unwrap() * 1e-3;
    let mut scene = Scene::from_toml(&text, "x.toml").unwrap();
    let o: Vec<Override> = args[4..].iter().map(|a| Override::parse(a, "probe").unwrap()).collect();
    scene = scene.with(&o).unwrap();
    let m = scene.motion.unwrap();
    let (v, hz) = (m.speed.get(), m.pose_rate.get());
    let t0 = std::time::Instant::now();
    let mut twin = Twin::new(&scene).unwrap();
    println!("{} points {:?} nodes", twin.integration_points(), twin.dimension());
    let n = (depth / v * hz).round() as usize;
    let (mut steps, mut most) = (0u64, 0.0f64);
    let (mut shown, mut t) = (0, std::time::Instant::now());
    let built = t0.elapsed();
    for i in 1..=n {
        let time_s = i as f64 / hz;
        let d = v * time_s;
        let p = match twin.step(StampedPose { time_s, pose: twin.pose_at_depth(d) }) {
            Ok(p) => p,
            Err(e) => {
                println!("{:.4} LOST {e}", d * 1e3);
                return;
            }
        };
        let one = t.elapsed().as_secs_f64();
        t = std::time::Instant::now();
        if one > most {
            most = one;
        }
        steps += u64::from(p.steps);
        for h in twin.happened() {
            println!(
                "EVENT {:?} before {:.3} after {:.3} mN steps {} pose {:.0} ms imbalance {:.4}",
                h.event,
                h.force_before_n[2] * 1e3,
                h.force_after_n[2] * 1e3,
                p.steps,
                one * 1e3,
                p.health.force_imbalance
            );
            let _ = matches!(h.event, Event::Slip { .. });
        }
        if i % every == 0 && d >= from {
            let [a, b] = twin.needle_forces().unwrap_or_default();
            let r: Vec<String> = twin.tip_rings().iter().map(|x| format!("{:.4}", x * 1e3)).collect();
            let q: Vec<String> = twin.tip_pushes().iter().map(|x| format!("{:.3}", x * 1e3)).collect();
            println!(
                "d {:.4} F {:.3} base {:.3} friction {:.3} tip {:.3} front {:.4} rings [{}] push [{}] steps {} imb {:.4} kin {:.4}",
                d * 1e3,
                p.force_n[2] * 1e3,
                -p.base_force_n[2] * 1e3,
                a * 1e3,
                b * 1e3,
                twin.cut_depth().unwrap_or(0.0) * 1e3,
                r.join(" "),
                q.join(" "),
                p.steps,
                p.health.force_imbalance,
                p.health.kinetic_to_strain_energy
            );
            shown += 1;
        }
    }
    println!(
        "poses {n} steps {steps} per pose {:.1} longest {:.0} ms whole {:.1} s build {:.1} s {shown}",
        steps as f64 / n as f64,
        most * 1e3,
        t0.elapsed().as_secs_f64(),
        built.as_secs_f64()
    );
}
