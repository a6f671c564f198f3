//! `[material]`: the constitutive law of the sample and its constants.

use mtled::material::{Distortional, Law, Ogden, Prony, Volumetric, ogden, prony};

use super::section::{Scope, Section, choice, read_terms, section, write};
use super::values::Values;
use super::{Key, KilogramsPerCubicMetre, Pascals, PoissonRatio, Range, SceneError, Word};

section! {
    /// Constitutive law with its constants.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Material => {
        /// The law of the change of shape.
        model: MaterialModel,
        /// Energy of a change of volume: quadratic, or logarithmic, which grows without bound as the volume goes to 0.
        volumetric: Volumetric = Key::word("material.volumetric", Volumetric::WORDS).or("quadratic"),
        /// Relaxation of the change of shape; no terms: elastic.
        prony: Prony,
        /// Poisson's ratio nu.
        poisson_ratio: PoissonRatio = Key::real("material.poisson_ratio", Range::open(-1.0, 0.5), "").because(
            "at 0.5 the bulk modulus 2 mu (1 + nu) / (3 (1 - 2 nu)) is infinite, and so is the number of explicit \
             steps: 0.49 to 0.499 serves for nearly incompressible tissue",
        ),
        /// Density of the undeformed sample.
        density: KilogramsPerCubicMetre = Key::real("material.density_kg_per_m3", Range::above(0.0, 1e5), "kg/m3"),
    }
}

choice! {
    /// Which constitutive law (`material.model`), with the constants that only it has.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub enum MaterialModel = Key::word("material.model", MaterialModel::WORDS)
        .described("Constitutive law of the change of shape.")
        .or("neo_hookean")
    => {
        /// W = mu/2 (J^-2/3 I1 - 3).
        "neo_hookean" => NeoHookean {
            /// Small-strain shear modulus mu; the instantaneous one where the material relaxes.
            shear_modulus: Pascals = Key::real("material.shear_modulus_pa", Range::above(0.0, 1e12), "Pa"),
        },
        /// W = sum_k 2 mu_k / a_k^2 (lb_1^a_k + lb_2^a_k + lb_3^a_k - 3).
        "ogden" => Ogden(terms: Ogden),
    }
}

const OGDEN_MODULI: Key = Key::list("material.ogden_shear_moduli_pa", Range::above(0.0, 1e12), ogden::MOST_TERMS, "Pa")
    .described("mu_k of W = sum 2 mu_k / a_k^2 (l1^a_k + l2^a_k + l3^a_k - 3); their sum is the initial shear modulus.")
    .because(
        "a term with a negative modulus makes the tissue unstable; the constants of a source that writes \
         W = sum mu_k / a_k (...) are to be multiplied by a_k / 2",
    );
const OGDEN_EXPONENTS: Key = Key::list("material.ogden_exponents", Range::closed(-30.0, 30.0), ogden::MOST_TERMS, "")
    .described("a_k of the same terms, in the same order; the exponent 2 is the neo-Hookean law.");

impl Section for Ogden {
    fn keys() -> Vec<Key> {
        vec![OGDEN_MODULI, OGDEN_EXPONENTS]
    }

    fn read(values: &Values, scope: Scope) -> Result<Self, SceneError> {
        read_terms(values, scope, [&OGDEN_EXPONENTS, &OGDEN_MODULI], |exponents, moduli| Self::new(moduli, exponents))
    }

    fn write(&self, values: &mut Values, scope: Scope) {
        let terms = self.terms();
        write(values, scope, &OGDEN_MODULI, &terms.iter().map(|t| t.shear_modulus).collect::<Vec<_>>());
        write(values, scope, &OGDEN_EXPONENTS, &terms.iter().map(|t| t.exponent).collect::<Vec<_>>());
    }
}

const PRONY_SHARES: Key = Key::list("material.prony_shares", Range::open(0.0, 1.0), prony::MOST_TERMS, "")
    .described("g_i: shares of the instantaneous stiffness in shear that relax; empty: elastic.")
    .or("[]");
const PRONY_TIMES: Key = Key::list("material.prony_times_s", Range::above(0.0, 1e9), prony::MOST_TERMS, "s")
    .described("tau_i: the times in which they relax, in the same order.")
    .or("[]");

impl Section for Prony {
    fn keys() -> Vec<Key> {
        vec![PRONY_SHARES, PRONY_TIMES]
    }

    fn read(values: &Values, scope: Scope) -> Result<Self, SceneError> {
        read_terms(values, scope, [&PRONY_TIMES, &PRONY_SHARES], |times, shares| Self::new(shares, times))
    }

    fn write(&self, values: &mut Values, scope: Scope) {
        write(values, scope, &PRONY_SHARES, &self.shares().to_vec());
        write(values, scope, &PRONY_TIMES, &self.times().to_vec());
    }
}

impl Material {
    /// Small-strain shear modulus mu, Pa, instantaneous where the material relaxes; Ogden: the sum of its terms.
    #[must_use]
    pub fn shear_modulus(&self) -> f64 {
        match &self.model {
            MaterialModel::NeoHookean { shear_modulus } => shear_modulus.get(),
            MaterialModel::Ogden(terms) => terms.shear_modulus(),
        }
    }

    /// Bulk modulus kappa = 2 mu (1 + nu) / (3 (1 - 2 nu)), Pa.
    #[must_use]
    pub fn bulk_modulus(&self) -> f64 {
        let nu = self.poisson_ratio.get();
        2.0 * self.shear_modulus() * (1.0 + nu) / (3.0 * (1.0 - 2.0 * nu))
    }

    /// The law with all its constants.
    #[must_use]
    pub fn law(&self) -> Law {
        Law {
            distortional: match self.model {
                MaterialModel::NeoHookean { shear_modulus } => {
                    Distortional::NeoHookean { shear_modulus: shear_modulus.get() }
                }
                MaterialModel::Ogden(terms) => Distortional::Ogden(terms),
            },
            volumetric: self.volumetric,
            bulk_modulus: self.bulk_modulus(),
            prony: self.prony,
        }
    }
}
