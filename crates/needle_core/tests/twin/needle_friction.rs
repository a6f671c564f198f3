//! A needle with friction, cutting and puncture: against the reference, its limits, its cycles, and at any pose rate.
#![allow(clippy::unwrap_used)]

use needle_core::scene::{Dimension, Override, Scene};
use needle_core::twin::{Event, Health, Phase, Prediction, Twin};
use testkit::coarse::{alone, at_depth, digits, travel};

const SAMPLE: &str = "[sample]\nshape = \"cylinder\"\ndiameter_m = 0.030\nheight_m = 0.017\n[material]\nmodel = \
    \"neo_hookean\"\nshear_modulus_pa = 1678.0\npoisson_ratio = 0.49\ndensity_kg_per_m3 = 970.0\n";
const NEEDLE: &str =
    "[instrument]\nkind = \"needle\"\ndiameter_m = 0.001\ncapture_radius_m = 0.0005\ninteraction = \"frictional\"\n";
const CLOUD: &str = "[discretisation]\nspacing_m = 2.33e-3\nedge_refinement = 0.11\ngrowth = 0.3\n";
const RUBS: &str = "friction_n_per_m = 3.0\ncutting_force_n = 0.003\n";
/// Skin of half a millimetre with a membrane.
const SKIN: &str = "[materials.skin]\nmodel = \"neo_hookean\"\nshear_modulus_pa = 16780.0\nfriction_n_per_m = 3.0\n\
    cutting_force_n = 0.003\npuncture_force_n = 0.02\n[[regions]]\nname = \"skin\"\nmaterial = \"skin\"\nshape = \
    \"layer\"\nfrom_depth_m = 0.0\nto_depth_m = 0.0005\n";

fn built(parts: &[&str]) -> Twin {
    alone(|| Twin::new(&Scene::from_toml(&parts.concat(), "needle.toml").unwrap()).unwrap())
}

fn reference(case: &str) -> Vec<Vec<f64>> {
    let text = std::fs::read_to_string(format!("{}/bags/reference/{case}.csv", testkit::root().display())).unwrap();
    text.lines().skip(1).map(|line| line.split(',').map(|x| x.parse().unwrap()).collect()).collect()
}

#[test]
fn an_embedded_needle_is_held_as_the_reference_has_it() {
    let targets = "[motion]\nstart_depth_m = 0.008\ndepth_m = 0.009\n[[targets]]\nname = \"below\"\nposition_m = [0, 0, 0.009]\n\
        [[targets]]\nname = \"surface\"\nposition_m = [0.00303, 0, 0.017]\n[[targets]]\nname = \"halfway\"\nposition_m = \
        [0.001493, 0, 0.013062]\n";
    let mut twin = built(&[SAMPLE, NEEDLE, RUBS, CLOUD, targets]);
    assert_eq!(twin.dimension(), Dimension::Axisymmetric);
    let (mut at, mut depth) = (Vec::new(), 0.008);
    twin.target_positions(&mut at);
    let rest = at.clone();
    let (mut force, mut beside, mut below, mut dissipated): (f64, f64, Vec<f64>, f64) = (0.0, 0.0, Vec::new(), 0.0);
    for row in reference("needle_friction").into_iter().skip(1) {
        let to = 0.008 + row[0];
        let last = *travel(&mut twin, depth, to, 100).last().unwrap();
        depth = to;
        twin.target_positions(&mut at);
        let off: Vec<f64> = (0..3).map(|i| (at[i][2] - rest[i][2] - row[3 + i]).abs() / 1e-3).collect();
        println!(
            "{:+.4} m: {:.5} N, reference {:.5} N; displacements off by {off:.4?} of the motion",
            row[0], last.force_n[2], row[1]
        );
        force = force.max((last.force_n[2] - row[1]).abs() / 0.027);
        beside = beside.max(off[1]).max(off[2]);
        below.push(off[0]);
        if row[0] > 0.00099 {
            assert!(off[0] < 0.01, "below the tip on the plateau: {off:?}");
        }
        assert!(twin.dissipated_j() >= dissipated, "slip makes no energy");
        dissipated = twin.dissipated_j();
        if row[0] > 0.00099 {
            let parts = twin.needle_forces().unwrap();
            assert!((last.force_n[2] / 0.027 - 1.0).abs() < 0.005, "plateau {} of {parts:?}", last.force_n[2]);
        }
    }
    below.sort_by(|a, b| b.total_cmp(a));
    println!(
        "largest error: force {force:.4} of the plateau, displacement beside {beside:.4}, below the tip {below:.4?}"
    );
    assert!(force < 0.02 && beside < 0.02, "{force} {beside}");
    // largest where the last of the shaft begins to slip: one pose in a few micrometres in which the tip goes on
    assert!(below[0] < 0.035 && below[1] < 0.02, "{below:?}");
}

