//! The contract of generated clouds: they fill the body exactly, conform to the instrument's edges, are graded, well
//! shaped, deterministic; and what cannot be made is refused with the reason.
#![allow(clippy::unwrap_used, clippy::panic)]

use mtled_cloud::check::{Fault, check};
use mtled_cloud::{Axis, BASE, Cloud, CloudError, Domain, Feature, LEAST_QUALITY, SIDE, Spacing, TOP, generate};
use proptest::prelude::*;
use std::f64::consts::PI;

const SAMPLE: Domain = Domain::Cylinder { radius: 0.015, height: 0.017 };

fn indentation() -> Spacing {
    let ring = Feature::ContactRing { centre: [0.0, 0.0], radius: 0.005, spacing: 0.0003 };
    Spacing { far: 0.00158, growth: 0.2, features: vec![ring] }
}

fn needle() -> Spacing {
    let path =
        Feature::Path { axis: Axis::vertical([0.0; 2]), capture_radius: 0.0005, length: 0.0105, spacing: 0.00025 };
    Spacing { far: 0.00233, growth: 0.3, features: vec![path] }
}

fn compression() -> Spacing {
    let rim = |top| Feature::Rim { top, spacing: 0.0005 };
    Spacing { far: 0.00155, growth: 0.3, features: vec![rim(true), rim(false)] }
}

/// Volume enclosed by the surface: divergence theorem, about the body's middle.
fn enclosed(cloud: &Cloud, domain: &Domain) -> f64 {
    let middle = 0.5 * domain.height();
    let corner = |v: u32| {
        let p = cloud.points[v as usize];
        [p[0], p[1], p[2] - middle]
    };
    let six = |t: &[u32; 3]| {
        let [a, b, c] = t.map(corner);
        a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])
    };
    cloud.surface.iter().map(six).sum::<f64>() / 6.0
}

/// All unordered edges, once each.
fn edges(cloud: &Cloud) -> Vec<(u32, u32)> {
    let pairs = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)];
    let all = cloud.cells.iter().flat_map(|c| pairs.map(|(i, j)| (c[i].min(c[j]), c[i].max(c[j]))));
    let mut edges: Vec<_> = all.collect();
    edges.sort_unstable();
    edges.dedup();
    edges
}

/// Everything that holds for every cloud.
fn holds(domain: &Domain, spacing: &Spacing) -> Cloud {
    let cloud = generate(domain, spacing).unwrap_or_else(|e| panic!("{e}: {domain:?} {spacing:?}"));
    // Valid, closed, simple, and of the topology of a ball.
    let surface = check(&cloud.points, &cloud.cells).unwrap();
    assert_eq!(surface, cloud.surface);
    let (nodes, faces) = (cloud.points.len() as i64, (4 * cloud.cells.len() + surface.len()) as i64 / 2);
    assert_eq!(
        nodes - edges(&cloud).len() as i64 + faces - cloud.cells.len() as i64,
        1,
        "Euler characteristic of a ball"
    );
    let on_surface = cloud.faces.iter().filter(|f| **f != 0).count();
    assert_eq!(surface.len(), 2 * on_surface - 4, "Euler characteristic of the surface is 2");
    // The cells fill exactly what the surface encloses.
    let volume: f64 = cloud.volumes().iter().sum();
    assert!((volume / enclosed(&cloud, domain) - 1.0).abs() < 1e-12);
    assert!(volume <= domain.volume() * (1.0 + 1e-12), "chords lie inside");
    // Shape.
    assert!(cloud.quality.lowest >= LEAST_QUALITY);
    assert!(cloud.quality.smallest_angle > 10.0 && cloud.quality.largest_angle < 165.0, "{:?}", cloud.quality);
    assert_eq!(cloud.quality.histogram.iter().sum::<usize>(), cloud.cells.len());
    on_faces(&cloud, domain);
    cloud
}

