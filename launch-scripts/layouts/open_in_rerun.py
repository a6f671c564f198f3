"""Opens a recording in Rerun: the sample's points coloured by displacement beside forces, residual and depth.

usage: open_in_rerun.py FILE.mcap [--save FILE.rrd]      (pip install rerun-sdk mcap-ros2-support)
"""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

TIME = "ros2_timestamp"
SERIES = {"force": ["predicted_n", "measured_n"], "residual": ["residual_n"], "depth": ["depth_m"]}
UNITS = {"force": "N", "residual": "N", "depth": "m"}
# red, green, blue
PALE, RED, BLUE = (242, 217, 199), (153, 13, 20), (60, 120, 255)
RADIUS_M = 1.2e-4


def send(entity: str, rows: list[tuple[int, float]]) -> None:
    """Sends (time in ns, value) as one series."""
    times, values = zip(*rows, strict=True)
    index = rr.TimeColumn(TIME, timestamp=np.array(times, dtype="datetime64[ns]"))
    rr.send_columns(entity, indexes=[index], columns=rr.Scalars.columns(scalars=values))


def messages(file: Path, topic: str) -> Iterator[tuple[int, Any]]:
    """The messages of a topic with their stamps, ns."""
    with file.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, _, _, message in reader.iter_decoded_messages(topics=[topic]):
            yield message.header.stamp.sec * 10**9 + message.header.stamp.nanosec, message


def curves(file: Path) -> None:
    """Sends what `comparison` says: Rerun draws numbers, not fields of messages of other packages."""
    rows: dict[str, list[tuple[int, float]]] = {}
    for stamp, message in messages(file, "/comparison"):
        for view, fields in SERIES.items():
            for field in fields:
                if message.valid or field in ("predicted_n", "depth_m"):
                    rows.setdefault(f"{view}/{field}", []).append((stamp, getattr(message, field)))
    for entity, series in rows.items():
        send(entity, series)


def sample(file: Path) -> None:
    """Sends the sample's points, pale at rest and red where they are moved furthest, and the targets."""
    largest = 1e-9
    for stamp, cloud in messages(file, "/tissue_points"):
        fields = np.frombuffer(bytes(cloud.data), "<f4").reshape(cloud.width, -1)
        moved = fields[:, 3]
        largest = max(largest, float(moved.max()))
        share = (moved / largest)[:, None]
        rr.set_time(TIME, timestamp=np.datetime64(stamp, "ns"))
        colours = (1.0 - share) * np.array(PALE) + share * np.array(RED)
        rr.log("sample/points", rr.Points3D(fields[:, :3], colors=colours.astype(np.uint8), radii=RADIUS_M))
    for stamp, targets in messages(file, "/targets"):
        rr.set_time(TIME, timestamp=np.datetime64(stamp, "ns"))
        places = [(p.position.x, p.position.y, p.position.z) for p in targets.poses]
        rr.log("sample/targets", rr.Points3D(places, colors=BLUE, radii=3 * RADIUS_M))


def blueprint() -> rrb.Blueprint:
    """The sample to the left, curves to the right."""
    view = rrb.Spatial3DView(origin="sample", name="Deformed sample")
    plots = [rrb.TimeSeriesView(origin=view, name=f"{view} in {UNITS[view]}") for view, fields in SERIES.items()]
    return rrb.Blueprint(rrb.Horizontal(view, rrb.Vertical(*plots)), collapse_panels=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path)
    parser.add_argument("--save", type=Path, help="write a .rrd file instead of opening the viewer")
    arguments = parser.parse_args()
    rr.init("needle_twin", spawn=arguments.save is None)
    if arguments.save:
        rr.save(arguments.save)
    rr.send_blueprint(blueprint())
    sample(arguments.file)
    curves(arguments.file)
    rr.disconnect()


main()
