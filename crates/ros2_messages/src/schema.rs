//! Descriptions of message types as bags carry them, so that a reader needs no knowledge of ours.
//!
//! A `ros2msg` schema is the text of the .msg, then each type that it uses, once, behind a line of 80 `=` and a line
//! `MSG: package/Type`.

/// A message type: its definition, and its hash where it is recorded on its own.
struct Definition {
    /// `package/Type`.
    name: &'static str,
    /// Text of the .msg file.
    text: &'static str,
    /// RIHS01 hash (ROS 2 Jazzy and later), "" for types that occur only inside others. A wrong hash makes readers
    /// refuse the bag: `tests/bags.rs` compares each with an independent implementation.
    hash: &'static str,
}

const fn definition(name: &'static str, text: &'static str, hash: &'static str) -> Definition {
    Definition { name, text, hash }
}

/// Every type that this program records, and every type inside them. Own types come from `msg/`.
static DEFINITIONS: &[Definition] = &[
    definition("builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n", ""),
    definition("builtin_interfaces/Duration", "int32 sec\nuint32 nanosec\n", ""),
    definition("std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id\n", ""),
    definition("std_msgs/ColorRGBA", "float32 r\nfloat32 g\nfloat32 b\nfloat32 a\n", ""),
    definition(
        "std_msgs/Float64",
        "float64 data\n",
        "RIHS01_705ba9c3d1a09df43737eb67095534de36fd426c0587779bda2bc51fe790182a",
    ),
    definition(
        "std_msgs/Bool",
        "bool data\n",
        "RIHS01_feb91e995ff9ebd09c0cb3d2aed18b11077585839fb5db80193b62d74528f6c9",
    ),
    definition(
        "std_msgs/String",
        "string data\n",
        "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    ),
    definition("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n", ""),
    definition("geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z\n", ""),
    definition("geometry_msgs/Quaternion", "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n", ""),
    definition("geometry_msgs/Pose", "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n", ""),
    definition(
        "geometry_msgs/Wrench",
        "geometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque\n",
        "RIHS01_018e8519d57c16adbe97c9fe1460ef21fec7e31bc541de3d653a35895677ce52",
    ),
    definition(
        "geometry_msgs/PointStamped",
        "std_msgs/Header header\ngeometry_msgs/Point point\n",
        "RIHS01_4c0296af86e01e562e9e0405d138a01537247580076c58ea38d7923ac1045897",
    ),
    definition(
        "geometry_msgs/PoseStamped",
        "std_msgs/Header header\ngeometry_msgs/Pose pose\n",
        "RIHS01_10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8",
    ),
    definition(
        "geometry_msgs/PoseArray",
        "std_msgs/Header header\ngeometry_msgs/Pose[] poses\n",
        "RIHS01_af0cc36d190e104d546d168d6b39df04fa4b4ccecf59cb4c9ed328d3d5004aa0",
    ),
    definition("geometry_msgs/PoseWithCovariance", "geometry_msgs/Pose pose\nfloat64[36] covariance\n", ""),
    definition(
        "geometry_msgs/PoseWithCovarianceStamped",
        "std_msgs/Header header\ngeometry_msgs/PoseWithCovariance pose\n",
        "RIHS01_26432f9803e43727d3c8f668d1fdb3c630f548af631e2f4e31382371bfea3b6e",
    ),
    definition(
        "geometry_msgs/WrenchStamped",
        "std_msgs/Header header\ngeometry_msgs/Wrench wrench\n",
        "RIHS01_8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77",
    ),
    definition(
        "sensor_msgs/JointState",
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n",
        "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
    ),
    definition(
        "sensor_msgs/PointField",
        "uint8 INT8=1\nuint8 UINT8=2\nuint8 INT16=3\nuint8 UINT16=4\nuint8 INT32=5\nuint8 UINT32=6\nuint8 FLOAT32=7\n\
         uint8 FLOAT64=8\nstring name\nuint32 offset\nuint8 datatype\nuint32 count\n",
        "",
    ),
    definition(
        "sensor_msgs/PointCloud2",
        "std_msgs/Header header\nuint32 height\nuint32 width\nsensor_msgs/PointField[] fields\nbool is_bigendian\n\
         uint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense\n",
        "RIHS01_9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5",
    ),
    definition("sensor_msgs/CompressedImage", "std_msgs/Header header\nstring format\nuint8[] data\n", ""),
    definition(
        "rosgraph_msgs/Clock",
        "builtin_interfaces/Time clock\n",
        "RIHS01_692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564",
    ),
    definition("visualization_msgs/UVCoordinate", "float32 u\nfloat32 v\n", ""),
    definition("visualization_msgs/MeshFile", "string filename\nuint8[] data\n", ""),
    definition(
        "visualization_msgs/Marker",
        "int32 ARROW=0\nint32 CUBE=1\nint32 SPHERE=2\nint32 CYLINDER=3\nint32 LINE_STRIP=4\nint32 LINE_LIST=5\n\
         int32 CUBE_LIST=6\nint32 SPHERE_LIST=7\nint32 POINTS=8\nint32 TEXT_VIEW_FACING=9\nint32 MESH_RESOURCE=10\n\
         int32 TRIANGLE_LIST=11\nint32 ARROW_STRIP=12\nint32 ADD=0\nint32 MODIFY=0\nint32 DELETE=2\n\
         int32 DELETEALL=3\nstd_msgs/Header header\nstring ns\nint32 id\nint32 type\nint32 action\n\
         geometry_msgs/Pose pose\ngeometry_msgs/Vector3 scale\nstd_msgs/ColorRGBA color\n\
         builtin_interfaces/Duration lifetime\nbool frame_locked\ngeometry_msgs/Point[] points\n\
         std_msgs/ColorRGBA[] colors\nstring texture_resource\nsensor_msgs/CompressedImage texture\n\
         visualization_msgs/UVCoordinate[] uv_coordinates\nstring text\nstring mesh_resource\n\
         visualization_msgs/MeshFile mesh_file\nbool mesh_use_embedded_materials\n",
        "RIHS01_45b13ccf791f225962bf74e746f9644518855d783a6f42ba0cc14fde2b4f3ce0",
    ),
    definition("geometry_msgs/Transform", "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n", ""),
    definition(
        "geometry_msgs/TransformStamped",
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n",
        "RIHS01_0a241f87d04668d94099cbb5ba11691d5ad32c2f29682e4eb5653424bd275206",
    ),
    definition(
        "tf2_msgs/TFMessage",
        "geometry_msgs/TransformStamped[] transforms\n",
        "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
    ),
    definition("diagnostic_msgs/KeyValue", "string key\nstring value\n", ""),
    definition(
        "diagnostic_msgs/DiagnosticStatus",
        "byte OK=0\nbyte WARN=1\nbyte ERROR=2\nbyte STALE=3\nbyte level\nstring name\nstring message\n\
         string hardware_id\ndiagnostic_msgs/KeyValue[] values\n",
        "",
    ),
    definition(
        "diagnostic_msgs/DiagnosticArray",
        "std_msgs/Header header\ndiagnostic_msgs/DiagnosticStatus[] status\n",
        "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
    ),
    definition(
        "needle_twin/TissueModel",
        include_str!("../msg/TissueModel.msg"),
        "RIHS01_fd30b3de905517d26a05f9bcd4ae8ea5c339f11bdb001dc8cca44035c27e08b7",
    ),
    definition(
        "needle_twin/TissueState",
        include_str!("../msg/TissueState.msg"),
        "RIHS01_1ef2c83fff1754d4b1877fdcfa87fc0c4b1c69bef9ac43859f3d6ea4f8c5afd0",
    ),
    definition(
        "needle_twin/TissueEvent",
        include_str!("../msg/TissueEvent.msg"),
        "RIHS01_8b219f28c929b28a0ed9b4c9ef6bdb18777e7eb8d498e0b163e5c936ebf663ca",
    ),
    definition(
        "needle_twin/ForceBand",
        include_str!("../msg/ForceBand.msg"),
        "RIHS01_dcab8f8d2907e70dc3349f009d9b89bb9dcdd1e34dd2cf1ec2c8d9b5b156a967",
    ),
    definition(
        "needle_twin/Outlook",
        include_str!("../msg/Outlook.msg"),
        "RIHS01_49cdf062c910d067fa6106fb5ba6446ed809216e40d21ec7a08b88e3ecb90e3e",
    ),
    definition(
        "needle_twin/ForceComparison",
        include_str!("../msg/ForceComparison.msg"),
        "RIHS01_8f27b8dece519aca8ded0e6649b1361805d899ba91b5c295aa0388439a0600b5",
    ),
    definition(
        "needle_twin/TwinStatus",
        include_str!("../msg/TwinStatus.msg"),
        "RIHS01_d9e4e62f3741f6f63b6150047b28cffbce1f9bb9fdb8fc605db676c9b88d6079",
    ),
    definition(
        "needle_twin/Safety",
        include_str!("../msg/Safety.msg"),
        "RIHS01_add064c15e0bad8a574593535a3e3a4a176b7a2aa1c23fda59ddcf25da3f46be",
    ),
];

/// A type as a bag's channel describes it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Schema {
    /// `package/msg/Type`.
    pub type_name: String,
    /// Definition with everything inside it, encoding `ros2msg`.
    pub text: String,
    /// RIHS01 hash, or "".
    pub hash: String,
}