/// Where all of the needle slips, loads alone decide how tissue under its face sinks: at its nodes as an own finite-element solution has it
/// (references/needle_face.py). Two of the face's three rings are nowhere in the shared table.
#[test]
fn the_face_of_an_embedded_tip_sinks_as_finite_elements_have_it() {
    let text = std::fs::read_to_string(format!("{}/tests/references/needle_face.csv", testkit::root().display()));
    let table: Vec<[f64; 2]> = text
        .unwrap()
        .lines()
        .skip(1)
        .map(|line| line.split_once(',').map(|(r, u)| [r.parse().unwrap(), u.parse().unwrap()]).unwrap())
        .collect();
    let target =
        |(i, [r, _]): (usize, &[f64; 2])| format!("[[targets]]\nname = \"{i}\"\nposition_m = [{r}, 0, 0.009]\n");
    let targets: String = table.iter().enumerate().map(target).collect();
    let mut twin =
        built(&[SAMPLE, NEEDLE, RUBS, CLOUD, "[motion]\nstart_depth_m = 0.008\ndepth_m = 0.009\n", &targets]);
    let (mut rest, mut at) = (Vec::new(), Vec::new());
    twin.target_positions(&mut rest);
    travel(&mut twin, 8e-3, 9e-3, 1000);
    twin.target_positions(&mut at);
    let (mut nodes, mut between): (f64, f64) = (0.0, 0.0);
    for (i, [r, uz]) in table.iter().enumerate() {
        let off = (at[i][2] - rest[i][2] - uz) / 1e-3;
        println!("r {r} m: {off:+.4} of the motion");
        let on_a_ring = (r / 2.5e-4).fract() < 1e-6;
        let worst = if on_a_ring { &mut nodes } else { &mut between };
        *worst = worst.max(off.abs());
    }
    println!("{nodes:.4} at the rings, {between:.4} between");
    assert!(nodes < 0.02 && between < 0.05, "{nodes} {between}");
}

#[test]
fn without_friction_the_force_is_that_of_cutting() {
    let motion = "[motion]\ndepth_m = 0.006\n";
    let mut smooth = built(&[SAMPLE, NEEDLE, "cutting_force_n = 0.003\n", CLOUD, motion]);
    let forces = travel(&mut smooth, 0.0, 5e-3, 1000);
    for a in forces.iter().skip(400).step_by(50) {
        assert!((a.force_n[2] / 0.003 - 1.0).abs() < 0.05, "{} m: {} N", a.depth_m, a.force_n[2]);
    }
    // out again, nothing holds it
    let back = travel(&mut smooth, 5e-3, 3e-3, 400);
    assert!(back.last().unwrap().force_n[2].abs() < 1e-4, "{:?}", back.last());
    assert_eq!(back.last().unwrap().phase, Phase::Retraction);
}

/// Force at twenty places on the way from one depth to a second and halfway back, m, in so many poses for a millimetre with so many steps
/// each, at least.
fn there_and_back(from: f64, to: f64, poses: u32, least: u32) -> Vec<f64> {
    let keys = format!(
        "[motion]\nstart_depth_m = {from}\ndepth_m = {}\n[stepping]\nmin_steps_per_pose = {least}\n",
        to + 1e-3
    );
    let mut twin = built(&[SAMPLE, NEEDLE, RUBS, CLOUD, &keys]);
    let down = travel(&mut twin, from, to, poses);
    let up = travel(&mut twin, to, 0.5 * (from + to), poses / 2);
    let every = poses as usize / 20;
    [down, up].concat().iter().skip(every - 1).step_by(every).map(|a| a.force_n[2]).collect()
}

