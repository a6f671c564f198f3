"""ROS 2 message types for CycloneDDS, made from .msg text.

Nothing here knows the Rust structs: standard types are written out below as ROS 2 Jazzy has them, our own are read from
the project's msg/ folder. A field order that differs between the two sides shows as a decoding error or a wrong value.
"""

import pathlib
import re

from cyclonedds.idl import make_idl_struct
from cyclonedds.idl.types import array, float32, float64, int8, int16, int32, int64, sequence, uint8, uint16, uint32, uint64

PRIMITIVES = {
    "bool": bool, "byte": uint8, "char": uint8, "float32": float32, "float64": float64, "int8": int8, "uint8": uint8,
    "int16": int16, "uint16": uint16, "int32": int32, "uint32": uint32, "int64": int64, "uint64": uint64, "string": str,
}

TEXTS = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "builtin_interfaces/Duration": "int32 sec\nuint32 nanosec",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "std_msgs/Float64": "float64 data",
    "std_msgs/Float32": "float32 data",
    "std_msgs/Bool": "bool data",
    "std_msgs/String": "string data",
    "std_msgs/ColorRGBA": "float32 r\nfloat32 g\nfloat32 b\nfloat32 a",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/PointStamped": "std_msgs/Header header\nPoint point",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    "geometry_msgs/Pose": "Point position\nQuaternion orientation",
    "geometry_msgs/PoseStamped": "std_msgs/Header header\nPose pose",
    "geometry_msgs/PoseArray": "std_msgs/Header header\nPose[] poses",
    "geometry_msgs/PoseWithCovariance": "Pose pose\nfloat64[36] covariance",
    "geometry_msgs/PoseWithCovarianceStamped": "std_msgs/Header header\nPoseWithCovariance pose",
    "geometry_msgs/Wrench": "Vector3 force\nVector3 torque",
    "geometry_msgs/WrenchStamped": "std_msgs/Header header\nWrench wrench",
    "geometry_msgs/Transform": "Vector3 translation\nQuaternion rotation",
    "geometry_msgs/TransformStamped": "std_msgs/Header header\nstring child_frame_id\nTransform transform",
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "sensor_msgs/JointState":
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort",
    "sensor_msgs/Range":
        "std_msgs/Header header\nuint8 radiation_type\nfloat32 field_of_view\nfloat32 min_range\nfloat32 max_range\n"
        "float32 range\nfloat32 variance",
    "sensor_msgs/PointField": "string name\nuint32 offset\nuint8 datatype\nuint32 count",
    "sensor_msgs/PointCloud2":
        "std_msgs/Header header\nuint32 height\nuint32 width\nPointField[] fields\nbool is_bigendian\n"
        "uint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense",
    "sensor_msgs/CompressedImage": "std_msgs/Header header\nstring format\nuint8[] data",
    "visualization_msgs/UVCoordinate": "float32 u\nfloat32 v",
    "visualization_msgs/MeshFile": "string filename\nuint8[] data",
    "visualization_msgs/Marker":
        "std_msgs/Header header\nstring ns\nint32 id\nint32 type\nint32 action\ngeometry_msgs/Pose pose\n"
        "geometry_msgs/Vector3 scale\nstd_msgs/ColorRGBA color\nbuiltin_interfaces/Duration lifetime\n"
        "bool frame_locked\ngeometry_msgs/Point[] points\nstd_msgs/ColorRGBA[] colors\nstring texture_resource\n"
        "sensor_msgs/CompressedImage texture\nUVCoordinate[] uv_coordinates\nstring text\nstring mesh_resource\n"
        "MeshFile mesh_file\nbool mesh_use_embedded_materials",
    "rosgraph_msgs/Clock": "builtin_interfaces/Time clock",
    "diagnostic_msgs/KeyValue": "string key\nstring value",
    "diagnostic_msgs/DiagnosticStatus":
        "byte level\nstring name\nstring message\nstring hardware_id\nKeyValue[] values",
    "diagnostic_msgs/DiagnosticArray": "std_msgs/Header header\nDiagnosticStatus[] status",
    "rcl_interfaces/Log":
        "builtin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\nstring file\nstring function\nuint32 line",
    "rcl_interfaces/ParameterValue":
        "uint8 type\nbool bool_value\nint64 integer_value\nfloat64 double_value\nstring string_value\n"
        "byte[] byte_array_value\nbool[] bool_array_value\nint64[] integer_array_value\n"
        "float64[] double_array_value\nstring[] string_array_value",
    "rcl_interfaces/Parameter": "string name\nParameterValue value",
    "rcl_interfaces/SetParametersResult": "bool successful\nstring reason",
    "rcl_interfaces/FloatingPointRange": "float64 from_value\nfloat64 to_value\nfloat64 step",
    "rcl_interfaces/IntegerRange": "int64 from_value\nint64 to_value\nuint64 step",
    "rcl_interfaces/ParameterDescriptor":
        "string name\nuint8 type\nstring description\nstring additional_constraints\nbool read_only\n"
        "bool dynamic_typing\nFloatingPointRange[] floating_point_range\nIntegerRange[] integer_range",
    "rcl_interfaces/ParameterEvent":
        "builtin_interfaces/Time stamp\nstring node\nParameter[] new_parameters\nParameter[] changed_parameters\n"
        "Parameter[] deleted_parameters",
    "lifecycle_msgs/State": "uint8 id\nstring label",
    "lifecycle_msgs/Transition": "uint8 id\nstring label",
    "lifecycle_msgs/TransitionDescription": "Transition transition\nState start_state\nState goal_state",
    "lifecycle_msgs/TransitionEvent":
        "uint64 timestamp\nTransition transition\nState start_state\nState goal_state",
    "rcl_interfaces/LoggerLevel": "string name\nuint32 level",
    "rcl_interfaces/SetLoggerLevelsResult": "bool successful\nstring reason",
    "rcl_interfaces/ListParametersResult": "string[] names\nstring[] prefixes",
}

