//! A parameter of a node as a typed handle: name, type, default, range and description stand in one constant, and the
//! value is read by that constant. A mistyped name or type does not compile.

use ros2_client::ParameterValue;

use super::parameters::{Check, Declaration, Range};

/// A type that a parameter can have.
pub trait Typed: Sized {
    /// How a default is written in the code.
    type Literal: Copy;
    /// What a value must be beside its type, in words and as a check.
    const MUST: (&'static str, Option<Check>) = ("", None);

    /// The default's value.
    fn value(literal: Self::Literal) -> ParameterValue;

    /// The default as it is read.
    fn literal(literal: Self::Literal) -> Self;

    /// What a value holds, if it is of this type.
    fn of(value: &ParameterValue) -> Option<Self>;
}

/// Implements [`Typed`] for a type that one kind of value holds.
macro_rules! typed {
    ($type:ty, $literal:ty, $kind:ident, |$l:ident| $owned:expr) => {
        impl Typed for $type {
            type Literal = $literal;

            fn value($l: $literal) -> ParameterValue {
                ParameterValue::$kind($owned)
            }

            fn literal($l: $literal) -> Self {
                $owned
            }

            fn of(value: &ParameterValue) -> Option<Self> {
                if let ParameterValue::$kind(v) = value { Some(v.clone()) } else { None }
            }
        }
    };
}
typed!(bool, bool, Boolean, |l| l);
typed!(i64, i64, Integer, |l| l);
typed!(f64, f64, Double, |l| l);
typed!(String, &'static str, String, |l| l.to_owned());
typed!(Vec<String>, [&'static str; 0], StringArray, |l| l.map(str::to_owned).to_vec());

/// Three numbers.
impl Typed for [f64; 3] {
    type Literal = Self;
    const MUST: (&'static str, Option<Check>) = ("three numbers", Some(three));

    fn value(literal: Self) -> ParameterValue {
        ParameterValue::DoubleArray(literal.to_vec())
    }

    fn literal(literal: Self) -> Self {
        literal
    }

    fn of(value: &ParameterValue) -> Option<Self> {
        if let ParameterValue::DoubleArray(v) = value { v.as_slice().try_into().ok() } else { None }
    }
}

fn three(value: &ParameterValue) -> Result<(), String> {
    let given = <[f64; 3]>::of(value).ok_or("is three numbers")?;
    if given.iter().all(|x| x.is_finite()) { Ok(()) } else { Err("is three finite numbers".to_owned()) }
}

/// A declared parameter; its value is [`super::parameters::Parameters::get`].
#[derive(Debug)]
pub struct Parameter<T: Typed> {
    name: &'static str,
    default: T::Literal,
    description: &'static str,
    range: Range,
    constraints: &'static str,
    check: Option<Check>,
    read_only: bool,
}

impl<T: Typed> Copy for Parameter<T> {}

impl<T: Typed> Clone for Parameter<T> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<T: Typed> Parameter<T> {
    /// A parameter that may change while the node runs; one sentence says what it is, with its unit.
    #[must_use]
    pub const fn new(name: &'static str, default: T::Literal, description: &'static str) -> Self {
        let (constraints, check) = T::MUST;
        Self { name, default, description, range: Range::Any, constraints, check, read_only: false }
    }

    /// The same, fixed once the node runs.
    #[must_use]
    pub const fn fixed(self) -> Self {
        Self { read_only: true, ..self }
    }

    /// With an extra check, described in words.
    #[must_use]
    pub const fn checked(self, constraints: &'static str, check: Check) -> Self {
        Self { constraints, check: Some(check), ..self }
    }

    /// Its name.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        self.name
    }

    /// The value that it has if nobody says anything else.
    #[must_use]
    pub fn default(&self) -> T {
        T::literal(self.default)
    }

    /// As the node declares it.
    #[must_use]
    pub fn declaration(&self) -> Declaration {
        Declaration {
            name: self.name.to_owned(),
            default: T::value(self.default),
            description: self.description.to_owned(),
            range: self.range,
            constraints: self.constraints.to_owned(),
            read_only: self.read_only,
            check: self.check,
        }
    }
}

impl Parameter<f64> {
    /// A number within these bounds, inclusive.
    #[must_use]
    pub const fn real(name: &'static str, default: f64, [low, high]: [f64; 2], description: &'static str) -> Self {
        Self { range: Range::Double(low, high), ..Self::new(name, default, description) }
    }
}

impl Parameter<i64> {
    /// A whole number within these bounds, inclusive.
    #[must_use]
    pub const fn integer(name: &'static str, default: i64, [low, high]: [i64; 2], description: &'static str) -> Self {
        Self { range: Range::Integer(low, high), ..Self::new(name, default, description) }
    }
}

/// Constants that are parameters, and a function that declares all of them: none can be forgotten.
#[doc(hidden)]
#[macro_export]
macro_rules! __parameters {
    ($(#[$about:meta])* $all:ident: $($(#[$doc:meta])* $name:ident: $type:ty = $parameter:expr;)+) => {
        $($(#[$doc])* pub const $name: $crate::parameter::Parameter<$type> = $parameter;)+

        $(#[$about])*
        pub fn $all() -> Vec<$crate::parameters::Declaration> {
            vec![$($name.declaration()),+]
        }
    };
}
pub use __parameters as parameters;
