#!/usr/bin/env python3
"""Measures the time from the start of the process to the poses of the first two frames.

tools/first_pose.py RUNS PROGRAM DATA...: minimum and median in ms per folder or recording, with its files in the system's cache (by a
first run). The minimum is the time of the work, the median includes other load on the machine."""

import os
import subprocess
import sys
import tempfile
import time

MARKS = [b"tracked frame=0 ", b"tracked frame=1 "]


def run(program, data, out):
    """Times until each mark, ms."""
    command = [program, "run", data, "--detector", "none", "--no-report", "--out", out, "-vv"]
    start = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    text, found = b"", []
    while len(found) < len(MARKS):
        piece = os.read(process.stderr.fileno(), 1 << 16)
        now = 1e3 * (time.perf_counter() - start)
        if not piece:
            sys.exit(f"expected {MARKS[len(found)].decode()!r} in what is said of {data}, found {text[-500:].decode()!r}")
        text += piece
        while len(found) < len(MARKS) and MARKS[len(found)] in text:
            found.append(now)
    process.kill()
    process.wait()
    return found


def main():
    if len(sys.argv) < 4:
        sys.exit(__doc__)
    runs, program = int(sys.argv[1]), sys.argv[2]
    print("| sequence | first frame: fastest, ms | median | second frame: fastest | median |\n|---|---:|---:|---:|---:|")
    for data in sys.argv[3:]:
        with tempfile.TemporaryDirectory() as folder:
            out = os.path.join(folder, "out")
            times = [run(program, data, out) for _ in range(runs + 1)][1:]
        first, second = (sorted(column) for column in zip(*times))
        middle = runs // 2
        name = os.path.basename(data.rstrip("/"))
        print(f"| {name} | {first[0]:.0f} | {first[middle]:.0f} | {second[0]:.0f} | {second[middle]:.0f} |")


if __name__ == "__main__":
    main()
