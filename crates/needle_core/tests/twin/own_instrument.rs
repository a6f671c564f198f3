//! Contract of own instruments: the built-in plate as a user would write it has the built-in plate's bits; one that drags the surface
//! has a lateral force, in balance with the base; a reset twin starts anew.
#![allow(clippy::unwrap_used)]

use mtled::solver::Solver;
use needle_core::instrument::{Instrument, Phase, Tip};
use needle_core::twin::{BuildError, Held, Twin};
use testkit::coarse::{alone, digits, scene, travel};

#[derive(Clone, Debug)]
struct Plate {
    nodes: Vec<u32>,
    drag: f64,
}

impl Instrument for Plate {
    fn impose(&mut self, tip: &Tip, solver: &mut Solver) -> Phase {
        let inside = tip.depth > 0.0;
        let [x, y, z] = if inside { tip.offset } else { [0.0; 3] };
        let displacement = [x - self.drag * z, y, z];
        self.nodes.iter().for_each(|&node| solver.prescribe(node as usize, displacement));
        solver.move_surface(displacement);
        if inside { Phase::Indentation } else { Phase::Approach }
    }

    fn reset(&mut self, solver: &mut Solver) {
        self.nodes.iter().for_each(|&node| solver.prescribe(node as usize, [0.0; 3]));
    }
}

fn own(drag: f64) -> Twin {
    let make = |Held { nodes, points }: Held| {
        assert_eq!(nodes.len(), points.len());
        assert!(points.iter().all(|p| (p[2] - points[0][2]).abs() < 1e-12), "the top face");
        Plate { nodes, drag }
    };
    Twin::with_instrument(&scene("compression", &[]), make).unwrap()
}

#[test]
fn a_plate_as_a_user_writes_it_has_the_plates_bits() {
    alone(|| {
        let mut built_in = Twin::new(&scene("compression", &[])).unwrap();
        assert_eq!(digits(&travel(&mut own(0.0), 0.0, 0.001, 40)), digits(&travel(&mut built_in, 0.0, 0.001, 40)));
    });
}

#[test]
fn a_plate_that_drags_is_pulled_back_and_the_base_holds_against_it() {
    alone(|| {
        let mut twin = own(0.2);
        let first = travel(&mut twin, 0.0, 0.001, 40);
        let last = first.last().unwrap();
        let ([fx, _, fz], [bx, ..]) = (last.force_n, last.base_force_n);
        // simple shear of the block: mu A u / H; its free sides make it softer, its compression stiffer
        let shear_n = 1678.0 * std::f64::consts::PI * 0.015_f64.powi(2) * 2e-4 / 0.017;
        assert!(fz > 0.0 && -fx > 0.5 * shear_n && -fx < 1.5 * shear_n, "{fx} N, {shear_n} N");
        assert!((fx + bx).abs().min((fx - bx).abs()) < 0.05 * fx.abs(), "{fx} {bx}");
        assert!(last.health.min_jacobian > 0.5);
        twin.reset();
        assert_eq!(digits(&travel(&mut twin, 0.0, 0.001, 40)), digits(&first));
    });
}

#[test]
fn a_half_plane_has_rings_and_no_nodes() {
    let half = scene("compression", &[("discretisation.dimension", "axisymmetric")]);
    let refused = Twin::with_instrument(&half, |Held { nodes, .. }| Plate { nodes, drag: 0.0 }).unwrap_err();
    assert!(matches!(refused, BuildError::Unsupported { .. }), "{refused}");
}
