#!/bin/sh
# Runs the shards of a manifest with HyperQueue, and puts their rows together.
#
# usage: hyperqueue.sh MANIFEST OUT [SHARDS]
# needs: a server and workers (`hq server start`, `hq worker start`); OUT on a disk that all workers see.
set -eu
manifest=$(realpath "$1") out=$(realpath -m "$2") shards=${3:-64}
program=$(command -v "${NEEDLE_TWIN:-needle_twin}")
# exit code 3: done, and some recordings failed; their rows say why
hq submit --array "1-$shards" --crash-limit 3 --wait --stdout none -- sh -c \
    '"$0" batch "$1" --out "$2/rows" --shard "$HQ_TASK_ID/$3" --threads 1 || test $? -eq 3' \
    "$program" "$manifest" "$out" "$shards"
exec "$program" batch merge "$out/rows" --out "$out"