/// In place, and from the surface on, against a curve with 32 steps for a micrometre. The error is largest just after the turn, where slip
/// spreads the other way.
#[test]
fn the_curve_does_not_depend_on_the_pose_rate() {
    for (from, to) in [(4e-3, 5e-3), (0.0, 1e-3)] {
        let fine = there_and_back(from, to, 4000, 8);
        let peak = fine.iter().copied().fold(0.0, f64::max);
        for poses in [20, 100, 1000, 4000] {
            let coarse = there_and_back(from, to, poses, 1);
            let off: Vec<f64> = fine.iter().zip(&coarse).map(|(a, b)| (b - a) / peak).collect();
            let worst = off.iter().map(|x| x.abs()).fold(0.0, f64::max);
            println!("from {from} m, {poses} poses for a millimetre: {worst:.4} of the peak, {peak} N");
            // where a pose is several strides, single ones are farther off
            assert!(worst < if poses <= 100 { 0.018 } else { 0.01 }, "{from} {poses}: {off:.4?}");
        }
    }
}

/// Slow modes with less inertia: few steps a pose, and the force of many.
#[test]
fn a_pose_takes_few_steps_and_has_the_force_of_many() {
    let curve = |stepping: &str| {
        let keys = format!("[motion]\ndepth_m = 0.004\n[stepping]\n{stepping}");
        let mut twin = built(&[SAMPLE, NEEDLE, RUBS, CLOUD, &keys]);
        let down = travel(&mut twin, 0.0, 3e-3, 600);
        let up = travel(&mut twin, 3e-3, 1e-3, 400);
        [down, up].concat()
    };
    let (few, many) = (curve(""), curve("tolerance = 0.002\nmin_steps_per_pose = 32\n"));
    let steps = few.iter().map(|a| f64::from(a.steps)).sum::<f64>() / few.len() as f64;
    let peak = many.iter().map(|a| a.force_n[2].abs()).fold(0.0, f64::max);
    let off = few.iter().zip(&many).map(|(a, b)| ((a.force_n[2] - b.force_n[2]) / peak).powi(2));
    let off = (off.sum::<f64>() / few.len() as f64).sqrt();
    println!("{steps:.2} steps a pose, {off:.5} of the peak");
    assert!(steps < 8.0 && off < 3e-3, "{steps} {off}");
}

#[test]
fn random_motions_that_end_where_they_began_take_work() {
    let mut twin = built(&[SAMPLE, NEEDLE, RUBS, CLOUD, "[motion]\nstart_depth_m = 0.004\ndepth_m = 0.006\n"]);
    let mut seed = 12345_u64;
    let mut random = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 33) as f64 / (1_u64 << 31) as f64
    };
    let mut dissipated = 0.0;
    for cycle in 0..40 {
        // there and back twice, so that the second time begins where slip has been
        let turns = [4e-3, 4e-3 + 8e-4 * random(), 4e-3 - 8e-4 * random(), 4e-3];
        let (mut work, mut size, mut before) = (0.0, 0.0, 0.0);
        for (round, pair) in [&turns[..], &turns[..]].concat().windows(2).enumerate() {
            for a in travel(&mut twin, pair[0], pair[1], 40) {
                let way = (pair[1] - pair[0]) / 40.0;
                if round > 3 {
                    work += 0.5 * (a.force_n[2] + before) * way;
                    size += a.force_n[2].abs() * way.abs();
                }
                before = a.force_n[2];
            }
            assert!(twin.dissipated_j() >= dissipated, "cycle {cycle}");
            dissipated = twin.dissipated_j();
        }
        assert!(work > -0.02 * size, "cycle {cycle} gives {work} J of {size} J");
    }
}

/// What a table of (m, N) says of a depth, N: the cubic through the four rows round it.
fn cubic(rows: &[Vec<f64>], depth: f64) -> f64 {
    let after = rows.partition_point(|row| row[0] < depth);
    let four = &rows[after.saturating_sub(2).min(rows.len() - 4)..][..4];
    let weight = |i: usize| -> f64 {
        let others = (0..4).filter(|&k| k != i);
        others.map(|k| (depth - four[k][0]) / (four[i][0] - four[k][0])).product()
    };
    (0..4).map(|i| four[i][1] * weight(i)).sum()
}

