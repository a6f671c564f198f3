//! A value of a scene key, with no knowledge of which key: what TOML, `--set` and ROS parameters have in common.

use std::fmt;

/// A value as it is written in a scene file, after `--set key=` or in a ROS parameter.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// Free text or one of a key's words.
    Text(String),
    /// A number.
    Real(f64),
    /// A whole number; taken for a [`Value::Real`] where the key is one.
    Integer(i64),
    /// Yes or no.
    Boolean(bool),
    /// A position, m.
    Point([f64; 3]),
    /// A list of numbers; three of them are read as a [`Value::Point`] and taken for a list where the key is one.
    List(Vec<f64>),
}

impl Value {
    /// What it is, for messages.
    #[must_use]
    pub(crate) const fn type_name(&self) -> &'static str {
        match self {
            Self::Text(_) => "text",
            Self::Real(_) => "a number",
            Self::Integer(_) => "a whole number",
            Self::Boolean(_) => "true or false",
            Self::Point(_) => "three numbers",
            Self::List(_) => "a list of numbers",
        }
    }

    /// The number in it, an integer being taken for a double.
    #[must_use]
    pub const fn as_real(&self) -> Option<f64> {
        match *self {
            Self::Real(x) => Some(x),
            Self::Integer(i) => Some(i as f64),
            _ => None,
        }
    }

    /// A point where there are three numbers, a list otherwise: what the text alone can say.
    #[must_use]
    pub fn of_numbers(numbers: Vec<f64>) -> Self {
        <[f64; 3]>::try_from(numbers).map_or_else(Self::List, Self::Point)
    }

    /// The numbers in it, a single one being taken for a list of one.
    #[must_use]
    pub fn as_list(&self) -> Option<Vec<f64>> {
        match self {
            Self::List(numbers) => Some(numbers.clone()),
            Self::Point(point) => Some(point.to_vec()),
            _ => self.as_real().map(|x| vec![x]),
        }
    }

    /// The text in it.
    #[must_use]
    pub fn as_text(&self) -> Option<&str> {
        match self {
            Self::Text(text) => Some(text),
            _ => None,
        }
    }
}

/// As TOML writes it, so that every finite number comes back with the same bits.
impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Text(text) => write!(f, "{}", toml::Value::String(text.clone())),
            Self::Real(x) => write!(f, "{}", Number(*x)),
            Self::Integer(i) => write!(f, "{i}"),
            Self::Boolean(yes) => write!(f, "{yes}"),
            Self::Point([x, y, z]) => write!(f, "[{}, {}, {}]", Number(*x), Number(*y), Number(*z)),
            Self::List(numbers) => {
                let numbers: Vec<String> = numbers.iter().map(|x| Number(*x).to_string()).collect();
                write!(f, "[{}]", numbers.join(", "))
            }
        }
    }
}

/// A double in the shortest form that TOML reads back bit for bit.
struct Number(f64);

impl fmt::Display for Number {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            x if x.is_nan() => f.write_str("nan"),
            x if x.is_infinite() => f.write_str(if x > 0.0 { "inf" } else { "-inf" }),
            x => write!(f, "{x:?}"),
        }
    }
}

impl From<f64> for Value {
    fn from(x: f64) -> Self {
        Self::Real(x)
    }
}

impl From<u32> for Value {
    fn from(i: u32) -> Self {
        Self::Integer(i64::from(i))
    }
}

impl From<bool> for Value {
    fn from(yes: bool) -> Self {
        Self::Boolean(yes)
    }
}

impl From<&str> for Value {
    fn from(text: &str) -> Self {
        Self::Text(text.to_owned())
    }
}

impl From<Vec<f64>> for Value {
    fn from(numbers: Vec<f64>) -> Self {
        Self::List(numbers)
    }
}

impl From<[f64; 3]> for Value {
    fn from(point: [f64; 3]) -> Self {
        Self::Point(point)
    }
}
