//! The deformation coefficient of a needle with friction: tissue travel over needle travel, a result where the kinematic needle has a key.
#![allow(clippy::unwrap_used)]

use needle_core::scene::Scene;
use needle_core::twin::Twin;
use testkit::coarse::{alone, at_depth, travel};

const HEAD: &str = "[sample]\nshape = \"cylinder\"\ndiameter_m = 0.030\nheight_m = 0.017\n[material]\nmodel = \
    \"neo_hookean\"\nshear_modulus_pa = 1678.0\npoisson_ratio = 0.49\ndensity_kg_per_m3 = 970.0\n\
    [discretisation]\nspacing_m = 2.33e-3\nedge_refinement = 0.11\ngrowth = 0.3\n[instrument]\nkind = \"needle\"\n\
    diameter_m = 0.001\ncapture_radius_m = 0.0005\n";

fn built(keys: &str) -> Twin {
    alone(|| Twin::new(&Scene::from_toml(&format!("{HEAD}{keys}"), "needle.toml").unwrap()).unwrap())
}

#[test]
fn tissue_sticks_first_and_is_left_behind_as_the_shaft_slips() {
    let mut twin = built(
        "interaction = \"frictional\"\nfriction_n_per_m = 3.0\ncutting_force_n = 0.003\n[motion]\nstart_depth_m = 0.008\n\
         depth_m = 0.009\n",
    );
    let mut seen = Vec::new();
    for k in 0..10 {
        travel(&mut twin, 8e-3 + 1e-4 * f64::from(k), 8e-3 + 1e-4 * f64::from(k + 1), 50);
        seen.push(twin.deformation_coefficient().unwrap());
    }
    println!("at every 0.1 mm: {seen:.4?}");
    assert!(seen[0] > 0.95 && seen[0] < 1.0, "all of the shaft sticks: {seen:?}");
    assert!(seen.windows(2).all(|w| w[1] < w[0] + 1e-3) && seen[9] < 0.9, "{seen:?}");
    travel(&mut twin, 9e-3, 8.5e-3, 250);
    assert_eq!(twin.deformation_coefficient(), None, "on the way out");
}

/// What has come to the shaft goes with it wholly, as the kinematic rule with coefficient 1 has it: to the give of the sticking spring. The
/// rule itself can't be run beside it: it puts all that it holds at the depth of the tip, and loses the solution after half a millimetre,
/// this after 1.4 mm.
#[test]
fn endless_friction_without_cutting_takes_along_all_that_the_shaft_has_come_to() {
    let run = |friction: &str| {
        let target = "[[targets]]\nname = \"top\"\nposition_m = [0.00049, 0, 0.01699]\n";
        let mut twin = built(&format!(
            "interaction = \"frictional\"\nfriction_n_per_m = {friction}\n[motion]\ndepth_m = 0.004\n{target}"
        ));
        let (mut before, mut after) = (Vec::new(), Vec::new());
        travel(&mut twin, 0.0, 0.8e-3, 400);
        twin.target_positions(&mut before);
        let force = travel(&mut twin, 0.8e-3, 1.2e-3, 200).last().unwrap().force_n[2];
        twin.target_positions(&mut after);
        let share = (before[0][2] - after[0][2]) / 4e-4;
        println!("{friction} N/m: {force:.6} N, tissue at the shaft goes {share:.4} of the way");
        (force, share)
    };
    let [a, b] = ["100.0", "1000.0"].map(run);
    assert!((a.0 / b.0 - 1.0).abs() < 1e-3, "{a:?} {b:?}");
    assert!((b.1 - 1.0).abs() < 0.05, "{b:?}");
}

/// The force on the needle once nothing is left to be done at a depth, N.
fn at_rest(twin: &mut Twin, depth: f64) -> f64 {
    (0..500).map(|_| at_depth(twin, depth)).find(|answer| answer.steps == 0).unwrap().force_n[2]
}

/// In place, 8 mm deep, and moved by 10 um: in, where the face of the tip pushes, endless friction is the kinematic rule with
/// coefficient 1 but
/// for the spring of sticking (the kinematic needle comes to its depth with coefficient 0 and is moved out with 1; its capture window, in
/// which tissue ahead of the tip is pinned, is next to nothing). Out, the face does not pull, and the force is smaller by that.
#[test]
fn endless_friction_in_place_is_the_kinematic_rule_with_coefficient_1() {
    let way = 1e-5;
    let mut moved = [1.0, -1.0].map(|side| {
        let keys = "interaction = \"frictional\"\nfriction_n_per_m = 1e4\ncutting_force_n = 10.0\n[motion]\nstart_depth_m = \
             0.008\ndepth_m = 0.01\n";
        let mut twin = built(keys);
        travel(&mut twin, 8e-3, 8e-3 + side * way, 20);
        side * at_rest(&mut twin, 8e-3 + side * way)
    });
    let mut kinematic = built(
        "deformation_coefficient = 0.0\nretraction_coefficient = 1.0\ncapture_window_m = 1e-6\n[motion]\ndepth_m = 0.01\n",
    );
    // a little below the layer of nodes at 8 mm, so that it is held on the way out
    let deepest = 8.02e-3;
    travel(&mut kinematic, 0.0, deepest, 401);
    travel(&mut kinematic, deepest, deepest - way, 20);
    let rule = -at_rest(&mut kinematic, deepest - way);
    moved.iter_mut().for_each(|force| *force /= rule);
    println!("{moved:.4?} of {rule} N");
    assert!((moved[0] - 1.0).abs() < 0.02 && moved[1] < moved[0] && moved[1] > 0.9, "{moved:?}");
}
