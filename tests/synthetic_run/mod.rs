//! A synthetic run for tests of the report: formulas of plausible shape, no solver. Not a result of anything.
#![allow(dead_code)] // each test file uses its part

use needle_core::scene::{DeformationRule, Instrument, InstrumentKind, Metres, Needle, NeedleTip, Radians};
use needle_core::twin::{Event, Phase};
use needle_estimate::compare::{Answer, FinalState, Run, Snapshot, TargetRow};

pub const HEIGHT_M: f64 = 0.017;
pub const RADIUS_M: f64 = 0.015;
pub const PUNCTURE_M: f64 = 0.0021;
const DEPTH_M: f64 = 0.010;
const SPEED_M_PER_S: f64 = 0.001;

/// A needle run: approach, insertion to 10 mm, hold, retraction, with a noisy "measured" force.
pub fn needle(pose_hz: f64) -> Run {
    let mesh = cylinder(8, 32, 12);
    let poses = (22.3 * pose_hz) as usize;
    let answers: Vec<Answer> = (0..poses).map(|i| answer(i, pose_hz)).collect();
    let snapshots: Vec<Snapshot> = (0..48).map(|i| snapshot(&mesh, 22.3 * f64::from(i) / 47.0)).collect();
    let last = snapshots.last().cloned().unwrap_or_default();
    let von_mises_pa = mesh.0.iter().map(|p| 900.0 * (-(p[0].hypot(p[1])) / 0.003).exp()).collect();
    Run {
        scene: "needle_insertion".into(),
        description: "Synthetic run for tests of the report: formulas, no solver. Assumed: diameter 1.0 mm, 1 mm/s."
            .into(),
        method: "mmls".into(),
        nodes: mesh.0.len(),
        integration_points: mesh.1.len(),
        steps: answers.iter().map(|a| u64::from(a.steps)).sum(),
        target_names: vec!["vessel".into(), "lesion".into()],
        targets: (0..224).map(|i| target_row(f64::from(i) * 0.1)).collect(),
        answers,
        build_s: 1.73,
        wall_s: 9.6,
        simulated_s: 22.3,
        missed_deadlines: 3,
        min_jacobian: 0.81,
        max_kinetic_to_strain_energy: 0.004,
        force_imbalance: 0.0065,
        force_imbalance_rms: 0.0021,
        step_error_rms: Some(0.0018),
        accuracy: 0.01,
        constraint_error_m: 2.1e-9,
        folded_energy: 0.0012,
        effective_radius_m: Some(4.9e-4),
        checksum: "9f3c0d5b7e21a864".into(),
        measured_source: "synthetic: formula with noise".into(),
        final_state: FinalState {
            surface: surface(&mesh.1, &mesh.0),
            points: mesh.0,
            cells: mesh.1,
            region: Vec::new(),
            displacement: last.displacement,
            jacobian: last.jacobian,
            von_mises_pa,
        },
        snapshots,
        instrument: Some(Instrument {
            interaction: needle_core::scene::Interaction::Kinematic,
            kind: InstrumentKind::Needle(needle_shape()),
            entry: [metres(0.0); 2],
            contact: needle_core::scene::ContactLaw::Bonded,
            load_cell_height: metres(0.0),
        }),
        scene_toml: SCENE.into(),
        command: "replay".into(),
        ..Run::default()
    }
}

fn metres(value: f64) -> Metres {
    Metres(value)
}

fn needle_shape() -> Needle {
    Needle {
        diameter: metres(0.001),
        capture_radius: metres(0.0005),
        capture_window: metres(0.0),
        deformation_coefficient: 0.4,
        retraction_coefficient: 0.4,
        deformation_rule: DeformationRule::Incremental,
        puncture_strain: 1e-6,
        wall_contact: true,
        tilt: Radians(0.0),
        azimuth: Radians(0.0),
        tip: NeedleTip::Flat,
        bevel: None,
        flexible: None,
    }
}

