#!/usr/bin/env python3
"""Runs Stillpoint, ORB-SLAM3 and RTAB-Map's odometry on the same frames, one after the other, and prints a table.

compare.py [INPUT ...]      INPUT: sim:SCENE (`stillpoint simulate --help` lists them), or whatever `stillpoint run` takes with ground truth

The peers come from PyPI into an environment of their own below target/; they are programs to compare with, nothing of them is part of Stillpoint.
Each program runs --runs times, in turn: medians are said, and the range of the error. Without a detector unless --detector names one.
"""
import argparse
import json
import os
import statistics
import subprocess
import sys
import venv
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
PACKAGES = ["pyorbslam3==0.1.1", "depthai==3.12.0", "numpy", "opencv-python-headless"]
# Title and licence.
PROGRAMS = {
    "stillpoint": ("**Stillpoint**", "MIT or Apache-2.0"),
    "orbslam3": ("ORB-SLAM3", "GPL-3.0"),
    "rtabmap": ("RTAB-Map odometry", "BSD-3-Clause"),
}


def call(command, **options):
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True, **options)
    if done.returncode not in (0, 1):
        sys.exit(f"{' '.join(map(str, command))} ended with {done.returncode}:\n{done.stderr[-2000:]}")
    return done.stdout


def environment(folder):
    python = folder / "bin" / "python"
    if not python.exists():
        print(f"making {folder} with {', '.join(PACKAGES)}", file=sys.stderr)
        venv.create(folder, with_pip=True)
        subprocess.run([str(python), "-m", "pip", "install", "-q", *PACKAGES], check=True)
    return python


class Comparison:
    def __init__(self, arguments):
        self.a = arguments
        self.out = arguments.out
        self.python = environment(arguments.environment)

    def prepare(self, text):
        """The input as Stillpoint takes it, and the same frames as a folder in TUM's layout for all."""
        name = text if text.startswith("sim:") else Path(text).name
        folder = self.out / "inputs" / name.removeprefix("sim:")
        if not folder.exists():
            if text.startswith("sim:"):
                limit = ["--frames", self.a.frames] if self.a.frames else []
                call([self.a.stillpoint, "simulate", "--scene", folder.name, "--out", folder, *limit])
            else:
                limit = ["--max-frames", self.a.frames] if self.a.frames else []
                call([self.a.stillpoint, "recording", "convert", text, folder, *limit])
        return name, folder, folder if text.startswith("sim:") else Path(text)

    def stillpoint(self, folder, source, out, run):
        result = out.with_suffix("")
        limit = ["--max-frames", self.a.frames] if self.a.frames and source != folder else []
        options = ["--detector", self.a.detector, "--seed", run, "--no-report", "--out", result, *limit]
        call([self.a.stillpoint, "-q", "run", source, *options])
        summary = json.loads((result / "summary.json").read_text())
        out.write_text((result / "trajectory.txt").read_text())
        median = next(t["median"] for t in summary["timing_ms"] if t["stage"] == "frame")
        return {"frames": summary["frames"], "median_ms": median, "memory_bytes": summary["peak_memory_bytes"]}

    def peer(self, program, folder, out):
        vocabulary = ["--vocabulary", self.a.vocabulary] if program == "orbslam3" and self.a.vocabulary else []
        environment = os.environ | {"PYTHONPATH": str(HERE)}
        printed = call([self.python, HERE / f"{program}.py", folder, out, *vocabulary], env=environment)
        return json.loads(printed.strip().splitlines()[-1])

    def measure(self, text):
        name, folder, source = self.prepare(text)
        for run in range(self.a.runs):
            for program in PROGRAMS:
                out = self.out / "runs" / f"{folder.name}.{program}.{run}.txt"
                kept = out.with_suffix(".json")
                if kept.exists():
                    yield json.loads(kept.read_text())
                    continue
                out.parent.mkdir(parents=True, exist_ok=True)
                one = self.stillpoint(folder, source, out, run) if program == "stillpoint" else self.peer(program, folder, out)
                score = json.loads(call([self.a.stillpoint, "eval", "--json", folder / "groundtruth.txt", out]))
                poses = sum(1 for line in out.read_text().splitlines() if line.strip() and not line.startswith("#"))
                row = {"input": name, "program": program, "run": run, "ate_mm": score["ate"]["rmse"] * 1e3, "poses": poses, **one}
                kept.write_text(json.dumps(row))
                yield row


