"""Reads what the package installs with parsers that are not this project's; prints findings, one per line.

usage: package.py CHECKOUT
"""

import ast
import json
import re
import sys
import xml.etree.ElementTree as xml
from pathlib import Path

from rosbags.typesys import get_types_from_msg
from ruamel.yaml import YAML

root = Path(sys.argv[1])
cmake, scripts = (root / "CMakeLists.txt").read_text(), root / "launch-scripts"
findings = []


def load(path):
    return YAML(typ="safe").load(path.read_text())


def finding(condition, text):
    if not condition:
        findings.append(text)


# Messages: parsed by another implementation, listed in CMake, with every package that they use.
depends = {e.text for e in xml.parse(root / "package.xml").getroot() if e.tag in ("depend", "buildtool_depend")}
for path in (root / "msg").glob("*.msg"):
    types = get_types_from_msg(path.read_text(), f"needle_twin/msg/{path.stem}")
    finding(f"needle_twin/msg/{path.stem}" in types, f"{path.name} can't be parsed")
    finding(f"msg/{path.name}" in cmake, f"{path.name} is not in CMakeLists.txt")
    for package in set(re.findall(r"^(\w+)/\w+", path.read_text(), re.M)):
        finding(package in depends, f"{path.name} uses {package}, which package.xml does not name")
        finding(f"find_package({package} REQUIRED)" in cmake, f"{package} is not found in CMakeLists.txt")

# What others take: the profile of Fast DDS is XML, and nothing installs an empty folder.
profile = xml.parse(scripts / "fast_dds.xml").getroot()
finding(any(e.tag.endswith("receiveBufferSize") and int(e.text) >= 1 << 22 for e in profile.iter()), "fast_dds.xml: receiveBufferSize")
finding("fast_dds.xml" in cmake, "fast_dds.xml is not installed")
finding("FILES_MATCHING" not in cmake, "a folder is installed without what does not match in it")

# Services: both halves parsed as messages, listed in CMake.
for path in (root / "srv").glob("*.srv"):
    halves = path.read_text().split("\n---\n")
    finding(len(halves) == 2, f"{path.name} is not a request and a response")
    for half in halves:
        get_types_from_msg(half, f"needle_twin/msg/{path.stem}")
    finding(f"srv/{path.name}" in cmake, f"{path.name} is not in CMakeLists.txt")
    for package in set(re.findall(r"^(\w+)/\w+", path.read_text(), re.M)):
        finding(package in depends, f"{path.name} uses {package}, which package.xml does not name")

# Launch files: the three kinds say the same.
for stem in ("twin", "rig_and_twin"):
    tree = ast.parse((scripts / f"{stem}.launch.py").read_text())
    calls = [c for c in ast.walk(tree) if isinstance(c, ast.Call) and getattr(c.func, "id", "") == "DeclareLaunchArgument"]
    python = {c.args[0].value for c in calls}
    nodes = [c for c in ast.walk(tree) if isinstance(c, ast.Call) and getattr(c.func, "id", "") == "Node"]
    python_nodes = [next(k.value.value for k in n.keywords if k.arg == "executable") for n in nodes]
    markup = xml.parse(scripts / f"{stem}.launch.xml").getroot()
    tags = [(e.tag, e.get("name"), e.get("exec")) for e in markup]
    text = load(scripts / f"{stem}.launch.yaml")["launch"]
    for name, arguments, found in (
        ("xml", {n for tag, n, _ in tags if tag == "arg"}, [e for tag, _, e in tags if tag == "node"]),
        ("yaml", {e["arg"]["name"] for e in text if "arg" in e}, [e["node"]["exec"] for e in text if "node" in e]),
    ):
        finding(arguments == python, f"{stem}: arguments of {name} {arguments} and of py {python} differ")
        finding(found == python_nodes, f"{stem}: nodes of {name} {found} and of py {python_nodes} differ")
    silent = [e.get("name") for e in markup if e.tag == "arg" and not e.get("description")]
    silent += [e["arg"]["name"] for e in text if "arg" in e and not e["arg"].get("description")]
    finding(not silent, f"{stem}: no description of {silent} for --show-args")
    again = [(e.get("respawn"), e.get("respawn_delay")) for e in markup if e.tag == "node"]
    finding(again == [("$(var respawn)", "1.0")] + (len(again) - 1) * [(None, None)], f"{stem}.launch.xml: respawn {again}")
    again = [(e["node"].get("respawn"), e["node"].get("respawn_delay")) for e in text if "node" in e]
    finding(again == [("$(var respawn)", 1.0)] + (len(again) - 1) * [(None, None)], f"{stem}.launch.yaml: respawn {again}")

# A supervisor brings back the twin, if asked to, and no other node: a guard or a driver that starts anew would move.
for path in scripts.glob("*.launch.py"):
    calls = [c for c in ast.walk(ast.parse(path.read_text())) if isinstance(c, ast.Call)]
    named = lambda function: [c for c in calls if getattr(c.func, "id", "") == function]
    declared = {c.args[0].value: c.keywords[0].value for c in named("DeclareLaunchArgument")}
    for call in named("DeclareLaunchArgument"):
        said = any(k.arg == "description" and k.value.value for k in call.keywords)
        finding(said, f"{path.name}: {call.args[0].value} has no description for --show-args")
    default = declared.get("respawn")
    finding(isinstance(default, ast.Constant) and default.value == "false", f"{path.name}: respawn is not offered, or not off")
    for node in named("Node"):
        words = {k.arg: k.value for k in node.keywords}
        twin, again = words["executable"].value == "twin_node", "respawn" in words and "respawn_delay" in words
        finding(twin == again, f"{path.name}: {words['executable'].value}: respawn is {again}")

