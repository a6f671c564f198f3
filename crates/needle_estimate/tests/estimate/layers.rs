//! The friction that `layers` finds against the force that was measured: the parts add up.
#![allow(clippy::unwrap_used)]

use needle_estimate::layers::{Reading, layers};

const DIAMETER: f64 = 1e-3;

/// A curve of `tests/references`, 10 um between rows, read each 2 um at 1 mm/s with noise of some 0.4 mN.
fn reference(file: &str, seed: u64) -> Vec<Reading> {
    let path = format!("{}/../../tests/references/{file}", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(path).unwrap();
    let row = |l: &str| l.split(',').map(|x| x.parse().unwrap()).collect::<Vec<f64>>();
    let rows: Vec<Vec<f64>> = text.lines().skip(1).map(row).collect();
    let mut noise = Noise(seed);
    let between = rows
        .windows(2)
        .flat_map(|w| (0..5).map(move |s| [0, 1].map(|k| w[0][k] + 0.2 * f64::from(s) * (w[1][k] - w[0][k]))));
    let read = |(i, [depth, force]): (usize, [f64; 2])| {
        [2e-3 * i as f64, depth + 1e-6 * noise.next(), force + 7e-4 * noise.next()]
    };
    between.enumerate().map(read).collect()
}

struct Noise(u64);

impl Noise {
    /// A pseudo-random number between -1 and 1.
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as f64 / f64::from(1 << 30) - 1.0
    }
}

/// A recording from 2 mm above the surface to a depth, m, and out again at 2 mm/s and 500 Hz: force over depth on the way in and on the way out.
fn in_and_out(deepest: f64, down: impl Fn(f64) -> f64, up: impl Fn(f64) -> f64) -> Vec<Reading> {
    let mut noise = Noise(7);
    let half = (250.0 * 1e3 * (deepest + 0.002)) as i32;
    let read = |i: i32| {
        let depth = deepest - 4e-6 * f64::from((i - half).abs());
        [2e-3 * f64::from(i), depth, if i <= half { down(depth) } else { up(depth) } + 1e-3 * noise.next()]
    };
    (0..=2 * half).map(read).collect()
}

#[test]
fn of_needles_that_rub_the_parts_add_up() {
    for (file, cutting) in [("rod_double.csv", 0.014), ("bar_double.csv", 0.005)] {
        for seed in 0..4 {
            let all = reference(file, seed);
            let air = all.iter().skip(100).position(|r| r[1] < -0.95e-3).unwrap() + 100;
            for (readings, number) in [(&all[..], 3), (&all[..=air], 3), (&all[..=air], 1)] {
                let found = layers(readings, DIAMETER, number).unwrap();
                assert!(found.beyond().is_none() && found.parts.len() >= 20, "{found:?}");
                let last = found.parts.last().unwrap();
                assert!(number == 1 || (last.at_the_tip_n() / cutting - 1.0).abs() < 0.15, "{file}: {last:?}");
            }
        }
    }
}

/// The membrane at the surface breaks before the shaft rubs, and at the deepest the friction is that of the way out.
#[test]
fn one_insertion_and_its_way_out_tell_the_first_puncture_and_the_last_cutting_force() {
    for (file, cutting, puncture) in [("rod_double.csv", 0.014, 0.030), ("bar_double.csv", 0.005, 0.022)] {
        let (mut worst, mut inside) = ([0.0_f64; 2], 0);
        for seed in 0..10 {
            let all = reference(file, seed);
            let air = all.iter().skip(100).position(|r| r[1] < -0.95e-3).unwrap() + 100;
            let found = layers(&all[..=air], DIAMETER, 3).unwrap();
            let [first, second, last] = &found.layers[..] else { unreachable!("three were asked for") };
            let (c, p) = (last.cutting_force_n.unwrap(), first.puncture_force_n.unwrap());
            let told = [first.cutting_force_n, second.cutting_force_n, second.puncture_force_n, last.puncture_force_n];
            assert_eq!(told, [None; 4]);
            worst = [worst[0].max((c.value / cutting - 1.0).abs()), worst[1].max((p.value / puncture - 1.0).abs())];
            inside += u32::from((c.value - cutting).abs() < 1.96 * c.standard_error);
        }
        println!(
            "{file}: cutting and puncture off by {worst:.3?} at most, cutting within 1.96 standard errors {inside} of 10"
        );
        assert!(worst[0] < 0.16 && worst[1] < 0.03 && inside >= 9, "{worst:?}, {inside}");
    }
}

/// Tissue that sticks to the needle and springs back: on the way out it pulls, and its pull falls with a slope that is taken for friction. Over the
/// depth that would be 0.81 N where the whole force is 0.45 N.
#[test]
fn a_friction_that_exceeds_the_whole_force_is_said() {
    let down = |d: f64| 25.0 * d.max(0.0);
    // tears off halfway; and slides freely from 10 mm up
    let torn = |d: f64| if d > 0.009 { 0.45 - 95.0 * (0.018 - d) } else { -45.0 * d.max(0.0) };
    let free = |d: f64| if d > 0.0165 { 0.45 - 500.0 * (0.018 - d) } else { -45.0 * (d - 0.0098).max(0.0) };
    for up in [&torn as &dyn Fn(f64) -> f64, &free] {
        let found = layers(&in_and_out(0.018, down, up), DIAMETER, 1).unwrap();
        let friction = found.layers[0].friction_n_per_m.value;
        println!("{friction:.2} N/m, {:?}", found.beyond());
        assert!((friction / 45.0 - 1.0).abs() < 0.05);
        let beyond = found.beyond().unwrap();
        assert!(beyond.friction_n > 1.3 * beyond.measured_n && beyond.depth_m > 0.01, "{beyond:?}");
    }
    // the same friction where the force has room for it
    let found = layers(&in_and_out(0.018, |d| if d > 0.0 { 0.05 + 45.0 * d } else { 0.0 }, torn), DIAMETER, 1).unwrap();
    assert!(found.beyond().is_none(), "{:?}", found.beyond());
}