/// Marked nodes lie on their faces to the bit (planes) or to rounding (cylinder); others lie inside; areas agree.
fn on_faces(cloud: &Cloud, domain: &Domain) {
    for (p, &f) in cloud.points.iter().zip(&cloud.faces) {
        assert_eq!(f & BASE != 0, p[2] == 0.0);
        assert_eq!(f & TOP != 0, p[2] == domain.height());
        match *domain {
            Domain::HalfCylinder { .. } | Domain::HalfBox { .. } | Domain::Outline(_) => {
                unreachable!("other tests have these")
            }
            Domain::Cylinder { radius, .. } => {
                let off = (p[0].hypot(p[1]) / radius - 1.0).abs();
                assert!(if f & SIDE != 0 { off < 1e-14 } else { off > 1e-6 }, "{p:?}");
            }
            Domain::Box { size } => {
                assert_eq!(f & SIDE != 0, p[0].abs() == 0.5 * size[0] || p[1].abs() == 0.5 * size[1]);
            }
        }
    }
    assert!(cloud.surface_faces.iter().all(|f| f.count_ones() == 1));
    for face in [BASE, TOP] {
        let area = area(cloud, face);
        let (exact, least) = match domain.whole() {
            Domain::HalfCylinder { .. } | Domain::HalfBox { .. } | Domain::Outline(_) => {
                unreachable!("the whole of a body is no half")
            }
            Domain::Cylinder { radius, .. } => (PI * radius * radius, 0.82),
            Domain::Box { size } => (size[0] * size[1], 1.0 - 1e-12),
        };
        assert!(area <= exact * (1.0 + 1e-12) && area >= least * exact, "{area} of {exact}");
    }
}

fn area(cloud: &Cloud, face: u8) -> f64 {
    let triangles = cloud.surface.iter().zip(&cloud.surface_faces).filter(|(_, f)| **f & face != 0);
    triangles
        .map(|(t, _)| {
            let [a, b, c] = t.map(|v| cloud.points[v as usize]);
            let (u, v) = ([b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]);
            0.5 * (u[0] * v[1] - u[1] * v[0]).abs()
        })
        .sum()
}

/// Share of edges whose length is within 0.6 to 1.6 of the wanted spacing at their middle.
fn graded_share(cloud: &Cloud, domain: &Domain, spacing: &Spacing) -> f64 {
    let edges = edges(cloud);
    let good = |&&(a, b): &&(u32, u32)| {
        let (p, q) = (cloud.points[a as usize], cloud.points[b as usize]);
        let length = ((p[0] - q[0]).powi(2) + (p[1] - q[1]).powi(2) + (p[2] - q[2]).powi(2)).sqrt();
        let middle = [0, 1, 2].map(|k| 0.5 * (p[k] + q[k]));
        (0.6..1.6).contains(&(length / spacing.at(domain, middle)))
    };
    edges.iter().filter(good).count() as f64 / edges.len() as f64
}

#[test]
fn preset_bodies_have_the_papers_size_and_are_filled_well_shaped_and_graded() {
    // The paper's sizes; for compression it gives none; about 7000 nodes are wanted.
    let sizes = [(8233.0, 44_343.0), (5224.0, 28_645.0), (7000.0, 35_000.0)];
    for (spacing, (nodes, cells)) in [indentation(), needle(), compression()].into_iter().zip(sizes) {
        let cloud = holds(&SAMPLE, &spacing);
        assert!((cloud.points.len() as f64 / nodes - 1.0).abs() < 0.1, "{} nodes", cloud.points.len());
        assert!((cloud.cells.len() as f64 / cells - 1.0).abs() < 0.1, "{} cells", cloud.cells.len());
        assert!(cloud.quality.lowest > 0.4, "{:?}", cloud.quality);
        assert!(cloud.quality.smallest_angle > 18.0, "{:?}", cloud.quality);
        let share = graded_share(&cloud, &SAMPLE, &spacing);
        assert!(share > 0.98, "{share} of the edges within 0.6 to 1.6 of the spacing");
        let ratio = cloud.points.len() as f64 / spacing.predicted_nodes(&SAMPLE);
        assert!((0.9..1.1).contains(&ratio), "{ratio} of the predicted nodes");
    }
}

