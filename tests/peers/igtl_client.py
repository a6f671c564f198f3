"""A client of OpenIGTLink: listens for so long and says as JSON what came. Transforms and points are read by pyigtl; of surfaces, which pyigtl can't read, the
protocol's own layout is read here. Every checksum is computed again by crcmod.

    igtl_client.py HOST PORT SECONDS
"""

import json
import socket
import struct
import sys
import time

import crcmod
import numpy as np
from pyigtl import OpenIGTLinkClient

CRC = crcmod.mkCrcFun(0x142F0E1EBA9EA3693, rev=False, initCrc=0)


def receive(stream, count):
    data = b""
    while len(data) < count:
        more = stream.recv(count - len(data))
        if not more:
            raise EOFError
        data += more
    return data


def surface(body):
    """NPOINTS, then cells and bytes of vertices, lines, polygons and strips, then NATTRIBUTES; points, polygons, attributes."""
    head = struct.unpack(">10I", body[:40])
    points, polygons, size, attributes = head[0], head[5], head[6], head[9]
    assert head[1:5] == (0, 0, 0, 0) and head[7:9] == (0, 0), head
    end = 40 + 12 * points
    places = np.frombuffer(body[40:end], ">f4").reshape(-1, 3)
    cells = np.frombuffer(body[end : end + size], ">u4").reshape(polygons, 4)
    assert (cells[:, 0] == 3).all() and cells[:, 1:].max() < points
    rest = body[end + size :]
    kind, components, count = struct.unpack(">BBI", rest[:6])
    assert (attributes, kind, components, count) == (1, 0, 1, points)
    name = rest[6:].split(b"\0")[0].decode()
    start = 6 + len(name) + 2 - len(name) % 2
    values = np.frombuffer(rest[start:], ">f4")
    assert len(values) == points
    return places, cells[:, 1:], name, values


def main():
    host, port, seconds = sys.argv[1], int(sys.argv[2]), float(sys.argv[3])
    client = OpenIGTLinkClient(host=host, port=port)
    found = {"count": {}, "polydata": None}
    try:
        with socket.create_connection((host, port), timeout=30) as stream:
            print("connected", flush=True)
            end = time.monotonic() + seconds
            while time.monotonic() < end:
                stream.settimeout(max(end - time.monotonic(), 1e-3))
                version, kind, device, _, size, crc = struct.unpack(">H12s20sQQQ", receive(stream, 58))
                stream.settimeout(30)
                body = receive(stream, size)
                assert version == 1 and CRC(body) == crc, (version, kind)
                name = kind.rstrip(b"\0").decode() + " " + device.rstrip(b"\0").decode()
                found["count"][name] = found["count"].get(name, 0) + 1
                if name.startswith("POLYDATA"):
                    places, cells, scalar, values = surface(body)
                    found["polydata"] = {
                        "points": len(places),
                        "triangles": len(cells),
                        "low": places.min(axis=0).tolist(),
                        "high": places.max(axis=0).tolist(),
                        "scalar": scalar,
                        "largest": float(values.max()),
                    }
    except TimeoutError:
        pass
    transform = client.wait_for_message("NeedleToSample", timeout=5)
    points = client.wait_for_message("Targets", timeout=5)
    found["matrix"] = transform.matrix.tolist() if transform else None
    found["stamp"] = transform.timestamp if transform else None
    found["targets"] = {"names": list(points.names), "positions": np.asarray(points.positions).tolist()} if points else None
    client.stop()
    print(json.dumps(found))


main()