/// From the drop on the force is that of cutting and friction of what is in, however many steps a pose has: what tissue that springs back
/// swings past its rest is not cut.
#[test]
fn the_drop_ends_at_cutting_and_friction_at_any_number_of_steps() {
    let few = "max_steps_per_pose = 200\n";
    for (stepping, pose_m) in [("", 2e-6_f64), ("min_steps_per_pose = 32\n", 2e-6), (few, 2e-6), ("", 1e-5)] {
        let stepping = format!("[motion]\ndepth_m = 0.003\n[stepping]\n{stepping}");
        let mut twin = built(&[SAMPLE, SKIN, NEEDLE, RUBS, CLOUD, &stepping]);
        let (mut highest, mut lowest, mut last, mut fell) = (0.0_f64, 0.0_f64, 0.0, None);
        let mut over = Vec::new();
        for i in 1..=(1.6e-3 / pose_m).round() as u32 {
            let depth = pose_m * f64::from(i);
            last = at_depth(&mut twin, depth).force_n[2];
            highest = highest.max(last);
            let level = 0.003 + 3.0 * (twin.cut_depth().unwrap() - 0.25e-3).max(0.0);
            let off = (last - level) / 0.02;
            fell = fell.or_else(|| (highest > 0.019 && off < 0.02).then_some(depth));
            if fell.is_some() {
                lowest = lowest.min(off);
                over.push(last / level);
            }
        }
        println!(
            "{stepping:?}: {highest} N, fallen at {fell:?}, lowest {lowest:+.4} of the puncture force, then {last} N"
        );
        assert!(fell.is_some_and(|depth| (depth - 1.5e-3).abs() < 5e-5), "{fell:?}");
        let mean = over.iter().sum::<f64>() / over.len() as f64;
        println!("force over cutting and friction: {} just after the drop, {mean} in the mean", over[0]);
        assert!((over[0] - 1.0).abs() < 0.02 && (mean - 1.0).abs() < 0.02, "{} {mean}", over[0]);
        assert!(lowest > -0.02, "{lowest}");
    }
}

#[test]
fn skin_is_pierced_and_the_force_falls_to_cutting_and_friction() {
    let mut twin = built(&[SAMPLE, SKIN, NEEDLE, RUBS, CLOUD, "[motion]\ndepth_m = 0.003\n"]);
    let (mut events, mut pushes, mut totals) = (Vec::new(), Vec::new(), Vec::new());
    let step = |i: u32| {
        let answer = at_depth(&mut twin, 2e-6 * f64::from(i));
        pushes.extend(twin.needle_forces().map(|[_, push]| push));
        totals.push(twin.cut_depth().map_or(0.0, |c| answer.force_n[2] / (0.003 + 3.0 * (c - 0.25e-3).max(0.0))));
        events.extend(twin.happened().iter().map(|h| h.event));
        answer
    };
    let answers: Vec<Prediction> = (1..=1100).map(step).collect();
    let (at, event) = answers.iter().enumerate().find_map(|(i, a)| a.event.map(|e| (i, e))).unwrap();
    let Event::Puncture { depth_m, region } = event else { unreachable!("{event:?}") };
    assert_eq!((region, answers[at - 1].phase), (1, Phase::Indentation));
    println!("punctured at {depth_m} m with {} N, then {} N", answers[at - 1].force_n[2], answers[at + 2].force_n[2]);
    let mut pressed = reference("membrane_indentation");
    pressed.insert(0, vec![0.0, 0.0]);
    let off = |a: &Prediction| (a.force_n[2] - cubic(&pressed, a.depth_m)) / 0.02;
    let most = answers[..at].iter().map(off).fold(0.0_f64, |most, off| most.max(off.abs()));
    println!("up to the drop at most {most} of the puncture force off");
    // half a millimetre of skin, three radii down: 0.026 with the whole path an eighth of the radius fine, at a seventh of the speed;
    // 0.004 of it is the shaft's wall, which the reference does not have
    assert!(most < 0.04, "{most}");
    // where the reference reaches 20 mN
    assert!((depth_m - 1.52e-3).abs() < 1e-4 && (cubic(&pressed, 1.52e-3) - 0.02).abs() < 5e-5, "{depth_m}");
    assert!(answers[at + 10].force_n[2] < 0.4 * answers[at - 1].force_n[2], "it falls within 20 ms");
    let parts = twin.needle_forces().unwrap();
    let rubbed = twin.cut_depth().unwrap() - 0.25e-3;
    println!("{parts:?} N at {:?} m, {rubbed} m rubbed", answers.last().unwrap().depth_m);
    assert!(parts[0] < 3.0 * rubbed * 1.001, "{parts:?}");
    // it pushes until it cuts, and less just after, since the tissue springs back
    let last = &pushes[pushes.len() - 200..];
    let (most, mean) = (last.iter().copied().fold(0.0, f64::max), last.iter().sum::<f64>() / 200.0);
    println!("over the last 0.4 mm the tip pushes with at most {most} N, {mean} N in the mean");
    let total = totals[totals.len() - 200..].iter().sum::<f64>() / 200.0;
    println!("the force over cutting and friction of what is in: {total}");
    assert!((total - 1.0).abs() < 0.02, "{total}");
    assert!((most / 0.003 - 1.0).abs() < 1e-3 && (mean / 0.003 - 1.0).abs() < 0.03, "{most} {mean}");
    let under = events.iter().any(|e| matches!(e, Event::Entered { region: 0, .. }));
    assert!(under, "what lies under the skin: {events:?}");
}

