//! Where regions lie in a sample that has no mesh: warnings about those that are not there, and about an instrument that would meet what is rigid.

use mtled::cloud::{Axis, Solid};

use super::check::is_inside;
use super::{InstrumentKind, Metres, Region, RegionShape, Scene, Shape};

/// Places along each edge of a region's box that are looked at.
const LOOKS: u32 = 21;
/// Places along the instrument's path that are looked at.
const STEPS: u32 = 4000;

impl RegionShape {
    /// The shape of a region in a sample whose top is at this height, m; `None` for a group of a mesh.
    #[must_use]
    pub(crate) fn solid(&self, top: f64) -> Option<Solid> {
        match *self {
            Self::Layer { from_depth, to_depth } => {
                Some(Solid::Layer { bottom: top - to_depth.get(), top: top - from_depth.get() })
            }
            Self::Sphere { centre, radius } => Some(Solid::Sphere { centre, radius: radius.get() }),
            Self::Cylinder { centre, radius, height } => {
                Some(Solid::Cylinder { centre, radius: radius.get(), height: height.get() })
            }
            Self::Box { centre, size } => Some(Solid::Box { centre, size }),
            Self::Group { .. } => None,
        }
    }
}

impl Scene {
    /// What of the regions is not in the sample, one sentence each. Nothing of a mesh, which is not read here.
    #[must_use]
    pub fn absent_regions(&self) -> Vec<String> {
        let Some((height, half)) = self.extents() else { return Vec::new() };
        let solids: Vec<Option<Solid>> = self.regions.iter().map(|r| r.shape.solid(height)).collect();
        let holds = |i: usize, p: [f64; 3]| solids[i].is_some_and(|solid| solid.signed(p) <= 0.0);
        let mut said = Vec::new();
        for (i, region) in self.regions.iter().enumerate() {
            let Some(solid) = &solids[i] else { continue };
            let mut inside = places(solid, height, half).filter(|p| is_inside(&self.sample.shape, *p) && holds(i, *p));
            let mut first = inside.next();
            if first.is_none() {
                said.push(format!(
                    "region \"{0}\" lies outside of the sample: nothing of it is modelled. Its centre is in frame sample, whose origin is the middle \
                     of the base: regions.{0}.centre_m moves it",
                    region.name
                ));
                continue;
            }
            while first.is_some_and(|p| (0..i).any(|before| holds(before, p))) {
                first = inside.next();
            }
            if first.is_none() {
                said.push(format!(
                    "region \"{}\" lies within regions before it, of which the first counts: write it before them",
                    region.name
                ));
            }
        }
        said
    }

    /// The rigid region that the instrument would meet on its path, and the depth along that, m, where there is one.
    pub(super) fn meets_rigid(&self, depth: f64) -> Option<String> {
        let (height, _) = self.extents()?;
        let instrument = self.instrument.as_ref()?;
        let axis = Axis { entry: instrument.entry.map(Metres::get), slope: instrument.slope() };
        let rigid = |region: &&Region| self.materials.iter().any(|m| m.rigid && m.name == region.material);
        if !self.regions.iter().any(|region| rigid(&region)) {
            return None;
        }
        let at = |along: f64| {
            let below = along / axis.secant();
            let [x, y] = axis.at(below);
            let holds = |r: &&Region| r.shape.solid(height).is_some_and(|s| s.signed([x, y, height - below]) <= 0.0);
            self.regions.iter().find(holds).filter(rigid)
        };
        let begins = (0..=STEPS).map(|k| depth * f64::from(k) / f64::from(STEPS)).find(|along| at(*along).is_some())?;
        let needle = matches!(instrument.kind, InstrumentKind::Needle(_));
        at(begins).map(|region| Self::said_of_rigid(&region.name, begins, depth, needle))
    }

    /// What to say of a motion to a depth, where a rigid region begins before that.
    pub(crate) fn said_of_rigid(region: &str, begins: f64, depth: f64, needle: bool) -> String {
        let what = if needle { "poses beyond are refused" } else { "the tissue before it can't be pressed to nothing" };
        format!(
            "motion.depth_m = {depth} goes {:.2} mm into region \"{region}\", which is rigid and begins at {:.2} mm on the instrument's path: {what}; \
             give a depth above that, or another entry",
            1e3 * (depth - begins),
            1e3 * begins
        )
    }

