"""Which topics and fields that a Foxglove or PlotJuggler layout draws are not in a recording, read by Foxglove's own Python reader.

usage: layout_paths.py FILE.mcap LAYOUT...; prints a JSON list of what is missing
"""

import json
import re
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory


def foxglove(layout: dict) -> list[str]:
    """Paths such as /measured_js.position[0] and topics, of all panels."""
    panels = layout["configById"].values()
    plots = [path["value"] for panel in panels for path in panel.get("paths", [])]
    return plots + [t for panel in panels for t in [*panel.get("topics", {}), panel.get("topicToRender", "")] if t]


def plotjuggler(root: ET.Element) -> list[str]:
    """Curves such as /status/depth_m; a joint state is unfolded there: /measured_js/insertion/position."""
    names = (curve.get("name", "") for curve in root.iter("curve"))
    return [re.sub(r"^(/[^/]+)/insertion/(\w+)$", r"\1.\2[0]", name).replace("/", ".").replace(".", "/", 1) for name in names]


def has(message: object, fields: list[str]) -> bool:
    """Whether a message has a field of fields, with an index or without."""
    for field in fields:
        name, _, index = field.partition("[")
        if not hasattr(message, name):
            return False
        message = getattr(message, name)
        if index and len(message) <= int(index.rstrip("]")):
            return False
    return True


def main() -> None:
    first: dict[str, object] = {}
    with open(sys.argv[1], "rb") as file:
        for _, channel, _, message in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            first.setdefault(channel.topic, message)
    wanted: list[str] = []
    for layout in map(Path, sys.argv[2:]):
        text = layout.read_text(encoding="utf-8")
        wanted += foxglove(json.loads(text)) if layout.suffix == ".json" else plotjuggler(ET.fromstring(text.encode()))
    missing = [path for path in wanted if not has(first.get(path.split(".")[0]), path.split(".")[1:]) or path.split(".")[0] not in first]
    print(json.dumps(sorted(set(missing))))


main()
