//! A scene with a plane of symmetry runs on one half of the sample, and shows all of it.
#![allow(clippy::unwrap_used, clippy::panic)]

use needle_core::scene::{Dimension, Override, Scene, Word as _};
use needle_core::twin::{Halt, Pose, Prediction, StampedPose, Twin};
use testkit::coarse;
use testkit::coarse::{alone, at_depth, press, travel};

fn with(preset: &str, changes: &[(&str, &str)]) -> Result<Scene, String> {
    let changes: Vec<_> = changes.iter().map(|(path, value)| Override::text(path, value, "test")).collect();
    Scene::preset(preset).unwrap().with(&changes).map_err(|e| e.to_string())
}

/// A coarse preset in one of the dimensions.
fn twin(preset: &str, dimension: &str, changes: &[(&str, &str)]) -> Twin {
    let changes = [&[("discretisation.dimension", dimension)], changes].concat();
    alone(|| Twin::new(&coarse::scene(preset, &changes)).unwrap())
}

const OBLIQUE: [(&str, &str); 1] = [("instrument.tilt_rad", "0.26")];
const BLOCK: [(&str, &str); 3] = [("sample.shape", "box"), ("sample.size_x_m", "0.03"), ("sample.size_y_m", "0.024")];
const LUMP: &str = "[materials.hard]\nmodel = \"neo_hookean\"\nshear_modulus_pa = 8390.0\n[[regions]]\nname = \"lump\"\nmaterial = \
    \"hard\"\nshape = \"sphere\"\ncentre_m = [0.001, 0.0, 0.012]\nradius_m = 0.003\n";
const SKIN: &str = "[materials.skin]\nmodel = \"neo_hookean\"\nshear_modulus_pa = 8390.0\n[[regions]]\nname = \"skin\"\nmaterial = \
    \"skin\"\nshape = \"layer\"\nto_depth_m = 0.002\n";

#[test]
fn auto_takes_a_plane_of_symmetry_or_says_why_there_is_none() {
    let beside = [("instrument.entry_x_m", "0.002"), ("instrument.entry_y_m", "-0.001")];
    let azimuth = ("instrument.azimuth_rad", "0.7");
    let height = ("sample.height_m", "0.017");
    let block = [&BLOCK[..], &[height]].concat();
    type Case<'a> = (&'a str, Vec<(&'a str, &'a str)>, Dimension, &'a [&'a str]);
    let cases: [Case; 7] = [
        ("needle_insertion", OBLIQUE.to_vec(), Dimension::Mirrored, &["tilt_rad", "azimuth 0.0000"]),
        ("needle_insertion", [&OBLIQUE[..], &[azimuth]].concat(), Dimension::Mirrored, &["azimuth 0.7000"]),
        ("needle_insertion", beside.to_vec(), Dimension::Mirrored, &["beside the sample's axis", "plane"]),
        ("needle_insertion", [&OBLIQUE[..], &beside].concat(), Dimension::Full, &["does not meet the sample's axis"]),
        ("indentation", block.clone(), Dimension::Mirrored, &["box"]),
        ("indentation", [&block[..], &beside].concat(), Dimension::Full, &["no plane of symmetry of the box"]),
        (
            "needle_insertion",
            [&beside[..1], &[("instrument.interaction", "frictional")]].concat(),
            Dimension::Mirrored,
            &["beside the sample's axis", "plane"],
        ),
    ];
    for (preset, changes, dimension, words) in cases {
        let resolved = with(preset, &changes).unwrap().dimension();
        assert_eq!(resolved.dimension, dimension, "{changes:?}: {}", resolved.because);
        assert!(words.iter().all(|w| resolved.because.contains(w)), "{changes:?}: {}", resolved.because);
        let asked = with(preset, &[&changes[..], &[("discretisation.dimension", "mirrored")]].concat());
        match asked {
            Ok(scene) => assert_eq!(scene.dimension().dimension, Dimension::Mirrored),
            Err(said) => {
                assert_eq!(dimension, Dimension::Full, "{said}");
                assert!(said.contains("discretisation.dimension") && said.contains("use full or auto"), "{said}");
            }
        }
    }
}

