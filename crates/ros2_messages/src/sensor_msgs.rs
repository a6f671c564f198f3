//! Package `sensor_msgs`.

use super::{cdr::octets, ros_messages, std_msgs::Header};
use serde::{Deserialize, Serialize};

/// State of joints; arrays are as long as `name`, or empty where there is no such value.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct JointState {
    /// When.
    pub header: Header,
    /// Names of the joints.
    pub name: Vec<String>,
    /// Positions, rad or m.
    pub position: Vec<f64>,
    /// Velocities, rad/s or m/s.
    pub velocity: Vec<f64>,
    /// Efforts, N m or N.
    pub effort: Vec<f64>,
}

/// Distance from a range finder. Jazzy's message has a `variance` behind these fields, which is not read.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Range {
    /// When and in which frame.
    pub header: Header,
    /// Ultrasound 0, infrared 1.
    pub radiation_type: u8,
    /// Opening angle, rad.
    pub field_of_view: f32,
    /// Smallest distance, m.
    pub min_range: f32,
    /// Largest distance, m.
    pub max_range: f32,
    /// The distance, m.
    pub range: f32,
}

/// One field of a point in a [`PointCloud2`].
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PointField {
    /// Name, `x`.
    pub name: String,
    /// Offset from the start of the point, bytes.
    pub offset: u32,
    /// One of the constants of this type.
    pub datatype: u8,
    /// Number of elements.
    pub count: u32,
}

impl PointField {
    /// 8-bit signed integer.
    pub const INT8: u8 = 1;
    /// 8-bit unsigned integer.
    pub const UINT8: u8 = 2;
    /// 16-bit signed integer.
    pub const INT16: u8 = 3;
    /// 16-bit unsigned integer.
    pub const UINT16: u8 = 4;
    /// 32-bit signed integer.
    pub const INT32: u8 = 5;
    /// 32-bit unsigned integer.
    pub const UINT32: u8 = 6;
    /// 32-bit floating point.
    pub const FLOAT32: u8 = 7;
    /// 64-bit floating point.
    pub const FLOAT64: u8 = 8;
}

/// Points with any fields, as one block of bytes.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PointCloud2 {
    /// When and in which frame.
    pub header: Header,
    /// 1 for an unordered cloud.
    pub height: u32,
    /// Points per row.
    pub width: u32,
    /// What a point holds.
    pub fields: Vec<PointField>,
    /// Byte order of `data`.
    pub is_bigendian: bool,
    /// Bytes per point.
    pub point_step: u32,
    /// Bytes per row.
    pub row_step: u32,
    /// The points, `row_step * height` bytes.
    #[serde(with = "octets")]
    pub data: Vec<u8>,
    /// True if every number is finite.
    pub is_dense: bool,
}

/// A compressed image (here only as a part of a marker, always empty).
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct CompressedImage {
    /// When and in which frame.
    pub header: Header,
    /// Format of the data.
    pub format: String,
    /// The image.
    #[serde(with = "octets")]
    pub data: Vec<u8>,
}

ros_messages!("sensor_msgs": JointState, Range, PointField, PointCloud2, CompressedImage);