    /// Height, and half of the size across, m; `None` of a mesh.
    fn extents(&self) -> Option<(f64, [f64; 2])> {
        match &self.sample.shape {
            Shape::Cylinder { diameter, height } => Some((height.get(), [0.5 * diameter.get(); 2])),
            Shape::Box { size_x, size_y, height } => {
                Some((height.get(), [*size_x, *size_y].map(|size| 0.5 * size.get())))
            }
            Shape::Mesh(_) | Shape::Outline(_) => None,
        }
    }
}

/// Places all over the part of a solid's box that lies in the box of the sample; none on its boundary.
fn places(solid: &Solid, height: f64, half: [f64; 2]) -> impl Iterator<Item = [f64; 3]> {
    let [low, high] = solid.bounds();
    let from = [low[0].max(-half[0]), low[1].max(-half[1]), low[2].max(0.0)];
    let to = [high[0].min(half[0]), high[1].min(half[1]), high[2].min(height)];
    let empty = (0..3).any(|k| from[k] >= to[k]);
    let count = if empty { 0 } else { LOOKS.pow(3) };
    (0..count).map(move |i| {
        let share = [i % LOOKS, i / LOOKS % LOOKS, i / LOOKS / LOOKS].map(|n| (f64::from(n) + 0.5) / f64::from(LOOKS));
        std::array::from_fn(|k| from[k] + share[k] * (to[k] - from[k]))
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::scene::PRESETS;

    /// The layered preset (40 by 20 mm) with its regions replaced.
    fn with(regions: &str) -> Scene {
        let text = Scene::preset("layered_tissue").unwrap().to_toml();
        let (before, after) = text.split_once("[[regions]]").unwrap();
        let after = &after[after.find("\n[instrument]").unwrap()..];
        let bone = "[materials.bone]\nrigid = true\n\n";
        Scene::from_toml(&format!("{before}{bone}{regions}{after}"), "regions.toml").unwrap()
    }

    fn region(name: &str, material: &str, shape: &str) -> String {
        format!("[[regions]]\nname = \"{name}\"\nmaterial = \"{material}\"\n{shape}\n")
    }

    #[test]
    fn regions_that_are_not_there_are_named_and_others_are_not() {
        for preset in PRESETS {
            assert_eq!(preset.scene().unwrap().absent_regions(), Vec::<String>::new());
        }
        let sphere = |x: f64, z: f64| format!("shape = \"sphere\"\ncentre_m = [{x}, 0, {z}]\nradius_m = 0.002");
        let layer = |from: f64, to: f64| format!("shape = \"layer\"\nfrom_depth_m = {from}\nto_depth_m = {to}");
        for (shape, there) in [
            (sphere(0.0, 0.01), true),
            (sphere(0.021, 0.01), true),
            (sphere(0.023, 0.01), false),
            (sphere(0.0, 0.03), false),
            (sphere(0.0, -0.01), false),
            (layer(0.019, 0.03), true),
        ] {
            let said = with(&region("odd", "fat", &shape)).absent_regions();
            assert_eq!(said.is_empty(), there, "{shape}: {said:?}");
            assert!(there || said[0].contains("\"odd\" lies outside") && said[0].contains("regions.odd."), "{said:?}");
        }
        let hidden = with(&(region("all", "fat", &layer(0.0, 0.02)) + &region("odd", "muscle", &sphere(0.0, 0.01))));
        let said = hidden.absent_regions();
        assert!(said.len() == 1 && said[0].contains("\"odd\"") && said[0].contains("before them"), "{said:?}");
    }

    #[test]
    fn a_motion_into_bone_is_said_with_where_it_begins() {
        let layer = |from: f64| format!("shape = \"layer\"\nfrom_depth_m = {from}\nto_depth_m = 0.02");
        let said = |from: f64| with(&region("skull", "bone", &layer(from))).advice().join("; ");
        assert!(!said(0.009).contains("skull"), "the motion ends at 8 mm: {}", said(0.009));
        let into = said(0.006);
        assert!(
            into.contains("2.00 mm into region \"skull\"")
                && into.contains("begins at 6.00 mm")
                && into.contains("motion.depth_m"),
            "{into}"
        );
    }
}