/// Along the axis and across it, at rest. The clouds differ, so the forces do as those of any two clouds of that spacing.
#[test]
fn the_force_is_that_of_the_whole_sample() {
    let both = |preset, changes: &[(&str, &str)], depth| {
        ["full", "mirrored"].map(|dimension| {
            let mut twin = twin(preset, dimension, changes);
            assert_eq!(twin.dimension().as_str(), dimension);
            let work = twin.integration_points() as f64 * twin.step_work().flops;
            (work, press(&mut twin, depth).force_n)
        })
    };
    let smooth = [
        ("instrument.contact", "frictionless"),
        ("instrument.entry_y_m", "0.004"),
        ("discretisation.spacing_m", "0.0025"),
    ];
    let thin = [("instrument.capture_radius_m", "0.0005"), ("discretisation.edge_refinement", "0.0833")];
    let oblique = [&OBLIQUE[..], &thin].concat();
    let beside = [&[("instrument.entry_x_m", "-0.006")][..], &thin].concat();
    for (preset, changes, depth, within) in [
        ("needle_insertion", &oblique[..], 2e-3, 0.01),
        ("needle_insertion", &beside, 2e-3, 0.01),
        ("indentation", &smooth, 1e-3, 0.02),
        ("indentation", &BLOCK, 1e-3, 0.02),
    ] {
        let [(work, full), (half_work, half)] = both(preset, changes, depth);
        let size = full.iter().map(|f| f * f).sum::<f64>().sqrt();
        let apart = (0..3).map(|k| (half[k] - full[k]).powi(2)).sum::<f64>().sqrt() / size;
        let share = half_work / work;
        println!("{preset} {changes:?}: {half:?} N for {share:.2} of the work of {full:?} N, {apart:.4} apart");
        assert!(apart < within, "{preset} {changes:?}: {half:?} {full:?}");
        assert!(share < 0.65, "{preset} {changes:?}: {share}");
    }
}

/// What slips, cuts and breaks in the half is half of it all: forces of shaft and tip, depth of the cut, work, on the way in, through a membrane,
/// and out.
#[test]
fn a_needle_with_friction_is_modelled_by_halves() {
    let needle = [
        OBLIQUE[0],
        ("instrument.interaction", "frictional"),
        ("instrument.friction_n_per_m", "3"),
        ("instrument.cutting_force_n", "0.004"),
        ("instrument.puncture_force_n", "0.006"),
        ("discretisation.edge_refinement", "0.1"),
    ];
    let thick = [("instrument.diameter_m", "0.002"), ("instrument.capture_radius_m", "0.001")];
    let changes = [&needle[..], &thick].concat();
    let mut twins = ["full", "mirrored"].map(|dimension| twin("needle_insertion", dimension, &changes));
    assert!(2 * twins[1].nodes() < twins[0].nodes() + 400, "{:?}", twins.each_ref().map(Twin::nodes));
    let mut peak = 0.0_f64;
    for k in 1..=110_i32 {
        let depth = 5e-5 * f64::from(60 - (k - 60).abs());
        let time_s = 0.01 * f64::from(k);
        let step = |twin: &mut Twin| twin.step(StampedPose { time_s, pose: twin.pose_at_depth(depth) }).unwrap();
        let [full, half] = twins.each_mut().map(step).map(|answer| answer.force_n);
        peak = full.iter().map(|f| f * f).sum::<f64>().sqrt().max(peak);
        assert_eq!(half[1], 0.0, "the force across the plane is none");
        if k % 20 > 0 {
            continue;
        }
        let told = twins.each_ref().map(|twin| {
            let [shaft, tip] = twin.needle_forces().unwrap();
            [shaft, tip, twin.cut_depth().unwrap(), twin.dissipated_j()]
        });
        println!("{depth:.5} m: {half:?} of {full:?} N; {:?} of {:?}", told[1], told[0]);
        let apart = (0..3).map(|i| (half[i] - full[i]).powi(2)).sum::<f64>().sqrt();
        assert!(apart < 0.01 * peak, "{depth}: {half:?} {full:?}");
        (0..2).for_each(|i| assert!((told[1][i] - told[0][i]).abs() < 0.01 * peak, "{depth}: {told:?}"));
        assert!((told[1][2] - told[0][2]).abs() < 1e-4, "cut {told:?}");
        assert!((told[1][3] / told[0][3] - 1.0).abs() < 0.05, "work {told:?}");
    }
}