/// A skin and a deeper layer, each behind a membrane.
const LAYERS: &str = "[materials.skin]\nmodel = \"neo_hookean\"\nshear_modulus_pa = 5000.0\nfriction_n_per_m = 2.0\n\
    cutting_force_n = 0.002\npuncture_force_n = 0.008\n[materials.deep]\nmodel = \"neo_hookean\"\nshear_modulus_pa = 1678.0\n\
    friction_n_per_m = 2.0\ncutting_force_n = 0.002\npuncture_force_n = 0.005\n[[regions]]\nname = \"skin\"\nmaterial = \"skin\"\n\
    shape = \"layer\"\nto_depth_m = 0.0005\n[[regions]]\nname = \"deep\"\nmaterial = \"deep\"\nshape = \"layer\"\n\
    from_depth_m = 0.0015\nto_depth_m = 0.017\n";

#[test]
fn one_pose_through_three_layers_brings_all_of_their_events() {
    let softly = "friction_n_per_m = 2.0\ncutting_force_n = 0.002\n";
    let run = |poses: u32| {
        let mut twin = built(&[SAMPLE, LAYERS, NEEDLE, softly, CLOUD, "[motion]\ndepth_m = 0.006\n"]);
        let mut seen = Vec::new();
        for k in 1..=poses {
            let deep_m = twin.boundaries_m().unwrap()[2];
            let answer = at_depth(&mut twin, 3e-3 * f64::from(k) / f64::from(poses));
            if poses > 1 && twin.happened().iter().any(|h| h.event.region() == 2 && h.event.puncture_depth().is_some())
            {
                println!("the deep layer is pierced at {} m; its boundary was at {deep_m} m", answer.depth_m);
                // it is that of the tissue around the needle, which the tip pushes less: the needle would stop before
                let beyond = answer.depth_m - deep_m;
                assert!(deep_m > 1.6e-3 && beyond > 0.0 && beyond < 3e-4, "{deep_m} {}", answer.depth_m);
            }
            assert_eq!(answer.event.is_some(), !twin.happened().is_empty());
            seen.extend(twin.happened().iter().filter(|h| h.event.kind() != "slip").copied());
        }
        seen
    };
    let [once, often] = [run(1), run(300)];
    let said = |all: &[needle_core::twin::Happening]| -> Vec<(&str, u8)> {
        all.iter().map(|h| (h.event.kind(), h.event.region())).collect()
    };
    assert_eq!(said(&once), [("puncture", 1), ("layer", 0), ("puncture", 2)], "{once:?}");
    assert_eq!(said(&once), said(&often), "{often:?}");
    for (a, b) in once.iter().zip(&often) {
        println!("{a:?} in one pose, {b:?} in 300");
        assert!((a.event.depth_m() - b.event.depth_m()).abs() < 1e-4, "{a:?} {b:?}");
    }
    let skin = &once[0];
    assert!((skin.force_before_n[2] / 0.008 - 1.0).abs() < 0.05 && skin.force_after_n[2] < 0.5 * 0.008, "{skin:?}");
}

#[test]
fn slip_is_state_that_is_copied_looked_ahead_with_and_reset() {
    let mut twin = built(&[SAMPLE, NEEDLE, RUBS, CLOUD, "[motion]\nstart_depth_m = 0.004\ndepth_m = 0.006\n"]);
    let first = travel(&mut twin, 4e-3, 4.8e-3, 80);
    let mut double = twin.double();
    double.take_over(&twin);
    let live = travel(&mut twin, 4.8e-3, 4.4e-3, 40);
    let ahead = travel(&mut double, 4.8e-3, 4.4e-3, 40);
    let difference = (live.last().unwrap().force_n[2] - ahead.last().unwrap().force_n[2]).abs();
    assert!(difference < 1e-5, "{difference}");
    twin.reset();
    assert_eq!(digits(&travel(&mut twin, 4e-3, 4.8e-3, 80)), digits(&first), "a reset twin is as new");
}

