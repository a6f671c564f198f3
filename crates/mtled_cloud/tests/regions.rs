//! Contract of clouds with regions: cells end at interfaces, and each region has its volume.
#![allow(clippy::unwrap_used, clippy::panic)]

use mtled_cloud::{Cloud, Domain, Feature, Solid, Spacing, generate};
use std::f64::consts::PI;

const SAMPLE: Domain = Domain::Cylinder { radius: 0.015, height: 0.017 };

/// Cells with nodes on both sides of an interface, and the volume of each region by its cells.
fn regions(cloud: &Cloud, spacing: &Spacing) -> (usize, Vec<f64>) {
    let solids = spacing.features.iter().filter_map(|f| match f {
        Feature::Region { solid, .. } => Some(*solid),
        _ => None,
    });
    let solids: Vec<_> = solids.collect();
    let mut volumes = vec![0.0; solids.len() + 1];
    let mut across = 0;
    for (c, volume) in cloud.cells.iter().zip(cloud.volumes()) {
        let p = c.map(|n| cloud.points[n as usize]);
        let centre = std::array::from_fn(|k| p.iter().map(|p| p[k]).sum::<f64>() / 4.0);
        volumes[usize::from(spacing.region(centre))] += volume;
        let sides = |solid: &Solid| p.map(|p| solid.signed(p));
        let cut = |solid| sides(solid).iter().any(|d| *d > 1e-7) && sides(solid).iter().any(|d| *d < -1e-7);
        across += usize::from(solids.iter().any(cut));
    }
    (across, volumes)
}

#[test]
fn cells_of_a_layered_cylinder_end_at_its_interfaces() {
    let layer = |bottom, top, spacing| Feature::Region { solid: Solid::Layer { bottom, top }, spacing };
    let ring = Feature::ContactRing { centre: [0.0, 0.0], radius: 0.005, spacing: 0.0006 };
    let features = vec![ring, layer(0.015, 0.017, 0.0019), layer(0.010, 0.015, 0.0019)];
    let spacing = Spacing { far: 0.0019, growth: 0.3, features };
    let cloud = generate(&SAMPLE, &spacing).unwrap();
    let (across, volumes) = regions(&cloud, &spacing);
    println!("{} nodes, {across} cells across, {:?}", cloud.points.len(), cloud.quality);
    assert!(across < cloud.cells.len() / 200, "{across} of {} cells reach across", cloud.cells.len());
    let area = SAMPLE.volume() / SAMPLE.height();
    for (volume, height) in volumes.iter().zip([0.010, 0.002, 0.005]) {
        assert!((volume / (area * height) - 1.0).abs() < 0.01, "{volume} {height}");
    }
}

#[test]
fn cells_round_inclusions_end_at_their_surface() {
    let centre = [0.002, 0.0, 0.009];
    let solids = [
        (Solid::Sphere { centre, radius: 0.003 }, 4.0 / 3.0 * PI * 0.003_f64.powi(3)),
        (Solid::Box { centre, size: [0.006, 0.005, 0.004] }, 0.006 * 0.005 * 0.004),
        (Solid::Cylinder { centre, radius: 0.003, height: 0.005 }, PI * 9e-6 * 0.005),
    ];
    for (solid, exact) in solids {
        let spacing = Spacing { far: 0.0018, growth: 0.3, features: vec![Feature::Region { solid, spacing: 0.0012 }] };
        let cloud = generate(&SAMPLE, &spacing).unwrap_or_else(|e| panic!("{solid:?}: {e}"));
        let (across, volumes) = regions(&cloud, &spacing);
        println!(
            "{solid:?}: {} nodes, {} cells, {across} across, {:.3} of its volume",
            cloud.points.len(),
            cloud.cells.len(),
            volumes[1] / exact
        );
        assert!(across < cloud.cells.len() / 50, "{solid:?}: {across} of {} cells reach across", cloud.cells.len());
        assert!((volumes[1] / exact - 1.0).abs() < 0.08, "{solid:?}: {}", volumes[1] / exact);
    }
}
