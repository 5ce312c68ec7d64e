"""``stillpoint_slam.ray`` on a local cluster of two nodes with an S3 server: results equal those of serial runs, even if workers die."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from test_batch import serial, simulated

import stillpoint_slam as sp

ray = pytest.importorskip("ray", reason="ray is not there")
pytest.importorskip("pyarrow", reason="pyarrow is not there")
cluster_utils = pytest.importorskip("ray.cluster_utils", reason="ray cannot make clusters here")

#: Memory reserved per worker, bytes.
MEMORY = 1e9
#: Number of recordings, and frames of each.
RECORDINGS, FRAMES = 40, 8


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    made = cluster_utils.Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "memory": 4e9, "object_store_memory": 100e6})
    made.add_node(num_cpus=1, memory=4e9, object_store_memory=100e6)
    ray.init(address=made.address, log_to_driver=False, configure_logging=False)
    ray.data.DataContext.get_current().enable_progress_bars = False
    yield made
    ray.shutdown()
    made.shutdown()


@pytest.fixture(scope="module")
def rooms(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return simulated(tmp_path_factory.mktemp("rooms"), [FRAMES] * RECORDINGS)


@pytest.fixture(scope="module")
def expected(rooms: list[Path], tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    out = tmp_path_factory.mktemp("serial")
    return {path.name: serial(path, out / path.name) for path in rooms}


@pytest.fixture
def bucket(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[str, dict[str, Any]]]:
    """A bucket of a local S3 server, with options for ``fsspec``."""
    server = pytest.importorskip("moto.server", reason="moto is not there")
    s3fs = pytest.importorskip("s3fs", reason="s3fs is not there")
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        monkeypatch.setenv(name, "test")
    moto = server.ThreadedMotoServer("127.0.0.1", port=0, verbose=False)
    moto.start()
    host, port = moto.get_host_and_port()
    options = {"key": "test", "secret": "test", "endpoint_url": f"http://{host}:{port}"}
    s3fs.S3FileSystem(**options).mkdir("recordings")
    yield "s3://recordings", options
    moto.stop()


def batch(paths: list[Any], out: Any, **options: Any) -> list[dict[str, Any]]:
    from stillpoint_slam import ray as sp_ray

    rows = sp_ray.batch(paths, out, memory=MEMORY, report=False, **options).take_all()
    return sorted(rows, key=lambda row: row["name"])


def check(rows: list[dict[str, Any]], out: Path, expected: dict[str, bytes]) -> None:
    assert [(row["name"], row["outcome"], row["error"]) for row in rows] == [(name, "ok", None) for name in sorted(expected)]
    for row in rows:
        assert (out / row["name"] / "trajectory.txt").read_bytes() == expected[row["name"]], row["name"]
        assert 0 < row["peak_memory_bytes"] < MEMORY, row


def test_cluster_runs_equal_serial_runs(cluster: Any, rooms: list[Path], expected: dict[str, bytes], tmp_path: Path) -> None:
    from stillpoint_slam.ray import COLUMNS

    rows = batch(rooms, tmp_path)
    check(rows, tmp_path, expected)
    assert list(rows[0]) == COLUMNS.names
    # Finished recordings are not repeated.
    times = [(tmp_path / row["name"] / "summary.json").stat().st_mtime_ns for row in rows]
    assert batch(rooms, tmp_path) == rows
    assert times == [(tmp_path / row["name"] / "summary.json").stat().st_mtime_ns for row in rows]


def test_columns_equal_those_of_the_command_line_table(rooms: list[Path], tmp_path: Path) -> None:
    from stillpoint_slam.ray import COLUMNS

    parquet = pytest.importorskip("pyarrow.parquet")
    sp.batch(rooms[0], tmp_path, detector="none", report=False, progress=False)
    assert parquet.read_schema(tmp_path / "batch.parquet").equals(COLUMNS)


def test_recordings_and_results_use_remote_storage(
    cluster: Any, rooms: list[Path], expected: dict[str, bytes], bucket: tuple[str, dict[str, Any]], tmp_path: Path
) -> None:
    import fsspec

    url, options = bucket
    fs = fsspec.filesystem("s3", **options)
    some = rooms[:4]
    for path in some:
        fs.put(str(path), f"recordings/in/{path.name}", recursive=True)
    paths = [f"{url}/in/{path.name}" for path in some]
    rows = batch(paths, f"{url}/out", storage_options=options)
    assert [row["outcome"] for row in rows] == ["ok"] * len(some), rows
    for path in some:
        assert fs.cat_file(f"recordings/out/{path.name}/trajectory.txt") == expected[path.name]
    fetched = Path("/tmp") / "stillpoint-fetched"
    assert not fetched.exists() or not list(fetched.iterdir())
    assert batch(paths, f"{url}/out", storage_options=options) == rows
    # One too large, and one missing.
    rows = batch([paths[0], f"{url}/in/none"], tmp_path, storage_options=options, disk=1000.0)
    assert [row["outcome"] for row in rows] == ["failed"] * 2
    assert "fits into disk=1e+03" in rows[1]["error"] and "none" in rows[0]["error"]
    file = f"file://{some[0]}"
    assert batch([file], tmp_path / "file")[0]["outcome"] == "ok"
    assert (tmp_path / "file" / some[0].name / "trajectory.txt").read_bytes() == expected[some[0].name]


def test_failed_recordings_do_not_affect_others(cluster: Any, rooms: list[Path], tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    rows = batch([tmp_path / "empty", rooms[0]], tmp_path / "out")
    assert [(row["name"], row["outcome"], row["attempts"]) for row in rows] == [("empty", "failed", 2), ("room0", "ok", 1)]
    late = batch([rooms[0]], tmp_path / "late", time_limit=0.001)
    assert late[0]["error"] == "took longer than 0.001 s"


def test_killed_worker_is_recovered(cluster: Any, rooms: list[Path], expected: dict[str, bytes], tmp_path: Path) -> None:
    killed = during(rooms, tmp_path, 2, lambda pid: os.kill(pid, signal.SIGKILL))
    check(killed, tmp_path, expected)


def test_killed_node_is_recovered(cluster: Any, rooms: list[Path], expected: dict[str, bytes], tmp_path: Path) -> None:
    node = cluster.add_node(num_cpus=1, memory=4e9, object_store_memory=100e6)
    # A worker on each of three nodes; removing a node kills its worker.
    rows = during(rooms, tmp_path, 3, lambda pid: cluster.remove_node(node, allow_graceful=False))
    check(rows, tmp_path, expected)


def during(rooms: list[Path], out: Path, workers: int, kill: Any) -> list[dict[str, Any]]:
    """A batch during which ``kill`` is called with the process id of a worker."""
    with ThreadPoolExecutor(1) as pool:
        done = pool.submit(batch, rooms, out, workers=workers)
        end = time.monotonic() + 120
        while not (len(pids := workers_now()) == workers and len(list(out.glob("*/recording.json"))) >= 3):
            assert time.monotonic() < end and not done.done(), (pids, done)
            time.sleep(0.05)
        kill(pids[0])
        rows = done.result()
    return rows


def workers_now() -> list[int]:
    return [int(pid) for pid in os.listdir("/proc") if pid.isdigit() and b"Recordings" in command(pid)]


def command(pid: str) -> bytes:
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return b""


def test_duplicate_names_are_refused_before_any_run(tmp_path: Path) -> None:
    from stillpoint_slam import ray as sp_ray

    with pytest.raises(ValueError, match="both walk"):
        sp_ray.batch(["/a/walk", "/b/walk"], tmp_path)
    with pytest.raises(ValueError, match="found none"):
        sp_ray.batch([], tmp_path)
