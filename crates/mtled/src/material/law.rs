//! A whole material: distortion, volume, relaxation.

use super::neo_hookean::{Gradient, distortional_energy, first_piola};
use super::ogden::Symmetric;
use super::shape::{Shape, With};
use super::{IsochoricLaw, MooneyRivlin, Ogden, Own, Prony, VerondaWestmann, Volumetric, Yeoh, prony};

/// Law of the change of shape, with its constants.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Distortional {
    /// [`super::neo_hookean`].
    NeoHookean {
        /// mu, Pa.
        shear_modulus: f64,
    },
    /// [`super::ogden`].
    Ogden(Ogden),
    /// `super::mooney_rivlin`.
    MooneyRivlin(MooneyRivlin),
    /// `super::yeoh`.
    Yeoh(Yeoh),
    /// `super::veronda_westmann`.
    VerondaWestmann(VerondaWestmann),
    /// Any other law in isochoric invariants.
    Own(Own),
}

impl Distortional {
    /// Initial shear modulus, Pa.
    #[must_use]
    pub fn shear_modulus(&self) -> f64 {
        match self {
            Self::NeoHookean { shear_modulus } => *shear_modulus,
            Self::Ogden(law) => law.shear_modulus(),
            Self::MooneyRivlin(law) => law.shear_modulus(),
            Self::Yeoh(law) => law.shear_modulus(),
            Self::VerondaWestmann(law) => law.shear_modulus(),
            Self::Own(law) => law.shear_modulus,
        }
    }

    /// Whether it is one law, whatever its constants.
    pub(crate) fn is_like(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Own(law), Self::Own(other)) => law.is_like(other),
            _ => std::mem::discriminant(self) == std::mem::discriminant(other),
        }
    }
}

/// All constants of a material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Law {
    /// Change of shape.
    pub distortional: Distortional,
    /// Change of volume.
    pub volumetric: Volumetric,
    /// kappa, Pa.
    pub bulk_modulus: f64,
    /// Relaxation of the change of shape.
    pub prony: Prony,
}

impl Law {
    /// The neo-Hookean law with the quadratic volumetric energy and no relaxation; moduli in Pa.
    #[must_use]
    pub fn neo_hookean(shear_modulus: f64, bulk_modulus: f64) -> Self {
        Self {
            distortional: Distortional::NeoHookean { shear_modulus },
            volumetric: Volumetric::Quadratic,
            bulk_modulus,
            prony: Prony::default(),
        }
    }

    /// Initial, instantaneous shear modulus, Pa.
    #[must_use]
    pub fn shear_modulus(&self) -> f64 {
        self.distortional.shear_modulus()
    }

    /// Instantaneous distortional energy density and first Piola-Kirchhoff stress without pressure, Pa.
    #[must_use]
    pub fn distortion(&self, f: &Gradient<f64>, cof: &Gradient<f64>, j: f64) -> (f64, Gradient<f64>) {
        match &self.distortional {
            Distortional::NeoHookean { shear_modulus: mu } => {
                (distortional_energy(f, j, *mu), first_piola(f, cof, j, *mu, 0.0))
            }
            Distortional::Ogden(law) => law.evaluate(f, cof, j),
            Distortional::MooneyRivlin(law) => With::of(law).distortion::<false>(f, cof, j).summed(cof),
            Distortional::Yeoh(law) => With::of(law).distortion::<false>(f, cof, j).summed(cof),
            Distortional::Own(law) => law.distortion(f, cof, j).summed(cof),
            Distortional::VerondaWestmann(law) => With::of(law).distortion::<false>(f, cof, j).summed(cof),
        }
    }

    /// The same within a time increment: gamma W + J^-2/3 H : C / 2 (see [`prony`]).
    #[must_use]
    pub fn relaxing(
        &self,
        f: &Gradient<f64>,
        cof: &Gradient<f64>,
        j: f64,
        gamma: f64,
        h: &Symmetric,
    ) -> (f64, Gradient<f64>) {
        let (w, p) = self.distortion(f, cof, j);
        let (held, q) = prony::held(f, cof, j, h);
        (gamma * w + held, std::array::from_fn(|i| gamma * p[i] + q[i]))
    }
}
