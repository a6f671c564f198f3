//! What `[discretisation]` leaves to the program: spacing of the nodes, supports and sums, by sample, instrument and dimension.
//!
//! ```text
//! far        h = f s t                    t: half of the sample's smallest size, m
//! edge       h_e = R/2, 0.1 h, 0.0304 a   needle of capture radius R, m; plate; indenter of radius a, m; times f where f < 1, a path at least 0.64 times
//! growth     g = f g_1                    h(x) = min(h, h_e + g d): d, distance from the edge or path, m
//! fineness   f = sqrt(accuracy / 0.01)    the error of the force falls with the square of the spacing
//! ```
//!
//! s and g_1 are those of the table in the code.

use super::{AskedGrading, Dimension, InstrumentKind, Integration, Metres, Scene, Shape};

/// Spacing of the nodes of a generated cloud.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grading {
    /// Far from every edge.
    pub spacing: Metres,
    /// At the instrument's contact edge, as a fraction of `spacing`.
    pub edge_refinement: f64,
    /// Growth per metre of distance from an edge.
    pub growth: f64,
    /// Fewest rings of nodes round a needle's path in space; 0: two, and three down to ten radii where a kinematic needle leans.
    pub path_rings: u32,
}

/// Spacing far from edges over half of the sample's smallest size, and growth from the edges; that alone in an outline.
const NONE: [f64; 2] = [0.235, 0.35];
const PLATE: [f64; 2] = [0.235, 0.4];
const INDENTER: [f64; 2] = [0.2235, 0.28];
/// A needle; in a half plane one with friction; in space that, and one that has a membrane to pierce. With a growth of 0.4 and supports of 1.6 round a
/// needle in space a step costs a third, and the force is up to 1.4 % off finite elements where it is 0.8 % with these
/// (`docs/lab/performance.md`).
const NEEDLE: [f64; 2] = [0.274, 0.3];
const FRICTION: [f64; 2] = [0.3, 0.3];
const FRICTION_IN_SPACE: [f64; 2] = [0.353, 0.4];
const MEMBRANE: [f64; 2] = [0.3, 0.5];
/// Spacing at the edge of a plate over that far from it, at that of an indenter over its radius, and on a needle's path over its capture
/// radius.
const EDGE_OF_PLATE: f64 = 0.1;
const EDGE_OF_INDENTER: f64 = 0.0304;
const ON_PATH: f64 = 0.5;
/// Least fineness of a path: in a half plane finer ones are not graded at their entry, where the force would have a saw-tooth.
const FINEST_PATH: f64 = 0.64;
const EDGE_IN_OUTLINE: f64 = 0.3;
/// The accuracy for which these hold (`docs/lab/model_error.md`), and the steepest growth that a scene may ask for.
const STANDARD_ACCURACY: f64 = 0.01;
const STEEPEST: f64 = 0.5;
/// Spacing in a half plane of several regions over that in space; round a kinematic needle, whose path is finer at the boundaries.
const PLANE_REFINEMENT: f64 = 0.5;
const NEEDLE_PLANE_REFINEMENT: f64 = 0.7;
/// Support radius over the mean edge length. Narrow supports are too stiff where the field bends sharply, plain sums too soft: consistent
/// ones leave the first error alone, and take wider supports. Beside an interface, where supports are one-sided, wide ones are too soft
/// (`docs/lab/integration.md`).
const SUPPORT: f64 = 1.8;
const WIDE_SUPPORT: f64 = 2.1;
/// That of a needle with friction in space: with a coarse cloud the two errors cancel in part, and little of its force is across the needle
/// (`docs/lab/friction.md`).
const NARROW_SUPPORT: f64 = 1.6;

impl Scene {
    /// How the nodes are spaced, in the dimension that the scene runs in; `None` where a mesh brings them.
    #[must_use]
    pub fn grading(&self) -> Option<Grading> {
        self.grading_in(self.dimension().dimension)
    }

    /// The same in another dimension.
    #[must_use]
    pub(crate) fn grading_in(&self, dimension: Dimension) -> Option<Grading> {
        let AskedGrading { spacing, edge_refinement, growth, path_rings } = self.discretisation.grading?;
        let [share, steepest] = match self.instrument.as_ref().map(|i| (&i.kind, i.is_frictional())) {
            None => NONE,
            Some(_) if self.sample.shape.mesh().is_some() => NONE,
            Some((InstrumentKind::Plate, _)) => PLATE,
            Some((InstrumentKind::Indenter { .. }, _)) => INDENTER,
            Some((InstrumentKind::Needle(_), true)) if dimension == Dimension::Axisymmetric => FRICTION,
            Some((InstrumentKind::Needle(_), true)) if self.has_membrane() => MEMBRANE,
            Some((InstrumentKind::Needle(_), true)) => FRICTION_IN_SPACE,
            Some((InstrumentKind::Needle(_), _)) => NEEDLE,
        };
        let fineness = self.fineness();
        let by_size = || Metres(three_digits(fineness * share * half_thickness(&self.sample.shape)));
        let spacing = spacing.unwrap_or_else(by_size);
        let edge_refinement = edge_refinement.unwrap_or_else(|| self.at_edge(spacing.get(), dimension));
        Some(Grading {
            spacing,
            edge_refinement,
            growth: growth.unwrap_or((fineness * steepest).min(STEEPEST)),
            path_rings,
        })
    }

