"""Measures batches: ``python measure_batch.py [--quick]`` prints the tables of docs/batch.md. On a loaded machine only the ratios are valid."""

from __future__ import annotations

import argparse
import os
import platform
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import stillpoint_slam as sp


def simulated(folder: Path, count: int, frames: int) -> list[Path]:
    """Recordings with `frames` frames each. The first 20 are simulated, the others are copies, which cost the same."""
    distinct = 20
    paths = [folder / f"r{i:04}" for i in range(count)]

    def simulate(i: int) -> None:
        command = ["simulate", "--scene", ("xyz", "halfsphere")[i % 2], "--frames", frames, "--seed", i, "--jpeg", "--out", paths[i], "-q"]
        subprocess.run([sys.executable, "-m", "stillpoint_slam", *map(str, command)], check=True)

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(simulate, (i for i, path in enumerate(paths[:distinct]) if not path.exists())))
    for i, path in enumerate(paths):
        if not path.exists():
            shutil.copytree(paths[i % distinct], path)
    return paths


def seconds(work: Callable[[], object]) -> float:
    begin = time.monotonic()
    work()
    return time.monotonic() - begin


def fresh(out: Path) -> Path:
    shutil.rmtree(out, ignore_errors=True)
    return out


def in_turn(first: Callable[[], object], second: Callable[[], object], rounds: int) -> tuple[float, float]:
    """Medians of both, measured alternately, so that other load on the machine affects both."""
    pairs = [(seconds(first), seconds(second)) for _ in range(rounds)]
    return statistics.median(a for a, _ in pairs), statistics.median(b for _, b in pairs)


def batch(paths: list[Path], out: Path, workers: int) -> None:
    done = sp.batch(paths, fresh(out), workers=workers, detector="none", progress=False)
    assert not done.failed and len(done) == len(paths), done.failed


def work_of_children() -> float:
    """CPU time of finished child processes, s: other load on the machine hardly affects it."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def workers(work: Path, frames: int, rounds: int) -> list[str]:
    paths = simulated(work / "long", 20, frames)
    worked: dict[int, list[float]] = {1: [], 2: []}

    def by(count: int) -> None:
        before = work_of_children()
        batch(paths, work / str(count), count)
        worked[count].append(work_of_children() - before)

    one, two = in_turn(lambda: by(1), lambda: by(2), rounds)
    total = 20 * frames
    cores = {count: statistics.median(all_rounds) for count, all_rounds in worked.items()}
    hours = 1000 * 3600 * 30 * cores[1] / total / 3600
    return [
        f"| twenty recordings of {frames / 30:g} s, one worker | {one:.1f} s; cores worked {cores[1]:.1f} s, {1e3 * cores[1] / total:.1f} ms per frame |",
        f"| the same, two workers | {two:.1f} s, {two / one:.2f} of that; cores worked {cores[2] / cores[1]:.2f} of that |",
        f"| a thousand hours at 30 Hz, multiplied from what cores worked in the first row | {hours:.0f} core hours |",
    ]


def on_ray(work: Path, frames: int, rounds: int) -> list[str]:
    try:
        import ray

        from stillpoint_slam import ray as sp_ray
    except ImportError:
        return ["| Ray | not measured: `ray` is not there |"]
    paths = simulated(work / "long", 20, frames)[:10]
    ray.init(num_cpus=1, log_to_driver=False, configure_logging=False, object_store_memory=100_000_000)
    ray.data.DataContext.get_current().enable_progress_bars = False

    def rows() -> None:
        done = sp_ray.batch(paths, fresh(work / "rows"), workers=1, memory=1e9).take_all()
        assert all(row["outcome"] == "ok" for row in done), done

    def plain() -> None:
        """The same calls without Ray, in one process."""
        code = "import sys, stillpoint_slam as sp\nfor i, p in enumerate(sys.argv[2:]): sp.run(p, out=f'{sys.argv[1]}/{i}', progress=False)"
        subprocess.run([sys.executable, "-c", code, str(fresh(work / "plain")), *map(str, paths)], check=True, env={**os.environ, "STILLPOINT_WORKERS": "1"})

    seconds(rows)
    alone, with_ray = in_turn(plain, rows, rounds)
    ray.shutdown()
    each = (with_ray - alone) / len(paths)
    return [f"| ten recordings of {frames / 30:g} s on Ray, one actor | {with_ray:.1f} s, {1e3 * each:+.0f} ms per recording beside the same runs in one process, {100 * (with_ray / alone - 1):+.1f} % |"]


def growth(work: Path, counts: list[int], frames: int) -> list[str]:
    lines = []
    for count in counts:
        paths = simulated(work / "short", count, frames)
        took = seconds(lambda paths=paths: batch(paths, work / "many", os.cpu_count() or 1))
        again = seconds(lambda paths=paths: sp.batch(paths, work / "many", detector="none", progress=False))
        lines.append(f"| {count} | {took:.1f} s | {1e3 * took / count:.0f} ms | {again:.2f} s |")
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a tenth of it, to see that it works")
    parser.add_argument("--rounds", type=int, help="how often each is measured (3)")
    parser.add_argument("--counts", type=int, nargs="+", help="numbers of short recordings (10 100 1000)")
    arguments = parser.parse_args()
    frames, rounds = (30, 1) if arguments.quick else (300, arguments.rounds or 3)
    counts = arguments.counts or ([3, 10, 30] if arguments.quick else [10, 100, 1000])
    print(f"{os.cpu_count()} cores, {platform.system()} {platform.machine()}, load {os.getloadavg()[1]:.1f}, Stillpoint {sp.__version__}\n")
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        print("| what | takes |\n|---|---|")
        for line in workers(work, frames, rounds) + on_ray(work, frames, rounds):
            print(line, flush=True)
        print("\n| recordings of 6 frames | batch | each | again, nothing to do |\n|---:|---:|---:|---:|")
        for line in growth(work, counts, 6):
            print(line, flush=True)


if __name__ == "__main__":
    main()
