"""Writes a recording of another rig with rosbags: nothing in it has this project's names or units.

usage: foreign_bag.py FOLDER
Makes FOLDER/numbers and FOLDER/ranges, 200 samples each, every 10 ms from second 5000 on:
numbers: /lvdt/mm (Float64, i * 0.01 mm), /scale/grams (Float64, i * 2 gf on the tissue, so downwards)
ranges:  /sonar (Range, 0.1 m - i * 0.01 mm), /arm/joint_states (JointState of two joints), /ft_sensor (WrenchStamped)
"""

import sys
from pathlib import Path

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

store = get_typestore(Stores.ROS2_JAZZY)
T = store.types
COUNT = 200
FLOAT, RANGE = "std_msgs/msg/Float64", "sensor_msgs/msg/Range"
JOINT, WRENCH = "sensor_msgs/msg/JointState", "geometry_msgs/msg/WrenchStamped"


def nanos(i):
    return 5_000_000_000_000 + i * 10_000_000


def header(i, frame):
    return T["std_msgs/msg/Header"](T["builtin_interfaces/msg/Time"](nanos(i) // 10**9, nanos(i) % 10**9), frame)


def vector(x, y, z):
    return T["geometry_msgs/msg/Vector3"](x, y, z)


def number(i, value):
    return T[FLOAT](value)


def sonar(i):
    names = [f.name for f in __import__("dataclasses").fields(T[RANGE]) if f.name != "__msgtype__"]
    values = {"header": header(i, "sonar"), "radiation_type": 0, "range": 0.1 - i * 1e-5}
    return T[RANGE](**{name: values.get(name, 0.0) for name in names})


def joints(i):
    empty = np.array([])
    return T[JOINT](header(i, ""), ["elbow", "z_axis"], np.array([1.0, i * 0.01]), empty, empty)


def wrench(i):
    return T[WRENCH](header(i, "cell"), T["geometry_msgs/msg/Wrench"](vector(0.0, 0.0, -i * 1e-3), vector(0.0, 0.0, 0.0)))


def write(name, topics):
    with Writer(Path(sys.argv[1]) / name, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        connections = {topic: bag.add_connection(topic, kind, typestore=store) for topic, (kind, _) in topics.items()}
        for i in range(COUNT):
            for topic, (kind, make) in topics.items():
                bag.write(connections[topic], nanos(i), store.serialize_cdr(make(i), kind))


write("numbers", {
    "/lvdt/mm": (FLOAT, lambda i: number(i, i * 0.01)),
    "/scale/grams": (FLOAT, lambda i: number(i, i * 2.0)),
})
write("ranges", {"/sonar": (RANGE, sonar), "/arm/joint_states": (JOINT, joints), "/ft_sensor": (WRENCH, wrench)})