def table(rows):
    """A row per program: median errors per input (lowest to highest) and frames without a pose, times and memory of its worst input."""
    inputs = list(dict.fromkeys(r["input"] for r in rows))
    head = ["", *(f"`{name}`" for name in inputs), "ms per frame", "memory", "licence"]
    lines = [" | ".join(["", *head, ""]).strip(), "|---|" + "---:|" * (len(inputs) + 2) + "---|"]
    for program, (title, licence) in PROGRAMS.items():
        cells, times, memory = [title], [], []
        for name in inputs:
            runs = [r for r in rows if (r["input"], r["program"]) == (name, program)]
            errors = sorted(r["ate_mm"] for r in runs)
            lost = round(statistics.median(r["frames"] - r["poses"] for r in runs))
            span = f" ({errors[0]:.1f} to {errors[-1]:.1f})" if f"{errors[0]:.1f}" != f"{errors[-1]:.1f}" else ""
            cells.append(f"{statistics.median(errors):.1f}{span}" + (f", {lost} lost" if lost > 1 else ""))
            times.append(statistics.median(r["median_ms"] for r in runs))
            memory.append(max(r["memory_bytes"] for r in runs))
        cells += [f"{min(times):.0f} to {max(times):.0f}", f"{max(memory) / 1e6:.0f} MB", licence]
        lines.append(" | ".join(["", *cells, ""]).strip())
    return "\n".join(lines)


def document(rows, arguments):
    """The page that README's table is held against."""
    version = subprocess.run(["git", "-C", ROOT, "rev-parse", "--short=12", "HEAD"], capture_output=True, text=True).stdout.strip()
    names = " ".join(text if text.startswith("sim:") else f"DIR/{Path(text).name}" for text in arguments.inputs)
    return f"""# Beside ORB-SLAM3 and RTAB-Map
```text
python3 tools/peers/compare.py --document {names}
```

The same images for all, one program after the other, {arguments.runs} runs each, at commit {version} on {os.cpu_count()} cores. ATE RMSE of the final poses in mm: medians, in brackets the lowest and the highest. A first frame without a pose is
not counted as lost. Times are those of the tracking call, medians of the fastest and the slowest input. Memory is the largest of all runs. The peers are {PACKAGES[0]} and the node RTABMapVIO of {PACKAGES[1]} from PyPI, with their own parameters and 1000 features; the
odometry of RTAB-Map closes no loops. Stillpoint runs without a detector.

{table(rows)}
"""


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("inputs", nargs="*", default=["sim:walking_xyz"])
    parser.add_argument("--stillpoint", type=Path, default=ROOT / "target/release/stillpoint")
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--frames", type=int, help="the first N frames only")
    parser.add_argument("--detector", default="none", help="of Stillpoint, as for `stillpoint run`")
    parser.add_argument("--vocabulary", help="of ORB-SLAM3; default: ORBvoc.txt, downloaded once. vocabulary.py trains a small one")
    parser.add_argument("--environment", type=Path, default=ROOT / "target/peers/environment", help="where the peers are installed")
    parser.add_argument("--out", type=Path, default=ROOT / "target/peers", help="inputs, trajectories and figures; what is there is not run again")
    parser.add_argument("--document", action="store_true", help="also write docs/evidence/peers.md")
    comparison = Comparison(parser.parse_args())
    rows = [row for text in comparison.a.inputs for row in comparison.measure(text)]
    print(table(rows))
    if comparison.a.document:
        (ROOT / "docs/evidence/peers.md").write_text(document(rows, comparison.a))


main()
