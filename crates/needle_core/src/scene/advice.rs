//! Warnings about scenes that are allowed but unlikely to give what they ask for; printed when a scene is checked or built.

use super::{
    ContactLaw, DeformationRule, Dimension, IndenterTip, Instrument, InstrumentKind, Material, Motion, Scene,
    VolumeRatio, Word as _,
};

/// Distance by which captured tissue can be pushed ahead of the tip before cells invert there, m: runs ended at 1.6 to 2.1 mm,
/// whatever the capture radius (`docs/lab/stability.md`).
const FURTHEST_PUSH: f64 = 1.5e-3;
/// Depth over the sample's height from which cells at a fine edge in three dimensions may stay folded on the way back where tissue may
/// pass the indenter's wall: 10 of 17 mm with 7962 nodes, 13 with 2649 (`docs/lab/stability.md`).
const FOLDING: f64 = 0.55;
/// Depth over the sample's height that every `volume_ratio` reaches; the shallowest run without the projected one ended
/// at 0.29 (`docs/lab/stability.md`).
const ANY_VOLUME_RATIO: f64 = 0.28;
/// Deformation coefficient up to which a kinematic needle goes in and out, in a half plane and in space: what is captured goes with the needle
/// and crushes what lies before it (`docs/stability.md`).
const MOST_TAKEN_ALONG: [f64; 2] = [0.75, 0.6];
/// Speed over that of a shear wave from which inertia, (v / c)^2 of the stress, is a per cent of the force.
const QUASI_STATIC: f64 = 0.1;
/// Compression of the base under the sample's own weight, rho g H / E, above which the scanned shape can't be taken for the unloaded one.
const OWN_WEIGHT: f64 = 0.1;
/// Acceleration of gravity, m/s^2.
const GRAVITY: f64 = 9.81;

impl Scene {
    /// Advice, one sentence each.
    #[must_use]
    pub fn advice(&self) -> Vec<String> {
        let mut advice: Vec<String> = self.own_weight().into_iter().collect();
        let (Some(instrument), Some(motion)) = (&self.instrument, &self.motion) else { return advice };
        advice.extend(self.inertia(motion.speed.get()));
        advice.extend(self.contact(instrument, motion));
        advice.extend(self.meets_rigid(motion.depth.get()));
        advice
    }

    /// The prediction is quasi-static, which holds for motions that are slow compared with shear waves, c = sqrt(mu / rho).
    fn inertia(&self, speed: f64) -> Option<String> {
        let wave = (self.material.shear_modulus() / self.material.density.get()).sqrt();
        (speed > QUASI_STATIC * wave).then(|| {
            format!(
                "motion.speed_m_per_s = {speed} is more than {QUASI_STATIC} of the tissue's shear wave speed of {wave:.3} m/s \
                 (from material.shear_modulus_pa and material.density_kg_per_m3): its inertia, which the prediction leaves out, \
                 is more than a per cent of the force"
            )
        })
    }

    /// The reference configuration is taken to be free of stress.
    fn own_weight(&self) -> Option<String> {
        let Material { poisson_ratio, density, .. } = self.material;
        let young = 2.0 * self.material.shear_modulus() * (1.0 + poisson_ratio.get());
        let strain = density.get() * GRAVITY * self.sample.shape.height()?.get() / young;
        (strain > OWN_WEIGHT).then(|| {
            format!(
                "the sample's own weight compresses its base by {:.0} % (density g height / E): the scanned shape is no unloaded one, \
                 and the twin takes it for one",
                100.0 * strain
            )
        })
    }

    fn contact(&self, instrument: &Instrument, motion: &Motion) -> Vec<String> {
        let depth = motion.depth.get();
        match &instrument.kind {
            InstrumentKind::Needle(needle) if needle.deformation_rule == DeformationRule::Absolute => {
                pushed_ahead(needle.deformation_coefficient * depth)
            }
            InstrumentKind::Needle(needle) if !instrument.is_frictional() => {
                let in_plane = self.dimension().dimension == Dimension::Axisymmetric;
                taken_along(needle.deformation_coefficient, MOST_TAKEN_ALONG[usize::from(!in_plane)])
                    .into_iter()
                    .collect()
            }
            InstrumentKind::Needle(_) => Vec::new(),
            InstrumentKind::Plate | InstrumentKind::Indenter { .. } => {
                let height = self.sample.shape.height().map_or(f64::INFINITY, |h| h.get());
                let mut advice = crushed(self.discretisation.volume_ratio, depth / height);
                if motion.retract && depth / height > FOLDING {
                    advice.extend(self.folding(instrument));
                }
                advice
            }
        }
    }
}