#[test]
fn size_follows_the_spacing_and_the_body_is_approached() {
    let mut missing = Vec::new();
    for far in [0.003, 0.0015, 0.00075] {
        let spacing = Spacing { far, growth: 0.3, features: vec![] };
        let cloud = holds(&SAMPLE, &spacing);
        missing.push(1.0 - cloud.volumes().iter().sum::<f64>() / SAMPLE.volume());
    }
    // Chords miss a share of the cylinder that falls with the square of the spacing.
    assert!(missing[0] / missing[1] > 3.0 && missing[1] / missing[2] > 3.0, "{missing:?}");
}

#[test]
fn contact_ring_is_resolved_by_edges_of_the_top_face() {
    let (radius, centre) = (0.005, [0.001, -0.002]);
    let ring = Feature::ContactRing { centre, radius, spacing: 0.0004 };
    let spacing = Spacing { far: 0.0018, growth: 0.3, features: vec![ring] };
    for domain in [SAMPLE, Domain::Box { size: [0.03, 0.024, 0.012] }] {
        let cloud = holds(&domain, &spacing);
        let off = |v: u32| {
            let p = cloud.points[v as usize];
            (p[0] - centre[0]).hypot(p[1] - centre[1]) / radius - 1.0
        };
        let top = |v: u32| cloud.faces[v as usize] & TOP != 0;
        let count = (0..cloud.points.len() as u32).filter(|&v| top(v) && off(v).abs() < 1e-9).count();
        assert_eq!(count, (2.0 * PI * radius / 0.0004_f64).round() as usize);
        let mut inside_area = 0.0;
        for (t, _) in cloud.surface.iter().zip(&cloud.surface_faces).filter(|(_, f)| **f == TOP) {
            let (inside, outside) = (t.iter().any(|&v| off(v) < -1e-9), t.iter().any(|&v| off(v) > 1e-9));
            assert!(!(inside && outside), "triangle {t:?} crosses the ring");
            if !outside {
                let [a, b, c] = t.map(|v| cloud.points[v as usize]);
                inside_area += 0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]));
            }
        }
        // The triangles inside make up exactly the regular polygon of the ring's nodes.
        let n = count as f64;
        let polygon = 0.5 * n * radius * radius * (2.0 * PI / n).sin();
        assert!((inside_area / polygon - 1.0).abs() < 1e-9, "{inside_area} of {polygon}");
    }
}

#[test]
fn needle_path_is_filled_by_its_layers_alone() {
    let (capture_radius, length, height) = (0.0005, 0.0101, 0.017);
    for centre in [[0.0, 0.0], [0.003, -0.0045]] {
        let path = Feature::Path { axis: Axis::vertical(centre), capture_radius, length, spacing: 0.00025 };
        let spacing = Spacing { far: 0.0022, growth: 0.3, features: vec![path] };
        let cloud = holds(&SAMPLE, &spacing);
        let radial = |p: &[f64; 3]| (p[0] - centre[0]).hypot(p[1] - centre[1]);
        let captured: Vec<_> = cloud
            .points
            .iter()
            .filter(|p| radial(p) <= capture_radius * (1.0 + 1e-9) && p[2] >= height - length * (1.0 + 1e-9))
            .collect();
        // 40 equal steps, in each layer an axis node and rings of 6 and 12.
        assert_eq!(captured.len(), 41 * 19);
        assert_eq!(path.path_nodes(), 41 * 19);
        for p in &captured {
            let layer = (height - p[2]) / (length / 40.0);
            assert!((layer - layer.round()).abs() < 1e-9, "{p:?}");
            let ring = radial(p) / (0.5 * capture_radius);
            assert!((ring - ring.round()).abs() < 1e-9, "{p:?}");
        }
        let others = cloud.points.iter().filter(|p| p[2] >= height - length).map(|p| radial(p) - capture_radius);
        let gap = others.filter(|g| *g > 1e-9).fold(f64::INFINITY, f64::min);
        assert!((0.6..1.2).contains(&(gap / 0.00025)), "next nodes {gap} m away");
    }
}

