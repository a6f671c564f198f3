"""Opens a recording in Rerun: the sample's points coloured by displacement beside forces, residual and depth.

usage: open_in_rerun.py FILE.mcap [--save FILE.rrd]      (pip install rerun-sdk mcap-ros2-support)
"""

import argparse
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

TIME = "ros2_timestamp"
SERIES = {"force": ["predicted_n", "measured_n"], "residual": ["residual_n"], "depth": ["depth_m"]}


def send(entity: str, rows: list[tuple[int, float]]) -> None:
    """Sends (time in ns, value) as one series."""
    times, values = zip(*rows, strict=True)
    index = rr.TimeColumn(TIME, timestamp=np.array(times, dtype="datetime64[ns]"))
    rr.send_columns(entity, indexes=[index], columns=rr.Scalars.columns(scalars=values))


def curves(file: Path) -> None:
    """Sends what `comparison` says: Rerun draws numbers, not fields of messages of other packages."""
    rows: dict[str, list[tuple[int, float]]] = {}
    with file.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, _, _, message in reader.iter_decoded_messages(topics=["/comparison"]):
            stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            for view, fields in SERIES.items():
                for field in fields:
                    if message.valid or field in ("predicted_n", "depth_m"):
                        rows.setdefault(f"{view}/{field}", []).append((stamp, getattr(message, field)))
    for entity, series in rows.items():
        send(entity, series)


def blueprint() -> rrb.Blueprint:
    """The sample to the left, curves to the right."""
    sample = rrb.Spatial3DView(origin="/", contents="/tissue_points", name="Deformed sample")
    plots = [rrb.TimeSeriesView(origin=view, name=f"{view} in {fields[0][-1]}") for view, fields in SERIES.items()]
    return rrb.Blueprint(rrb.Horizontal(sample, rrb.Vertical(*plots)), collapse_panels=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path)
    parser.add_argument("--save", type=Path, help="write a .rrd file instead of opening the viewer")
    arguments = parser.parse_args()
    rr.init("needle_twin", spawn=arguments.save is None)
    if arguments.save:
        rr.save(arguments.save)
    rr.send_blueprint(blueprint())
    rr.log_file_from_path(arguments.file)
    curves(arguments.file)
    rr.disconnect()


main()
