//! Contract of [`Team`]: its members step as solvers alone do, with the same bits.
#![allow(clippy::unwrap_used)]

use std::sync::Arc;

use mtled::approximation::axisymmetric::AxisymmetricApproximation;
use mtled::approximation::{Basis, Settings, ShapeTable};
use mtled::cloud::{BASE, Domain, Spacing, TOP, meridian::meridian};
use mtled::material::{Distortional, Law, MooneyRivlin, Ogden, Own, Prony, VerondaWestmann, Yeoh};
use mtled::solver::{Advance, Precision, Role, Solver, SolverSettings, Team, VolumeRatio};

/// A pressed half plane.
struct Plane {
    points: Vec<[f64; 3]>,
    cells: Vec<[u32; 4]>,
    roles: Vec<Role>,
    table: ShapeTable,
}

fn plane() -> Plane {
    let spacing = Spacing { far: 0.003, growth: 0.3, features: Vec::new() };
    let plane = meridian(&Domain::Cylinder { radius: 0.012, height: 0.01 }, &spacing).unwrap();
    let role = |faces: &u8| match faces {
        f if f & BASE != 0 => Role::Base,
        f if f & TOP != 0 => Role::Instrument,
        _ => Role::Free,
    };
    let roles: Vec<Role> = plane.faces.iter().map(role).collect();
    let held: Vec<bool> = roles.iter().map(|r| *r != Role::Free).collect();
    let basis = Some(Basis::Quadratic { penalty: 1e-2 });
    let settings = Settings { basis, support_factor: 1.8, points_per_cell: 1, cells_per_point: 1 };
    let table = AxisymmetricApproximation::new(&plane.points, &plane.triangles, &held, settings).table().unwrap();
    let cells = plane.triangles.iter().map(|&[a, b, c]| [a, b, c, c]).collect();
    Plane { points: plane.points, cells, roles, table }
}

fn law(k: usize) -> Law {
    Law::neo_hookean(1678.0 * (0.7 + 0.2 * k as f64), 83_340.0)
}

/// Solvers of so many laws on one cloud.
fn solvers(plane: &Plane, precision: Precision, laws: &[Law]) -> Vec<Solver> {
    with(VolumeRatio::Projected, plane, precision, laws)
}

fn with(volume_ratio: VolumeRatio, plane: &Plane, precision: Precision, laws: &[Law]) -> Vec<Solver> {
    let settings = SolverSettings { law: laws[0], volume_ratio, precision, step_factor: 0.8, threads: 1 };
    let first = Solver::new(&plane.table, &plane.cells, &plane.points, plane.roles.clone(), &settings);
    laws.iter().map(|law| Solver::of(Arc::new(first.model().with_laws(&[*law])), 1)).collect()
}

/// Presses a solver's top to a depth, m.
fn press(solver: &mut Solver, depth: f64) {
    for n in 0..solver.roles().len() {
        if solver.roles()[n] == Role::Instrument {
            solver.prescribe(n, [0.0, 0.0, -depth]);
        }
    }
}

fn step_together(team: &mut Team, solvers: &mut [Solver], steps: u32, travel: f64) {
    let mut all = solvers.iter_mut();
    team.advance(&mut std::array::from_fn(|_| all.next()), &[steps; Team::MOST], &[[0.0, 0.0, travel]; Team::MOST]);
}

