//! Package `visualization_msgs`.

use super::builtin_interfaces::Duration;
use super::cdr::octets;
use super::geometry_msgs::{Point, Pose, Vector3};
use super::ros_messages;
use super::sensor_msgs::CompressedImage;
use super::std_msgs::{ColorRGBA, Header};
use serde::{Deserialize, Serialize};

/// Texture coordinates of a vertex.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct UVCoordinate {
    /// Along the width, in [0, 1].
    pub u: f32,
    /// Along the height, in [0, 1].
    pub v: f32,
}

/// A mesh file that travels within the message.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct MeshFile {
    /// Name.
    pub filename: String,
    /// Content.
    #[serde(with = "octets")]
    pub data: Vec<u8>,
}

/// Something to draw. Humble and later have the fields `texture_resource` to `uv_coordinates` and `mesh_file`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Marker {
    /// When and in which frame.
    pub header: Header,
    /// Namespace of the id.
    pub ns: String,
    /// The same id replaces the marker.
    pub id: i32,
    /// Kind of shape (`type` in the .msg), one of the constants.
    pub r#type: i32,
    /// `ADD` or `DELETE`.
    pub action: i32,
    /// Where.
    pub pose: Pose,
    /// Size; (1, 1, 1) for a triangle list in metres.
    pub scale: Vector3,
    /// Colour of the whole.
    pub color: ColorRGBA,
    /// How long; zero is for ever.
    pub lifetime: Duration,
    /// Whether it moves with its frame.
    pub frame_locked: bool,
    /// Vertices; three per triangle for a triangle list.
    pub points: Vec<Point>,
    /// Colour per vertex, or empty.
    pub colors: Vec<ColorRGBA>,
    /// Name of a texture, or empty.
    pub texture_resource: String,
    /// The texture, or empty.
    pub texture: CompressedImage,
    /// Texture coordinates, or empty.
    pub uv_coordinates: Vec<UVCoordinate>,
    /// Text of a text marker.
    pub text: String,
    /// Name of a mesh, or empty.
    pub mesh_resource: String,
    /// The mesh, or empty.
    pub mesh_file: MeshFile,
    /// Whether the mesh brings its colours.
    pub mesh_use_embedded_materials: bool,
}

impl Marker {
    /// `type`: separate points.
    pub const POINTS: i32 = 8;
    /// `type`: text that faces the viewer.
    pub const TEXT_VIEW_FACING: i32 = 9;
    /// `type`: triangles, three points each.
    pub const TRIANGLE_LIST: i32 = 11;
    /// `action`: add or replace.
    pub const ADD: i32 = 0;
    /// `action`: remove.
    pub const DELETE: i32 = 2;
    /// `action`: remove all.
    pub const DELETEALL: i32 = 3;
}

ros_messages!("visualization_msgs": UVCoordinate, MeshFile, Marker);
