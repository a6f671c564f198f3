//! Correction of the discretisation error: a coarse cloud's force and targets, brought to what a finer one has.
//!
//! The error of a vector v of a coarse cloud (the force, a target's displacement) depends on how deep the instrument has been, and hardly on the
//! constants of the tissue: both clouds have it. So what was learnt at rest along the scene's path, depth by depth,
//!
//! ```text
//! v' = s R(w) v        s = |v_fine| / |v_coarse|,   R(w): the rotation by |w| about w that takes v_coarse to v_fine the short way
//! ```
//!
//! is applied to whatever the coarse cloud answers (a bridging function between models of two fidelities, multiplicative as the scale factor of Haftka
//! 1991, AIAA J. 29:1361). s and w are linear between two depths, and constant before the first and after the last. On the way back
//! those of the deepest point count, since what was captured to there is what there is in the tissue; nothing was learnt there, and the errors of the
//! cloud stay as they are.

use crate::scene::{Correction, Scene};

use super::Twin;

/// A scale and a rotation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Similarity {
    /// s.
    pub scale: f64,
    /// w: axis times angle, rad.
    pub turn: [f64; 3],
}

impl Similarity {
    /// What leaves a vector as it is.
    pub const NONE: Self = Self { scale: 1.0, turn: [0.0; 3] };

    /// What takes a vector to another one the short way; `None` where one of them has no direction.
    #[must_use]
    pub fn between(from: [f64; 3], to: [f64; 3]) -> Option<Self> {
        let scale = length(to) / length(from);
        let axis = cross(from, to);
        let (sine, cosine) = (length(axis), dot(from, to));
        // along the same line to the last digit there is nothing to turn
        let by = if sine > 0.0 { sine.atan2(cosine) / sine } else { 0.0 };
        (scale.is_finite() && scale > 0.0).then(|| Self { scale, turn: axis.map(|a| by * a) })
    }

    /// s R(w) v (Rodrigues).
    #[must_use]
    pub(crate) fn apply(&self, v: [f64; 3]) -> [f64; 3] {
        let angle = length(self.turn);
        if angle == 0.0 {
            return v.map(|v| self.scale * v);
        }
        let axis = self.turn.map(|w| w / angle);
        let (sine, cosine) = angle.sin_cos();
        let (across, along) = (cross(axis, v), dot(axis, v) * (1.0 - cosine));
        std::array::from_fn(|k| self.scale * (cosine * v[k] + sine * across[k] + along * axis[k]))
    }

    /// Scale and turn as a list has them.
    #[must_use]
    pub fn numbers(&self) -> [f64; Correction::NUMBERS] {
        [self.scale, self.turn[0], self.turn[1], self.turn[2]]
    }

    /// The one at a depth of those that a list has for rising depths.
    fn at(depths: &[f64], list: &[f64], depth: f64) -> Self {
        let after = depths.partition_point(|d| *d < depth);
        let (a, b) = (after.saturating_sub(1), after.min(depths.len() - 1));
        let share = if a == b { 0.0 } else { (depth - depths[a]) / (depths[b] - depths[a]) };
        let number =
            |k: usize| (1.0 - share) * list[Correction::NUMBERS * a + k] + share * list[Correction::NUMBERS * b + k];
        Self { scale: number(0), turn: [number(1), number(2), number(3)] }
    }
}

/// What to say of a model that is corrected.
pub(super) fn told(scene: &Scene) -> String {
    let Some(correction) = scene.correction.as_ref().filter(|c| c.apply) else { return String::new() };
    let left = match correction.left {
        0.0 => String::new(),
        left => format!(", within {:.2} % in a run that it was not learnt from", 100.0 * left),
    };
    format!("; force and targets corrected by what {} have at rest{left}", correction.learnt_from)
}

impl Twin {
    /// The scene's correction, if one is applied.
    #[must_use]
    pub fn correction(&self) -> Option<&Correction> {
        self.fixed.scene.correction.as_ref().filter(|c| c.apply && !c.depths.is_empty())
    }

    /// Depth whose correction counts with the tip at a depth, m: the deepest of a needle in the tissue.
    fn corrected_depth(&self, depth: f64) -> f64 {
        self.deepest().map_or(depth, |deepest| deepest.max(depth))
    }

    /// A force or torque of the cloud with the tip at a depth, as it is answered.
    pub(super) fn corrected(&self, v: [f64; 3], depth: f64) -> [f64; 3] {
        match self.correction() {
            Some(c) => Similarity::at(&c.depths, &c.force, self.corrected_depth(depth)).apply(v),
            None => v,
        }
    }

    /// Corrects the places of the targets, m.
    pub(super) fn correct_targets(&self, places: &mut [[f64; 3]]) {
        let Some(c) = self.correction() else { return };
        let depth = self.corrected_depth(-self.progress.tip[2] * self.path().secant());
        let each = Correction::NUMBERS * c.depths.len();
        for ((place, target), list) in places.iter_mut().zip(&self.fixed.scene.targets).zip(c.targets.chunks(each)) {
            let from = target.position;
            let moved = Similarity::at(&c.depths, list, depth).apply(std::array::from_fn(|k| place[k] - from[k]));
            *place = std::array::from_fn(|k| from[k] + moved[k]);
        }
    }
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|k| a[k] * b[k]).sum()
}

fn length(v: [f64; 3]) -> f64 {
    dot(v, v).sqrt()
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn it_takes_one_vector_to_the_other(from in prop::array::uniform3(-1.0..1.0_f64), to in prop::array::uniform3(-1.0..1.0_f64)) {
            prop_assume!(length(from) > 0.01 && length(to) > 0.01 && dot(from, to) > -0.9 * length(from) * length(to));
            let found = Similarity::between(from, to).unwrap().apply(from);
            prop_assert!((0..3).all(|k| (found[k] - to[k]).abs() < 1e-12), "{found:?} {to:?}");
        }
    }

    #[test]
    fn between_two_depths_it_is_their_mean_and_beyond_them_the_last() {
        let list = [1.0, 0.0, 0.0, 0.0, 1.2, 0.0, 0.0, 0.1];
        let at = |depth| Similarity::at(&[1e-3, 2e-3], &list, depth).numbers();
        assert_eq!(at(0.0), [1.0, 0.0, 0.0, 0.0]);
        assert!((at(1.25e-3)[0] - 1.05).abs() < 1e-12 && (at(1.25e-3)[3] - 0.025).abs() < 1e-12);
        assert_eq!((at(2e-3), at(1.0)), ([1.2, 0.0, 0.0, 0.1], [1.2, 0.0, 0.0, 0.1]));
        assert_eq!(Similarity::at(&[1e-3], &list[..4], 5e-3).numbers(), [1.0, 0.0, 0.0, 0.0]);
    }

    #[test]
    fn what_does_not_move_has_no_direction() {
        assert_eq!(Similarity::between([0.0; 3], [1.0, 0.0, 0.0]), None);
        assert_eq!(Similarity::between([1.0, 0.0, 0.0], [0.0; 3]), None);
        assert_eq!(Similarity::between([2.0, 0.0, 0.0], [3.0, 0.0, 0.0]).unwrap().numbers(), [1.5, 0.0, 0.0, 0.0]);
    }
}