EMPTY = "uint8 structure_needs_at_least_one_member"

SERVICES = {
    "std_srvs/Trigger": (EMPTY, "bool success\nstring message"),
    "rcl_interfaces/GetParameters": ("string[] names", "ParameterValue[] values"),
    "rcl_interfaces/SetParameters": ("Parameter[] parameters", "SetParametersResult[] results"),
    "rcl_interfaces/ListParameters": ("string[] prefixes\nuint64 depth", "ListParametersResult result"),
    "rcl_interfaces/DescribeParameters": ("string[] names", "ParameterDescriptor[] descriptors"),
    "rcl_interfaces/GetParameterTypes": ("string[] names", "uint8[] types"),
    "rosbag2_interfaces/Pause": (EMPTY, EMPTY),
    "rosbag2_interfaces/Resume": (EMPTY, EMPTY),
    "rosbag2_interfaces/TogglePaused": (EMPTY, EMPTY),
    "rosbag2_interfaces/IsPaused": (EMPTY, "bool paused"),
    "rosbag2_interfaces/GetRate": (EMPTY, "float64 rate"),
    "rosbag2_interfaces/SetRate": ("float64 rate", "bool success"),
    "rosbag2_interfaces/Seek": ("builtin_interfaces/Time time", "bool success"),
    "rosbag2_interfaces/PlayNext": (EMPTY, "bool success"),
    "rosbag2_interfaces/Stop": (EMPTY, EMPTY),
    "rosbag2_interfaces/Play":
        ("builtin_interfaces/Time start_offset\nbuiltin_interfaces/Duration playback_duration\n"
         "builtin_interfaces/Time playback_until_timestamp", "bool success"),
    "lifecycle_msgs/GetState": (EMPTY, "State current_state"),
    "lifecycle_msgs/ChangeState": ("Transition transition", "bool success"),
    "lifecycle_msgs/GetAvailableStates": (EMPTY, "State[] available_states"),
    "lifecycle_msgs/GetAvailableTransitions": (EMPTY, "TransitionDescription[] available_transitions"),
    "rcl_interfaces/SetParametersAtomically": ("Parameter[] parameters", "SetParametersResult result"),
    "rcl_interfaces/GetLoggerLevels": ("string[] names", "LoggerLevel[] levels"),
    "rcl_interfaces/SetLoggerLevels": ("LoggerLevel[] levels", "SetLoggerLevelsResult[] results"),
    "rosbag2_interfaces/Burst": ("uint64 num_messages", "uint64 actually_burst"),
}

