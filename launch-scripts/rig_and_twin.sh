#!/bin/sh
# Rig and twin without a ROS installation: plays a recording through the twin until it ends or Ctrl-C.
#   launch-scripts/rig_and_twin.sh [BAG] [-- more arguments of twin_node]
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
bag=$here/../bags/needle_insertion
if [ $# -gt 0 ] && [ "$1" != "--" ]; then
    bag=$1
    shift
fi
[ $# -gt 0 ] && shift

node twin_node "$@" --ros-args --params-file "$here/parameters/twin.yaml" -p use_sim_time:=true &
twin=$!
trap 'kill -INT "$twin" 2>/dev/null || true; wait "$twin" 2>/dev/null || true' EXIT INT TERM
# The model is built meanwhile.
(node rig_node "$bag" --ros-args --params-file "$here/parameters/rig_player.yaml" -p delay:=8.0)
