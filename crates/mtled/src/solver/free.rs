//! Nodes through one step: the free ones four at a time, in the processor's vectors.

use super::inertia::Sums;
use super::nodes::{Held, Nodes, Rule};
use super::state::Role;
use crate::number::lanes::{Loop, run};

/// Nodes that go together: their components fill whole vectors.
const FOUR: usize = 4;

/// Components of four nodes.
type Components = [f64; 3 * FOUR];

impl Nodes<'_> {
    /// Moves all of these nodes through one step, from the forces at its start.
    pub fn integrate_all(&mut self, held: &Held<'_>, step: u32, rule: &Rule) {
        run(Motion { nodes: self, held, step, rule });
    }

    /// What these nodes contribute to the balance.
    pub fn sums(&self, held: &Held<'_>, mass_factor: f64) -> Sums {
        let mut sums = Sums::default();
        run(Summing { nodes: self, held, mass_factor, sums: &mut sums });
        sums
    }

    /// Whether nothing holds the four nodes from `l` on, nor a symmetry.
    #[inline(always)]
    fn are_free(&self, l: usize, held: &Held<'_>) -> bool {
        let n = self.first + l;
        let free = held.role[n..n + FOUR].iter().all(|role| *role == Role::Free);
        free && (n..n + FOUR).all(|n| !held.keeps_on_axis(n))
    }
}

/// Four nodes of a field.
#[inline(always)]
fn four<'a>(field: &'a mut [[f64; 3]], l: usize) -> &'a mut Components {
    let [one] = field[l..l + FOUR].as_flattened_mut().as_chunks_mut::<{ 3 * FOUR }>().0 else { unreachable!() };
    one
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
        let mut l = 0;
        while l < nodes.u.len() {
            if l + FOUR <= nodes.u.len() && nodes.are_free(l, held) {
                move_four(nodes, l, held, rule);
                l += FOUR;
            } else {
                nodes.integrate(l, held, step, rule);
                l += 1;
            }
        }
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

/// What [`Nodes::integrate`] does to free nodes: the same operations on each component, hence the same bits.
#[inline(always)]
fn move_four(nodes: &mut Nodes<'_>, l: usize, held: &Held<'_>, rule: &Rule) {
    let n = nodes.first + l;
    let mut inverse = [0.0; FOUR];
    inverse.iter_mut().zip(&held.mass[n..n + FOUR]).for_each(|(i, mass)| *i = 1.0 / (mass * rule.mass_factor));
    let inverse: Components = std::array::from_fn(|i| inverse[i / 3]);
    let (u, q, f) = (four(nodes.u, l), four(nodes.q, l), four(nodes.f, l));
    let [x, y, z] = nodes.tangent.each_mut().map(|t| four(t, l));
    let mut left = [0.0; 3 * FOUR];
    for i in 0..3 * FOUR {
        left[i] = rule.keep * q[i] - f[i] * inverse[i];
    }
    let along = rule.travel;
    if along[0] == 0.0 && along[1] == 0.0 {
        for i in 0..3 * FOUR {
            u[i] += z[i] * along[2] + left[i];
        }
    } else {
        for i in 0..3 * FOUR {
            u[i] += x[i] * along[0] + y[i] * along[1] + z[i] * along[2] + left[i];
        }
    }
    let deviation = left;
    for (d, tangent) in [x, y, z].into_iter().enumerate().filter(|(d, _)| along[*d] != 0.0) {
        let learn = rule.learn * rule.gain[d];
        for i in 0..3 * FOUR {
            let lesson = learn * deviation[i];
            tangent[i] += lesson;
            left[i] -= lesson * along[d];
        }
    }
    *q = left;
}
