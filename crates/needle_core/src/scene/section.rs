//! Sections: a struct or a choice whose fields are scene keys.
//!
//! The field of a [`section`] or [`choice`] is the one place of a key: its doc comment is the key's description, its
//! type says how the value is read, and the [`Key`] beside it gives path, range, unit and default. The registry
//! ([`super::keys`]), reading, writing and `--set` all come from there.

use super::key::AUTO;
use super::values::Values;
use super::{Hertz, KilogramsPerCubicMetre, MetresPerSecond, Pascals, PoissonRatio, Radians, Seconds};
use super::{Key, Metres, SceneError, Value};

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
        impl $crate::scene::Word for $type {
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

/// Which of several sections with the same keys is meant.
#[derive(Clone, Copy, Debug)]
pub(super) enum Scope<'a> {
    /// The section that there is once: paths are those of the registry.
    Once,
    /// An element of a list: `targets.name` is `targets.0.name`.
    Element(usize),
    /// An element with a name: `regions.radius_m` is `regions.NAME.radius_m`, and `material.model` is
    /// `materials.NAME.model`.
    Named(&'a str),
}

impl Scope<'_> {
    /// The full path of a key of the registry.
    pub(super) fn path(self, key: &Key) -> String {
        match self {
            Self::Once => key.path.to_owned(),
            Self::Element(i) => format!("{}.{i}.{}", key.section(), key.field()),
            Self::Named(name) => {
                let section = if key.section() == "material" { "materials" } else { key.section() };
                format!("{section}.{name}.{}", key.field())
            }
        }
    }
}

/// A part of a scene that knows its own keys.
pub(super) trait Section: Sized {
    /// Its keys, in the order in which a file is written.
    fn keys() -> Vec<Key>;

    /// Whether the values ask for it; asked where it may be absent.
    fn applies(_: &Values) -> bool {
        true
    }

