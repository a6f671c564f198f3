//! Scenes of physics alone, as somebody writes them who has not read how the solver works: other stiffness, size, law and place than the presets.
//! Each was once refused, lost, or out of balance at the program's own settings.
#![allow(clippy::unwrap_used, clippy::panic)]

use needle_core::scene::Scene;
use needle_core::twin::{Prediction, StampedPose, Twin};

/// The scene's own motion at its own speed.
fn run(text: &str) -> Vec<Prediction> {
    let scene = Scene::from_toml(text, "plain.toml").unwrap();
    let mut twin = Twin::new(&scene).unwrap();
    let poses: Vec<_> = scene.motion.unwrap().poses().collect();
    let step = |(time_s, depth_m)| {
        let pose = twin.pose_at_depth(depth_m);
        twin.step(StampedPose { time_s, pose }).unwrap()
    };
    poses.into_iter().map(step).collect()
}

/// Root mean square and largest difference of the forces on instrument and base, over the peak force.
fn imbalance(answers: &[Prediction]) -> (f64, f64) {
    let length = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
    let peak = answers.iter().map(|a| length(a.force_n)).fold(0.0, f64::max);
    let of = |a: &Prediction| length(std::array::from_fn(|k| a.force_n[k] + a.base_force_n[k])) / peak;
    let square = answers.iter().map(|a| of(a).powi(2)).sum::<f64>() / answers.len() as f64;
    (square.sqrt(), answers.iter().map(of).fold(0.0, f64::max))
}

/// Tissue that stiffens throws the needle's force by a fifth of the peak where a layer of nodes is taken or left.
#[test]
fn a_kinematic_needle_in_tissue_that_stiffens_has_no_jumps() {
    let answers = run("[sample]\nshape = \"box\"\nsize_x_m = 0.043\nsize_y_m = 0.0375\nheight_m = 0.06\n[material]\n\
        model = \"veronda_westmann\"\nshear_modulus_pa = 16000.0\nstiffening_exponent = 3.0\npoisson_ratio = 0.49\n\
        density_kg_per_m3 = 1000.0\n[instrument]\nkind = \"needle\"\ndiameter_m = 0.00166\ncapture_radius_m = 0.00083\n\
        [motion]\ndepth_m = 0.005\nspeed_m_per_s = 0.005\npose_hz = 1000.0\nretract = true\n");
    let (mean, most) = imbalance(&answers);
    println!("imbalance {:.2} %, at most {:.2} %", 100.0 * mean, 100.0 * most);
    assert!(mean < 0.011 && most < 0.05, "{mean} {most}");
    let last = answers.last().unwrap();
    assert!(last.depth_m.abs() < 1e-9 && last.health.folded_energy < 0.01, "{last:?}");
}

/// A needle of little friction in stiff tissue was judged by a force that it never meets, that of a body as wide as it is high.
#[test]
fn a_needle_of_little_friction_in_a_large_stiff_sample_is_balanced() {
    let answers = run(
        "[sample]\nshape = \"cylinder\"\ndiameter_m = 0.06\nheight_m = 0.056\n[material]\nmodel = \"neo_hookean\"\n\
        shear_modulus_pa = 16000.0\npoisson_ratio = 0.45\ndensity_kg_per_m3 = 1000.0\n[instrument]\nkind = \"needle\"\n\
        diameter_m = 0.0018\ncapture_radius_m = 0.0009\ninteraction = \"frictional\"\nfriction_n_per_m = 3.0\n\
        cutting_force_n = 0.01\n[motion]\ndepth_m = 0.005\nspeed_m_per_s = 0.005\npose_hz = 1000.0\n",
    );
    let (mean, most) = imbalance(&answers);
    println!("imbalance {:.2} %, at most {:.2} %", 100.0 * mean, 100.0 * most);
    assert!(mean < 0.01 && most < 0.05, "{mean} {most}");
}

/// Lumps that touch the surface nearly, end at it, or come out of it, in a half plane and in half of a box.
#[test]
fn lumps_at_the_surface_are_meshed() {
    let half_plane = "shape = \"cylinder\"\ndiameter_m = 0.043\nheight_m = 0.039\n";
    let space = "shape = \"box\"\nsize_x_m = 0.0344\nsize_y_m = 0.0466\nheight_m = 0.0286\n";
    let sphere =
        |x: f64, z: f64, radius: f64| format!("shape = \"sphere\"\ncentre_m = [{x}, 0.0, {z}]\nradius_m = {radius}\n");
    let column = |z: f64, height: f64| {
        format!("shape = \"cylinder\"\ncentre_m = [0.0, 0.0, {z}]\nradius_m = 0.00412\nheight_m = {height}\n")
    };
    let indenter = "kind = \"indenter\"\ndiameter_m = 0.0175\n[motion]\ndepth_m = 0.003\n";
    let needle = "kind = \"needle\"\ndiameter_m = 0.00124\ncapture_radius_m = 0.00062\ninteraction = \"frictional\"\n\
        friction_n_per_m = 1.0\ncutting_force_n = 0.01\n[motion]\ndepth_m = 0.0051\n";
    for (sample, lump, instrument) in [
        (half_plane, sphere(0.0, 0.036, 0.00412), indenter),
        (half_plane, sphere(0.0, 0.03508, 0.0039), indenter),
        (half_plane, column(0.0365, 0.005), indenter),
        (half_plane, column(0.036, 0.02), indenter),
        (space, sphere(0.00572, 0.02503, 0.00286), needle),
        (space, sphere(0.00572, 0.02603, 0.00286), needle),
        (space, sphere(0.0143, 0.019, 0.00286), needle),
    ] {
        let text = format!(
            "[sample]\n{sample}[material]\nmodel = \"neo_hookean\"\nshear_modulus_pa = 2000.0\npoisson_ratio = 0.45\n\
             density_kg_per_m3 = 1000.0\n[materials.hard]\nmodel = \"neo_hookean\"\nshear_modulus_pa = 8000.0\n[[regions]]\n\
             name = \"lump\"\nmaterial = \"hard\"\n{lump}[instrument]\n{instrument}"
        );
        let scene = Scene::from_toml(&text, "plain.toml").unwrap();
        let mut twin = Twin::new(&scene).unwrap_or_else(|e| panic!("{e}: {lump}"));
        let pose = twin.pose_at_depth(2e-4);
        let force = (0..3).map(|_| twin.step(StampedPose { time_s: 0.1, pose }).unwrap().force_n[2]).last().unwrap();
        assert!(force > 1e-5 && force.is_finite(), "{force}: {lump}");
    }
}
