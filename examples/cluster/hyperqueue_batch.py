"""Runs the shards of a manifest, or of the study of accuracy, with HyperQueue, and puts their rows together.

usage: hyperqueue_batch.py MANIFEST|study OUT [--shards N] [--server DIR] [--program needle_twin]

needs: pip install hyperqueue; OUT on a disk that all workers see. Without --server (the folder of a running server) a
server and two workers are started here. A shard whose worker dies is run again; it goes on from the rows that are there.
"""

import argparse
import os
import subprocess
from pathlib import Path

# Exit code 3: done, and some recordings failed; their rows say why.
RUN = 'out=$1 shard=$2; shift 2; "$0" "$@" --out "$out/rows" --shard "$shard" --threads 1 || test $? -eq 3'


def command(manifest):
    """What is run in shards, and what joins them."""
    if manifest == "study":
        return ["study", "accuracy"], ["study", "merge"]
    return ["batch", os.path.abspath(manifest)], ["batch", "merge"]


def submit(client, program, manifest, out, shards):
    """All shards as tasks of one job; waits for them."""
    from hyperqueue import Job

    # tasks run in folders of their own, so every path is a whole one
    what, out = command(manifest)[0], os.path.abspath(out)
    job = Job(max_fails=0)
    for number in range(1, shards + 1):
        log = Path(out, "logs", str(number))
        shard = f"{number}/{shards}"
        job.program(["sh", "-c", RUN, program, out, shard, *what], stdout=f"{log}.out", stderr=f"{log}.err")
    client.wait_for_jobs([client.submit(job)])


def main():
    from hyperqueue import Client, LocalCluster
    from hyperqueue.cluster import WorkerConfig

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("manifest")
    parser.add_argument("out")
    parser.add_argument("--shards", type=int, default=64)
    parser.add_argument("--server")
    parser.add_argument("--program", default="needle_twin")
    a = parser.parse_args()
    if a.server:
        submit(Client(a.server), a.program, a.manifest, a.out, a.shards)
    else:
        with LocalCluster() as cluster:
            for _ in range(2):
                cluster.start_worker(WorkerConfig(cores=1))
            submit(cluster.client(), a.program, a.manifest, a.out, a.shards)
    merge = [a.program, *command(a.manifest)[1], f"{a.out}/rows", "--out", a.out]
    raise SystemExit(subprocess.run(merge, check=False).returncode)


if __name__ == "__main__":
    main()
