//! Whether a scene can have hexahedra for background cells and which, and supports without some of their nodes.

use super::check::Check;
use super::{Cells, Dimension, InstrumentKind, Method, Scene, SceneError, Shape};

impl Check<'_> {
    /// Hexahedra: in three dimensions, whole or half, of a meshless method.
    pub(super) fn cells(&self) -> Result<(), SceneError> {
        if self.scene.discretisation.cells == Cells::Tetrahedra {
            return Ok(());
        }
        match self.against_hexahedra() {
            Some(reason) => self.refuse("discretisation.cells", reason.to_owned()),
            None => Ok(()),
        }
    }

    /// Only a support can lack a node.
    pub(super) fn support_nodes(&self) -> Result<(), SceneError> {
        let discretisation = &self.scene.discretisation;
        if discretisation.points_per_support_node == 1 || discretisation.method != Method::Tet4 {
            return Ok(());
        }
        let reason =
            "linear tetrahedra have no supports to leave nodes out of: use 1, or discretisation.method = mmls or mls";
        self.refuse("discretisation.points_per_support_node", reason.to_owned())
    }

    fn against_hexahedra(&self) -> Option<&'static str> {
        let scene = self.scene;
        if scene.discretisation.method == Method::Tet4 {
            return Some("linear tetrahedra have no hexahedra: use discretisation.method = mmls or mls");
        }
        let plane = scene.dimension().dimension == Dimension::Axisymmetric;
        plane.then_some("a half plane has no hexahedra: use discretisation.dimension = full")
    }
}

impl Scene {
    /// Whether the sample is a grid of hexahedra, its outermost ones among them: a whole cylinder or box in one material, with nothing that
    /// the lines of a grid can't follow. Other bodies have hexahedra inside and tetrahedra about them.
    #[must_use]
    pub(crate) fn is_grid(&self) -> bool {
        let round = match self.sample.shape {
            Shape::Cylinder { .. } => true,
            Shape::Box { .. } => false,
            Shape::Mesh(_) | Shape::Outline(_) => return false,
        };
        let follows = self.instrument.as_ref().is_none_or(|instrument| match instrument.kind {
            InstrumentKind::Plate => true,
            InstrumentKind::Needle(_) => false,
            InstrumentKind::Indenter { .. } => round && instrument.entry.iter().all(|x| x.get() == 0.0),
        });
        let whole = self.dimension().dimension == Dimension::Full;
        self.discretisation.cells != Cells::Tetrahedra && whole && follows && self.regions.is_empty()
    }
}