#[test]
fn same_input_same_bits_on_any_thread() {
    let first = generate(&SAMPLE, &needle()).unwrap();
    let others: Vec<Cloud> = (0..2)
        .map(|_| std::thread::spawn(|| generate(&SAMPLE, &needle()).unwrap()))
        .map(|t| t.join().unwrap())
        .collect();
    let bits = |c: &Cloud| c.points.iter().flatten().map(|x| x.to_bits()).collect::<Vec<_>>();
    for other in others {
        assert_eq!(bits(&first), bits(&other));
        assert_eq!(first.cells, other.cells);
        assert_eq!(first.surface, other.surface);
    }
}

#[test]
fn absurd_spacing_says_what_it_would_need_at_once() {
    let start = std::time::Instant::now();
    for far in [1e-6, 1e-9, 1e-300] {
        let error = generate(&SAMPLE, &Spacing { far, growth: 0.3, features: vec![] }).unwrap_err();
        assert!(matches!(error, CloudError::TooManyNodes { .. }), "{error}");
        assert!(error.to_string().contains("nodes") && error.to_string().contains("GB"), "{error}");
    }
    let ring = Feature::ContactRing { centre: [0.0, 0.0], radius: 0.005, spacing: 1e-8 };
    let rim = Feature::Rim { top: true, spacing: 1e-7 };
    let path = Feature::Path { axis: Axis::vertical([0.0; 2]), capture_radius: 0.0005, length: 0.01, spacing: 1e-6 };
    for feature in [ring, rim, path] {
        let error = generate(&SAMPLE, &Spacing { far: 0.002, growth: 0.3, features: vec![feature] }).unwrap_err();
        assert!(matches!(error, CloudError::TooManyNodes { .. }), "{error}");
    }
    assert!(start.elapsed().as_secs() < 5, "refused before anything was built");
}

#[test]
fn numbers_out_of_range_are_named() {
    let ring = |centre, radius, spacing| vec![Feature::ContactRing { centre, radius, spacing }];
    let path = |centre, capture_radius, length, spacing| {
        vec![Feature::Path { axis: Axis::vertical(centre), capture_radius, length, spacing }]
    };
    let cases: Vec<(f64, f64, Vec<Feature>, &str)> = vec![
        (0.0, 0.3, vec![], "spacing"),
        (-0.001, 0.3, vec![], "spacing"),
        (f64::NAN, 0.3, vec![], "spacing"),
        (0.02, 0.3, vec![], "spacing"),
        (0.002, 0.0, vec![], "growth"),
        (0.002, 5.0, vec![], "growth"),
        (0.002, 0.3, ring([0.0, 0.0], 0.005, 0.003), "edge spacing"),
        (0.002, 0.3, ring([0.0, 0.0], 0.005, -1.0), "edge spacing"),
        (0.002, 0.3, ring([0.0, 0.0], 0.0002, 0.0005), "edge spacing"),
        (0.002, 0.3, ring([0.0, 0.0], 0.0149, 0.0005), "contact radius"),
        (0.002, 0.3, ring([0.012, 0.0], 0.005, 0.0005), "contact radius"),
        (0.002, 0.3, path([0.0, 0.0], 0.0005, 0.02, 0.00025), "path length"),
        (0.002, 0.3, path([0.0149, 0.0], 0.0005, 0.01, 0.00025), "capture radius"),
        (0.002, 0.3, path([0.0, f64::NAN], 0.0005, 0.01, 0.00025), "capture radius"),
    ];
    for (far, growth, features, key) in cases {
        let what = format!("{far} {growth} {features:?}");
        match generate(&SAMPLE, &Spacing { far, growth, features }) {
            Err(CloudError::OutOfRange { key: named, .. }) => assert_eq!(named, key, "{what}"),
            other => panic!("{what}: {:?}", other.map(|c| c.points.len())),
        }
    }
    let flat = Domain::Cylinder { radius: 0.015, height: 0.0 };
    assert!(generate(&flat, &indentation()).unwrap_err().to_string().contains("sample height"));
    let mut close = needle();
    close.features.push(Feature::ContactRing { centre: [0.0, 0.0], radius: 0.0006, spacing: 0.0003 });
    assert!(generate(&SAMPLE, &close).unwrap_err().to_string().contains("another path"));
}

