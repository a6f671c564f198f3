//! Clouds with hexahedra: bricks among tetrahedra, and grids of hexahedra alone.
#![allow(clippy::unwrap_used)]

use mtled::cloud::hexahedron::is_sound;
use mtled::cloud::{Axis, Domain, Feature, Solid, Spacing};

#[test]
fn bricks_are_whole_and_lie_in_one_region_clear_of_path_and_surface() {
    const INTERFACE: f64 = 0.013;
    let cylinder = Domain::Cylinder { radius: 0.015, height: 0.017 };
    let axis = Axis { entry: [0.0; 2], slope: [0.0; 2] };
    let path = Feature::Path { axis, capture_radius: 0.0005, length: 0.0105, spacing: 0.00025 };
    let layer = Feature::Region { solid: Solid::Layer { bottom: INTERFACE, top: 0.017 }, spacing: 0.0015 };
    for (domain, features, share) in [
        (cylinder, vec![path], 0.5),
        (cylinder.half(), vec![path], 0.4),
        (cylinder, vec![path, layer], 0.4),
        (Domain::Box { size: [0.02; 3] }, Vec::new(), 0.4),
    ] {
        let layered = features.len() > 1;
        let cloud = mtled_hexahedra::with_bricks(&domain, &Spacing { far: 0.0015, growth: 0.3, features }).unwrap();
        let volumes = cloud.volumes();
        let mut owners = vec![0; cloud.cells.len()];
        for h in &cloud.hexahedra {
            h.cells.iter().for_each(|&c| owners[c as usize] += 1);
            let corners = h.corners.map(|n| cloud.points[n as usize]);
            assert!(is_sound(&corners));
            assert!(h.corners.iter().all(|&n| cloud.faces[n as usize] == 0));
            let above = corners.iter().filter(|p| p[2] > INTERFACE).count();
            assert!(!layered || above % 8 == 0, "{corners:?} reaches across the interface");
            assert!(corners.iter().all(|p| p[0].hypot(p[1]) > 0.0005 || p[2] < 0.0065));
        }
        assert!(owners.iter().all(|o| *o <= 1), "a tetrahedron is of one hexahedron");
        let within: f64 = volumes.iter().zip(&owners).filter(|(_, o)| **o > 0).map(|(v, _)| v).sum();
        let part = within / volumes.iter().sum::<f64>();
        println!("{} nodes, {} hexahedra, {part:.2} of the volume", cloud.points.len(), cloud.hexahedra.len());
        assert!(part > share, "{part}");
    }
}

#[test]
fn cylinder_and_box_are_whole_and_graded() {
    let rim = [true, false].map(|top| Feature::Rim { top, spacing: 0.0008 });
    let ring = Feature::ContactRing { centre: [0.0; 2], radius: 0.005, spacing: 0.0006 };
    let cylinder = Domain::Cylinder { radius: 0.015, height: 0.017 };
    for (domain, features) in [
        (cylinder, rim.to_vec()),
        (cylinder, vec![ring]),
        (cylinder, Vec::new()),
        (Domain::Box { size: [0.03, 0.02, 0.017] }, rim.to_vec()),
    ] {
        let spacing = Spacing { far: 0.003, growth: 0.4, features };
        let cloud = mtled_hexahedra::structured(&domain, &spacing).unwrap();
        println!("{} nodes, {} hexahedra", cloud.points.len(), cloud.hexahedra.len());
        assert_eq!(cloud.cells.len(), 6 * cloud.hexahedra.len());
        let volume: f64 = cloud.volumes().iter().sum();
        assert!((volume / domain.volume() - 1.0).abs() < 1e-9, "{volume} of {}", domain.volume());
        let mut owner = vec![0; cloud.cells.len()];
        for h in &cloud.hexahedra {
            h.cells.iter().for_each(|&c| owner[c as usize] += 1);
            assert!(h.cells.iter().all(|&c| cloud.cells[c as usize].iter().all(|n| h.corners.contains(n))));
            assert!(is_sound(&h.corners.map(|n| cloud.points[n as usize])));
        }
        assert!(owner.iter().all(|o| *o == 1), "each tetrahedron is of one hexahedron");
        let least = spacing.finest().max(0.25 * spacing.far);
        let layers: Vec<f64> = {
            let mut z: Vec<f64> = cloud.points.iter().map(|p| p[2]).collect();
            z.sort_by(f64::total_cmp);
            z.dedup();
            z.windows(2).map(|w| w[1] - w[0]).collect()
        };
        let last = layers[layers.len() - 1];
        assert!(last < 1.3 * least && last > 0.4 * least, "{last} where {least} is asked for");
        if spacing.features == vec![ring] {
            let on_ring = |p: &[f64; 3]| p[2] == 0.017 && (p[0].hypot(p[1]) - 0.005).abs() < 1e-12;
            assert_eq!(cloud.points.iter().filter(|p| on_ring(p)).count(), 32);
        }
    }
}

#[test]
fn the_half_of_a_body_is_refused() {
    let spacing = Spacing { far: 0.003, growth: 0.4, features: Vec::new() };
    let half = Domain::Cylinder { radius: 0.015, height: 0.017 }.half();
    assert!(mtled_hexahedra::structured(&half, &spacing).unwrap_err().to_string().contains("hexahedra"));
}
