//! `[[regions]]`: parts of the sample that are of another material.

use super::section::{Scope, Section, choice, section};
use super::values::Values;
use super::{Key, Metres, Range, SceneError};

const LENGTH: Range = Range::above(0.0, 10.0);
const CENTRE: Key = Key::point("regions.centre_m", "m");
const RADIUS: Key = Key::real("regions.radius_m", LENGTH, "m");

section! {
    /// A part of the sample that is of another material; of several that hold a point the first one counts.
    #[derive(Clone, Debug, PartialEq)]
    pub struct Region => {
        /// Name of the region, by which paths, outputs and messages call it.
        name: String = Key::text("regions.name"),
        /// Name of its material, a table [materials.NAME].
        material: String = Key::text("regions.material"),
        /// What it consists of.
        shape: RegionShape,
    }
}

choice! {
    /// Shape and place of a region (`regions.shape`), in the undeformed sample, frame `sample`.
    #[derive(Clone, Debug, PartialEq)]
    pub enum RegionShape = Key::word("regions.shape", RegionShape::WORDS)
        .described("Shape of the region: a layer, sphere, upright cylinder or box, or a volume group of the mesh.")
    => {
        /// All between two depths.
        "layer" => Layer {
            /// Depth below the sample's top at which the layer begins.
            from_depth: Metres = Key::real("regions.from_depth_m", Range::closed(0.0, 10.0), "m").or("0.0"),
            /// Depth below the sample's top at which the layer ends.
            to_depth: Metres = Key::real("regions.to_depth_m", LENGTH, "m"),
        },
        /// A sphere.
        "sphere" => Sphere {
            /// Centre of a sphere, cylinder or box.
            centre: [f64; 3] = CENTRE,
            /// Radius of a sphere or cylinder.
            radius: Metres = RADIUS,
        },
        /// An upright cylinder.
        "cylinder" => Cylinder {
            /// Centre of a sphere, cylinder or box.
            centre: [f64; 3] = CENTRE,
            /// Radius of a sphere or cylinder.
            radius: Metres = RADIUS,
            /// Height of the cylinder, half of it on either side of its centre.
            height: Metres = Key::real("regions.height_m", LENGTH, "m"),
        },
        /// An upright box.
        "box" => Box {
            /// Centre of a sphere, cylinder or box.
            centre: [f64; 3] = CENTRE,
            /// Edges of the box along x, y and z.
            size: [f64; 3] = Key::point("regions.size_m", "m"),
        },
        /// A volume group of the mesh.
        "group" => Group {
            /// Name of the volume group of the mesh.
            group: String = Key::text("regions.group"),
        },
    }
}

impl Section for Vec<Region> {
    fn keys() -> Vec<Key> {
        Region::keys()
    }

    fn read(values: &Values, _: Scope<'_>) -> Result<Self, SceneError> {
        let of = |name: &str| {
            let region = Region::read(values, Scope::Named(name))?;
            let key = format!("regions.{name}.name");
            if region.name == name {
                return Ok(region);
            }
            let reason = "a region's name can't be changed: write it into the scene file".to_owned();
            Err(SceneError::Inconsistent { place: values.place(&key), key, value: region.name, reason })
        };
        values.names("regions").map(of).collect()
    }

    fn write(&self, values: &mut Values, _: Scope<'_>) {
        self.iter().for_each(|region| region.write(values, Scope::Named(&region.name)));
    }
}
