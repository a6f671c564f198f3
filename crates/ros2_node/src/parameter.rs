//! Typed parameters of a node. One constant has the name, type, default, range and description, and the value is read
//! with that constant. A mistyped name or type does not compile.

use ros2_client::ParameterValue;

use super::declaration::{Check, Declaration, Range};

/// A type that a parameter can have.
pub trait Typed: Sized {
    /// Type of the default in the source code.
    type Literal: Copy;
    /// Constraints of a value in addition to its type, in words and as a check.
    const MUST: (&'static str, Option<Check>) = ("", None);

    /// The default as a parameter value.
    fn value(literal: Self::Literal) -> ParameterValue;

    /// The default as this type.
    fn literal(literal: Self::Literal) -> Self;

    /// The content of a value, if it is of this type.
    fn of(value: &ParameterValue) -> Option<Self>;
}

/// Implements [`Typed`] for a type that corresponds to one kind of value.
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
    /// A parameter that may change at run time. The description is one sentence with the unit.
    #[must_use]
    pub const fn new(name: &'static str, default: T::Literal, description: &'static str) -> Self {
        let (constraints, check) = T::MUST;
        Self { name, default, description, range: Range::Any, constraints, check, read_only: false }
    }

    /// The same, read-only at run time.
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

    /// The default value.
    #[must_use]
    pub fn default(&self) -> T {
        T::literal(self.default)
    }

    /// The declaration for the node.
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

/// Defines parameter constants, and a function that declares all of them, so that none is missing.
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
