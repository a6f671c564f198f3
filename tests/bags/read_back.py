"""Reads a bag with two independent libraries and compares every field of every message with what was written.

usage: read_back.py BAG EXPECTED.json MSG_FOLDER
EXPECTED.json: [{"topic", "type", "log_ns", "publish_ns", "hash", "reliability", "durability", "message": {...}}, ...] in order.
Prints, as JSON, what else can only be said from this side: each message's bytes in big-endian CDR.
"""

import json
import sys
from pathlib import Path

import numpy as np
from mcap_ros2.reader import read_ros2_messages
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

bag, expected_file, msg_folder = map(Path, sys.argv[1:])
expected = json.loads(expected_file.read_text())


def plain(value):
    """A decoded message as JSON would have it."""
    if isinstance(value, np.ndarray):
        return [plain(v) for v in value.tolist()]
    if isinstance(value, (bytes, bytearray, memoryview)):
        return list(value)
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, np.generic):
        return value.item()
    if hasattr(value, "__dataclass_fields__"):  # rosbags; constants are no fields of ours
        return {k: plain(getattr(value, k)) for k in value.__dataclass_fields__ if not k.startswith("__") and not k.isupper()}
    if hasattr(value, "__slots__"):  # mcap-ros2-support
        return {k: plain(getattr(value, k)) for k in value.__slots__ if not k.startswith("_") and not k.isupper()}
    return value


def compare(where, found, wanted):
    if isinstance(wanted, dict):
        assert isinstance(found, dict) and set(found) == set(wanted), f"{where}: {set(found)} instead of {set(wanted)}"
        for key, value in wanted.items():
            compare(f"{where}.{key}", found[key], value)
    elif isinstance(wanted, list):
        if wanted and isinstance(wanted[0], list):  # rows and columns of a covariance are one array in a message
            wanted = [value for row in wanted for value in row]
        assert len(found) == len(wanted), f"{where}: {len(found)} elements instead of {len(wanted)}"
        for i, (f, w) in enumerate(zip(found, wanted)):
            compare(f"{where}[{i}]", f, w)
    elif where.endswith("].level"):  # `byte`: one octet, which rosbags takes for signed and mcap_ros2 for a byte string
        found = found[0] if isinstance(found, list) else found
        assert found % 256 == wanted, f"{where}: {found!r} instead of {wanted!r}"
    else:
        assert type(found) is type(wanted) and found == wanted, f"{where}: {found!r} instead of {wanted!r}"


# Definitions that don't come from the bag: those of ROS 2 Jazzy, and our .msg files.
store = get_typestore(Stores.ROS2_JAZZY)
for file in sorted(msg_folder.glob("*.msg")):
    store.register(get_types_from_msg(file.read_text(), f"needle_twin/msg/{file.stem}"))

big_endian = []
with AnyReader([bag]) as reader:
    profiles = {c.topic: c.ext.offered_qos_profiles for c in reader.connections}
    for connection in reader.connections:
        want = next(e for e in expected if e["topic"] == connection.topic)
        assert connection.digest == want["hash"] == store.hash_rihs01(connection.msgtype), f"hash of {connection.msgtype}"
        (profile,) = profiles[connection.topic]
        assert profile.reliability.name.lower() == want["reliability"], connection.topic
        assert profile.durability.name.lower() == want["durability"], connection.topic
        assert profile.deadline.sec == 9223372036 and profile.deadline.nsec == 854775807
    count = 0
    for want, (connection, time, raw) in zip(expected, reader.messages()):
        where = f"rosbags: message {count} on {connection.topic}"
        assert (connection.topic, connection.msgtype, time) == (want["topic"], want["type"], want["log_ns"]), where
        compare(where, plain(reader.deserialize(raw, connection.msgtype)), want["message"])
        message = store.deserialize_cdr(raw, connection.msgtype)
        assert bytes(store.serialize_cdr(message, connection.msgtype)) == bytes(raw), f"{where}: bytes differ"
        big_endian.append(bytes(store.serialize_cdr(message, connection.msgtype, little_endian=False)).hex())
        count += 1
    assert count == len(expected) == reader.message_count, f"rosbags: {count} of {len(expected)} messages"

(file,) = bag.glob("*.mcap")
count = 0
for want, m in zip(expected, read_ros2_messages(str(file))):
    where = f"mcap_ros2: message {count} on {m.channel.topic}"
    assert (m.channel.topic, m.schema.name) == (want["topic"], want["type"]), where
    assert (m.log_time_ns, m.publish_time_ns) == (want["log_ns"], want["publish_ns"]), where
    compare(where, plain(m.ros_msg), want["message"])
    count += 1
assert count == len(expected), f"mcap_ros2: {count} of {len(expected)} messages"

print(json.dumps(big_endian))
