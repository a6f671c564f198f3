//! What a parameter is declared with, and which values it accepts.

use ros2_client::ParameterValue;
use ros2_client::parameters::{NumericRange, ParameterDescriptor, ParameterType};

/// Allowed values of a number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Range {
    /// Any value of the type.
    Any,
    /// Inclusive.
    Integer(i64, i64),
    /// Inclusive.
    Double(f64, f64),
}

/// Additional check of a value; the error states what would be valid.
pub(crate) type Check = fn(&ParameterValue) -> Result<(), String>;

/// A declared parameter.
#[derive(Clone, Debug)]
pub struct Declaration {
    /// Dotted name.
    pub name: String,
    /// Default; fixes the type.
    pub default: ParameterValue,
    /// One sentence with the unit.
    pub description: String,
    /// Allowed values.
    pub range: Range,
    /// Constraints that a range can't express.
    pub constraints: String,
    /// Whether it is read-only at run time.
    pub read_only: bool,
    /// Additional check.
    pub check: Option<Check>,
}

impl Declaration {
    /// A parameter that may change at run time.
    #[must_use]
    pub fn new(name: &str, default: ParameterValue, range: Range, description: &str) -> Self {
        Self {
            name: name.to_owned(),
            default,
            description: description.to_owned(),
            range,
            constraints: String::new(),
            read_only: false,
            check: None,
        }
    }

    /// The same, read-only at run time.
    #[must_use]
    pub fn fixed(mut self) -> Self {
        self.read_only = true;
        self
    }

    /// The value converted to this parameter's type (an integer, or a number as text, is accepted as a double).
    ///
    /// # Errors
    /// What would be valid, in words.
    pub(crate) fn accept(&self, value: &ParameterValue) -> Result<ParameterValue, String> {
        use ParameterValue as P;
        #[allow(clippy::cast_precision_loss)] // parameters are small numbers
        let value = match (&self.default, value) {
            (P::Double(_), P::Integer(v)) => P::Double(*v as f64),
            (P::DoubleArray(_), P::IntegerArray(v)) => P::DoubleArray(v.iter().map(|v| *v as f64).collect()),
            // An empty list has no type in YAML.
            (default, given) if is_array(default) && is_empty(given) => default_empty(default),
            // `-p bag:=2024` is meant as a name.
            (P::String(_), P::Integer(v)) => P::String(v.to_string()),
            // `ros2 param` takes 1e-5 for text: its YAML wants a point.
            (P::Double(_), P::String(v)) if v.parse::<f64>().is_ok() => P::Double(v.parse().unwrap_or(f64::NAN)),
            (default, value) if default.to_parameter_type() == value.to_parameter_type() => value.clone(),
            (default, value) => {
                return Err(format!("is a {}, got {} ({})", word(default), word(value), show(value)));
            }
        };
        match (self.range, &value) {
            (Range::Integer(from, to), P::Integer(v)) if !(from..=to).contains(v) => {
                return Err(format!("{v} is not in [{from}, {to}]"));
            }
            (Range::Double(from, to), P::Double(v)) if !(from..=to).contains(v) => {
                return Err(format!("{v} is not in [{from}, {to}]"));
            }
            (_, P::Double(v)) if !v.is_finite() => return Err(format!("{v} is not a finite number")),
            _ => {}
        }
        self.check.map_or(Ok(()), |check| check(&value))?;
        Ok(value)
    }

    pub(super) fn descriptor(&self) -> ParameterDescriptor {
        ParameterDescriptor {
            name: self.name.clone(),
            param_type: self.default.to_parameter_type(),
            description: self.description.clone(),
            additional_constraints: self.constraints.clone(),
            read_only: self.read_only,
            dynamic_typing: false,
            range: match self.range {
                Range::Any => NumericRange::NotSpecified,
                Range::Integer(from_value, to_value) => NumericRange::IntegerRange { from_value, to_value, step: 0 },
                Range::Double(from_value, to_value) => {
                    NumericRange::FloatingPointRange { from_value, to_value, step: 0.0 }
                }
            },
        }
    }
}

fn is_array(value: &ParameterValue) -> bool {
    use ParameterValue as P;
    matches!(value, P::ByteArray(_) | P::BooleanArray(_) | P::IntegerArray(_) | P::DoubleArray(_) | P::StringArray(_))
}

fn is_empty(value: &ParameterValue) -> bool {
    use ParameterValue as P;
    match value {
        P::ByteArray(v) => v.is_empty(),
        P::BooleanArray(v) => v.is_empty(),
        P::IntegerArray(v) => v.is_empty(),
        P::DoubleArray(v) => v.is_empty(),
        P::StringArray(v) => v.is_empty(),
        _ => false,
    }
}

fn default_empty(value: &ParameterValue) -> ParameterValue {
    use ParameterValue as P;
    match value {
        P::ByteArray(_) => P::ByteArray(Vec::new()),
        P::BooleanArray(_) => P::BooleanArray(Vec::new()),
        P::IntegerArray(_) => P::IntegerArray(Vec::new()),
        P::DoubleArray(_) => P::DoubleArray(Vec::new()),
        _ => P::StringArray(Vec::new()),
    }
}

/// Name of the type.
#[must_use]
pub(crate) fn word(value: &ParameterValue) -> &'static str {
    match value.to_parameter_type() {
        ParameterType::NotSet => "nothing",
        ParameterType::Bool => "boolean",
        ParameterType::Integer => "integer",
        ParameterType::Double => "double",
        ParameterType::String => "string",
        ParameterType::ByteArray => "list of bytes",
        ParameterType::BoolArray => "list of booleans",
        ParameterType::IntegerArray => "list of integers",
        ParameterType::DoubleArray => "list of doubles",
        ParameterType::StringArray => "list of strings",
    }
}

/// Readable form of the value.
#[must_use]
pub fn show(value: &ParameterValue) -> String {
    use ParameterValue as P;
    match value {
        P::NotSet => "not set".to_owned(),
        P::Boolean(v) => v.to_string(),
        P::Integer(v) => v.to_string(),
        P::Double(v) => v.to_string(),
        P::String(v) => v.clone(),
        P::ByteArray(v) => format!("{v:?}"),
        P::BooleanArray(v) => format!("{v:?}"),
        P::IntegerArray(v) => format!("{v:?}"),
        P::DoubleArray(v) => format!("{v:?}"),
        P::StringArray(v) => format!("{v:?}"),
    }
}
