#!/bin/sh
# Needle driver and twin without a ROS installation, until Ctrl-C: publish servo_jp (sensor_msgs/JointState) to move.
#   launch-scripts/closed_loop.sh [arguments of twin_node]
# Programs are taken from PROGRAMS (default: target/release of this checkout).
set -eu
here=$(CDPATH= cd -- "$(dirname -- "$0")" && pwd)
programs=${PROGRAMS:-$here/../target/release}

"$programs/rig_node" --ros-args --params-file "$here/parameters/rig_driver.yaml" &
rig=$!
trap 'kill -INT "$rig" 2>/dev/null || true; wait "$rig" 2>/dev/null || true' EXIT INT TERM
"$programs/twin_node" "$@" --ros-args --params-file "$here/parameters/twin.yaml"
