//! Contact of free nodes with rigid surfaces, within the explicit step.
//!
//! ```text
//! x*     = where the step takes the node by itself
//! g      = depth of x* inside the surface, n its normal;    w = x* - x - (motion of the surface) without its part along n
//! dx     = g n - w                    if |w| <= mu g        it sticks
//!        = g n - mu g w / |w|         otherwise             it slides
//! x     <- x* + dx,   force on the node = m dx
//! ```
//!
//! A rigid surface needs no penalty: with lumped masses the displacement that takes a node out of the surface is the impulse of the
//! contact over its mass (forward-increment multipliers: Carpenter, Taylor, Katona, Int. J. Numer. Meth. Engng 32, 1991), and the
//! largest eigenvalue of a constrained system is no larger than that of the free one, so the stable step stays. Coulomb's law is
//! the return mapping of the tangential impulse, the mass drops out. A node that sticks keeps its place on the surface exactly, so
//! stick needs no memory. A frictionless surface has mu = 0; one to which tissue sticks wherever it presses has an infinite mu.
//!
//! A node here is one whose nodal parameter is the field's value (see `approximation::weight::interpolating`).
//!
//! *Motion.* What is held moves with the surface, as a prescribed node does: its tangent motion follows at once, and it has no
//! velocity relative to that. What slides is free in the surface's plane.

use super::surface::Shape;
use crate::vector::dot;

/// A rigid surface and its law of contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// What it looks like.
    pub shape: Shape,
    /// Where its lowest (a table's highest) point stands before any motion, m.
    pub origin: [f64; 3],
    /// mu, Coulomb's coefficient of friction: 0 or more, infinite for tissue that never slides.
    pub friction: f64,
}

/// Whose surface holds a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub(super) enum By {
    #[default]
    Nobody,
    Instrument,
    Base,
}

/// What a surface does to a node.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Touch {
    /// Who touches it.
    pub by: By,
    /// Unit normal, out of the surface.
    pub normal: [f64; 3],
    /// Whether it sticks.
    pub sticks: bool,
    /// Force of friction on it while it slides, N.
    pub friction: [f64; 3],
}

impl Touch {
    /// Force of the surface on a node whose internal force is `f`, N: what it holds of that, and friction.
    pub(super) fn force(&self, f: &[f64; 3]) -> [f64; 3] {
        if self.sticks {
            return *f;
        }
        let along = dot(*f, self.normal);
        std::array::from_fn(|k| along * self.normal[k] + self.friction[k])
    }

    /// The part of a vector in which the node is free.
    pub(super) fn free(&self, v: &[f64; 3]) -> [f64; 3] {
        if self.sticks {
            return [0.0; 3];
        }
        let along = dot(*v, self.normal);
        std::array::from_fn(|k| v[k] - along * self.normal[k])
    }
}

/// A surface and its motion in one step.
#[derive(Clone, Copy, Debug)]
pub(super) struct Moved<'a> {
    pub surface: &'a Surface,
    /// Where it stands before and after the step, as offset from its origin, m.
    pub from: [f64; 3],
    pub to: [f64; 3],
}

impl Moved<'_> {
    /// What brings a node that goes from `x` to `trial` (places in m) out of the surface, and how it is held.
    pub(super) fn meet(&self, x: &[f64; 3], trial: &[f64; 3]) -> Option<([f64; 3], Touch)> {
        let Surface { shape, origin, friction } = self.surface;
        let from = std::array::from_fn(|k| x[k] - origin[k] - self.from[k]);
        let to = std::array::from_fn(|k| trial[k] - origin[k] - self.to[k]);
        let inside = shape.inside(&from, &to)?;
        let normal = inside.normal;
        let mut way: [f64; 3] = std::array::from_fn(|k| to[k] - from[k]);
        let along = dot(way, normal);
        (0..3).for_each(|k| way[k] -= along * normal[k]);
        let (size, limit) = (dot(way, way).sqrt(), friction * inside.depth);
        let sticks = *friction > 0.0 && size <= limit;
        let share = if sticks { 1.0 } else { limit.min(size) / size.max(f64::MIN_POSITIVE) };
        let friction = way.map(|w| -share * w);
        let move_out = std::array::from_fn(|k| inside.depth * normal[k] + friction[k]);
        Some((move_out, Touch { by: By::Nobody, normal, sticks, friction }))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn plate(friction: f64) -> Surface {
        Surface { shape: Shape::Plate, origin: [0.0, 0.0, 1.0], friction }
    }

    #[test]
    fn a_node_is_brought_to_the_surface_and_held_back_within_the_cone() {
        for (friction, stays, slides) in
            [(0.0, 0.0, 0.3), (0.5, 0.25, 0.05), (2.0, 0.3, 0.0), (f64::INFINITY, 0.3, 0.0)]
        {
            let surface = plate(friction);
            // the plate comes down by 0.2 and goes aside by 0.1, the node goes up by 0.3 and aside by 0.4
            let moved = Moved { surface: &surface, from: [0.0; 3], to: [0.1, 0.0, -0.2] };
            let (x, trial) = ([3.0, 2.0, 1.0], [3.4, 2.0, 1.3]);
            let (out, touch) = moved.meet(&x, &trial).unwrap();
            assert!((out[2] + 0.5).abs() < 1e-15, "{out:?}");
            assert!((-out[0] - stays).abs() < 1e-15 && out[1] == 0.0, "{friction}: {out:?}");
            assert_eq!(touch.sticks, slides == 0.0, "{friction}");
            assert!((trial[0] + out[0] - x[0] - 0.1 - slides).abs() < 1e-15, "{friction}: {out:?}");
            // what is held and what is free of a force make all of it
            let f = [5.0, -1.0, 7.0];
            let held = Touch { friction: [0.0; 3], ..touch }.force(&f);
            (0..3).for_each(|k| assert!((held[k] + touch.free(&f)[k] - f[k]).abs() < 1e-12));
        }
    }

    #[test]
    fn a_node_that_leaves_is_let_go() {
        let surface = plate(0.3);
        let moved = Moved { surface: &surface, from: [0.0; 3], to: [0.0, 0.0, 0.2] };
        assert_eq!(moved.meet(&[0.0, 0.0, 1.0], &[0.0, 0.0, 1.19]), None);
    }
}
