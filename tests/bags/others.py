"""Writes the same recording with other programs' writers, in every way that a bag can be packed.

usage: others.py FOLDER
Makes FOLDER/NAME (rosbag2 folders by rosbags) and FOLDER/NAME.mcap (files by mcap); 300 messages each:
/measured_js with position i * 1e-4 and /measured_cf with force.z = i * 1e-3, stamped i * 10 ms after second 1000.
"""

import sys
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

folder = Path(sys.argv[1])
store = get_typestore(Stores.ROS2_HUMBLE)
T = store.types
COUNT = 300


def stamp(i):
    return 1_000_000_000_000 + i * 10_000_000


def header(i):
    ns = stamp(i)
    return T["std_msgs/msg/Header"](T["builtin_interfaces/msg/Time"](ns // 10**9, ns % 10**9), "sample")


def joint(i):
    empty = np.array([])
    return T["sensor_msgs/msg/JointState"](header(i), ["insertion"], np.array([i * 1e-4]), empty, empty)


def wrench(i):
    v = T["geometry_msgs/msg/Vector3"]
    return T["geometry_msgs/msg/WrenchStamped"](header(i), T["geometry_msgs/msg/Wrench"](v(0.0, 0.0, i * 1e-3), v(0.0, 0.0, 0.0)))


JOINT, WRENCH = "sensor_msgs/msg/JointState", "geometry_msgs/msg/WrenchStamped"


def rosbag2(name, version, compress=None):
    bag = Writer(folder / name, version=version, storage_plugin=StoragePlugin.MCAP)
    if compress:
        bag.set_compression(compress, CompressionFormat.ZSTD)
    with bag:
        js = bag.add_connection("/measured_js", JOINT, typestore=store)
        cf = bag.add_connection("/measured_cf", WRENCH, typestore=store)
        for i in range(COUNT):
            bag.write(js, stamp(i), store.serialize_cdr(joint(i), JOINT))
            bag.write(cf, stamp(i), store.serialize_cdr(wrench(i), WRENCH))


rosbag2("version_9", 9)
rosbag2("version_8", 8)
rosbag2("packed_files", 9, CompressionMode.FILE)
rosbag2("packed_messages", 9, CompressionMode.MESSAGE)


def mcap(name, **options):
    with open(folder / f"{name}.mcap", "wb") as file:
        writer = McapWriter(file, chunk_size=4000, **options)
        writer.start(profile="ros2", library="another")

        def channel(topic, name):
            text = store.generate_msgdef(name, ros_version=2)[0]
            return writer.register_channel(topic, "cdr", writer.register_schema(name, "ros2msg", text.encode()))

        js, cf = channel("/measured_js", JOINT), channel("/measured_cf", WRENCH)
        for i in range(COUNT):
            for id, message, name in ((js, joint(i), JOINT), (cf, wrench(i), WRENCH)):
                data = bytes(store.serialize_cdr(message, name))
                writer.add_message(channel_id=id, log_time=stamp(i), publish_time=stamp(i), data=data)
        writer.finish()


mcap("zstd")
mcap("lz4", compression=CompressionType.LZ4)
mcap("plain_chunks", compression=CompressionType.NONE)
mcap("no_chunks", use_chunking=False)
mcap("no_index", index_types=IndexType.NONE, use_statistics=False, use_summary_offsets=False)
mcap("nothing_repeated", repeat_schemas=False, repeat_channels=False)
mcap("no_checksums", enable_crcs=False)
