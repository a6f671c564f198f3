//! Patch test and rigid motions of clouds with hexahedra.
#![allow(clippy::unwrap_used)]

#[path = "../../mtled/tests/clouds/mod.rs"]
mod clouds;

use clouds::{METHODS, MLS, MMLS, patch, settings};
use mtled::approximation::Settings;
use mtled::approximation::table::Approximation;
use mtled::cloud::{self, Cloud, Domain, Spacing};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

/// With so many points in each hexahedron.
fn approximation(cloud: &Cloud, settings: Settings, points: u32) -> Approximation {
    let approximation = Approximation::new(&cloud.points, &cloud.cells, patch::boundary(cloud), settings);
    mtled_hexahedra::integrated(approximation, &cloud.points, &cloud.cells, &cloud.hexahedra, |_| points == 8)
}

fn patch_error(cloud: &Cloud, settings: Settings, points: u32, consistent: bool) -> f64 {
    patch::patch_error(cloud, &approximation(cloud, settings, points), consistent, 1)
}

/// The cube as a grid of hexahedra, its inner nodes pushed about if they are to be, so that faces are warped.
fn hexahedra(pushed: bool) -> Cloud {
    let spacing = Spacing { far: 0.004, growth: 0.3, features: vec![] };
    let mut cloud = mtled_hexahedra::structured(&Domain::Box { size: [0.02; 3] }, &spacing).unwrap();
    let mut random = ChaCha8Rng::seed_from_u64(5);
    for n in (0..cloud.points.len()).filter(|&n| pushed && cloud.faces[n] == 0).collect::<Vec<_>>() {
        cloud.points[n].iter_mut().for_each(|x| *x += 0.0008 * (clouds::uniform(&mut random) - 0.5));
    }
    cloud
}

#[test]
fn hexahedra_pass_as_tetrahedra_do() {
    for (name, basis) in [("mmls", MMLS), ("mls", MLS)] {
        for pushed in [false, true] {
            let cloud = hexahedra(pushed);
            assert_eq!((cloud.hexahedra.len(), cloud.cells.len()), (125, 750));
            for points in [8, 1] {
                let plain = patch_error(&cloud, settings(basis, 1), points, false);
                println!("{name}, {points} points: {plain:.3}");
                assert!(plain < 0.09 || points == 1, "{name}, {points} points: {plain:.3}");
            }
            let consistent = patch_error(&cloud, settings(basis, 1), 8, true);
            println!("{name}, consistent: {consistent:.1e}");
            // what conjugate gradients and the way to rest leave
            assert!(consistent < 3e-4, "{name}: {consistent:.1e}");
        }
    }
}

/// A box, and what it outlines, with hexahedra inside and tetrahedra about them.
fn with_bricks() -> [Cloud; 2] {
    let spacing = Spacing { far: 0.0028, growth: 0.3, features: vec![] };
    let own = mtled_hexahedra::with_bricks(&Domain::Box { size: [0.02; 3] }, &spacing).unwrap();
    let outline = cloud::Outline::new(&own, vec![0; own.cells.len()], 0.02);
    let filled = mtled_hexahedra::with_bricks(&Domain::Outline(&outline), &spacing).unwrap();
    [own, filled]
}

#[test]
fn hexahedra_inside_tetrahedra_pass_as_tetrahedra_do() {
    for cloud in with_bricks() {
        assert!(cloud.hexahedra.len() > 100, "{}", cloud.hexahedra.len());
        let volume: f64 = cloud.volumes().iter().sum();
        assert!((volume / 8e-6 - 1.0).abs() < 1e-9, "{volume} m^3");
        for (points, cells_per_point) in [(8, 1), (1, 1), (1, 2)] {
            let tetrahedra = Settings { cells_per_point, ..settings(MMLS, 1) };
            let error = patch_error(&cloud, tetrahedra, points, true);
            let plain = patch_error(&cloud, tetrahedra, points, false);
            println!("{points} points, {cells_per_point} cells per point: {plain:.3}, consistent {error:.1e}");
            assert!(plain < 0.09 && error < 3e-4, "{points} points: {plain:.3}, consistent {error:.1e}");
        }
    }
}

#[test]
fn rigid_motions_cause_no_force() {
    for cloud in [vec![hexahedra(true)], with_bricks().into()].concat() {
        for (name, basis) in METHODS {
            patch::assert_rigid_motions(&cloud, name, &approximation(&cloud, settings(basis, 1), 8));
        }
    }
}