#[test]
fn members_step_as_solvers_alone() {
    let plane = plane();
    let laws = [law(0), law(1), law(2)];
    let (projected, mixed) = (VolumeRatio::Projected, VolumeRatio::Mixed);
    // of what is asked of single points, which a member computes anew in double precision
    let (single, double) = ((Precision::F32, 2e-4), (Precision::F64, 1e-9));
    for (ratio, (precision, close)) in [(projected, single), (projected, double), (mixed, single), (mixed, double)] {
        let mut alone = with(ratio, &plane, precision, &laws);
        let mut together = with(ratio, &plane, precision, &laws);
        let mut team = Team::new(&together.iter().collect::<Vec<_>>(), None).unwrap();
        let travel = 2e-5;
        // masses are brought up to date on the way
        for pose in 1..=40 {
            for solver in alone.iter_mut().chain(&mut together) {
                press(solver, travel * f64::from(pose));
            }
            for solver in &mut alone {
                solver.refresh_if_due();
                solver.advance(&Advance { steps: 3, travel: [0.0, 0.0, travel] });
            }
            step_together(&mut team, &mut together, 3, travel);
        }
        for (own, member) in alone.iter().zip(&together) {
            let (a, b) = (own.balance(), member.balance());
            assert!(a.instrument[2] > 0.1 && a == b, "{precision:?}: the same bits, {a:?} {b:?}");
            assert_eq!(own.parameters(), member.parameters(), "{precision:?}");
            assert!(own.min_jacobian() == member.min_jacobian() && own.slowest() == member.slowest());
            // what is asked of single points
            for point in 0..plane.table.volume.len() {
                let (f, g) = (own.deformation(point), member.deformation(point));
                assert!((0..9).all(|i| (f[i] - g[i]).abs() < 3.0 * close), "{precision:?} {point}: {f:?} {g:?}");
                let (e, d) = (own.energy_of(point), member.energy_of(point));
                assert!((e - d).abs() < 10.0 * close * a.strain, "{precision:?} {point}: {e} {d}");
            }
            let stresses = |solver: &Solver| {
                let mut all = Vec::new();
                solver.for_points(|point, _, stress, _| all.push((point, stress)));
                all
            };
            for ((p, s), (q, t)) in stresses(own).into_iter().zip(stresses(member)) {
                assert!(p == q && (0..9).all(|i| (s[i] - t[i]).abs() < 3e5 * close), "{precision:?} {p}: {s:?} {t:?}");
            }
        }
        let force = |k: usize| together[k].balance().instrument[2];
        assert!(force(1) > 1.1 * force(0) && force(2) > 1.1 * force(1), "each has its own law");
    }
}

/// Every law in the lanes, in both precisions; members of an Ogden law with terms of their own.
#[test]
fn members_of_every_law_step_as_solvers_alone() {
    let plane = plane();
    let of = |distortional: [Distortional; 2]| distortional.map(|distortional| Law { distortional, ..law(0) });
    let ogden = |moduli: &[f64], exponents: &[f64]| Distortional::Ogden(Ogden::new(moduli, exponents).unwrap());
    let yeoh = |c20: f64| Distortional::Yeoh(Yeoh { c10: 839.0, c20, c30: 20.0 });
    let mooney = |c01: f64| Distortional::MooneyRivlin(MooneyRivlin { c10: 539.0, c01 });
    let veronda = |exponent: f64| Distortional::VerondaWestmann(VerondaWestmann { shear_modulus: 1678.0, exponent });
    let pairs = [
        of([yeoh(-60.0), yeoh(100.0)]),
        of([mooney(300.0), mooney(100.0)]),
        of([veronda(0.8), veronda(2.0)]),
        // the same law twice, as a caller's own
        of([300.0, 100.0].map(|c01| Distortional::Own(Own::new(&MooneyRivlin { c10: 539.0, c01 })))),
        of([ogden(&[1678.0], &[-4.7]), ogden(&[400.0, 900.0, 378.0], &[1.3, 5.0, -2.0])]),
    ];
    for (laws, precision) in pairs.iter().flat_map(|p| [(p, Precision::F32), (p, Precision::F64)]) {
        let (mut alone, mut together) = (solvers(&plane, precision, laws), solvers(&plane, precision, laws));
        let mut team = Team::new(&together.iter().collect::<Vec<_>>(), None).unwrap();
        for pose in 1..=40 {
            let travel = 2e-5;
            alone.iter_mut().chain(&mut together).for_each(|solver| press(solver, travel * f64::from(pose)));
            for solver in &mut alone {
                solver.refresh_if_due();
                solver.advance(&Advance { steps: 3, travel: [0.0, 0.0, travel] });
            }
            step_together(&mut team, &mut together, 3, travel);
        }
        let force = |solver: &Solver| solver.balance().instrument[2];
        for (own, member) in alone.iter().zip(&together) {
            assert!(force(own) > 0.1 && own.balance() == member.balance(), "{laws:?} {precision:?}: the same bits");
            assert_eq!(own.parameters(), member.parameters(), "{laws:?} {precision:?}");
        }
        assert!(force(&alone[0]) != force(&alone[1]), "{laws:?}: each has its own constants");
    }
    let own = of([
        Distortional::Own(Own::new(&MooneyRivlin { c10: 539.0, c01: 300.0 })),
        Distortional::Own(Own::new(&Yeoh { c10: 839.0, c20: 10.0, c30: 20.0 })),
    ]);
    for two in [[law(0), pairs[0][0]], own] {
        let different = solvers(&plane, Precision::F32, &two);
        assert!(Team::new(&different.iter().collect::<Vec<_>>(), None).is_none(), "two laws");
    }
}