#[test]
fn regions_are_modelled_by_halves() {
    let of = |region: &str, dimension: &str, azimuth: &str| {
        let changes = [
            OBLIQUE[0],
            ("discretisation.dimension", dimension),
            ("instrument.azimuth_rad", azimuth),
            ("instrument.capture_radius_m", "0.0005"),
            ("discretisation.spacing_m", "0.0025"),
            ("discretisation.edge_refinement", "0.1"),
        ];
        let scene = coarse::scene("needle_insertion", &changes);
        Scene::from_toml(&(scene.to_toml() + region), "regions.toml")
    };
    for region in [SKIN, LUMP] {
        let [full, half] = ["full", "mirrored"].map(|dimension| {
            let mut twin = alone(|| Twin::new(&of(region, dimension, "0").unwrap()).unwrap());
            assert_eq!(twin.cells().len(), twin.cell_regions().len());
            press(&mut twin, 1.5e-3).force_n
        });
        println!("{half:?} N, {full:?} N");
        assert!((0..3).all(|k| (half[k] - full[k]).abs() < 0.03 * full[2]), "{half:?} {full:?}");
    }
    // a layer is symmetric about any plane, a lump about that through its centre alone
    assert_eq!(of(SKIN, "auto", "0.5").unwrap().dimension().dimension, Dimension::Mirrored);
    let beside = of(LUMP, "auto", "0.5").unwrap().dimension();
    assert!(beside.dimension == Dimension::Full && beside.because.contains("regions.lump.centre_m"), "{beside:?}");
}

#[test]
fn the_plane_may_stand_at_any_azimuth() {
    let force = |azimuth: f64| {
        let text = format!("{azimuth}");
        let mut twin = twin("needle_insertion", "auto", &[OBLIQUE[0], ("instrument.azimuth_rad", &text)]);
        assert_eq!(twin.dimension(), Dimension::Mirrored);
        press(&mut twin, 2e-3)
    };
    let straight = force(0.0);
    assert_eq!(straight.force_n[1], 0.0);
    for azimuth in [0.7, std::f64::consts::FRAC_PI_2, -2.0] {
        let Prediction { force_n, torque_nm, .. } = force(azimuth);
        let (sin, cos) = azimuth.sin_cos();
        let turned = |v: [f64; 3]| [cos * v[0] + sin * v[1], cos * v[1] - sin * v[0], v[2]];
        for (mine, theirs, within) in [
            // rounding decides between nodes of the pressure that are equally good
            (turned(force_n), straight.force_n, 2e-3 * straight.force_n[2]),
            // a small moment of forces that nearly balance: over the force times the depth
            (turned(torque_nm), straight.torque_nm, 1e-3 * straight.force_n[2] * 2e-3),
        ] {
            println!("azimuth {azimuth}: {mine:?} {theirs:?}");
            (0..3).for_each(|k| assert!((mine[k] - theirs[k]).abs() < within, "{azimuth}: {mine:?} {theirs:?}"));
        }
    }
}

#[test]
fn the_whole_sample_is_shown_and_all_targets_move() {
    let mut scene = coarse::scene("needle_insertion", &OBLIQUE);
    scene.discretisation.dimension = Dimension::Mirrored;
    // a target and its image beyond the plane y = 0, and one on it
    let mut target = scene.targets[0].clone();
    scene.targets.clear();
    for (name, y) in [("left", 0.002), ("right", -0.002), ("middle", 0.0)] {
        target.name = name.to_owned();
        target.position = [0.001, y, 0.014];
        scene.targets.push(target.clone());
    }
    let mut twin = alone(|| Twin::new(&scene).unwrap());
    travel(&mut twin, 0.0, 2e-3, 100);
    let (points, mut u, mut jacobian, mut stress) = (twin.reference_points(), Vec::new(), Vec::new(), Vec::new());
    twin.displacements(&mut u);
    twin.jacobian_and_stress(&mut jacobian, &mut stress);
    assert!([u.len(), jacobian.len(), stress.len()].iter().all(|len| *len == points.len()));
    assert!(points.len() > twin.nodes() && points.len() < 2 * twin.nodes());
    for n in twin.nodes()..points.len() {
        let [x, y, z] = points[n];
        let other = points.iter().position(|p| *p == [x, -y, z]).unwrap();
        assert_eq!(u[n], [u[other][0], -u[other][1], u[other][2]]);
        assert_eq!((jacobian[n], stress[n]), (jacobian[other], stress[other]));
    }
    let volume = |c: &[u32; 4]| {
        let [a, b, c, d] = c.map(|n| points[n as usize]);
        let [u, v, w] = [b, c, d].map(|p| [0, 1, 2].map(|k| p[k] - a[k]));
        let cross = [v[1] * w[2] - v[2] * w[1], v[2] * w[0] - v[0] * w[2], v[0] * w[1] - v[1] * w[0]];
        (0..3).map(|k| u[k] * cross[k]).sum::<f64>() / 6.0
    };
    let (least, sum) = twin.cells().iter().map(volume).fold((f64::MAX, 0.0), |(m, s), v| (v.min(m), s + v));
    let cylinder = std::f64::consts::PI * 0.015 * 0.015 * 0.017;
    assert!(least > 0.0 && (sum / cylinder - 1.0).abs() < 0.03, "{least} {sum} {cylinder}");
    let mut seen = Vec::new();
    twin.target_positions(&mut seen);
    assert!((0..3).all(|k| (seen[0][k] - if k == 1 { -seen[1][k] } else { seen[1][k] }).abs() < 1e-12), "{seen:?}");
    assert!(seen[2][1].abs() < 1e-12 && seen[2][2] < 0.014, "{seen:?}");
}

