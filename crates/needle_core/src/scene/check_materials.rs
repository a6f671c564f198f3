//! Consistency of materials and regions.

use super::check::{Check, LARGEST_POISSON_RATIO};
use super::values::listed;
use super::{Material, MaterialModel, Region, RegionShape, SceneError};

/// Smallest size of an Ogden exponent: below it, differences of the powers are lost in round-off.
const LEAST_EXPONENT: f64 = 0.01;
/// Largest sum of the Prony shares.
const MOST_RELAXING: f64 = 0.999;
/// Thinnest layer over the height of the sample: the cloud follows both of its faces, and its nodes grow with the inverse.
const THINNEST: f64 = 1.0 / 400.0;
/// Most materials of a scene.
const MOST_MATERIALS: usize = 60;

impl Check<'_> {
    pub(super) fn materials(&self) -> Result<(), SceneError> {
        self.material("material", &self.scene.material)?;
        if self.scene.materials.len() > MOST_MATERIALS {
            let reason = format!("{} materials; at most {MOST_MATERIALS} are taken", self.scene.materials.len());
            return self.refuse("materials", reason);
        }
        let mut named = self.scene.materials.iter();
        named.try_for_each(|m| self.material(&format!("materials.{}", m.name), &m.material))
    }

    fn material(&self, section: &str, material: &Material) -> Result<(), SceneError> {
        if material.poisson_ratio.get() > LARGEST_POISSON_RATIO {
            return self.refuse(
                &format!("{section}.poisson_ratio"),
                format!(
                    "the law's accuracy was shown in (-1, {LARGEST_POISSON_RATIO}]; beyond, the pressure drowns in round-off, while the \
                     force at {LARGEST_POISSON_RATIO} is within some 0.2 % of that of an incompressible tissue"
                ),
            );
        }
        self.model(section, &material.model)?;
        let relaxing = 1.0 - material.prony.long_term_share();
        if relaxing > MOST_RELAXING {
            return self.refuse(
                &format!("{section}.prony_shares"),
                format!("their sum is {relaxing}; at most {MOST_RELAXING}, or the material flows like a liquid"),
            );
        }
        Ok(())
    }

    fn model(&self, section: &str, model: &MaterialModel) -> Result<(), SceneError> {
        match model {
            MaterialModel::Ogden(ogden) => {
                let key = format!("{section}.ogden_exponents");
                if ogden.terms().is_empty() {
                    return self.refuse(&key, "Ogden's law needs at least one term".to_owned());
                }
                if ogden.terms().iter().any(|t| t.exponent.abs() < LEAST_EXPONENT) {
                    return self.refuse(
                        &key,
                        format!("an exponent of 0 makes a term 0/0; at least {LEAST_EXPONENT} in size is needed"),
                    );
                }
                Ok(())
            }
            MaterialModel::Yeoh { c10, c20, c30 } => {
                let law = mtled::material::Yeoh { c10: c10.get(), c20: c20.get(), c30: c30.get() };
                if law.is_stable() {
                    return Ok(());
                }
                self.refuse(
                    &format!("{section}.c20_pa"),
                    "with these constants the stress falls as the strain grows: C20 >= 0, or C20^2 < 3 C10 C30, keeps \
                     C10 + 2 C20 x + 3 C30 x^2 above 0"
                        .to_owned(),
                )
            }
            _ => Ok(()),
        }
    }

    pub(super) fn regions(&self) -> Result<(), SceneError> {
        self.scene.regions.iter().try_for_each(|region| self.region(region))?;
        self.layers()
    }

    /// Layers, and what they leave of the sample between them, are thick enough for a cloud.
    fn layers(&self) -> Result<(), SceneError> {
        let Some(height) = self.scene.sample.shape.height().map(|h| h.get()) else { return Ok(()) };
        let layers: Vec<(&str, [f64; 2])> = self.scene.regions.iter().filter_map(layer).collect();
        let ends = layers.iter().flat_map(|(_, ends)| *ends).filter(|end| *end < height);
        let mut depths: Vec<f64> = ends.chain([0.0, height]).collect();
        depths.sort_by(f64::total_cmp);
        depths.dedup();
        let owner = |depth: f64| layers.iter().position(|(_, [from, to])| (*from..*to).contains(&depth));
        let mut begun = 0.0;
        for (i, to) in depths.iter().enumerate().skip(1) {
            let of = owner(depths[i - 1]);
            if depths.get(i + 1).is_some_and(|_| owner(*to) == of) {
                continue; // no interface
            }
            if to - begun < THINNEST * height {
                // what is left of the sample is so thin because of a layer that ends beside it
                let beside = || layers.iter().position(|(_, ends)| ends.contains(&begun) || ends.contains(to));
                let Some((name, _)) = of.or_else(beside).and_then(|of| layers.get(of)) else { return Ok(()) };
                let reason = format!(
                    "the tissue between the depths {begun} and {to} m would be {:.3e} m thick; at least {:.3e} m ({THINNEST} of the \
                     sample's height) is needed, since the cloud follows both faces of a layer",
                    to - begun,
                    THINNEST * height
                );
                return self.refuse(&format!("regions.{name}.to_depth_m"), reason);
            }
            begun = *to;
        }
        Ok(())
    }

    fn region(&self, region: &Region) -> Result<(), SceneError> {
        let key = |field: &str| format!("regions.{}.{field}", region.name);
        let names = || self.scene.materials.iter().map(|m| m.name.as_str());
        if names().all(|name| name != region.material) {
            return self
                .refuse(&key("material"), format!("no such material; the scene has {}", listed("materials", names())));
        }
        match &region.shape {
            RegionShape::Layer { from_depth, to_depth } => {
                if from_depth.get() >= to_depth.get() {
                    let reason = format!("must be more than from_depth_m = {}", from_depth.get());
                    return self.refuse(&key("to_depth_m"), reason);
                }
                match self.scene.sample.shape.height() {
                    Some(height) if from_depth.get() >= height.get() => self.refuse(
                        &key("from_depth_m"),
                        format!("the layer lies below the sample: sample.height_m = {}", height.get()),
                    ),
                    _ => Ok(()),
                }
            }
            RegionShape::Box { size, .. } if size.iter().any(|s| *s <= 0.0) => {
                self.refuse(&key("size_m"), "three lengths above 0 are needed".to_owned())
            }
            RegionShape::Group { .. } if self.scene.sample.shape.mesh().is_none() => self.refuse(
                &key("shape"),
                "a volume group is a part of a mesh, and sample.shape is not \"mesh\" or \"outline\"; use layer, sphere, cylinder or box"
                    .to_owned(),
            ),
            _ => Ok(()),
        }
    }
}

/// Name and depths of a layer.
fn layer(region: &Region) -> Option<(&str, [f64; 2])> {
    match &region.shape {
        RegionShape::Layer { from_depth, to_depth } => Some((&region.name, [from_depth.get(), to_depth.get()])),
        _ => None,
    }
}
