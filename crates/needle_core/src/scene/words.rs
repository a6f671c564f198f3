//! The words that a scene file uses for its choices, each tied to its type in one place.

use mtled::material::Volumetric;
use mtled::solver::Precision;

use super::{DeformationRule, Dimension, IndenterTip, Integration, Method, NeedleTip, VolumeRatio};

/// A choice that a scene file makes by a word.
pub trait Word: Sized + Copy {
    /// Every word, in the order of the variants.
    const WORDS: &'static [&'static str];

    /// The word that files and messages use.
    #[must_use]
    fn as_str(self) -> &'static str;

    /// The variant that a word stands for.
    #[must_use]
    fn from_word(word: &str) -> Option<Self>;
}

/// Ties the variants of a plain enum to their words.
macro_rules! words {
    ($type:ident: $($variant:ident = $word:literal),+) => {
        impl Word for $type {
            const WORDS: &'static [&'static str] = &[$($word),+];

            fn as_str(self) -> &'static str {
                match self {
                    $(Self::$variant => $word),+
                }
            }

            fn from_word(word: &str) -> Option<Self> {
                match word {
                    $($word => Some(Self::$variant),)+
                    _ => None,
                }
            }
        }
    };
}

words!(Volumetric: Quadratic = "quadratic", Logarithmic = "logarithmic");
words!(IndenterTip: Flat = "flat", Sphere = "sphere");
words!(NeedleTip: Flat = "flat", Conical = "conical", Bevel = "bevel");
words!(DeformationRule: Incremental = "incremental", Absolute = "absolute");
words!(Method: Mmls = "mmls", Mls = "mls", Tet4 = "tet4");
words!(Integration: Plain = "plain", Consistent = "consistent", Auto = "auto");
words!(Dimension: Auto = "auto", Axisymmetric = "axisymmetric", Mirrored = "mirrored", Full = "full");
words!(VolumeRatio: Auto = "auto", Mixed = "mixed", Projected = "projected", Pointwise = "pointwise", Averaged = "averaged");
words!(Precision: F32 = "f32", F64 = "f64");
