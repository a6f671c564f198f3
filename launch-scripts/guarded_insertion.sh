#!/bin/sh
# Needle driver, twin and guard without a ROS installation: inserts the needle under supervision, then ends.
#   launch-scripts/guarded_insertion.sh [parameters of the guard, such as -p goal_depth_m:=0.008]
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
node twin_node --ros-args --params-file "$here/parameters/twin.yaml" &
twin=$!
trap 'kill -INT "$rig" "$twin" 2>/dev/null || true; wait "$rig" "$twin" 2>/dev/null || true' EXIT INT TERM
"$programs/needle_twin" guard --ros-args --params-file "$here/parameters/guard.yaml" "$@"
