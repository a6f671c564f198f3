//! Does a scene have symmetry of revolution? Then a meridian half plane models all of it. Or a plane of symmetry? Then the half beside it
//! does.

use mtled::mirror::Mirror;

use super::{Bevel, Dimension, InstrumentKind, Region, RegionShape, Scene, Shape, VolumeRatio};

/// Largest distance of an entry point from a plane of symmetry, m: a thousandth of what a sensor resolves.
const ON_PLANE: f64 = 1e-9;
/// Largest sine of the angle between two directions that are the same but for round-off.
const SAME_WAY: f64 = 1e-9;

/// What `discretisation.dimension` comes to in a scene, and why.
#[derive(Clone, Debug, PartialEq)]
pub struct Resolved {
    /// [`Dimension::Axisymmetric`], [`Dimension::Mirrored`] or [`Dimension::Full`].
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
            let article = if matches!(shape, Shape::Outline(_)) { "an" } else { "a" };
            return Some(format!("{article} {} is not a body of revolution", shape.as_str()));
        }
        if self.instrument.is_some_and(|i| i.entry.iter().any(|e| e.get() != 0.0)) {
            return Some(
                "the instrument is beside the sample's axis (instrument.entry_x_m, instrument.entry_y_m)".to_owned(),
            );
        }
        if self.instrument.is_some_and(|i| i.slope() != [0.0; 2]) {
            return Some("the needle's path is oblique (instrument.tilt_rad)".to_owned());
        }
        if self.bevel().is_some() {
            return Some("a bevel pushes the needle aside (instrument.tip)".to_owned());
        }
        self.regions.iter().find_map(off_axis)
    }

    /// The vertical plane about which sample, regions, instrument and path are symmetric.
    ///
    /// # Errors
    /// Why there is none, in one clause.
    pub(crate) fn plane_of_symmetry(&self) -> Result<Mirror, String> {
        if self.sample.shape.mesh().is_some() {
            return Err("a mesh has no plane of symmetry that is known".to_owned());
        }
        if self.bevel().is_some_and(|bevel| bevel.roll.get().sin().abs() > SAME_WAY) {
            return Err("the bevel pushes the needle out of the plane of its path (instrument.roll_rad)".to_owned());
        }
        let Some(direction) = self.direction() else {
            return Err(
                "the oblique path does not meet the sample's axis (instrument.entry_x_m, instrument.entry_y_m, \
                        instrument.azimuth_rad)"
                    .to_owned(),
            );
        };
        let [x, y] = direction;
        let mirror = match self.sample.shape {
            Shape::Box { .. } if x.abs() > SAME_WAY && y.abs() > SAME_WAY => {
                return Err(
                    "the path lies in no plane of symmetry of the box (instrument.entry_x_m, instrument.entry_y_m, \
                            instrument.azimuth_rad)"
                        .to_owned(),
                );
            }
            // exact where it can be
            _ if y.abs() <= SAME_WAY => Mirror::along([1.0, 0.0]),
            _ if x.abs() <= SAME_WAY => Mirror::along([0.0, 1.0]),
            _ => Mirror::along(direction),
        };
        self.regions.iter().find_map(|region| off_plane(region, &mirror)).map_or(Ok(mirror), Err)
    }

    /// The bevel of the needle's tip, if it has one.
    fn bevel(&self) -> Option<&Bevel> {
        self.instrument.as_ref()?.needle()?.bevel.as_ref()
    }

    /// Horizontal unit vector in the plane that holds the sample's axis and the instrument's path; `None` if no plane does.
    fn direction(&self) -> Option<[f64; 2]> {
        let unit = |v: [f64; 2]| v.map(|x| x / v[0].hypot(v[1]));
        let beside = |region: &Region| match region.shape {
            RegionShape::Sphere { centre: [x, y, _], .. } | RegionShape::Cylinder { centre: [x, y, _], .. } => {
                ((x, y) != (0.0, 0.0)).then_some([x, y])
            }
            _ => None,
        };
        // what stands upright on the axis leaves the choice
        let free = || Some(self.regions.iter().find_map(beside).map_or([1.0, 0.0], unit));
        let Some(instrument) = &self.instrument else { return free() };
        let entry = instrument.entry.map(|e| e.get());
        match &instrument.kind {
            InstrumentKind::Needle(needle) if needle.tilt.get() != 0.0 || needle.bevel.is_some() => {
                let (sin, cos) = needle.azimuth.get().sin_cos();
                ((cos * entry[1] - sin * entry[0]).abs() <= ON_PLANE).then_some([cos, sin])
            }
            _ if entry == [0.0; 2] => free(),
            _ => Some(unit(entry)),
        }
    }

    /// The plane of symmetry of a scene that is modelled by a half.
    #[must_use]
    pub(crate) fn mirror(&self) -> Option<Mirror> {
        (self.dimension().dimension == Dimension::Mirrored).then(|| self.plane_of_symmetry().ok()).flatten()
    }

    /// The dimension that the scene runs in: what it asks for, or the least that it allows.
    #[must_use]
    pub fn dimension(&self) -> Resolved {
        let asked = "discretisation.dimension asks for it".to_owned();
        match self.discretisation.dimension {
            Dimension::Auto => match self.asymmetry() {
                Some(asymmetry) => self.in_space(&asymmetry),
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

    /// Volume ratio that the law sees, in a dimension, never `auto`. Beside a needle's entry tissue is sheared so far that the distortion locks
    /// (`docs/lab/integration.md`); under an indenter's edge, where it is crushed, that same stiffness holds cells open.
    #[must_use]
    pub fn volume_ratio_in(&self, dimension: Dimension) -> VolumeRatio {
        let needle = matches!(self.instrument, Some(i) if matches!(i.kind, InstrumentKind::Needle(_)));
        match self.discretisation.volume_ratio {
            VolumeRatio::Auto if needle && dimension != Dimension::Axisymmetric => VolumeRatio::Mixed,
            VolumeRatio::Auto => VolumeRatio::Projected,
            given => given,
        }
    }

    /// Half of space or all of it, for a scene that has no symmetry of revolution.
    fn in_space(&self, asymmetry: &str) -> Resolved {
        match self.plane_of_symmetry() {
            Ok(mirror) => {
                let [x, y] = mirror.direction();
                let azimuth = y.atan2(x);
                let because = format!("{asymmetry}; the vertical plane at azimuth {azimuth:.4} rad is one of symmetry");
                Resolved { dimension: Dimension::Mirrored, because }
            }
            Err(no_plane) => {
                let because = if no_plane == asymmetry { no_plane } else { format!("{asymmetry}, and {no_plane}") };
                Resolved { dimension: Dimension::Full, because }
            }
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

/// Why a region is not modelled by halves, if it isn't.
fn off_plane(region: &Region, mirror: &Mirror) -> Option<String> {
    let name = &region.name;
    match region.shape {
        RegionShape::Layer { .. } => None,
        RegionShape::Sphere { centre, .. } | RegionShape::Cylinder { centre, .. } => (mirror.across(&centre).abs()
            > ON_PLANE)
            .then(|| format!("region \"{name}\" is beside the plane of the path (regions.{name}.centre_m)")),
        RegionShape::Box { .. } | RegionShape::Group { .. } => {
            Some(format!("region \"{name}\" is a {}, which is modelled whole", region.shape.as_str()))
        }
    }
}
