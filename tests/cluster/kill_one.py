"""Runs the shards on two Dask workers, of which one is killed in the middle.

usage: kill_one.py FOLDER_OF_EXAMPLES PROGRAM MANIFEST OUT SHARDS
Prints the process numbers of the workers before and after.
"""

import os
import signal
import sys

sys.path.insert(0, sys.argv[1])
import dask_batch  # noqa: E402
from dask.distributed import Client, LocalCluster, as_completed  # noqa: E402

if __name__ == "__main__":
    program, manifest, out, shards = sys.argv[2:5] + [int(sys.argv[5])]
    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
        with Client(cluster) as client:
            before = sorted(client.run(os.getpid).values())
            futures = dask_batch.submit(client, program, manifest, out, shards)
            # one shard is done, so both workers are at work on others
            next(iter(as_completed(futures)))
            os.kill(before[0], signal.SIGKILL)
            codes = client.gather(futures)
            after = sorted(client.run(os.getpid).values())
    assert len(codes) == shards, codes
    assert before[0] not in after, (before, after)
    dask_batch.merge(program, out)
    print(before, after)
