"""Runs the shards of a manifest, or of the study of accuracy, on a Dask cluster, and puts their rows together.

usage: dask_batch.py MANIFEST|study OUT [--shards N] [--scheduler tcp://HOST:8786] [--program needle_twin]

needs: pip install "dask[distributed]"; OUT on a disk that all workers see, and needle_twin on each.
Without --scheduler two worker processes are started here. A shard whose worker dies is run again elsewhere; it finds
the rows that were done before and goes on from there.
"""

import argparse
import subprocess

# 0: all done. 3: done, and some recordings failed: their rows say why, and running them again would not help.
DONE = (0, 3)


def command(manifest):
    """What is run in shards, and what joins them."""
    if manifest == "study":
        return ["study", "accuracy"], ["study", "merge"]
    return ["batch", manifest], ["batch", "merge"]


def run_shard(program, manifest, rows, number, shards):
    """One shard, on one core of whatever worker it lands on; gives its exit code."""
    shard = ["--shard", f"{number}/{shards}", "--threads", "1"]
    code = subprocess.run([program, *command(manifest)[0], "--out", rows, *shard], check=False).returncode
    if code not in DONE:
        raise RuntimeError(f"shard {number}/{shards} ended with exit code {code}")
    return code


def submit(client, program, manifest, out, shards):
    """All shards as tasks of the cluster."""
    numbers = range(1, shards + 1)
    # a row is a pure function of its recording, so the cluster may run one again
    return client.map(lambda n: run_shard(program, manifest, f"{out}/rows", n, shards), numbers, retries=3, pure=False)


def merge(program, out, manifest=""):
    """Tables and page from the rows."""
    return subprocess.run([program, *command(manifest)[1], f"{out}/rows", "--out", out], check=False).returncode


def main():
    from dask.distributed import Client, LocalCluster

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("manifest")
    parser.add_argument("out")
    parser.add_argument("--shards", type=int, default=64)
    parser.add_argument("--scheduler")
    parser.add_argument("--program", default="needle_twin")
    a = parser.parse_args()
    cluster = a.scheduler or LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None)
    with Client(cluster) as client:
        client.gather(submit(client, a.program, a.manifest, a.out, a.shards))
    raise SystemExit(merge(a.program, a.out, a.manifest))


if __name__ == "__main__":
    main()
