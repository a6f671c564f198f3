#!/bin/sh
# Needle driver and twin without a ROS installation, until Ctrl-C: publish servo_jp (sensor_msgs/JointState) to move.
#   launch-scripts/closed_loop.sh [arguments of twin_node]
# Programs are taken from PROGRAMS (default: target/release of this checkout).
set -eu
here=$(CDPATH= cd -- "$(dirname -- "$0")" && pwd)
programs=${PROGRAMS:-$here/../target/release}
# The node of a name: the program, or the same of needle_twin, which `cargo run --release` has built.
node() {
    name=$1
    shift
    if [ -x "$programs/$name" ]; then
        exec "$programs/$name" "$@"
    elif [ -x "$programs/needle_twin" ]; then
        exec "$programs/needle_twin" "$(echo "$name" | tr _ -)" "$@"
    fi
    echo "error: no $name in $programs: run cargo build --release first, or set PROGRAMS" >&2
    exit 1
}

node rig_node --ros-args --params-file "$here/parameters/rig_driver.yaml" &
rig=$!
trap 'kill -INT "$rig" 2>/dev/null || true; wait "$rig" 2>/dev/null || true' EXIT INT TERM
(node twin_node "$@" --ros-args --params-file "$here/parameters/twin.yaml")
