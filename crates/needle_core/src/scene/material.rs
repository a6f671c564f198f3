//! `[material]`: the constitutive law of the sample and its constants.

use mtled::material::{
    Distortional, Law, MooneyRivlin, Ogden, Own, Prony, VerondaWestmann, Volumetric, Yeoh, ogden, prony,
};

use super::section::{Scope, Section, choice, read_terms, section, words, write};
use super::values::Values;
use super::{Key, KilogramsPerCubicMetre, Pascals, PoissonRatio, Range, SceneError, Word};

section! {
    /// Constitutive law with its constants.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Material => {
        /// The law of the change of shape.
        model: MaterialModel,
        /// A law of the caller's own in its place. It stays when keys change; a file cannot say it.
        own: Option<Own>,
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
    pub enum MaterialModel = MODEL => {
        /// W = mu/2 (J^-2/3 I1 - 3).
        "neo_hookean" => NeoHookean {
            /// Small-strain shear modulus mu; the instantaneous one where the material relaxes.
            shear_modulus: Pascals = Key::real("material.shear_modulus_pa", Range::above(0.0, 1e12), "Pa"),
        },
        /// W = sum_k 2 mu_k / a_k^2 (lb_1^a_k + lb_2^a_k + lb_3^a_k - 3).
        "ogden" => Ogden(terms: Ogden),
        /// W = C10 (J^-2/3 I1 - 3) + C01 (J^-4/3 I2 - 3).
        "mooney_rivlin" => MooneyRivlin {
            /// C10; the initial shear modulus is 2 (C10 + C01), or 2 C10 of Yeoh's law.
            c10: Pascals = C10,
            /// C01 of W = C10 (J^-2/3 I1 - 3) + C01 (J^-4/3 I2 - 3).
            c01: Pascals = Key::real("material.c01_pa", Range::closed(0.0, 1e12), "Pa")
                .because("with a negative C01 the tissue is unstable at large stretches"),
        },
        /// W = C10 x + C20 x^2 + C30 x^3 with x = J^-2/3 I1 - 3.
        "yeoh" => Yeoh {
            /// C10; the initial shear modulus is 2 C10.
            c10: Pascals = C10,
            /// C20 of W = C10 x + C20 x^2 + C30 x^3 with x = J^-2/3 I1 - 3.
            c20: Pascals = Key::real("material.c20_pa", Range::closed(-1e12, 1e12), "Pa"),
            /// C30 of the same.
            c30: Pascals = Key::real("material.c30_pa", Range::closed(0.0, 1e12), "Pa").or("0.0")
                .because("with a negative C30 the tissue is unstable at large stretches"),
        },
        /// W = mu/c (exp(c (J^-2/3 I1 - 3)) - 1) - mu/2 (J^-4/3 I2 - 3).
        "veronda_westmann" => VerondaWestmann {
            /// Small-strain shear modulus mu.
            shear_modulus: Pascals = Key::real("material.shear_modulus_pa", Range::above(0.0, 1e12), "Pa"),
            /// c of the exponential law: how fast the tissue stiffens. Veronda and Westmann's C2, and their C1 is mu/c.
            exponent: f64 = Key::real("material.stiffening_exponent", Range::above(0.0, 100.0), ""),
        },
    }
}

const MODEL: Key = Key::word("material.model", MaterialModel::WORDS)
    .described("Constitutive law of the change of shape.")
    .or("neo_hookean");

impl Section for Option<Own> {
    fn keys() -> Vec<Key> {
        Vec::new()
    }

    fn read(values: &Values, scope: Scope<'_>) -> Result<Self, SceneError> {
        Ok(values.own_law(&scope.path(&MODEL)))
    }

    fn write(&self, values: &mut Values, scope: Scope<'_>) {
        if let Some(law) = self {
            values.put_own_law(scope.path(&MODEL), *law);
        }
    }
}

const C10: Key = Key::real("material.c10_pa", Range::above(0.0, 1e12), "Pa");

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

    fn read(values: &Values, scope: Scope<'_>) -> Result<Self, SceneError> {
        read_terms(values, scope, [&OGDEN_EXPONENTS, &OGDEN_MODULI], |exponents, moduli| Self::new(moduli, exponents))
    }

    fn write(&self, values: &mut Values, scope: Scope<'_>) {
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

    fn read(values: &Values, scope: Scope<'_>) -> Result<Self, SceneError> {
        read_terms(values, scope, [&PRONY_TIMES, &PRONY_SHARES], |times, shares| Self::new(shares, times))
    }

    fn write(&self, values: &mut Values, scope: Scope<'_>) {
        write(values, scope, &PRONY_SHARES, &self.shares().to_vec());
        write(values, scope, &PRONY_TIMES, &self.times().to_vec());
    }
}

impl Material {
    /// Small-strain shear modulus mu, Pa, instantaneous where the material relaxes.
    #[must_use]
    pub fn shear_modulus(&self) -> f64 {
        self.distortional().shear_modulus()
    }

    /// Bulk modulus kappa = 2 mu (1 + nu) / (3 (1 - 2 nu)), Pa.
    #[must_use]
    pub fn bulk_modulus(&self) -> f64 {
        let nu = self.poisson_ratio.get();
        2.0 * self.shear_modulus() * (1.0 + nu) / (3.0 * (1.0 - 2.0 * nu))
    }

    /// The law with all its constants.
    #[must_use]
    pub(crate) fn law(&self) -> Law {
        Law {
            distortional: self.distortional(),
            volumetric: self.volumetric,
            bulk_modulus: self.bulk_modulus(),
            prony: self.prony,
        }
    }

    fn distortional(&self) -> Distortional {
        if let Some(law) = self.own {
            return Distortional::Own(law);
        }
        match self.model {
            MaterialModel::NeoHookean { shear_modulus } => {
                Distortional::NeoHookean { shear_modulus: shear_modulus.get() }
            }
            MaterialModel::Ogden(terms) => Distortional::Ogden(terms),
            MaterialModel::MooneyRivlin { c10, c01 } => {
                Distortional::MooneyRivlin(MooneyRivlin { c10: c10.get(), c01: c01.get() })
            }
            MaterialModel::Yeoh { c10, c20, c30 } => {
                Distortional::Yeoh(Yeoh { c10: c10.get(), c20: c20.get(), c30: c30.get() })
            }
            MaterialModel::VerondaWestmann { shear_modulus, exponent } => {
                Distortional::VerondaWestmann(VerondaWestmann { shear_modulus: shear_modulus.get(), exponent })
            }
        }
    }
}

words!(Volumetric: Quadratic = "quadratic", Logarithmic = "logarithmic");
