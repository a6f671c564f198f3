//! Package `std_msgs`.

use super::{builtin_interfaces::Time, ros_messages};
use serde::{Deserialize, Serialize};

/// When and in which frame.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Header {
    /// Time of the measurement, or of the pose that a prediction answers.
    pub stamp: Time,
    /// Coordinate frame, without a leading slash.
    pub frame_id: std::string::String,
}

/// A number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Float64 {
    /// The number.
    pub data: f64,
}

/// A number of single precision.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Float32 {
    /// The number.
    pub data: f32,
}

/// A truth value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Bool {
    /// The value.
    pub data: bool,
}

/// A text.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct String {
    /// The text.
    pub data: std::string::String,
}

/// One dimension of an array.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct MultiArrayDimension {
    /// Its name.
    pub label: std::string::String,
    /// Elements along it.
    pub size: u32,
    /// Numbers from one element to the next.
    pub stride: u32,
}

/// How the numbers of an array lie.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct MultiArrayLayout {
    /// From the outermost to the innermost.
    pub dim: Vec<MultiArrayDimension>,
    /// Numbers before the first element.
    pub data_offset: u32,
}

/// An array of numbers.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Float64MultiArray {
    /// How they lie.
    pub layout: MultiArrayLayout,
    /// The numbers.
    pub data: Vec<f64>,
}

/// Colour and opacity, each in [0, 1].
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ColorRGBA {
    /// Red.
    pub r: f32,
    /// Green.
    pub g: f32,
    /// Blue.
    pub b: f32,
    /// Opacity.
    pub a: f32,
}

ros_messages!("std_msgs":
    Header, Float64, Float32, Bool, String, MultiArrayDimension, MultiArrayLayout, Float64MultiArray, ColorRGBA,
);
