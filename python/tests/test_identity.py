"""Trajectories and verdicts are identical to those of the command line."""

from __future__ import annotations

import csv
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import data

import stillpoint_slam as sp


def command_line(*arguments: object) -> None:
    """Runs the wheel's command line, or the program STILLPOINT_CLI."""
    program = os.environ.get("STILLPOINT_CLI")
    command = [program] if program else [sys.executable, "-m", "stillpoint_slam"]
    done = subprocess.run([*command, *map(str, arguments)], capture_output=True, text=True)
    assert done.returncode in (0, 1), done.stderr


def rows(path: Path) -> dict[float, str]:
    lines = (line.split() for line in path.read_text().splitlines() if line and line[0] != "#")
    return {float(stamp): name for stamp, name in lines}


@pytest.mark.parametrize("name", ["fr1_xyz", "fr1_xyz_walkers"])
def test_trajectories_equal_those_of_the_command_line(name: str, tmp_path: Path) -> None:
    path = data(name)
    command_line("run", path, "--detector", "none", "--no-report", "-q", "--out", tmp_path / "out")
    expected = (tmp_path / "out" / "trajectory.txt").read_bytes()
    recording = sp.open(path)
    with sp.Slam(recording.camera) as slam:
        for i in recording:
            slam.track(i.stamp, np.array(i.color), np.array(i.depth), depth_stamp=i.depth_stamp)
    slam.trajectory().save(tmp_path / "trajectory.txt")
    assert (tmp_path / "trajectory.txt").read_bytes() == expected
    assert sp.run(path, progress=False).trajectory.to_tum().encode() == expected


def test_raw_depth_images_give_the_same_trajectory(tmp_path: Path) -> None:
    image = pytest.importorskip("PIL.Image")
    path = data("fr1_xyz")
    files = rows(path / "depth.txt")
    texts = []
    for raw in (False, True):
        recording = sp.open(path, max_frames=60)
        with sp.Slam(recording.camera) as slam:
            for i in recording:
                depth = np.array(image.open(path / files[i.depth_stamp])).astype(np.uint16) if raw else i.depth
                slam.track(i.stamp, i.color, depth, depth_stamp=i.depth_stamp)
        texts.append(slam.trajectory().to_tum())
    assert texts[0] == texts[1]


def verdict_rows(path: Path) -> list[tuple[str, str, str, str, str]]:
    with path.open(newline="") as file:
        return [(r["timestamp"], r["u"], r["v"], r["verdict"], r["reasons"]) for r in csv.DictReader(file)]


@pytest.mark.parametrize("way", ["argument", "function"])
def test_python_boxes_give_the_verdicts_of_a_script(way: str, tmp_path: Path) -> None:
    room = sp.simulate("walking_xyz", frames=40)
    images = list(room)
    seen = [room.detections(i) for i in range(len(room))]
    assert any(seen)
    with sp.record(tmp_path / "room", room.camera) as recorder:
        for i in images:
            recorder.add(i.stamp, i.color, i.depth, depth_stamp=i.depth_stamp, truth=i.truth)
    script = tmp_path / "boxes.csv"
    with script.open("w") as file:
        file.write("timestamp,class,score,x0,y0,x1,y1\n")
        for i, boxes in zip(images, seen):
            for d in boxes:
                numbers = [repr(float(np.float32(d.score))), *(repr(v) for v in d.box)]
                file.write(f"{i.stamp!r},{d.class_name},{','.join(numbers)}\n")
    command_line(
        "run", tmp_path / "room", "--detector", f"scripted:{script}", "--no-report", "-q",
        "--verdicts", tmp_path / "verdicts.csv", "--out", tmp_path / "out",
    )  # fmt: skip
    expected = verdict_rows(tmp_path / "verdicts.csv")
    recording = sp.open(tmp_path / "room")
    turn = iter(seen)
    slam = sp.Slam(recording.camera, detector=(lambda image: next(turn)) if way == "function" else None)
    found = []
    for i, boxes in zip(recording, seen):
        given = boxes if way == "argument" else None
        frame = slam.track(i.stamp, i.color, i.depth, given, depth_stamp=i.depth_stamp)
        v = frame.verdicts
        for (u, w), dynamic, reasons in zip(v.pixels, v.dynamic, v.reasons):
            found.append((f"{i.stamp:.6f}", float(u), float(w), "dynamic" if dynamic else "static", reasons))
    slam.finish()
    said = [(t, float(u), float(v), verdict, reasons) for t, u, v, verdict, reasons in expected]
    assert len(found) == len(said) > 10_000
    assert [(t, verdict, reasons) for t, _, _, verdict, reasons in found] == [(t, d, r) for t, _, _, d, r in said]
    assert np.allclose([f[1:3] for f in found], [s[1:3] for s in said], atol=0.01)
    assert any("object" in f[4] for f in found)
    assert slam.trajectory().to_tum() == (tmp_path / "out" / "trajectory.txt").read_text()
    # Control: without the boxes the verdicts differ.
    plain = sp.Slam(recording.camera)
    without = []
    for i in recording:
        without.extend(plain.track(i.stamp, i.color, i.depth, depth_stamp=i.depth_stamp).verdicts.reasons)
    assert without != [f[4] for f in found]