for path in (pathlib.Path(__file__).parents[2] / "msg").glob("*.msg"):
    TEXTS[f"needle_twin/{path.stem}"] = path.read_text()

for path in (pathlib.Path(__file__).parents[2] / "srv").glob("*.srv"):
    SERVICES[f"needle_twin/{path.stem}"] = tuple(path.read_text().split("\n---\n"))

_made = {}


def _fields(text, package):
    fields = {}
    for line in text.splitlines():
        line = line.split("#")[0].strip()
        if not line or re.match(r"^\S+\s+\w+\s*=", line):
            continue
        kind, name = line.split()[:2]
        base, _, suffix = kind.partition("[")
        element = PRIMITIVES.get(base) or message(base if "/" in base else f"{package}/{base}")
        if suffix == "]":
            element = sequence[element]
        elif suffix:
            element = array[element, int(suffix.rstrip("]"))]
        fields[name] = element
    return fields


def message(name):
    """The class of `package/Type` (or `package/msg/Type`)."""
    name = name.replace("/msg/", "/")
    if name not in _made:
        package, type_name = name.split("/")
        dds_name = f"{package}::msg::dds_::{type_name}_"
        _made[name] = make_idl_struct(type_name, dds_name, _fields(TEXTS[name], package))
    return _made[name]


def service(name):
    """Request and response of `package/Type` as rmw_cyclonedds puts them on the wire: a header of the client's identity
    and a sequence number in front of the fields."""
    name = name.replace("/srv/", "/")
    package, type_name = name.split("/")
    made = []
    for part, text in zip(("Request", "Response"), SERVICES[name]):
        key = f"{name}_{part}"
        if key not in _made:
            header = {"client_guid": array[uint8, 8], "sequence_number": int64}
            dds_name = f"{package}::srv::dds_::{type_name}_{part}_"
            _made[key] = make_idl_struct(f"{type_name}_{part}", dds_name, header | _fields(text, package))
        made.append(_made[key])
    return made


def to_dict(value):
    """A message as JSON has it."""
    if hasattr(value, "__idl_annotations__") or hasattr(value, "__dataclass_fields__"):
        return {name: to_dict(getattr(value, name)) for name in value.__dataclass_fields__}
    if isinstance(value, (list, tuple)):
        return [to_dict(v) for v in value]
    if isinstance(value, (bytes, bytearray)):
        return list(value)
    return value


def default(kind):
    """A value of zeros."""
    if kind is str or kind == "str":
        return ""
    if kind is bool:
        return False
    if hasattr(kind, "__dataclass_fields__"):
        return from_dict(kind, {})
    text = repr(kind)
    if "sequence" in text:
        return []
    if "array" in text:
        return [0] * int(re.search(r",\s*(\d+)\]", text).group(1))
    return 0.0 if "float" in text else 0


def _element(kind):
    for meta in getattr(kind, "__metadata__", ()):
        if hasattr(meta, "subtype"):
            return meta.subtype
    return None


def from_dict(cls, values):
    """A message from JSON; what is left out is zero."""
    made = {}
    for name, kind in cls.__annotations__.items():
        if name not in values:
            made[name] = default(kind)
        elif hasattr(kind, "__dataclass_fields__"):
            made[name] = from_dict(kind, values[name])
        else:
            element = _element(kind)
            given = values[name]
            if element is not None and hasattr(element, "__dataclass_fields__"):
                given = [from_dict(element, v) for v in given]
            made[name] = given
    return cls(**made)