const SCENE: &str = r#"name = "needle_insertion"
[sample]
kind = "cylinder"
diameter_m = 0.03
height_m = 0.017
[material]
model = "neo_hookean"
shear_modulus_pa = 1678.0
poisson_ratio = 0.49
density_kg_per_m3 = 970.0
[instrument]
kind = "needle"
diameter_m = 0.001
puncture_strain = 1e-6
[[targets]]
name = "vessel"
position_m = [0.002, 0.0, 0.009]
"#;

fn depth_at(time: f64) -> f64 {
    let insertion = DEPTH_M / SPEED_M_PER_S;
    match time {
        t if t < 0.3 + insertion => SPEED_M_PER_S * (t - 0.3),
        t if t < 1.3 + insertion => DEPTH_M,
        t => DEPTH_M - SPEED_M_PER_S * (t - 1.3 - insertion),
    }
}

fn answer(i: usize, pose_hz: f64) -> Answer {
    let time_s = i as f64 / pose_hz;
    let depth_m = depth_at(time_s);
    let inside = depth_m.max(0.0) / DEPTH_M;
    let retracting = time_s > 11.3;
    let drop = if depth_m > PUNCTURE_M || retracting { 0.85 } else { 1.0 };
    let force = if retracting {
        0.0675 * (1.25 * inside - 0.25 * inside.sqrt()) * 0.85
    } else {
        0.0675 * drop * inside.powf(1.5)
    };
    let noise = 0.0006 * (hash(i as u64) - 0.5) + 0.0008 * (time_s * 0.9).sin();
    let before = depth_at((i as f64 - 1.0) / pose_hz);
    let punctured = !retracting && before <= PUNCTURE_M && depth_m > PUNCTURE_M;
    Answer {
        time_s,
        depth_m,
        predicted_n: force,
        measured_n: Some(force * 1.04 + noise),
        predicted_vector_n: [1e-4, -2e-4, force],
        measured_vector_n: Some([2e-4, -1e-4, force * 1.04 + noise]),
        model_error_n: 0.01 * force,
        phase: match () {
            () if retracting && depth_m > 0.0 => Phase::Retraction,
            () if depth_m <= 0.0 => Phase::Approach,
            () if depth_m <= PUNCTURE_M => Phase::Indentation,
            () => Phase::Penetration,
        },
        event: punctured.then_some(Event::Puncture { depth_m: PUNCTURE_M, region: 0 }),
        steps: if time_s < 0.3 { 0 } else { 8 + (12.0 * (-(time_s - 0.3)).exp()) as u32 },
        latency_s: 3e-4 + 1e-4 * hash(7 * i as u64 + 1) + if i % 997 == 996 { 1.3e-3 } else { 0.0 },
    }
}