#[test]
fn a_needle_that_comes_in_again_only_rubs_along_its_channel() {
    let mut twin = built(&[SAMPLE, NEEDLE, RUBS, CLOUD, "[motion]\ndepth_m = 0.005\n"]);
    let first = travel(&mut twin, 0.0, 4e-3, 800);
    let cut = twin.cut_depth().unwrap();
    let out = travel(&mut twin, 4e-3, 0.0, 800);
    assert!(out.iter().any(|a| a.force_n[2] < -0.003), "coming out, the needle is held back");
    at_depth(&mut twin, -1e-4);
    let second = travel(&mut twin, 0.0, 2e-3, 400);
    let [friction, tip] = twin.needle_forces().unwrap();
    assert!(tip == 0.0 && friction > 0.002, "{tip} {friction}");
    // more of the shaft is in the tissue than the first time, when the tip pushed it ahead
    assert!(second[399].force_n[2] < 0.9 * first[399].force_n[2], "{:?} {:?}", second[399].force_n, first[399].force_n);
    // the last pose of the first insertion cut a little more
    assert!((twin.cut_depth().unwrap() - cut).abs() < 2e-5, "{:?} {cut}", twin.cut_depth());
}

/// The preset of layers to a depth in m and back out, at a share of its speed.
fn layers(depth: &str, slower: f64) -> Vec<Prediction> {
    let set = |path: &str, value: &str| Override::text(path, value, "test");
    let scene = Scene::preset("layered_tissue").unwrap();
    let speed = (slower * scene.motion.unwrap().speed.get()).to_string();
    let keys = [set("motion.depth_m", depth), set("motion.insertions", "1"), set("motion.speed_m_per_s", &speed)];
    let scene = scene.with(&keys).unwrap();
    let mut twin = alone(|| Twin::new(&scene).unwrap());
    scene.motion.unwrap().poses().map(|(_, depth)| at_depth(&mut twin, depth)).collect()
}

fn peak(answers: &[Prediction]) -> f64 {
    answers.iter().map(|a| a.force_n[2].abs()).fold(0.0, f64::max)
}

/// Through two membranes, out again: each pose is answered from an equilibrium, so that the run may say that its forces are those of rest.
#[test]
fn every_pose_through_layers_is_answered_from_an_equilibrium() {
    let answers = layers("0.006", 1.0);
    let peak = peak(&answers);
    let worst = |of: &dyn Fn(&Prediction) -> f64| answers.iter().map(of).fold(0.0, f64::max);
    let imbalance = worst(&|a| (a.force_n[2] + a.base_force_n[2]).abs() / peak);
    let loaded = |a: &Prediction| a.force_n[2].abs() >= Health::LOADED * peak;
    let energies = worst(&|a| if loaded(a) { a.health.kinetic_to_strain_energy } else { 0.0 });
    let constraint = worst(&|a| a.health.constraint_error_m);
    let steps = answers.iter().map(|a| f64::from(a.steps)).sum::<f64>() / answers.len() as f64;
    println!(
        "imbalance {imbalance:.4}, energies {energies:.4}, constraint error {constraint:.2e} m, {steps:.1} steps per pose"
    );
    let punctures = answers.iter().filter(|a| matches!(a.event, Some(Event::Puncture { .. }))).count();
    assert_eq!(punctures, 2);
    assert!(imbalance < 0.02 && energies < Health::MOST_KINETIC, "{imbalance} {energies}");
    assert!(constraint < 1e-6, "{constraint}");
    assert!(steps < 45.0, "{steps} steps per pose");
}

/// The curve through a membrane and back against a run at a twentieth of the speed: within 1 % of the peak, or 50 um beside it where it
/// falls.
#[test]
fn the_curve_through_a_membrane_does_not_depend_on_the_speed() {
    let (fast, slow) = (layers("0.001", 1.0), layers("0.001", 0.05));
    let peak = peak(&slow);
    let mut worst = (0.0_f64, 0.0);
    for (i, a) in fast.iter().enumerate().step_by(2) {
        let near = (20 * i).saturating_sub(200)..(20 * i + 201).min(slow.len());
        let (least, most) =
            slow[near].iter().map(|b| b.force_n[2]).fold((f64::MAX, f64::MIN), |(l, m), f| (l.min(f), m.max(f)));
        let off = (least - a.force_n[2]).max(a.force_n[2] - most).max(0.0) / peak;
        worst = if off > worst.0 { (off, a.depth_m) } else { worst };
    }
    println!("{:.4} of the peak at {} m", worst.0, worst.1);
    assert!(worst.0 < 0.01, "{worst:?}");
}
