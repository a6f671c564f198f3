#!/bin/sh
# Needle driver, twin and guard without a ROS installation: inserts the needle under supervision, then ends.
#   launch-scripts/guarded_insertion.sh [parameters of the guard, such as -p goal_depth_m:=0.008]
# Programs are taken from PROGRAMS (default: target/release of this checkout).
set -eu
here=$(CDPATH= cd -- "$(dirname -- "$0")" && pwd)
programs=${PROGRAMS:-$here/../target/release}

"$programs/rig_node" --ros-args --params-file "$here/parameters/rig_driver.yaml" &
rig=$!
"$programs/twin_node" --ros-args --params-file "$here/parameters/twin.yaml" &
twin=$!
trap 'kill -INT "$rig" "$twin" 2>/dev/null || true; wait "$rig" "$twin" 2>/dev/null || true' EXIT INT TERM
"$programs/needle_twin" guard --ros-args --params-file "$here/parameters/guard.yaml" "$@"
