//! Rigid surfaces: which points are inside, how deep, and which way leads out.

use mtled::solver::Shape;

const SHAPES: [Shape; 6] = [
    Shape::Plate,
    Shape::Table,
    Shape::Punch { radius: 2.0, edge: 0.0 },
    Shape::Punch { radius: 1.5, edge: 0.5 },
    Shape::Shaft { radius: 2.0, slope: [0.4, -0.3] },
    Shape::Ball { radius: 2.0 },
];

/// Points all over the neighbourhood of the shapes.
fn points() -> impl Iterator<Item = [f64; 3]> {
    let value = |i: usize| ((i.wrapping_mul(2_654_435_761) >> 7) % 10_007) as f64 / 10_007.0 - 0.5;
    (0..2000).map(move |i| std::array::from_fn(|k| 8.0 * value(3 * i + k + 1)))
}

#[test]
fn the_normal_is_the_gradient_of_the_depth_and_leads_out() {
    for shape in SHAPES {
        let mut seen = 0;
        for x in points() {
            let Some(inside) = shape.inside(&x, &x) else { continue };
            seen += 1;
            let length = inside.normal.iter().map(|n| n * n).sum::<f64>();
            assert!((length - 1.0).abs() < 1e-12, "{shape:?} {x:?}");
            let out: [f64; 3] = std::array::from_fn(|k| x[k] + (inside.depth + 1e-9) * inside.normal[k]);
            assert_eq!(shape.inside(&x, &out), None, "{shape:?} {x:?}");
            for k in 0..3 {
                let at = |h: f64| {
                    let mut y = x;
                    y[k] += h;
                    shape.inside(&x, &y).map_or(0.0, |i| i.depth)
                };
                let slope = (at(1e-6) - at(-1e-6)) / 2e-6;
                let near = inside.depth < 1e-5;
                assert!(near || (slope + inside.normal[k]).abs() < 1e-6, "{shape:?} {x:?} {k}: {slope}");
            }
        }
        assert!(seen > 50, "{shape:?}: {seen}");
    }
}

#[test]
fn a_shaft_that_stands_upright_is_a_sharp_punch() {
    let (shaft, punch) = (Shape::Shaft { radius: 2.0, slope: [0.0; 2] }, Shape::Punch { radius: 2.0, edge: 0.0 });
    for (from, x) in points().zip(points().skip(7)).filter(|(from, _)| punch.inside(from, from).is_none()) {
        let (a, b) = (shaft.inside(&from, &x), punch.inside(&from, &x));
        assert_eq!(a.is_some(), b.is_some(), "{from:?} {x:?}");
        let (Some(a), Some(b)) = (a, b) else { continue };
        assert!((a.depth - b.depth).abs() < 1e-12, "{from:?} {x:?}: {a:?} {b:?}");
        assert!((0..3).all(|k| (a.normal[k] - b.normal[k]).abs() < 1e-12), "{from:?} {x:?}: {a:?} {b:?}");
    }
}

#[test]
fn a_point_leaves_a_punch_where_it_entered() {
    let punch = Shape::Punch { radius: 2.0, edge: 0.0 };
    let inside = [1.9, 0.0, 0.05];
    let through_the_face = punch.inside(&[1.9, 0.0, -0.01], &inside).map(|i| i.normal);
    let through_the_wall = punch.inside(&[2.0, 0.0, 0.3], &inside).map(|i| i.normal);
    assert_eq!((through_the_face, through_the_wall), (Some([0.0, 0.0, -1.0]), Some([1.0, 0.0, 0.0])));
    assert_eq!(punch.inside(&inside, &[2.1, 0.0, 0.1]), None);
    assert_eq!(punch.inside(&inside, &[0.0, 0.0, -0.1]), None);
}