/// `package/msg/Type` or `package/Type` without the middle part.
fn short_name(type_name: &str) -> String {
    type_name.replacen("/msg/", "/", 1)
}

fn find(short: &str) -> Option<&'static Definition> {
    DEFINITIONS.iter().find(|d| d.name == short)
}

/// The types that a definition names in its fields, in order, as `package/Type`; built-in types are left out.
fn field_types(text: &str) -> impl Iterator<Item = &str> {
    text.lines().filter_map(|line| {
        let field_type = line.split('#').next()?.split_whitespace().next()?;
        let field_type = field_type.split('[').next()?;
        field_type.contains('/').then_some(field_type)
    })
}

/// Collects the types inside `text`, each once, in the order in which a reader meets them.
fn collect(text: &str, seen: &mut Vec<&'static Definition>) {
    for name in field_types(text) {
        let Some(definition) = find(name) else { continue };
        if !seen.iter().any(|d| d.name == definition.name) {
            seen.push(definition);
            collect(definition.text, seen);
        }
    }
}

/// The schema of a type that this program knows, by `package/msg/Type`.
#[must_use]
pub fn schema(type_name: &str) -> Option<Schema> {
    let definition = find(&short_name(type_name))?;
    let mut inside = Vec::new();
    collect(definition.text, &mut inside);
    let mut text = definition.text.trim_end().to_owned();
    text.push('\n');
    for d in inside {
        text.push_str(&format!("{}\nMSG: {}\n{}\n", "=".repeat(80), d.name, d.text.trim_end()));
    }
    Some(Schema { type_name: definition.name.replacen('/', "/msg/", 1), text, hash: definition.hash.to_owned() })
}

