//! Prototype: time of a step of a member alone and in a team.
#![allow(clippy::unwrap_used, missing_docs)]
use mtled::approximation::axisymmetric::AxisymmetricApproximation;
use mtled::approximation::table::Approximation;
use mtled::approximation::{Basis, Settings, ShapeTable};
use mtled::cloud::{self, Axis, BASE, Domain, Feature, Spacing};
use mtled::material::Law;
use mtled::solver::{Advance, Precision, Role, Solver, SolverSettings, Team, VolumeRatio};
use std::sync::Arc;
use std::time::Instant;

fn main() {
    let axis = Axis { entry: [0.0; 2], slope: [0.0; 2] };
    let feature = Feature::Path { axis, capture_radius: 1e-3, length: 0.012, spacing: 8e-4 };
    let domain = Domain::Cylinder { radius: 0.0175, height: 0.017 };
    let spacing = Spacing { far: 0.002, growth: 0.3, features: vec![feature.clone()] };
    let plane = cloud::meridian::meridian(&domain, &spacing).unwrap();
    let settings = Settings {
        basis: Some(Basis::Quadratic { penalty: 1e-2 }),
        support_factor: 1.8,
        points_per_cell: 1,
        cells_per_point: 1,
    };
    let held = |p: &[f64; 3], faces: u8, r: f64| {
        if faces & BASE != 0 {
            Role::Base
        } else if p[0].hypot(p[1]) <= r && p[2] > 0.01 {
            Role::Instrument
        } else {
            Role::Free
        }
    };
    let roles: Vec<Role> = plane.points.iter().zip(&plane.faces).map(|(p, f)| held(p, *f, 1e-9)).collect();
    let interp: Vec<bool> = roles.iter().map(|r| *r != Role::Free).collect();
    let approx = AxisymmetricApproximation::new(&plane.points, &plane.triangles, &interp, settings);
    let table = approx.table().unwrap();
    let cells: Vec<[u32; 4]> = plane.triangles.iter().map(|&[a, b, c]| [a, b, c, c]).collect();
    run("half plane", &table, &cells, &plane.points, roles);
    let spacing = Spacing { far: 0.0016, growth: 0.3, features: vec![feature] };
    let c = cloud::generate(&domain, &spacing).unwrap();
    let roles: Vec<Role> = c.points.iter().zip(&c.faces).map(|(p, f)| held(p, *f, 1e-9)).collect();
    let interp: Vec<bool> = roles.iter().map(|r| *r != Role::Free).collect();
    let table = Approximation::new(&c.points, &c.cells, interp, settings).table().unwrap();
    if std::env::args().nth(1).is_none() {
        run("space", &table, &c.cells, &c.points, roles);
    }
}

fn run(name: &str, table: &ShapeTable, cells: &[[u32; 4]], points: &[[f64; 3]], roles: Vec<Role>) {
    let law = |k: usize| Law::neo_hookean(1678.0 * (0.8 + 0.05 * k as f64), 83_340.0);
    let settings = SolverSettings {
        law: law(0),
        volume_ratio: VolumeRatio::Projected,
        precision: Precision::F32,
        step_factor: 0.8,
        threads: 1,
    };
    let first = Solver::new(table, cells, points, roles.clone(), &settings);
    let work = first.work();
    println!(
        "{name}: {} nodes, {} points, {:.1} nodes a point, {:.0} flops",
        points.len(),
        table.volume.len(),
        work.support_nodes,
        work.flops
    );
    let new = |k: usize| Solver::of(Arc::new(first.model().with_laws(&[law(k)])), 1);
    let mut alone: Vec<Solver> = (0..8).map(new).collect();
    let mut together: Vec<Solver> = (0..8).map(new).collect();
    let mut team = Team::new(&together.iter().collect::<Vec<_>>(), None).unwrap();
    let nodes: Vec<usize> = (0..roles.len()).filter(|&n| roles[n] == Role::Instrument).collect();
    let poses = if std::env::args().nth(1).is_some() { 4_000_000 } else { 400_000 } / points.len().max(400) as u32;
    let (mut one, mut eight) = (0.0, 0.0);
    let (mut worst, mut peak) = (0.0_f64, 0.0_f64);
    for pose in 1..=poses {
        let depth = 4e-3 * f64::from(pose) / f64::from(poses);
        for s in alone.iter_mut().chain(&mut together) {
            nodes.iter().for_each(|&n| s.prescribe(n, [0.0, 0.0, -depth]));
        }
        let travel = [0.0, 0.0, 4e-3 / f64::from(poses)];
        let start = Instant::now();
        for s in &mut alone {
            s.refresh_if_due();
            s.advance(&Advance { steps: 1, travel });
        }
        one += start.elapsed().as_secs_f64();
        let start = Instant::now();
        let mut all = together.iter_mut();
        let mut members = std::array::from_fn(|_| all.next());
        team.advance(&mut members, 1, &[travel; 8]);
        eight += start.elapsed().as_secs_f64();
        for (a, b) in alone.iter().zip(&together) {
            let (a, b) = (a.balance().instrument[2], b.balance().instrument[2]);
            peak = peak.max(a.abs());
            worst = worst.max((a - b).abs());
        }
    }
    let us = |t: f64| 1e6 * t / f64::from(8 * poses);
    println!(
        "  a member and step: alone {:.2} us, in a team {:.2} us, ratio {:.2}; off {:.2e} of the peak {peak:.3e}",
        us(one),
        us(eight),
        one / eight,
        worst / peak
    );
}