#[test]
fn a_pose_out_of_the_plane_is_refused_and_one_within_it_is_followed() {
    let mut twin = twin("needle_insertion", "auto", &OBLIQUE);
    let mut control = self::twin("needle_insertion", "auto", &OBLIQUE);
    for twin in [&mut twin, &mut control] {
        travel(twin, 0.0, 1.5e-3, 75);
    }
    let good = twin.pose_at_depth(1.5e-3);
    let moved = |by: [f64; 3], lean: f64| {
        let [x, _, z] = good.axis;
        let axis = [x * (1.0 - lean * lean).sqrt(), lean, z * (1.0 - lean * lean).sqrt()];
        StampedPose {
            time_s: 0.0,
            pose: Pose { tip: std::array::from_fn(|k| good.tip[k] + by[k]), axis, roll_rad: 0.0 },
        }
    };
    for pose in [moved([0.0, 1e-4, 0.0], 0.0), moved([0.0; 3], 0.01)] {
        let Err(Halt::Pose { reason }) = twin.step(pose) else { panic!("{pose:?} is taken") };
        assert!(
            reason.contains("plane of symmetry") && reason.contains("discretisation.dimension = \"full\""),
            "{reason}"
        );
    }
    let before = at_depth(&mut twin, 1.5e-3);
    assert_eq!(before, at_depth(&mut control, 1.5e-3), "the state is untouched");
    // what trembles is borne
    let noisy = twin.step(moved([0.0, 1e-5, 0.0], 1e-4)).unwrap();
    assert!(noisy.force_n[1] == 0.0, "{:?}", noisy.force_n);
    let aside = (1..=20).map(|i| twin.step(moved([2e-5 * f64::from(i), 0.0, 0.0], 0.0)).unwrap()).last().unwrap();
    println!("{:?} N, moved aside {:?} N", before.force_n, aside.force_n);
    assert!(aside.force_n[0] < before.force_n[0] - 0.002 && aside.force_n[1] == 0.0, "{:?}", aside.force_n);
}

/// Where a tilted path meets a layer's boundary, its nodes are its own: turned layers of the path were joined by nodes of
/// the line in which boundary and plane of symmetry meet, and the scene was refused.
#[test]
fn a_tilted_path_through_layers_is_modelled_by_halves() {
    for tilt in ["0.24", "0.26", "0.4"] {
        for depth in ["0.002", "0.003", "0.0037"] {
            let skin = SKIN.replace("0.002", depth);
            let tilted = Scene::preset("needle_insertion").unwrap().to_toml() + &skin;
            let change = |key: &str, value: &str| Override::text(key, value, "test");
            let changes = [change("instrument.tilt_rad", tilt), change("discretisation.dimension", "mirrored")];
            let scene = Scene::from_toml(&tilted, "layers").unwrap().with(&changes).unwrap();
            if let Err(error) = Twin::new(&scene) {
                panic!("tilt {tilt}, boundary at {depth} m: {error}");
            }
        }
    }
}