/// A number in [0, 1) from an integer (splitmix64).
fn hash(seed: u64) -> f64 {
    let mut z = seed.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

/// Displacement and volume ratio of a made-up field: tissue dragged down round the axis, bulging outward.
fn field(p: &[f64; 3], depth_m: f64) -> ([f64; 3], f64) {
    let r = p[0].hypot(p[1]);
    let drag = 0.45 * depth_m.max(0.0) * (-r / 0.0035).exp() * (p[2] / HEIGHT_M).powf(0.8);
    let bulge = 0.25 * drag * (r / 0.004) * (-r / 0.004).exp();
    let radial = |x: f64| if r > 0.0 { bulge * x / r } else { 0.0 };
    ([radial(p[0]), radial(p[1]), -drag], 1.0 - 14.0 * drag * ((p[2] / HEIGHT_M) - 0.6))
}

fn snapshot(mesh: &Mesh, time_s: f64) -> Snapshot {
    let depth_m = depth_at(time_s);
    let (displacement, jacobian) = mesh.0.iter().map(|p| field(p, depth_m)).unzip();
    Snapshot { time_s, depth_m, displacement, jacobian, needle: Vec::new() }
}

fn target_row(time_s: f64) -> TargetRow {
    let depth_m = depth_at(time_s);
    let moved = |p: [f64; 3]| {
        let (u, _) = field(&p, depth_m);
        [p[0] + u[0], p[1] + u[1], p[2] + u[2]]
    };
    TargetRow { time_s, depth_m, positions: vec![moved([0.002, 0.0, 0.009]), moved([-0.004, 0.003, 0.006])] }
}

type Mesh = (Vec<[f64; 3]>, Vec<[u32; 4]>);

/// A cylinder of rings, sectors and layers of prisms, each cut into three tetrahedra along its lowest indices, so
/// that neighbours agree on the diagonals.
pub fn cylinder(rings: usize, sectors: usize, layers: usize) -> Mesh {
    let per_layer = 1 + rings * sectors;
    let mut points = Vec::new();
    for k in 0..=layers {
        let z = HEIGHT_M * k as f64 / layers as f64;
        points.push([0.0, 0.0, z]);
        for i in 1..=rings {
            let r = RADIUS_M * (i as f64 / rings as f64).powf(1.3);
            for j in 0..sectors {
                let (sin, cos) = (std::f64::consts::TAU * j as f64 / sectors as f64).sin_cos();
                points.push([r * cos, r * sin, z]);
            }
        }
    }
    let node = |i: usize, j: usize| if i == 0 { 0 } else { 1 + (i - 1) * sectors + j % sectors };
    let mut cells = Vec::new();
    for k in 0..layers {
        for j in 0..sectors {
            for i in 0..rings {
                let [a, b, c, d] = [node(i, j), node(i + 1, j), node(i + 1, j + 1), node(i, j + 1)];
                let triangles: &[[usize; 3]] = if i == 0 { &[[a, b, c]] } else { &[[a, b, c], [a, c, d]] };
                for triangle in triangles {
                    prism(&mut cells, triangle.map(|n| (n + k * per_layer) as u32), per_layer as u32);
                }
            }
        }
    }
    (points, cells)
}

fn prism(cells: &mut Vec<[u32; 4]>, mut bottom: [u32; 3], up: u32) {
    let least = (0..3).min_by_key(|&i| bottom[i]).unwrap_or(0);
    bottom.rotate_left(least);
    let [a, b, c] = bottom;
    if b < c {
        cells.extend([[a, b, c, c + up], [a, b, c + up, b + up], [a, b + up, c + up, a + up]]);
    } else {
        cells.extend([[a, b, c, b + up], [a, b + up, c, c + up], [a, b + up, c + up, a + up]]);
    }
}

/// Faces that only one cell has, turned outward.
pub fn surface(cells: &[[u32; 4]], points: &[[f64; 3]]) -> Vec<[u32; 3]> {
    let mut faces = std::collections::BTreeMap::<[u32; 3], Vec<[u32; 3]>>::new();
    for &[a, b, c, d] in cells {
        for (face, opposite) in [([a, b, c], d), ([a, b, d], c), ([a, c, d], b), ([b, c, d], a)] {
            let mut key = face;
            key.sort_unstable();
            let [p, q, r, o] = [face[0], face[1], face[2], opposite].map(|i| points[i as usize]);
            let [u, v, w] = [q, r, o].map(|x| [x[0] - p[0], x[1] - p[1], x[2] - p[2]]);
            let towards = (u[1] * v[2] - u[2] * v[1]) * w[0]
                + (u[2] * v[0] - u[0] * v[2]) * w[1]
                + (u[0] * v[1] - u[1] * v[0]) * w[2];
            faces.entry(key).or_default().push(if towards > 0.0 { [face[0], face[2], face[1]] } else { face });
        }
    }
    faces.into_values().filter(|f| f.len() == 1).map(|f| f[0]).collect()
}
