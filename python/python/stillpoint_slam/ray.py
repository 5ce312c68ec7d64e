"""Recordings on a Ray cluster: ``pip install stillpoint-slam[ray]``.

>>> from stillpoint_slam import ray as sp_ray                                       # doctest: +SKIP
>>> rows = sp_ray.batch(["s3://bucket/a.mcap", "s3://bucket/b.mcap"], "s3://bucket/results")  # doctest: +SKIP
>>> rows.to_pandas()                                                                # doctest: +SKIP

Actors keep their detector between recordings. Ray restarts killed actors and reassigns their work; results are stored atomically and
identified by input, configuration and program, so finished recordings are not repeated. Progress is that of ``ray.data``; the metrics
``stillpoint_*`` are in Ray's dashboard.
"""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import pyarrow as pa
import ray
import ray.data
from ray.util import metrics

from . import _native
from ._batch import _config
from ._native import Config, Detector
from ._places import Results, Source, is_url, name_of
from ._run import run

#: Columns of the data set: those of ``batch.parquet``.
COLUMNS = pa.schema(
    [(name, pa.string()) for name in ("name", "input", "folder", "outcome", "error")]
    + [("attempts", pa.int64()), ("seconds", pa.float64()), ("input_bytes", pa.int64())]
    + [(name, pa.int64()) for name in ("frames", "skipped", "tracked")]
    + [("tracked_share", pa.float64())]
    + [(name, pa.int64()) for name in ("lost_stretches", "submaps", "keyframes", "landmarks", "loops")]
    + [("ate_rmse", pa.float64()), ("rpe_rmse", pa.float64()), ("peak_memory_bytes", pa.int64())]
    + [(name, pa.string()) for name in ("input_sha256", "stillpoint", "program_sha256", "configuration_sha256")]
)

#: Maximum attempts per recording, and worker deaths it may cause.
ATTEMPTS, DEATHS = 2, 3