    /// Spacing in a half plane over that in space: where there are several regions it is finer, and costs next to nothing.
    #[must_use]
    pub(crate) fn plane_refinement(&self) -> f64 {
        match self.instrument.as_ref().map(|i| (&i.kind, i.is_frictional())) {
            _ if self.regions.is_empty() => 1.0,
            Some((InstrumentKind::Needle(_), false)) => NEEDLE_PLANE_REFINEMENT,
            _ => PLANE_REFINEMENT,
        }
    }

    /// Support radius over the mean edge length at a node, in the dimension that the scene runs in.
    #[must_use]
    pub fn support_factor(&self) -> f64 {
        self.support_factor_in(self.dimension().dimension)
    }

    /// The same in another dimension.
    #[must_use]
    pub fn support_factor_in(&self, dimension: Dimension) -> f64 {
        let given = self.discretisation.support_factor;
        let indenter = matches!(&self.instrument, Some(i) if matches!(i.kind, InstrumentKind::Indenter { .. }));
        let frictional = self.instrument.is_some_and(|i| i.is_frictional());
        if given > 0.0 {
            given
        } else if frictional && self.is_consistent_in(dimension) {
            NARROW_SUPPORT
        } else if self.is_consistent_in(dimension) && self.regions.is_empty() && indenter {
            WIDE_SUPPORT
        } else {
            SUPPORT
        }
    }

    /// Whether gradients are corrected so that a uniform stress is in balance, in a dimension. `auto` leaves it where supports can't be wide:
    /// with narrow ones an indenter's force is further off with consistent sums than with plain ones.
    #[must_use]
    pub fn is_consistent_in(&self, dimension: Dimension) -> bool {
        let wanted = match self.discretisation.integration {
            Integration::Plain => false,
            Integration::Consistent => true,
            Integration::Auto => self.regions.is_empty() && self.sample.shape.mesh().is_none(),
        };
        wanted && dimension != Dimension::Axisymmetric
    }

    /// Tetrahedra that share an integration point, where cells can share one.
    #[must_use]
    pub fn cells_per_point(&self) -> u32 {
        let shared = self.sample.shape.mesh().is_none()
            && match self.instrument.as_ref().map(|i| &i.kind) {
                Some(InstrumentKind::Needle(_)) => true,
                Some(InstrumentKind::Plate) => self.regions.is_empty(),
                Some(InstrumentKind::Indenter { .. }) | None => false,
            };
        match self.discretisation.cells_per_point {
            0 if shared => 2,
            0 => 1,
            given => given,
        }
    }

    /// What its supports lack, after a semicolon; empty where they lack nothing.
    #[must_use]
    pub fn left_out(&self) -> String {
        match self.discretisation.points_per_support_node {
            ..=1 => String::new(),
            fewest => {
                format!("; supports without the nodes that fewer than {fewest} of 8 points beside each other have")
            }
        }
    }

    /// Spacing over that of the standard accuracy.
    fn fineness(&self) -> f64 {
        (self.accuracy / STANDARD_ACCURACY).sqrt()
    }

    /// Tolerated relative error of the force from too few steps.
    #[must_use]
    pub fn tolerance(&self) -> f64 {
        self.stepping.tolerance.unwrap_or(self.accuracy)
    }

    /// Spacing at the edge of the instrument or on its path, over that far from it.
    fn at_edge(&self, spacing: f64, dimension: Dimension) -> f64 {
        let fineness = self.fineness().min(1.0);
        let frictional = self.instrument.is_some_and(|i| i.is_frictional());
        // what the path of another needle is in a half plane of several regions is finer by that
        let finer = if frictional && dimension == Dimension::Axisymmetric { self.plane_refinement() } else { 1.0 };
        match self.instrument.as_ref().map(|i| &i.kind) {
            Some(InstrumentKind::Needle(needle)) => {
                within(fineness.max(FINEST_PATH) * ON_PATH * needle.capture_radius.get() / (finer * spacing))
            }
            _ if self.sample.shape.mesh().is_some() => EDGE_IN_OUTLINE,
            None | Some(InstrumentKind::Plate) => EDGE_OF_PLATE,
            Some(InstrumentKind::Indenter { diameter, .. }) => {
                within(three_digits(fineness * EDGE_OF_INDENTER * 0.5 * diameter.get() / spacing))
            }
        }
    }
}

/// Half of a sample's smallest size, m; infinite for a mesh, whose size its file says.
fn half_thickness(shape: &Shape) -> f64 {
    match shape {
        Shape::Cylinder { diameter, height } => 0.5 * diameter.get().min(height.get()),
        Shape::Box { size_x, size_y, height } => 0.5 * size_x.get().min(size_y.get()).min(height.get()),
        Shape::Mesh(_) | Shape::Outline(_) => f64::INFINITY,
    }
}

/// The range of `discretisation.edge_refinement`.
const fn within(refinement: f64) -> f64 {
    refinement.clamp(0.01, 1.0)
}

/// A number as a person writes it.
fn three_digits(x: f64) -> f64 {
    format!("{x:.2e}").parse().unwrap_or(x)
}
