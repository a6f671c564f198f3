//! A material law of one's own: rubber by Arruda and Boyce (1993) in three terms. Its constants and the slopes of its energy are all that the
//! solver needs; `tests/material.rs` checks it by differences together with the built-in laws.
//!
//! `cargo run --release -p mtled --example own_law`

use mtled::material::neo_hookean::{cofactor, determinant};
use mtled::material::{Distortional, IsochoricLaw, Law, Own, Slopes};
use mtled::number::Number;

/// W = mu ((a - 3) / 2 + (a^2 - 9) / (20 n) + 11 (a^3 - 27) / (1050 n^2)) with the chains' number of links n.
#[derive(Clone, Copy, Debug)]
pub struct ArrudaBoyce {
    /// mu, Pa; the initial shear modulus is mu (1 + 3 / (5 n) + 99 / (175 n^2)).
    pub mu: f64,
    /// n.
    pub links: f64,
}

impl IsochoricLaw<3> for ArrudaBoyce {
    const SECOND: bool = false;

    fn constants(&self) -> [f64; 3] {
        [self.mu / 2.0, self.mu / (20.0 * self.links), 11.0 * self.mu / (1050.0 * self.links * self.links)]
    }

    #[inline(always)]
    fn slopes<N: Number>(&[c1, c2, c3]: &[N; 3], a: N, _: N) -> Slopes<N> {
        let (two, three) = (N::of(2.0), N::of(3.0));
        Slopes {
            w: (a - three) * (c1 + c2 * (a + three) + c3 * (a * a + three * a + N::of(9.0))),
            a: c1 + two * c2 * a + three * c3 * a * a,
            aa: two * c2 + N::of(6.0) * c3 * a,
            ..Slopes::default()
        }
    }
}

fn main() {
    let rubber = ArrudaBoyce { mu: 1500.0, links: 6.0 };
    println!("initial shear modulus {:.1} Pa", rubber.shear_modulus());
    let law = Law { distortional: Distortional::Own(Own::new(&rubber)), ..Law::neo_hookean(1500.0, 150_000.0) };
    for stretch in [1.0, 1.2, 1.5, 2.0, 3.0_f64] {
        let across = stretch.powf(-0.5);
        let f = [across, 0.0, 0.0, 0.0, across, 0.0, 0.0, 0.0, stretch];
        let cof = cofactor(&f);
        let (energy, stress) = law.distortion(&f, &cof, determinant(&f, &cof));
        // without pressure: what is across is taken off
        let along = stress[8] - stress[0] * across / stretch;
        println!("stretch {stretch:.1}: {energy:8.1} J/m^3, {along:8.1} Pa along");
    }
}
