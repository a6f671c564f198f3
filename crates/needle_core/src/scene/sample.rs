//! `[sample]`: the tissue sample's geometry.

use super::instrument::FRICTION;
use super::section::{choice, section};
use super::{Key, Metres, Range};

const LENGTH: Range = Range::above(0.0, 10.0);
const HEIGHT: Key = Key::real("sample.height_m", LENGTH, "m");

section! {
    /// The sample's geometry. Frame `sample`: origin at the centre of the bottom face, z up; a mesh brings its own origin.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Sample => {
        /// Shape and size.
        shape: Shape,
        /// What holds the base.
        base: Base,
    }
}

choice! {
    /// Shape and size of the sample (`sample.shape`).
    #[derive(Clone, Debug, PartialEq)]
    pub enum Shape = Key::word("sample.shape", Shape::WORDS)
        .described("Shape of the sample: upright on its base, a mesh from a file, or what a mesh outlines with nodes of the twin's own.")
        .or("cylinder")
    => {
        /// Upright cylinder.
        "cylinder" => Cylinder {
            /// Height; the top face is at z = height.
            height: Metres = HEIGHT,
            /// Diameter of the cylinder.
            diameter: Metres = Key::real("sample.diameter_m", LENGTH, "m"),
        },
        /// Upright box, centred on the z axis.
        "box" => Box {
            /// Height; the top face is at z = height.
            height: Metres = HEIGHT,
            /// Edge of the box along x.
            size_x: Metres = Key::real("sample.size_x_m", LENGTH, "m"),
            /// Edge of the box along y.
            size_y: Metres = Key::real("sample.size_y_m", LENGTH, "m"),
        },
        /// A tetrahedral mesh from a file, in the file's own frame, z up.
        "mesh" => Mesh(mesh: MeshFile),
        /// What such a mesh encloses, filled with nodes of the twin's own.
        "outline" => Outline(mesh: MeshFile),
    }
}

choice! {
    /// How the sample stands on its base (`sample.base`).
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub enum Base = Key::word("sample.base", Base::WORDS)
        .described("How the sample stands on the table: it sticks to it, slides freely, or sticks up to Coulomb's limit.")
        .or("bonded")
    => {
        /// The base is held.
        "bonded" => Bonded,
        /// The table pushes, and nothing holds the base sideways.
        "frictionless" => Frictionless,
        /// Friction up to a share of the pressure.
        "coulomb" => Coulomb {
            /// mu: largest friction over pressure between tissue and table.
            base_friction_coefficient: f64 = Key::real("sample.base_friction_coefficient", FRICTION, ""),
        },
    }
}

section! {
    /// A mesh file and what its parts stand for.
    #[derive(Clone, Debug, PartialEq)]
    pub struct MeshFile => {
        /// Mesh of tetrahedra, Gmsh .msh 4.1 or 2.2 or VTU, z up, or for an outline a closed surface as STL; its path, from the scene file's folder (with --set:
        /// from here).
        path: String = Key::text("sample.mesh"),
        /// Metres per unit of the mesh file: 0.001 for mm.
        unit_m: f64 = Key::real("sample.mesh_unit_m", Range::above(0.0, 1e3), "m").or("1.0"),
        /// Group of the mesh's surface that is held.
        base_group: String = Key::text("sample.base_group").or("base"),
        /// Group of the mesh's surface that the instrument may touch.
        contact_group: String = Key::text("sample.contact_group").or("contact"),
    }
}

impl Shape {
    /// The mesh that gives the shape, if one does.
    #[must_use]
    pub(crate) const fn mesh(&self) -> Option<&MeshFile> {
        match self {
            Self::Mesh(mesh) | Self::Outline(mesh) => Some(mesh),
            Self::Cylinder { .. } | Self::Box { .. } => None,
        }
    }

    /// Height of a cylinder or box; a mesh has to be read for it.
    #[must_use]
    pub const fn height(&self) -> Option<Metres> {
        match self {
            Self::Cylinder { height, .. } | Self::Box { height, .. } => Some(*height),
            Self::Mesh(_) | Self::Outline(_) => None,
        }
    }
}