#[test]
fn check_names_what_is_wrong_with_an_imported_cloud() {
    let corner = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]];
    let good = vec![[0, 1, 2, 3], [0, 2, 1, 4]];
    assert_eq!(check(&corner, &good).unwrap().len(), 6);
    let fault = |points: &[[f64; 3]], cells: &[[u32; 4]]| check(points, cells).unwrap_err();
    assert_eq!(fault(&corner, &[]), Fault::Empty);
    assert!(matches!(fault(&corner, &[[0, 2, 1, 3], [0, 2, 1, 4]]), Fault::Inverted { cell: 0, .. }));
    assert!(matches!(fault(&corner, &[[0, 1, 2, 3], [0, 3, 4, 1], [0, 2, 1, 4]]), Fault::Flat { cell: 1, .. }));
    assert!(matches!(fault(&corner, &good[..1]), Fault::Isolated { node: 4, .. }));
    assert!(matches!(fault(&corner, &[[0, 1, 2, 9]]), Fault::UnknownNode { cell: 0, node: 9, nodes: 5 }));
    let mut twin = corner.clone();
    twin.push([1.0, 0.0, 0.0]);
    assert!(matches!(fault(&twin, &[good[0], [0, 2, 5, 4]]), Fault::Duplicate { first: 1, second: 5, .. }));
    let mut broken = corner.clone();
    broken[2][1] = f64::NAN;
    assert!(matches!(fault(&broken, &good), Fault::NotFinite { node: 2, .. }));
    // Two cells on the same side of one triangle.
    let mut above = corner.clone();
    above[4] = [0.2, 0.2, 2.0];
    assert!(matches!(fault(&above, &[[0, 1, 2, 3], [0, 1, 2, 4]]), Fault::Overlap { .. }));
    // Two cells that touch only along an edge, or only at a node.
    let mut two = corner.clone();
    two.extend([[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]);
    let edge = [[0, 1, 2, 3], [0, 5, 6, 3], [0, 2, 1, 4]];
    assert!(matches!(fault(&two, &edge), Fault::NonManifold { a: 0, b: 3, triangles: 4 }));
    let mut apart = corner[..4].to_vec();
    apart.extend([[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]);
    let node = [[0, 1, 2, 3], [0, 4, 6, 5]];
    assert_eq!(fault(&apart, &node), Fault::Pinched { node: 0 });
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 40, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_cylinder_with_a_ring_or_a_path(
        radius in 0.005..0.03f64, height in 0.005..0.04f64, coarse in 0.15..0.6f64, growth in 0.1..0.5f64,
        reach in 0.2..0.7f64, fine in 0.25..1.0f64, ring in any::<bool>(), rim in any::<bool>(),
    ) {
        let domain = Domain::Cylinder { radius, height };
        let far = coarse * domain.half_thickness();
        let centre = [0.15 * radius, -0.1 * radius];
        let mut features = vec![if ring {
            Feature::ContactRing { centre, radius: reach * radius, spacing: (fine * far).min(0.15 * radius) }
        } else {
            let capture_radius = (0.5 * fine * far).max(0.1 * far);
            Feature::Path { axis: Axis::vertical(centre), capture_radius, length: reach * height, spacing: 0.5 * capture_radius }
        }];
        if rim {
            features.push(Feature::Rim { top: true, spacing: fine * far });
        }
        let spacing = Spacing { far, growth, features };
        prop_assume!(spacing.predicted_nodes(&domain) < 20_000.0);
        holds(&domain, &spacing);
    }

    #[test]
    fn any_box(x in 0.01..0.05f64, y in 0.01..0.05f64, z in 0.005..0.04f64, coarse in 0.2..0.8f64, growth in 0.1..0.5f64) {
        let domain = Domain::Box { size: [x, y, z] };
        let spacing = Spacing { far: coarse * domain.half_thickness(), growth, features: vec![] };
        prop_assume!(spacing.predicted_nodes(&domain) < 20_000.0);
        holds(&domain, &spacing);
    }
}
