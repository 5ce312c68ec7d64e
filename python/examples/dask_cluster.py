"""Runs recordings on a Dask cluster, one per task: python dask_cluster.py SCHEDULER OUT RECORDING.."""

import sys
from pathlib import Path

from dask.distributed import Client, as_completed

import stillpoint_slam as sp

scheduler, out, *recordings = sys.argv[1:]
with Client(scheduler) as client:
    runs = [client.submit(sp.batch, path, Path(out) / Path(path).stem, workers=1, progress=False, key=path) for path in recordings]
    for run in as_completed(runs):
        print(run.result()[0]["name"], run.result()[0]["outcome"])
rows = sp.batch_merge((Path(out) / Path(path).stem for path in recordings), Path(out) / "all")
print(rows)
