//! Does a scene have symmetry of revolution? Then a meridian half plane models all of it.

use super::{Dimension, Region, RegionShape, Scene, Shape};

/// What `discretisation.dimension` comes to in a scene, and why.
#[derive(Clone, Debug, PartialEq)]
pub struct Resolved {
    /// [`Dimension::Axisymmetric`] or [`Dimension::Full`].
    pub dimension: Dimension,
    /// Why, in one clause.
    pub because: String,
}

impl Scene {
    /// What breaks the symmetry of revolution, if anything.
    #[must_use]
    pub fn asymmetry(&self) -> Option<String> {
        let shape = &self.sample.shape;
        if !matches!(shape, Shape::Cylinder { .. }) {
            return Some(format!("a {} is not a body of revolution", shape.as_str()));
        }
        if self.instrument.is_some_and(|i| i.entry.iter().any(|e| e.get() != 0.0)) {
            return Some(
                "the instrument is beside the sample's axis (instrument.entry_x_m, instrument.entry_y_m)".to_owned(),
            );
        }
        if self.instrument.is_some_and(|i| i.slope() != [0.0; 2]) {
            return Some("the needle's path is oblique (instrument.tilt_rad)".to_owned());
        }
        self.regions.iter().find_map(off_axis)
    }

    /// The dimension that the scene runs in: what it asks for, or the least that it allows.
    #[must_use]
    pub fn dimension(&self) -> Resolved {
        let asked = "discretisation.dimension asks for it".to_owned();
        match self.discretisation.dimension {
            Dimension::Auto => match self.asymmetry() {
                Some(because) => Resolved { dimension: Dimension::Full, because },
                None => Resolved {
                    dimension: Dimension::Axisymmetric,
                    because: match self.regions.is_empty() {
                        true => "sample, instrument and path have one axis".to_owned(),
                        false => "sample, regions, instrument and path have one axis".to_owned(),
                    },
                },
            },
            dimension => Resolved { dimension, because: asked },
        }
    }
}

/// Why a region has no symmetry about the sample's axis, if it has none.
fn off_axis(region: &Region) -> Option<String> {
    let name = &region.name;
    match region.shape {
        RegionShape::Sphere { centre: [x, y, _], .. } | RegionShape::Cylinder { centre: [x, y, _], .. } => ((x, y)
            != (0.0, 0.0))
            .then(|| format!("region \"{name}\" is beside the sample's axis (regions.{name}.centre_m)")),
        RegionShape::Box { .. } | RegionShape::Group { .. } => {
            Some(format!("region \"{name}\" is a {}, no body of revolution", region.shape.as_str()))
        }
        RegionShape::Layer { .. } => None,
    }
}