impl Scene {
    fn folding(&self, instrument: &Instrument) -> Option<String> {
        let InstrumentKind::Indenter { tip: IndenterTip::Flat, wall_contact: false, .. } = instrument.kind else {
            return None;
        };
        let through_the_wall = instrument.contact == ContactLaw::Bonded;
        (through_the_wall && self.dimension().dimension != Dimension::Axisymmetric).then(|| {
            "cells at the edge of contact may fold at that depth and stay so on the way back, displaced by up to 0.8 mm, since tissue \
             passes the indenter's wall: instrument.wall_contact = true keeps it outside"
                .to_owned()
        })
    }
}

fn taken_along(coefficient: f64, most: f64) -> Option<String> {
    (coefficient > most).then(|| {
        format!(
            "instrument.deformation_coefficient = {coefficient} crushes the tissue before the tip: above {most} such runs lose their \
             balance or their solution. Tissue that sticks so much is what instrument.interaction = \"frictional\" is for"
        )
    })
}

fn pushed_ahead(push: f64) -> Vec<String> {
    if push <= FURTHEST_PUSH {
        return Vec::new();
    }
    vec![format!(
        "instrument.deformation_rule = \"absolute\" pushes the tissue at the tip {:.1} mm ahead (instrument.deformation_coefficient \
         times motion.depth_m); past {:.1} mm cells turn inside out there and the run ends: take \"incremental\"",
        1e3 * push,
        1e3 * FURTHEST_PUSH
    )]
}

fn crushed(ratio: VolumeRatio, depth: f64) -> Vec<String> {
    if !matches!(ratio, VolumeRatio::Averaged | VolumeRatio::Pointwise) || depth <= ANY_VOLUME_RATIO {
        return Vec::new();
    }
    vec![format!(
        "discretisation.volume_ratio = \"{}\" lets cells at the edge of contact turn inside out: such runs ended at 0.29 to 0.7 of \
         the sample's height; this one is to reach {depth:.2} (motion.depth_m): \"projected\" goes on",
        ratio.as_str()
    )]
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use crate::scene::{Override, PRESETS, Scene};

    fn advice(preset: &str, keys: &[(&str, &str)]) -> String {
        let keys: Vec<_> = keys.iter().map(|(path, value)| Override::text(path, value, "test")).collect();
        Scene::preset(preset).unwrap().with(&keys).unwrap().advice().join("; ")
    }

    #[test]
    fn is_given_where_runs_are_known_to_end() {
        for preset in PRESETS {
            assert!(preset.scene().unwrap().advice().is_empty(), "{:?}", preset.scene().unwrap().advice());
        }
        if cfg!(feature = "research") {
            let absolute = ("instrument.deformation_rule", "absolute");
            assert!(advice("needle_insertion", &[absolute]).contains("take \"incremental\""));
            assert_eq!(advice("needle_insertion", &[absolute, ("motion.depth_m", "0.003")]), "");
        }
        let pointwise = ("discretisation.volume_ratio", "pointwise");
        assert!(advice("indentation", &[pointwise]).contains("\"projected\" goes on"));
        assert_eq!(advice("indentation", &[pointwise, ("motion.depth_m", "0.004")]), "");
        let back =
            [("motion.retract", "true"), ("discretisation.dimension", "full"), ("instrument.wall_contact", "false")];
        assert!(advice("indentation", &back).contains("instrument.wall_contact = true"));
        assert_eq!(advice("indentation", &[back[0], back[2]]), "");
        assert_eq!(advice("indentation", &back[..2]), "");
        let along = |value| ("instrument.deformation_coefficient", value);
        assert!(advice("needle_insertion", &[along("0.8")]).contains("crushes the tissue before the tip: above 0.75"));
        assert_eq!(advice("needle_insertion", &[along("0.7")]), "");
        let in_space = ("discretisation.dimension", "mirrored");
        assert!(advice("needle_insertion", &[along("0.7"), in_space]).contains("above 0.6"));
        assert!(advice("indentation", &[("motion.speed_m_per_s", "0.2")]).contains("shear wave speed of 1.315 m/s"));
        assert!(advice("indentation", &[("material.shear_modulus_pa", "300")]).contains("compresses its base by 18 %"));
    }
}
