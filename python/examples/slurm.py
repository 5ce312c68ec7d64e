"""Runs recordings on a Slurm cluster, a shard per job: python slurm.py JOBS OUT RECORDING.."""

import sys
from pathlib import Path

import submitit

import stillpoint_slam as sp

jobs, out, recordings = int(sys.argv[1]), Path(sys.argv[2]), sys.argv[3:]
executor = submitit.AutoExecutor(folder=out / "logs")
executor.update_parameters(cpus_per_task=8, mem_gb=16, timeout_min=24 * 60)
with executor.batch():
    shares = [executor.submit(sp.batch, recordings, out / str(i), shard=(i, jobs), progress=False) for i in range(1, jobs + 1)]
print([share.result() for share in shares])
print(sp.batch_merge((out / str(i) for i in range(1, jobs + 1)), out / "all"))
