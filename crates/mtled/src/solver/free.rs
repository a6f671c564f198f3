//! All nodes through one step, the free ones four at a time in the processor's vectors, and what they contribute to the balance.

use super::inertia::Sums;
use super::nodes::{Held, Nodes, Rule};
use super::state::Role;
use crate::number::{Loop, run};

/// Nodes that go together: their components fill whole vectors.
const FOUR: usize = 4;

impl Nodes<'_> {
    /// Moves all of these nodes through one step, from the forces at its start.
    pub(super) fn integrate_all(&mut self, held: &Held<'_>, step: u32, rule: &Rule) {
        run(Motion { nodes: self, held, step, rule });
    }

    /// What these nodes contribute to the balance.
    pub(super) fn sums(&self, held: &Held<'_>, mass_factor: f64) -> Sums {
        let mut sums = Sums::default();
        run(Summing { nodes: self, held, mass_factor, sums: &mut sums });
        sums
    }
}

struct Motion<'a, 'n, 'h> {
    nodes: &'a mut Nodes<'n>,
    held: &'a Held<'h>,
    step: u32,
    rule: &'a Rule,
}

impl Loop for Motion<'_, '_, '_> {
    #[inline(always)]
    fn go(self) {
        let Self { nodes, held, step, rule } = self;
        let roles = &held.role[nodes.first..nodes.first + nodes.u.len()];
        let mut l = 0;
        while l < roles.len() {
            let mut count = 1;
            match roles[l] {
                Role::Free if roles[l..].len() >= FOUR && roles[l..l + FOUR].iter().all(|r| *r == Role::Free) => {
                    count = FOUR;
                    move_free::<FOUR, { 3 * FOUR }>(nodes, l, held, rule);
                }
                Role::Free => move_free::<1, 3>(nodes, l, held, rule),
                _ => nodes.integrate(l, held, step, rule),
            }
            l += count;
        }
    }
}

/// The components of some nodes of a field.
#[inline(always)]
fn components<const C: usize>(field: &mut [[f64; 3]], l: usize) -> &mut [f64; C] {
    let [those] = field[l..l + C / 3].as_flattened_mut().as_chunks_mut().0 else { unreachable!("C components") };
    those
}

/// Moves free nodes through one step: the same operations on each of C components, however many there are, hence the same bits.
#[inline(always)]
fn move_free<const NODES: usize, const C: usize>(nodes: &mut Nodes<'_>, l: usize, held: &Held<'_>, rule: &Rule) {
    let n = nodes.first + l;
    let mut inverse = [0.0; NODES];
    inverse.iter_mut().zip(&held.mass[n..n + NODES]).for_each(|(i, mass)| *i = 1.0 / (mass * rule.mass_factor));
    let inverse: [f64; C] = std::array::from_fn(|i| inverse[i / 3]);
    let [u, q, f] = [&mut *nodes.u, &mut *nodes.q, &mut *nodes.f].map(|field| components::<C>(field, l));
    let [x, y, z] = nodes.tangent.each_mut().map(|t| components::<C>(t, l));
    let mut left = [0.0; C];
    for i in 0..C {
        left[i] = rule.keep * q[i] - f[i] * inverse[i];
    }
    let along = rule.travel;
    if along[0] == 0.0 && along[1] == 0.0 {
        // mostly an instrument moves along z alone
        for i in 0..C {
            u[i] += z[i] * along[2] + left[i];
        }
    } else {
        for i in 0..C {
            u[i] += x[i] * along[0] + y[i] * along[1] + z[i] * along[2] + left[i];
        }
    }
    let deviation = left;
    for (d, tangent) in [x, y, z].into_iter().enumerate().filter(|(d, _)| along[*d] != 0.0) {
        let learn = rule.learn * rule.gain[d];
        for i in 0..C {
            let lesson = learn * deviation[i];
            tangent[i] += lesson;
            left[i] -= lesson * along[d];
        }
    }
    *q = left;
    for l in (l..l + NODES).filter(|l| held.keeps_on_axis(nodes.first + l)) {
        (nodes.u[l][0], nodes.q[l][0]) = (0.0, 0.0);
        nodes.tangent.iter_mut().for_each(|t| t[l][0] = 0.0);
    }
}

struct Summing<'a, 'n, 'h> {
    nodes: &'a Nodes<'n>,
    held: &'a Held<'h>,
    mass_factor: f64,
    sums: &'a mut Sums,
}

impl Loop for Summing<'_, '_, '_> {
    #[inline(always)]
    fn go(self) {
        let Self { nodes, held, mass_factor, sums } = self;
        let [x, y, z] = nodes.tangent.each_ref().map(|t| &t[..]);
        for (l, (role, mass)) in held.role[nodes.first..].iter().zip(&held.mass[nodes.first..]).enumerate() {
            let Some(f) = nodes.f.get(l) else { break };
            if *role != Role::Free {
                nodes.add_to(sums, l, held, mass_factor);
            } else if held.revolved {
                // nothing goes sideways
                sums.add_free(mass * mass_factor, &nodes.q[l], [&z[l]], f);
            } else {
                sums.add_free(mass * mass_factor, &nodes.q[l], [&x[l], &y[l], &z[l]], f);
            }
        }
    }
}
