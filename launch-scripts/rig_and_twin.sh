#!/bin/sh
# Rig and twin without a ROS installation: plays a recording through the twin until it ends or Ctrl-C.
#   launch-scripts/rig_and_twin.sh [BAG] [-- more arguments of twin_node]
# Programs are taken from PROGRAMS (default: target/release of this checkout).
set -eu
here=$(CDPATH= cd -- "$(dirname -- "$0")" && pwd)
programs=${PROGRAMS:-$here/../target/release}
bag=$here/../bags/needle_insertion
if [ $# -gt 0 ] && [ "$1" != "--" ]; then
    bag=$1
    shift
fi
[ $# -gt 0 ] && shift

"$programs/twin_node" "$@" --ros-args --params-file "$here/parameters/twin.yaml" -p use_sim_time:=true &
twin=$!
trap 'kill -INT "$twin" 2>/dev/null || true; wait "$twin" 2>/dev/null || true' EXIT INT TERM
# The model is built meanwhile.
"$programs/rig_node" "$bag" --ros-args --params-file "$here/parameters/rig_player.yaml" -p delay:=8.0
