//! Whether a scene can have hexahedra for background cells, and supports without some of their nodes.

use super::check::Check;
use super::{Cells, Dimension, InstrumentKind, Method, SceneError, Shape};

impl Check<'_> {
    /// Hexahedra: in full three dimensions, of a meshless method, in a mesh that has them or a cylinder or box that a grid is made for.
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
        if scene.dimension().dimension != Dimension::Full {
            return Some("only a model in full three dimensions has hexahedra: use discretisation.dimension = full");
        }
        if matches!(scene.sample.shape, Shape::Mesh(_)) {
            return None;
        }
        if matches!(scene.sample.shape, Shape::Outline(_)) {
            return Some(
                "the cells that fill an outline are tetrahedra: use sample.shape = mesh for the hexahedra of the file",
            );
        }
        if !scene.regions.is_empty() {
            return Some(
                "a grid of hexahedra does not follow regions: use tetrahedra, or a mesh whose volume groups are the regions",
            );
        }
        let instrument = scene.instrument?;
        match instrument.kind {
            InstrumentKind::Plate => None,
            InstrumentKind::Needle(_) => Some(
                "a needle's path has rings and layers of its own, which a grid of hexahedra has not: use tetrahedra, or a mesh",
            ),
            InstrumentKind::Indenter { .. } => {
                let on_axis = instrument.entry.iter().all(|x| x.get() == 0.0);
                let round = matches!(scene.sample.shape, Shape::Cylinder { .. });
                (!round || !on_axis).then_some(
                    "a grid of hexahedra follows the edge of an indenter only on the axis of a cylinder: use tetrahedra, or a mesh",
                )
            }
        }
    }
}