def batch(
    paths: Iterable[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    *,
    workers: int | None = None,
    cpus: float = 1.0,
    memory: float = 2e9,
    disk: float = 50e9,
    time_limit: float | None = None,
    camera: str | None = None,
    config: Config | str | os.PathLike[str] | Mapping[str, Any] | None = None,
    detector: str | os.PathLike[str] | None = None,
    dense: bool | float = False,
    report: bool = True,
    start: int = 0,
    max_frames: int | None = None,
    storage_options: Mapping[str, Any] | None = None,
) -> ray.data.Dataset:
    """Runs recordings on a Ray cluster, and returns their rows as a data set.

    Args:
        paths: recordings and data set folders: paths accessible to every node, or URLs (``s3://``, ``gs://``, ``file://``), which each worker
            downloads one at a time and then removes.
        out: folder of the results, accessible to every node, or a URL. Recordings with existing results are skipped.
        workers: number of actors; None for as many as the cluster can run, starting with one.
        cpus, memory: resources reserved per actor: cores, and bytes (a run with 640x480 px and a detector stays below the default for about
            ten minutes of video).
        disk: maximum size of a downloaded recording, bytes.
        time_limit: maximum duration of a run, s.
        camera, config, dense, report, start, max_frames: as for :func:`stillpoint_slam.run`.
        detector: as for ``--detector``, for all recordings.
        storage_options: options of ``fsspec`` for the servers.

    Returns:
        One row per recording; ``outcome`` is ``ok``, ``lost`` or ``failed``, and ``error`` is the reason. Evaluated lazily: Ray starts when rows are
        read.

    Raises:
        ValueError: no recordings, or two whose results would have the same name.
    """
    all_paths = [os.fspath(p) for p in paths]
    options = {
        "camera": camera,
        "config": None if config is None else _config(config).to_toml(),
        "detector": None if detector is None else os.fspath(detector),
        "dense": dense,
        "report": report,
        "start": start,
        "max_frames": max_frames,
    }
    target = os.fspath(out)
    items = _items(all_paths)
    rows = ray.data.from_items(items, override_num_blocks=len(items))
    # The pool grows only if actors queue more than one recording.
    pool = {"size": workers} if workers else {"min_size": 1}
    return rows.map_batches(
        Recordings,
        fn_constructor_kwargs={
            "out": target if is_url(target) else os.path.abspath(target),
            "options": options,
            "limits": (disk, time_limit, cpus),
            "storage_options": dict(storage_options or {}),
        },
        compute=ray.data.ActorPoolStrategy(**pool, max_tasks_in_flight_per_actor=2),
        batch_size=1,
        batch_format="pyarrow",
        num_cpus=cpus,
        memory=memory,
    )


def _items(paths: list[str]) -> list[dict[str, str]]:
    if not paths:
        raise ValueError("paths: expected recordings, found none")
    names: dict[str, str] = {}
    for path in paths:
        other = names.setdefault(name_of(path), path)
        if other != path:
            raise ValueError(f"paths: expected recordings whose results have different names, found {other} and {path}, both {name_of(path)}")
    return [{"name": name, "path": path} for name, path in names.items()]


class Recordings:
    """An actor: keeps its detector, and runs recordings one after another."""

    def __init__(self, out: str, options: Mapping[str, Any], limits: tuple[float, float | None, float], storage_options: Mapping[str, Any]) -> None:
        self._out, self._options, self._storage = out, dict(options), storage_options
        self._disk, self._time_limit, cpus = limits
        # Threads per frame: other actors need the remaining cores.
        os.environ["STILLPOINT_WORKERS"] = str(max(1, int(cpus)))
        named = self._options.pop("detector")
        self._detector = None if named is None else Detector(named)
        self._method = _method(options)
        with tempfile.TemporaryDirectory() as folder:
            text = self._options.pop("config")
            file = Path(folder) / "config.toml"
            file.write_text(text or "", encoding="utf-8")
            self._config = Config(file=file)
        self._recordings = metrics.Counter("stillpoint_recordings", "Recordings that came to an end.", ("outcome",))
        self._frames = metrics.Counter("stillpoint_frames", "Frames that went through.")
        self._rate = metrics.Gauge("stillpoint_frames_per_second", "Frames per second of the last recording of each worker.", ("worker",))

    def __call__(self, items: pa.Table) -> pa.Table:
        return pa.Table.from_pylist([self._row(**item) for item in items.to_pylist()], COLUMNS)

    def _row(self, name: str, path: str) -> dict[str, Any]:
        results = Results(self._out, name, self._storage)
        row: dict[str, Any] = {"name": name, "input": path, "folder": results.folder, "outcome": "failed", "attempts": 0, "seconds": 0.0, **self._method}
        try:
            source = Source(path, self._storage)
        except Exception as e:
            return self._counted({**row, "error": f"{path}: {e}"})
        row.update(input_sha256=source.sha256, input_bytes=source.bytes)
        known = json.loads(results.read("recording.json") or "{}")
        if all(known.get(column) == value for column, value in [*self._method.items(), ("input_sha256", source.sha256)]):
            return {**row, **{column: known.get(column) for column in COLUMNS.names}, "folder": results.folder}
        deaths = int(results.read("started") or 0)
        if deaths >= DEATHS:
            # Lets the next batch try again.
            results.remove("started")
            return self._counted({**row, "attempts": deaths, "error": f"its worker died {deaths} times"})
        results.write("started", str(deaths + 1))
        results.remove("recording.json")
        for attempt in range(1, ATTEMPTS + 1):
            row["attempts"], begin = attempt, time.monotonic()
            try:
                row.update(self._run(source, results), error=None)
                row["seconds"] = time.monotonic() - begin
                results.write("recording.json", json.dumps(row, indent=2) + "\n")
                break
            except Exception as e:
                row.update(seconds=time.monotonic() - begin, error=str(e) or type(e).__name__)
        results.remove("started")
        return self._counted(row)

    def _run(self, source: Source, results: Results) -> dict[str, Any]:
        """Runs once; returns the figures of the row."""
        with source.local(self._disk) as path, results.filling() as folder:
            run(path, config=self._config, detector=self._detector, out=folder, progress=False, time_limit=self._time_limit, **self._options)
            return figures(json.loads((folder / "summary.json").read_text(encoding="utf-8")))

    def _counted(self, row: dict[str, Any]) -> dict[str, Any]:
        self._recordings.inc(tags={"outcome": row["outcome"]})
        if frames := row.get("frames"):
            self._frames.inc(frames)
            self._rate.set(frames / max(row["seconds"], 1e-3), tags={"worker": str(os.getpid())})
        return row


def _method(options: Mapping[str, Any]) -> dict[str, str]:
    """Digests of everything else that results depend on: program and arguments."""
    told = hashlib.sha256(json.dumps(dict(options), sort_keys=True).encode())
    for name in ("detector", "camera"):
        file = Path((options[name] or "").removeprefix("scripted:"))
        if file.is_file():
            told.update(file.read_bytes())
    program = hashlib.sha256(Path(_native.__file__).read_bytes())
    return {"stillpoint": _native.__version__, "program_sha256": program.hexdigest(), "configuration_sha256": told.hexdigest()}


def figures(summary: Mapping[str, Any]) -> dict[str, Any]:
    """The columns derived from a run's ``summary.json``."""
    final = (summary.get("accuracy") or {}).get("final", {})
    rpe = final.get("rpe")
    error = final.get("ate") or final.get("drift")
    return {
        "outcome": "lost" if summary["lost"] else "ok",
        "frames": summary["frames"],
        "skipped": summary["skipped"],
        "tracked": summary["tracked"],
        "tracked_share": summary["tracked"] / max(summary["frames"], 1),
        "lost_stretches": len(summary["lost"]),
        "submaps": len(summary["submaps"]),
        "keyframes": summary["keyframes"],
        "landmarks": summary["landmarks"],
        "loops": summary["loops"]["closed"],
        "ate_rmse": error and error["rmse"],
        "rpe_rmse": rpe and rpe["translation"]["rmse"],
        "peak_memory_bytes": summary.get("peak_memory_bytes"),
    }