#[test]
fn a_member_may_leave_and_come_back() {
    let plane = plane();
    let laws = [law(0), law(1)];
    let mut solvers = solvers(&plane, Precision::F64, &laws);
    let mut never = self::solvers(&plane, Precision::F64, &laws);
    let mut team = Team::new(&solvers.iter().collect::<Vec<_>>(), None).unwrap();
    for pose in 1..=60 {
        let depth = 1e-5 * f64::from(pose);
        solvers.iter_mut().chain(&mut never).for_each(|solver| press(solver, depth));
        let advance = Advance { steps: 1, travel: [0.0, 0.0, 1e-5] };
        let alone = |solver: &mut Solver| {
            solver.refresh_if_due();
            solver.advance(&advance);
        };
        never.iter_mut().for_each(alone);
        if pose % 7 == 0 {
            // one alone, and the other in a team of one
            let (first, rest) = solvers.split_at_mut(1);
            alone(&mut first[0]);
            let mut members = [const { None }; Team::MOST];
            members[1] = rest.first_mut();
            team.advance(&mut members, &[1; Team::MOST], &[advance.travel; Team::MOST]);
        } else {
            step_together(&mut team, &mut solvers, 1, 1e-5);
        }
    }
    for (a, b) in solvers.iter().zip(&never) {
        let (a, b) = (a.balance(), b.balance());
        assert!(a.instrument[2] > 0.01 && a == b, "{a:?} {b:?}");
    }
}

#[test]
fn each_member_has_its_own_number_of_steps() {
    let plane = plane();
    let laws = [law(0), law(1), law(2)];
    let mut alone = solvers(&plane, Precision::F64, &laws);
    let mut together = solvers(&plane, Precision::F64, &laws);
    let mut team = Team::new(&together.iter().collect::<Vec<_>>(), None).unwrap();
    let travel = [0.0, 0.0, 1e-5];
    for pose in 1..=60 {
        alone.iter_mut().chain(&mut together).for_each(|solver| press(solver, 1e-5 * f64::from(pose)));
        // masses are brought up to date at each one's own time, on the way to a pose as well
        let steps: [u32; Team::MOST] = std::array::from_fn(|k| if pose % 7 == 3 { 0 } else { 1 + 2 * k as u32 });
        for (solver, &steps) in alone.iter_mut().zip(&steps).filter(|(_, steps)| **steps > 0) {
            solver.refresh_if_due();
            solver.advance(&Advance { steps, travel });
        }
        let mut all = together.iter_mut().zip(steps).map(|(solver, steps)| (steps > 0).then_some(solver));
        team.advance(&mut std::array::from_fn(|_| all.next().flatten()), &steps, &[travel; Team::MOST]);
    }
    for (a, b) in alone.iter().zip(&together) {
        let (a, b) = (a.balance(), b.balance());
        assert!(a.instrument[2] > 1e-2 && a == b, "{a:?} {b:?}");
    }
}

#[test]
fn a_team_is_of_one_cloud_and_of_plain_laws() {
    let plane = plane();
    let relaxing = Law { prony: Prony::new(&[0.3], &[1.0]).unwrap(), ..law(0) };
    let [one, other] = [0, 1].map(|_| solvers(&plane, Precision::F32, &[law(0), law(1)]));
    let makes = |solvers: &[&Solver]| Team::new(solvers, None).is_some();
    assert!(makes(&[&one[0], &one[1]]));
    assert!(!makes(&[&one[0], &other[1]]), "two clouds");
    assert!(!makes(&[]));
    assert!(!makes(&[&one[0]; Team::MOST + 1]));
    assert!(!makes(&[&solvers(&plane, Precision::F32, &[relaxing])[0]]));
}
