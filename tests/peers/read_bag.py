"""Reads one topic of a bag with rosbags: one line of JSON per message, the bits of a wrench's force.z.

usage: read_bag.py BAG TOPIC
"""

import json
import struct
import sys
from pathlib import Path

from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

with AnyReader([Path(sys.argv[1])], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as bag:
    chosen = [c for c in bag.connections if c.topic == sys.argv[2]]
    for connection, _, data in bag.messages(connections=chosen):
        force = bag.deserialize(data, connection.msgtype).wrench.force
        print(json.dumps(struct.unpack("<Q", struct.pack("<d", force.z))[0]))