    /// Reads it; types and ranges hold already, what is absent and required is an error here.
    ///
    /// # Errors
    /// [`SceneError::Missing`] for a required key, [`SceneError::Inconsistent`] for keys that contradict each other.
    fn read(values: &Values, scope: Scope<'_>) -> Result<Self, SceneError>;

    /// Writes every key that applies.
    fn write(&self, values: &mut Values, scope: Scope<'_>);
}

impl<T: Section> Section for Option<T> {
    fn keys() -> Vec<Key> {
        T::keys()
    }

    fn read(values: &Values, scope: Scope<'_>) -> Result<Self, SceneError> {
        T::applies(values).then(|| T::read(values, scope)).transpose()
    }

    fn write(&self, values: &mut Values, scope: Scope<'_>) {
        if let Some(section) = self {
            section.write(values, scope);
        }
    }
}

/// A type that one key fills.
pub(super) trait Field: Sized {
    /// The field of a value that is of the key's type.
    fn from_value(value: &Value) -> Option<Self>;

    /// The value that a file would hold.
    fn to_value(&self) -> Value;
}

impl<T: Word> Field for T {
    fn from_value(value: &Value) -> Option<Self> {
        T::from_word(value.as_text()?)
    }

    fn to_value(&self) -> Value {
        self.as_str().into()
    }
}

impl Field for String {
    fn from_value(value: &Value) -> Option<Self> {
        value.as_text().map(Self::from)
    }

    fn to_value(&self) -> Value {
        self.as_str().into()
    }
}

impl Field for f64 {
    fn from_value(value: &Value) -> Option<Self> {
        value.as_real()
    }

    fn to_value(&self) -> Value {
        (*self).into()
    }
}

/// `None`: left to the program.
impl<T: Number> Field for Option<T> {
    fn from_value(value: &Value) -> Option<Self> {
        match value {
            Value::Text(word) => (word == AUTO).then_some(None),
            number => T::from_value(number).map(Some),
        }
    }

    fn to_value(&self) -> Value {
        self.as_ref().map_or_else(|| AUTO.into(), Field::to_value)
    }
}

/// What a key may leave to the program.
pub(super) trait Number: Field {}

impl Number for f64 {}
impl Number for Metres {}

impl Field for u32 {
    fn from_value(value: &Value) -> Option<Self> {
        match value {
            Value::Integer(i) => (*i).try_into().ok(),
            _ => None,
        }
    }

    fn to_value(&self) -> Value {
        (*self).into()
    }
}

impl Field for bool {
    fn from_value(value: &Value) -> Option<Self> {
        match value {
            Value::Boolean(yes) => Some(*yes),
            _ => None,
        }
    }

    fn to_value(&self) -> Value {
        (*self).into()
    }
}

impl Field for [f64; 3] {
    fn from_value(value: &Value) -> Option<Self> {
        match value {
            Value::Point(point) => Some(*point),
            _ => None,
        }
    }

    fn to_value(&self) -> Value {
        (*self).into()
    }
}

impl Field for Vec<f64> {
    fn from_value(value: &Value) -> Option<Self> {
        value.as_list()
    }

    fn to_value(&self) -> Value {
        self.clone().into()
    }
}

macro_rules! fields_with_units {
    ($($unit:ident),+) => {
        $(impl Field for $unit {
            fn from_value(value: &Value) -> Option<Self> {
                value.as_real().map(Self)
            }

            fn to_value(&self) -> Value {
                self.get().into()
            }
        })+
    };
}

fields_with_units!(Metres, Pascals, KilogramsPerCubicMetre, MetresPerSecond, Hertz, Radians, Seconds, PoissonRatio);

/// Reads the field of a key.
pub(super) fn read<T: Field>(values: &Values, scope: Scope<'_>, key: &Key) -> Result<T, SceneError> {
    let path = scope.path(key);
    T::from_value(&values.value(&path)?).ok_or_else(|| not_of_type(values, scope, key))
}

/// Only reached if a key and its field disagree on the type, which a test over every key rules out.
pub(super) fn not_of_type(values: &Values, scope: Scope<'_>, key: &Key) -> SceneError {
    let path = scope.path(key);
    SceneError::Inconsistent {
        place: values.place(&path),
        value: values.get(&path).map_or_else(|| "default".to_owned(), Value::to_string),
        key: path,
        reason: "not of the key's type".to_owned(),
    }
}

/// Writes the field of a key.
pub(super) fn write(values: &mut Values, scope: Scope<'_>, key: &Key, field: &impl Field) {
    values.put(&scope.path(key), field.to_value());
}

/// What two lists of the same length make, one of each for a term.
pub(super) fn read_terms<T>(
    values: &Values,
    scope: Scope<'_>,
    [first, second]: [&Key; 2],
    make: impl Fn(&[f64], &[f64]) -> Option<T>,
) -> Result<T, SceneError> {
    let (a, b): (Vec<f64>, Vec<f64>) = (read(values, scope, first)?, read(values, scope, second)?);
    // the lengths of both lists are in range, so they can only differ
    make(&a, &b).ok_or_else(|| SceneError::Inconsistent {
        place: values.place(&scope.path(first)),
        key: scope.path(first),
        value: Value::from(a.clone()).to_string(),
        reason: format!("{} numbers, but {} has {}: one of each makes a term", a.len(), scope.path(second), b.len()),
    })
}

/// Ties the keys of one variant to the word that selects it; a key of several variants belongs to all their words, and one that another key of
/// the variant selects is left to that.
pub(super) fn tie(keys: &mut Vec<Key>, selector: &'static str, word: &'static str, of_variant: Vec<Key>) {
    for key in of_variant {
        match keys.iter_mut().find(|known| known.path == key.path) {
            // The registry is built once; what it leaks is a few words.
            Some(known) => {
                let words = known.only_with.map_or(&[][..], |(_, words)| words);
                known.only_with = Some((selector, [words, &[word]].concat().leak()));
            }
            None if key.only_with.is_some_and(|(by, _)| by != selector) => keys.push(key),
            None => keys.push(key.only(selector, vec![word].leak())),
        }
    }
}

/// Keys of a field: its own, or those of the section that it holds.
macro_rules! field_keys {
    ($type:ty, $doc:expr, $key:expr) => {
        vec![$key.described($doc)]
    };
    ($type:ty, $doc:expr) => {
        <$type as $crate::scene::section::Section>::keys()
    };
}

/// The value of a field.
macro_rules! read_field {
    ($values:expr, $scope:expr, $type:ty, $key:expr) => {
        $crate::scene::section::read::<$type>($values, $scope, &$key)?
    };
    ($values:expr, $scope:expr, $type:ty) => {
        <$type as $crate::scene::section::Section>::read($values, $scope)?
    };
}

/// Writes a field.
macro_rules! write_field {
    ($values:expr, $scope:expr, $field:expr, $key:expr) => {
        $crate::scene::section::write($values, $scope, &$key, $field)
    };
    ($values:expr, $scope:expr, $field:expr) => {
        $crate::scene::section::Section::write($field, $values, $scope)
    };
}

/// A struct whose fields are keys (`field: Type = Key`) or sections (`field: Type`). `when CONDITION` says when the
/// values ask for it, for an `Option` of it.
macro_rules! section {
    (
        $(#[$meta:meta])*
        $vis:vis struct $name:ident $(when $applies:expr)? => {
            $( $(#[doc = $doc:literal])+ $field:ident: $type:ty $(= $key:expr)? ),+ $(,)?
        }
    ) => {
        $(#[$meta])*
        $vis struct $name {
            $( $(#[doc = $doc])+ pub $field: $type, )+
        }

        impl $crate::scene::section::Section for $name {
            fn keys() -> Vec<$crate::scene::Key> {
                let mut keys = Vec::new();
                $( keys.extend($crate::scene::section::field_keys!($type, concat!($($doc),+) $(, $key)?)); )+
                keys
            }

            $(fn applies(values: &$crate::scene::values::Values) -> bool {
                let applies: fn(&$crate::scene::values::Values) -> bool = $applies;
                applies(values)
            })?

            fn read(
                values: &$crate::scene::values::Values,
                scope: $crate::scene::section::Scope<'_>,
            ) -> Result<Self, $crate::scene::SceneError> {
                Ok(Self { $( $field: $crate::scene::section::read_field!(values, scope, $type $(, $key)?), )+ })
            }

            fn write(&self, values: &mut $crate::scene::values::Values, scope: $crate::scene::section::Scope<'_>) {
                $( $crate::scene::section::write_field!(values, scope, &self.$field $(, $key)?); )+
            }
        }
    };
}

/// An enum that a key selects by a word, each variant with the keys that only it has: none, fields as in [`section`],
/// or a section in brackets.
macro_rules! choice {
    (
        $(#[$meta:meta])*
        pub enum $name:ident = $selector:expr => {
            $(
                $(#[doc = $variant_doc:literal])+
                $word:literal => $variant:ident
                $( { $( $(#[doc = $doc:literal])+ $field:ident: $type:ty = $key:expr ),+ $(,)? } )?
                $( ( $payload:ident: $payload_type:ty ) )?
            ),+ $(,)?
        }
    ) => {
        $(#[$meta])*
        pub enum $name {
            $(
                $(#[doc = $variant_doc])+
                $variant $( { $( $(#[doc = $doc])+ $field: $type ),+ } )? $( ($payload_type) )?
            ),+
        }

        impl $name {
            /// The words that select the variants, in their order.
            pub const WORDS: &'static [&'static str] = &[$($word),+];

            /// The word that files and messages use.
            #[must_use]
            pub const fn as_str(&self) -> &'static str {
                match self {
                    $( Self::$variant { .. } => $word ),+
                }
            }
        }

        impl $crate::scene::section::Section for $name {
            fn keys() -> Vec<$crate::scene::Key> {
                let selector: $crate::scene::Key = $selector;
                #[allow(unused_mut)]
                let mut keys = Vec::new();
                $(
                    #[allow(unused_mut)]
                    let mut of_variant = Vec::new();
                    $( $( of_variant.extend($crate::scene::section::field_keys!($type, concat!($($doc),+), $key)); )+ )?
                    $( of_variant.extend(<$payload_type as $crate::scene::section::Section>::keys()); )?
                    $crate::scene::section::tie(&mut keys, selector.path, $word, of_variant);
                )+
                keys.insert(0, selector);
                keys
            }

            fn read(
                values: &$crate::scene::values::Values,
                scope: $crate::scene::section::Scope<'_>,
            ) -> Result<Self, $crate::scene::SceneError> {
                let word: String = $crate::scene::section::read(values, scope, &$selector)?;
                Ok(match word.as_str() {
                    $(
                        $word => Self::$variant
                            $( { $( $field: $crate::scene::section::read_field!(values, scope, $type, $key) ),+ } )?
                            $( ($crate::scene::section::read_field!(values, scope, $payload_type)) )?,
                    )+
                    _ => return Err($crate::scene::section::not_of_type(values, scope, &$selector)),
                })
            }

            fn write(&self, values: &mut $crate::scene::values::Values, scope: $crate::scene::section::Scope<'_>) {
                $crate::scene::section::write(values, scope, &$selector, &self.as_str().to_owned());
                match self {
                    $(
                        Self::$variant $( { $( $field ),+ } )? $( ($payload) )? => {
                            $( $( $crate::scene::section::write_field!(values, scope, $field, $key); )+ )?
                            $( $crate::scene::section::write_field!(values, scope, $payload); )?
                        }
                    )+
                }
            }
        }
    };
}

pub(super) use {choice, field_keys, read_field, section, words, write_field};
