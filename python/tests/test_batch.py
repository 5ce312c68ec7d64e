"""``batch`` from Python, and the examples for Dask and submitit on local clusters."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from pathlib import Path

import pytest

import stillpoint_slam as sp

EXAMPLES = Path(__file__).parents[1] / "examples"


def simulated(folder: Path, frames: list[int]) -> list[Path]:
    """Recordings of rooms with the given numbers of frames."""
    paths = []
    for i, n in enumerate(frames):
        path = folder / f"room{i}"
        command = ["simulate", "--scene", ("xyz", "halfsphere")[i % 2], "--frames", n, "--seed", i, "--jpeg", "--out", path, "-q"]
        subprocess.run([sys.executable, "-m", "stillpoint_slam", *map(str, command)], check=True)
        paths.append(path)
    return paths


def serial(path: Path, out: Path, *options: object) -> bytes:
    """The trajectory of a run by the command line."""
    command = ["run", path, "--detector", "none", "--no-report", "-q", "--out", out, *options]
    done = subprocess.run([sys.executable, "-m", "stillpoint_slam", *map(str, command)])
    assert done.returncode in (0, 1)
    return (out / "trajectory.txt").read_bytes()


def test_batch_equals_serial_runs_and_is_not_repeated(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    paths = simulated(tmp_path / "in", [6, 5])
    options = {"config": {"tracking.min_inliers": 31}, "detector": "none", "report": False, "workers": 2}
    done = sp.batch(paths, tmp_path / "out", **options)
    assert repr(done) == "<Batch: 2 recordings>" and not done.failed and done.skipped == 0
    assert [row["name"] for row in done] == ["room0", "room1"]
    assert "2 workers on" in capfd.readouterr().err
    for path, row in zip(paths, done, strict=True):
        expected = serial(path, tmp_path / "serial", "--set", "tracking.min_inliers=31")
        assert (done.folder / row["folder"] / "trajectory.txt").read_bytes() == expected
    again = sp.batch(tmp_path / "in" / "*", tmp_path / "out", **options, progress=False)
    assert again.skipped == 2 and list(again) == list(done)
    assert not capfd.readouterr().err
    # The digest is that of the library, not of the interpreter.
    assert done[0]["program_sha256"] == hashlib.sha256(Path(sp._native.__file__).read_bytes()).hexdigest()


def test_failures_are_reported_and_bad_arguments_refused(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    done = sp.batch(tmp_path / "empty", tmp_path / "out", progress=False)
    assert repr(done) == "<Batch: 1 recordings, 1 without a result>"
    assert done.failed[0]["attempts"] == 2 and "empty" in done.failed[0]["error"]
    for inputs, options, words in [
        ([], {}, "inputs: expected recordings"),
        ("no/*.mcap", {}, "found none that does"),
        ("a\nb", {}, "without line breaks"),
        (tmp_path, {"shard": (3, 2)}, "from 1 to 2"),
        (tmp_path, {"config": {"no.such": 1}}, "no.such"),
    ]:
        with pytest.raises(ValueError, match=words):
            sp.batch(inputs, tmp_path / "never", progress=False, **options)
    assert not (tmp_path / "never").exists()


def test_shards_are_joined(tmp_path: Path) -> None:
    paths = simulated(tmp_path / "in", [4, 4, 4])
    folders = [tmp_path / str(i) for i in (1, 2)]
    for i, folder in enumerate(folders):
        sp.batch(paths, folder, shard=(i + 1, 2), detector="none", progress=False)
    joined = sp.batch_merge(folders, tmp_path / "all", progress=False)
    assert [row["name"] for row in joined] == ["room0", "room1", "room2"]
    with pytest.raises(ValueError, match="name each batch once"):
        sp.batch_merge([folders[0], folders[0]], tmp_path / "all", progress=False)


def test_batch_table_is_readable_by_arrow(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    done = sp.batch(simulated(tmp_path / "in", [5]), tmp_path / "out", detector="none", progress=False)
    rows = parquet.read_table(tmp_path / "out" / "batch.parquet").to_pylist()
    assert rows == [dict(row) for row in done]


def example(name: str, *arguments: object) -> None:
    """Runs an example with this interpreter."""
    done = subprocess.run([sys.executable, str(EXAMPLES / name), *map(str, arguments)], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr


def test_dask_example(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    paths = simulated(tmp_path / "in", [5, 4])
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        example("dask_cluster.py", cluster.scheduler_address, tmp_path / "out", *paths)
    check_all(paths, tmp_path)


def test_submitit_example(tmp_path: Path) -> None:
    pytest.importorskip("submitit")
    paths = simulated(tmp_path / "in", [5, 4])
    example("slurm.py", 2, tmp_path / "out", *paths)
    check_all(paths, tmp_path)


def check_all(paths: list[Path], folder: Path) -> None:
    table = json.loads((folder / "out" / "all" / "batch.json").read_text())
    assert [row["outcome"] for row in table["recordings"]] == ["ok"] * len(paths)
    for path, row in zip(paths, table["recordings"], strict=True):
        result = folder / "out" / "all" / row["folder"] / "trajectory.txt"
        assert result.read_bytes() == serial(path, folder / "serial")


def test_loaded_detector_is_reused_across_runs(tmp_path: Path) -> None:
    room = tmp_path / "room"
    command = ["simulate", "--scene", "walking_xyz", "--frames", "20", "--jpeg", "--out", str(room), "-q"]
    subprocess.run([sys.executable, "-m", "stillpoint_slam", *command], check=True)
    named = f"scripted:{room / 'detections.csv'}"
    kept = sp.Detector(named)
    assert repr(kept) == f"Detector('{named}')"
    texts = [sp.run(room, detector=detector, progress=False).trajectory.to_tum() for detector in (named, kept, kept)]
    assert texts[0] == texts[1] == texts[2]
    with pytest.raises(ValueError, match="name: "):
        sp.Detector("scripted:" + str(tmp_path / "none.csv"))
    with pytest.raises(TimeoutError, match="longer than"):
        sp.run(room, progress=False, time_limit=1e-6)