/// Names of all types that can be recorded on their own, as `package/msg/Type`.
pub fn recorded_types() -> impl Iterator<Item = String> {
    DEFINITIONS.iter().filter(|d| !d.hash.is_empty()).map(|d| d.name.replacen('/', "/msg/", 1))
}

/// The types that a schema's text uses but does not define: a reader without them can't decode a message.
#[must_use]
pub fn missing_types(schema_text: &str) -> Vec<String> {
    let defined: std::collections::BTreeSet<&str> =
        schema_text.lines().filter_map(|line| line.strip_prefix("MSG: ")).map(str::trim).collect();
    let mut missing: Vec<String> =
        field_types(schema_text).filter(|name| !defined.contains(name)).map(str::to_owned).collect();
    missing.dedup();
    missing
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn every_schema_is_complete() {
        for name in recorded_types() {
            let schema = schema(&name).unwrap();
            assert_eq!(schema.type_name, name);
            assert_eq!(missing_types(&schema.text), Vec::<String>::new(), "{name}");
        }
    }

    #[test]
    fn dependencies_follow_once_and_transitively() {
        let text = schema("geometry_msgs/msg/PoseStamped").unwrap().text;
        let names: Vec<_> = text.lines().filter_map(|l| l.strip_prefix("MSG: ")).collect();
        let expected = [
            "std_msgs/Header",
            "builtin_interfaces/Time",
            "geometry_msgs/Pose",
            "geometry_msgs/Point",
            "geometry_msgs/Quaternion",
        ];
        assert_eq!(names, expected);
        assert_eq!(text.lines().filter(|l| *l == "=".repeat(80)).count(), expected.len());
    }

    #[test]
    fn a_missing_definition_is_seen() {
        assert_eq!(missing_types("std_msgs/Header header\nfloat64 x\n"), ["std_msgs/Header"]);
        assert!(schema("my_msgs/msg/Other").is_none());
    }
}
