//! How one node of a needle's path comes to be held.
//!
//! *Along the needle* a node ahead of the tip moves on a linear ramp over the capture window, from its displacement at the
//! window's far end to the one that the rule prescribes; the ramp ends when the tip reaches the node.
//!
//! A needle that goes back and comes again finds the node on the ramp it had. With a ramp of its own for each time a node at the window's end
//! would be drawn to the rule step by step by a needle that only trembles.
//! On an oblique path it is held along the path, and not along z: held along z alone it would take none of the lateral share of the force
//! with which the needle holds it, and the lateral force had a saw-tooth of 3 % at the distance of the layers.
//!
//! *Sideways* tissue ahead of the tip is free: it goes along with a needle that moves sideways or leans as far as the tissue
//! takes it. Between two layers of nodes the tip holds the next layer in part, by a spring to where the needle would have it,
//!
//! ```text
//! k = 2 mu h s / (1 - s)                  per node, N/m; s: share of the way from the last layer to this one
//! ```
//!
//! from nothing at the last layer to a rigid hold at this one. 2 mu h is the node's own stiffness against its layer's
//! motion: slabs of tissue of the thickness h on both sides, each with mu A/h, over A/h^2 nodes. With it the held length grows
//! in proportion to the depth, so the lateral force has no jump and no saw-tooth.

/// An axis within this of where it was has not moved, m: rounding.
const SAME_M: f64 = 1e-9;

/// What one node of the path is doing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Hold {
    /// Free tissue.
    Free,
    /// Held by the tip before the puncture.
    Indented,
    /// In the capture window, or behind the tip.
    Captured(Capture),
    /// Free tissue that the window has been at and has left: it comes back onto its ramp.
    Left(Capture),
}

/// A node in the capture window, or behind the tip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Capture {
    /// Depth of the tip when the window reached the node, m.
    pub since: f64,
    /// Displacement then, m.
    pub from: [f64; 3],
    /// Where the needle's axis was at the node's depth then, m.
    pub axis: [f64; 2],
    /// The needle's axis beside the node's layer when the tip left the layer before, m.
    pub beside: [f64; 2],
    /// s.
    pub passed: f64,
}

impl Capture {
    /// How far the node is held along the needle: a ramp from 0 to 1.
    pub(crate) fn share(&self, depth: f64, window: f64) -> f64 {
        let way = depth - self.since;
        if way >= window { 1.0 } else { (way / window).clamp(0.0, 1.0) }
    }

    /// Whether the needle comes back the way that it came.
    pub(crate) fn is_on(&self, axis: [f64; 2]) -> bool {
        (axis[0] - self.axis[0]).hypot(axis[1] - self.axis[1]) < SAME_M
    }

    /// k, for a shear modulus in Pa and a distance between layers in m; for s below 1.
    pub(crate) fn spring(&self, shear_modulus: f64, layer: f64) -> f64 {
        2.0 * shear_modulus * layer * self.passed / (1.0 - self.passed)
    }
}

/// s of a node at depth z.
pub(super) fn passed(depth: f64, z: f64, layer: f64) -> f64 {
    // most nodes are long behind the tip; one that is at a layer but for round-off has passed it
    if depth >= z {
        return 1.0;
    }
    (1.0 + 1e-9 + (depth - z) / layer).clamp(0.0, 1.0)
}

/// How far the needle carries a layer that its tip comes to sideways off the path, m: the layer's own shift, as far as the tissue
/// held `behind` the tip has carried it. A needle that has never left its path so stays on it.
pub(super) fn carried(shift: [f64; 2], behind: [f64; 2]) -> [f64; 2] {
    let square = behind[0] * behind[0] + behind[1] * behind[1];
    if square <= 0.0 {
        return [0.0; 2];
    }
    let share = ((shift[0] * behind[0] + shift[1] * behind[1]) / square).clamp(0.0, 1.0);
    behind.map(|x| share * x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hold_grows_from_layer_to_layer() {
        let at = |depth: f64| {
            let capture = Capture {
                since: 0.0,
                from: [0.0; 3],
                axis: [0.0; 2],
                beside: [0.0; 2],
                passed: passed(depth, 2e-3, 1e-3),
            };
            capture.spring(500.0, 1e-3)
        };
        assert!(at(1e-3) < 1e-6 && (at(1.5e-3) - 1.0).abs() < 1e-6, "{} {}", at(1e-3), at(1.5e-3));
        assert!(at(1.999e-3) > 900.0);
        assert!(passed(2e-3 - 1e-17, 2e-3, 1e-3) >= 1.0 && passed(0.9e-3, 2e-3, 1e-3) <= 0.0);
    }

    #[test]
    fn a_layer_is_carried_no_further_than_what_carries_it() {
        assert_eq!(carried([3e-6, -2e-6], [0.0; 2]), [0.0; 2], "on its path the needle leaves nothing aside");
        assert_eq!(carried([3e-4, 0.0], [4e-4, 0.0]), [3e-4, 0.0]);
        assert_eq!(carried([5e-4, 1e-5], [4e-4, 0.0]), [4e-4, 0.0]);
        assert_eq!(carried([-1e-4, 0.0], [4e-4, 0.0]), [0.0, 0.0]);
    }
}