# Layouts: they can be parsed and name topics that the nodes have.
topics = {"tissue_surface", "tissue_points", "targets", "predicted_cf", "comparison", "measured_js", "status", "diagnostics"}
displays = load(scripts / "layouts/needle_twin.rviz")["Visualization Manager"]["Displays"]
named = [d["Topic"]["Value"] for d in displays if "Topic" in d]
fox = json.loads((scripts / "layouts/foxglove.json").read_text())
named += [t for c in fox["configById"].values() for t in c.get("topics", {})]
named += [p["value"].split(".")[0] for c in fox["configById"].values() for p in c.get("paths", [])]
named += [c.get("name").split("/")[1] for c in xml.parse(scripts / "layouts/plotjuggler.xml").getroot().iter("curve")]


def panels(layout):
    return [layout] if isinstance(layout, str) else panels(layout["first"]) + panels(layout["second"])


finding(sorted(panels(fox["layout"])) == sorted(fox["configById"]), "foxglove.json: layout and panels differ")
for topic in named:
    finding(topic.strip("/") in topics, f"a layout shows {topic}, which nobody publishes")

# The view: all of one tree of frames, and a robot whose links are those of the command.
view = {d["Name"]: d for d in displays}
finding(view["Frames"]["Class"] == "rviz_default_plugins/TF" and view["Frames"]["Enabled"], "needle_twin.rviz shows no frames")
description = view["Rig"]["Description Topic"]
finding(description["Value"] == "robot_description" and description["Durability Policy"] == "Transient Local", "needle_twin.rviz: Rig")
started = ast.parse((scripts / "view.launch.py").read_text())
words = [[k.value for k in c.keywords if k.arg == "executable"] for c in ast.walk(started) if getattr(getattr(c, "func", None), "id", "") == "Node"]
started = {w[0].value for w in words}
finding(started == {"twin_node", "rig_node", "robot_state_publisher", "rviz2", "foxglove_bridge"}, f"view.launch.py starts {started}")

# ros2_control: plugin, description, controllers and launch file name the same things, and what they need is declared.
control = root / "ros2_control"
source = (control / "src/sensor.cpp").read_text()
package = xml.parse(control / "package.xml").getroot()
needed = {e.text for e in package if e.tag.endswith("depend")}
for include in re.findall(r'^#include "(\w+)/', source, re.M):
    finding(include in needed | {"needle_twin_control"}, f"sensor.cpp includes {include}, which ros2_control/package.xml does not name")
for found in re.findall(r"find_package\((\w+)", (control / "CMakeLists.txt").read_text()):
    finding(found in needed, f"ros2_control/CMakeLists.txt finds {found}, which its package.xml does not name")
plugin = xml.parse(control / "needle_twin_control.xml").getroot().find("class")
exported = f"PLUGINLIB_EXPORT_CLASS({plugin.get('type')}, {plugin.get('base_class_type')})"
finding(exported in source and "needle_twin_control.xml" in (control / "CMakeLists.txt").read_text(), "the plugin is not exported as it is described")
robot = xml.parse(control / "urdf/mock_rig.urdf.xacro").getroot()
sensor = next(e for e in robot.iter("ros2_control") if e.get("type") == "sensor")
finding(sensor.find("hardware/plugin").text == plugin.get("name"), "mock_rig.urdf.xacro loads another plugin")
offered = [e.get("name") for e in sensor.iter("state_interface")]
finding(offered == re.findall(r'"([a-z.]+)"', source[source.index("kInterfaces{"):].split("}")[0]), f"mock_rig.urdf.xacro has the states {offered}")
for name in (e.get("name") for e in sensor.iter("param")):
    finding(f'parameter("{name}"' in source, f"mock_rig.urdf.xacro sets {name}, which the plugin does not read")
joint = next(e for e in robot.iter("ros2_control") if e.get("type") == "system").find("joint").get("name")
finding(joint in {e.get("name") for e in robot.findall("joint")}, f"mock_rig.urdf.xacro has no joint {joint}")
controllers = load(control / "config/controllers.yaml")
kinds = {name for name, value in controllers["controller_manager"]["ros__parameters"].items() if isinstance(value, dict)}
launched = (control / "launch/mock_rig.launch.py").read_text()
finding(kinds == set(re.findall(r'"(\w+_(?:broadcaster|controller))"', launched)), f"mock_rig.launch.py spawns others than {kinds}")
finding(controllers["predicted_force_broadcaster"]["ros__parameters"]["sensor_name"] == sensor.find("sensor").get("name"), "controllers.yaml: sensor_name")
finding(controllers["insertion_controller"]["ros__parameters"]["joints"] == [joint], "controllers.yaml: joints")
finding(f'"joint_name": "{joint}"' in launched, "mock_rig.launch.py: joint_name")
for package_name in set(re.findall(r'package="(\w+)"', launched)) - {"needle_twin_control"}:
    finding(package_name in needed, f"mock_rig.launch.py starts {package_name}, which ros2_control/package.xml does not name")
ast.parse(launched)

for path in (scripts / "parameters").glob("*.yaml"):
    finding("ros__parameters" in next(iter(load(path).values())), f"{path.name} has no ros__parameters")
print("\n".join(findings), end="")
