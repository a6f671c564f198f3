//! The half plane's cloud and kernel: exact where the field is known, forces the slope of the energy, and sound for many shapes.
#![allow(clippy::unwrap_used, clippy::panic)]

use crate::axisymmetric::{HEIGHT, RADIUS};
use crate::clouds::{KAPPA, METHODS, MU, norm, settings, uniform};
use mtled::approximation::axisymmetric::{AxisymmetricApproximation, triangle};
use mtled::approximation::{Basis, ShapeTable};
use mtled::cloud::meridian::meridian;
use mtled::cloud::{Axis, BASE, CloudError, Domain, Feature, Meridian, Spacing};
use mtled::material::Law;
use mtled::solver::VolumeRatio;
use mtled::solver::{InternalForce, Kernel, Pool};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use std::f64::consts::PI;

/// The presets' half plane with a needle's path, coarse; which nodes interpolate, as in a scene.
fn half_plane() -> (Meridian, Vec<bool>) {
    let path = Feature::Path { axis: Axis::vertical([0.0; 2]), capture_radius: 0.001, length: 0.011, spacing: 0.0005 };
    let spacing = Spacing { far: 0.003, growth: 0.3, features: vec![path] };
    let plane = meridian(&Domain::Cylinder { radius: RADIUS, height: HEIGHT }, &spacing).unwrap();
    let held = |(p, f): (&[f64; 3], &u8)| f & BASE != 0 || p[0] <= 0.001 * (1.0 + 1e-9);
    let interpolating = plane.points.iter().zip(&plane.faces).map(held).collect();
    (plane, interpolating)
}

fn table(plane: &Meridian, interpolating: &[bool], basis: Option<Basis>, points_per_cell: u32) -> ShapeTable {
    let settings = settings(basis, points_per_cell);
    AxisymmetricApproximation::new(&plane.points, &plane.triangles, interpolating, settings).table().unwrap()
}

fn kernel(plane: &Meridian, table: &ShapeTable, ratio: VolumeRatio) -> Kernel<f64> {
    let cells: Vec<[u32; 4]> = plane.triangles.iter().map(|&[a, b, c]| [a, b, c, c]).collect();
    Kernel::of_materials(table, &cells, &plane.points, &[Law::neo_hookean(MU, KAPPA)], ratio)
}

fn evaluate(kernel: &Kernel<f64>, u: &[[f64; 3]]) -> InternalForce {
    kernel.internal_force(&mut Pool::new(1), u)
}

#[test]
fn a_uniform_stretch_is_exact_with_its_hoop_strain() {
    let (plane, interpolating) = half_plane();
    let (a, b, shift) = (0.07, -0.11, 0.003);
    let u: Vec<_> = plane.points.iter().map(|p| [a * p[0], 0.0, b * p[2] + shift]).collect();
    let wanted = [1.0 + a, 0.0, 0.0, 0.0, 1.0 + a, 0.0, 0.0, 0.0, 1.0 + b];
    for (name, basis) in METHODS {
        for points_per_cell in [1, 4, 5] {
            let table = table(&plane, &interpolating, basis, points_per_cell);
            let volume: f64 = table.volume.iter().sum();
            assert!((volume / (PI * RADIUS * RADIUS * HEIGHT) - 1.0).abs() < 1e-12, "{name}: {volume} m^3");
            let at = evaluate(&kernel(&plane, &table, VolumeRatio::Projected), &u);
            let worst = at
                .deformation
                .iter()
                .flat_map(|f| f.iter().zip(wanted))
                .map(|(f, w)| (f - w).abs())
                .fold(0.0, f64::max);
            println!("{name}, rule {points_per_cell}: F is off by {worst:.1e}");
            assert!(worst < 1e-11, "{name}, rule {points_per_cell}: {worst:.1e}");
        }
    }
}

fn shaken(plane: &Meridian, random: &mut ChaCha8Rng) -> Vec<[f64; 3]> {
    let mut noise = || 1e-4 * (uniform(random) - 0.5);
    plane.points.iter().map(|p| [if p[0] == 0.0 { 0.0 } else { noise() }, 0.0, noise()]).collect()
}

/// f . du = dE for any motion: the hoop stress, the images and the projected pressure included.
#[test]
fn forces_are_the_slope_of_the_energy() {
    let (plane, interpolating) = half_plane();
    let mut random = ChaCha8Rng::seed_from_u64(21);
    let (u, way) = (shaken(&plane, &mut random), shaken(&plane, &mut random));
    for (name, basis) in METHODS {
        for ratio in [VolumeRatio::Projected, VolumeRatio::Averaged, VolumeRatio::Pointwise] {
            let kernel = kernel(&plane, &table(&plane, &interpolating, basis, 1), ratio);
            let force = evaluate(&kernel, &u).force;
            let work: f64 = force.iter().zip(&way).map(|(f, d)| f[0] * d[0] + f[2] * d[2]).sum();
            let energy = |s: f64| {
                let at: Vec<_> = u.iter().zip(&way).map(|(u, d)| std::array::from_fn(|k| u[k] + s * d[k])).collect();
                evaluate(&kernel, &at).energy
            };
            let h = 1e-4;
            let slope = (energy(h) - energy(-h)) / (2.0 * h);
            println!("{name}, {ratio:?}: {work:.6e} {slope:.6e}");
            assert!((work / slope - 1.0).abs() < 1e-5, "{name}, {ratio:?}: {work} {slope}");
            let axial: f64 = force.iter().map(|f| f[2]).sum();
            let total: f64 = force.iter().map(|f| norm(*f)).sum();
            assert!(axial.abs() < 1e-12 * total, "{name}, {ratio:?}: axial forces sum to {axial:.1e} of {total}");
            let on_axis = |n: &usize| plane.points[*n][0] == 0.0;
            assert!((0..force.len()).filter(on_axis).all(|n| force[n][0] == 0.0), "no force off the axis");
        }
    }
}

/// Half planes of all sizes, gradings and instruments: nodes where they belong, the whole rectangle and nothing else.
#[test]
fn half_planes_of_many_shapes_are_sound() {
    let mut random = ChaCha8Rng::seed_from_u64(22);
    let mut lowest = 1.0_f64;
    for case in 0..200 {
        let mut between = |a: f64, b: f64| a * (b / a).powf(uniform(&mut random));
        let (radius, height) = (between(0.003, 0.1), between(0.003, 0.1));
        let far = radius.min(0.5 * height) * between(0.08, 0.9);
        let spacing = far * between(0.05, 1.0);
        let length = (height * between(0.05, 0.8)).max(spacing);
        let capture_radius = (0.5 * radius).min(spacing * between(0.9, 4.0));
        let features = match case % 4 {
            0 => vec![],
            1 => vec![Feature::Rim { top: true, spacing }, Feature::Rim { top: false, spacing }],
            2 => vec![Feature::ContactRing { centre: [0.0; 2], radius: radius * between(0.3, 0.9), spacing }],
            _ => vec![Feature::Path { axis: Axis::vertical([0.0; 2]), capture_radius, length, spacing }],
        };
        let spacing = Spacing { far, growth: between(0.15, 0.5), features };
        let plane = match meridian(&Domain::Cylinder { radius, height }, &spacing) {
            Ok(plane) => plane,
            Err(CloudError::OutOfRange { .. }) => continue, // the instrument doesn't fit
            Err(e) => panic!("case {case}: {e}: {radius} {height} {spacing:?}"),
        };
        lowest = lowest.min(plane.lowest_shape());
        let area: f64 = plane.triangles.iter().map(|t| triangle(&t.map(|n| plane.points[n as usize])).0).sum();
        assert!((area / (radius * height) - 1.0).abs() < 1e-12, "case {case}: {area}");
        assert!(plane.points.iter().all(|p| p[0] >= 0.0 && p[1] == 0.0 && p[2] >= 0.0 && p[2] <= height));
    }
    println!("lowest shape {lowest:.3}");
}

/// Layers and rings of a path that is finer where it enters: as far apart as the entry says at every depth, and no triangle crosses the
/// captured cylinder.
#[test]
fn a_path_is_finer_where_it_enters() {
    let (radius, spacing, at_top, growth) = (5e-4, 2.5e-4, 1.5e-4, 0.06);
    let path = Feature::Path { axis: Axis::vertical([0.0; 2]), capture_radius: radius, length: 0.0105, spacing };
    let entry = Feature::FinePath {
        axis: Axis::vertical([0.0; 2]),
        depths: [0.0; 2],
        radius: 1.5 * radius,
        spacing: at_top,
        growth,
    };
    let domain = Domain::Cylinder { radius: RADIUS, height: HEIGHT };
    let plane = |features: Vec<Feature>| meridian(&domain, &Spacing { far: 2.33e-3, growth: 0.3, features });
    let graded = plane(vec![path, entry]).unwrap();
    let mut layers: Vec<f64> = graded.points.iter().filter(|p| p[0] == radius).map(|p| HEIGHT - p[2]).collect();
    layers.sort_by(f64::total_cmp);
    for pair in layers.windows(2) {
        let wanted = (at_top + growth * 0.5 * (pair[0] + pair[1])).min(spacing);
        assert!(((pair[1] - pair[0]) / wanted - 1.0).abs() < 0.03, "{pair:?} m: {wanted} m wanted");
    }
    assert!((layers[layers.len() - 1] - 0.0105).abs() < 1e-12);
    for &depth in &layers {
        let on = |p: &&[f64; 3]| (HEIGHT - p[2] - depth).abs() < 1e-9 && p[0] <= radius;
        let rings = (radius / (at_top + growth * depth).min(spacing)).round() as usize;
        assert_eq!(graded.points.iter().filter(on).count(), rings + 1, "at {depth} m");
    }
    let crosses = |t: &&[u32; 3]| {
        let r = t.map(|n| graded.points[n as usize][0]);
        r.iter().any(|r| *r < radius) && r.iter().any(|r| *r > radius)
    };
    let above = |t: &&[u32; 3]| t.iter().all(|&n| graded.points[n as usize][2] > HEIGHT - 0.0105 + 1e-9);
    assert_eq!(graded.triangles.iter().filter(above).filter(crosses).count(), 0);
    let even = plane(vec![path]).unwrap();
    let more = graded.points.len() as f64 / even.points.len() as f64;
    assert!((1.05..1.2).contains(&more), "{} nodes instead of {}", graded.points.len(), even.points.len());
    for growth in [0.0, 0.6, f64::NAN] {
        let entry =
            Feature::FinePath { axis: Axis::vertical([0.0; 2]), depths: [0.0; 2], radius, spacing: at_top, growth };
        assert!(
            matches!(plane(vec![path, entry]), Err(CloudError::OutOfRange { key: "entry growth", .. })),
            "{growth}"
        );
    }
}
